"""Lenses and stereo through the program: python3 intrinsics_test.py SOURCE_DIR KINCAL [TEST ...]

Makes views of a board through two cameras, by a projection written here. Proves: the files of a result, their keys, and that its rig.yaml is a
rig whose cameras see as the true ones, for `evaluate` and `calibrate`; joint readings are not needed, of a robot either; one view
and parallel views are told (exit 2, or a warning); wrong input ends with 1 and leaves nothing; an existing result is replaced only
with --force; the same input gives the same bytes. It does not prove the statistics (models/intrinsics/intrinsics_test.cpp).
"""

import json
import os
import subprocess
import sys
import unittest
import xml.etree.ElementTree

import numpy

import helpers

SOURCE_DIR = KINCAL = None
URDF = """<robot name="r"><link name="base"/><link name="head"/>
<joint name="pan" type="revolute"><parent link="base"/><child link="head"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>
"""
RIG = """format: kincal/1
robot: robot.urdf
base: base
targets:
  board: {type: chessboard, rows: 6, columns: 9, square: 0.03, mount: {link: base}}
sensors:
  left: {type: camera, link: head, pose: {xyz: [0.1, 0.2, 0.3]}, model: pinhole, intrinsics: [700, 700, 300, 200], image_size: [640, 480], sigma: 0.3}
  right: {type: camera, link: head, pose: {xyz: [0.1, 0.2, 0.3]}, model: kannala_brandt, distortion: [0, 0, 0, 0], intrinsics: [700, 700, 300, 200],
          image_size: [640, 480], sigma: 0.3}
"""
FREE = RIG.replace("mount: {link: base}", "mount: free").replace("link: head", "link: base")
TANGENTIAL = {"left": (0.0015, -0.001), "right": (-0.001, 0.0012)}
NUMBERS = {"left": [500, 505, 322, 236, -0.25, 0.08], "right": [510, 512, 318, 241, -0.22, 0.06]}
BASELINE = 0.12
NOISE = 0.1


def rotation(w):
    angle = numpy.linalg.norm(w)
    if angle == 0:
        return numpy.eye(3)
    k = numpy.cross(numpy.eye(3), w / angle)
    return numpy.eye(3) - numpy.sin(angle) * k + (1 - numpy.cos(angle)) * k @ k


def pixels(numbers, points, p1=0, p2=0):
    fx, fy, cx, cy, k1, k2 = numbers
    u, v = points[0] / points[2], points[1] / points[2]
    s = u * u + v * v
    radial = 1 + k1 * s + k2 * s * s
    return numpy.array([fx * (u * radial + 2 * p1 * u * v + p2 * (s + 2 * u * u)) + cx, fy * (v * radial + p1 * (s + 2 * v * v) + 2 * p2 * u * v) + cy])


def samples(count, tilt=0.6, seed=1, cameras=("left", "right"), bent=0, noise=NOISE, tangential=None):
    draws = numpy.random.RandomState(seed)
    board = numpy.array([[c * 0.03, r * 0.03, bent * (1 - (c / 4 - 1) ** 2)] for r in range(6) for c in range(9)]).T
    lines = []
    for i in range(count):
        way = draws.uniform(0, 6.28)
        turn = rotation(tilt * numpy.array([numpy.cos(way), numpy.sin(way), 0]))
        z = draws.uniform(0.4, 0.6)
        centre = numpy.array([draws.uniform(-0.25, 0.25) * z + 0.06, draws.uniform(-0.2, 0.2) * z, z])
        points = turn @ (board - board.mean(axis=1)[:, None]) + centre[:, None]
        views = []
        for camera in cameras:
            seen = points - numpy.array([[BASELINE if camera == "right" else 0], [0], [0]])
            z = pixels(NUMBERS[camera], seen, *(tangential or {}).get(camera, ())) + noise * draws.normal(size=(2, 54))
            inside = [k for k in range(54) if 0 <= z[0, k] < 640 and 0 <= z[1, k] < 480]
            views.append({"sensor": camera, "target": "board", "ids": inside, "pixels": [[round(z[0, k], 4), round(z[1, k], 4)] for k in inside]})
        lines.append(json.dumps({"id": "s%d" % i, "joints": {}, "views": views}) + "\n")
    return "".join(lines)


