"""From a rig to pictures and back: python3 render_test.py SOURCE_DIR KINCAL [TEST ...]

Proves: `simulate --render` takes pictures in which `detect` finds every type of target where the simulation says that it is, through every
lens, also of the right camera of a rectified pair; the pictures' samples have images and no pixels unless asked, joints.csv
goes with the pictures alone; the same seed gives the same pictures for any number of threads; what cannot be is said, and without
kincal-render what to install. The arm of examples/arm goes from pictures to a calibration that is right against the truth. Boards that look the
same from several sides are numbered alike in all pictures, as the joint readings say. `simulate --bag` records what it says, as an independent reader
(python3-rosbag; skipped without it) agrees for ROS 1; MCAP files are read by kincal itself here.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

import numpy

SOURCE_DIR = KINCAL = None
LINKS = ["base", "one", "two", "three", "four", "five", "tip"]
AXES = ["0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"]
PLACES = ["0 0 0.3", "0 0 0.1", "0 0 0.4", "0.3 0 0", "0.1 0 0", "0.08 0 0"]
BOARDS = {
    "chessboard": "{type: chessboard, rows: 6, columns: 9, square: 0.02, mount: %s}",
    "charuco": "{type: charuco, rows: 6, columns: 8, square: 0.025, marker: 0.0175, dictionary: DICT_5X5_250, mount: %s}",
    "circles": "{type: circles, rows: 5, columns: 7, spacing: 0.025, origin: large, mount: %s}",
    "asymmetric": "{type: circles, rows: 11, columns: 4, spacing: 0.018, asymmetric: true, mount: %s}",
    "grid": "{type: apriltag_grid, rows: 4, columns: 5, tag: 0.03, spacing: 0.3, family: tag36h11, mount: %s}",
    "marker": "{type: marker, dictionary: DICT_4X4_50, id: 7, size: 0.08, mount: %s}",
}
LENSES = {
    "pinhole": "model: pinhole, intrinsics: [520, 522, 321.2, 236.7]",
    "brown": "model: brown_conrady, intrinsics: [520, 522, 321.2, 236.7], distortion: [-0.2, 0.06, 0.001, -0.0005, 0]",
    "rational": "model: brown_conrady, intrinsics: [520, 522, 321.2, 236.7], distortion: [0.2, 0.05, 0.0004, -0.0005, 0.01, 0.3, 0.05, 0.01]",
    "fisheye": "model: kannala_brandt, intrinsics: [330, 331, 321.2, 236.7], distortion: [0.02, -0.01, 0.002, 0]",
    "right": "model: pinhole, intrinsics: [520, 522, 321.2, 236.7], baseline: 0.11",
}


def urdf():
    text = '<robot name="arm">' + "".join('<link name="%s"/>' % name for name in LINKS)
    for i, (axis, xyz) in enumerate(zip(AXES, PLACES)):
        text += ('<joint name="j%d" type="revolute"><parent link="%s"/><child link="%s"/><origin xyz="%s"/><axis xyz="%s"/>'
                 '<limit lower="-2.5" upper="2.5" effort="1" velocity="1"/></joint>' % (i + 1, LINKS[i], LINKS[i + 1], xyz, axis))
    return text + "</robot>\n"


def rig(cameras, boards, steps="", joints=""):
    """Cameras: name → (link, lens); boards: name → (type, mount)."""
    text = "format: kincal/1\nrobot: robot.urdf\nbase: base\n" + joints + "targets:\n"
    text += "".join("  %s: %s\n" % (name, BOARDS[kind] % mount) for name, (kind, mount) in boards.items()) + "sensors:\n"
    for name, (link, lens) in cameras.items():
        text += "  %s: {type: camera, link: %s, %s, image_size: [640, 480], sigma: 0.000001, pose: {xyz: [0.05, 0, 0.04]}}\n" % (name, link, LENSES[lens])
    return text + steps


class Case(unittest.TestCase):
    def setUp(self):
        if not os.path.exists(os.path.join(os.path.dirname(KINCAL), "kincal-render")) and type(self).__name__ != "Missing":
            self.skipTest("kincal-render is not built: no OpenCV")
        self.dir = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, self.dir)
        self.write("robot.urdf", urdf())

    def write(self, name, text):
        with open(os.path.join(self.dir, name), "w") as f:
            f.write(text)

    def run_it(self, *arguments, code=0, program=None):
        p = subprocess.run([program or KINCAL, *arguments], cwd=self.dir, stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=500,
                           env={**os.environ, "PATH": "/nowhere"})
        self.out, self.err = p.stdout.decode(), p.stderr.decode()
        self.assertEqual(p.returncode, code, self.out + self.err)

    def samples(self, name):
        with open(os.path.join(self.dir, name)) as f:
            return [json.loads(line) for line in f]

    def bytes(self, name):
        with open(os.path.join(self.dir, name), "rb") as f:
            return f.read()

    def errors(self, found, true):
        """Distances between what was found and what is there, of all views that are in both, and the share of points that were found."""
        known = {(s["id"], v["sensor"], v["target"]): dict(zip(v["ids"], v["pixels"])) for s in true for v in s["views"]}
        distances, points = [], 0
        for s in found:
            for v in s["views"]:
                there = known[s["id"], v["sensor"], v["target"]]
                ids = v.get("ids") or range(len(v["pixels"]))
                distances += [numpy.subtract(there[i], p) for i, p in zip(ids, v["pixels"])]
        points = sum(map(len, known.values()))
        return numpy.array(distances), len(distances) / points


class Pictures(Case):
    def there_and_back(self, cameras, boards, limit, least):
        self.write("rig.yaml", rig(cameras, boards))
        self.run_it("simulate", "rig.yaml", "--samples", "6", "--seed", "4", "--out", "sim", "--render", "pictures", "--pixels", "--image-noise", "1", "--force")
        true = self.samples("sim/samples.jsonl")
        self.write("asked.jsonl", "".join(json.dumps({**s, "views": [{k: v[k] for k in ("sensor", "target")} | {"image": v["image"][3:]} for v in s["views"]]}) + "\n"
                                          for s in true))
        self.run_it("detect", "rig.yaml", "asked.jsonl", "--out", "found.jsonl", "--force")
        distances, share = self.errors(self.samples("found.jsonl"), true)
        self.assertGreater(share, least, self.out)
        self.assertLess(numpy.sqrt((distances ** 2).sum(axis=1).mean()), limit, self.out)
        self.assertLess(numpy.abs(distances.mean(axis=0)).max(), 0.02)

    def test_every_type_is_found_where_it_is(self):
        for kind in BOARDS:
            with self.subTest(kind):
                least = 0.5 if kind == "grid" else 0.8  # tags of some 20 px, as in three of these six, are often not read
                self.there_and_back({"eye": ("tip", "brown")}, {"board": (kind, "free")}, 0.15, least)

    def test_every_lens(self):
        for lens in LENSES:
            with self.subTest(lens):
                self.there_and_back({"eye": ("tip", lens)}, {"board": ("charuco", "free")}, 0.12, 0.8)


class Files(Case):
    def setUp(self):
        super().setUp()
        self.write("rig.yaml", rig({"left": ("tip", "brown"), "right": ("tip", "right")}, {"board": ("chessboard", "free")}))

    def test_images_and_joints(self):
        self.run_it("simulate", "rig.yaml", "--samples", "4", "--seed", "4", "--out", "sim", "--render", "sim/images", "--threads", "1")
        self.assertIn("8 pictures", self.out)
        samples = self.samples("sim/samples.jsonl")
        self.assertEqual([[v["image"] for v in s["views"]] for s in samples],
                         [["images/sample_%04d_left.png" % i, "images/sample_%04d_right.png" % i] for i in range(4)])
        self.assertFalse(any("pixels" in v or "ids" in v for s in samples for v in s["views"]))
        rows = self.bytes("sim/joints.csv").decode().splitlines()
        self.assertEqual(len(rows), 9)
        self.assertEqual(rows[0], "image,j1,j2,j3,j4,j5,j6")
        self.assertEqual(rows[1], "sample_0000_left.png," + ",".join(repr(samples[0]["joints"]["j%d" % i]) for i in range(1, 7)))
        self.run_it("calibrate", "rig.yaml", "sim/samples.jsonl", "--dry-run", code=1)
        self.assertIn("kincal detect", self.err)
        self.run_it("detect", "rig.yaml", "sim/images/*_left.png", "--sensor", "left", "--joints", "sim/joints.csv", "--out", "left.jsonl")
        self.assertEqual([s["joints"] for s in self.samples("left.jsonl")], [s["joints"] for s in samples])
        self.run_it("simulate", "rig.yaml", "--samples", "4", "--seed", "4", "--out", "again", "--render", "pictures", "--threads", "3", "--quiet")
        self.run_it("simulate", "rig.yaml", "--samples", "4", "--seed", "4", "--out", "plain")
        self.assertEqual(self.bytes("again/truth.json"), self.bytes("plain/truth.json"))
        for name in os.listdir(os.path.join(self.dir, "pictures")):
            self.assertEqual(self.bytes("sim/images/" + name), self.bytes("pictures/" + name), name)
        self.run_it("simulate", "rig.yaml", "--samples", "4", "--seed", "5", "--out", "other", "--render", "pictures", code=1)
        self.assertIn("--force", self.err)
        self.assertFalse(os.path.exists(os.path.join(self.dir, "other")))
        self.run_it("simulate", "rig.yaml", "--samples", "4", "--seed", "5", "--out", "other", "--render", "pictures", "--force")
        self.assertNotEqual(self.bytes("sim/images/sample_0000_left.png"), self.bytes("pictures/sample_0000_left.png"))
        # The folder of images inside the simulation is replaced with it, and never deleted with it.
        self.write("sim/images/notes.txt", "mine")
        self.run_it("simulate", "rig.yaml", "--samples", "4", "--seed", "5", "--out", "sim", "--render", "sim/images", "--force", "--quiet")
        self.assertEqual(self.out, "")
        self.assertEqual(self.bytes("sim/samples.jsonl").replace(b"images/", b"../pictures/"), self.bytes("other/samples.jsonl"))
        for name in os.listdir(os.path.join(self.dir, "pictures")):
            self.assertEqual(self.bytes("sim/images/" + name), self.bytes("pictures/" + name), name)
        self.assertEqual(self.bytes("sim/images/notes.txt"), b"mine")
        self.run_it("simulate", "rig.yaml", "--samples", "4", "--seed", "5", "--out", "sim", "--force", code=1)
        self.assertIn("holds images", self.err)
        self.assertEqual([n for n in os.listdir(self.dir) if n.startswith("sim")], ["sim"])

    def test_what_cannot_be(self):
        self.run_it("simulate", "rig.yaml", "--samples", "2", "--seed", "4", "--out", "sim", "--blur", "1", code=1)
        self.assertIn("--render", self.err)
        self.run_it("simulate", "rig.yaml", "--samples", "2", "--seed", "4", "--out", "sim", "--render", "p", "--background", "green", code=1)
        self.write("rig.yaml", rig({"eye": ("tip", "brown")}, {"board": ("chessboard", "free")}).replace(", image_size: [640, 480]", ""))
        self.run_it("simulate", "rig.yaml", "--samples", "2", "--seed", "4", "--out", "sim", "--render", "p", code=1)
        self.assertIn("image_size", self.err)
        self.assertFalse(os.path.exists(os.path.join(self.dir, "sim")))


class Arm(Case):
    """The arm of examples/arm takes other pictures."""

    def setUp(self):
        super().setUp()
        self.arm = os.path.join(SOURCE_DIR, "examples", "arm")
        shutil.copy(os.path.join(self.arm, "robot.urdf"), self.dir)
        with open(os.path.join(self.arm, "rig.yaml")) as f:
            self.rig = f.read()

    def simulate(self, seed, *more):
        self.run_it("simulate", "rig.yaml", "--samples", "16", "--seed", seed, "--truth", os.path.join(self.arm, "truth.json"),
                    "--postures", os.path.join(self.arm, "postures.jsonl"), "--out", "sim", "--render", "images", "--force", *more)

    def detect(self, *more):
        self.run_it("detect", "rig.yaml", "images", "--out", "found.jsonl", "--force", *more)


class Calibrated(Arm):
    def test_from_pictures_to_the_truth(self):
        self.write("rig.yaml", self.rig)
        self.simulate("11", "--image-noise", "0.4", "--blur", "0.7", "--background", "gradient")
        self.detect("--joints", "sim/joints.csv")
        self.run_it("check", "rig.yaml", "found.jsonl")
        self.assertIn("Nothing found", self.out)
        self.run_it("calibrate", "rig.yaml", "found.jsonl", "--out", "result")
        with open(os.path.join(self.dir, "result", "result.json")) as f:
            result = json.load(f)
        self.assertTrue(0.6 < result["chi2_data"] / result["dof_data"] < 1.5, result["chi2_data"] / result["dof_data"])
        for name, true in (("lift", -0.0121), ("bend", 0.0163), ("forearm_roll", 0.0087), ("wrist_bend", -0.0142)):
            found = result["parameters"]["joint/%s/offset" % name]
            value, sigma = numpy.ravel(found["value"])[0], numpy.ravel(found["sigma"])[0]
            self.assertLess(abs(value - true), 4 * sigma, name)
            self.assertLess(sigma, 0.001)


class Numbering(Arm):
    """Boards that look the same from several sides, seen by a camera that rolls all around."""

    def board(self, rows, columns, mount="{link: base}"):
        head, rest = self.rig.split("    type: charuco")
        rest = rest.split("    mount: {link: base}")[1]
        text = "    type: chessboard\n    rows: %d\n    columns: %d\n    square: 0.03\n    mount: %s" % (rows, columns, mount)
        self.write("rig.yaml", head + text + rest)

    def turns(self, rows, columns):
        """Quarter turns of each view from how the simulation numbers it."""
        true = {s["id"]: s["views"][0] for s in self.samples("sim/samples.jsonl")}
        grid, out = numpy.arange(rows * columns).reshape(rows, columns), []
        for s in self.samples("found.jsonl"):
            pixels, there = (numpy.array(v["pixels"]) for v in (s["views"][0], true[s["id"]]))
            errors = {q: numpy.abs(pixels - there[numpy.rot90(grid, q).ravel()]).max() for q in range(4) if rows == columns or q % 2 == 0}
            out.append(min(errors, key=errors.get))
            self.assertLess(min(errors.values()), 0.5)
        self.assertGreater(len(out), 11)
        return set(out)

    def test_views_agree_with_the_joints(self):
        for rows, columns in ((5, 7), (6, 6), (5, 5)):
            with self.subTest(rows=rows, columns=columns):
                self.board(rows, columns)
                self.simulate("3", "--pixels")
                self.detect()
                self.assertGreater(len(self.turns(rows, columns)), 1)
                self.assertIn("no joint readings", self.out)
                self.detect("--joints", "sim/joints.csv")
                self.assertEqual(len(self.turns(rows, columns)), 1)
                self.assertIn("views were turned", self.out)

    def test_a_given_board_decides_the_rest(self):
        self.board(6, 6, "{link: base, pose: {xyz: [0.47, 0.13, 0.02], rpy: [3.13, 0, 0.35]}}")
        with open(os.path.join(self.arm, "truth.json")) as f:
            truth = json.load(f)["parameters"]
        self.write("truth.json", json.dumps({"parameters": {k: v for k, v in truth.items() if not k.startswith("target")}}))
        self.arm, arm = self.dir, self.arm
        shutil.copy(os.path.join(arm, "postures.jsonl"), self.dir)
        self.simulate("3", "--pixels")
        self.detect("--joints", "sim/joints.csv")
        self.assertEqual(self.turns(6, 6), {0})


class Bags(Case):
    """Recordings of a simulation: `simulate --bag`."""

    def setUp(self):
        super().setUp()
        self.write("rig.yaml", rig({"left": ("tip", "brown"), "right": ("tip", "fisheye")}, {"board": ("charuco", "free")}, joints='joints: {"*": {sigma: 0.0003}}\n')
                   .replace("[640, 480]", "[160, 120]").replace("intrinsics: [520, 522, 321.2, 236.7]", "intrinsics: [130, 130, 80, 60]")
                   .replace("intrinsics: [330, 331, 321.2, 236.7]", "intrinsics: [90, 90, 80, 60]"))

    def record(self, name, *options, code=0):
        self.run_it("simulate", "rig.yaml", "--samples", "3", "--seed", "4", "--out", "sim", "--force", "--bag", name, "--rest", "0.4", "--move", "0.3", *options, code=code)

    def test_what_is_in_them(self):
        for name in ("a.bag", "a.mcap"):
            self.record(name, "--threads", "1")
            self.assertIn("36 images and 181 readings of the joints in 1.8 s", self.out)   # 10 and 100 Hz
            once = self.bytes(name)
            self.record(name, "--threads", "3")
            self.assertTrue(once == self.bytes(name), "the bag depends on the threads")
            self.run_it("import", name, "--list")
            for topic, kind, count in (("/joint_states", "sensor_msgs/JointState", 181), ("/left/image_raw", "sensor_msgs/Image", 18),
                                       ("/right/camera_info", "sensor_msgs/CameraInfo", 18), ("/robot_description", "std_msgs/String", 1)):
                self.assertRegex(self.out, r"%s +%s +%d " % (topic, kind, count))
            self.assertNotIn("lost", self.out + self.err)

    def test_an_independent_reader_agrees(self):
        code = ("import json, rosbag, sys\nout = []\n"
                "for topic, m, t in rosbag.Bag(sys.argv[1]).read_messages():\n"
                "    if topic == '/joint_states': out.append(['joints', m.header.stamp.to_nsec(), m.name, list(m.position)])\n"
                "    if topic == '/left/image_raw': out.append(['image', m.header.stamp.to_nsec(), [m.width, m.height, m.encoding, m.step], len(m.data)])\n"
                "print(json.dumps(out))\n")
        self.record("a.bag", "--camera-delay", "0.02", "--scatter", "0")
        p = subprocess.run([sys.executable, "-c", code, os.path.join(self.dir, "a.bag")], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        if b"No module named" in p.stderr:
            self.skipTest("no module rosbag (Debian: python3-rosbag)")
        self.assertEqual(p.returncode, 0, p.stderr.decode())
        messages, start = json.loads(p.stdout), 1767225600 * 10**9
        joints, images = ([m for m in messages if m[0] == kind] for kind in ("joints", "image"))
        self.assertEqual([m[1] - start for m in joints], [10**7 * i for i in range(181)])
        self.assertEqual([m[1] - start for m in images], [10**8 * i + 25 * 10**6 + 20 * 10**6 for i in range(18)])   # half a period, then the delay
        self.assertEqual(images[0][2:], [[160, 120, "mono8", 160], 160 * 120])
        samples = self.samples("sim/samples.jsonl")
        for k, sample in enumerate(samples):   # at rest, and without scatter, each is the sample's
            for i in (70 * k, 70 * k + 20, 70 * k + 40):
                self.assertEqual(dict(zip(*joints[i][2:])), sample["joints"])
        first, second = (samples[k]["joints"] for k in (0, 1))
        for name, q in zip(*joints[55][2:]):   # halfway
            self.assertAlmostEqual(q, (first[name] + second[name]) / 2, places=12)

    def test_what_cannot_be(self):
        self.record("a.zip", code=1)
        self.assertIn("NAME.bag (ROS 1) or NAME.mcap (ROS 2) is expected, not 'a.zip'", self.err)
        self.write("a.bag", "mine")
        self.run_it("simulate", "rig.yaml", "--samples", "3", "--seed", "4", "--out", "new", "--bag", "a.bag", code=1)
        self.assertIn("a.bag: exists already; --force", self.err)
        self.assertEqual(self.bytes("a.bag"), b"mine")
        self.assertFalse(os.path.exists(os.path.join(self.dir, "new")))
        for option in ("--blur", "--frame-rate"):
            self.run_it("simulate", "rig.yaml", "--samples", "3", "--seed", "4", "--out", "new", option, "1", code=1)
            self.assertIn(option, self.err)
        self.run_it("simulate", "rig.yaml", "--samples", "3", "--seed", "4", "--out", "new", "--bag", "b.bag", "--render", "i", code=1)
        with open(os.path.join(self.dir, "rig.yaml")) as f:
            self.write("rig.yaml", f.read().replace(", image_size: [160, 120]", ""))
        self.run_it("simulate", "rig.yaml", "--samples", "3", "--seed", "4", "--out", "new", "--bag", "b.bag", "--quiet", code=1)
        self.assertIn("--bag: camera 'left' has no image_size in the rig", self.err)
        self.assertEqual([name for name in os.listdir(self.dir) if name.startswith("b.bag")], [])


class Missing(Case):
    def test_the_program_says_what_to_install(self):
        alone = os.path.join(self.dir, "kincal")
        shutil.copy(KINCAL, alone)
        self.write("rig.yaml", rig({"eye": ("tip", "brown")}, {"board": ("chessboard", "free")}))
        self.run_it("simulate", "rig.yaml", "--samples", "2", "--seed", "4", "--out", "sim", "--render", "p", program=alone, code=1)
        self.assertIn("libopencv-contrib-dev", self.err)
        self.assertFalse(os.path.exists(os.path.join(self.dir, "sim")))


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
