"""The robot itself in the formats of other programs: python3 robot_formats_test.py SOURCE_DIR KINCAL [TEST ...]

Proves: xacro properties, ros2_control's transmissions and the kinematics of Universal Robots mean the calibrated robot.urdf, by formulas
written here after these programs' documentation, to 1e-12; so do tables of Denavit and Hartenberg, standard and modified, with the poses that
they state before and behind them, and where axes are nearly parallel as well as they say; what `init` makes of a table or of such
kinematics is that robot; LeRobot's homing offsets move readings by the estimated offsets, and everything else in the file stays. Not
proved: that these programs take the files.
"""
import json
import math
import os
import re
import subprocess
import sys
import unittest
from xml.etree import ElementTree

import numpy as np
import yaml

import helpers
from mjcf_test import Urdf, X, Y, Z, rigid, rig_text, turn, urdf_text

SOURCE_DIR = KINCAL = None
HALF_PI = "1.5707963267948966"

# Shoulder, upper arm and forearm have parallel axes.
UR = urdf_text(["base_link", "shoulder_link", "upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link", "tool0"], [
    ("shoulder_pan_joint", "revolute", "base_link", "shoulder_link", "0 0 0.1625", "0 0 0", "0 0 1"),
    ("shoulder_lift_joint", "revolute", "shoulder_link", "upper_arm_link", "0 0 0", HALF_PI + " 0 0", "0 0 1"),
    ("elbow_joint", "revolute", "upper_arm_link", "forearm_link", "-0.425 0 0", "0 0 0", "0 0 1"),
    ("wrist_1_joint", "revolute", "forearm_link", "wrist_1_link", "-0.3922 0 0.1333", "0 0 0", "0 0 1"),
    ("wrist_2_joint", "revolute", "wrist_1_link", "wrist_2_link", "0 -0.0997 0", HALF_PI + " 0 0", "0 0 1"),
    ("wrist_3_joint", "revolute", "wrist_2_link", "wrist_3_link", "0 0.0996 0", "-" + HALF_PI + " 0 0", "0 0 1"),
    ("tool", "fixed", "wrist_3_link", "tool0", "0 0 0.02", "0 0 0.3", "")])

# No two consecutive axes are parallel; the second joint slides.
SKEW = urdf_text(["base", "a", "b", "c", "d", "tip"], [
    ("j1", "revolute", "base", "a", "0.1 0.2 0.3", "0.1 0.2 0.3", "0 0 1"),
    ("j2", "prismatic", "a", "b", "0.1 -0.1 0.2", "0.3 0.8 0", "1 0.2 0"),
    ("j3", "continuous", "b", "c", "0 0.3 0.1", "-0.5 0 0.4", "0 -1 0"),
    ("between", "fixed", "c", "d", "0.02 0.3 0.1", "-0.5 1 0.4", ""),
    ("j4", "revolute", "d", "tip", "0.05 0 0.1", "0.7 0.6 0", "0 1 1")])


def rotations(z=0.0, x=0.0):
    return rigid(turn(Z, z)), rigid(turn(X, x))


def table_of(text):
    """Rows of a table, and the poses that are said before and behind it."""
    poses = {}
    for what in ("before the first row", "behind the last row"):
        match = re.search("# %s: xyz (.*?), rpy (.*?) \\(" % what, text)
        r, p, y = [float(v) for v in match.group(2).split()] if match else (0, 0, 0)
        poses[what] = rigid(turn(Z, y) @ turn(Y, p) @ turn(X, r), [float(v) for v in match.group(1).split()] if match else (0, 0, 0))
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    assert lines[0] == "joint,a,alpha,d,theta_offset,type", lines[0]
    return [line.split(",") for line in lines[1:]], poses["before the first row"], poses["behind the last row"]


def dh(text, modified, q):
    rows, t, behind = table_of(text)
    for joint, a, alpha, d, theta, kind in rows:
        slides = kind == "prismatic"
        rz, rx = rotations(float(theta) + (0 if slides else q[joint]), float(alpha))
        tz, tx = rigid(xyz=(0, 0, float(d) + (q[joint] if slides else 0))), rigid(xyz=(float(a), 0, 0))
        t = t @ (rx @ tx @ rz @ tz if modified else rz @ tz @ tx @ rx)
    return t @ behind


