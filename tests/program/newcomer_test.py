"""What a newcomer reads after a rig without steps: python3 newcomer_test.py SOURCE_DIR KINCAL [TEST ...]

Words must agree with each other and with the data: `diff` with --report-frame, `calibrate` with `check`, warnings with what was seen.
All data are simulated here, from an arm with a tracker and three reflectors, or a camera and a board. Not proved: that there are no more
such contradictions, and thresholds on other robots.
"""

import functools
import json
import math
import os
import random
import re
import subprocess
import sys
import tempfile
import unittest

import yaml

sys.dont_write_bytecode = True
import helpers
from cli_test import axis_angle, frame, inverse, move, mul

SOURCE_DIR = KINCAL = None


def urdf():
    joints = [("j%d" % k, "l%d" % k, *joint) for k, joint in enumerate(helpers.ARM, 1)]
    return "\n".join(['<robot name="arm"><link name="base"/>', *helpers.revolute(joints, "base", 1.2), "</robot>"])


TRACKER = """format: kincal/1
robot: arm.urdf
base: base
joints:
  "*": {sigma: 0.0002}
targets:
  r0: {type: points, points: [[0, 0, 0]], mount: {link: l6}}
  r1: {type: points, points: [[0, 0, 0]], mount: {link: l6}}
  r2: {type: points, points: [[0, 0, 0]], mount: {link: l6}}
sensors:
  tracker: {type: point, link: base, sigma: 5.0e-05}
"""
TRACKER_TRUTH = {"sensor/tracker/pose": [2.0, 0.5, 0.3, 0.1, 0.2, 2.0], "target/r0/pose": [0.1, 0.05, 0.02, 0, 0, 0],
                 "target/r1/pose": [0.08, -0.06, 0.03, 0, 0, 0], "target/r2/pose": [0.12, 0.0, -0.07, 0, 0, 0],
                 "joint/j2/offset": 0.008, "joint/j4/offset": -0.006}
CAMERA = """format: kincal/1
robot: arm.urdf
base: base
joints:
  "*": {sigma: 0.0002}
targets:
  board: {type: chessboard, rows: 6, columns: 9, square: 0.025, mount: {link: l6}}
sensors:
  cam: {type: camera, model: brown_conrady, link: base, image_size: [1280, 960], intrinsics: [1000, 1000, 640, 480], sigma: 0.2}
"""
CAMERA_POSES = (("link: base, image", "link: base, pose: {xyz: [2.2, 0.1, 0.5], rpy: [-1.5708, 0.02, 1.5908]}, image"),
                ("mount: {link: l6}", "mount: {link: l6, pose: {xyz: [0.05, -0.1, -0.06], rpy: [0.03, 1.5508, 0]}}"))
HEAD_URDF = """<robot name="head"><link name="base"/><link name="neck"/><link name="face"/><link name="lens"/>
<joint name="pan" type="revolute"><parent link="base"/><child link="neck"/><origin xyz="0 0 0.4"/><axis xyz="0 0 1"/><limit lower="-0.5" upper="0.5" effort="1" velocity="1"/></joint>
<joint name="tilt" type="revolute"><parent link="neck"/><child link="face"/><origin xyz="0.05 0 0.1"/><axis xyz="0 1 0"/><limit lower="-0.4" upper="0.4" effort="1" velocity="1"/></joint>
<joint name="hold" type="fixed"><parent link="face"/><child link="lens"/><origin xyz="0.06 0.02 0.05" rpy="-1.5707963267948966 0 -1.5707963267948966"/></joint></robot>
"""
HEAD = """format: kincal/1
robot: head.urdf
base: base
joints:
  "*": {sigma: 0.0002}
targets:
  board: {type: chessboard, rows: 7, columns: 9, square: 0.04, mount: {link: base}}
sensors:
  eye: {type: camera, link: lens, mount: joint/hold, model: pinhole, image_size: [640, 480], intrinsics: [600, 600, 320, 240], sigma: 0.2}
"""
HEAD_TRUTH = {"joint/pan/offset": -0.006, "joint/tilt/offset": 0.007, "joint/pan/origin": [0, 0, 0, 0.002, -0.002, 0],
              "joint/hold/origin": [-0.008, 0.001, -0.002, 0.008, 0.012, -0.015]}
POSED = functools.reduce(lambda text, change: text.replace(*change), CAMERA_POSES, CAMERA)
CAMERA_TRUTH = {"joint/j2/offset": 0.008, "joint/j3/offset": -0.006, "joint/j4/origin": [0.001, 0, 0, 0, 0.002, 0]}

BOARDS = """  near: {type: chessboard, rows: 6, columns: 9, square: %(square)s, mount: {link: base, pose: {xyz: [2.0, 0.3, 1.3], rpy: [-1.5708, 0, -1.5708]}}}
  left: {type: chessboard, rows: 6, columns: 9, square: %(square)s, mount: {link: base, pose: {xyz: [1.1, 0.9, 0.9], rpy: [-1.4, 0.2, -0.9]}}}
  right: {type: chessboard, rows: 6, columns: 9, square: %(square)s, mount: {link: base, pose: {xyz: [1.4, -0.9, 0.6], rpy: [-1.7, 0.0, -2.1]}}}
"""
LOOKING = HEAD_URDF.replace('lower="-0.5" upper="0.5"', 'lower="-1" upper="1"').replace('lower="-0.4" upper="0.4"', 'lower="-0.5" upper="0.5"').replace(
    "</robot>", '<link name="lens2"/><joint name="hold2" type="fixed"><parent link="face"/><child link="lens2"/>'
                '<origin xyz="0.06 -0.1 0.05" rpy="-1.5707963267948966 0 -1.5707963267948966"/></joint></robot>')
STEREO_HEAD = """format: kincal/1
robot: looking.urdf
base: base
joints:
  "*": {sigma: 0.0002}
targets:
""" + BOARDS + """sensors:
  eye: {type: camera, link: lens, mount: joint/hold, model: pinhole, image_size: [640, 480], intrinsics: [500, 500, 320, 240], sigma: 0.1}
  eye2: {type: camera, link: lens2, mount: joint/hold2, model: pinhole, image_size: [640, 480], intrinsics: [500, 500, 320, 240], sigma: 0.1}
"""
STEREO_TRUTH = {"joint/pan/offset": -0.006, "joint/tilt/offset": 0.007, "joint/hold/origin": [-0.004, 0.001, -0.002, 0.008, 0.006, -0.007],
                "joint/hold2/origin": [0.002, -0.003, 0.001, -0.004, 0.005, 0.003], "target/near/pose": [0.012, -0.015, 0.01, 0.01, -0.006, 0.008],
                "target/left/pose": [-0.01, 0.013, 0.016, -0.007, 0.01, 0.002], "target/right/pose": [0.014, 0.009, -0.012, 0.005, 0.004, -0.01]}
SLIDE_URDF = """<robot name="scara"><link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="flange"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0 0.4"/><axis xyz="0 0 1"/><limit lower="-1.2" upper="1.2" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/><limit lower="-1.2" upper="1.2" effort="1" velocity="1"/></joint>
<joint name="j3" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0.25 0 0" rpy="3.141592653589793 0 0"/><axis xyz="0 0 1"/><limit lower="0" upper="0.15" effort="1" velocity="1"/></joint>
<joint name="j4" type="revolute"><parent link="c"/><child link="flange"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>
"""
SLIDE = """format: kincal/1
robot: scara.urdf
base: base
joints:
  "j[124]": {sigma: 0.0001}
  j3: {sigma: 0.00002}
targets:
  board: {type: chessboard, rows: 7, columns: 10, square: 0.015, mount: {link: base, pose: {xyz: [0.4, 0.05, 0.0], rpy: [3.14159265, 0, 0.0]}}}
sensors:
  cam: {type: camera, link: flange, model: pinhole, image_size: [1280, 960], intrinsics: [1100, 1100, 640, 480], sigma: 0.1, pose: {xyz: [0.05, 0, -0.02], rpy: [0, 0, 0]}}
priors: {sensor/cam/pose.z: 0.001}
"""
SLIDE_TRUTH = {"joint/j2/offset": -0.006, "sensor/cam/pose": [0.012, 0.008, 0, 0.004, 0.008, 0.01], "target/board/pose": [-0.01, 0.005, 0, 0.004, 0.006, -0.006],
               "sensor/cam/intrinsics": [1106, 1105, 643, 476]}
GANTRY_URDF = """<robot name="gantry"><link name="frame"/><link name="a"/><link name="b"/><link name="c"/>
<joint name="x" type="prismatic"><parent link="frame"/><child link="a"/><origin xyz="0 0 0.8"/><axis xyz="1 0 0"/><limit lower="0" upper="0.8" effort="1" velocity="1"/></joint>
<joint name="y" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/><limit lower="0" upper="0.8" effort="1" velocity="1"/></joint>
<joint name="z" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0 0 0" rpy="3.141592653589793 0 0"/><axis xyz="0 0 1"/><limit lower="0" upper="0.3" effort="1" velocity="1"/></joint>
<link name="tool"/><joint name="turn" type="revolute"><parent link="c"/><child link="tool"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>
"""
GANTRY = """format: kincal/1
robot: gantry.urdf
base: frame
joints:
  "*": {sigma: 0.00003}
targets:
  ball: {type: points, points: [[0, 0, 0]], mount: {link: tool, pose: {xyz: [0.03, 0, 0.05]}}}
sensors:
  tracker: {type: point, link: frame, pose: {xyz: [-1, 0.5, 1], rpy: [0, 0, 0]}, sigma: 0.00004}
"""


