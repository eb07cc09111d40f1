"""From images to samples through the program: python3 detect_test.py SOURCE_DIR KINCAL [TEST ...]

Makes pictures of a chessboard (no lens: the detectors' accuracy is proved by tests/images). Proves: views with an image and no pixels get them,
all else of a samples file is kept; a folder of images becomes samples, with the readings of a table joined by name or by time; images that
cannot be used are named and counted and end nothing; equal boards in one picture are told apart by the joints or refused; where nothing is found nothing is written; one thread or four write the
same bytes; without kincal-detect the program says what to install.
"""

import functools
import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

import numpy

SOURCE_DIR = KINCAL = None
RIG = """format: kincal/1
robot: robot.urdf
base: base
targets:
  board: {type: chessboard, rows: 5, columns: 8, square: 0.02, mount: {link: base}}
sensors:
  eye: {type: camera, link: tip, model: pinhole, intrinsics: [600, 600, 199.5, 149.5], image_size: [400, 300], sigma: 0.2}
estimate:
  - {step: all, free: [sensor/eye/pose, target/board/pose]}
"""
URDF = """<robot name="r"><link name="base"/><link name="tip"/>
<joint name="j" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>
"""
SIDE = 30.0


def corners(angle, x, y):
    """Where the corners of the board are: turned about its point 0, which is at (x, y)."""
    c, s = numpy.cos(angle), numpy.sin(angle)
    return [[x + SIDE * (c * i - s * j), y + SIDE * (s * i + c * j)] for j in range(5) for i in range(8)]


@functools.lru_cache(maxsize=None)
def picture(angle, x, y, width=400, height=300, fine=5, wave=0):
    step = (numpy.arange(fine) + 0.5) / fine - 0.5
    u = (numpy.arange(width)[:, None] + step).ravel()[None, :] - x
    v = (numpy.arange(height)[:, None] + step).ravel()[:, None] - y
    u = u - wave * numpy.sin(v / 40)
    c, s = numpy.cos(angle), numpy.sin(angle)
    i, j = numpy.floor((c * u + s * v) / SIDE), numpy.floor((c * v - s * u) / SIDE)
    dark = ((i + j) % 2 == 0) & (i >= -1) & (i < 8) & (j >= -1) & (j < 5)
    bright = numpy.where(dark, 30.0, 220.0).reshape(height, fine, width, fine).mean(axis=(1, 3))
    return numpy.round(bright)


def pgm(image, bits=8):
    head = b"P5\n%d %d\n%d\n" % (image.shape[1], image.shape[0], 255 if bits == 8 else 65535)
    return head + (image.astype("u1") if bits == 8 else (image * 200).astype(">u2")).tobytes()


class Case(unittest.TestCase):
    def setUp(self):
        self.dir = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, self.dir)
        self.write("rig.yaml", RIG.encode())
        self.write("robot.urdf", URDF.encode())
        self.truth = {"a1": (0.1, 60, 60), "a2": (-0.15, 70, 110), "a10": (3.3, 330, 230)}
        for name, where in self.truth.items():
            self.write("images/%s.pgm" % name, pgm(picture(*where)))

    def write(self, name, data):
        path = os.path.join(self.dir, name)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "wb") as f:
            f.write(data)

    def detect(self, *arguments, code=0, program=None):
        p = subprocess.run([program or KINCAL, "detect", *arguments], cwd=self.dir, stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=300,
                           env={**os.environ, "PATH": "/nowhere"})
        self.out, self.err = p.stdout.decode(), p.stderr.decode()
        self.assertEqual(p.returncode, code, self.out + self.err)

    def samples(self, name="out.jsonl"):
        with open(os.path.join(self.dir, name)) as f:
            return [json.loads(line) for line in f]

    def right(self, pixels, name):
        difference = numpy.array(pixels) - corners(*self.truth[name])
        self.assertLess(numpy.abs(difference).max(), 0.1, name)