class Case(helpers.Folder):
    def run_kincal(self, *arguments):
        return subprocess.run([KINCAL, *arguments], cwd=self.dir, capture_output=True, text=True, timeout=120)

    def good(self, *arguments):
        run = self.run_kincal(*arguments)
        self.assertEqual(run.returncode, 0, run.stderr)
        return run

    def fails(self, arguments, *words):
        run = self.run_kincal(*arguments)
        self.assertEqual((run.returncode, run.stdout), (1, ""))
        for word in words:
            self.assertIn(word, run.stderr)
        self.assertEqual(run.stderr.count("\n"), 1, run.stderr)

    def calibrated(self, urdf, tips, base, free='["joint/*/offset", "joint/*/origin"]'):
        self.write("robot.urdf", urdf)
        rig = rig_text(tips, base).replace('["joint/*/offset", "joint/*/origin"]', free)
        if "origin" not in free:
            rig = rig.replace(', "joint/*/origin": {translation: 0.005, rotation: 0.01}', "")
        self.write("rig.yaml", rig)
        spread = ["--spread=%s=%s" % (one, "0.004" if one.endswith("origin") else "0.02") for one in json.loads(free)]
        self.good("simulate", "rig.yaml", "--samples", "12", "--seed", "3", *spread, "--out", "sim", "--force")
        self.good("calibrate", "rig.yaml", "sim/samples.jsonl", "--out", "result", "--quiet", "--no-report", "--force")
        return Urdf(self.read("result", "robot.urdf"))

    def postures(self, urdf, count=20):
        rng = np.random.default_rng(7)
        for _ in range(count):
            yield urdf.positions({j["name"]: rng.uniform(-0.1, 0.4) if j["type"] == "prismatic" else rng.uniform(-1.5, 1.5) for j in urdf.moving()})


class Ros(Case):
    def test_xacro_properties(self):
        after = self.calibrated(UR, ["tool0"], "base_link")
        text = self.good("export", "result", "--as", "xacro_properties").stdout
        found = dict(re.findall('<xacro:property name="(.*?)" value="(.*?)"/>', text))
        self.assertEqual(len(found), 2 * len(after.joints))
        for joint in after.joints.values():
            r, p, y = [float(v) for v in found[joint["name"] + "_rpy"].split()]
            t = rigid(turn(Z, y) @ turn(Y, p) @ turn(X, r), [float(v) for v in found[joint["name"] + "_xyz"].split()])
            np.testing.assert_allclose(t, joint["origin"], atol=1e-12)
        self.calibrated(UR, ["tool0"], "base_link", '["joint/elbow_joint/offset"]')  # of the others there is nothing to say
        text = self.good("export", "result", "--as", "xacro_properties").stdout
        self.assertEqual(re.findall('name="(.*?)"', text), ["elbow_joint_xyz", "elbow_joint_rpy"])

    def transmissions(self, text):
        root = ElementTree.fromstring("<robot>%s</robot>" % text)
        out = {}
        for t in root.findall("transmission"):
            self.assertEqual((t.find("plugin").text, t.find("actuator").get("role"), t.find("joint").get("role")), ("transmission_interface/SimpleTransmission", "actuator1", "joint1"))
            out[t.find("joint").get("name")] = (float(t.find("joint/mechanical_reduction").text), float(t.find("joint/offset").text))
        return out

    def test_ros2_control(self):
        """Its positions, with the origins that the text names, are those of robot.urdf."""
        after = self.calibrated(UR, ["tool0"], "base_link")
        text = self.good("export", "result", "--as", "ros2_control").stdout
        self.assertNotIn("rising", text)
        apart = Urdf(self.read("result", "robot.urdf"))
        by_name = {j["name"]: j for j in apart.joints.values()}
        for name, xyz, rpy in re.findall('(\\w+): <origin xyz="(.*?)" rpy="(.*?)"/>', text):
            r, p, y = [float(v) for v in rpy.split()]
            by_name[name]["origin"] = rigid(turn(Z, y) @ turn(Y, p) @ turn(X, r), [float(v) for v in xyz.split()])
        found = self.transmissions(text)
        self.assertEqual(len(found), 6)
        for q in self.postures(after):
            positions = {name: q[name] / found[name][0] + found[name][1] for name in found}
            np.testing.assert_allclose(apart.pose("tool0", positions), after.pose("tool0", q), atol=1e-12)

    def test_scales(self):
        self.write("robot.urdf", UR)
        self.write("rig.yaml", rig_text(["tool0"], "base_link").replace("targets:", "joints:\n  elbow_joint: {offset: 0.1, scale: 0.5}\ntargets:", 1))
        found = self.transmissions(self.good("export", "rig.yaml", "--as", "ros2_control").stdout)
        self.assertEqual(found, {"elbow_joint": (2, 0.1)})  # position = 0.5 reading + 0.1
        self.write("rig.yaml", rig_text(["tool0"], "base_link"))
        self.fails(["export", "rig.yaml", "--as", "ros2_control"], "no joint has an offset")
        self.fails(["export", "rig.yaml", "--as", "ros2_control", "--tip", "tool0"], "--tip", "dh, modified_dh")
        self.fails(["export", "rig.yaml", "--as", "ros2_control", "--sensor", "tracker"], "--sensor")


