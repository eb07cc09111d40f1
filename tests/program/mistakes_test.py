"""Mistakes that a newcomer makes, planted one at a time: python3 mistakes_test.py SOURCE_DIR KINCAL [TEST ...]

Each must be the first finding of `check`, or of `calibrate` on a rig without steps, with the cure for it, and nothing else may be found. All
data are simulated here: an arm with a camera, a tracker or reflectors, on a rail, with two arms. Not proved: that other robots show them,
and mistakes of check_test.py.
"""

import copy
import json
import math
import os
import random
import re
import subprocess
import sys
import tempfile
import unittest

import helpers
from cli_test import axis_angle, frame, move, mul

SOURCE_DIR = KINCAL = FOLDER = None
SCENES = {}

AXES = [("0 0 0.3", "0 0 1"), ("0.05 0 0.1", "0 1 0"), ("0.4 0 0", "0 1 0"), ("0.3 0 0.05", "1 0 0"), ("0.1 0 0", "0 1 0"), ("0.08 0 0", "1 0 0")]
POINTS = [[0, 0, 0], [0.1, 0, 0.02], [0.1, 0.08, 0], [-0.01, 0.09, 0.05]]
HEAD = 'format: kincal/1\nrobot: arm.urdf\nbase: base\njoints:\n  "*": {sigma: 0.0002}\ntargets:\n'
CAMERA = ("  {name}: {{type: camera, model: brown_conrady, link: {link}, image_size: [1280, 960], intrinsics: [1000, 1000, 640, 480], "
          "sigma: 0.2{more}}}\n")
BOARD = "  {name}: {{type: chessboard, rows: 6, columns: 9, square: 0.025, mount: {{link: {link}{more}}}}}\n"
ROOM = ", pose: {xyz: [2.2, 0.1, 0.5], rpy: [-1.5708, 0.02, 1.5908]}"
HAND = ", pose: {xyz: [0.05, -0.1, -0.06], rpy: [0.03, 1.5508, 0.02]}"
TRACKER = "sensors:\n  tracker: {type: point, link: base, sigma: 5.0e-05}\n"
TRACKER_TRUTH = {"sensor/tracker/pose": [2, 0.5, 0.3, 0.1, 0.2, 2]}


def link(name, kind, parent, child, origin, axis, low=-1.2, high=1.2):
    xyz, rpy = (origin.split("|") + ["0 0 0"])[:2]
    moving = "" if kind == "fixed" else '<axis xyz="%s"/><limit lower="%g" upper="%g" effort="1" velocity="1"/>' % (axis, low, high)
    return ('<joint name="%s" type="%s"><parent link="%s"/><child link="%s"/><origin xyz="%s" rpy="%s"/>%s</joint><link name="%s"/>'
            % (name, kind, parent, child, xyz, rpy, moving, child))


def arm(axes=None, parent="base", prefix=""):
    out = []
    for k, (xyz, axis) in enumerate(axes or AXES, 1):
        out.append(link(prefix + "j%d" % k, "revolute", parent, prefix + "l%d" % k, xyz, axis))
        parent = prefix + "l%d" % k
    return out


def robot(joints):
    return '<robot name="arm"><link name="base"/>' + "\n".join(joints) + "</robot>"


def two_arms():
    out = [link("pan", "revolute", "base", "neck", "0.05 0 0.7", "0 0 1", -0.6, 0.6), link("tilt", "revolute", "neck", "head", "0.05 0 0.1", "0 1 0", -0.2, 0.7),
           link("optics", "fixed", "head", "optical", "0 0 0|-1.5708 0 -1.5708", "")]
    axes = [("0.1 0 0", "0 1 0"), ("0.25 0 0", "0 1 0"), ("0.2 0 0", "1 0 0"), ("0.05 0 0", "0 1 0")]
    for side, y in (("left", 0.2), ("right", -0.2)):
        out.append(link(side + "_j0", "revolute", "base", side + "_l0", "0.05 %g 0.4" % y, "0 0 1", -0.6, 0.6))
        out += arm(axes, side + "_l0", side + "_")
    return robot(out)