class Case(helpers.Folder):
    def setUp(self):
        super().setUp()
        self.write("robot.urdf", URDF)
        self.write("rig.yaml", RIG)
        self.write("samples.jsonl", samples(14))

    def run_it(self, *arguments, code=0):
        done = subprocess.run([KINCAL, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, cwd=self.dir)
        self.assertEqual(done.returncode, code, done.stdout.decode() + done.stderr.decode())
        return done.stdout.decode(), done.stderr.decode()


class Result(Case):
    def test_stereo(self):
        said, _ = self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens")
        self.assertEqual(sorted(os.listdir(self.path("lens"))), ["coverage.svg", "intrinsics.json", "rig.yaml", "robot.urdf"])
        self.assertEqual(self.read("lens/robot.urdf"), URDF)
        for words in ("Camera 'left': brown_conrady_4", "held out", "Corners over the image (640 x 480 px)", "pose seen from 'left'"):
            self.assertIn(words, said)
        result = json.loads(self.read("lens/intrinsics.json"))
        self.assertEqual((result["status"], result["warnings"]), ("converged", []))
        self.assertEqual([group["cameras"] for group in result["groups"]], [["left", "right"]])
        for name, truth in NUMBERS.items():
            camera = result["cameras"][name]
            self.assertEqual((camera["lens"], camera["model"]), ("brown_conrady_4", "brown_conrady"))
            for component, true in zip(("fx", "fy", "cx", "cy"), truth):
                one = camera["intrinsics"][component]
                self.assertLess(abs(one["value"] - true), 4 * one["sigma"], component)
                self.assertLess(one["sigma"], 1.0)
            self.assertAlmostEqual(camera["noise"]["seen"], NOISE, delta=0.01)
            self.assertLess(camera["held_out"]["rms"], 1.2 * camera["rms"])
            self.assertEqual([m["model"] for m in camera["models"] if m["chosen"]], ["brown_conrady_4"])
            self.assertEqual(len(camera["models"]), 5)
            self.assertEqual(sum(map(sum, camera["coverage"])), camera["points"])
            self.assertEqual((len(camera["projection"]["sigma"]), len(camera["projection"]["sigma_far"][0])), (6, 8))
            middle, corner = camera["projection"]["sigma"][3][4], camera["projection"]["sigma"][0][0]
            self.assertTrue(0 < middle < 0.1 and middle < corner)
        stereo = result["cameras"]["right"]["stereo"]
        self.assertEqual(stereo["reference"], "left")
        for found, true, sigma in zip(stereo["pose"]["xyz"], (BASELINE, 0, 0), stereo["sigma"]):
            self.assertLess(abs(found - true), 4 * sigma)
        picture = xml.etree.ElementTree.fromstring(self.read("lens/coverage.svg"))
        circles = [e for e in picture.iter() if e.tag.endswith("circle")]
        self.assertEqual(len(circles), sum(c["points"] for c in result["cameras"].values()))

    def test_rig_to_calibrate_from(self):
        self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--quiet")
        rig = self.read("lens/rig.yaml")
        self.assertNotIn("kannala_brandt", rig)
        self.assertIn("sigma: 0.3", rig)
        self.assertIn("[0.1, 0.2, 0.3]", rig)  # the reference stays
        self.write("rig.yaml", FREE)
        self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "free", "--quiet", "--model", "brown_conrady_2")
        sensors = json.loads(self.run_it("evaluate", "free", "samples.jsonl", "--json")[0])["sensors"]
        for camera in ("left", "right"):
            self.assertLess(sensors[camera]["train"]["rms"], 1.1 * NOISE * 2 ** 0.5)
        self.write("free/rig.yaml", self.read("free/rig.yaml") + "estimate:\n  - {step: all, free: [sensor/right/pose, 'sensor/*/intrinsics']}\n")
        self.run_it("calibrate", "free", "samples.jsonl", "--out", "result", "--quiet")

    def test_markers_in_the_rig_read_back(self):
        self.write("rig.yaml", RIG.replace("targets:\n", "targets:\n  tag: {type: marker, dictionary: DICT_4X4_50, id: 7, size: 0.08, mount: {link: base}}\n"))
        self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--quiet")
        self.assertNotIn("points", self.read("lens/rig.yaml"))
        self.write("postures.jsonl", self.read("samples.jsonl").replace('"joints": {}', '"joints": {"pan": 0}'))
        self.run_it("evaluate", "lens", "postures.jsonl")

    def test_noise_of_a_flange_that_nobody_stated(self):
        """It stays open: what the program supposes until it finds it is no statement."""
        self.write("rig.yaml", RIG.replace("robot: robot.urdf\nbase: base", "robot: {base: base, flange: head}"))
        self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--quiet")
        self.assertNotIn("joints", self.read("lens/rig.yaml"))

    def test_settings_of_all_joints_where_there_are_none(self):
        """As `init` writes them, whatever the robot."""
        self.write("robot.urdf", '<robot name="bench"><link name="base"/></robot>\n')
        self.write("rig.yaml", RIG.replace("link: head", "link: base") + 'joints: {"*": {sigma: 0.0001}}\n')
        self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--quiet")

    def test_json_and_same_bytes(self):
        said, _ = self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--json")
        self.assertEqual(said, self.read("lens/intrinsics.json"))
        before = {name: self.read("lens/" + name) for name in os.listdir(self.path("lens"))}
        self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--json", code=1)
        self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--json", "--force")
        for name, text in before.items():
            self.assertEqual(self.read("lens/" + name).replace(" --force", ""), text)
        self.write("lens/mine.txt", "")
        self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--force", code=1)

    def test_names_of_another_lens(self):
        self.write("rig.yaml", RIG + "estimate:\n  - {step: all, free: [sensor/right/distortion.k4, sensor/left/pose]}\n")
        _, errors = self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens")
        self.assertIn("'sensor/right/distortion.k4' in the rig's steps has no meaning", errors.replace("\n", " "))