class Ur(Case):
    PARTS = {"shoulder": "shoulder_pan_joint", "upper_arm": "shoulder_lift_joint", "forearm": "elbow_joint", "wrist_1": "wrist_1_joint", "wrist_2": "wrist_2_joint", "wrist_3": "wrist_3_joint"}

    def origin(self, part):
        return rigid(turn(Z, part["yaw"]) @ turn(Y, part["pitch"]) @ turn(X, part["roll"]), [part[k] for k in "xyz"])

    def test_out_and_in(self):
        after = self.calibrated(UR, ["tool0"], "base_link")
        run = self.good("export", "result", "--as", "ur_kinematics", "--out", "mine.yaml")
        self.assertIn("--from FILE", run.stderr)
        data = yaml.safe_load(self.read("mine.yaml"))["kinematics"]
        self.assertEqual(list(data), [*self.PARTS, "hash"])
        joints = {j["name"]: j for j in after.joints.values()}
        for part, joint in self.PARTS.items():
            self.assertTrue(all(isinstance(v, float) for v in data[part].values()), data[part])
            np.testing.assert_allclose(self.origin(data[part]), joints[joint]["origin"], atol=1e-12)
        # the robot's own file, as ur_calibration writes it, and back into the nominal URDF
        self.write("robot.yaml", "kinematics:\n" + "".join("  %s:\n%s" % (part, "".join("    %s: %s\n" % (k, v) for k, v in data[part].items())) for part in self.PARTS) + "  hash: calib_1234567890\n")
        run = self.good("export", "result", "--as", "ur_kinematics", "--from", "robot.yaml")
        self.assertEqual((yaml.safe_load(run.stdout)["kinematics"]["hash"], run.stderr), ("calib_1234567890", ""))
        os.mkdir(self.path("new"))
        self.good("init", "robot.urdf", "--kinematics", "robot.yaml", "--sensor", "point:base_link:tracker", "--target", "points:0,0,0@tool0:ball", "--out", "new/rig.yaml")
        self.assertEqual(yaml.safe_load(self.read("new", "rig.yaml"))["robot"], "robot_kinematics.urdf")
        made = Urdf(self.read("new", "robot_kinematics.urdf"))
        for q in self.postures(after):
            np.testing.assert_allclose(made.pose("wrist_3_link", q), after.pose("wrist_3_link", q), atol=1e-12)
        self.assertEqual(re.sub('(xyz|rpy)="[^"]*"', "", self.read("new", "robot_kinematics.urdf")), re.sub('(xyz|rpy)="[^"]*"', "", UR))

    def test_prefix(self):
        two = urdf_text(["world"], []).replace("</robot>", "") + "".join(
            re.sub(r'(link|name|joint)="(?!robot|world)', r'\1="%s_' % side, UR.replace('<robot name="robot">', "").replace("</robot>", ""))
            + '<joint name="%s_mount" type="fixed"><parent link="world"/><child link="%s_base_link"/></joint>' % (side, side) for side in ("left", "right")) + "</robot>"
        self.write("robot.urdf", two)
        self.write("rig.yaml", rig_text(["left_tool0"], "world"))
        self.fails(["export", "rig.yaml", "--as", "ur_kinematics"], "--prefix", "left_, right_")
        data = yaml.safe_load(self.good("export", "rig.yaml", "--as", "ur_kinematics", "--prefix", "left_").stdout)["kinematics"]
        self.assertEqual(data["forearm"]["x"], -0.425)
        self.fails(["export", "rig.yaml", "--as", "ur_kinematics", "--prefix", "lft_"], "lft_shoulder_pan_joint", "nearest: left_shoulder_pan_joint")

    def test_wrong(self):
        self.write("robot.urdf", UR)
        init = ["init", "robot.urdf", "--kinematics", "k.yaml", "--sensor", "point:base_link:tracker", "--target", "points:0,0,0@tool0:ball"]
        self.write("k.yaml", "kinematics:\n  shoulder: {x: 0, y: 0, z: 0, roll: 0, pitch: 0}\n")
        self.fails(init, "k.yaml:1: kinematics", "upper_arm")
        self.write("k.yaml", "kinematic: {}\n")
        self.fails(init, "k.yaml", "'kinematics' is missing")
        self.write("k.yaml", "kinematics: {%s}\n" % ", ".join("%s: {x: 0, y: 0, z: 0, roll: 0, pitch: 0, yaw: 0}" % part for part in self.PARTS))
        self.fails(init, "--out is required")
        self.fails(["init", "--flange", "tool0", "--kinematics", "k.yaml"], "--kinematics", "URDF")
        self.fails(["init", "robot.urdf", "--prefix", "a"], "--prefix", "--kinematics")
        self.good(*init, "--out", "r.yaml")
        self.fails([*init, "--out", "other.yaml"], "robot_kinematics.urdf", "--force")
        self.write("robot.urdf", SKEW)
        self.fails(init, "shoulder_pan_joint")