def make(name):
    """URDF, rig without poses, rig with poses, truth; how many samples."""
    rail = [link("rail", "prismatic", "base", "cart", "0 0 0.1", "0 1 0", -0.5, 0.5)] + arm(parent="cart")
    tool = HEAD + "  tool: {type: points, points: %s, mount: {link: l6}}\n" % POINTS + TRACKER
    if name == "tool":
        return robot(arm()), tool, tool, dict(TRACKER_TRUTH, **{"target/tool/pose": [0.1, 0.05, 0.02, 0.2, 0.1, 0.3]}), 24
    if name == "balls":
        rig = HEAD + "".join("  r%d: {type: points, points: [[0, 0, 0]], mount: {link: l6}}\n" % k for k in range(3)) + TRACKER
        at = {"target/r%d/pose" % k: xyz + [0, 0, 0] for k, xyz in enumerate(([0.1, 0.05, 0.02], [0.08, -0.06, 0.03], [0.12, 0, -0.07]))}
        return robot(arm()), rig, rig, dict(TRACKER_TRUTH, **at), 24
    if name == "head":
        def rig(pose):
            return (HEAD + "".join(BOARD.format(name=side, link=side + "_l4", more=pose).replace("6, columns: 9, square: 0.025", "4, columns: 5, square: 0.02")
                                   for side in ("left", "right")) + "sensors:\n" + CAMERA.format(name="cam", link="optical", more=pose and ", pose: {xyz: [0, 0, 0]}"))
        return two_arms(), rig(""), rig(", pose: {xyz: [0.05, 0.02, 0.02], rpy: [0, -1.57, 0]}"), {}, 40
    if name == "mocap":
        rig = HEAD + "  body: {type: points, points: %s, mount: {link: l6}}\nsensors:\n" % POINTS + "  mocap: {type: pose, link: base, sigma: {translation: 0.0002, rotation: 0.0005}}\n"
        return robot(arm()), rig, rig, {"sensor/mocap/pose": [2, 0.5, 0.3, 0.1, 0.2, 2], "target/body/pose": [0.1, 0.05, 0.02, 0.2, 0.1, 0.3]}, 24
    if name == "laser":
        tilt = [link("tilt", "revolute", "base", "tilter", "1.6 0.1 0.5|0 0 3.1", "0 1 0", -0.9, 0.9), link("hold", "fixed", "tilter", "laser", "0.03 0 0.05|0.02 0 0", "")]
        rig = (HEAD + BOARD.format(name="board", link="l6", more=HAND).replace("0.025", "0.05") + "sensors:\n" + CAMERA.format(name="cam", link="base", more=ROOM)
               + "  lidar: {type: tilting_laser, link: laser, pose: {xyz: [0, 0, 0]}, joint: tilt, sigma: {joint: 0.0005, bearing: 0.0007, range: 0.002}}\n")
        return robot(arm() + tilt), rig, rig, {}, 24
    joints = rail if name == "rail" else arm()
    rigs = [HEAD + BOARD.format(name="board", link="l6", more=h) + "sensors:\n" + CAMERA.format(name="cam", link="base", more=r) for h, r in (("", ""), (HAND, ROOM))]
    if name == "stereo":
        rigs = [rigs[1] + CAMERA.format(name="cam2", link="base", more=ROOM + ", baseline: 0.12")] * 2
    return robot(joints), rigs[0], rigs[1], {}, 24


class Scene:
    """A copy of a simulated set, to be spoilt; `rig` has no poses."""

    def __init__(self, name):
        self.urdf, self.rig, self.posed, truth, count = make(name)
        self.dir = tempfile.mkdtemp(dir=FOLDER)
        if name not in SCENES:
            self.write(self.posed, [])
            with open(os.path.join(self.dir, "truth.json"), "w", encoding="utf-8") as f:
                offsets = {"joint/right_j2/offset": -0.005} if name == "head" else {"joint/j2/offset": 0.008, "joint/j3/offset": -0.006}
                json.dump({"parameters": dict(truth, **offsets)}, f)
            subprocess.run([KINCAL, "simulate", "rig.yaml", "--samples", str(count), "--seed", "1", "--truth", "truth.json", "--out", "sim"], cwd=self.dir,
                           check=True, capture_output=True)
            with open(os.path.join(self.dir, "sim", "samples.jsonl"), encoding="utf-8") as f:
                SCENES[name] = [json.loads(line) for line in f]
        self.samples = copy.deepcopy(SCENES[name])

    def views(self):
        return (v for s in self.samples for v in s["views"])

    def readings(self, joint, change):
        for s in self.samples:
            s["joints"][joint] = change(s["joints"][joint])
        return self

    def write(self, rig, samples):
        for name, content in (("arm.urdf", self.urdf), ("rig.yaml", rig), ("samples.jsonl", "".join(json.dumps(s) + "\n" for s in samples))):
            with open(os.path.join(self.dir, name), "w", encoding="utf-8") as f:
                f.write(content)

    def check(self, rig=None):
        self.write(rig or self.rig, self.samples)
        p = subprocess.run([KINCAL, "check", "rig.yaml", "samples.jsonl", "--json"], capture_output=True, text=True, cwd=self.dir)
        assert p.stdout, p.stderr
        return json.loads(p.stdout)["findings"]

    def calibrate(self):
        self.write(self.rig, self.samples)
        p = subprocess.run([KINCAL, "calibrate", "rig.yaml", "samples.jsonl", "--out", "out", "--force", "--json", "--no-report"], capture_output=True,
                           text=True, cwd=self.dir)
        return p.returncode, json.loads(p.stdout or "{}"), p.stderr