class Together(Case):
    def test_lenses_are_chosen_together(self):
        """A tangential distortion that one camera by itself hardly sees: in 11 of these 12 recordings one or both chose a lens without it, and
        numbers were up to 5.3 sigmas off."""
        small = {name: (0.00036, -0.00024) for name in NUMBERS}
        worst = 0
        for seed in range(1, 13):
            self.write("samples.jsonl", samples(20, seed=seed, tangential=small))
            self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--quiet", "--force")
            cameras = json.loads(self.read("lens/intrinsics.json"))["cameras"]
            for name, truth in NUMBERS.items():
                self.assertIn(cameras[name]["lens"], ("brown_conrady_4", "brown_conrady_5"), seed)
                for component, true in zip(("fx", "fy", "cx", "cy"), truth):
                    one = cameras[name]["intrinsics"][component]
                    worst = max(worst, abs(one["value"] - true) / one["sigma"])
            pose = cameras["right"]["stereo"]["pose"]
            errors = [pose["xyz"][0] - BASELINE, *pose["xyz"][1:], *(2 * q for q in pose["quat"][:3])]
            worst = max(worst, max(abs(e) / s for e, s in zip(errors, cameras["right"]["stereo"]["sigma"])))
        self.assertLess(worst, 3.5)

    def test_exchanged_cameras(self):
        right = "  right: {type: camera, link: head, pose: {xyz: [0.1, 0.2, 0.3]}"
        self.assertIn(right, RIG)
        for side, said in ((BASELINE, False), (-BASELINE, True)):
            self.write("rig.yaml", RIG.replace(right, right.replace("0.1,", "%g," % (0.1 + side))))
            _, errors = self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--quiet", "--force")
            self.assertEqual("'right' was found on the other side of 'left'" in errors.replace("\n", " "), said)