class Dh(Case):
    def export(self, kind, tip, path="rig.yaml"):
        return self.good("export", path, "--as", kind, "--tip", tip).stdout

    def check(self, text, modified, urdf, base, tip, tolerance=1e-12):
        for q in self.postures(urdf):
            shall = np.linalg.inv(urdf.pose(base, q)) @ urdf.pose(tip, q)
            np.testing.assert_allclose(dh(text, modified, q), shall, atol=tolerance)

    def test_exact(self):
        for urdf, base, tip in ((SKEW, "base", "tip"), (UR, "base_link", "tool0")):
            self.write("robot.urdf", urdf)
            self.write("rig.yaml", rig_text([tip], base))
            for kind in ("dh", "modified_dh"):
                with self.subTest(kind=kind, tip=tip):
                    text = self.export(kind, tip)
                    self.assertIn("# not expressed: nothing else", text)
                    self.check(text, kind == "modified_dh", Urdf(urdf), base, tip)

    def test_the_usual_numbers(self):
        """A robot as it is drawn has the table that its maker prints."""
        self.write("robot.urdf", UR.replace('rpy="0 0 0.3"', 'rpy="0 0 0"'))
        self.write("rig.yaml", rig_text(["tool0"], "base_link"))
        text = self.export("dh", "tool0")
        self.assertNotIn("before the first row", text)
        self.assertNotIn("behind the last row", text)
        rows = [[float(v) for v in row[1:5]] for row in table_of(text)[0]]
        np.testing.assert_allclose([abs(row[0]) for row in rows], [0, 0.425, 0.3922, 0, 0, 0], atol=1e-9)
        np.testing.assert_allclose([abs(math.cos(row[1])) for row in rows], [0, 1, 1, 0, 0, 1], atol=1e-9)
        np.testing.assert_allclose([abs(row[2]) for row in (rows[0], rows[4], rows[5])], [0.1625, 0.0997, 0.1196], atol=1e-9)

    def test_calibrated(self):
        """Parallel axes of a calibrated robot are not quite parallel: the table says how far off it is."""
        after = self.calibrated(UR, ["tool0"], "base_link")
        for kind in ("dh", "modified_dh"):
            text = self.export(kind, "tool0", "result")
            rows = table_of(text)[0]
            self.assertTrue(all(abs(float(v)) < 2 for row in rows for v in (row[1], row[3])), text)  # no perpendicular far away
            mm, mrad = [float(v) for v in re.search("up to ([0-9.]+) mm and ([0-9.]+) mrad", text).groups()]
            off = []
            for q in self.postures(after, 100):
                t = np.linalg.inv(dh(text, kind == "modified_dh", q)) @ after.pose("tool0", q)
                off.append((1e3 * np.linalg.norm(t[:3, 3]), 1e3 * math.acos(min(1, (np.trace(t[:3, :3]) - 1) / 2))))
            worst = np.max(off, axis=0)
            self.assertTrue(0.6 < worst[0] / mm < 1.6 and 0.6 < worst[1] / mrad < 1.6, (worst, mm, mrad))
            self.assertLess(mrad, 60)

    def test_in(self):
        """A table becomes a URDF beside the rig, and comes out again as it was."""
        self.write("table.csv", "# of its maker\njoint,a,alpha,d,theta_offset,type\nwaist,0.1,%s,0.3,0.2,revolute\nlift,0,1.2,0.1,-0.3,prismatic\nbend,0.25,-0.7,0.05,0,revolute\n" % HALF_PI)
        q = {"waist": 0.3, "lift": 0.12, "bend": -0.8}
        for option, kind in (("--dh", "dh"), ("--modified-dh", "modified_dh")):
            folder = kind
            os.mkdir(self.path(folder))
            self.good("init", option, "table.csv", "--sensor", "point:base:tracker", "--target", "points:0,0,0@tip:ball", "--out", folder + "/rig.yaml")
            self.assertEqual(yaml.safe_load(self.read(folder, "rig.yaml"))["robot"], "table.urdf")
            urdf = Urdf(self.read(folder, "table.urdf"))
            shall = dh(self.read("table.csv").split("\n", 1)[1], kind == "modified_dh", q)
            np.testing.assert_allclose(urdf.pose("tip", q), shall, atol=1e-12)
            text = self.export(kind, "tip", folder + "/rig.yaml")
            self.check(text, kind == "modified_dh", urdf, "base", "tip")
        self.assertIn("tip", self.good("init", "--dh", "table.csv").stdout)
        self.write("short.csv", "alpha;a;d;theta_offset\n0;0.1;0;0\n")
        self.good("init", "--dh", "short.csv", "--sensor", "point:base:tracker", "--target", "points:0,0,0@tip:ball", "--out", "short.yaml")
        self.assertIn("joint_1", self.read("short.urdf"))

    def test_wrong(self):
        self.write("robot.urdf", UR)
        self.write("rig.yaml", rig_text(["tool0"], "base_link"))
        self.fails(["export", "rig.yaml", "--as", "dh"], "--tip is missing", "tool0")
        self.fails(["export", "rig.yaml", "--as", "dh", "--tip", "tool"], "--tip", "nearest: tool0")
        self.fails(["export", "rig.yaml", "--as", "dh", "--tip", "base_link"], "no joint moves it")
        for text, words in (("1,2,3,4\n", ("t.csv:1", "a, alpha, d and theta_offset")), ("a,alpha,d,theta_offset\n1,2,3\n", ("t.csv:2", "3 cells")),
                            ("a,alpha,d,theta_offset\n0,90,0,0\n", ("t.csv:2: alpha", "rad")), ("a,alpha,d,theta_offset\n0,x,0,0\n", ("t.csv:2: alpha", "'x'")),
                            ("a,alpha,d,theta_offset,type\n0,0,0,0,hinge\n", ("t.csv:2: type", "prismatic")), ("a,alpha,d,theta_offset\n", ("no row",)),
                            ("joint,a,alpha,d,theta_offset\nj,0,0,0,0\nj,0,0,0,0\n", ("'j'", "taken"))):
            self.write("t.csv", text)
            self.fails(["init", "--dh", "t.csv", "--out", "x.yaml", "--sensor", "point:base:tracker", "--target", "points:0,0,0@tip:ball"], *words)
        self.fails(["init", "robot.urdf", "--dh", "t.csv"], "one robot")