class Case(unittest.TestCase):
    def one(self, findings, kind, where, cure, chi2=4000):
        self.assertEqual([f["id"] for f in findings], [kind], findings)
        self.assertTrue(set(where) <= set(findings[0]["where"]), findings)
        self.assertRegex(findings[0]["text"], cure)
        self.assertLess(findings[0]["chi2_corrected"], chi2)


class Clean(Case):
    def test_nothing_is_found(self):
        for name in ("tool", "balls", "room", "rail", "head", "stereo"):
            with self.subTest(name):
                self.assertEqual(Scene(name).check(), [])


class Readings(Case):
    def test_another_zero(self):
        for joint, turn, words in (("j3", math.pi / 2, "-pi/2 has to"), ("j4", -math.pi / 2, " pi/2 has to"), ("j3", math.pi, "pi has to")):
            with self.subTest(joint=joint, turn=turn):
                self.one(Scene("room").readings(joint, lambda q: q + turn).check(), "home-position", [joint], words)
        code, result, _ = Scene("tool").readings("j3", lambda q: q + math.pi / 2).calibrate()  # a free offset takes it up
        self.assertNotEqual(result["verdict"]["use"], "yes")
        self.assertEqual([f["id"] for f in result["findings"]], ["home-position"])

    def test_exchanged_joints(self):
        for name, a, b in (("room", "j2", "j3"), ("tool", "j1", "j3"), ("rail", "j4", "j5")):
            with self.subTest(name):
                scene = Scene(name)
                for s in scene.samples:
                    q = s["joints"]
                    q[a], q[b] = q[b], q[a]
                self.one(scene.check(), "exchanged-joints", [a, b], "Exchange the two names")

    def test_numbers_under_the_names_of_other_joints(self):
        """All numbers in one order under names in another, as of /joint_states, which is alphabetical."""
        names = ["base_yaw", "shoulder", "elbow", "roll", "wrist", "flange_turn"]
        for given, right, words in ((names, sorted(names), "stand in the names' alphabetical order"), (sorted(names), names, "under the names in alphabetical order"),
                                    (names, names[::-1], "stand in reversed order")):
            for name in helpers.some(("room", "tool"), 1):
                scene = Scene(name)
                for k, joint in enumerate(names, 1):
                    scene.urdf = scene.urdf.replace('<joint name="j%d"' % k, '<joint name="%s"' % joint)
                for s in scene.samples:
                    q = {joint: s["joints"]["j%d" % k] for k, joint in enumerate(names, 1)}
                    s["joints"] = {joint: q[of] for joint, of in zip(given, right)}
                with self.subTest(name, words=words):
                    self.one(scene.check(), "exchanged-joints", names, words)

    def test_exchanged_arms(self):
        scene = Scene("head")
        for s in scene.samples:
            s["joints"] = {re.sub("left|right", lambda m: "right" if m[0] == "left" else "left", j): q for j, q in s["joints"].items()}
        self.one(scene.check(), "exchanged-joints", ["left_j1", "right_j1"], "Exchange left and right")
        scene = Scene("head")
        for v in scene.views():
            v["target"] = "left" if v["target"] == "right" else "right"
        self.assertIn(scene.check()[0]["id"], ("exchanged-targets", "exchanged-joints"))

    def test_absolute_angles(self):
        for sign, words in ((1, "Subtract the reading of 'j2' from that of 'j3'"), (-1, "Add the reading of 'j2' to that of 'j3'")):
            scene = Scene("room")
            for s in scene.samples:
                s["joints"]["j3"] += sign * s["joints"]["j2"]
            self.one(scene.check(), "absolute-angle", ["j3", "j2"], words)

    def test_ids_from_one_on_two_boards(self):
        """One detector counts them from 1 on both boards, and the last point is missing."""
        scene = Scene("head")
        for v in scene.views():
            v["pixels"] = v["pixels"][:-1]
            v["ids"] = list(range(1, len(v["pixels"]) + 1))
        self.one(scene.check(), "numbering", ["left", "right"], "Subtract 1")

    def test_two_signs(self):
        scene = Scene("room").readings("j2", lambda q: -q).readings("j4", lambda q: -q)
        self.one(scene.check(), "joint-sign", ["j2", "j4"], "Change the signs")
        scene = Scene("head").readings("left_j1", lambda q: -q).readings("right_j2", lambda q: -q)
        self.one(scene.check(), "joint-sign", ["left_j1", "right_j2"], "Change the signs")

    def test_another_axis(self):
        for joint, right, wrong in (("j3", "0 1 0", "0 0 1"), ("j4", "1 0 0", "0 -1 0")):
            scene = Scene("room")
            before, at, after = scene.urdf.partition('<joint name="%s"' % joint)
            scene.urdf = before + at + after.replace('<axis xyz="%s"/>' % right, '<axis xyz="%s"/>' % wrong, 1)
            found = scene.check()
            self.assertEqual([(f["id"], f["where"]) for f in found], [("joint-axis", [joint])], found)
            self.assertIn('Write <axis xyz="%s"/>' % right, found[0]["text"])

    def test_a_gear(self):
        for name in ("room", "tool"):
            self.one(Scene(name).readings("j2", lambda q: 1.02 * q).check(), "gear", ["j2"], r"moves 0\.98\d* times .* wrong by (2|1\.[89]\d*) %")

    def test_a_robot_that_moves_yet(self):
        scene = Scene("room")
        for s, after in zip(scene.samples, copy.deepcopy(scene.samples[1:])):
            s["joints"] = {j: q + 0.01 * (after["joints"][j] - q) for j, q in s["joints"].items()}
        self.one(scene.check(), "lag", ["joints"], r"by (0\.9\d*|1|1\.\d) % of the way to the posture of the sample after it")

        scene = Scene("room")
        for s, before in zip(scene.samples[1:], copy.deepcopy(scene.samples)):
            s["joints"] = {j: q + 0.02 * (before["joints"][j] - q) for j, q in s["joints"].items()}
        self.one(scene.check(), "lag", ["joints"], r"by (2|2\.\d|1\.9\d*) % of the way from the posture of the sample before it")

    def test_a_sign_beside_bad_samples(self):
        scene = Scene("room").readings("j3", lambda q: -q)
        scene.samples[3]["joints"], scene.samples[8]["joints"], scene.samples[15]["joints"] = [scene.samples[k]["joints"] for k in (8, 15, 3)]
        found = scene.check()
        self.assertEqual({f["id"] for f in found}, {"joint-sign", "bad-samples"}, found)
        self.assertEqual([f["where"] for f in found if f["id"] == "joint-sign"], [["j3"]])


    def give(self, scene, order):
        """Sample i gets the readings of sample order[i]."""
        logged = [s["joints"] for s in scene.samples]
        for s, k in zip(scene.samples, order):
            s["joints"] = logged[k]
        return scene

    def test_shifted_where_pictures_were_lost(self):
        for name in helpers.some(("tool", "room"), 1):
            for by in (1, -1):
                with self.subTest(name, by=by):
                    scene = Scene(name)
                    n = len(scene.samples)
                    self.give(scene, [(i + by) % n for i in range(n)])
                    scene.samples = [s for i, s in enumerate(scene.samples) if i not in (0, n - 1, 4, 9, 10, 15)]
                    for i, s in enumerate(scene.samples):
                        s["id"] = "img_%s.png" % s["id"].split("_")[-1]
                    self.one(scene.check(), "shifted", [], "one of the two logs starts a sample too")

    def test_rows_in_another_order(self):
        for name in helpers.some(("room", "tool"), 1):
            n = len(Scene(name).samples)
            with self.subTest(name, order="reversed"):
                self.one(self.give(Scene(name), range(n)[::-1]).check(), "shifted", [], "one of the two is in reversed order")
            for first in (0, 1):
                texts = sorted(range(n), key=lambda k: str(k + first))
                with self.subTest(name, first=first):
                    self.one(self.give(Scene(name), texts).check(), "shifted", [], r"sorted by digits \(1, 10, 11, 2\).*Pair")
            with self.subTest(name, order="ids as texts"):  # pictures by their names, rows as they were recorded
                scene = Scene(name)
                logged = [s["joints"] for s in scene.samples]
                texts = sorted(range(n), key=lambda k: str(k + 1))
                scene.samples = [dict(scene.samples[k], id="img%d" % (k + 1), joints=logged[i]) for i, k in enumerate(texts)]
                self.one(scene.check(), "shifted", [], "sorted by digits")

    def test_changed_half_way(self):
        """A joint homed anew, a camera that was bumped, images of half the size: from which sample on. Which it was is not said; a little of it
        (chi2/dof below 5) is left to calibrate's `jump`."""
        for name, change in (("tool", lambda s: s["joints"].update(j2=s["joints"]["j2"] + 0.02)), ("room", None)):
            scene = Scene(name)
            first = scene.samples[11]
            for s in scene.samples[11:]:
                if change:
                    change(s)
                for v in s["views"] if not change else []:
                    v["pixels"] = [[(u + 0.5) / 2 - 0.5, (w + 0.5) / 2 - 0.5] for u, w in v["pixels"]]
            with self.subTest(name=name):
                found, = scene.check()
                self.assertEqual((found["id"], found["where"]), ("changed", [first["id"]]), found)
                self.assertIn("Calibrate the two parts separately", found["text"])
                random.Random(1).shuffle(scene.samples)  # nor is anything there where no order is
                self.assertNotIn("changed", [f["id"] for f in scene.check()])

    def test_one_stale_joint(self):
        for name, joint in (("room", "j3"), ("tool", "j2"), ("rail", "j5")):
            with self.subTest(name, joint=joint):
                scene = Scene(name)
                logged = [s["joints"][joint] for s in scene.samples]
                for s, old in zip(scene.samples[1:], logged):
                    s["joints"][joint] = old
                self.one(scene.check(), "shifted", [joint], "a sample too old")