class Bent(Case):
    def test_bent_board(self):
        self.write("rig.yaml", FREE)
        self.write("samples.jsonl", samples(14, bent=0.0015))
        self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "flat", "--quiet")
        said, _ = self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--warp")
        self.assertIn("Boards that may be bent", said)
        warp = json.loads(self.read("lens/intrinsics.json"))["groups"][0]["warp"]
        self.assertTrue(warp["kept"])
        for value, sigma, true in zip(warp["targets"]["board"]["value"], warp["targets"]["board"]["sigma"], (0.0015, 0)):
            self.assertLess(abs(value - true), 4 * sigma)
        self.assertIn("warp: [0.0015" if warp["targets"]["board"]["value"][0] >= 0.0015 else "warp: [0.0014", self.read("lens/rig.yaml"))
        rms = {out: json.loads(self.run_it("evaluate", out, "samples.jsonl", "--json")[0])["sensors"]["left"]["train"]["rms"] for out in ("flat", "lens")}
        self.assertLess(rms["lens"], 1.1 * NOISE * 2 ** 0.5)
        self.assertLess(rms["lens"], 0.9 * rms["flat"])
        # A rig that has a warp is calibrated with it, and it can be freed.
        self.write("lens/rig.yaml", self.read("lens/rig.yaml") + "estimate:\n  - {step: all, free: [sensor/right/pose, target/board/warp]}\n")
        self.run_it("calibrate", "lens", "samples.jsonl", "--out", "result", "--quiet")
        result = json.loads(self.read("result/result.json"))["parameters"]["target/board/warp"]
        self.assertLess(abs(result["value"][0] - 0.0015), 4 * result["sigma"][0])
        self.assertIn("warp: [%r" % result["value"][0], self.read("result/rig.yaml"))

    def test_lens_behind_a_bent_board(self):
        """A lens that shows only once the board is bent is chosen then."""
        self.write("rig.yaml", FREE)
        self.write("samples.jsonl", samples(16, bent=0.003, noise=0.02, tangential=TANGENTIAL))
        _, errors = self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "flat", "--quiet")
        self.assertIn("boards look bent, by up to 3", errors)
        result = json.loads(self.read("flat/intrinsics.json"))
        self.assertEqual(result["warnings"][0]["id"], "bent")
        self.assertNotIn("warp", result["groups"][0])
        _, errors = self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--quiet", "--warp")
        self.assertEqual(errors, "")
        for name, truth in NUMBERS.items():
            camera = json.loads(self.read("lens/intrinsics.json"))["cameras"][name]
            self.assertEqual(camera["lens"], "brown_conrady_4")
            for component, true in zip(("fx", "fy", "cx", "cy"), truth):
                one = camera["intrinsics"][component]
                self.assertLess(abs(one["value"] - true), 4 * one["sigma"], component)

    def test_wrong_warp(self):
        for warp, words in (("[0.001]", "2"), ("flat", "warp")):
            self.write("rig.yaml", FREE.replace("square: 0.03,", "square: 0.03, warp: %s," % warp))
            _, errors = self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", code=1)
            self.assertIn("targets.board.warp", errors)
            self.assertIn(words, errors)


def changed(text, change):
    """The samples with every view changed; change(sample index, view)."""
    lines = [json.loads(line) for line in text.splitlines()]
    for i, line in enumerate(lines):
        for view in line["views"]:
            change(i, view)
    return "".join(json.dumps(line) + "\n" for line in lines)