class LeRobot(Case):
    MOTORS = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "gripper"]

    def degrees(self, motor, actual, sign):
        """Of norm mode DEGREES: the motor gives what it reads without its homing offset."""
        present = actual - sign * motor["homing_offset"]
        return (present - (motor["range_min"] + motor["range_max"]) / 2) * 360 / 4095

    def test_offsets(self):
        self.calibrated(UR, ["tool0"], "base_link", '["joint/*/offset"]')
        result = json.loads(self.read("result", "result.json"))["parameters"]
        # As LeRobot writes it, and by hand
        self.write("arm.json", json.dumps({name: {"id": i + 1, "drive_mode": 0, "homing_offset": 100 * i - 200, "range_min": 800 + i, "range_max": 3200} for i, name in enumerate(self.MOTORS)}, indent=4))
        for motors, sign in (("feetech", 1), ("dynamixel", -1)):
            run = self.good("export", "result", "--as", "lerobot", "--from", "arm.json", "--motors", motors)
            before, after = json.loads(self.read("arm.json")), json.loads(run.stdout)
            self.assertEqual(re.sub('"homing_offset": -?[0-9]+', "", run.stdout), re.sub('"homing_offset": -?[0-9]+', "", self.read("arm.json")))
            self.assertEqual(after["gripper"], before["gripper"])
            self.assertIn("gripper", run.stderr)
            self.assertIn("'wrist_2_joint' has no motor", run.stderr)
            for name in self.MOTORS[:4]:
                moved = self.degrees(after[name], 2000, sign) - self.degrees(before[name], 2000, sign)
                offset = result["joint/%s/offset" % name]["value"]
                offset = math.degrees(offset[0] if isinstance(offset, list) else offset)
                self.assertLess(abs(moved - offset), 180 / 4096 + 0.001 * abs(offset))
        self.write("lines.json", self.read("arm.json").replace('"homing_offset": ', '"homing_offset":\n   ').replace("-200", "-2e2"))  # another writer's
        self.assertEqual(json.loads(self.good("export", "result", "--as", "lerobot", "--from", "lines.json", "--motors", motors).stdout), after)
        self.write("arm.json", self.read("arm.json").replace('"drive_mode": 0', '"drive_mode": 1'))
        turned = json.loads(self.good("export", "result", "--as", "lerobot", "--from", "arm.json").stdout)
        self.assertEqual(turned, {name: {**motor, "drive_mode": 1} for name, motor in after.items()})  # as dynamixel, the other way

    def test_wrong(self):
        self.write("robot.urdf", UR)
        self.write("rig.yaml", rig_text(["tool0"], "base_link").replace("targets:", "joints:\n  elbow_joint: {offset: 1.5, scale: 1.01}\ntargets:", 1))
        base = ["export", "rig.yaml", "--as", "lerobot"]
        self.fails(base, "--from is missing")
        self.write("a.json", '{"x": {"id": 1, "drive_mode": 0, "homing_offset": 5, "range_min": 0, "range_max": 4095}}')
        self.fails([*base, "--from", "a.json"], "a.json", "no motor", "x")
        self.fails([*base, "--from", "a.json", "--motors", "other"], "--motors", "dynamixel")
        self.write("a.json", '{"elbow_joint": {"id": 1, "drive_mode": 0, "homing_offset": -1500, "range_min": 0, "range_max": 4095}}')
        self.fails([*base, "--from", "a.json"], "elbow_joint.homing_offset", "-2478")
        self.write("a.json", '{"elbow_joint": {"id": 1, "drive_mode": 0, "homing_offset": 1.5, "range_min": 0, "range_max": 4095}}')
        self.fails([*base, "--from", "a.json"], "elbow_joint.homing_offset")
        self.write("a.json", '{"elbow_joint": {"id": 1, "drive_mode": 0, "homing_offset": 0, "range_min": 0, "range_max": 4095}}')
        self.assertIn("its scale (1.01)", self.good(*base, "--from", "a.json").stderr)


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:], verbosity=2)