class Measured(Case):
    """Mistakes in what a motion capture system or a tilting laser measures."""

    def test_clean(self):
        for name in ("mocap", "laser"):
            self.assertEqual(Scene(name).check(), [])

    def test_quaternions_in_another_order(self):
        for order, words in (([3, 0, 1, 2], "with w first"), ([1, 2, 3, 0], "with w last that were read with w first")):
            scene = Scene("mocap")
            for v in scene.views():
                v["pose"]["quat"] = [v["pose"]["quat"][k] for k in order]
            self.one(scene.check(), "quaternion", ["mocap"], words + r".*\"quat\": \[x, y, z, w\]")

    def test_poses_of_a_left_handed_frame(self):
        """As of Unity: they can be explained by a robot whose joints all turn the other way, which nobody means."""
        scene = Scene("mocap")
        for v in scene.views():
            xyz, q = v["pose"]["xyz"], v["pose"]["quat"]
            v["pose"] = {"xyz": [xyz[0], -xyz[1], xyz[2]], "quat": [-q[0], q[1], -q[2], q[3]]}
        self.assertEqual(scene.check()[0]["id"], "mirrored")

    def test_a_marker_from_behind(self):
        """Corners counter-clockwise: the marker lies on its face, and all else fits."""
        scene = Scene("room")
        rig = scene.rig.replace("chessboard, rows: 6, columns: 9, square: 0.025", "marker, dictionary: DICT_4X4_50, id: 3, size: 0.12")
        posed = scene.posed.replace("chessboard, rows: 6, columns: 9, square: 0.025", "marker, dictionary: DICT_4X4_50, id: 3, size: 0.12")
        scene.write(posed, [])
        subprocess.run([KINCAL, "simulate", "rig.yaml", "--samples", "24", "--seed", "1", "--out", "marker"], cwd=scene.dir, check=True, capture_output=True)
        scene.rig = rig
        for backwards in (False, True):
            with open(os.path.join(scene.dir, "marker", "samples.jsonl"), encoding="utf-8") as f:
                scene.samples = [json.loads(line) for line in f]
            for v in scene.views():
                if backwards:
                    v["pixels"] = [v["pixels"][k] for k in (0, 3, 2, 1)]
            _, result, error = scene.calibrate()
            self.assertEqual([f["id"] for f in result.get("findings", [])], ["mirrored"] if backwards else [], error)

    def test_ranges_in_other_units(self):
        for factor, unit in ((1000, "millimetres"), (100, "centimetres")):
            scene = Scene("laser")
            for v in scene.views():
                for ray in v.get("rays", []):
                    ray[2] *= factor
            self.one(scene.check(), "units", ["lidar"], "ranges of sensor 'lidar' are in " + unit, 6000)

    def test_numbers_of_a_ray_in_another_order(self):
        for order, words in (([2, 1, 0], "range, bearing, reading"), ([1, 2, 0], "bearing, range, reading"), ([0, 2, 1], "reading, range, bearing")):
            scene = Scene("laser")
            for v in scene.views():
                if "rays" in v:
                    v["rays"] = [[ray[k] for k in order] for ray in v["rays"]]
            with self.subTest(words):
                self.one(scene.check(), "convention", ["lidar"], "in the order " + words, 6000)