class Case(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.dir = folder.name
        self.write("arm.urdf", urdf())

    def path(self, *names):
        return os.path.join(self.dir, *names)

    def write(self, name, text):
        with open(self.path(name), "w", encoding="utf-8") as file:
            file.write(text)

    def kincal(self, *arguments, code=0):
        p = subprocess.run([KINCAL, *arguments], capture_output=True, text=True, cwd=self.dir)
        self.assertEqual(p.returncode, code, p.stdout + p.stderr)
        return p.stdout + p.stderr

    def simulate(self, rig, truth, samples=24, seed=1, out="sim"):
        self.write("rig.yaml", rig)
        self.write("truth.json", json.dumps({"parameters": truth}))
        self.kincal("simulate", "rig.yaml", "--samples", str(samples), "--seed", str(seed), "--truth", "truth.json", "--out", out)
        with open(self.path(out, "samples.jsonl"), encoding="utf-8") as file:
            return [json.loads(line) for line in file]

    def calibrate(self, samples, *options, code=0, out="out", rig="rig.yaml"):
        self.write("samples.jsonl", "".join(json.dumps(s) + "\n" for s in samples))
        text = self.kincal("calibrate", rig, "samples.jsonl", "--out", out, "--force", *options, code=code)
        with open(self.path(out, "result.json"), encoding="utf-8") as file:
            return json.load(file), text

    def warnings(self, result, kind):
        return [w["text"] for w in result["warnings"] if w["id"] == kind]


class Words(Case):
    def test_diff_predicts_what_report_frame_does(self):
        samples = self.simulate(TRACKER, TRACKER_TRUTH)
        result, _ = self.calibrate(samples, "--report-frame", "l6")
        limits = result["validation"]["frames"]["l6"]["workspaces"]["limits"]
        self.assertTrue(result["held"])  # numbers without evidence, which predictions count
        frame = json.loads(self.kincal("diff", "out", "out", "--frame", "l6", "--json"))["frames"]["l6"]
        for part in ("position", "rotation"):
            self.assertAlmostEqual(frame[part]["sigma"] / (math.sqrt(2) * limits[part]["rms"]), 1, delta=1e-6)
        self.assertNotIn("not determined", self.kincal("diff", "out", "out"))

    def test_reflectors_without_poses_have_a_start(self):
        for seed in (1, 2):
            result, text = self.calibrate(self.simulate(TRACKER, TRACKER_TRUTH, seed=seed, out="sim%d" % seed))
            self.assertEqual(self.warnings(result, "no_start"), [])
            for name in ("r0", "r1", "r2"):
                found = result["parameters"]["target/%s/pose" % name]["pose"]["xyz"]
                for a, b in zip(found, TRACKER_TRUTH["target/%s/pose" % name]):
                    self.assertLess(abs(a - b), 0.02)  # lengths and the tool's own frame trade

    def test_check_of_a_robot_with_usual_errors_finds_nothing(self):
        """Its lengths are off by a millimetre, which no pose or offset explains: `check` says how it is with these errors estimated."""
        lengths = {"joint/j%d/origin" % j: [0.001, -0.001, 0.001, 0.001, 0.002, -0.001] for j in (2, 3, 4)}
        self.simulate(TRACKER, dict(TRACKER_TRUTH, **lengths))
        said = self.kincal("check", "rig.yaml", "sim/samples.jsonl")
        self.assertIn("Nothing found", said)
        self.assertRegex(said, r"chi2/dof is [0-9]{2,}[0-9.]* with poses of .* estimated, and [01]\.[0-9]+ with the usual errors of a robot")
        self.assertIn("Next: kincal calibrate", said)

    def test_what_nothing_can_turn_keeps_its_rotation(self):
        """A reflector on a bracket: its point in the frame that the rig gives is told, the frame's rotation is not, and stays what it is."""
        rig = TRACKER.replace("points: [[0, 0, 0]]", "points: [[0.03, -0.02, 0.05]]").replace("mount: {link: l6}", "mount: {link: l6, pose: {xyz: [0.1, 0, 0], rpy: [0.2, -0.1, 0.3]}}")
        turn = [0, 0, 0]
        truth = {"sensor/tracker/pose": TRACKER_TRUTH["sensor/tracker/pose"], "joint/j2/offset": 0.008, "target/r0/pose": [0.0017, -0.001, 0.002] + turn,
                 "target/r1/pose": [-0.02, 0.06, 0.01] + turn, "target/r2/pose": [0.03, 0.02, -0.05] + turn}
        result, text = self.calibrate(self.simulate(rig, truth, samples=30, seed=5))
        self.assertEqual(result["verdict"]["use"], "good", text)
        for name in ("r0", "r1", "r2"):
            estimate = result["parameters"]["target/%s/pose" % name]
            self.assertEqual(estimate["value"][3:], [0, 0, 0], text)
            for c in range(3):
                self.assertLess(abs(estimate["value"][c] - truth["target/%s/pose" % name][c]), 4 * estimate["sigma"][c], (name, c, text))

    def test_one_wrong_length_is_no_scale_of_the_sensor(self):
        """The second link is 20 mm longer than the URDF says; the others err by 0.5 mm. Not proved: what is told of arms with one long link only."""
        for seed in helpers.some((1, 2, 3), 1):
            rng = random.Random(seed)
            truth = dict(TRACKER_TRUTH)
            for k, (_, axis) in enumerate(helpers.ARM, 1):
                along = axis.split().index("1")
                truth["joint/j%d/origin" % k] = [0 if c % 3 == along else rng.gauss(0, 0.0005 if c < 3 else 0.001) for c in range(6)]
            truth["joint/j3/origin"][0] += 0.02
            result, text = self.calibrate(self.simulate(TRACKER, truth, samples=30, seed=seed, out="sim%d" % seed))
            self.assertEqual(self.warnings(result, "arm_scale"), [], text)
            self.assertTrue(any("joint/j3/origin" in w for w in self.warnings(result, "prior")), text)

    def test_what_measures_in_another_scale_is_named(self):
        """A tracker 1 % off scales the whole arm: nothing else shows it. Not proved: that 0.3 % is seen."""
        for seed in helpers.some((1, 2, 3), 1):
            for scale in (1, 1.01):
                rng = random.Random(seed)
                truth = dict(TRACKER_TRUTH)
                for k, (_, axis) in enumerate(helpers.ARM, 1):
                    along = axis.split().index("1")
                    truth["joint/j%d/origin" % k] = [0 if c % 3 == along else rng.gauss(0, 0.0005 if c < 3 else 0.001) for c in range(6)]
                samples = self.simulate(TRACKER, truth, samples=30, seed=seed, out="sim-%d-%g" % (seed, scale))
                for v in (v for s in samples for v in s["views"]):
                    v["points"] = [[scale * x for x in p] for p in v["points"]]
                result, text = self.calibrate(samples)
                said = self.warnings(result, "arm_scale")
                if scale == 1:
                    self.assertEqual((said, result["verdict"]["use"]), ([], "good"), text)
                    continue
                self.assertEqual((len(said), result["verdict"]["use"]), (1, "doubts"), text)
                factor, sigma = map(float, re.search(r"came out ([\d.]+) \+- ([\d.e-]+) times", said[0]).groups())
                self.assertLess(abs(factor - scale), 4 * sigma, text)
                self.assertIn("tracker", said[0])

    def test_diff_knows_how_well_held_numbers_are_known(self):
        few = self.simulate(TRACKER, TRACKER_TRUTH, samples=12, seed=3, out="few")
        many = self.simulate(TRACKER, dict(TRACKER_TRUTH, **{"joint/j4/origin": [0.002, 0, 0.001, 0, 0.004, 0]}), samples=60, seed=4, out="many")
        a, _ = self.calibrate(few, out="a")
        b, _ = self.calibrate(many, out="b")
        held = {h["parameter"]: h["sigma"] for h in a["held"]}
        rows = json.loads(self.kincal("diff", "a", "b", "--json"))["parameters"]
        compared = 0
        for name, row in rows.items():
            for c, sigma in enumerate(row["sigma"]):
                known = b["parameters"].get(name, {"sigma": [0] * 6})["sigma"][c]
                key = name + "." + "x y z rx ry rz".split()[c] if len(row["sigma"]) == 6 else name
                if sigma and known and key in held:
                    compared += 1
                    self.assertAlmostEqual(sigma / math.hypot(known, held[key]), 1, delta=1e-6, msg=key)
        self.assertGreater(compared, 0)

    def test_what_was_never_seen_is_not_known(self):
        rig = TRACKER.replace("sensors:\n", "  spare: {type: points, points: [[0, 0, 0]], mount: {link: l4}}\nsensors:\n")
        samples = self.simulate(rig, dict(TRACKER_TRUTH, **{"target/spare/pose": [0.1, 0, 0, 0, 0, 0]}))
        for s in samples:
            s["views"] = [v for v in s["views"] if v["target"] != "spare"]
        result, text = self.calibrate(samples, "--report-frame", "target/spare", "--report-frame", "l6", "--require",
                                      "frame/target/spare<1000mm", code=4)
        frames = result["validation"]["frames"]
        self.assertIsNone(frames["target/spare"]["workspaces"]["samples"]["position"]["rms"])
        self.assertIsNotNone(frames["l6"]["workspaces"]["samples"]["position"]["rms"])
        self.assertEqual(len(self.warnings(result, "never_seen")), 1)
        self.assertIn("target/spare/pose: no training sample shows", self.warnings(result, "never_seen")[0])
        # its pose stays open in the result: there is nothing to compare
        self.assertIn("not compared: A leaves target/spare/pose open", self.kincal("diff", "out", "out"))
        # a given pose stays what it is, and is said to be taken as exact
        self.write("given.yaml", rig.replace("mount: {link: l4}", "mount: {link: l4, pose: {xyz: [0.1, 0, 0]}}"))
        result, _ = self.calibrate(samples, "--report-frame", "target/spare", rig="given.yaml")
        self.assertIn("keeps the rig's value", self.warnings(result, "never_seen")[0])
        self.assertIsNotNone(result["validation"]["frames"]["target/spare"]["workspaces"]["samples"]["position"]["rms"])
        # and what is seen is not spoken of
        for s in samples:
            s["views"] = [dict(v, target="spare") if v["target"] == "r2" else v for v in s["views"]]
        result, _ = self.calibrate(samples, code=5)  # r2's points are not where spare is
        self.assertEqual(len(self.warnings(result, "never_seen")), 1)
        self.assertIn("target/r2/pose", self.warnings(result, "never_seen")[0])

    def test_a_frame_that_no_sample_measures_is_not_known_better_than_usual(self):
        """An arm that nothing sees: the error of its tool is that of its joints' zeros and lengths."""
        idle = """<link name="upper"/><link name="lower"/><link name="hand2"/>
<joint name="i1" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0.5 0.4"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="i2" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="i3" type="fixed"><parent link="lower"/><child link="hand2"/><origin xyz="0.5 0 0"/></joint></robot>"""
        self.write("arm.urdf", urdf().replace("</robot>", idle))
        samples = self.simulate(POSED, CAMERA_TRUTH)
        seen, _ = self.calibrate(samples)
        result, text = self.calibrate(samples, "--report-frame", "hand2")
        error = result["validation"]["frames"]["hand2"]["workspaces"]["limits"]["position"]["rms"]
        self.assertGreater(error, 0.001, text)   # usual zeros of 5 mrad, at 0.9 m
        self.assertLess(error, 0.05, text)
        for name, found in result["parameters"].items():   # no estimate depends on what is reported
            for value, other, sigma in zip(found["value"], seen["parameters"][name]["value"], found["sigma"]):
                self.assertAlmostEqual(value, other, delta=1e-3 * sigma + 1e-12, msg=name)

    def test_the_last_zero_is_no_doubt(self):
        """Likewise the last joint's zero and how the board behind it is turned about its axis."""
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        samples = self.simulate(true, {"joint/j2/offset": 0.04, "joint/j3/offset": -0.03, "joint/j4/offset": 0.035}, samples=20, seed=2)
        self.write("rig.yaml", CAMERA)
        result, text = self.calibrate(samples)
        self.assertEqual(self.warnings(result, "sigma"), [], text)
        self.assertEqual(result["verdict"]["use"], "good", text)
        found, = self.warnings(result, "last_zero")
        self.assertIn("target/board/pose.r", found)
        self.assertIn("fix joint/j6/offset (--fix)", found)
        result, text = self.calibrate(samples, "--fix", "joint/j6/offset")
        self.assertEqual(self.warnings(result, "last_zero") + self.warnings(result, "sigma"), [], text)

    def test_a_head_that_pans_and_tilts(self):
        """Two joints tell neither zero, nor how the base stands; the board's size is what is to be measured, not more postures."""
        self.write("head.urdf", HEAD_URDF)
        samples = self.simulate(HEAD.replace("{link: base}", "{link: base, pose: {xyz: [1.5, 0.15, 0.65], rpy: [-1.4, 0.1, -1.45]}}"), HEAD_TRUTH, samples=25)
        self.write("rig.yaml", HEAD)
        result, text = self.calibrate(samples)
        found, = self.warnings(result, "sigma")
        self.assertRegex(found, r"^target/board/pose.z is known to 0.0\d+ m only \(one sigma\). The data do not determine target/board/square. What to do: measure "
                                r"target/board/square over several fields, write it into the rig, and fix it \(--fix\)$")
        self.assertNotIn("more varied postures", text)
        self.assertEqual(result["verdict"]["use"], "no", text)  # above 3 cm
        self.assertRegex(result["verdict"]["next"][0], "^measure target/board/square")
        result, text = self.calibrate(samples, "--fix", "target/board/square")
        self.assertEqual(result["verdict"]["use"], "good", text)
        self.assertEqual(self.warnings(result, "sigma"), [], text)
        base, = self.warnings(result, "base_frame")
        for name in ("target/board/pose.x", "joint/pan/offset"):
            self.assertIn(name, base)
        self.assertEqual(self.warnings(result, "last_zero"), [], text)  # a zero that no data check is expected within a degree
        # the tilt is the camera's, up to its own zero
        origin = result["parameters"]["joint/hold/origin"]
        self.assertAlmostEqual(origin["value"][3], 0.008 - 0.007, delta=0.004)

    def test_where_the_base_frame_is_is_no_doubt(self):
        """The first joint's zero and the base frame's turn about its axis are one number: no posture helps, and nobody is harmed."""
        far = dict(TRACKER_TRUTH, **{"sensor/tracker/pose": [5.0, 0.5, 0.3, 0.1, 0.2, 2.0]})
        samples = self.simulate(TRACKER, far, samples=30)
        result, text = self.calibrate(samples)
        self.assertEqual(self.warnings(result, "sigma"), [], text)
        self.assertEqual(result["verdict"]["use"], "good", text)
        self.assertNotIn("more varied postures", text)
        found, = self.warnings(result, "base_frame")
        self.assertRegex(found, r"^sensor/tracker/pose.x \(0.02\d+ m\) and sensor/tracker/pose.y \(0.01\d+ m\) are determined no better than the base frame")
        self.assertIn("fix joint/j1/offset (--fix)", found)
        self.assertGreater(result["parameters"]["sensor/tracker/pose"]["sigma"][1], 0.01)  # it is still told
        result, text = self.calibrate(samples, "--fix", "joint/j1/offset")
        self.assertEqual(self.warnings(result, "base_frame") + self.warnings(result, "sigma"), [], text)
        self.assertLess(max(result["parameters"]["sensor/tracker/pose"]["sigma"][:3]), 0.01)
        # steps with a prior: the same
        steps = TRACKER + ("estimate:\n  - {step: all, free: ['joint/*/offset', 'sensor/*/pose', 'target/*/pose.?'], "
                           "priors: {'joint/*/offset': 0.01}}\n")
        steps = steps.replace("mount: {link: l6}", "mount: {link: l6, pose: {xyz: [0.1, 0, 0]}}")
        self.write("steps.yaml", steps)
        result, text = self.calibrate(samples, rig="steps.yaml")
        self.assertEqual(self.warnings(result, "sigma"), [], text)
        self.assertIn("joint/j1/offset", self.warnings(result, "base_frame")[0])
        # freed without a prior it is not determined, and the cure is the joint
        result, text = self.calibrate(samples, "--free", "joint/j1/offset", code=2)
        self.assertIn("fix joint/j1/offset, because the position of the base frame is a free choice", self.warnings(result, "unobservable")[0])
        # what hangs on a joint further out is no choice of the base's
        moved = TRACKER.replace("link: base, sigma", "link: l1, sigma")
        samples = self.simulate(moved, dict(TRACKER_TRUTH), samples=30, out="moved")
        result, text = self.calibrate(samples)
        self.assertEqual(self.warnings(result, "base_frame"), [], text)

    def test_the_base_frame_is_no_doubt_where_axes_are_tilted(self):
        """One axis tilted by 14 mrad makes all angles wide: those of joint 2 that turn as the base frame does are its choice, too (they seemed decided)."""
        rig = "".join(line + "\n" for line in TRACKER.splitlines() if not line.startswith(("  r1", "  r2")))
        truth = {name: value for name, value in TRACKER_TRUTH.items() if "/r1/" not in name and "/r2/" not in name}
        truth.update({"sensor/tracker/pose": [4.0, 0.5, 0.3, 0.1, 0.2, 2.0], "joint/j2/origin": [0, 0, 0, 0.01, 0, 0.01]})
        result, text = self.calibrate(self.simulate(rig, truth, samples=40, seed=1))
        self.assertEqual(result["verdict"]["use"], "good", text)
        self.assertEqual(self.warnings(result, "sigma"), [], text)
        self.assertNotIn("more varied postures", text)
        self.assertIn("joint/j1/o", self.warnings(result, "base_frame")[0])

    def test_what_was_asked_for_and_is_held_is_said(self):
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        samples = self.simulate(true, CAMERA_TRUTH, samples=20, seed=2)
        self.write("open.yaml", CAMERA)
        result, text = self.calibrate(samples, "--group", "centres", "--group", "offsets", rig="open.yaml")
        held, = self.warnings(result, "no_effect")
        self.assertIn("--group 'centres' was requested, but its parameters keep their nominal values", held)
        self.assertIn("free each by name (--free), for example sensor/cam/intrinsics.cx", held)
        self.assertIn("; --group 'offsets' has no effect: this group is always tried", held)
        # what is freed by name is estimated, and nothing says that it is held
        result, text = self.calibrate(samples, "--free", "sensor/cam/intrinsics.cx", rig="open.yaml")
        self.assertNotIn("sensor/cam/intrinsics.cx", [h["parameter"] for h in result["held"]])
        self.assertIn("sensor/cam/intrinsics.cy", [h["parameter"] for h in result["held"]])
        self.assertNotEqual(result["parameters"]["sensor/cam/intrinsics"]["value"][2], 640)
        self.assertEqual(self.warnings(result, "no_effect"), [])
        self.assertEqual([g["held"] for g in result["automatic"] if g["group"] == "centres"], [False])

    def test_errors_that_go_with_the_posture(self):
        """A joint that sags is no noise, however large its noise is stated: it bends, which is found; told not to look for that, its errors are said to go with the posture. Noise has no such warning."""
        self.write("open.yaml", CAMERA.replace("0.0002", "0.0005"))
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        clean = self.simulate(true, CAMERA_TRUTH, samples=40, seed=4)
        result, _ = self.calibrate(clean, rig="open.yaml")
        self.assertEqual(self.warnings(result, "systematic"), [])
        for s in clean:
            s["joints"]["j2"] -= 0.004 * math.cos(s["joints"]["j2"])
        for rig in (CAMERA, CAMERA.replace("0.0002", "0.0005")):
            self.write("open.yaml", rig)
            result, _ = self.calibrate(clean, rig="open.yaml")
            self.assertEqual(self.warnings(result, "systematic"), [])
            self.assertEqual(result["verdict"]["use"], "good")
            self.assertIn("compliance", [g["group"] for g in result["automatic"] if not g["held"]])
            result, _ = self.calibrate(clean, "--no-group", "compliance*", "--no-group", "loads", "--no-group", "curve/*", "--no-group", "coupling/*", rig="open.yaml")
            found, = self.warnings(result, "systematic")
            self.assertRegex(found, r"the errors of the readings of joint 'j2' depend on its position \(0\.\d+ mrad, up to \d+ % of their scatter\)")
            self.assertEqual(result["verdict"]["use"], "doubts")
            self.assertIn("depend on its position", result["verdict"]["text"])

    def test_errors_that_are_a_curve(self):
        """An error with cycles over the angle is a curve, which is found; where steps leave it out, neighbouring angles agree in it, and a warning says so. Noise of the size has none."""
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        steps = "estimate:\n  - {step: all, free: [sensor/cam/pose, target/board/pose, joint/*/offset], priors: {joint/*/offset: 0.01}}\n"
        self.write("open.yaml", CAMERA.replace("0.0002", "0.0007") + steps)
        clean = self.simulate(true, {"joint/j2/offset": 0.008}, samples=80, seed=4)
        rng = random.Random(3)
        noisy = json.loads(json.dumps(clean))
        for s, n in zip(clean, noisy):
            s["joints"]["j2"] += 0.001 * math.sin(10 * s["joints"]["j2"] + 1)
            n["joints"]["j2"] += 0.0007 * rng.gauss(0, 1)
        result, text = self.calibrate(noisy, rig="open.yaml")
        self.assertEqual(self.warnings(result, "systematic"), [], text)
        result, text = self.calibrate(clean, rig="open.yaml")
        found, = self.warnings(result, "systematic")
        self.assertRegex(found, r"the errors of the readings of joint 'j2' depend on its position \(0\.\d+ mrad, up to \d+ % of their scatter\)")

    def test_errors_that_jump(self):
        """A joint that was homed anew at half time: which sample, also where the samples are not in the order of their times."""
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        self.write("open.yaml", CAMERA)
        for seed in helpers.some((4, 5, 6), 1):
            clean = self.simulate(true, CAMERA_TRUTH, samples=30, seed=seed, out="sim%d" % seed)
            result, _ = self.calibrate(clean, rig="open.yaml")
            self.assertEqual(self.warnings(result, "jump"), [])
            homed = json.loads(json.dumps(clean))
            for k, s in enumerate(homed):
                s["time"] = 10.0 * k
                s["joints"]["j2"] += 0.006 * (k >= 15)
            for samples in (homed, homed[::2] + homed[1::2]):
                with self.subTest(seed=seed):
                    result, text = self.calibrate(samples, rig="open.yaml")
                    found, = self.warnings(result, "jump")
                    self.assertIn("calibrate the samples before that one and those from it on separately", found)
                    self.assertEqual(result["verdict"]["use"], "doubts", text)
                    changed = [f["where"] for f in result.get("findings", []) if f["id"] == "changed"]
                    if changed:         # then noise is not estimated, which makes the jump look smaller, and begin a sample early
                        self.assertEqual(changed, [[clean[15]["id"]]])
                        self.assertIn("and those from '%s' on contradict each other" % clean[15]["id"], result["verdict"]["text"])
                        self.assertRegex(found, r"^the errors of joint 'j2' jump by at least [2-6]\.?\d* mrad from sample 'sample_001[45]' on")
                        continue
                    self.assertRegex(found, r"^the errors of joint 'j2' jump by at least [56]\.?\d* mrad from sample '%s' on" % clean[15]["id"])
                    self.assertIn("jump by at least", result["verdict"]["text"])

    def test_noise_of_joints_that_nobody_stated_is_no_change(self):
        """A camera in the hand before two boards, 20 samples: two halves overfit, so they were said to contradict each other in most of these."""
        noise, sensor = 'joints:\n  "*": {sigma: 0.0003}\n', " pose: {xyz: [0.05, 0, 0.03], rpy: [-1.5708, 0, -1.5708]},"
        wall, floor = ", pose: {xyz: [1.4, 0.2, 0.9], rpy: [1.5708, 0, 1.5708]}", ", pose: {xyz: [0.6, 0.3, -0.2], rpy: [0, 0, 0.1]}"
        board = "  %s: {type: chessboard, rows: 6, columns: 9, square: 0.06, mount: {link: base%s}}\n"
        rig = ("format: kincal/1\nrobot: arm.urdf\nbase: base\n%stargets:\n" + board + board + "sensors:\n"
               "  cam: {type: camera, model: brown_conrady, link: l6,%s image_size: [1280, 960], intrinsics: [700, 700, 640, 480], sigma: 0.1}\n")
        self.write("open.yaml", rig % ("", "wall", "", "floor", "", ""))
        for seed in helpers.some(range(1, 7), 2):
            draws, truth = random.Random(seed), {}
            for k, (_, axis) in enumerate(helpers.ARM, 1):
                along = axis.split().index("1")
                truth["joint/j%d/origin" % k] = [0 if c % 3 == along else draws.gauss(0, 0.0005 if c < 3 else 0.001) for c in range(6)]
                truth["joint/j%d/offset" % k] = draws.gauss(0, 0.005)
            result, text = self.calibrate(self.simulate(rig % (noise, "wall", wall, "floor", floor, sensor), truth, samples=20, seed=seed, out="sim%d" % seed), rig="open.yaml")
            self.assertEqual(result["verdict"]["use"], "good", text)

    def test_postures_that_are_repeated(self):
        """Three pictures of a robot that stands still are one posture, unless its readings scatter as stated."""
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        self.write("open.yaml", CAMERA)
        one = self.simulate(true, CAMERA_TRUTH, samples=16, seed=5)
        for jitter, times, said in ((0, 3, 1), (0.1, 3, 1), (1, 3, 0), (0, 5, 1)):
            with self.subTest(jitter=jitter, times=times):
                draws, samples = random.Random(1), []
                for s in one:
                    for k in range(times):
                        again = json.loads(json.dumps(s))
                        again["id"] += "_%d" % k
                        again["joints"] = {j: q + draws.gauss(0, 0.0002 * jitter) for j, q in s["joints"].items()}
                        again["views"][0]["pixels"] = [[u + draws.gauss(0, 0.2), v + draws.gauss(0, 0.2)] for u, v in s["views"][0]["pixels"]]
                        samples.append(again)
                result, _ = self.calibrate(samples, rig="open.yaml")
                found = self.warnings(result, "repeated")
                self.assertEqual(len(found), said, found)
                if said:
                    self.assertIn("%d samples were taken at 16 postures" % (16 * times), found[0])
                if times == 5:  # sigmas may be more than twice too small
                    self.assertRegex(result["verdict"]["text"], "^80 samples were taken at 16 postures")
                    self.assertEqual(result["verdict"]["use"], "doubts")

    def test_repeated_postures_are_no_jump(self):
        """Their errors are the same ones: counted three times each they seemed to jump or to go with the posture in two of these recordings."""
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        self.write("open.yaml", CAMERA)
        for seed in helpers.some(range(40, 60), 3):
            draws, samples = random.Random(seed), []
            for s in self.simulate(true, CAMERA_TRUTH, samples=15, seed=seed, out="sim%d" % seed):
                for k in range(3):
                    again = json.loads(json.dumps(s))
                    again["id"] += "_%d" % k
                    again["joints"] = {j: q + draws.gauss(0, 0.00001) for j, q in s["joints"].items()}
                    again["views"][0]["pixels"] = [[u + draws.gauss(0, 0.2), v + draws.gauss(0, 0.2)] for u, v in s["views"][0]["pixels"]]
                    samples.append(again)
            result, text = self.calibrate(samples, rig="open.yaml")
            self.assertEqual([], self.warnings(result, "jump") + self.warnings(result, "systematic"), seed)

    def test_a_coordinate_that_is_held_where_no_pose_is_stated(self):
        """A camera that is far from the board's coordinate that is held: the pose is asked for, no other mistake is blamed."""
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        samples = self.simulate(true, CAMERA_TRUTH, samples=20, seed=2)
        self.write("open.yaml", CAMERA)
        self.write("samples.jsonl", "".join(json.dumps(s) + "\n" for s in samples))
        p = subprocess.run([KINCAL, "calibrate", "open.yaml", "samples.jsonl", "--fix", "sensor/cam/pose.x", "--out", "held", "--force", "--quiet"],
                           capture_output=True, text=True, cwd=self.dir)
        self.assertNotEqual(p.returncode, 0)
        self.assertIn("sensor/cam/pose is missing in the rig, and one of its coordinates is fixed, or it has a prior: the fixed value or the prior is that of the identity", p.stdout + p.stderr)
        for word in ("mirrored", "joint-sign", "wrong-link"):
            self.assertNotIn(word, p.stdout + p.stderr)

    def test_words_of_poses_and_widths(self):
        """No prior is spoken of where the user gave none, and what is held of a pose that the rig leaves open is named."""
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        samples = self.simulate(true, CAMERA_TRUTH, samples=20, seed=2)
        self.write("open.yaml", CAMERA)
        result, text = self.calibrate(samples, "--fix", "target/board/pose.z", rig="open.yaml")
        found, = self.warnings(result, "identity")
        self.assertIn("target/board/pose is missing in the rig, and its z is fixed: the fixed value or the prior is that of the identity", found)
        self.assertIn("give it a pose in the rig", found)
        self.assertEqual(result["verdict"]["use"], "doubts")
        self.assertIn("give it a pose in the rig", result["verdict"]["text"])
        # one joint far off among good ones
        truth = {"joint/j%d/offset" % k: 0.0003 * (-1) ** k for k in range(2, 7)}
        truth["joint/j4/origin"] = [0.02, 0, 0, 0, 0, 0]
        samples = self.simulate(true, truth, samples=40, seed=3, out="far")
        result, text = self.calibrate(samples, rig="open.yaml")
        for words in self.warnings(result, "prior"):
            self.assertIn("its group 'lengths/j1..j6' usually is here", words)
        self.assertNotIn("prior", result["verdict"]["text"])
        self.assertNotIn("with the prior", text)

    def test_noise_smaller_than_stated(self):
        small = TRACKER.replace("sigma: 0.0002", "sigma: 0.00008").replace("sigma: 5.0e-05", "sigma: 2.0e-05")
        samples = self.simulate(small, TRACKER_TRUTH, samples=30)
        self.write("rig.yaml", TRACKER)
        result, text = self.calibrate(samples)
        found, = self.warnings(result, "noise")
        self.assertIn("errors are smaller than stated. All sigmas were multiplied by 0.4", found)
        self.assertIn("sensor/tracker: ", found)
        self.assertNotIn("exact", found)
        self.assertNotIn("noisier", found)
        samples = self.simulate(TRACKER.replace("sigma: 5.0e-05", "sigma: 1.0e-05"), TRACKER_TRUTH, samples=30, out="sharp")
        self.write("rig.yaml", TRACKER.replace("sigma: 5.0e-05", "sigma: 1.2e-04"))
        found, = self.warnings(self.calibrate(samples)[0], "noise")
        self.assertRegex(found, "Sigmas of the result may be up to .* times too small, because the data allow more noise than that: .*joint/.*--estimate-noise")

    def test_sensors_stated_too_noisy_beside_right_joints_are_a_doubt(self):
        """One factor for all sigmas makes those of the joints too small: the verdict says so, and what to state makes it good."""
        samples = self.simulate(TRACKER, TRACKER_TRUTH, samples=30)
        for factor in (4, 10):
            self.write("rig.yaml", TRACKER.replace("sigma: 5.0e-05", "sigma: %g" % (5e-5 * factor)))
            result, text = self.calibrate(samples)
            self.assertEqual(result["verdict"]["use"], "doubts", text)
            self.assertIn("All sigmas were multiplied by 0.", result["verdict"]["text"])
            stated = re.search(r"if that of the joints is right: sensors: {tracker: {sigma: (0\.0000\d+)}}", result["verdict"]["next"][1])
            self.write("rig.yaml", TRACKER.replace("sigma: 5.0e-05", "sigma: " + stated.group(1)))
            result, text = self.calibrate(samples)
            self.assertEqual(result["verdict"]["use"], "good", text)
        # A little too much of both is none.
        self.write("rig.yaml", TRACKER.replace("sigma: 5.0e-05", "sigma: 8.0e-05").replace("sigma: 0.0002", "sigma: 0.00032"))
        result, text = self.calibrate(samples)
        self.assertEqual(result["verdict"]["use"], "good", text)

    def test_a_whole_group_is_held(self):
        samples = self.simulate(TRACKER, TRACKER_TRUTH)
        self.write("rig.yaml", TRACKER)
        for name in ("joint/*/offset", "joint/*/origin"):
            result, _ = self.calibrate(samples, "--fix", name)
            self.assertEqual([g for g in result["automatic"] if not g["members"] and not g["unseen"]], [])
            self.assertEqual([p for p in result["parameters"] if p.endswith(name[7:])], [])

    def test_many_rejected_samples_are_a_warning(self):
        samples = self.simulate(TRACKER, TRACKER_TRUTH)
        for k, expected in ((2, []), (6, ["6 of 24"])):
            wrong = json.loads(json.dumps(samples))
            for i, s in enumerate(wrong[:k]):
                s["joints"]["j%d" % (i % 3 + 1)] += 0.2 + 0.1 * i
            result, _ = self.calibrate(wrong, "--reject")
            self.assertEqual(len({r["sample"] for r in result["rejected"]}), k)
            found = self.warnings(result, "rejected")
            self.assertEqual(len(found), len(expected))
            for text, start in zip(found, expected):
                self.assertTrue(text.startswith(start), text)

    def test_calibrate_finds_what_check_finds(self):
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        samples = self.simulate(true, CAMERA_TRUTH, samples=20, seed=2)
        for s in samples:
            s["joints"]["j2"] = -s["joints"]["j2"]
        self.write("rig.yaml", CAMERA)
        self.write("samples.jsonl", "".join(json.dumps(s) + "\n" for s in samples))
        found = json.loads(self.kincal("check", "rig.yaml", "samples.jsonl", "--json"))["findings"]
        self.assertEqual(found[0]["id"], "joint-sign")
        p = subprocess.run([KINCAL, "calibrate", "rig.yaml", "samples.jsonl", "--out", "out"], cwd=self.dir, capture_output=True, text=True)
        self.assertNotEqual(p.returncode, 0)
        self.assertIn(found[0]["text"][:60], p.stdout + p.stderr)

    def test_calibrate_finds_a_gear_that_the_geometry_takes_up(self):
        """With all free that may be wrong the noise looks a little larger, and that is all; with mounts and offsets alone it is proved."""
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        samples = self.simulate(true, CAMERA_TRUTH, samples=20, seed=2)
        for s in samples:
            s["joints"]["j3"] *= 1.01
        self.write("rig.yaml", CAMERA)
        result, text = self.calibrate(samples, "--no-report")
        self.assertEqual([(f["id"], f["where"]) for f in result.get("findings", [])], [("gear", ["j3"])], text)
        self.assertEqual(result["verdict"]["use"], "doubts", text)

    def test_heights_of_parallel_axes_are_held_not_searched_for(self):
        """No posture of a SCARA tells how high tracker and tool are, each by itself."""
        joints = [("j1", "l1", "0 0 0.3", "0 0 1"), ("j2", "l2", "0.3 0 0.02", "0 0 1"), ("j3", "l3", "0.25 0 0", "0 0 1")]
        self.write("scara.urdf", "\n".join(['<robot name="scara"><link name="base"/>', *helpers.revolute(joints, "base", 2.2), "</robot>"]))
        rig = TRACKER.replace("arm.urdf", "scara.urdf").replace("l6", "l3").replace(
            "  r1: {type: points, points: [[0, 0, 0]], mount: {link: l3}}\n  r2: {type: points, points: [[0, 0, 0]], mount: {link: l3}}\n", "").replace(
            "points: [[0, 0, 0]]", "points: [[0, 0, 0.05], [0.04, 0, 0.05], [0, 0.05, 0.03], [0.03, 0.03, 0]]")
        samples = self.simulate(rig, {"sensor/tracker/pose": [2, 0.5, 0.3, 0, 0, 2], "target/r0/pose": [0.1, 0.05, 0.02, 0, 0, 0],
                                      "joint/j2/origin": [0, 0, 0, 0.002, 0.001, 0], "joint/j3/origin": [0, 0, 0, -0.001, 0.002, 0]}, samples=20, out="scara")
        result, text = self.calibrate(samples, "--no-report")
        self.assertIn("sensor/tracker/pose.z", self.warnings(result, "gauge")[0])
        self.assertNotIn("more varied", result["verdict"]["text"] + " ".join(result["verdict"]["next"]))
        self.assertEqual(result["verdict"]["use"], "good", text)
        result, text = self.calibrate(samples, "--no-report", "--fix", "sensor/tracker/pose.z")
        self.assertEqual(self.warnings(result, "gauge"), [], text)
        self.assertNotEqual(result["verdict"]["use"], "no", text)

    def test_height_of_a_palletizer_is_held_not_searched_for(self):
        """Followers keep its tool level, so that only its first and last axis turn it: no posture tells how high tracker and tool are."""
        joints = [("j1", "l1", "0 0 0.5", "0 0 1"), ("j2", "l2", "0.25 0 0.2", "0 1 0"), ("j3", "l3", "0 0 0.9", "0 1 0"),
                  ("j4", "l4", "0.9 0 0", "0 1 0"), ("j5", "l5", "0 0 0", "0 1 0"), ("j6", "l6", "0.15 0 -0.1", "0 0 1")]
        lines = list(helpers.revolute(joints, "base", 1.2))
        for follower, leader in (("j4", "j2"), ("j5", "j3")):
            lines = [x.replace("</joint>", '<mimic joint="%s" multiplier="-1"/></joint>' % leader) if 'name="%s"' % follower in x else x for x in lines]
        self.write("pallet.urdf", "\n".join(['<robot name="pallet"><link name="base"/>', *lines, "</robot>"]))
        self.assertEqual("".join(lines).count("mimic"), 2)
        rig = TRACKER.replace("arm.urdf", "pallet.urdf").replace(
            "  r1: {type: points, points: [[0, 0, 0]], mount: {link: l6}}\n  r2: {type: points, points: [[0, 0, 0]], mount: {link: l6}}\n", "").replace(
            "points: [[0, 0, 0]]", "points: [[0, 0, 0.05], [0.04, 0, 0.05], [0, 0.05, 0.03], [0.03, 0.03, 0]]")
        samples = self.simulate(rig, {"sensor/tracker/pose": [2, 0.5, 0.3, 0, 0, 2], "target/r0/pose": [0.1, 0.05, 0.02, 0, 0, 0],
                                      "joint/j2/origin": [0, 0, 0, 0.002, 0, 0.001], "joint/j3/origin": [0, 0, 0, -0.001, 0, 0.002]}, samples=30, out="pallet")
        result, text = self.calibrate(samples, "--no-report")
        self.assertNotIn("more varied", result["verdict"]["text"] + " ".join(result["verdict"]["next"]), text)
        self.assertIn("sensor/tracker/pose.z", self.warnings(result, "gauge")[0])
        self.assertEqual(result["verdict"]["use"], "good", text)

    def test_cameras_without_a_robot_are_told_to_hold_one(self):
        """They do see the same board: what no sample tells is where both are, and with one held all is found."""
        self.write("bench.urdf", '<robot name="bench"><link name="base"/></robot>')
        camera = "{type: camera, model: pinhole, link: base, pose: {xyz: [%g, 0, 0]}, image_size: [1280, 960], intrinsics: [1000, 1000, 640, 480], sigma: 0.2}"
        bench = ("format: kincal/1\nrobot: bench.urdf\nbase: base\ntargets:\n  board: {type: chessboard, rows: 6, columns: 9, square: 0.025, mount: free}\n"
                 "sensors:\n  left: %s\n  right: %s\n" % (camera % 0, camera % 0.12))
        self.simulate(bench, {}, samples=12, out="bench")
        found, = json.loads(self.kincal("check", "rig.yaml", "bench/samples.jsonl", "--json", code=0))["findings"]
        self.assertEqual(found["id"], "disconnected")
        self.assertNotIn("no other sensor", found["text"])
        self.assertIn("Fix one of these, as sensor/left/pose:", found["text"])
        self.kincal("calibrate", "rig.yaml", "bench/samples.jsonl", "--out", "held", "--fix", "sensor/left/pose")

    def test_a_board_in_millimetres_is_calibrated_and_named(self):
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        samples = self.simulate(true, CAMERA_TRUTH, samples=20, seed=2)
        self.write("mm.yaml", CAMERA.replace("square: 0.025", "square: 25"))
        result, text = self.calibrate(samples, rig="mm.yaml")
        self.assertAlmostEqual(result["parameters"]["target/board/square"]["value"][0], 0.025, delta=1e-4, msg=text)
        self.assertEqual(result["verdict"]["use"], "doubts", text)
        for kind in ("implausible", "rescaled"):
            self.assertEqual(len(self.warnings(result, kind)), 1, text)
            self.assertIn("board", self.warnings(result, kind)[0])

    def test_a_length_that_is_wrong_in_the_urdf_is_not_blamed_on_the_board_alone(self):
        """Board and arm have one scale: both are named, and what to measure. A board that is wrong is named alone."""
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        truth = dict(CAMERA_TRUTH, **{"joint/j3/origin": [0.03, 0, 0, 0, 0, 0]})
        samples = self.simulate(true, truth, samples=20, seed=4)
        self.write("open.yaml", CAMERA)
        result, text = self.calibrate(samples, rig="open.yaml")
        self.assertEqual(result["verdict"]["use"], "no", text)  # the camera is one place or 8 cm from there
        self.assertEqual([f["id"] for f in result["findings"]], ["link-length"], text)
        for words in ("joint/j3/origin.", "target/board/square", "with a ruler", "equally well"):
            self.assertIn(words, result["findings"][0]["text"])
        # less than what is looked for: the size that came out as another is a doubt all the same, but not where it was said how well it is known
        self.write("less.yaml", CAMERA.replace("square: 0.025", "square: 0.0255"))
        samples = self.simulate(true, CAMERA_TRUTH, samples=20, seed=4, out="less")
        result, text = self.calibrate(samples, rig="less.yaml")
        self.assertEqual((result["verdict"]["use"], len(self.warnings(result, "rescaled"))), ("doubts", 1), text)
        self.assertIn("target/board/square is 0.0", result["verdict"]["text"])
        self.write("known.yaml", CAMERA.replace("square: 0.025", "square: 0.0255") + "priors: {target/board/square: 0.001}\n")
        result, text = self.calibrate(samples, rig="known.yaml")
        self.assertEqual((result["verdict"]["use"], len(self.warnings(result, "rescaled"))), ("good", 1), text)
        self.write("wrong.yaml", CAMERA.replace("square: 0.025", "square: 0.0265"))
        result, text = self.calibrate(samples, rig="wrong.yaml")
        self.assertEqual([f["id"] for f in result["findings"]], ["square"], text)

    @helpers.slow("that such a length is named is proved by the test before this one")
    def test_a_length_that_is_off_by_millimetres_is_named_or_within_what_is_predicted(self):
        """Arms whose lengths all err a little, and one by 5 mm, which a board 0.8 % larger hides: `link-length`, or the error is predicted.
        Without that length nothing is named. Not proved: arms in which a length does nothing but scale."""
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        named = 0
        for seed in range(1, 7):
            for wrong in (0.005, 0.0):
                rng = random.Random(seed)
                truth = {}
                for k, (_, axis) in enumerate(helpers.ARM, 1):
                    along = axis.split().index("1")
                    truth["joint/j%d/origin" % k] = [0 if c % 3 == along else rng.gauss(0, 0.0007 if c < 3 else 0.001) for c in range(6)]
                    truth["joint/j%d/offset" % k] = rng.gauss(0, 0.005)
                truth["joint/j3/origin"][0] += wrong
                samples = self.simulate(true, truth, samples=20, seed=seed, out="sim-%d-%g" % (seed, wrong))
                self.write("open.yaml", CAMERA)
                result, text = self.calibrate(samples, "--no-report", rig="open.yaml")
                findings = [f["id"] for f in result.get("findings", [])]
                self.assertEqual(len(findings) - findings.count("link-length"), 0, text)
                named += wrong > 0 and "link-length" in findings
                if not wrong:
                    self.assertEqual(findings, [], text)
                for name, actual in (("target/board/square", 0.025), ("joint/j3/origin", truth["joint/j3/origin"][0])):
                    if name in result["parameters"] and not findings:
                        estimate = result["parameters"][name]
                        self.assertLess(abs(estimate["value"][0] - actual), 4 * estimate["sigma"][0], "%s %s %s" % (seed, name, text))
        self.assertGreaterEqual(named, 3)

    def test_a_pose_that_nothing_tells_is_no_result(self):
        """Readings that hardly change: exit code 2, and the files say so, too. Of steps the same is the user's own choice."""
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        first = self.simulate(true, CAMERA_TRUTH, samples=20, seed=2)[0]
        rng = random.Random(3)
        near = [{"id": "n%d" % k, "joints": {j: q + rng.uniform(-0.01, 0.01) for j, q in first["joints"].items()},
                 "views": [{"sensor": "cam", "target": "board"}]} for k in range(12)]
        self.write("near.jsonl", "".join(json.dumps(p) + "\n" for p in near))
        self.write("rig.yaml", true.replace("sigma: 0.2", "sigma: 3"))
        self.kincal("simulate", "rig.yaml", "--samples", "12", "--seed", "2", "--postures", "near.jsonl", "--truth", "truth.json", "--out", "near")
        with open(self.path("near", "samples.jsonl"), encoding="utf-8") as file:
            samples = [json.loads(line) for line in file]
        self.write("rig.yaml", CAMERA.replace("sigma: 0.2", "sigma: 3"))
        result, text = self.calibrate(samples, code=2)
        self.assertEqual(result["status"], "unobservable", text)
        self.assertEqual(result["verdict"]["use"], "no")
        self.assertRegex(result["verdict"]["text"], "sensor 'cam' against target 'board' hardly turned .* turn one of them about at least two axes")
        with open(self.path("out", "rig.yaml"), encoding="utf-8") as file:
            self.assertIn("do not rely", file.readline())

    def test_turns_about_one_axis_are_told_in_these_words(self):
        """Two joints whose axes are parallel move, the others stand still."""
        true = CAMERA
        for old, new in CAMERA_POSES:
            true = true.replace(old, new)
        first = self.simulate(true, CAMERA_TRUTH, samples=20, seed=2)[0]
        rng = random.Random(5)
        turned = [{"id": "t%d" % k, "joints": dict(first["joints"], j2=first["joints"]["j2"] + rng.uniform(-0.3, 0.3),
                                                   j3=first["joints"]["j3"] + rng.uniform(-0.2, 0.2)),
                   "views": [{"sensor": "cam", "target": "board"}]} for k in range(12)]
        self.write("turned.jsonl", "".join(json.dumps(p) + "\n" for p in turned))
        self.kincal("simulate", "rig.yaml", "--samples", "12", "--seed", "2", "--postures", "turned.jsonl", "--truth", "truth.json", "--out", "turned")
        with open(self.path("turned", "samples.jsonl"), encoding="utf-8") as file:
            samples = [json.loads(line) for line in file]
        for steps in ("", "estimate:\n  - {step: mounts, free: [sensor/cam/pose, target/board/pose]}\n"):
            with self.subTest(steps=steps):
                self.write("open.yaml", CAMERA + steps)
                result, text = self.calibrate(samples, rig="open.yaml")
                self.assertEqual(result["verdict"]["use"], "no")
                said = result["verdict"]["text"]
                self.assertIn("ensor 'cam' against target 'board' turned about one axis only", said)
                self.assertIn("turn one of them about at least two axes that are not parallel", said)
                self.assertNotRegex(said, r"[-+][0-9.]+ sensor/cam/pose")   # coefficients stand in result.json

    def test_a_print_that_is_not_to_scale_is_found(self):
        """The truth has the points of the print, the rig a board to scale: lens, joints and noise stay as they are. What is to scale gets no print."""
        for stretch, shear in ((0.004, 0), (0, -0.003), (0, 0)):
            with self.subTest(stretch=stretch, shear=shear):
                points = [[0.025 * ((1 + stretch / 2) * c + shear / 2 * r), 0.025 * (shear / 2 * c + (1 - stretch / 2) * r), 0] for r in range(6) for c in range(9)]
                printed = "type: points, points: %s," % json.dumps(points)
                samples = self.simulate(POSED.replace("type: chessboard, rows: 6, columns: 9, square: 0.025,", printed), CAMERA_TRUTH, samples=30, seed=3, out="sim%g_%g" % (stretch, shear))
                self.write("open.yaml", CAMERA)
                result, text = self.calibrate(samples, rig="open.yaml")
                self.assertEqual(result["verdict"]["use"], "good", text)
                tried = {t["group"]: t["outcome"] for t in result["tried"]}
                self.assertEqual([g for g, outcome in tried.items() if outcome == "kept"], ["prints"] if stretch or shear else [], text)
                if stretch or shear:
                    found = result["parameters"]["target/board/print"]
                    for value, sigma, true in zip(found["value"], found["sigma"], (stretch, shear)):
                        self.assertLess(abs(value - true), 4 * sigma)
                        self.assertLess(sigma, 4e-4)
                    with open(self.path("out", "rig.yaml"), encoding="utf-8") as file:
                        self.assertIn("print: [%r" % found["value"][0], file.read())
                    again, _ = self.calibrate(samples, rig="out/rig.yaml")     # a rig that has it
                    self.assertAlmostEqual(again["parameters"]["target/board/print"]["value"][0], found["value"][0], delta=0.2 * found["sigma"][0])

    def test_marker_points_that_are_off_are_found(self):
        """The truth has other points of the body than the rig: joints and noise stay as they are, its lengths are found. Right points stay."""
        rig = TRACKER[:TRACKER.index("targets:")] + "targets:\n  body: {type: points, points: %s, mount: {link: l6}}\nsensors:" + TRACKER.split("sensors:")[1]
        given = [[0, 0, 0], [0.12, 0, 0], [0, 0.1, 0], [0.05, 0.04, 0.06]]
        off = [[0, 0, 0], [1, 0, 0.5], [-0.5, 1.5, 0], [0, 0, -1]]
        truth = {name: value for name, value in TRACKER_TRUTH.items() if not name.startswith("target/")}
        truth["target/body/pose"] = [0.08, -0.06, 0.03, 0, 0, 0.2]
        for by in (0, 1e-3):
            with self.subTest(by=by):
                points = [[a + by * b for a, b in zip(*both)] for both in zip(given, off)]
                samples = self.simulate(rig % json.dumps(points), truth, samples=30, seed=3, out="sim%g" % by)
                self.write("open.yaml", rig % json.dumps(given))
                result, text = self.calibrate(samples, rig="open.yaml")
                self.assertEqual(result["verdict"]["use"], "good", text)
                self.assertEqual([t["group"] for t in result["tried"] if t["outcome"] == "kept"], ["marker points"] if by else [], text)
                if by:
                    values = result["parameters"]["target/body/points"]["value"]
                    found = [values[i:i + 3] for i in range(0, 12, 3)]
                    for a in range(4):
                        for b in range(a):
                            self.assertLess(abs(math.dist(found[a], found[b]) - math.dist(points[a], points[b])), 1e-4)

    def test_a_sigma_stated_ten_times_too_small_is_named_and_errors_hold(self):
        """chi2/dof near 100: the finding alone would leave predicted errors a tenth of the actual ones."""
        for part, true, rig in (("a sensor", POSED.replace("sigma: 0.2}", "sigma: 2}"), CAMERA), ("joints", POSED.replace("sigma: 0.0002}", "sigma: 0.002}"), CAMERA)):
            with self.subTest(part=part):
                samples = self.simulate(true, CAMERA_TRUTH, samples=30, seed=4, out=part.replace(" ", "_"))
                self.write("open.yaml", rig)
                result, text = self.calibrate(samples, rig="open.yaml")
                if part == "a sensor":      # (joints: chi2/dof is below 25, where noise is estimated without a finding)
                    self.assertEqual([f["id"] for f in result["findings"]], ["sigma"], text)
                self.assertEqual(result["verdict"]["use"], "doubts")
                self.assertNotIn("does not explain everything", text)
                self.assertLess(result["chi2_data"] / result["dof_data"], 1.3)
                for name in ("joint/j2/offset", "joint/j3/offset"):
                    estimate = result["parameters"][name]
                    self.assertLess(abs(estimate["value"][0] - CAMERA_TRUTH[name]), 3.5 * estimate["sigma"][0], name)

    def test_what_a_lag_explains_alone_is_no_second_mistake(self):
        """A board that moved, or another resolution, seemed to explain a part, and was named beside the lag."""
        for share in (0.05, 0.1):
            with self.subTest(share=share):
                samples = self.simulate(POSED, CAMERA_TRUTH, samples=30, seed=2, out="sim%g" % share)
                for now, before in zip(samples[:0:-1], samples[-2::-1]):
                    for joint in now["joints"]:
                        now["joints"][joint] += share * (before["joints"][joint] - now["joints"][joint])
                self.write("samples.jsonl", "".join(json.dumps(s) + "\n" for s in samples))
                found = json.loads(self.kincal("check", "rig.yaml", "samples.jsonl", "--json"))["findings"]
                self.assertEqual([f["id"] for f in found], ["lag"])

    def test_a_prior_that_the_data_contradict_is_named(self):
        samples = self.simulate(TRACKER, TRACKER_TRUTH, samples=30)
        for width, expected in ((0.0003, 1), (0.005, 0)):
            self.write("stated.yaml", TRACKER + "priors:\n  joint/*/offset: %g\n" % width)
            result, text = self.calibrate(samples, rig="stated.yaml")
            found = [w for w in self.warnings(result, "prior") if "the rig's prior on joint/*/offset" in w]
            self.assertEqual(len(found), expected, text)

    def test_diff_compares_nothing_with_an_open_pose(self):
        self.calibrate(self.simulate(TRACKER, TRACKER_TRUTH))
        d = json.loads(self.kincal("diff", "rig.yaml", "out", "--json"))
        self.assertEqual(d["open_in_a"], ["sensor/tracker/pose"] + ["target/r%d/pose" % k for k in range(3)])
        self.assertEqual(d["open_in_b"], [])
        self.assertFalse([name for name in d["parameters"] if name.endswith("/pose")])
        self.assertEqual(list(d["frames"]), ["l6"])
        text = self.kincal("diff", "rig.yaml", "out", "--frame", "sensor/tracker", code=1)
        self.assertIn("rig.yaml leaves the pose of sensor/tracker open", text)

    def test_diff_shows_no_numbers_that_do_not_subtract(self):
        self.calibrate(self.simulate(TRACKER, TRACKER_TRUTH), out="a")
        self.calibrate(self.simulate(TRACKER, TRACKER_TRUTH, seed=2, out="other"), out="b")
        text = self.kincal("diff", "a", "b")
        self.assertRegex(text, r"(/pose|/origin)\.r?[xyz] +m\w+ +- +- +[-+]")
        rows = [line.split() for line in text.splitlines() if "/offset " in line]
        self.assertTrue(rows)
        for row in rows:
            self.assertAlmostEqual(float(row[3]) - float(row[2]), float(row[4]), delta=1e-3 * abs(float(row[4])) + 1e-5)

    def test_a_group_is_called_by_its_option(self):
        self.write("samples.jsonl", "".join(json.dumps(s) + "\n" for s in self.simulate(TRACKER, TRACKER_TRUTH)))
        for option in ("--group", "--no-group"):
            text = self.kincal("calibrate", "rig.yaml", "samples.jsonl", "--out", "out", option, "gear", code=1)
            self.assertIn("kincal: error: %s: there is no group 'gear'" % option, text)

    def test_batch_names_what_moved(self):
        os.makedirs(self.path("sets"))
        for name, z in (("monday", 0.3), ("tuesday", 0.3), ("wednesday", 0.33)):
            truth = dict(TRACKER_TRUTH, **{"sensor/tracker/pose": [2.0, 0.5, z, 0.1, 0.2, 2.0]})
            samples = self.simulate(TRACKER, truth, seed=len(name), out=name)
            os.makedirs(self.path("sets", name))
            self.write("sets/%s/rig.yaml" % name, TRACKER.replace("arm.urdf", "../../arm.urdf"))
            self.write("sets/%s/samples.jsonl" % name, "".join(json.dumps(s) + "\n" for s in samples))
        text = self.kincal("batch", "sets", "--out", "fleet")
        line = [x for x in text.splitlines() if x.startswith("Most different between two sets")]
        self.assertEqual(len(line), 1, text)
        self.assertRegex(line[0], r"sensor/tracker/pose\.z, by [23]\d\.\d+ mm .* and wednesday\.")

    def test_errors_of_a_thousand_sigmas_are_no_noise(self):
        """Points that have nothing to do with the robot: no sigma is to be stated for them."""
        samples = self.simulate(TRACKER, TRACKER_TRUTH, samples=20)
        rng = random.Random(5)
        for view in (v for sample in samples for v in sample["views"]):
            view["points"] = [[rng.uniform(-1, 1) for _ in range(3)] for _ in view["points"]]
        self.write("steps.yaml", TRACKER.replace("{link: l6}", "{link: l6, pose: {xyz: [0.1, 0, 0]}}") + "estimate:\n  - {step: mounts, free: [sensor/tracker/pose, \"target/r*/pose.[xyz]\"]}\n")
        result, text = self.calibrate(samples, "--no-report", code=5, rig="steps.yaml")
        self.assertRegex(result["verdict"]["text"], r"Errors are \d+ times the noise stated in the rig, evenly")
        self.assertNotIn("an understated noise is likelier", result["verdict"]["text"].lower())


CAMERAS = """  %(l)s: {type: camera, link: %(link)s, pose: {xyz: [%(x)s], rpy: [-1.5708, 0.02, 1.5908]}, model: pinhole, intrinsics: [900, 900, 640, 480], image_size: [1280, 960], sigma: 0.2}
  %(r)s: {type: camera, link: %(link)s, pose: {xyz: [%(x)s], rpy: [-1.5708, 0.02, 1.5908]}, model: pinhole, intrinsics: [900, 900, 640, 480], baseline: 0.1, image_size: [1280, 960], sigma: 0.2}
"""


class Pairs(Case):
    """Rectified pairs that no fixed joint carries alone: both cameras have one pose."""
    FOOT = '<link name="foot"/><joint name="base_joint" type="fixed"><parent link="foot"/><child link="base"/></joint><link name="head"/><joint name="neck" type="fixed"><parent link="base"/><child link="head"/></joint></robot>'
    OFF = [0.01, -0.005, 0.012, 0.02, -0.02, 0.01]

    def rig(self, cameras):
        return """format: kincal/1
robot: arm.urdf
base: foot
joints: {"*": {sigma: 0.0002}}
targets:
  board: {type: chessboard, rows: 6, columns: 9, square: 0.025, mount: {link: l6, pose: {xyz: [0.05, -0.1, -0.06], rpy: [0.03, 1.5508, 0]}}}
sensors:
""" + cameras

    def poses(self):
        with open(self.path("out", "rig.yaml"), encoding="utf-8") as file:
            return {name: s.get("pose") for name, s in yaml.safe_load(file)["sensors"].items()}

    def is_right(self, pose, xyz):
        """Against the rig's pose (camera axes: x to -y, y to -z of the base, but for 0.02 rad) and where the truth has moved it."""
        nominal = frame(xyz, (-1.5708, 0.02, 1.5908))
        for found, true in zip(pose["xyz"], move(nominal, self.OFF[:3])):
            self.assertLess(abs(found - true), 0.002, pose)

    def test_a_pair_on_the_robots_base(self):
        """The joint above carries the arm, too: it is no mount of the pair."""
        self.write("arm.urdf", urdf().replace("</robot>", self.FOOT))
        rig = self.rig(CAMERAS % {"l": "left", "r": "right", "link": "base", "x": "2.2, 0.1, 0.5"})
        samples = self.simulate(rig, {"sensor/left/pose": self.OFF, "sensor/right/pose": self.OFF, "joint/j3/offset": 0.004}, samples=30)
        result, text = self.calibrate(samples)
        self.assertIn("sensor/left/pose", result["parameters"])
        self.assertNotIn("joint/base_joint/origin", result["parameters"])
        pair = self.poses()
        self.assertEqual(pair["left"], pair["right"])
        self.is_right(pair["left"], (2.2, 0.1, 0.5))

    def test_two_pairs_on_one_head(self):
        """The joint of the head stands for the pose of the first pair, the second has its own."""
        self.write("arm.urdf", urdf().replace("</robot>", self.FOOT))
        rig = self.rig(CAMERAS % {"l": "left", "r": "right", "link": "head", "x": "2.2, 0.1, 0.5"} + CAMERAS % {"l": "left2", "r": "right2", "link": "head", "x": "2.2, 0.4, 0.4"})
        samples = self.simulate(rig, {"joint/neck/origin": [0.005, 0, 0, 0, 0.01, 0], "sensor/left2/pose": self.OFF, "sensor/right2/pose": self.OFF}, samples=30)
        result, text = self.calibrate(samples)
        pair = self.poses()
        self.assertEqual(pair["left2"], pair["right2"])
        for name, sensor in result["sensors"].items():
            self.assertLess(sensor["train"]["rms"], 0.4, name)
        self.is_right(pair["left2"], (2.2, 0.4, 0.4))


class HeldOut(Case):
    """What is held out decides nothing: with other held-out samples the same robot comes out."""

    def test_held_out_samples_decide_nothing(self):
        samples = self.simulate(POSED, CAMERA_TRUTH, samples=30)
        for s in samples[24:]:
            s["split"] = "test"
        first, _ = self.calibrate(samples, out="first")
        for s in samples[24:]:
            s["joints"]["j3"] = -s["joints"]["j3"]
        second, _ = self.calibrate(samples, out="second")
        with open(self.path("first", "robot.urdf")) as a, open(self.path("second", "robot.urdf")) as b:
            self.assertEqual(a.read(), b.read())
        self.assertEqual(first["chi2"], second["chi2"])

    def test_one_held_out_point_turns_no_sensor(self):
        """A `point` sensor that sees one place only has no rotation, whatever held-out samples see."""
        rig = TRACKER.replace("sigma: 5.0e-05}", "sigma: 5.0e-05}\n  socket: {type: point, link: l6, sigma: 0.0001}").replace(
            "sensors:", "  ball: {type: points, points: [[0, 0, 0]], mount: {link: base, pose: {xyz: [0.9, 0, 0.6]}}}\nsensors:")
        samples = self.simulate(TRACKER, TRACKER_TRUTH, samples=30)
        self.write("rig.yaml", rig)
        for s in samples[26:]:
            s["split"] = "test"
        for s in samples[:4]:
            s["views"].append({"sensor": "socket", "target": "ball", "points": [[0, 0, 0]]})
        dof = []
        for point in ([0, 0, 0], [0.003, 0, 0]):
            held = [dict(s, views=list(s["views"])) for s in samples]
            held[29]["views"].append({"sensor": "socket", "target": "ball", "points": [point]})
            self.write("samples.jsonl", "".join(json.dumps(s) + "\n" for s in held))
            p = subprocess.run([KINCAL, "calibrate", "rig.yaml", "samples.jsonl", "--out", "out", "--force", "--no-report"], capture_output=True, text=True, cwd=self.dir)
            self.assertIn(p.returncode, (0, 2, 3, 5), p.stderr)
            with open(self.path("out", "result.json"), encoding="utf-8") as file:
                dof.append(json.load(file)["dof"])
        self.assertEqual(dof[0], dof[1])

    def test_each_fold_estimates_the_noise_by_itself(self):
        """Cross-validation with --estimate-noise is what calibrations without each fold, which estimate the noise themselves, say of that fold."""
        rig = POSED.replace("sigma: 0.2}", "sigma: 0.6}\nestimate: [{step: all, free: ['*/pose', 'joint/j[2-5]/offset']}]")
        samples = self.simulate(rig.replace("sigma: 0.6}", "sigma: 0.2}"), CAMERA_TRUTH, samples=18)
        self.write("rig.yaml", rig)
        result, _ = self.calibrate(samples, "--cross-validate", "3", "--estimate-noise")
        cross = result["validation"]["cross_validation"]
        squares = points = 0
        for fold in cross["folds"]:
            split = [dict(s, split="test" if s["id"] in fold["held_out"] else "train") for s in samples]
            alone, _ = self.calibrate(split, "--estimate-noise", out="alone")
            test = alone["validation"]["test"]["cam"]
            squares += test["rms"] ** 2 * test["points"]
            points += test["points"]
        self.assertAlmostEqual(cross["sensors"]["cam"]["rms"] / math.sqrt(squares / points), 1, places=4)


class Data(Case):
    """What shows in the data alone, and permutations of readings."""

    def found(self, samples):
        self.write("samples.jsonl", "".join(json.dumps(s) + "\n" for s in samples))
        p = subprocess.run([KINCAL, "check", "rig.yaml", "samples.jsonl", "--json"], capture_output=True, text=True, cwd=self.dir)
        return [(f["id"], f["text"]) for f in json.loads(p.stdout)["findings"]]

    def test_a_view_twice_is_one(self):
        samples = self.simulate(POSED, CAMERA_TRUTH, samples=20)
        samples[3]["views"].append(samples[3]["views"][0])
        self.assertIn("duplicates", [id for id, text in self.found(samples) if "twice, with identical values, in sample %s" % samples[3]["id"] in text])

    def test_a_picture_that_was_paired_twice(self):
        samples = self.simulate(POSED, CAMERA_TRUTH, samples=20)
        for i in range(1, 20, 2):
            samples[i]["views"] = samples[i - 1]["views"]
        found = [text for id, text in self.found(samples) if id == "duplicates"]
        self.assertIn("10 samples", found[0])

    def test_columns_that_begin_with_another_joint(self):
        samples = self.simulate(POSED, CAMERA_TRUTH, samples=24)
        self.assertEqual(self.found(samples), [])
        names = ["j%d" % k for k in range(1, 7)]
        for by in (1, 2, 5):
            wrong = [dict(s, joints={n: s["joints"][names[(i + by) % 6]] for i, n in enumerate(names)}) for s in samples]
            found = self.found(wrong)
            self.assertEqual(found[0][0], "exchanged-joints", found)
            self.assertIn("begin with that of another joint", found[0][1])

    def test_readings_in_pulses_are_no_degrees(self):
        scale = 1.3e-5
        samples = self.simulate(POSED, CAMERA_TRUTH, samples=20)
        self.write("rig.yaml", POSED.replace('"*": {sigma: 0.0002}', '"*": {sigma: 15, scale: %g}' % scale))
        for s in samples:
            s["joints"] = {name: round(q / scale) for name, q in s["joints"].items()}
        self.assertEqual(self.found(samples), [])

    def test_a_prior_on_what_no_group_has_counts(self):
        """The origin of a fixed joint before the camera's link: free within its prior."""
        self.write("arm.urdf", urdf().replace("</robot>", '<link name="plate"/><joint name="bracket" type="fixed"><parent link="base"/><child link="plate"/></joint></robot>'))
        rig = POSED.replace("link: base, pose", "link: plate, pose") + "priors: {joint/bracket/origin: {translation: 0.0001, rotation: 0.0001}}\n"
        result, _ = self.calibrate(self.simulate(rig, CAMERA_TRUTH), code=0)
        self.assertIn("joint/bracket/origin", result["parameters"])
        self.assertEqual(self.warnings(result, "unused_prior"), [])


class Pr2(Case):
    def test_bearings_with_the_wrong_sign(self):
        """The laser's pose, given but free, takes them up: upside down it sees the same. chi2 is good, and the mistake is named none the less."""
        example = os.path.join(SOURCE_DIR, "examples", "pr2")
        with open(os.path.join(example, "rig.yaml")) as f:
            rig = f.read().replace("robot: robot.urdf", "robot: " + os.path.join(example, "robot.urdf"))
        rig = rig[:rig.index("\nestimate:") + 1]
        laser = "    link: laser_tilt_link\n"
        self.assertEqual(rig.count(laser), 1)
        with open(os.path.join(example, "samples.jsonl")) as f:
            samples = [json.loads(line) for line in f]
        for sign, use in ((1, "good"), (-1, "doubts")):
            for view in (v for sample in samples for v in sample["views"] if v["sensor"] == "tilt_laser"):
                view["rays"] = [[tilt, sign * bearing, distance] for tilt, bearing, distance in view["rays"]]
            self.write("rig.yaml", rig.replace(laser, laser + "    pose: {xyz: [0, 0, -0.006], rpy: [0.019, -0.012, -0.015]}\n"))
            result, text = self.calibrate(samples, "--no-report")
            self.assertEqual(result["verdict"]["use"], use, text)
            named = [(f["id"], f["where"]) for f in result.get("findings", [])]   # (the laser's tilt has a gear of 1.02, which is named too)
            self.assertEqual(("mirrored", ["tilt_laser"]) in named, sign < 0, text)


SCARA = """format: kincal/1
robot: scara.urdf
base: base
joints: {j1: {sigma: 0.0002}, j2: {sigma: 0.0002}, j3: {sigma: 0.00005}, j4: {sigma: 0.0002}}
targets:
  board: {type: chessboard, rows: 8, columns: 11, square: 0.03, mount: {link: base%s}}
sensors:
  cam: {type: camera, model: brown_conrady, link: l4, image_size: [1280, 960], intrinsics: [900, 900, 640, 480], sigma: 0.2%s}
"""
SCARA_POSES = (", pose: {xyz: [0.3, -0.1, -0.25], rpy: [0, 0, 0.02]}", ", pose: {xyz: [0.03, -0.02, -0.03], rpy: [3.12, 0.03, 0.4]}")


class Parallel(Case):
    """All axes parallel, one slide, a camera in the hand above a board: how high both stand is not determined, only how far apart."""

    def samples(self):
        joint = '<joint name="%s" type="%s"><parent link="%s"/><child link="%s"/><origin xyz="%s"/><axis xyz="0 0 1"/><limit lower="%g" upper="%g" effort="1" velocity="1"/></joint><link name="%s"/>'
        joints = (("j1", "revolute", "base", "l1", "0 0 0.35", -1.2, 1.2), ("j2", "revolute", "l1", "l2", "0.3 0 0", -1.8, 1.8),
                  ("j3", "prismatic", "l2", "l3", "0.25 0 0", -0.15, 0), ("j4", "revolute", "l3", "l4", "0 0 -0.02", -2, 2))
        self.write("scara.urdf", '<robot name="scara"><link name="base"/>' + "".join(joint % (*j, j[3]) for j in joints) + "</robot>")
        camera, board = frame([0.033, -0.018, -0.034], [3.11, 0.02, 0.41]), frame([0.3, -0.1, -0.25], [0, 0, 0.02])
        corners = [(0.03 * c, 0.03 * r, 0) for r in range(8) for c in range(11)]
        rng, out = random.Random(4), []

        def turn(angle, xyz):
            return axis_angle((0, 0, 1), angle, xyz)
        while len(out) < 30:
            q = [rng.uniform(low, high) for low, high in ((-1.2, 1.2), (-1.8, 1.8), (-0.15, 0), (-2, 2))]
            tool = mul(mul(turn(q[0], (0, 0, 0.35)), turn(q[1] + 0.006, (0.3, 0, 0))), mul(turn(0, (0.25, 0, q[2])), turn(q[3], (0, 0, -0.02))))
            to_camera = mul(inverse(mul(tool, camera)), board)
            seen = [move(to_camera, p) for p in corners]
            pixels = [[900 * x / z + 640 + rng.gauss(0, 0.2), 900 * y / z + 480 + rng.gauss(0, 0.2)] for x, y, z in seen]
            if all(0 <= u <= 1279 and 0 <= v <= 959 for u, v in pixels):
                readings = {"j%d" % (k + 1): a + rng.gauss(0, 5e-5 if k == 2 else 2e-4) for k, a in enumerate(q)}
                out.append({"id": "s%d" % len(out), "joints": readings, "views": [{"sensor": "cam", "target": "board", "pixels": pixels}]})
        return out

    def test_what_no_posture_tells_is_named_and_stays_near_the_start(self):
        samples = self.samples()
        for poses, near in ((SCARA_POSES, -0.03), (("", ""), None), ((SCARA_POSES[0], ""), None)):
            with self.subTest(poses=poses):
                self.write("rig.yaml", SCARA % poses)
                result, text = self.calibrate(samples)
                self.assertEqual(result["verdict"]["use"], "good", text)
                self.assertEqual(result.get("findings", []), [], text)
                said, = self.warnings(result, "gauge")
                self.assertRegex(said, r"(target/board/pose\.z cannot be distinguished from sensor/cam/pose\.z|sensor/cam/pose\.z cannot be distinguished from target/board/pose\.z) in any posture")
                self.assertIn("fixed as the rig gives it" if poses[0] else "fixed at its starting value", said)
                camera, board = (result["parameters"][name]["pose"]["xyz"] for name in ("sensor/cam/pose", "target/board/pose"))
                self.assertAlmostEqual(camera[2] - board[2], 0.216, delta=0.002)   # how far apart is known
                self.assertLess(abs(camera[2] + 0.034), 0.5)                       # and how high is not led away
                sigmas = [result["parameters"].get("sensor/cam/pose", {"sigma": [0] * 6})["sigma"][2], result["parameters"]["target/board/pose"]["sigma"][2]]
                if poses[0]:
                    self.assertLess(max(sigmas), 0.05)
                else:                                                              # and is not said to be known
                    self.assertGreater(max(sigmas), 0.5)
                    self.kincal("calibrate", "rig.yaml", "samples.jsonl", "--out", "required", "--force", "--no-report", "--require", "frame/sensor/cam<100mm",
                                "--require", "frame/target/board<100mm", code=4)
                if near is not None:
                    self.assertAlmostEqual(camera[2], near, delta=0.01)
                self.assertAlmostEqual(camera[0], 0.033, delta=0.001)
        self.assertIn("nothing to explain", self.kincal("check", "rig.yaml", "samples.jsonl", "--quiet"))

    def test_two_cameras_that_see_free_boards_only(self):
        """Where both are together is a choice: the place of one is fixed, the other's place and the lenses are determined. Views that do not belong together are named."""
        camera = "  %s: {type: camera, model: brown_conrady, link: l2, image_size: [1280, 960], intrinsics: [%g, %g, 640, 480], sigma: 0.2%s}\n"
        rig = """format: kincal/1
robot: mast.urdf
base: base
joints: {"*": {sigma: 0.0001}}
targets:
  board: {type: chessboard, rows: 8, columns: 11, square: 0.03, mount: free}
sensors:
"""
        self.write("mast.urdf", '<robot name="mast"><link name="base"/>' + "".join(
            '<joint name="%s" type="%s"><parent link="%s"/><child link="%s"/><origin xyz="0.1 0 0.3"/><axis xyz="0 0 1"/><limit lower="-0.5" upper="0.5" effort="1" velocity="1"/></joint><link name="%s"/>' % (*j, j[3])
            for j in (("lift", "prismatic", "base", "l1"), ("pan", "revolute", "l1", "l2"))) + "</robot>")
        poses = [", pose: {xyz: [%g, 0, 0], rpy: [0, %g, 0]}" % p for p in ((0, 0), (0.12, -0.05))]
        samples = self.simulate(rig + "".join(camera % (n, 903, 904, p) for n, p in zip(("left", "right"), poses)), {}, samples=25)
        for given in (poses, (poses[0], ""), ("", "")):
            with self.subTest(given=given):
                self.write("rig.yaml", rig + "".join(camera % (n, 900, 900, p) for n, p in zip(("left", "right"), given)))
                result, text = self.calibrate(samples)
                self.assertEqual(result["verdict"]["use"], "good", text)
                self.assertIn("6 parameters are free choices", self.warnings(result, "gauge")[0])
                left, right = (pose["pose"] for pose in (result["parameters"].get("sensor/%s/pose" % n, {"pose": {"xyz": [0, 0, 0]}}) for n in ("left", "right")))
                self.assertAlmostEqual(math.dist(left["xyz"], right["xyz"]), 0.12, delta=0.002)
                for n in ("left", "right"):
                    self.assertAlmostEqual(result["parameters"]["sensor/%s/intrinsics" % n]["value"][0], 903, delta=2)
        views = [s["views"] for s in samples]
        for i, s in enumerate(samples):
            s["views"] = [v for v in views[i] if v["sensor"] == "left"] + [v for v in views[(7 * i + 3) % 25] if v["sensor"] == "right"]
        result, text = self.calibrate(samples, code=3)
        self.assertIn("views-apart", [f["id"] for f in result["findings"]], text)

    def test_one_pose_given_determines_the_other(self):
        self.write("rig.yaml", SCARA % SCARA_POSES + "estimate:\n  - {step: camera, free: [sensor/cam/pose, joint/j2/offset]}\n")
        result, _ = self.calibrate(self.samples())
        self.assertEqual(result["verdict"]["use"], "good", result["verdict"])
        self.assertAlmostEqual(result["parameters"]["sensor/cam/pose"]["pose"]["xyz"][2], -0.034, delta=0.0005)


class Scales(Case):
    """Lengths that hang on one number: proved where nothing else tells it, and where all else is right."""

    def wrong(self, result, truth):
        """Estimates of poses further off than three sigmas."""
        out = []
        for name, true in truth.items():
            found = result["parameters"].get(name)
            for c, (x, sigma) in enumerate(zip(found["value"], found["sigma"])) if found else []:
                if sigma and abs(x - (true[c] if isinstance(true, list) else true)) > 3 * sigma:
                    out.append("%s %d" % (name, c))
        return out

    def test_squares_of_what_a_head_sees(self):
        """The head turns about one place, so a wrong square makes the whole room and the cameras' distance larger."""
        self.write("looking.urdf", LOOKING)
        samples = self.simulate(STEREO_HEAD % {"square": 0.06}, STEREO_TRUTH, samples=40)
        result, text = self.calibrate(samples)
        self.assertEqual(self.warnings(result, "scale"), [], text)
        unchecked, = self.warnings(result, "unchecked")
        self.assertIn("the squares of targets 'near', 'left', 'right': with an error of one percent, target/", unchecked)
        self.assertRegex(result["verdict"]["text"], "^converged; .* It is only as accurate as the squares of targets 'near', 'left', 'right', which nothing checks")
        self.assertEqual(self.wrong(result, {n: v for n, v in STEREO_TRUTH.items() if n.startswith("target")}), [])
        self.write("wrong.yaml", STEREO_HEAD % {"square": 0.05})
        result, text = self.calibrate(samples, rig="wrong.yaml")
        self.assertEqual(result["verdict"]["use"], "doubts")
        self.assertRegex(result["verdict"]["text"], "^all lengths between sensors and targets came out 0.8[345]\\d? times those of the rig .* assumed 1.(2|19)")
        self.assertIn("measure the spacing", result["verdict"]["next"][0])
        self.assertNotEqual(self.wrong(result, {n: v for n, v in STEREO_TRUTH.items() if n.startswith("target")}), [])  # what the doubt is about

    def test_a_sign_that_given_poses_take_up(self):
        """Turned by half a turn, all poses explain readings of the wrong sign as well as the right ones do; how far they are from those in the rig decides,
        also where the lenses are off by more than the noise. What it does not prove: anything where no pose is given."""
        self.write("looking.urdf", LOOKING.replace('xyz="0.05 0 0.1"', 'xyz="0 0 0.1"'))   # its axes meet
        lenses = {"sensor/eye/intrinsics": [504, 503, 322, 241.5], "sensor/eye2/intrinsics": [497, 498, 318.5, 238]}
        samples = self.simulate(STEREO_HEAD % {"square": 0.06}, dict(STEREO_TRUTH, **lenses), samples=30, seed=3)
        result, text = self.calibrate(samples)
        self.assertEqual((result["verdict"]["use"], result["findings"]), ("good", []), text)
        for s in samples:
            s["joints"]["tilt"] *= -1
        result, text = self.calibrate(samples)
        self.assertEqual([(f["id"], f["where"]) for f in result["findings"]], [("joint-sign", ["tilt"])], text)
        self.assertNotEqual(result["verdict"]["use"], "good")
        said = self.kincal("check", "rig.yaml", "samples.jsonl")
        self.assertIn("oint 'tilt' turns the other way", said)
        self.assertRegex(said, r"chi2/dof is [\d.]+; [\d.]+ with the findings corrected, and [01]\.\d+ with the usual errors of a robot")

    def test_a_slide_that_nothing_checks(self):
        """A camera that looks along the only slide: its focal length is as long as the slide's readings say."""
        self.write("scara.urdf", SLIDE_URDF)
        samples = self.simulate(SLIDE, SLIDE_TRUTH, samples=25)
        for s in samples:
            s["joints"]["j3"] *= 1.02
        result, text = self.calibrate(samples)
        wrong = self.wrong(result, {"sensor/cam/intrinsics": SLIDE_TRUTH["sensor/cam/intrinsics"]})
        self.assertEqual(wrong[:2], ["sensor/cam/intrinsics 0", "sensor/cam/intrinsics 1"], text)
        self.assertRegex(" ".join(self.warnings(result, "unchecked")), "the readings of joint 'j3': with an error of one percent, sensor/cam/intrinsics.f[xy] would "
                                                                       "shift by (9|10|11).* What to do: compare a long travel of the joint with a ruler")
        self.assertIn("It is only as accurate as the readings of joint 'j3', which nothing checks", result["verdict"]["text"])

    def test_a_point_is_not_turned_where_a_part_of_its_pose_is_held(self):
        self.write("gantry.urdf", GANTRY_URDF)
        truth = {"target/ball/pose": [0.008, -0.006, 0, 0, 0, 0], "sensor/tracker/pose": [0.02, -0.01, 0.015, 0.01, 0.02, -0.02]}
        samples = self.simulate(GANTRY, truth, samples=20)
        result, text = self.calibrate(samples, "--fix", "target/ball/pose.z")
        ball = result["parameters"]["target/ball/pose"]
        self.assertEqual(ball["value"][2:], [0, 0, 0, 0], text)
        self.assertEqual(result["verdict"]["use"], "good", text)
        self.assertEqual(self.wrong(result, truth), [])

    def test_a_given_pose_far_off_leaves_no_other_in_the_wrong_place(self):
        """A fisheye camera half a metre and 45 degrees from where the rig says: it may find back while a board that nobody measured stays where
        the camera's given pose has put it (so it was with each of these seeds)."""
        rig = """format: kincal/1
robot: %s
base: base
joints:
  "*": {sigma: 0.0003}
targets:
  table: {type: chessboard, rows: 6, columns: 8, square: 0.04, mount: {link: base%s}}
  wall: {type: chessboard, rows: 6, columns: 8, square: 0.04, mount: {link: base%s}}
sensors:
  eye: {type: camera, link: flange, model: kannala_brandt, intrinsics: [400.0, 400.0, 639.5, 479.5], image_size: [1280, 960],
        distortion: [0.03, -0.01, 0.002, -0.0005], sigma: 0.1, pose: {xyz: %s, rpy: %s}}
"""
        robot = os.path.join(SOURCE_DIR, "examples", "arm", "robot.urdf")
        place, turn = [0.05, 0, 0.03], [-math.pi / 2, 0, -math.pi / 2]
        self.write("given.yaml", rig % (robot, ", pose: {xyz: [0.7, -0.1, 0], rpy: [3.14159265, 0, 0]}",
                                        ", pose: {xyz: [1.2, 0.2, 0.7], rpy: [-1.5707963, 0, -1.5707963]}", place, turn))
        for seed in (8, 20, 33, 36):
            draw = random.Random(seed)
            away, turned = ([v + far * draw.gauss(0, 1) / 1.7 for v in pose] for far, pose in ((0.5, place), (0.8, turn)))
            self.write("far.yaml", rig % (robot, "", "", away, turned))
            self.kincal("simulate", "given.yaml", "--samples", "25", "--seed", str(seed), "--out", "sim%d" % seed, "--quiet")
            self.kincal("calibrate", "far.yaml", "sim%d/samples.jsonl" % seed, "--out", "far%d" % seed, "--quiet", "--no-report")
            with open(self.path("far%d" % seed, "result.json")) as f:
                result = json.load(f)
            self.assertEqual(result["verdict"]["use"], "good", result["verdict"]["text"])
            self.assertLess(result["chi2_data"] / result["dof_data"], 1.2)


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:], verbosity=1)