class Mistakes(Case):
    """Mistakes of users: each is named, with sample and cure."""

    def setUp(self):
        super().setUp()
        self.one = "\n".join(line for line in FREE.split("\n") if "right" not in line and "640, 480], sigma: 0.3}" not in line[:60]) + "\n"
        self.write("rig.yaml", self.one)
        self.views = samples(14, cameras=("left",))
        self.write("samples.jsonl", self.views)

    def lens(self, text, code, *more):
        self.write("samples.jsonl", text)
        _, errors = self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--quiet", "--force", *more, code=code)
        result = json.loads(self.read("lens/intrinsics.json"))
        return result, errors.replace("\n", " ")

    def test_nothing_wrong(self):
        result, errors = self.lens(self.views, 0)
        self.assertEqual((result["warnings"], errors), ([], ""))

    def test_millimetres(self):
        self.write("rig.yaml", self.one.replace("square: 0.03", "square: 30"))
        result, errors = self.lens(self.views, 0)
        self.assertEqual(result["warnings"][0]["id"], "square")
        self.assertIn("The fields of target 'board' are 30 m large in the rig. Write metres: 0.03 if these are millimetres", errors)

    def test_rows_and_columns(self):
        self.write("rig.yaml", self.one.replace("rows: 6, columns: 9", "rows: 9, columns: 6"))
        done = subprocess.run([KINCAL, "intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--quiet"], cwd=self.dir, stderr=subprocess.PIPE)
        self.assertIn(done.returncode, (3, 5))
        self.assertIn("'left': rows and columns of board 'board' are exchanged", done.stderr.decode())
        self.assertIn("Exchange targets.board.rows and .columns", done.stderr.decode())
        self.assertEqual(json.loads(self.read("lens/intrinsics.json"))["warnings"][0]["id"], "rows_columns")

    def test_columns_counted_as_squares(self):
        self.write("rig.yaml", self.one.replace("rows: 6, columns: 9", "rows: 7, columns: 10"))
        done = subprocess.run([KINCAL, "intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--quiet"], cwd=self.dir, stderr=subprocess.PIPE)
        self.assertIn(done.returncode, (3, 5))
        self.assertIn("are numbered in rows of 9, the rig has 10 in a row", done.stderr.decode())

    def test_numbers_off_by_one(self):
        for shift, words in ((1, "are numbered one too high: ids count from 0, row by row. Write every id less by one"), (-1, "one too low")):
            def shifted(_, view):
                kept = [k for k, i in enumerate(view["ids"]) if 0 <= i + shift < 54]
                view["ids"], view["pixels"] = [view["ids"][k] + shift for k in kept], [view["pixels"][k] for k in kept]
            self.write("samples.jsonl", changed(self.views, shifted))
            done = subprocess.run([KINCAL, "intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--quiet", "--force"], cwd=self.dir, stderr=subprocess.PIPE)
            self.assertIn(done.returncode, (1, 3, 5))  # 1: where not even a start is found
            self.assertIn(words, done.stderr.decode().replace("\n", " ").split("(")[0])

    def test_normalised_pixels(self):
        self.write("samples.jsonl", changed(self.views, lambda _, view: view.update(pixels=[[(u - 322) / 500, (v - 236) / 505] for u, v in view["pixels"]])))
        _, errors = self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", code=1)
        self.assertIn("they are normalised coordinates", errors.replace("\n", " "))
        self.assertFalse(os.path.exists(self.path("lens")))

    def test_pictures_of_one_side_in_reverse_order(self):
        self.write("rig.yaml", FREE)
        lines = [json.loads(line) for line in samples(14, noise=0.05).splitlines()]
        right = [line["views"][1] for line in lines]
        for line, view in zip(lines, reversed(right)):
            line["views"][1] = view
        self.write("samples.jsonl", "".join(json.dumps(line) + "\n" for line in lines))
        done = subprocess.run([KINCAL, "intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--quiet"], cwd=self.dir, stderr=subprocess.PIPE)
        self.assertIn(done.returncode, (3, 5))
        self.assertIn("warning: the views of cameras 'left' and 'right' do not belong together", done.stderr.decode().replace("\n", " "))

    def test_one_corner(self):
        def far(i, view):
            if i == 3:
                view["pixels"][10][0] += 25
        result, errors = self.lens(changed(self.views, far), 0)
        self.assertIn("corners far off the others: sample 's3' (id %d); they took no part" % json.loads(self.views.splitlines()[3])["views"][0]["ids"][10], errors)
        self.assertEqual([w["id"] for w in result["warnings"]], ["outlier_point"])
        # It takes no part: with it the lens was chosen as pinhole, and what that leaves called other corners far off.
        camera = result["cameras"]["left"]
        self.assertEqual(camera["lens"], "brown_conrady_4")
        for component, true in zip(("fx", "fy", "cx", "cy"), NUMBERS["left"]):
            one = camera["intrinsics"][component]
            self.assertLess(abs(one["value"] - true), 4 * one["sigma"], component)

    def test_one_corner_so_far_that_its_view_is_none(self):
        def far(i, view):
            if i == 3:
                view["pixels"][10] = [5, 470]
        self.write("samples.jsonl", changed(self.views, far))
        done = subprocess.run([KINCAL, "intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--quiet"], cwd=self.dir, stderr=subprocess.PIPE)
        self.assertIn(done.returncode, (0, 5))
        corner = json.loads(self.views.splitlines()[3])["views"][0]["ids"][10]
        self.assertIn("sample 's3' (id %d)" % corner, done.stderr.decode().replace("\n", " "))

    def test_u_and_v_exchanged(self):
        def turned(_, view):
            view["pixels"] = [[v, u] for u, v in view["pixels"]]
        result, errors = self.lens(changed(self.views, turned), 5)
        self.assertIn("'left': u and v of the pixels are exchanged", errors)
        self.assertIn("Write pixels as [u, v]", errors)
        self.assertEqual((result["status"], result["warnings"][0]["id"]), ("unexplained", "exchanged"))

    def test_copies_of_a_view(self):
        lines = [json.loads(line) for line in self.views.splitlines()]
        lines += [{**lines[3], "id": "again"}, {**lines[5], "id": "and again"}]
        result, errors = self.lens("".join(json.dumps(line) + "\n" for line in lines), 0)
        self.assertIn("sample 'again' (as 's3') and 'and again' (as 's5')", errors)
        self.assertEqual([w["id"] for w in result["warnings"]], ["copied"])

    def test_one_view(self):
        def shifted(i, view):
            if i == 5:
                view["pixels"] = [[u + 12 * numpy.sin(v / 50), v] for u, v in view["pixels"]]
        result, errors = self.lens(changed(self.views, shifted), 0)
        self.assertIn("1 view does not belong to the others: sample 's5'", errors)
        self.assertIn("take the views out of the samples", errors)

    def test_views_in_another_order(self):
        def turned(i, view):
            if i in (3, 7):
                at = sorted(range(len(view["ids"])), key=lambda k: (view["ids"][k] % 9, view["ids"][k] // 9))
                view["pixels"] = [view["pixels"][k] for k in at]
        result, errors = self.lens(changed(self.views, turned), 5)
        self.assertIn("corners of sample 's3' and 's7' are not in the order of board 'board'", errors)
        self.assertEqual(result["status"], "unexplained")
        self.assertIn("# kincal: status unexplained", self.read("lens/rig.yaml"))

    def test_mirrored(self):
        def flipped(_, view):
            view["pixels"] = [[639 - u, v] for u, v in view["pixels"]]
        result, errors = self.lens(changed(self.views, flipped), 0)
        self.assertIn("'left': board 'board' is seen from behind in all views, or nearly: the pixels are mirrored", errors)
        self.assertIn("take 639 - u for u", errors)

    def test_image_size(self):
        for size, words in (("[480, 640]", "width and height are exchanged? It would be image_size: [640, 480]"),
                            ("[320, 240]", "correct image_size, or detect in pictures of that size"),
                            ("[1280, 960]", "were the corners found in smaller pictures?")):
            self.write("rig.yaml", self.one.replace("[640, 480]", size))
            _, errors = self.lens(self.views, 0, "--model", "brown_conrady_2")
            self.assertIn(words, errors)

    def test_one_view_only(self):
        for model in ("auto", "rig", "brown_conrady_5"):
            result, errors = self.lens(samples(1, cameras=("left",)), 2, "--model", model)
            self.assertIn("'left': the views do not determine fx", errors)
            self.assertIn("show it at least three times", errors)
        _, errors = self.run_it("export", "lens", "--as", "opencv", code=1)
        self.assertIn("its status is 'unobservable', not 'converged': 'left': the views do not determine fx", errors)
        _, errors = self.run_it("export", "lens", "--as", "opencv", "--force")
        self.assertIn("kincal: warning: lens: 'left': the views do not determine fx", errors)

    def test_parallel_views(self):
        self.write("rig.yaml", self.one.replace("model: pinhole", "model: brown_conrady, distortion: [0, 0, 0, 0, 0]"))
        for tilt in (0, 0.03):
            result, errors = self.lens(samples(14, tilt=tilt, cameras=("left",)), 2)
            self.assertEqual(result["cameras"]["left"]["lens"], "brown_conrady_5")  # as in the rig
            self.assertIn("the views do not determine fx", errors)
            self.assertIn("tilt the board by 20 to 45 degrees", errors)


class WrongInput(Case):
    def test_undetermined(self):
        self.write("samples.jsonl", samples(1, cameras=("left",)))
        _, errors = self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--model", "pinhole", code=2)
        self.assertIn("'left': the views do not determine", errors)
        self.assertIn("# kincal: status unobservable", self.read("lens/rig.yaml"))
        result = json.loads(self.read("lens/intrinsics.json"))
        self.assertEqual(result["status"], "unobservable")
        self.assertIsNone(result["cameras"]["left"]["intrinsics"]["fx"]["sigma"])
        self.write("samples.jsonl", samples(8, tilt=0, cameras=("left",)))
        done = subprocess.run([KINCAL, "intrinsics", "rig.yaml", "samples.jsonl", "--out", "flat", "--model", "pinhole"], cwd=self.dir,
                              stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        self.assertIn(done.returncode, (0, 2))
        self.assertIn("parallel within", done.stderr.decode())

    def test_nothing_written(self):
        for change, words in ((lambda: self.write("samples.jsonl", json.dumps({"id": "a", "joints": {}, "views": []}) + "\n"), "no camera of the rig sees a board"),
                              (lambda: self.write("samples.jsonl", samples(3).replace("pixels", "pixel")), "pixel"),
                              (lambda: self.write("rig.yaml", RIG.replace("chessboard", "chessbord")), "chessbord")):
            self.setUp()
            change()
            _, errors = self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", code=1)
            self.assertIn(words, errors)
            self.assertFalse(os.path.exists(self.path("lens")))
        self.run_it("intrinsics", "rig.yaml", "samples.jsonl", "--out", "lens", "--model", "fish", code=1)
        self.run_it("intrinsics", "rig.yaml", "samples.jsonl", code=1)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:])