class Units(Case):
    def test_a_slide(self):
        for factor, name in ((1000, "millimetres"), (100, "centimetres"), (1 / 0.0254, "inches")):
            with self.subTest(name):
                self.one(Scene("rail").readings("rail", lambda q: factor * q).check(), "units", ["rail"], "readings of sliding joint 'rail' are " + name)
        _, result, error = Scene("rail").readings("rail", lambda q: 1000 * q).calibrate()  # before any fit
        self.assertIn("if these are millimetres", error + " ".join(w["text"] for w in result.get("warnings", [])) if result else error + "if these are millimetres")

    def test_a_length_of_the_robot(self):
        for name in ("room", "tool", "balls"):
            for wrong, unit in (("400", "millimetres"), ("40", "centimetres")):
                with self.subTest(name, unit=unit):
                    scene = Scene(name)
                    scene.urdf = scene.urdf.replace('xyz="0.4 0 0"', 'xyz="%s 0 0"' % wrong)
                    self.one(scene.check(), "units", ["j3"], r"given in %s in the URDF.*\(0\.4\)" % unit)

    def test_a_tracker(self):
        for name in ("tool", "balls"):
            for factor, unit in ((1000, "millimetres"), (1 / 0.0254, "inches")):
                with self.subTest(name, unit=unit):
                    scene = Scene(name)
                    for v in scene.views():
                        v["points"] = [[factor * x for x in p] for p in v["points"]]
                    self.one(scene.check(), "square", ["tracker"], "measures are in " + unit)

    def test_data_are_not_shrunk_to_please(self):
        """Measurements in a smaller unit have smaller residuals: no proof."""
        scene = Scene("balls")
        for s in scene.samples:
            q = s["joints"]
            q["j3"], q["j5"] = q["j5"], q["j3"]
        self.assertNotIn("square", [f["id"] for f in scene.check()])

    def test_a_baseline(self):
        for wrong, words in (("120", "Write metres"), ("0", "stand at one place"), ("-0.12", "the other way round")):
            with self.subTest(wrong):
                scene = Scene("stereo")
                found = [f for f in scene.check(scene.rig.replace("baseline: 0.12", "baseline: " + wrong)) if f["id"] == "baseline"]
                self.assertEqual(len(found), 1)
                self.assertEqual(found[0]["where"], ["cam2"] if wrong == "120" else ["cam2", "cam"])  # of a pair the right one first
                self.assertIn(words, found[0]["text"])

    def found_in_each_others_place(self, scene, rig, key, names, finding):
        """`names` exchanged in what is seen of two things with given poses that are free: nothing but where they came out shows it."""
        scene.write(rig, [])
        subprocess.run([KINCAL, "simulate", "rig.yaml", "--samples", "30", "--seed", "3", "--out", "two"], cwd=scene.dir, check=True, capture_output=True)
        with open(os.path.join(scene.dir, "two", "samples.jsonl"), encoding="utf-8") as f:
            samples = [json.loads(line) for line in f]
        for exchanged in (False, True):
            for v in [v for s in samples for v in s["views"] if exchanged]:
                v[key] = names[1 - names.index(v[key])]
            scene.write(rig, samples)
            done = subprocess.run([KINCAL, "calibrate", "rig.yaml", "samples.jsonl", "--out", "out", "--force"], cwd=scene.dir, capture_output=True, text=True)
            with open(os.path.join(scene.dir, "out", "result.json"), encoding="utf-8") as f:
                result = json.load(f)
            self.assertEqual([f["id"] for f in result.get("findings", [])], [finding] if exchanged else [], done.stdout)
            self.assertEqual(result["verdict"]["use"] == "doubts", exchanged, result["verdict"])

    def test_exchanged_cameras_whose_places_are_free(self):
        rig = (HEAD + BOARD.format(name="board", link="l6", more=HAND) + "sensors:\n" + CAMERA.format(name="cam", link="base", more=ROOM)
               + CAMERA.format(name="cam2", link="base", more=ROOM.replace("2.2, 0.1,", "2.2, 0.2,")))
        self.found_in_each_others_place(Scene("stereo"), rig, "sensor", ["cam", "cam2"], "swapped-cameras")

    def test_exchanged_targets_whose_places_are_free(self):
        boards = BOARD.format(name="board", link="l6", more=HAND) + BOARD.format(name="other", link="l6", more=HAND.replace("-0.1, -0.06", "0.2, -0.06"))
        rig = HEAD + boards + "sensors:\n" + CAMERA.format(name="cam", link="base", more=ROOM)
        self.found_in_each_others_place(Scene("room"), rig, "target", ["board", "other"], "exchanged-targets")

    def test_focal_lengths(self):
        scene = Scene("room")
        self.one(scene.check(scene.rig.replace("[1000, 1000,", "[1100, 1100,")), "intrinsics", ["cam"], r"in the rig, 1000|in the rig, 99\d|times 0\.909")

    def test_a_baseline_that_is_wrong_or_has_the_wrong_sign(self):
        scene = Scene("stereo")   # on a mount that both share; else they share the pose of the first
        scene.urdf = scene.urdf.replace('<link name="base"/>', '<link name="base"/>' + link("mount", "fixed", "base", "head", "0 0 0", ""), 1)
        scene.rig = scene.rig.replace("baseline: 0.12", "baseline: 0.132").replace("brown_conrady, link: base", "brown_conrady, link: head")
        _, result, _ = scene.calibrate()
        self.assertEqual([(f["id"], f["where"]) for f in result["findings"]], [("baseline", ["cam2"])])
        self.assertRegex(result["findings"][0]["text"], r"0\.132 m in the rig, 0\.(12|1199\d|1200\d) m from the data")
        for given, found in (("0.12", []), ("0.132", [("baseline", ["cam2"])])):
            scene = Scene("stereo")
            scene.rig = scene.rig.replace("baseline: 0.12", "baseline: " + given)
            _, result, _ = scene.calibrate()
            self.assertEqual([(f["id"], f["where"]) for f in result.get("findings", [])], found, result["verdict"])
        self.assertRegex(result["findings"][0]["text"], r"0\.132 m in the rig, 0\.(12|1199\d|1200\d) m from the data")   # a pair has one pose, which takes nothing up
        self.assertEqual(result["verdict"]["use"], "doubts")
        scene = Scene("stereo")
        for rig in (scene.rig, re.sub(", pose: {[^}]*}(?=, baseline|})", "", scene.rig)):
            scene.rig = rig.replace("baseline: 0.12", "baseline: -0.12")
            found = scene.check(scene.rig)
            self.assertEqual([(f["id"], f["where"]) for f in found], [("baseline", ["cam2", "cam"])], found)
            self.assertIn("positive", found[0]["text"])
            _, result, _ = scene.calibrate()   # poses of their own take it up
            self.assertEqual(result["verdict"]["use"], "doubts")
            self.assertIn(found[0]["what"], result["verdict"]["text"])