class Detect(Case):
    def setUp(self):
        super().setUp()
        if not os.path.exists(os.path.join(os.path.dirname(KINCAL), "kincal-detect")):
            self.skipTest("kincal-detect is not built: no OpenCV")

    def test_squares_in_place_of_corners(self):
        """A board that the rig has with another number of corners is told by its own."""
        for rows, columns in ((6, 9), (5, 9), (4, 8)):
            with self.subTest(rows=rows, columns=columns):
                self.write("rig.yaml", RIG.replace("rows: 5, columns: 8", "rows: %d, columns: %d" % (rows, columns)).encode())
                self.detect("rig.yaml", "images", "--sensor", "eye", "--out", "wrong.jsonl", "--force", code=1)
                self.assertIn("target 'board': no image shows a chessboard of %d x %d inner corners, but 3 of 3 looked at show 5 x 8" % (rows, columns), self.out)
                self.assertIn("Write rows: 5, columns: 8", self.out)

    def test_views_are_filled_in(self):
        given = [{"id": "one", "time": 3.25, "joints": {"j": 0.125}, "note": "kept", "split": "test",
                  "views": [{"sensor": "eye", "target": "board", "image": "images/a1.pgm", "sigma": 0.5}]},
                 {"id": "two", "joints": {"j": 0.25}, "views": [{"sensor": "eye", "target": "board", "pixels": [[1.5, 2]], "ids": [3], "image": "images/a2.pgm"}]},
                 {"id": "three", "joints": {"j": 0.5}, "views": [{"sensor": "eye", "target": "board", "image": "images/none.pgm"}]}]
        self.write("in.jsonl", "".join(json.dumps(s) + "\n" for s in given).encode())
        os.mkdir(os.path.join(self.dir, "there"))
        self.detect("rig.yaml", "in.jsonl", "--out", "there/out.jsonl", "--draw", "drawn")
        one, two = self.samples("there/out.jsonl")
        self.right(one["views"][0].pop("pixels"), "a1")
        for s in given:
            s["views"][0]["image"] = "../" + s["views"][0]["image"]
        self.assertEqual([one, two], given[:2])
        self.assertIn("images/none.pgm: UNUSABLE: the image is not there", self.out)
        self.assertIn("left out: sample 'three'", self.out)
        self.assertEqual(len(os.listdir(os.path.join(self.dir, "drawn"))), 1)
        self.detect("rig.yaml", "in.jsonl", "--out", "there/out.jsonl", code=1)
        self.assertIn("--force", self.err)

    def test_a_folder_becomes_samples(self):
        self.write("joints.csv", b"image,j\na1.pgm,0.5\na10.pgm,0.75\n")
        self.detect("rig.yaml", "images", "--out", "out.jsonl", "--joints", "joints.csv", "--threads", "1")
        one = self.samples()
        self.assertEqual([(s["id"], s["joints"], s["views"][0]["image"]) for s in one], [("a1", {"j": 0.5}, "images/a1.pgm"), ("a10", {"j": 0.75}, "images/a10.pgm")])
        for s in one:
            self.right(s["views"][0]["pixels"], s["id"])
        self.assertIn("image 'images/a2.pgm': no joint readings", self.out)
        self.detect("rig.yaml", "images/*.pgm", "--out", "four.jsonl", "--joints", "joints.csv", "--threads", "4")
        self.assertEqual(one, self.samples("four.jsonl"))
        p = subprocess.run([KINCAL, "calibrate", "rig.yaml", "out.jsonl", "--dry-run"], cwd=self.dir, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self.assertEqual(p.returncode, 0, p.stdout.decode())

    def test_every_type_of_target(self):
        more = """targets:
  tag: {type: marker, dictionary: DICT_4X4_50, id: 3, size: 0.05, mount: free}
  dots: {type: circles, rows: 4, columns: 5, spacing: 0.02, origin: large, mount: free}
  charuco: {type: charuco, rows: 5, columns: 7, square: 0.03, marker: 0.02, dictionary: DICT_5X5_100, mount: free}
  grid: {type: apriltag_grid, rows: 3, columns: 4, tag: 0.03, spacing: 0.3, family: tag36h11, mount: free}
"""
        self.write("rig.yaml", RIG.replace("targets:\n", more).encode())
        self.detect("rig.yaml", "images", "--out", "out.jsonl")
        self.assertIn("3 of 15 views found; 3 samples", self.out)
        for name in ("tag", "dots", "charuco", "grid"):
            self.assertIn("a1.pgm: %s: NOT FOUND: " % name, self.out)
        for old, new, words in (("DICT_4X4_50", "DICT_4X4_51", "DICT_4X4_51"), ("tag36h11", "tag36h12", "tag36h11"), ("origin: large", "origin: small", "large"),
                                ("id: 3, ", "", "id")):
            self.write("rig.yaml", RIG.replace("targets:\n", more).replace(old, new).encode())
            self.detect("rig.yaml", "images", "--out", "wrong.jsonl", code=1)
            self.assertIn(words, self.err)

    def equal_boards(self, pose="pose: {xyz: [%g, %g, 0.4]}"):
        """A rig with two equal boards before a camera that turns about its axis, and pictures of them; returns where their corners are."""
        rig = RIG.replace("[600, 600, 199.5, 149.5], image_size: [400, 300]", "[600, 600, 399.5, 199.5], image_size: [800, 400], pose: {xyz: [0, 0, 0]}")
        board, rest = rig.split("  board: ")[1].split("\n", 1)
        places = {"near": (0.02, -0.2, -0.06), "other": (-0.1, 0.05, -0.04)}      # turned by, m
        lines = "".join("  %s: %s\n" % (name, board.replace("link: base", "link: base" + (", " + pose % (x, y) if pose else ""))) for name, (_, x, y) in places.items())
        self.write("rig.yaml", (rig.split("  board: ")[0] + lines + rest).replace("target/board", "target/*").encode())
        shutil.rmtree(os.path.join(self.dir, "images"))
        true = {}
        for name, j, those in (("both", 0, ("near", "other")), ("turned", 0.2, ("near", "other")), ("more", -0.15, ("near", "other")), ("one", 0.1, ("other",))):
            seen = []
            for target in those:
                a, x, y = places[target]
                x, y = x * 1500, y * 1500       # px
                at = (a - j, 399.5 + numpy.cos(j) * x + numpy.sin(j) * y, 199.5 - numpy.sin(j) * x + numpy.cos(j) * y)
                seen.append(picture(*at, width=800, height=400))
                true[name, target] = corners(*at)
            self.write("images/%s.pgm" % name, pgm(numpy.minimum.reduce(seen)))
        return true

    def test_equal_boards_are_told_apart_by_the_joints(self):
        true = self.equal_boards()
        self.write("joints.csv", b"image,j\nboth.pgm,0\nturned.pgm,0.2\nmore.pgm,-0.15\none.pgm,0.1\n")
        self.detect("rig.yaml", "images", "--out", "out.jsonl", "--joints", "joints.csv")
        found = {(s["id"], v["target"]): v["pixels"] for s in self.samples() for v in s["views"]}
        self.assertEqual(sorted(found), sorted(true))
        for key, pixels in found.items():
            self.assertLess(numpy.abs(numpy.array(pixels) - true[key]).max(), 0.1, key)
        self.assertIn("one.pgm: near: NOT FOUND: of its print only another target's board is there", self.out)
        # Readings that fit neither well: views that they cannot assign are left out.
        self.write("joints.csv", b"image,j\nboth.pgm,0\nturned.pgm,1.57\nmore.pgm,1.5\none.pgm,-1.6\n")
        self.detect("rig.yaml", "images", "--out", "out.jsonl", "--joints", "joints.csv", "--force")
        self.assertEqual([s["id"] for s in self.samples()], ["both"])
        self.assertIn("turned.pgm: near: NOT FOUND: there is a board that cannot be identified as this one", self.out)

    def test_equal_boards_that_nothing_tells_are_refused(self):
        self.equal_boards()
        self.detect("rig.yaml", "images", "--out", "out.jsonl", code=1)
        for words in ("'near' and 'other' look the same", "joint 'j' has no reading", "first_id"):
            self.assertIn(words, self.err)
        self.equal_boards(pose=None)
        self.write("joints.csv", b"image,j\nboth.pgm,0\n")
        self.detect("rig.yaml", "images", "--out", "out.jsonl", "--joints", "joints.csv", code=1)
        for words in ("'near' and 'other' look the same", "the rig has no pose of 'near'", "first_id"):
            self.assertIn(words, self.err)

    def test_sigma_is_said_and_written_on_demand(self):
        self.detect("rig.yaml", "images", "--out", "out.jsonl")
        self.assertRegex(self.out, r"a1.pgm: board: 40 of 40 points, .*, sigma 0\.0\d\d px\n")
        self.assertFalse(any("sigma" in s["views"][0] for s in self.samples()))
        noisy = picture(*self.truth["a1"]) + numpy.random.default_rng(3).normal(0, 6, (300, 400))
        self.write("images/noisy.pgm", pgm(numpy.clip(numpy.round(noisy), 0, 255)))
        self.detect("rig.yaml", "images", "--out", "out.jsonl", "--sigma", "--force")
        sigma = {s["id"]: s["views"][0]["sigma"] for s in self.samples()}
        self.assertLess(sigma["a1"], 0.02)
        self.assertGreater(sigma["noisy"], 2 * sigma["a1"])
        given = {"id": "one", "joints": {"j": 0.1}, "views": [{"sensor": "eye", "target": "board", "image": "images/a1.pgm", "sigma": 0.5}]}
        self.write("in.jsonl", json.dumps(given).encode())
        self.detect("rig.yaml", "in.jsonl", "--out", "kept.jsonl", "--sigma")
        self.assertEqual(self.samples("kept.jsonl")[0]["views"][0]["sigma"], 0.5)

    def test_tables_as_people_write_them(self):
        """Separators, comments, folders, other endings and other case."""
        want = {"a1": 0.5, "a10": 0.75}
        for text in ("image;j;comment\r\nC:\\shots\\a1.jpg;0.5;first; \r\n".replace("; \r", "\r") + "a10.pgm;0.75;\r\n", "File\tj\tnote\nshots/a1.pgm\t0.5\tgood\na10.PGM\t0.75\tbad\n",
                     "\ufeffid,operator,j\nA1,me,0.5\na10,me,0.75\n", "id,image,j\nposture 1,a1.pgm,0.5\nposture 2,a10,0.75\n",
                     "image,j\na1.png,0.5\na10.pgm,0.75\na1.png,0.5\n", "image;j\na1.png;0,5\na10.pgm;0,75\n", "image j\na1 0.5\na10 0.75\n"):
            self.write("joints.csv", text.encode())
            self.detect("rig.yaml", "images", "--out", "out.jsonl", "--joints", "joints.csv", "--force")
            self.assertEqual({s["id"]: s["joints"]["j"] for s in self.samples()}, want, text)
        for text, options in (("j\n0.5\n0.1\n0.75\n", ()), ("A1\n28.64788975654116\n0\n42.97183463481174\n", ("--map", "A1=j", "--angles", "deg"))):  # by their order
            self.write("joints.csv", text.encode())
            self.detect("rig.yaml", "images", "--out", "out.jsonl", "--joints", "joints.csv", "--force", *options)
            self.assertEqual({s["id"]: round(s["joints"]["j"], 12) for s in self.samples()}, {**want, "a2": 0 if options else 0.1}, text)
            self.assertIn("3 rows without names go with the images in the order of their names", self.out)
        self.write("joints.csv", b"image,j\nleft/a1.pgm,1\nimages/a1.pgm,2\n")    # folders decide
        self.detect("rig.yaml", "images", "--out", "out.jsonl", "--joints", "joints.csv", "--force")
        self.assertEqual(self.samples()[0]["joints"], {"j": 2})
        for text, words in (("image,j\na1.pgm,0.5\na1.pgm,0.6\n", ("joints.csv:3", "images/a1.pgm", "joints.csv:2")),
                            ("image;j\na1.pgm;0,5,1\n", ("joints.csv:2: j", "write a point", "'0,5,1'")),
                            ("image,j\na1.pgm,\n", ("joints.csv:2: j", "''")),
                            ("image,j\na1.pgm,1,2\n", ("joints.csv:2: 3 cells; the header has 2",)),
                            ("a1.pgm,0.5\na2.pgm,0.6\n", ("joints.csv:1", "`image`")),
                            ("image,joint\na1.pgm,0.5\n", ("joints.csv:1", "the robot has: j")),
                            ("time,j\nnoon,0.5\n", ("joints.csv:2: time", "'noon'")),
                            ("image,j,j\na1.pgm,0.5,0.6\n", ("joints.csv:1", "two columns 'j'")),
                            ("image,image,j\na1.pgm,a2.pgm,0.6\n", ("joints.csv:1", "two columns 'image'")),
                            ("image,j,note\na1.pgm,0.5\n", ("joints.csv:2: 2 cells; the header has 3",)),
                            ('{"image": "a1.pgm", "joints": {"j": 1, "j": 2}}\n', ("joints.csv:1", "j")),
                            ("\n", ("joints.csv", "no row of numbers"))):
            self.write("joints.csv", text.encode())
            self.detect("rig.yaml", "images", "--out", "wrong.jsonl", "--joints", "joints.csv", code=1)
            for word in words:
                self.assertIn(word, self.err, text)
        self.assertFalse(os.path.exists(os.path.join(self.dir, "wrong.jsonl")))

    def test_names_in_tables(self):
        """A joint that is missing is named, one that is misspelt refused, and what is no joint left out."""
        joint = '<joint name="%s" type="revolute"><parent link="%s"/><child link="%s"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        self.write("robot.urdf", ('<robot name="r"><link name="base"/><link name="arm"/><link name="tip"/>' + joint % ("shoulder", "base", "arm") +
                                  joint % ("elbow", "arm", "tip") + "</robot>").encode())
        for text, words in (("image,shoulder,elbw\na1.pgm,0.5,0.25\n", ("joints.csv:1", "'elbw'", "nearest: elbow")),
                            ('{"image": "a1.pgm", "joints": {"shoulder": 0.5, "elbw": 0.25}}\n', ("joints.csv:1", "'elbw'", "nearest: elbow"))):
            self.write("joints.csv", text.encode())
            self.detect("rig.yaml", "images", "--out", "wrong.jsonl", "--joints", "joints.csv", code=1)
            for word in words:
                self.assertIn(word, self.err, text)
        self.write("joints.csv", b"image,shoulder,elbow,temperature\na1.pgm,0.5,0.25,36.5\n")
        self.detect("rig.yaml", "images", "--out", "out.jsonl", "--joints", "joints.csv")
        self.assertEqual(self.samples()[0]["joints"], {"shoulder": 0.5, "elbow": 0.25})
        self.assertNotIn("no reading of joint", self.out)
        self.write("joints.csv", b"image,shoulder\na1.pgm,0.5\n")
        self.detect("rig.yaml", "images", "--out", "out.jsonl", "--joints", "joints.csv", "--force")
        self.assertIn("joints.csv:2: no reading of joint 'elbow'", self.out)

    def test_tables_of_poses_that_are_wrong(self):
        self.write("rig.yaml", RIG.replace("robot: robot.urdf", "robot: {base: base, flange: tip}").encode())
        head = "image,x,y,z,qx,qy,qz,qw\n"
        for text, arguments, words in ((head + "a1.pgm,0.1,0.2,0.3,0,0,1\n", ["xyzw"], ("poses.csv:2: 7 cells",)),
                                       (head + "a1.pgm,0.1,0.2,0.3,0,0,0.5,0.5\n", ["xyzw"], ("poses.csv:2", "length 1", "0.707")),
                                       (head + "a1.pgm,0.1,far,0.3,0,0,0,1\n", ["xyzw"], ("poses.csv:2: y", "'far'")),
                                       ("a1.pgm,0.1,0.2,0.3,0,0\n", ["xyzw"], ("poses.csv:1", "needs 7 numbers")),
                                       (head + "a1.pgm,0.1,0.2,0.3,0,0,0,1\n", ["xyz_quat"], ("--pose-format", "valid: xyzw")),
                                       (head + "a1.pgm,0.1,0.2,0.3,0,0,0,1\n", ["xyzw", "--unit", "cm"], ("--unit", "'mm'")),
                                       ("image,x,y,z,rx,ry,rz\na1.pgm,0.1,0.2,0.3,90,0,0\n", ["rotvec"], ("poses.csv:2: rx", "90", "rad")),
                                       ("x,y,z,qx,qy,qz,qw\n0.1,0.2,0.3,0,0,0,1\n", ["xyzw"], ("poses.csv", "1 rows and 3 images", "`image`")),
                                       (head + "a1.pgm,0.1,0.2,0.3,0,0,0,1\na1.pgm,0.1,0.2,0.4,0,0,0,1\n", ["xyzw"], ("poses.csv:3", "images/a1.pgm"))):
            self.write("poses.csv", text.encode())
            self.detect("rig.yaml", "images", "--out", "wrong.jsonl", "--joints", "poses.csv", "--pose-format", *arguments, code=1)
            for word in words:
                self.assertIn(word, self.err, text)
        self.write("joints.csv", b"image,x,y\na1.pgm,1,2\n")
        self.detect("rig.yaml", "images", "--out", "wrong.jsonl", "--joints", "joints.csv", code=1)
        self.assertIn("--pose-format", self.err)

        self.write("poses.csv", (head + "a1.pgm,512,0.2,0.3,0,0,0,1\na2.pgm,0.2,0.2,0.3,0,0,0,1\n").encode())
        self.detect("rig.yaml", "images", "--out", "far.jsonl", "--joints", "poses.csv", "--pose-format", "xyzw")
        self.assertIn("512 m away: if lengths are in mm, take --unit mm", self.out)
        self.detect("rig.yaml", "pictures", "--out", "wrong.jsonl", code=1)
        self.assertIn("pictures: there is no such file or folder", self.err)

    def test_ids_are_unique(self):
        os.rename(os.path.join(self.dir, "images", "a2.pgm"), os.path.join(self.dir, "images", "a1.PGM"))
        self.detect("rig.yaml", "images", "--out", "out.jsonl")
        self.assertEqual(sorted(s["id"] for s in self.samples()), ["a1.PGM", "a1.pgm", "a10"])
        view = {"sensor": "eye", "target": "board", "image": "images/a1.pgm"}
        for ids, words in (((1, 2), "in.jsonl:1: id"), (("x", "x"), "in.jsonl:2: id 'x' is that of line 1 already")):
            self.write("in.jsonl", "".join(json.dumps({"id": i, "joints": {}, "views": [view]}) + "\n" for i in ids).encode())
            self.detect("rig.yaml", "in.jsonl", "--out", "wrong.jsonl", code=1)
            self.assertIn(words, self.err)

    def test_images_are_found_again_from_another_folder(self):
        self.write("joints.csv", b"image,j\na1.pgm,0.5\na10.pgm,0.75\n")
        os.makedirs(os.path.join(self.dir, "results", "today"))
        self.detect("rig.yaml", "images", "--out", "results/today/out.jsonl", "--joints", "joints.csv")
        one = self.samples("results/today/out.jsonl")
        self.assertEqual(one[0]["views"][0]["image"], "../../images/a1.pgm")
        for s in one:
            s["views"] = [{k: v for k, v in s["views"][0].items() if k not in ("pixels", "ids")}]
        self.write("results/today/again.jsonl", "".join(json.dumps(s) + "\n" for s in one).encode())
        for folder, rig, name, out in ((".", "rig.yaml", "results/today/again.jsonl", "found.jsonl"),
                                       ("results", "../rig.yaml", "today/again.jsonl", "../found2.jsonl"), ("results/today", "../../rig.yaml", "again.jsonl", "found3.jsonl")):
            p = subprocess.run([KINCAL, "detect", rig, name, "--out", out], cwd=os.path.join(self.dir, folder), stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            self.assertIn("2 of 2 views found", p.stdout.decode())
        self.assertEqual(self.samples("found2.jsonl")[0]["views"][0]["image"], "images/a1.pgm")
        p = subprocess.run([KINCAL, "calibrate", "../rig.yaml", "today/out.jsonl", "--dry-run"], cwd=os.path.join(self.dir, "results"), stdout=subprocess.PIPE)
        self.assertEqual(p.returncode, 0)

    def test_readings_by_time(self):
        for name, new in (("a1", "12.50"), ("a2", "1700000000250000000"), ("a10", "99")):
            os.rename(os.path.join(self.dir, "images", name + ".pgm"), os.path.join(self.dir, "images", new + ".pgm"))
        self.write("joints.jsonl", b'{"time": 12.4, "joints": {"j": 1}}\n{"time": 12.49, "joints": {"j": 2}}\n{"time": 1700000000.26, "joints": {"j": 3}}\n')
        self.detect("rig.yaml", "images", "--out", "out.jsonl", "--joints", "joints.jsonl", "--tolerance", "0.02")
        self.assertEqual({s["id"]: s["joints"]["j"] for s in self.samples()}, {"12.50": 2, "1700000000250000000": 3})
        self.assertIn("99.pgm", self.out)
        self.write("images/frame_7.pgm", pgm(picture(*self.truth["a1"])))
        self.detect("rig.yaml", "images", "--out", "more.jsonl", "--joints", "joints.jsonl")
        self.assertIn("frame_7.pgm': no joint readings in joints.jsonl, which is matched by time: the image's name is not a number", self.out)

    def test_a_board_that_is_not_flat(self):
        self.detect("rig.yaml", "images", "--out", "out.jsonl")
        self.assertNotIn("the board is warped", self.out)
        for name, where in self.truth.items():
            self.write("images/%s.pgm" % name, pgm(picture(*where, wave=1.5)))
        self.detect("rig.yaml", "images", "--out", "bent.jsonl")
        self.assertRegex(self.out, r"target 'board': its points deviate by [0-9.]+ px from a plane seen through a lens .*: the board is warped, or the lens distorts strongly")

    def test_poses_of_a_flange(self):
        self.write("rig.yaml", RIG.replace("robot: robot.urdf", "robot: {base: base, flange: tip}").encode())
        half = 0.5 ** 0.5
        poses = {"a1": ([0.1, 0.2, 0.3], [0, 0, half, half]), "a2": ([0.4, 0, 0.3], [half, 0, 0, half])}
        self.write("joints.jsonl", "".join(json.dumps({"image": name + ".pgm", "joints": {"flange": {"xyz": xyz, "quat": quat}}}) + "\n"
                                           for name, (xyz, quat) in poses.items()).encode())
        self.write("kuka.csv", b"image,X,Y,Z,A,B,C\na1.pgm,100,200,300,90,0,0\na2.pgm,400,0,300,0,0,90\n")
        for name, more in (("joints.jsonl", ()), ("kuka.csv", ("--pose-format", "kuka"))):
            self.detect("rig.yaml", "images", "--out", "out.jsonl", "--joints", name, "--force", *more)
            found = {s["id"]: s["joints"]["flange"] for s in self.samples()}
            self.assertEqual(sorted(found), ["a1", "a2"])
            for key, (xyz, quat) in poses.items():
                numpy.testing.assert_allclose(found[key]["xyz"] + found[key]["quat"], xyz + quat, atol=1e-12)
        p = subprocess.run([KINCAL, "calibrate", "rig.yaml", "out.jsonl", "--dry-run"], cwd=self.dir, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self.assertEqual(p.returncode, 0, p.stdout.decode())
        self.write("joints.jsonl", b'{"image": "a1.pgm", "joints": {"flange": {"xyz": [1, 2, 3]}}}\n')
        self.detect("rig.yaml", "images", "--out", "other.jsonl", "--joints", "joints.jsonl", code=1)
        self.assertIn("joints.jsonl:1", self.err)
        self.assertIn("quat", self.err)

    def test_what_cannot_be_used_is_named(self):
        self.write("images/empty.pgm", b"")
        self.write("images/broken.png", b"\x89PNG\r\n\x1a\nno more")
        self.write("images/small.pgm", pgm(picture(0.1, 60, 60)[:200]))
        self.write("images/grey.pgm", pgm(numpy.full((300, 400), 128)))
        self.write("images/deep.pgm", pgm(picture(*self.truth["a1"]), bits=16))
        os.mkdir(os.path.join(self.dir, "images", "folder.png"))
        blurred = picture(*self.truth["a1"])
        for axis in (0, 1):     # so far that nothing is left of the squares
            for _ in range(12):
                blurred = sum(numpy.roll(blurred, k, axis) for k in range(-7, 8)) / 15
        self.write("images/blurred.pgm", pgm(numpy.round(blurred)))
        self.detect("rig.yaml", "images", "--out", "out.jsonl", "--quiet")
        self.assertEqual([s["id"] for s in self.samples()], ["a1", "a2", "a10", "deep"])
        self.right(self.samples()[3]["views"][0]["pixels"], "a1")
        for words in ("empty.pgm: UNUSABLE: the image is empty", "broken.png: UNUSABLE", "small.pgm: UNUSABLE: the image has 400 x 200 pixels, the rig's image_size is 400 x 300",
                      "grey.pgm: board: NOT FOUND", "blurred.pgm: board: NOT FOUND"):
            self.assertIn(words, self.out)
        self.assertNotIn("views found", self.out)
        self.assertIn("1 of 9 images: each has more than 8 bits: its range was mapped to 8", self.out)
        self.detect("rig.yaml", "images", "--out", "out.jsonl", "--force")
        self.assertIn("4 of 9 views found, 3 images not usable; 4 samples", self.out)
        self.detect("rig.yaml", "images/grey.pgm", "--out", "none.jsonl", code=1)
        self.assertFalse(os.path.exists(os.path.join(self.dir, "none.jsonl")))


class Missing(Case):
    def test_the_program_says_what_to_install(self):
        alone = os.path.join(self.dir, "kincal")
        shutil.copy(KINCAL, alone)
        self.detect("rig.yaml", "images", "--out", "out.jsonl", program=alone, code=1)
        self.assertIn("libopencv-contrib-dev", self.err)
        self.detect("--help", program=alone)
        self.assertIn("--joints", self.out)


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = sys.argv[1], os.path.abspath(sys.argv[2])
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