def touching(axes, ball, goal, rng):
    """Readings at which the ball in the hand is at `goal`: one joint after the other turns it there."""
    vector = lambda text: [float(v) for v in text.split()]
    q = [rng.uniform(-0.8, 0.8) for _ in axes]
    for _ in range(400):
        for k in reversed(range(len(axes))):
            frames = [frame([0, 0, 0], [0, 0, 0])]
            for (xyz, axis), angle in zip(axes, q):
                frames.append(mul(frames[-1], axis_angle(vector(axis), angle, vector(xyz))))
            at, centre, tip = move(frames[-1], ball), move(frames[k + 1], (0, 0, 0)), move(frames[k + 1], vector(axes[k][1]))
            a = [x - y for x, y in zip(tip, centre)]
            u, w = ([x - y - h * z for x, y, z in zip(p, centre, a)]
                    for p in (at, goal) for h in [sum((x - y) * z for x, y, z in zip(p, centre, a))])
            cross = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]]
            q[k] += math.atan2(sum(x * y for x, y in zip(a, cross)), sum(x * y for x, y in zip(u, w)))
        if math.dist(at, goal) < 1e-5:
            return q
    return None


class Points(Case):
    def test_sockets_in_millimetres(self):
        """A ball in the hand touches sockets. Of an arm that is not as drawn more than noise is left with metres: then a ball where the first axes
        meet, which never moves, and sockets of no size would explain all."""
        axes = [AXES[0], ("0 0 0.1", "0 1 0")] + AXES[2:]
        drawn = axes[:3] + [("0.3 0 0.058", axes[3][1])] + axes[4:]
        rng, ball, samples = random.Random(2), [0.05, 0.02, 0.1], []
        sockets = {"s%d" % k: [0.45 + 0.1 * (k % 2), -0.15 + 0.3 * (k // 2), 0.25] for k in range(4)}
        for name, at in sockets.items():
            for i in range(16):
                q = touching(axes, ball, [at[0] + 0.05 * (i % 2)] + at[1:], rng)
                if q:
                    joints = {"j%d" % k: math.remainder(a, 2 * math.pi) + rng.gauss(0, 1e-4) for k, a in enumerate(q, 1)}
                    samples.append({"id": "%s_%d" % (name, i), "joints": joints, "views": [{"sensor": "ball", "target": name, "ids": [i % 2], "points": [[0, 0, 0]]}]})
        rig = (HEAD.replace('joints:\n  "*": {sigma: 0.0002}\n', "")
               + "".join("  %s: {type: points, points: [[0, 0, 0], [50, 0, 0]], mount: {link: base, pose: {xyz: [%g, %g, %g]}}}\n" % (n, *p) for n, p in sockets.items())
               + "sensors:\n  ball: {type: point, link: l6, pose: {xyz: %s}, sigma: 0.0003}\n" % ball)
        scene = Scene("tool")
        scene.urdf, scene.samples = robot(arm(drawn)), samples
        found = scene.check(rig)
        self.assertEqual([f["id"] for f in found], ["square"], found)
        self.assertEqual(set(found[0]["where"]), set(sockets))

    def test_a_ball_in_sockets(self):
        """Its readings are zeros, or their noise: no scale is read from them, its turn is held, and mistakes have the names that they have elsewhere (at
        an inner link all sockets could be one point)."""
        rng, ball, samples = random.Random(3), [0.05, 0.02, 0.1], []
        for k in range(4):
            at = [0.45 + 0.1 * (k % 2), -0.15 + 0.3 * (k // 2), 0.25 + 0.05 * k]
            for i in range(14):
                q = touching(AXES, ball, at, rng)
                if q:
                    joints = {"j%d" % j: math.remainder(a, 2 * math.pi) + rng.gauss(0, 2e-4) for j, a in enumerate(q, 1)}
                    samples.append({"id": "s%d_%d" % (k, i), "joints": joints, "views": [{"sensor": "ball", "target": "s%d" % k, "points": [[0, 0, 0]]}]})
        scene = Scene("tool")
        scene.urdf = robot(arm())
        scene.rig = (HEAD + "".join("  s%d: {type: points, points: [[0, 0, 0]], mount: {link: base}}\n" % k for k in range(4))
                     + "sensors:\n  ball: {type: point, link: l6, pose: {xyz: %s}, sigma: 0.0001}\n" % ball)
        for noise in (0, 1e-4):
            with self.subTest(noise=noise):
                scene.samples = copy.deepcopy(samples)
                for v in scene.views():
                    v["points"] = [[rng.gauss(0, noise) for _ in range(3)]]
                code, result, said = scene.calibrate()
                self.assertEqual((code, result["verdict"]["use"]), (0, "good"), result.get("verdict", said))
                self.assertNotIn("arm_scale", [w["id"] for w in result["warnings"]])
                self.assertEqual(result["parameters"]["sensor/ball/pose"]["sigma"][3:], [0, 0, 0])
        scene.samples = copy.deepcopy(samples)
        found = scene.readings("j3", lambda q: -q).check()
        self.assertEqual((found[0]["id"], found[0]["where"]), ("joint-sign", ["j3"]), found)

    def test_order_of_reflectors(self):
        for order in ((3, 2, 1, 0), (0, 2, 1, 3), (2, 0, 3, 1)):
            with self.subTest(order=order):
                scene = Scene("tool")
                for v in scene.views():
                    v["points"] = [v["points"][k] for k in order]
                self.one(scene.check(), "numbering", ["tool", "tracker"], "rig's points %s" % ", ".join(map(str, order)))

    def test_a_wrong_point_is_no_wrong_reading(self):
        scene = Scene("balls")
        for k in (3, 7, 15):
            scene.samples[k]["views"][0]["points"][0][0] += 0.05
        self.one(scene.check(), "outlier-points", [scene.samples[k]["id"] for k in (3, 7, 15)], r"Remove these points from the samples.*\(--reject\)")
        for s in scene.samples:
            s["views"] = s["views"][:1]
        self.one(scene.check(scene.rig), "bad-samples", [scene.samples[k]["id"] for k in (3, 7, 15)], "the measured point is wrong, or")

    def test_column_by_column(self):
        for flip_row, flip_column in ((0, 0), (1, 0), (0, 1), (1, 1)):
            with self.subTest(flip_row=flip_row, flip_column=flip_column):
                scene = Scene("room")
                for v in scene.views():
                    v["ids"] = [(8 - i % 9 if flip_column else i % 9) * 6 + (5 - i // 9 if flip_row else i // 9) for i in v.get("ids") or range(54)]
                found = scene.check(scene.posed + 'estimate:\n  - {step: offsets, free: ["joint/*/offset"]}\n')
                self.one(found, "numbering" if flip_row or flip_column else "rows-columns", ["board"], "numbered column by column")

    def test_quaternion(self):
        for held, where in (("sensor", "cam"), ("target", "board")):
            scene = Scene("room")
            pose = ROOM if held == "sensor" else HAND
            roll, pitch, yaw = [float(x) / 2 for x in re.search(r"rpy: \[(.*)\]", pose)[1].split(",")]
            c, s = math.cos, math.sin
            w = c(roll) * c(pitch) * c(yaw) + s(roll) * s(pitch) * s(yaw)
            x = s(roll) * c(pitch) * c(yaw) - c(roll) * s(pitch) * s(yaw)
            y = c(roll) * s(pitch) * c(yaw) + s(roll) * c(pitch) * s(yaw)
            z = c(roll) * c(pitch) * s(yaw) - s(roll) * s(pitch) * c(yaw)
            rig = scene.posed.replace(pose, re.sub(r"rpy: \[.*\]", "quat: [%.9f, %.9f, %.9f, %.9f]" % (w, x, y, z), pose))
            found = scene.check(rig + 'estimate:\n  - {step: offsets, free: ["joint/*/offset"]}\n')
            self.one(found, "quaternion", [where], r"quat as \[x, y, z, w\]")


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    with tempfile.TemporaryDirectory() as FOLDER:
        unittest.main(argv=[sys.argv[0]] + sys.argv[3:], verbosity=1, exit=False).result.wasSuccessful() or sys.exit(1)
