"""The built program as a user meets it: python3 cli_test.py SOURCE_DIR KINCAL [TEST ...]

Makes its own small robot, rig and samples in a temporary directory (Python's standard library only, forward kinematics
written here) and proves: every kind of wrong input gives one error that names file, line, field and what is valid, with exit
code 1 and nothing written; what is written is written whole or not at all; exit codes; what each option does; the content of
every result file against the formats; that results lead back to themselves (second calibration, evaluate, apply); that
locale, directory and threads change nothing. It does not prove estimates against references (data_test.py, reference_test.py).
"""

import csv
import json
import math
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

SOURCE_DIR = KINCAL = None
FILES = ["changes.yaml", "covariance.csv", "information.csv", "loops.csv", "report.html", "residuals.csv", "result.json", "rig.yaml", "robot.urdf", "samples.csv"]

# ----------------------------------------------------------------------------- a robot, its kinematics, measurements

URDF = """<?xml version="1.0"?>
<!-- a small robot for tests: turntable, oblique lift, slide, tool -->
<robot name="tiny">
  <link name="base_link"/>
  <link name="turret"/>
  <link name="upper"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <link name="carriage"/>
  <link name="tool"/>
  <link name="finger"/>   <!-- follows the slide -->
  <link name="cart"/>

  <joint name="turn" type="continuous">
    <parent link="base_link"/>
    <child link="turret"/>
    <origin xyz="0 0 0.4" rpy="0 0 0"/>
    <axis xyz="0 0 1"/>
  </joint>

  <joint name="lift" type="revolute">
    <parent link="turret"/>
    <child link="upper"/>
    <origin rpy="-1.5707963 0.2 0.1"   xyz="0.1   0
      0.2"/>
    <axis xyz="0 0 -2"/>
    <limit lower="-1.2" upper="1.2" effort="10" velocity="1"/>
    <calibration rising="0.1"/>
  </joint>
  <joint name='slide' type='prismatic'>
    <parent link='upper'/>
    <child link='carriage'/>
    <origin xyz='0.3 0 0'/>
    <axis xyz='1 0 0'/>
    <limit lower='0' upper='0.4' effort='10' velocity='1'/>
  </joint>
  <joint name="tool_joint" type="fixed">
    <parent link="carriage"/>
    <child link="tool"/>
    <origin xyz="0.1 0.02 0" rpy="0 1.5707963267948966 0"/>
  </joint>
  <joint name="follower" type="prismatic">
    <parent link="tool"/>
    <child link="finger"/>
    <origin xyz="0 0 0.05" rpy="0.3 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="10" velocity="1"/>
    <mimic joint="slide" multiplier="-0.5" offset="0.01"/>
  </joint>
  <joint name="caster" type="floating">
    <parent link="base_link"/>
    <child link="cart"/>
  </joint>

  <transmission name="turn_trans">
    <type>transmission_interface/SimpleTransmission</type>
    <joint name="turn"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>
    <actuator name="turn_motor"><mechanicalReduction>-120.5</mechanicalReduction></actuator>
  </transmission>
  <gazebo reference="tool"><material>Gazebo/Grey</material></gazebo>
</robot>
"""

RIG = """format: kincal/1
robot: robot.urdf
base: base_link

joints:
  "*": {sigma: 0.0005}
  slide: {sigma: 0.0002}

targets:
  reflectors:
    type: points
    points: [[0, 0, 0], [0.1, 0, 0], [0, 0.08, 0.03]]
    mount: {link: tool}
  plate:
    type: points
    points: [[0, 0, 0]]
    mount: {link: tool, pose: {xyz: [0.02, 0, 0.05], rpy: [0, 0.1, 0]}}
  board:
    type: chessboard
    rows: 3
    columns: 4
    square: 0.05
    mount: free

sensors:
  tracker:
    type: point
    link: base_link
    pose: {xyz: [0.5, -2.0, 0.3], rpy: [0, 0, 1.2]}
    sigma: 0.0002
  mocap:
    type: pose
    link: base_link
    pose: {xyz: [0, 2.0, 1.0], rpy: [0.1, 0, -1.0]}
    sigma: {translation: 0.0005, rotation: 0.001}
  eye:
    type: camera
    link: base_link
    pose: {xyz: [0.1, 0, 0.9], rpy: [-1.5707963, 0, -1.5707963]}
    model: pinhole
    image_size: [640, 480]
    intrinsics: [500, 500, 320, 240]
    sigma: 0.2

estimate:
  - step: eyes
    sensors: [tracker, eye]
    free: [sensor/tracker/pose, sensor/eye/pose]
  - step: all
    free: [sensor/tracker/pose, sensor/eye/pose, sensor/mocap/pose, target/plate/pose, joint/turn/scale, joint/lift/offset,
           joint/slide/offset, joint/tool_joint/origin.x, joint/tool_joint/origin.y, joint/tool_joint/origin.rx,
           joint/tool_joint/origin.ry, joint/tool_joint/origin.rz]
"""


def mul(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def inverse(t):
    r = [[t[j][i] for j in range(3)] for i in range(3)]
    return [r[i] + [-sum(r[i][k] * t[k][3] for k in range(3))] for i in range(3)] + [[0, 0, 0, 1]]


def move(t, p):
    return [sum(t[i][k] * p[k] for k in range(3)) + t[i][3] for i in range(3)]


def axis_angle(axis, angle, xyz=(0, 0, 0)):
    n = math.sqrt(sum(x * x for x in axis))
    x, y, z = (v / n for v in axis) if n else (1.0, 0.0, 0.0)
    c, s = math.cos(angle), math.sin(angle)
    v = 1 - c
    return [[c + x * x * v, x * y * v - z * s, x * z * v + y * s, xyz[0]], [y * x * v + z * s, c + y * y * v, y * z * v - x * s, xyz[1]],
            [z * x * v - y * s, z * y * v + x * s, c + z * z * v, xyz[2]], [0, 0, 0, 1]]


def frame(xyz, rpy=(0, 0, 0)):
    t = axis_angle((0, 0, 1), rpy[2], xyz)
    return mul(mul(t, axis_angle((0, 1, 0), rpy[1])), axis_angle((1, 0, 0), rpy[0]))


def twist(v):
    """A small motion [x y z rx ry rz]: near enough to exp for the making of a truth."""
    return axis_angle(v[3:], math.sqrt(sum(x * x for x in v[3:])), v[:3])


def log_rotation(t):
    c = (t[0][0] + t[1][1] + t[2][2] - 1) / 2
    angle = math.acos(max(-1.0, min(1.0, c)))
    f = 0.5 if angle < 1e-7 else angle / (2 * math.sin(angle))
    return [f * (t[2][1] - t[1][2]), f * (t[0][2] - t[2][0]), f * (t[1][0] - t[0][1])]


def quaternion(t):
    w = math.sqrt(max(0.0, 1 + t[0][0] + t[1][1] + t[2][2])) / 2
    assert w > 1e-3, "not needed here"
    return [(t[2][1] - t[1][2]) / (4 * w), (t[0][2] - t[2][0]) / (4 * w), (t[1][0] - t[0][1]) / (4 * w), w]


def from_quaternion(xyz, q):
    x, y, z, w = q
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), xyz[0]],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), xyz[1]],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), xyz[2]], [0, 0, 0, 1]]


def read_joints(urdf_text):
    import xml.etree.ElementTree as ElementTree
    joints = {}
    for j in ElementTree.fromstring(urdf_text.encode()).findall("joint"):
        numbers = lambda e, k, d: [float(x) for x in (e.get(k, d) if e is not None else d).split()]
        o, a, m = j.find("origin"), j.find("axis"), j.find("mimic")
        joints[j.get("name")] = {
            "type": j.get("type"), "parent": j.find("parent").get("link"), "child": j.find("child").get("link"),
            "origin": frame(numbers(o, "xyz", "0 0 0"), numbers(o, "rpy", "0 0 0")), "axis": numbers(a, "xyz", "1 0 0"),
            "mimic": m is not None and (m.get("joint"), float(m.get("multiplier", 1)), float(m.get("offset", 0)))}
    return joints


def position(joints, name, positions):
    m = joints[name]["mimic"]
    return m[1] * position(joints, m[0], positions) + m[2] if m else positions.get(name, 0.0)


def link_pose(joints, link, positions):
    """root_T_link; `positions`: by joint name, without mimic joints."""
    t = frame((0, 0, 0))
    for name, j in joints.items():
        if j["child"] == link:
            t = mul(link_pose(joints, j["parent"], positions), j["origin"])
            q = position(joints, name, positions)
            if j["type"] == "prismatic":
                n = math.sqrt(sum(x * x for x in j["axis"]))
                t = mul(t, frame([x / n * q for x in j["axis"]]))
            elif j["type"] in ("revolute", "continuous"):
                t = mul(t, axis_angle(j["axis"], q))
    return t


TRUTH = {"scale": 1.01, "lift": 0.012, "slide": 0.004, "tool": [0.003, -0.002, 0, 0.01, -0.006, 0.008],
         "tracker": [0.02, -0.01, 0.03, 0.01, 0.02, -0.015], "mocap": [0.01, 0.02, -0.01, 0.02, 0, 0.01],
         "plate": [0.002, 0.001, -0.003, 0.01, 0.02, 0.015], "eye": [0.01, 0.004, 0, 0.012, -0.01, 0.006]}
REFLECTORS = [[0, 0, 0], [0.1, 0, 0], [0, 0.08, 0.03]]


def make_samples(count=24, boards=8, seed=1, noise=1.0):
    """Samples of the rig above with the truth above, as dictionaries; every fourth is held out."""
    rng = random.Random(seed)
    gauss = lambda sigma: rng.gauss(0, sigma) * noise
    joints = read_joints(URDF)
    joints["tool_joint"]["origin"] = mul(joints["tool_joint"]["origin"], twist(TRUTH["tool"]))
    tracker = mul(frame([0.5, -2.0, 0.3], [0, 0, 1.2]), twist(TRUTH["tracker"]))
    mocap = mul(frame([0, 2.0, 1.0], [0.1, 0, -1.0]), twist(TRUTH["mocap"]))
    plate = mul(frame([0.02, 0, 0.05], [0, 0.1, 0]), twist(TRUTH["plate"]))
    eye = mul(frame([0.1, 0, 0.9], [-1.5707963, 0, -1.5707963]), twist(TRUTH["eye"]))
    samples = []
    for i in range(count):
        reading = {"turn": rng.uniform(-1.5, 1.5), "lift": rng.uniform(-1.1, 1.1), "slide": rng.uniform(0, 0.4)}
        tool = link_pose(joints, "tool", {"turn": TRUTH["scale"] * (reading["turn"] + gauss(0.0005)),
                                          "lift": reading["lift"] + gauss(0.0005) + TRUTH["lift"],
                                          "slide": reading["slide"] + gauss(0.0002) + TRUTH["slide"]})
        seen = [[x + gauss(0.0002) for x in move(mul(inverse(tracker), tool), p)] for p in REFLECTORS]
        pose = mul(mul(inverse(mocap), tool), plate)
        pose = mul(pose, twist([gauss(0.0005) for _ in range(3)] + [gauss(0.001) for _ in range(3)]))
        samples.append({"id": "arm_%03d" % i, "joints": reading, "views": [
            {"sensor": "tracker", "target": "reflectors", "points": seen},
            {"sensor": "mocap", "target": "plate", "pose": {"xyz": [pose[k][3] for k in range(3)], "quat": quaternion(pose)}}]})
    corners = [[c * 0.05, r * 0.05, 0] for r in range(3) for c in range(4)]
    for i in range(boards):
        camera_T_board = frame([rng.uniform(-0.4, 0.2), rng.uniform(-0.3, 0.2), rng.uniform(1.0, 1.6)], [rng.uniform(-0.5, 0.5) for _ in range(3)])
        in_camera = [move(camera_T_board, p) for p in corners]
        in_tracker = [move(mul(inverse(tracker), eye), p) for p in in_camera]
        samples.append({"id": "board_%03d" % i, "joints": {"turn": 0.1, "lift": 0, "slide": 0}, "views": [
            {"sensor": "eye", "target": "board", "pixels": [[500 * p[0] / p[2] + 320 + gauss(0.2), 500 * p[1] / p[2] + 240 + gauss(0.2)] for p in in_camera]},
            {"sensor": "tracker", "target": "board", "ids": [0, 3, 8, 11], "points": [[x + gauss(0.0002) for x in in_tracker[k]] for k in (0, 3, 8, 11)]}]})
    for i, s in enumerate(samples):
        if i % 4 == 3:
            s["split"] = "test"
    return samples


def lines(samples):
    return "".join(json.dumps(s) + "\n" for s in samples)


# ----------------------------------------------------------------------------- running the program

class Run:
    def __init__(self, process, out, err):
        self.code, self.out, self.err = process.returncode, out, err


class Case(unittest.TestCase):
    maxDiff = 2000

    @classmethod
    def setUpClass(cls):
        cls.root = tempfile.mkdtemp(prefix="kincal_cli_")

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.root, ignore_errors=True)

    def setUp(self):
        self.dir = tempfile.mkdtemp(dir=self.root)
        self.write("robot.urdf", URDF)
        self.write("rig.yaml", RIG)
        self.write("samples.jsonl", lines(make_samples()))

    def path(self, *names):
        return os.path.join(self.dir, *names)

    def write(self, name, text):
        with open(self.path(name), "w", encoding="utf-8", newline="") as f:
            f.write(text)
        return self.path(name)

    def read(self, *names):
        with open(self.path(*names), encoding="utf-8", newline="") as f:
            return f.read()

    def run_kincal(self, *args, cwd=None, env=None, **more):
        p = subprocess.Popen([KINCAL] + list(args), stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, cwd=cwd or self.dir,
                             env=dict(os.environ, **(env or {})), **more)
        out, err = p.communicate(timeout=120)
        self.assertGreaterEqual(p.returncode, 0, "killed by signal %d; %s" % (-p.returncode, err.decode()[-500:]))
        return Run(p, out.decode(), err.decode())

    def calibrate(self, *args, rig="rig.yaml", samples="samples.jsonl", out="out", **more):
        return self.run_kincal("calibrate", rig, samples, "--out", out, *args, **more)

    def result(self, directory="out"):
        return strict_json(self.read(directory, "result.json"))

    def fails(self, run, *words):
        """One clear error, exit code 1, nothing written."""
        before = {"robot.urdf", "rig.yaml", "samples.jsonl"} | getattr(self, "extra", set())
        self.assertEqual(run.code, 1, "exit code %d\nstdout: %s\nstderr: %s" % (run.code, run.out[-800:], run.err[-800:]))
        self.assertEqual(run.out, "")
        errors = [x for x in run.err.splitlines() if x.startswith("kincal: error: ")]
        self.assertEqual(len(errors), 1, run.err)
        text = run.err.lower()
        for w in words:
            self.assertTrue(any(x.lower() in text for x in w) if isinstance(w, tuple) else w.lower() in text,
                            "'%s' is not in the message: %s" % (w, run.err))
        self.assertEqual(set(os.listdir(self.dir)) - before, set(), "something was written")


def sanitized():
    """Is the program built with a sanitizer? It needs address space without bounds, and time."""
    symbols = subprocess.run(["nm", "-D", KINCAL], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL).stdout
    return b"__asan_init" in symbols or b"__tsan_init" in symbols


def strict_json(text):
    def refuse(x):
        raise ValueError("not JSON: " + x)

    def pairs(p):
        keys = [k for k, _ in p]
        assert len(set(keys)) == len(keys), "a key occurs twice"
        return dict(p)
    return json.loads(text, parse_constant=refuse, object_pairs_hook=pairs)


def line_of(text, part):
    return text[:text.index(part)].count("\n") + 1


# ----------------------------------------------------------------------------- wrong input

class WrongRig(Case):
    """(name, old text, new text, words of the message); the line of the new text must be in the message."""

    def case(self, old, new, *words, line=None, at=None):
        self.assertIn(old, RIG)
        text = RIG.replace(old, new, 1)
        self.write("rig.yaml", text)
        where = "rig.yaml:%d" % (line or line_of(text, at or new.strip().splitlines()[-1].strip()))
        for args in (("calibrate", "rig.yaml", "samples.jsonl", "--out", "out"), ("calibrate", "rig.yaml", "samples.jsonl", "--dry-run"),
                     ("evaluate", "rig.yaml", "samples.jsonl")):
            with self.subTest(new=new, command=args[0]):
                self.fails(self.run_kincal(*args), where + ":", *words)

    def test_malformed_yaml(self):
        self.case("points: [[0, 0, 0], [0.1, 0, 0], [0, 0.08, 0.03]]", "points: [[0, 0, 0], [0.1, 0, 0], [0, 0.08, 0.03]", line=line_of(RIG, "mount: {link: tool}"))
        text = RIG.replace("    rows: 3", "\trows: 3")
        self.write("rig.yaml", text)
        self.fails(self.calibrate(), "rig.yaml:%d" % line_of(text, "\trows"))

    def test_unknown_keys(self):
        self.case("joints:\n", "joint:\n", "joint", "nearest", "joints")
        self.case('  slide: {sigma: 0.0002}', '  slide: {sigmas: 0.0002}', "joints.slide", "sigmas", "sigma")
        self.case("    square: 0.05", "    sqare: 0.05", "sqare", "square")
        self.case("    image_size: [640, 480]", "    imagesize: [640, 480]", "imagesize", "image_size")
        self.case("mount: {link: tool}", "mount: {lnk: tool}", "lnk", "link")
        self.case("  - step: eyes", "  - stepp: eyes", "stepp", "step")
        self.case("    sigma: 0.0002", "    sigma: 0.0002\n    baseline: 0.1", "sensors.tracker", "baseline")
        self.case("{translation: 0.0005, rotation: 0.001}", "{translation: 0.0005, rotate: 0.001}", "rotate", "rotation")
        self.case("    sensors: [tracker, eye]", "    sensors: [tracker, eye]\n    loss: {hubert: 3}", "hubert", "huber")

    def test_missing_keys(self):
        self.case("format: kincal/1\n", "", "format", line=1)
        self.case("    link: base_link\n    pose: {xyz: [0.5", "    pose: {xyz: [0.5", "link", line=line_of(RIG, "  tracker:\n"))
        self.case("    rows: 3\n", "", "rows", line=line_of(RIG, "  board:\n"))

    def test_key_twice(self):
        self.case("base: base_link\n", "base: base_link\nbase: turret\n", "base", at="base: turret")

    def test_format_version(self):
        self.case("format: kincal/1", "format: kincal/2", "format", "kincal/1")

    def test_unknown_names(self):
        self.case("  slide: {sigma: 0.0002}", "  slyde: {sigma: 0.0002}", "slyde", "nearest", "slide")
        self.case('  slide: {sigma: 0.0002}', '  "wrist_*": {sigma: 0.0002}', "wrist_*")
        self.case("base: base_link", "base: bass_link", "bass_link", "nearest", "base_link")
        self.case("mount: {link: tool}", "mount: {link: tol}", "tol", "nearest", "tool")
        self.case("    link: base_link\n    pose: {xyz: [0.5", "    link: base_lnk\n    pose: {xyz: [0.5", "sensors.tracker", "base_lnk", "nearest", "base_link",
                  at="    link: base_lnk")
        self.case("    type: point\n", "    type: pont\n", "pont", "point", "tilting_laser")
        self.case("    type: chessboard", "    type: chesboard", "chesboard", "chessboard", "charuco")
        self.case("    model: pinhole", "    model: pinehole", "pinehole", "pinhole", "kannala_brandt")
        self.case("sensors: [tracker, eye]", "sensors: [traker, eye]", "traker", "nearest", "tracker")
        self.case("sensor/eye/pose]", "sensor/eyes/pose]", "sensor/eyes/pose", "nearest", "sensor/eye/pose")
        self.case("sensor/eye/pose]", "sensor/eye/pose.w]", "sensor/eye/pose.w")
        self.case("sensor/eye/pose]", "joint/turnn/offset]", "joint/turnn/offset", "nearest", "joint/turn/offset")
        self.case("sensor/eye/pose]", "\"joint/wrist_*\"]", "joint/wrist_*")

    def test_fixed_and_mimic_joints_by_name(self):
        self.case("  slide: {sigma: 0.0002}", "  tool_joint: {sigma: 0.0002}", "tool_joint", "fixed")
        self.case("  slide: {sigma: 0.0002}", "  follower: {sigma: 0.0002}", "follower", "mimic")

    def test_numbers(self):
        for bad in (".nan", ".inf", "-.inf", "1e999", "abc", "-0.1", "''", "[]"):
            self.case("  slide: {sigma: 0.0002}", "  slide: {sigma: %s}" % bad, "joints.slide.sigma")
        for bad in ("0", "-1", ".nan"):
            self.case("    square: 0.05", "    square: %s" % bad, "targets.board.square")
            self.case("    sigma: 0.2", "    sigma: %s" % bad, "sensors.eye.sigma", line=line_of(RIG, "    sigma: 0.2"))
        for bad in ("0", "-3", "2.5", "three"):
            self.case("    rows: 3", "    rows: %s" % bad, "targets.board.rows")
        self.case("  slide: {sigma: 0.0002}", "  slide: {scale: 0}", "joints.slide.scale")
        self.case("  slide: {sigma: 0.0002}", "  slide: {sigma: 0,0002}", "joints.slide")
        self.case("intrinsics: [500, 500", "intrinsics: [0, 500", "sensors.eye.intrinsics")

    def test_vector_lengths(self):
        self.case("xyz: [0.5, -2.0, 0.3]", "xyz: [0.5, -2.0]", "sensors.tracker.pose.xyz", "3")
        self.case("rpy: [0, 0, 1.2]}", "rpy: [0, 0, 1.2, 0]}", "sensors.tracker.pose.rpy", "3")
        self.case("rpy: [0, 0, 1.2]}", "quat: [0, 0, 1]}", "sensors.tracker.pose.quat", "4")
        self.case("rpy: [0, 0, 1.2]}", "quat: [0, 0, 0, 0]}", "sensors.tracker.pose.quat")
        self.case("intrinsics: [500, 500, 320, 240]", "intrinsics: [500, 320, 240]", "sensors.eye.intrinsics", "4")
        self.case("image_size: [640, 480]", "image_size: [640]", "sensors.eye.image_size")
        self.case("    model: pinhole", "    model: brown_conrady\n    distortion: [0, 0, 0]", "sensors.eye.distortion", "5")
        self.case("[0.1, 0, 0]", "[0.1, 0]", "targets.reflectors.points", "3")
        self.case("    sigma: 0.0002", "    sigma: [0.0002, 0.0002]", "sensors.tracker.sigma", "3")
        self.case("sigma: {translation: 0.0005, rotation: 0.001}", "sigma: 0.001", "sensors.mocap.sigma")

    def test_wrong_kinds(self):
        self.case("free: [sensor/tracker/pose, sensor/eye/pose]", "free: {sensor/tracker/pose: 1}", "free")
        self.case("mount: free", "mount: fre", "targets.board.mount", "free")
        self.case("base: base_link", "base: [base_link]", "base")
        self.write("rig.yaml", "")
        self.fails(self.calibrate(), "rig.yaml")
        self.write("rig.yaml", "- 1\n- 2\n")
        self.fails(self.calibrate(), "rig.yaml:1")
        self.write("rig.yaml", "\x00\x01\x02 binary")
        self.fails(self.calibrate(), "rig.yaml")

    def test_steps(self):
        self.case("free: [sensor/tracker/pose, sensor/eye/pose]", "free: []", "estimate[0].free", "nothing")
        self.case("    sensors: [tracker, eye]", "    sensors: []", "sensors")
        self.case("  - step: all", "  - step: eyes", "eyes", line=line_of(RIG, "  - step: all"))                                         # a name twice
        self.case("    sensors: [tracker, eye]", "    sensors: [tracker, eye]\n    priors: {joint/lift/offset: 0.1}", "joint/lift/offset", "prior")
        self.case("    sensors: [tracker, eye]", "    sensors: [tracker, eye]\n    priors: {sensor/tracker/pose: -0.1}", "sensor/tracker/pose")
        self.case("    sensors: [tracker, eye]", "    sensors: [tracker, eye]\n    priors: {sensor/trackr/pose: 0.1}", "sensor/trackr/pose", "sensor/tracker/pose")
        self.case("    sensors: [tracker, eye]", "    sensors: [tracker, eye]\n    loss: {huber: 0}", "loss")
        # a glob whose every parameter nothing of the step depends on frees nothing
        text = RIG.replace("free: [sensor/tracker/pose, sensor/eye/pose]", 'free: ["target/plate/*"]')
        self.write("rig.yaml", text)
        self.fails(self.calibrate(), "eyes", ("frees nothing", "target/plate"))
        text = RIG[:RIG.index("estimate:")]
        self.write("rig.yaml", text)
        run = self.run_kincal("calibrate", "rig.yaml", "samples.jsonl", "--dry-run")  # no error: the automatic path (automatic_test.py)
        self.assertEqual(run.code, 0, run.err)
        self.assertIn("everything below is estimated", run.out)
        run = self.run_kincal("calibrate", "rig.yaml", "samples.jsonl", "--dry-run", "--json")
        self.assertEqual(run.code, 1)
        self.assertIn("--dry-run excludes --json", run.err)
        for option in ("--free", "--fix"):  # as the real run
            run = self.run_kincal("calibrate", "rig.yaml", "samples.jsonl", "--dry-run", option, "sensor/trackr/pose")
            self.fails(run, option, ("sensor/trackr/pose", "matches no parameter"), ("sensor/tracker/pose",))

    def test_files(self):
        os.remove(self.path("rig.yaml"))
        self.fails(self.calibrate(), "rig.yaml", ("no such file", "not found", "cannot be read", "cannot read"))
        os.mkdir(self.path("rig.yaml"))
        self.fails(self.calibrate(), "rig.yaml")
        os.rmdir(self.path("rig.yaml"))
        self.case("robot: robot.urdf", "robot: nobot.urdf", "nobot.urdf")


class WrongRobot(Case):
    def case(self, old, new, *words, at=None, where=True):
        self.assertIn(old, URDF)
        text = URDF.replace(old, new, 1)
        self.write("robot.urdf", text)
        if where:
            words = ("robot.urdf:%d" % line_of(text, at or new.strip().splitlines()[0]),) + words
        with self.subTest(new=new):
            self.fails(self.calibrate(), "robot.urdf", *words)

    def test_xml(self):
        self.case("</robot>", "", where=False)
        self.case('<joint name="turn" type="continuous">', '<joint name="turn" type="continuous"', where=False)
        self.write("robot.urdf", "")
        self.fails(self.calibrate(), "robot.urdf")
        self.write("robot.urdf", "<sdf></sdf>")
        self.fails(self.calibrate(), "robot.urdf", "robot")
        self.write("robot.urdf", '<robot name="x"></robot>')
        self.fails(self.calibrate(), "robot.urdf", "link")

    def test_tree(self):
        self.case('<child link="turret"/>', '<child link="tool"/>', "tool", where=False)                      # two parents
        self.case('<link name="cart"/>', '<link name="cart"/><link name="island"/>', "root", "island", "base_link", where=False)
        # a loop: base_link hangs on the tool
        self.case("</robot>", '<joint name="back" type="fixed"><parent link="tool"/><child link="base_link"/></joint></robot>', ("loop", "root", "cycle"), where=False)
        self.case('<child link="turret"/>', '<child link="turet"/>', "turet", "turret", where=False)
        self.case('<link name="cart"/>', '<link name="tool"/>', "tool", ("twice", "already"), where=False)
        self.case("<joint name='slide' type='prismatic'>", "<joint name='lift' type='prismatic'>", "lift", ("twice", "already"), where=False)
        self.case('<mimic joint="slide"', '<mimic joint="slid"', "slid", "slide")
        self.case('<mimic joint="slide"', '<mimic joint="follower"', "follower", where=False)
        self.case('<joint name="turn" type="continuous">', '<joint name="turn" type="continous">', "continous", "continuous")
        self.case('    <parent link="base_link"/>\n', "", "turn", "parent", where=False)

    def test_numbers(self):
        self.case('<origin xyz="0 0 0.4" rpy="0 0 0"/>', '<origin xyz="0 0" rpy="0 0 0"/>', "xyz", "3")
        self.case('<origin xyz="0 0 0.4" rpy="0 0 0"/>', '<origin xyz="0 0 nan" rpy="0 0 0"/>', "xyz")
        self.case('<origin xyz="0 0 0.4" rpy="0 0 0"/>', '<origin xyz="0 0 0,4" rpy="0 0 0"/>', "xyz")
        self.case('<origin xyz="0 0 0.4" rpy="0 0 0"/>', '<origin xyz="0 0 inf" rpy="0 0 0"/>', "xyz")
        self.case('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', "axis")

    def test_floating_joint_in_a_used_chain(self):
        self.write("rig.yaml", RIG.replace("mount: {link: tool}", "mount: {link: cart}"))
        self.fails(self.calibrate(), "samples.jsonl:1", "needs joint 'caster'")


class WrongSamples(Case):
    def case(self, change, *words, line=3, field=None):
        samples = make_samples()
        change(samples[line - 1])
        self.write("samples.jsonl", lines(samples))
        with self.subTest(words=words, field=field):
            self.fails(self.calibrate(), "samples.jsonl:%d" % line, *(words + ((field,) if field else ())))

    def text_case(self, text, *words, line=None):
        self.write("samples.jsonl", text)
        with self.subTest(text=text[:60]):
            self.fails(self.calibrate(), "samples.jsonl" + (":%d" % line if line else ""), *words)

    def test_malformed_lines(self):
        good = lines(make_samples()).splitlines()
        for bad in ('{"id": "x"', "not json", good[2][:-1], good[2] + "}", "[1, 2]", '"text"', good[2].replace('"joints"', "'joints'"), good[2] + " " + good[3]):
            self.text_case("\n".join(good[:2] + [bad] + good[3:]) + "\n", line=3)

    def test_empty(self):
        self.text_case("", ("empty", "no sample"))
        self.text_case("\n\n", ("empty", "no sample"))
        samples = make_samples()
        for s in samples:
            s["split"] = "test"
        self.text_case(lines(samples), ("train", "held out"))
        os.remove(self.path("samples.jsonl"))
        self.fails(self.calibrate(), "samples.jsonl", ("no such file", "not found", "cannot be read", "cannot read"))

    def test_ids(self):
        self.case(lambda s: s.update(id="arm_000"), "arm_000", ("twice", "duplicate", "line 1", ":1"), field="id")
        self.case(lambda s: s.pop("id"), "id")

    def test_not_finite(self):
        good = lines(make_samples()).splitlines()
        for bad in ("NaN", "Infinity", "-Infinity", "1e999", "nan"):
            text = re.sub(r'"lift": [-0-9.e]+', '"lift": ' + bad, good[2])
            self.text_case("\n".join(good[:2] + [text] + good[3:]) + "\n", line=3)
        for bad in ('"0.5"', "null", "[0.5]", "true"):
            text = re.sub(r'"lift": [-0-9.e]+', '"lift": ' + bad, good[2])
            self.text_case("\n".join(good[:2] + [text] + good[3:]) + "\n", "joints.lift", line=3)

    def test_unknown(self):
        self.case(lambda s: s["views"][0].update(sensor="traker"), "traker", "nearest", "tracker", field="views[0].sensor")
        self.case(lambda s: s["views"][1].update(target="plat"), "plat", "nearest", "plate", field="views[1].target")
        self.case(lambda s: s["views"][0].update(sigmas=1), "sigmas", "sigma", field="views[0]")
        self.case(lambda s: s.update(jonts={}), "jonts", "joints")
        self.case(lambda s: s.update(split="validation"), "validation", "train", "test", field="split")

    def test_missing_reading(self):
        self.case(lambda s: s["joints"].pop("lift"), "lift")
        self.case(lambda s: s["joints"].update(lyft=s["joints"].pop("lift")), "lift", "lyft")
        self.case(lambda s: s.pop("joints"), "joints")

    def test_vectors(self):
        view = lambda s: s["views"][0]
        self.case(lambda s: view(s)["points"].append([0, 0, 0]), ("3", "ids"), field="views[0]")
        self.case(lambda s: view(s)["points"][1].pop(), "3", field="views[0].points[1]")
        self.case(lambda s: view(s).update(points=[]), field="views[0].points")
        self.case(lambda s: view(s).pop("points"), "points", field="views[0]")
        self.case(lambda s: view(s).update(pixels=[[1, 2]]), "pixels", field="views[0]")
        self.case(lambda s: view(s).update(ids=[0, 1]), "ids", field="views[0]")
        self.case(lambda s: view(s).update(ids=[0, 1, 3]), "3", "2", field="views[0].ids")
        self.case(lambda s: view(s).update(ids=[0, 1, -1]), "-1", field="views[0].ids")
        self.case(lambda s: view(s).update(ids=[0, 1, 1]), "1", field="views[0].ids")
        self.case(lambda s: view(s).update(ids=[0, 1, 1.5]), field="views[0].ids")
        self.case(lambda s: view(s).update(sigma=0), field="views[0].sigma")
        self.case(lambda s: view(s).update(sigma=[1, 2]), "3", field="views[0].sigma")
        self.case(lambda s: view(s).update(covariance=[[1, 0], [0, 1]]), field="views[0].covariance")
        self.case(lambda s: view(s).update(covariance=[[1, 0, 0], [0, 1, 0], [0, 0, -1]]), field="views[0].covariance")
        self.case(lambda s: view(s).update(covariance=[[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]), field="views[0].covariance")
        self.case(lambda s: view(s).update(covariance=[[1, 0, 0], [0, 1, 0], [0, 0, 1]], sigma=0.1), "sigma", field="views[0]")
        view = lambda s: s["views"][1]
        self.case(lambda s: view(s).update(ids=[0]), "ids", field="views[1]")
        self.case(lambda s: view(s)["pose"]["quat"].pop(), "4", field="views[1].pose.quat")
        self.case(lambda s: view(s)["pose"].update(quat=[0, 0, 0, 0]), field="views[1].pose.quat")
        self.case(lambda s: view(s).pop("pose"), "pose", field="views[1]")
        self.case(lambda s: view(s).update(covariance=[[1, 0, 0], [0, 1, 0], [0, 0, 1]]), "covariance", field="views[1]")

    def test_point_behind_the_camera(self):
        """At the start: a mounted board behind the camera that should see it, and no step moves either."""
        text = RIG.replace(", sensor/eye/pose", "").replace("    mount: free", "    mount: {link: base_link, pose: {xyz: [-2, 0, 1], rpy: [0, 0, 0]}}")
        self.write("rig.yaml", text)
        self.fails(self.calibrate(), "board_000", "'eye'", "behind")


class WrongKinds(Case):
    """A file of another kind is called what it is, with what is wanted and what to do; never by the grammar of what it is not."""

    def other(self, command, name, *words):
        with self.subTest(command=command, name=name):
            run = self.run_kincal(*command.replace("NAME", name).split())
            self.extra = set(os.listdir(self.dir))
            self.fails(run, name + ": this is", *words) if words[0] != "are" else self.fails(run, name + ": these are", *words[1:])

    def put(self, name, data):
        with open(self.path(name), "wb") as f:
            f.write(data if isinstance(data, bytes) else data.encode())
        self.extra = set(os.listdir(self.dir))

    def test_arguments_in_another_order(self):
        for command, name, words in (
                ("evaluate NAME rig.yaml", "samples.jsonl", ("are", "samples, no rig", "the rig comes first")),
                ("evaluate NAME samples.jsonl", "robot.urdf", ("XML, no rig", "robot: ...", "kincal init")),
                ("evaluate rig.yaml NAME", "rig.yaml", ("a rig, no samples", "the rig comes first")),
                ("calibrate rig.yaml NAME --out x", "robot.urdf", ("XML, no samples", "the rig names")),
                ("evaluate rig.yaml samples.jsonl --urdf NAME", "rig.yaml", ("a rig, no URDF", "robot: ...")),
                ("evaluate rig.yaml samples.jsonl --urdf NAME", "samples.jsonl", ("are", "samples, no URDF")),
                ("check NAME rig.yaml", "samples.jsonl", ("are", "samples, no rig")),
                ("init NAME --sensor point:base_link --target points:0,0,0@tool", "rig.yaml", ("a rig, no URDF",)),
                ("simulate rig.yaml --samples 3 --seed 1 --out x --truth NAME", "rig.yaml", ("a rig, no truth.json",)),
                ("simulate rig.yaml --samples 3 --seed 1 --out x --truth NAME", "samples.jsonl", ("are", "samples, no truth.json")),
                ("simulate rig.yaml --samples 3 --seed 1 --out x --postures NAME", "rig.yaml", ("a rig, no postures",)),
                ("apply NAME robot.urdf --out x", "rig.yaml", ("a rig, no result.json",)),
                ("apply NAME robot.urdf --out x", "robot.urdf", ("XML, no result.json",)),
                ("diff NAME NAME", "samples.jsonl", ("are", "samples, no rig"))):
            self.other(command, name, *words)
        self.assertEqual(self.calibrate().code, 0)
        self.extra = {"out"}
        self.other("apply robot.urdf NAME --out x", "out", "a directory, not a URDF", "the result is the first argument")
        self.other("evaluate rig.yaml NAME", "out/result.json", "a result.json, no samples")

    def test_samples_written_otherwise(self):
        samples = make_samples()
        for name, text, words in (
                ("table.csv", "time,turn,lift\r\n0.1,0.2,0.3\r\n", ("a table (CSV), no samples", '{"id": "...", "joints": {...}, "views": [...]}')),
                ("table.tsv", "time\tturn\n0.1\t0.2\n", ("a table (CSV), no samples",)),
                ("semicolons.csv", "0,1;0,2\n0,3;0,4", ("a table (CSV), no samples",)),
                ("list.json", json.dumps(samples), ("a JSON list, no samples", "jq -c '.[]'")),
                ("pretty_list.json", "\ufeff" + json.dumps(samples, indent=2), ("a JSON list, no samples", "jq -c '.[]'")),
                ("pretty.json", "\n".join(json.dumps(s, indent=1) for s in samples), ("JSON over several lines, no samples", "jq -c ."))):
            self.put(name, text)
            self.other("evaluate rig.yaml NAME", name, *words)
        # what is merely wrong keeps its place
        good = lines(samples).splitlines()
        for bad in ('{"id": "x"}', good[0][:-1], "[1, 2]", '"text"', "not json"):
            self.write("samples.jsonl", "\n".join([bad] + good[1:]) + "\n")
            self.fails(self.calibrate(), "samples.jsonl:1")

    def test_samples_in_something(self):
        samples = make_samples()
        for name, text, words in (
                ("object.json", json.dumps({"samples": samples}), ("one JSON object around a list ('samples'), no samples", "jq -c '.samples[]'")),
                ("object2.json", json.dumps({"data": samples}, indent=2), ("one JSON object around a list ('data'), no samples", "jq -c '.data[]'")),
                ("object3.json", json.dumps({"robot": "tiny", "n": 3, "samples": samples}), ("one JSON object around", "jq -c '.samples[]'")),
                ("comments.csv", "# logged on Monday\n#\n# time, turn\n0.1,0.2\n0.3,0.4\n", ("a table (CSV), no samples", '{"id": "..."')),
                ("savetxt.txt", "# turn lift\n1.0e-01 -2.5e-01\n3.0e-01 4.0e-01\n", ("a table (CSV, with blanks), no samples", '{"id": "..."'))):
            self.put(name, text)
            self.other("evaluate rig.yaml NAME", name, *words)
        views_first = [dict([("views", s["views"])] + [(k, v) for k, v in s.items() if k != "views"]) for s in samples]
        self.write("samples.jsonl", lines(views_first))  # an order of keys is no other kind
        self.assertEqual(self.calibrate("--dry-run").code, 0)

    def test_files_of_other_programs(self):
        matrix = "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [900, 0, 640, 0, 900, 480, 0, 0, 1]\n"
        for name, text, words in (
                ("camera.yaml", "image_width: 1280\nimage_height: 960\ncamera_name: left\n" + matrix + "distortion_model: plumb_bob\n",
                 ("a camera_info of ROS", "no rig", "--sensor NAME --out NEW_RIG", "kincal init")),
                ("echo.yaml", "header:\n  seq: 0\nheight: 960\nwidth: 1280\ndistortion_model: 'plumb_bob'\nD: [0.1, 0, 0, 0, 0]\nK: [900, 0, 640]\n",
                 ("a camera_info message of ROS", "no rig", "kincal init")),
                ("opencv.yml", "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n", ("a file of OpenCV", "no rig", "kincal import")),
                ("camchain.yaml", "cam0:\n  camera_model: pinhole\n  distortion_model: radtan\n  intrinsics: [1, 2, 3, 4]\n  resolution: [640, 480]\n",
                 ("a camchain of Kalibr", "no rig", "import FILE --camera cam0")),
                ("april.yaml", "target_type: 'aprilgrid'\ntagCols: 6\ntagRows: 6\n", ("a target of Kalibr", "no rig", "--target NAME --out NEW_RIG")),
                ("handeye.yaml", "parameters:\n  eye_on_hand: true\n  robot_base_frame: base\ntransformation:\n  x: 0.1\n  qw: 1.0\n",
                 ("a result of easy_handeye", "no rig", "pose: {xyz:")),
                ("easy.calib", "parameters:\n  name: cam\n  calibration_type: eye_in_hand\n  robot_base_frame: base\ntransform:\n  translation: {x: 0}\n",
                 ("a file of easy_handeye", "no rig", "pose: {xyz:")),
                ("shot.png", b"\x89PNG\r\n\x1a\n\0", ("an image (PNG), no rig", "kincal detect")),
                ("data.npy", b"\x93NUMPY\1\0", ("an array of numpy, no rig", "samples.jsonl"))):
            self.put(name, text)
            self.other("evaluate NAME samples.jsonl", name, *words)
            self.other("evaluate rig.yaml NAME", name, words[0].split(",")[0], "no samples")

    def test_no_text(self):
        import gzip
        for name, data, words in (
                ("packed.gz", gzip.compress(b"x" * 100), ("a compressed file (gzip)", "gunzip")), ("packed.zip", b"PK\3\4rest", ("a zip archive (numpy's .npz is one, too)", "unzip")),
                ("packed.xz", b"\xfd7zXZ\0rest", ("a compressed file (xz)", "unxz")), ("some.bag", b"#ROSBAG V2.0\n\0", ("a ROS bag", "samples.jsonl")),
                ("some.db3", b"SQLite format 3\0rest", ("a database (of a ROS 2 bag?)", "samples.jsonl")), ("some.mcap", b"\x89MCAP0\r\n", ("a bag (MCAP)",)),
                ("noise.bin", bytes(range(1, 100)) + b"\0\1\2", ("binary data",)), ("wide.txt", RIG.encode("utf-16"), ("a text in UTF-16", "save it as UTF-8"))):
            self.put(name, data)
            for command, what in (("evaluate NAME samples.jsonl", ", no rig"), ("evaluate rig.yaml NAME", ", no samples"),
                                  ("evaluate rig.yaml samples.jsonl --urdf NAME", ", no URDF"), ("apply NAME robot.urdf --out x", ", no result.json")):
                self.other(command, name, words[0] + what, *words[1:])

    def test_tabs_in_yaml(self):
        for old in ("  slide:", "    rows:", "  board:", "    link: base_link", "    sensors: [tracker"):
            text = RIG.replace(old, "\t" + old.strip(), 1)
            self.write("rig.yaml", text)
            self.fails(self.calibrate(), "rig.yaml:%d:1: a tab indents this line" % line_of(text, "\t"), "blanks")
        self.write("rig.yaml", RIG.replace("robot: robot", "robot:\trobot"))  # no indentation
        self.assertEqual(self.calibrate("--dry-run").code, 0)
        self.write("rig.yaml", RIG.replace("robot: robot", "robot:\t{robot"))
        run = self.calibrate("--dry-run")
        self.assertEqual(run.code, 1)
        self.assertNotIn("tab", run.err)

    def test_xacro(self):
        """Also where the rest would do as a robot: what is not expanded may have been a joint."""
        bound = URDF.replace('<robot name="tiny">', '<robot name="tiny" xmlns:xacro="http://www.ros.org/wiki/xacro">')
        include = '<xacro:include filename="arm.xacro"/>'
        for text in (bound.replace("</robot>", include + "</robot>"), URDF.replace("</robot>", include + "</robot>"),
                     bound.replace('<link name="turret"/>', include), bound.replace('<link name="cart"/>', '<link name="cart">' + include + "</link>"),
                     URDF.replace('name="turret"', 'name="${prefix}turret"'), URDF.replace('link="turret"', 'link="$(arg prefix)turret"'),
                     URDF.replace('xyz="0 0 0.4"', 'xyz="0 0 ${height}"')):
            self.write("robot.urdf", text)
            self.fails(self.calibrate(), "robot.urdf:", "not expanded", "run xacro")
        self.write("robot.urdf", URDF.replace("</robot>", "<!-- " + include + " --></robot>"))
        self.assertEqual(self.calibrate("--dry-run").code, 0)

    def test_unbound_prefix(self):
        self.write("robot.urdf", URDF.replace("<material>Gazebo/Grey</material>", "<sensor:camera/>"))
        self.fails(self.calibrate(), "robot.urdf:%d" % line_of(URDF, "<gazebo"), "unbound prefix in 'sensor:camera'", "declare xmlns:sensor in <robot>")


class WrongArguments(Case):
    def test_options(self):
        for args, words in ((("--nose", "latent"), ("--nose",)), (("--noise", "latnt"), ("latnt", "latent")), (("--threads", "0"), ("threads",)),
                            (("--threads", "two"), ("threads",)), (("--linear-solver", "magic"), ("magic", "dense", "sparse", "cholmod")), (("--step",), ("step",)),
                            (("extra",), ("extra",))):
            with self.subTest(args=args):
                self.fails(self.calibrate(*args), *words)
        for args, nearest in ((("--ou", "x"), "--out"), (("--treads=2",), "--threads"), (("-quiet",), "--quiet"),
                              (("--linear_solver", "dense"), "--linear-solver")):
            with self.subTest(args=args):
                self.fails(self.calibrate(*args), "calibrate: there is no option '" + args[0].split("=")[0] + "'; nearest: " + nearest)
        # a required option that is misspelt, and an option that is nothing like any
        self.fails(self.run_kincal("simulate", "rig.yaml", "--samples", "3", "--sede", "1", "--out", "x"), "no option '--sede'; nearest: --seed")
        self.fails(self.run_kincal("evaluate", "rig.yaml", "samples.jsonl", "--xyzzy"), "there is no option '--xyzzy'")
        self.fails(self.run_kincal("--versoin"), "error: there is no option '--versoin'; nearest: --version")
        self.fails(self.run_kincal("calibrate", "rig.yaml"), "SAMPLES")
        self.fails(self.run_kincal("calibrate", "rig.yaml", "samples.jsonl"), "--out")
        self.fails(self.run_kincal("evaluate", "rig.yaml", "samples.jsonl", "--out", "out"), "--out")

    def test_subcommands(self):
        self.fails(self.run_kincal("calibrat", "rig.yaml", "samples.jsonl"), "calibrat", "calibrate", "evaluate")
        self.fails(self.run_kincal(), "calibrate")

    def test_names(self):
        self.fails(self.calibrate("--step", "eye"), "eye", "eyes")
        self.fails(self.calibrate("--free", "joint/lift/ofset"), "--free", "joint/lift/ofset", "nearest", "joint/lift/offset")
        self.fails(self.calibrate("--free", "joint/arm_*"), "joint/arm_*")
        self.fails(self.calibrate("--fix", "sensor/ey/pose"), "--fix", "sensor/ey/pose", "nearest", "sensor/eye/pose")
        self.fails(self.calibrate("--fix", "*"), "all", ("frees nothing", "nothing"))
        self.fails(self.run_kincal("evaluate", "rig.yaml", "samples.jsonl", "--free", "joint/lift/ofset"), "joint/lift/ofset", "nearest", "joint/lift/offset")
        self.fails(self.run_kincal("evaluate", "rig.yaml", "samples.jsonl", "--urdf", "none.urdf"), "none.urdf")

    def test_version_and_help(self):
        run = self.run_kincal("--version")
        self.assertEqual(run.code, 0)
        self.assertRegex(run.out, r"^kincal \d+\.\d+\.\d+\n$")
        run = self.run_kincal("--help")
        self.assertEqual((run.code, run.err), (0, ""))
        for word in ("calibrate", "evaluate", "apply", "Exit codes", "130", "rig.yaml", "samples.jsonl"):
            self.assertIn(word, run.out)
        subcommands = re.findall(r"^  ([a-z]+) {2,}\S", run.out[run.out.index("Subcommands:"):run.out.index("Examples:")], re.M)
        # what the text promises must be there
        for name in re.findall(r"^  kincal ([a-z]+)", run.out, re.M):
            with self.subTest(example=name):
                self.assertIn(name, subcommands)
        must = {"calibrate": ["--out", "--noise", "--threads", "--step", "--free", "--fix", "--linear-solver", "--no-report", "--write-reduction", "--force",
                              "--dry-run", "--quiet", "--json", "latent", "marginal", "RIG", "SAMPLES", "joint/NAME/offset"],
                "evaluate": ["--urdf", "--free", "--noise", "--json", "RIG", "SAMPLES"], "apply": ["RESULT", "URDF", "--out"],
                "simulate": ["--samples", "--seed", "--out", "--truth", "--spread", "--postures"]}
        for name in subcommands:
            run = self.run_kincal(name, "--help")
            with self.subTest(subcommand=name, option="--help"):
                self.assertEqual((run.code, run.err), (0, ""))
                for word in must.get(name, []):
                    self.assertIn(word, run.out)
            with self.subTest(subcommand=name, option="--version"):
                run = self.run_kincal(name, "--version")
                self.assertEqual((run.code, run.err), (0, ""))
                self.assertRegex(run.out, r"^kincal \d+\.\d+\.\d+\n$")


# ----------------------------------------------------------------------------- writing

class Writing(Case):
    def test_an_existing_result_is_kept(self):
        self.extra = {"out"}
        self.assertEqual(self.calibrate().code, 0)
        before = {f: self.read("out", f) for f in FILES}
        self.fails(self.calibrate(), "out", "--force")
        self.assertEqual({f: self.read("out", f) for f in FILES}, before)
        run = self.calibrate("--force", "--step", "eyes", "--no-report")
        self.assertEqual(run.code, 0, run.err)
        self.assertEqual(sorted(os.listdir(self.path("out"))), [f for f in FILES if f not in ("loops.csv", "residuals.csv", "report.html")])
        self.assertEqual(len(self.result()["steps"]), 1)
        self.assertEqual(set(os.listdir(self.dir)), {"out", "rig.yaml", "robot.urdf", "samples.jsonl"})

    def test_force_replaces_nothing_but_results(self):
        self.extra = {"out"}
        os.mkdir(self.path("out"))
        self.write("out/thesis.txt", "ten years of work")
        self.fails(self.calibrate(), "out")
        self.fails(self.calibrate("--force"), "out")
        self.assertEqual(self.read("out", "thesis.txt"), "ten years of work")
        shutil.rmtree(self.path("out"))
        self.write("out", "a file")
        self.fails(self.calibrate(), "out")
        self.fails(self.calibrate("--force"), "out")
        self.assertEqual(self.read("out"), "a file")
        os.remove(self.path("out"))
        os.mkdir(self.path("out"))
        self.fails(self.calibrate(), "out")
        self.assertEqual(self.calibrate("--force").code, 0)
        self.assertEqual(sorted(os.listdir(self.path("out"))), FILES)

    def test_force_with_bad_input_keeps_the_old_result(self):
        self.extra = {"out"}
        self.assertEqual(self.calibrate().code, 0)
        before = self.read("out", "result.json")
        self.write("samples.jsonl", "{\n")
        self.fails(self.calibrate("--force"), "samples.jsonl:1")
        self.assertEqual(self.read("out", "result.json"), before)

    def test_a_result_with_foreign_files_beside(self):
        """--force on a result directory in which the user keeps something of his own must not destroy that."""
        self.assertEqual(self.calibrate().code, 0)
        self.write("out/notes.txt", "mine")
        run = self.calibrate("--force")
        self.assertTrue(os.path.exists(self.path("out", "notes.txt")), "--force removed a user's file; exit code %d" % run.code)

    def test_a_slash_at_the_end(self):
        """As a shell completes it: --out out/."""
        run = self.calibrate(out="out/")
        self.assertEqual(run.code, 0, run.err)
        self.assertEqual(sorted(os.listdir(self.path("out"))), FILES)
        self.assertEqual(self.calibrate("--force", out="out/").code, 0)
        self.assertEqual(self.calibrate("--force", out="./out").code, 0)
        self.assertEqual(set(os.listdir(self.dir)), {"out", "rig.yaml", "robot.urdf", "samples.jsonl"})

    def test_a_link_to_a_result(self):
        """--force through a symbolic link: replaced or refused, but never a broken or half result."""
        self.assertEqual(self.calibrate(out="real").code, 0)
        os.symlink("real", self.path("latest"))
        run = self.calibrate("--force", out="latest")
        self.assertIn(run.code, (0, 1))
        self.assertEqual(sorted(os.listdir(self.path("latest"))), FILES)
        self.assertEqual(sorted(os.listdir(self.path("real"))), FILES)
        self.assertEqual(set(os.listdir(self.dir)), {"real", "latest", "rig.yaml", "robot.urdf", "samples.jsonl"})

    def test_parent(self):
        self.fails(self.calibrate(out="rig.yaml/out"), "rig.yaml")
        if os.getuid() != 0:
            self.extra = {"locked"}
            os.mkdir(self.path("locked"), 0o555)
            self.fails(self.calibrate(out="locked/out"), "locked")
        run = self.calibrate(out="a/b/out")       # either made or refused, never halves
        self.assertIn(run.code, (0, 1))
        if run.code == 0:
            self.assertEqual(sorted(os.listdir(self.path("a/b/out"))), FILES)
            self.assertEqual(os.listdir(self.path("a/b")), ["out"])
        else:
            self.assertFalse(os.path.exists(self.path("a")))
            self.assertIn("a/b", run.err)

    def test_full_disk(self):
        """Files cannot grow beyond some limit: an error, and nothing left."""
        def limit(size):
            def f():
                signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
                resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
            return f
        for size in (0, 1000, 5000, 20000):
            with self.subTest(size=size):
                self.fails(self.calibrate(preexec_fn=limit(size), restore_signals=False), "out")
        self.extra = {"out"}
        self.assertEqual(self.calibrate().code, 0)
        before = self.read("out", "result.json")
        self.fails(self.calibrate("--force", "--step", "eyes", preexec_fn=limit(5000), restore_signals=False), "out")
        self.assertEqual(self.read("out", "result.json"), before)

    def test_standard_output_that_is_full(self):
        """/dev/full as standard output: not success."""
        if not os.path.exists("/dev/full"):
            self.skipTest("no /dev/full")
        self.assertEqual(self.calibrate().code, 0)
        with open("/dev/full", "w") as full:
            p = subprocess.run([KINCAL, "evaluate", "out/rig.yaml", "samples.jsonl", "--json"], stdout=full, stderr=subprocess.PIPE, cwd=self.dir)
        self.assertNotEqual(p.returncode, 0)

    def test_interrupted(self):
        """SIGINT (and SIGTERM) at many moments of a long run: 130 and nothing left, or, at the very end, everything."""
        text = lines(make_samples(count=300, boards=100, noise=1.0))
        big = []
        for i in range(20):
            big.append(text.replace('"id": "', '"id": "copy%d_' % i))
        self.write("samples.jsonl", "".join(big))
        start = time.time()
        self.assertEqual(self.calibrate().code, 0)
        whole = time.time() - start
        shutil.rmtree(self.path("out"))
        interrupted = 0
        for i in range(12):
            p = subprocess.Popen([KINCAL, "calibrate", "rig.yaml", "samples.jsonl", "--out", "out"], cwd=self.dir, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            time.sleep(max(0.05, whole * (i + 0.5) / 12))
            p.send_signal(signal.SIGINT if i % 3 else signal.SIGTERM)
            out, err = p.communicate(timeout=60)
            listed = set(os.listdir(self.dir)) - {"rig.yaml", "robot.urdf", "samples.jsonl"}
            if p.returncode == 0:
                self.assertEqual(sorted(os.listdir(self.path("out"))), FILES)
                shutil.rmtree(self.path("out"))
            else:
                self.assertEqual((p.returncode, listed), (130, set()), err)
                interrupted += 1
        self.assertGreaterEqual(interrupted, 3)


    def test_simulate_interrupted(self):
        p = subprocess.Popen([KINCAL, "simulate", "rig.yaml", "--samples", "1000000", "--seed", "1", "--out", "out"], cwd=self.dir,
                             stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        time.sleep(0.5)
        p.send_signal(signal.SIGINT)
        start = time.time()
        out, err = p.communicate(timeout=60)
        self.assertEqual(p.returncode, 130, err)
        self.assertLess(time.time() - start, 5)  # it drew for half a second only
        self.assertFalse(os.path.exists(self.path("out")))


# ----------------------------------------------------------------------------- results

class Results(Case):
    def test_json_without_a_folder(self):
        """What is printed is the result.json that would be written; the folder stays as it was."""
        def plain(text):
            return re.sub(r'"(command|date|seconds)": *("(?:[^"\\]|\\.)*"|[-+0-9.e]+)', "", text)
        before = sorted(os.listdir(self.dir))
        run = self.run_kincal("calibrate", "rig.yaml", "samples.jsonl", "--json")
        self.assertEqual((run.code, run.err), (0, ""))
        self.assertEqual(sorted(os.listdir(self.dir)), before)
        self.assertEqual(self.calibrate("--json").code, 0)
        strict_json(run.out)
        self.assertEqual(plain(run.out), plain(self.read("out", "result.json")))
        run = self.run_kincal("calibrate", "rig.yaml", "samples.jsonl", "--quiet")
        self.assertEqual(run.code, 1)
        self.assertIn("--out DIR is required", run.err)

    def test_files_and_fields(self):
        run = self.calibrate()
        self.assertEqual(run.code, 0, run.err)
        self.assertEqual(sorted(os.listdir(self.path("out"))), FILES)
        self.assertEqual(set(os.listdir(self.dir)), {"out", "rig.yaml", "robot.urdf", "samples.jsonl"})
        r = self.result()
        must = {"kincal", "status", "noise", "chi2", "cost", "dof", "chi2_data", "dof_data", "input", "steps", "parameters", "samples", "sensors", "unobservable", "warnings"}
        self.assertEqual(must - set(r), set())
        self.assertRegex(r["kincal"], r"^\d+\.\d+\.\d+$")
        self.assertEqual((r["status"], r["noise"], r["unobservable"]), ("converged", "latent", []))
        self.assertAlmostEqual(r["cost"], r["chi2"] / 2, delta=1e-9 * r["chi2"])
        self.assertEqual(set(r["input"]), {"command", "date", "rig", "samples", "urdf"})
        self.assertRegex(r["input"]["date"], r"^20\d\d-\d\d-\d\dT\d\d:\d\d:\d\dZ$")
        import hashlib
        for key, name in (("rig", "rig.yaml"), ("samples", "samples.jsonl"), ("urdf", "robot.urdf")):
            self.assertEqual(r["input"][key], hashlib.sha256(self.read(name).encode()).hexdigest())
        self.assertIn("calibrate rig.yaml samples.jsonl --out out", r["input"]["command"])
        # steps
        self.assertEqual([s["step"] for s in r["steps"]], ["eyes", "all"])
        for s in r["steps"]:
            self.assertEqual({"step", "status", "iterations", "chi2_initial", "chi2", "dof", "chi2_data", "dof_data", "seconds", "linear_solver", "history", "unused", "held_out", "unobservable"} - set(s), set())
            self.assertEqual(s["status"], "converged")
            self.assertEqual(len(s["history"]), s["iterations"] + 1)
            self.assertTrue(all(len(h) == 2 and h[1] > 0 for h in s["history"]))
            self.assertAlmostEqual(s["history"][0][0], s["chi2_initial"], delta=1e-9 * s["chi2_initial"])
            self.assertAlmostEqual(s["history"][-1][0], s["chi2"], delta=1e-6 * s["chi2"])
            self.assertLess(s["chi2"], s["chi2_initial"])
            self.assertIn(s["linear_solver"], ("dense", "sparse", "cholmod"))
            self.assertEqual((s["unused"], s["held_out"], s["unobservable"]), ([], [], []))
        self.assertEqual(r["steps"][-1]["chi2"], r["chi2"])
        self.assertEqual(r["steps"][-1]["dof"], r["dof"])
        self.assertEqual((r["chi2_data"], r["dof_data"]), (r["chi2"], r["dof"]), "there are no priors")
        # degrees of freedom by hand: 18 arm samples (3 points, a pose, 3 joint errors), 6 boards (12 corners, 4 points; free pose; no joint in the way)
        self.assertEqual(r["dof"], 18 * (9 + 6 + 3 - 3) + 6 * (24 + 12 - 6) - (6 + 6 + 6 + 6 + 3 + 5))
        self.assertTrue(0.7 < r["chi2"] / r["dof"] < 1.3, r["chi2"] / r["dof"])
        # parameters
        names = ["sensor/tracker/pose", "sensor/eye/pose", "sensor/mocap/pose", "target/plate/pose", "joint/turn/scale", "joint/lift/offset", "joint/slide/offset",
                 "joint/tool_joint/origin"]
        self.assertEqual(sorted(r["parameters"]), sorted(names))
        units = {"pose": ["m"] * 3 + ["rad"] * 3, "origin": ["m"] * 3 + ["rad"] * 3, "scale": [""], "offset": ["rad"]}
        for name, p in r["parameters"].items():
            kind = name.split("/")[-1]
            size = 6 if kind in ("pose", "origin") else 1
            self.assertEqual({"unit", "initial", "value", "sigma", "step"} | ({"pose"} if size == 6 else set()), set(p), name)
            for key in ("unit", "initial", "value", "sigma"):
                self.assertEqual(len(p[key]), size, name)
            self.assertEqual(p["initial"], [0.0] * 6 if size == 6 else [1.0 if kind == "scale" else 0.0], name)
            self.assertEqual(p["step"], "all")
            if name == "joint/slide/offset":
                self.assertEqual(p["unit"], ["m"])
            elif kind != "scale":
                self.assertEqual(p["unit"], units[kind], name)
            if size == 6:
                self.assertEqual((len(p["pose"]["xyz"]), len(p["pose"]["quat"])), (3, 4))
                self.assertAlmostEqual(sum(x * x for x in p["pose"]["quat"]), 1, delta=1e-12)
            for i, s in enumerate(p["sigma"]):
                held = name == "joint/tool_joint/origin" and i == 2
                self.assertTrue(s == 0 if held else 0 < s < 0.1, (name, i, s))
                if held:
                    self.assertAlmostEqual(p["value"][i], 0.0, delta=1e-15)
        # the truth within 5 sigmas
        scale, lift, slide = (r["parameters"]["joint/" + n] for n in ("turn/scale", "lift/offset", "slide/offset"))
        self.assertLess(abs(scale["value"][0] - TRUTH["scale"]), 5 * scale["sigma"][0])
        self.assertLess(abs(lift["value"][0] - TRUTH["lift"]), 5 * lift["sigma"][0])
        # poses of samples
        training = [s for s in make_samples() if s.get("split") != "test"]
        self.assertEqual(set(r["samples"]), {s["id"] for s in training})
        for s in training:
            entry = r["samples"][s["id"]]
            if s["id"].startswith("arm"):
                self.assertEqual(set(entry["joint_errors"]), {"turn", "lift", "slide"})
                self.assertTrue(all(abs(d) < 5 * 0.0005 for d in entry["joint_errors"].values()))
                self.assertEqual(entry.get("targets", {}), {})
            else:
                self.assertEqual(set(entry["targets"]), {"board"})
                self.assertEqual((len(entry["targets"]["board"]["xyz"]), len(entry["targets"]["board"]["quat"])), (3, 4))
        # sensors
        self.assertEqual(set(r["sensors"]), {"tracker", "mocap", "eye"})
        self.assertEqual({k: v["unit"] for k, v in r["sensors"].items()}, {"tracker": "m", "mocap": "m", "eye": "px"})
        counts = {"tracker": (18 * 3 + 6 * 4, 6 * 3 + 2 * 4), "mocap": (18, 6), "eye": (6 * 12, 2 * 12)}
        for name, s in r["sensors"].items():
            for split, n in zip(("train", "test"), counts[name]):
                keys = {"points", "rms_before", "rms", "rms_as_read"}
                if name == "mocap":
                    keys |= {"rms_rotation"}
                self.assertEqual(keys - set(s[split]), set())
                self.assertEqual(s[split]["points"], n)
                self.assertTrue(all(s[split][k] > 0 for k in keys))
                self.assertLess(s[split]["rms"], s[split]["rms_before"])
        self.assertLess(r["sensors"]["eye"]["test"]["rms"], 0.5)
        self.assertLess(r["sensors"]["tracker"]["test"]["rms"], 0.001)
        for w in r["warnings"]:
            self.assertEqual(set(w), {"id", "text"})

    def test_residuals_csv(self):
        self.assertEqual(self.calibrate().code, 0)
        r = self.result()
        with open(self.path("out", "residuals.csv"), newline="") as f:
            rows = list(csv.DictReader(f))
        self.assertEqual(list(rows[0]), "sample,split,sensor,target,id,unit,x,y,z,rx,ry,rz,before_x,before_y,before_z,whitened,measured_1,measured_2,measured_3,whitened_1,whitened_2,whitened_3,whitened_4,whitened_5,whitened_6".split(","))
        self.assertEqual(len(rows), sum(s[k]["points"] for s in r["sensors"].values() for k in ("train", "test")))
        for name, s in r["sensors"].items():
            for split in ("train", "test"):
                part = [x for x in rows if x["sensor"] == name and x["split"] == split]
                for key, columns in (("rms", "xyz"), ("rms_before", ["before_x", "before_y", "before_z"]), ("rms_rotation", ["rx", "ry", "rz"])):
                    if key in s[split]:
                        total = sum(float(x[c] or 0) ** 2 for x in part for c in columns)
                        self.assertAlmostEqual(math.sqrt(total / len(part)), s[split][key], delta=1e-9 * s[split][key], msg=name + " " + key)
        eye = next(x for x in rows if x["sensor"] == "eye")
        self.assertEqual((eye["unit"], eye["z"], eye["rx"]), ("px", "", ""))
        mocap = next(x for x in rows if x["sensor"] == "mocap")
        self.assertEqual((mocap["unit"], mocap["id"]), ("m", ""))
        ids = [x["id"] for x in rows if x["sensor"] == "tracker" and x["sample"] == "board_000"]
        self.assertEqual(ids, ["0", "3", "8", "11"])
        # measured: what the samples file has
        with open(self.path("samples.jsonl")) as f:
            samples = {s["id"]: s for s in map(json.loads, f)}
        for x in rows:
            view = next(v for v in samples[x["sample"]]["views"] if (v["sensor"], v["target"]) == (x["sensor"], x["target"]))
            measured = [float(x["measured_%d" % i]) for i in (1, 2, 3) if x["measured_%d" % i] != ""]
            if "pose" in view:
                self.assertEqual(measured, view["pose"]["xyz"])
            elif x["id"] == "":
                self.assertEqual(measured, [])                      # a chain measures nothing but the joints
            else:
                points = next(view[key] for key in ("pixels", "rays", "points") if key in view)
                at = view["ids"].index(int(x["id"])) if "ids" in view else int(x["id"])
                self.assertEqual(measured, points[at])
        # whitened: own noise; together with the joint errors' terms it is chi2
        joints = sum((d / (0.0002 if j == "slide" else 0.0005)) ** 2 for s in r["samples"].values() for j, d in s.get("joint_errors", {}).items())
        total = sum(float(x["whitened"]) ** 2 for x in rows if x["split"] == "train") + joints
        self.assertAlmostEqual(total, r["chi2"], delta=1e-8 * r["chi2"])

    def test_samples_csv(self):
        self.assertEqual(self.calibrate().code, 0)
        r = self.result()
        with open(self.path("out", "samples.csv"), newline="") as f:
            rows = list(csv.DictReader(f))
        with open(self.path("samples.jsonl")) as f:
            samples = [json.loads(line) for line in f if line.strip()]
        self.assertEqual([(x["sample"], x["split"]) for x in rows], [(s["id"], s.get("split", "train")) for s in samples])
        errors = poses = 0
        for x, s in zip(rows, samples):
            readings = {name[8:]: float(value) for name, value in x.items() if name.startswith("reading/") and value != ""}
            self.assertEqual(readings, {j: v for j, v in s["joints"].items() if j in readings})
            self.assertEqual(set(s["joints"]) - set(readings), set())
            estimated = r["samples"].get(s["id"], {})
            self.assertEqual({name[6:]: float(v) for name, v in x.items() if name.startswith("error/") and v != ""}, estimated.get("joint_errors", {}))
            targets = {name.split("/")[1] for name, v in x.items() if name.startswith("target/") and v != ""}
            self.assertEqual(targets, set(estimated.get("targets", {})))
            for t in targets:
                pose = [float(x["target/%s/%s" % (t, n)]) for n in ("x", "y", "z", "qx", "qy", "qz", "qw")]
                self.assertEqual(pose, estimated["targets"][t]["xyz"] + estimated["targets"][t]["quat"])
            errors, poses = errors + len(estimated.get("joint_errors", {})), poses + len(targets)
        self.assertGreater(min(errors, poses), 0)

    def test_loops_csv(self):
        """The points behind the root mean squares of `loops`."""
        self.assertEqual(self.calibrate().code, 0)
        with open(self.path("out", "loops.csv"), newline="") as f:
            rows = list(csv.DictReader(f))
        loops = self.result()["loops"]
        self.assertEqual({(x["from"], x["to"]) for x in rows}, {(l["from"], l["to"]) for l in loops})
        for l in loops:
            part = [x for x in rows if (x["from"], x["to"], x["split"]) == (l["from"], l["to"], "train")]
            self.assertEqual(len(part), l["points"])
            for key, names in (("rms", "xyz"), ("rms_before", ["before_x", "before_y", "before_z"])):
                if part and l[key] is not None:
                    rms = math.sqrt(sum(float(x[n] or 0) ** 2 for x in part for n in names) / len(part))
                    self.assertAlmostEqual(rms, l[key], delta=1e-5 * l[key], msg=str(l))

    def test_covariance_csv(self):
        self.assertEqual(self.calibrate().code, 0)
        r = self.result()
        with open(self.path("out", "covariance.csv"), newline="") as f:
            rows = list(csv.reader(f))
        names, c = rows[0], [[float(x) for x in row] for row in rows[1:]]
        self.assertEqual(len(names), 32)
        self.assertEqual((len(c), {len(row) for row in c}), (32, {32}))
        components = ["x", "y", "z", "rx", "ry", "rz"]
        for i, name in enumerate(names):
            block, _, component = name.partition(".")
            sigma = r["parameters"][block]["sigma"][components.index(component) if component else 0]
            self.assertAlmostEqual(math.sqrt(c[i][i]), sigma, delta=1e-9 * sigma, msg=name)
            for j in range(32):
                self.assertAlmostEqual(c[i][j], c[j][i], delta=1e-12 * math.sqrt(c[i][i] * c[j][j]))

    def test_changes_yaml(self):
        self.assertEqual(self.calibrate().code, 0)
        text = self.read("out", "changes.yaml")
        old, new = read_joints(URDF), read_joints(self.read("out", "robot.urdf"))
        for name in ("lift", "slide", "tool_joint", "follower"):
            m = re.search(r'"?%s"?:\s*\n\s+old: \{xyz: \[(.*?)\], rpy: \[(.*?)\]\}\s*\n\s+new: \{xyz: \[(.*?)\], rpy: \[(.*?)\]\}' % name, text)
            self.assertTrue(m, name)
            numbers = [[float(x) for x in m.group(i).split(",")] for i in range(1, 5)]
            for xyz, rpy, joint in ((numbers[0], numbers[1], old[name]), (numbers[2], numbers[3], new[name])):
                self.assertLess(distance(frame(xyz, rpy), joint["origin"]), 1e-12)
        self.assertNotRegex(text, r'"?turn"?:\s*\n\s+old')
        self.assertNotRegex(text, r'"?caster"?:')
        m = re.search(r'"?turn"?: *\{scale: (.*?), old: (.*?), new: (.*?)\}', text)      # the gear, for its <transmission>
        self.assertAlmostEqual(float(m.group(1)) * float(m.group(3)), -120.5, delta=1e-9)

    def test_robot_urdf(self):
        """Only changed lines differ, and forward kinematics of the written file is the estimated model's, for every link."""
        self.assertEqual(self.calibrate().code, 0)
        r, text = self.result(), self.read("out", "robot.urdf")
        old, new = URDF.splitlines(), text.splitlines()
        self.assertEqual(len(old), len(new))
        changed = [(a, b) for a, b in zip(old, new) if a != b]
        for a, b in changed:
            # only numbers of a line of an origin differ
            shape = lambda x: re.sub(r"[-+]?[0-9.]+(e[-+]?\d+)?", "#", x)
            self.assertEqual(re.sub(r"(#\s*)+", "#", shape(a)), re.sub(r"(#\s*)+", "#", shape(b)))
        self.assertLessEqual(len(changed), 5)
        self.assertGreaterEqual(len(changed), 4)
        joints, written = read_joints(URDF), read_joints(text)
        p = r["parameters"]
        joints["tool_joint"]["origin"] = from_quaternion(**{"xyz": p["joint/tool_joint/origin"]["pose"]["xyz"], "q": p["joint/tool_joint/origin"]["pose"]["quat"]})
        rng = random.Random(5)
        for _ in range(20):
            q = {"turn": rng.uniform(-3, 3), "lift": rng.uniform(-1.2, 1.2), "slide": rng.uniform(0, 0.4)}
            model = dict(q, lift=q["lift"] + p["joint/lift/offset"]["value"][0], slide=q["slide"] + p["joint/slide/offset"]["value"][0])
            for link in ("turret", "upper", "carriage", "tool", "finger", "cart"):
                self.assertLess(distance(link_pose(joints, link, model), link_pose(written, link, q)), 1e-9, link)
        self.assertIn("-120.5", text)

    def test_line_ends_stay(self):
        self.write("robot.urdf", URDF.replace("\n", "\r\n"))
        self.assertEqual(self.calibrate().code, 0)
        text = self.read("out", "robot.urdf")
        self.assertEqual(text.count("\r\n"), URDF.count("\n"))
        self.assertEqual(text.count("\n"), URDF.count("\n"))

    def test_second_calibration(self):
        """From the written rig: the same chi2, the same robot, nothing applied twice."""
        self.assertEqual(self.calibrate().code, 0)
        run = self.calibrate(rig="out/rig.yaml", out="again")
        self.assertEqual(run.code, 0, run.err)
        a, b = self.result(), self.result("again")
        self.assertAlmostEqual(a["chi2"], b["chi2"], delta=1e-9 * a["chi2"])
        self.assertEqual(a["dof"], b["dof"])
        for name, p in b["parameters"].items():
            first = a["parameters"][name]
            for i, v in enumerate(p["value"]):
                if name == "joint/turn/scale":
                    self.assertAlmostEqual(v, first["value"][0], delta=1e-4 * first["sigma"][0])
                elif p["sigma"][i] > 0:
                    self.assertLess(abs(v), 1e-4 * p["sigma"][i], name)
            if "pose" in p:
                self.assertLess(distance(from_quaternion(p["pose"]["xyz"], p["pose"]["quat"]), from_quaternion(first["pose"]["xyz"], first["pose"]["quat"])), 1e-7)
        ja, jb = read_joints(self.read("out", "robot.urdf")), read_joints(self.read("again", "robot.urdf"))
        for link in ("turret", "upper", "carriage", "tool", "finger"):
            q = {"turn": 1, "lift": 0.5, "slide": 0.1}
            self.assertLess(distance(link_pose(ja, link, q), link_pose(jb, link, q)), 1e-7)

    def sensors_equal(self, a, b, msg):
        for name in a:
            for split in ("train", "test"):
                for key in ("points", "rms", "rms_as_read", "rms_rotation"):
                    if key in a[name][split]:
                        x, y = a[name][split][key], b[name][split][key]
                        self.assertAlmostEqual(x, y, delta=1e-6 * abs(x), msg="%s %s %s %s" % (msg, name, split, key))

    def test_evaluate(self):
        self.assertEqual(self.calibrate().code, 0)
        r = self.result()
        run = self.run_kincal("evaluate", "out/rig.yaml", "samples.jsonl", "--json")
        self.assertEqual((run.code, run.err), (0, ""))
        e = strict_json(run.out)
        self.assertEqual(set(e), {"chi2", "dof", "sensors", "warnings"})
        self.assertEqual(e["warnings"], [])
        self.assertEqual(set(e["sensors"]), set(r["sensors"]))
        for s in e["sensors"].values():
            self.assertNotIn("rms_before", s["train"])
        self.sensors_equal(r["sensors"], e["sensors"], "rig")
        # training samples alone, nothing free but boards and joint errors: the result's chi2
        self.write("train.jsonl", lines(s for s in make_samples() if s.get("split") != "test"))
        t = strict_json(self.run_kincal("evaluate", "out/rig.yaml", "train.jsonl", "--json").out)
        self.assertEqual(t["dof"], r["dof"] + 32)
        self.assertAlmostEqual(t["chi2"], r["chi2"], delta=1e-8 * r["chi2"])
        self.assertEqual(e["dof"], t["dof"] + 6 * 15 + 2 * 30)       # all samples: the held-out ones' with theirs
        e = strict_json(self.run_kincal("evaluate", "out/rig.yaml", "samples.jsonl", "--urdf", "out/robot.urdf", "--json").out)
        self.sensors_equal(r["sensors"], e["sensors"], "--urdf")
        # the original robot in its place is worse
        e = strict_json(self.run_kincal("evaluate", "out/rig.yaml", "samples.jsonl", "--urdf", "robot.urdf", "--json").out)
        self.assertGreater(e["sensors"]["tracker"]["train"]["rms"], 5 * r["sensors"]["tracker"]["train"]["rms"])
        self.assertEqual([w["id"] for w in e["warnings"]], ["chi2"])
        self.assertIn("chi2/dof is %.3g" % (e["chi2"] / e["dof"]), e["warnings"][0]["text"])
        run = self.run_kincal("evaluate", "out/rig.yaml", "samples.jsonl", "--urdf", "robot.urdf")
        self.assertEqual((run.code, run.err), (0, "kincal: warning: " + e["warnings"][0]["text"] + "\n"))
        # one sample that is wrong is named
        samples = make_samples()
        view = next(v for v in samples[5]["views"] if v["sensor"] == "tracker")
        view["points"][0][0] += 1
        self.write("wrong.jsonl", lines(samples))
        (said,) = strict_json(self.run_kincal("evaluate", "out/rig.yaml", "wrong.jsonl", "--json").out)["warnings"]
        self.assertRegex(said["text"], "; (100|9[0-9]) % of their squares are those of sample '" + samples[5]["id"] + "'. What to do")
        # an offset in the rig is taken as folded in, a scale stays
        text = self.read("out", "rig.yaml")
        self.assertNotIn("offset:", text)
        self.assertRegex(text, r"turn: *\{.*scale: 1\.0")
        with_offset = re.sub(r"(turn: *\{)", r"\1offset: 0.3, ", text)
        self.write("out/with_offset.yaml", with_offset)
        e = strict_json(self.run_kincal("evaluate", "out/with_offset.yaml", "samples.jsonl", "--urdf", "out/robot.urdf", "--json").out)
        self.sensors_equal(r["sensors"], e["sensors"], "--urdf with offset")
        table = self.run_kincal("evaluate", "out/rig.yaml", "samples.jsonl")
        self.assertEqual(table.code, 0)
        for word in ("tracker", "mocap", "eye", "px", "chi2"):
            self.assertIn(word, table.out)

    def test_options_without_effect(self):
        """A pattern that changes nothing is a warning with its reason; one that changes something is not."""
        def said(*args):
            code = self.calibrate("--force", *args).code
            self.assertIn(code, (0, 2))
            return [w["text"] for w in self.result()["warnings"] if w["id"] == "no_effect"]
        self.assertEqual(said("--fix", "joint/lift/offset"), [])
        self.assertEqual(said(), [])
        (text,) = said("--free", "joint/lift/offset")
        self.assertEqual(text, "--free 'joint/lift/offset' changes nothing: it is free in step 'all' anyway")
        (text,) = said("--fix", "joint/lift/scale", "--fix", "joint/lift/offset")
        self.assertEqual(text, "--fix 'joint/lift/scale' changes nothing: it is not free in step 'all' anyway")
        (text,) = said("--free", "sensor/*/baselin[e]", "--step", "eyes", "--fix", "sensor/*/baseline")
        self.assertIn("--free 'sensor/*/baselin[e]' changes nothing: no measurement of step 'eyes' depends on it, or --fix holds it", text)
        run = self.run_kincal("calibrate", "rig.yaml", "samples.jsonl", "--dry-run", "--free", "joint/lift/offset")
        self.assertIn("warning: --free 'joint/lift/offset' changes nothing", run.out)
        run = self.run_kincal("evaluate", "out/rig.yaml", "samples.jsonl", "--json", "--free", "joint/follower/origi*")
        self.assertEqual([w["id"] for w in strict_json(run.out)["warnings"]], ["chi2", "no_effect"])
        self.assertIn("'joint/follower/origi*' has no effect", run.err)

    def test_evaluate_free(self):
        """--free is estimated in each split by itself."""
        e0 = strict_json(self.run_kincal("evaluate", "rig.yaml", "samples.jsonl", "--json").out)
        run = self.run_kincal("evaluate", "rig.yaml", "samples.jsonl", "--json", "--free", "sensor/mocap/pose", "--free", "sensor/tracker/pose")
        self.assertEqual(run.code, 0)
        self.assertRegex(run.err, r"^kincal: warning: chi2/dof is 88\.3: [^\n]*\n$")  # the rig's own values are off
        e1 = strict_json(run.out)
        self.assertLess(e1["chi2"], e0["chi2"])
        self.assertEqual(e1["dof"], e0["dof"] - 2 * 12)
        for split in ("train", "test"):
            self.assertLess(e1["sensors"]["mocap"][split]["rms"], e0["sensors"]["mocap"][split]["rms"])

    def test_apply(self):
        self.assertEqual(self.calibrate().code, 0)
        copy = URDF.replace("<link name=\"tool\"/>", "<!-- the user's own remark -->\n\n  <link name=\"tool\"/>\n\n").replace("  <joint name=\"lift\"", "\n\t<joint   name=\"lift\"")
        self.write("copy.urdf", copy)
        run = self.run_kincal("apply", "out", "copy.urdf", "--out", "copy_calibrated.urdf")
        self.assertEqual(run.code, 0, run.err)
        text = self.read("copy_calibrated.urdf")
        self.assertIn("the user's own remark", text)
        a, b = read_joints(self.read("out", "robot.urdf")), read_joints(text)
        for name in a:
            self.assertLess(distance(a[name]["origin"], b[name]["origin"]), 1e-12, name)
        self.assertEqual(len(copy.splitlines()), len(text.splitlines()))
        # a follower that the calibrated robot does not have would be left where its master's zero was
        follower = '<link name="rod"/><joint name="rod_joint" type="revolute"><parent link="tool"/><child link="rod"/><limit effort="1" velocity="1"/><mimic joint="lift"/></joint>'
        self.write("more.urdf", URDF.replace("</robot>", follower + "</robot>"))
        run = self.run_kincal("apply", "out", "more.urdf", "--out", "more_calibrated.urdf")
        self.assertEqual(run.code, 1)
        self.assertIn("joint 'rod_joint' is not one of the calibrated robot and follows joint 'lift'", run.err)
        os.remove(self.path("more.urdf"))
        # a result in doubts is applied, with a word
        result = json.loads(self.read("out", "result.json"))
        result.update(chi2=5400, dof=100, verdict={"use": "doubts", "text": "converged, but look here"})
        os.makedirs(self.path("doubted"))
        self.write("doubted/result.json", json.dumps(result))
        run = self.run_kincal("apply", "doubted", "copy.urdf", "--out", "doubted.urdf")
        self.assertEqual((run.code, run.err), (0, "kincal: warning: doubted/result.json: its verdict is 'doubts' (chi2/dof 54): converged, but look here\n"))
        # the result's directory or its result.json; for the same copy the same numbers (to the last digits: result.json holds quaternions)
        self.assertEqual(self.run_kincal("apply", "out/result.json", "robot.urdf", "--out", "same.urdf").code, 0)
        b = read_joints(self.read("same.urdf"))
        for name in a:
            self.assertLess(distance(a[name]["origin"], b[name]["origin"]), 1e-12, name)
        same = [x == y for x, y in zip(self.read("same.urdf").splitlines(), URDF.splitlines())]
        written = [x == y for x, y in zip(self.read("out", "robot.urdf").splitlines(), URDF.splitlines())]
        self.assertEqual(same, written)
        # numbers written in another way, origin given as zero where it was absent
        other = URDF.replace("xyz='0.3 0 0'", "xyz='3e-1 0.0 0.' rpy='0 0 0'").replace('xyz="0.1 0.02 0"', 'xyz="0.10 0.02 0.0"')
        self.write("other.urdf", other)
        run = self.run_kincal("apply", "out", "other.urdf", "--out", "other_calibrated.urdf")
        self.assertEqual(run.code, 0, run.err)
        self.extra = set(os.listdir(self.dir))
        before = self.read("same.urdf")
        self.fails(self.run_kincal("apply", "out", "robot.urdf", "--out", "same.urdf"), "same.urdf", "--force")
        self.assertEqual(self.read("same.urdf"), before)
        self.fails(self.run_kincal("apply", "out", "copy_calibrated.urdf", "--out", "twice.urdf"), "already")
        self.fails(self.run_kincal("apply", "out", "out/robot.urdf", "--out", "twice.urdf"), "already")
        for old, new, words in ((' xyz="0.1   0\n      0.2"', ' xyz="0.1   0\n      0.25"', ["lift"]), ("'slide'", "'slyde'", ["slide"]),
                                ('<axis xyz="0 0 -2"/>', '<axis xyz="0 1 0"/>', ["lift"]), ('multiplier="-0.5"', 'multiplier="0.5"', ["follower"])):
            self.assertIn(old, URDF)
            text = URDF.replace(old, new).replace('joint="slide"', 'joint="slyde"') if "slyde" in new else URDF.replace(old, new)
            self.write("alien.urdf", text)
            self.extra.add("alien.urdf")
            with self.subTest(alien=new):
                run = self.run_kincal("apply", "out", "alien.urdf", "--out", "alien_calibrated.urdf")
                if run.code == 0:
                    os.remove(self.path("alien_calibrated.urdf"))
                self.fails(run, "alien.urdf", *words)
        self.fails(self.run_kincal("apply", "nowhere", "robot.urdf", "--out", "new.urdf"), "nowhere")
        self.fails(self.run_kincal("apply", "rig.yaml", "robot.urdf", "--out", "new.urdf"), "rig.yaml")
        self.fails(self.run_kincal("apply", "out", "none.urdf", "--out", "new.urdf"), "none.urdf")

    def test_write_reduction(self):
        run = self.calibrate("--tables")
        self.assertEqual(run.code, 0)
        scale = self.result()["parameters"]["joint/turn/scale"]["value"][0]
        reduction = -120.5 / scale
        self.assertIn("-120.5", self.read("out", "robot.urdf"))
        self.assertIn("%.3f" % reduction, run.out)                                    # printed, and in result.json
        text = json.dumps(self.result())
        self.assertTrue(any(abs(float(x) - reduction) < 1e-9 for x in re.findall(r"-\d+\.\d+", text)), "reduction not in result.json")
        self.assertEqual(self.calibrate("--write-reduction", out="geared").code, 0)
        m = re.search(r"<mechanicalReduction>(.*?)</mechanicalReduction>", self.read("geared", "robot.urdf"))
        self.assertAlmostEqual(float(m.group(1)), reduction, delta=1e-12)
        rig = self.read("geared", "rig.yaml")
        self.assertNotRegex(rig, r"scale: *1\.0[0-9]")
        # logs recorded from then on have readings scaled by the new gear: readings * scale
        samples = make_samples()
        for s in samples:
            s["joints"]["turn"] *= scale
        self.write("later.jsonl", lines(samples))
        a = strict_json(self.run_kincal("evaluate", "out/rig.yaml", "samples.jsonl", "--json").out)["sensors"]
        b = strict_json(self.run_kincal("evaluate", "geared/rig.yaml", "later.jsonl", "--json").out)["sensors"]
        for name in a:
            self.assertAlmostEqual(a[name]["train"]["rms_as_read"], b[name]["train"]["rms_as_read"], delta=1e-6 * a[name]["train"]["rms_as_read"])

    def test_json_and_quiet(self):
        run = self.calibrate("--json")
        self.assertEqual((run.code, run.err), (0, ""))
        self.assertEqual(run.out, self.read("out", "result.json"))
        strict_json(run.out)
        run = self.calibrate("--quiet", out="silent")
        self.assertEqual((run.code, run.out, run.err), (0, "", ""))
        self.assertEqual(sorted(os.listdir(self.path("silent"))), FILES)

    def test_tables(self):
        run = self.calibrate("--tables")
        self.assertEqual(run.code, 0)
        for word in ("eyes", "all", "tracker", "mocap", "eye", "px", "mm", "mrad", "before", "after", "train", "held out", "sigma", "chi2/dof",
                     "joint/turn/scale", "sensor/tracker/pose", "out"):
            self.assertIn(word, run.out + run.err)
        self.assertNotIn("\x1b", run.out + run.err)     # piped: plain lines
        self.assertNotIn("\r", run.out + run.err)

    def test_loops(self):
        run = self.calibrate("--tables")
        self.assertIn("Loops", run.out)
        sensors = self.result()["sensors"]
        loops = self.result()["loops"]
        pairs = [(loop["from"], loop["to"]) for loop in loops]
        self.assertEqual(len(set(pairs)), len(pairs))
        for loop in loops:
            self.assertEqual(set(loop) - {"test"}, {"from", "to", "unit", "points", "rms_before", "rms"})
            self.assertEqual(loop["unit"], sensors[loop["to"]]["unit"])
            self.assertIn((loop["to"], loop["from"]), pairs)  # here every sensor has points, and all are seen
            self.assertGreater(loop["points"], 0)
            self.assertLess(loop["rms"], loop["rms_before"])
            self.assertGreaterEqual(loop["rms"], 0.2 * sensors[loop["to"]]["train"]["rms"])  # noise of both is in it
        self.assertNotIn("Loops", self.calibrate("--no-report", "--force").out)
        self.assertNotIn("loops", self.result())

    def test_restarts(self):
        run = self.calibrate("--restarts", "3")
        self.assertRegex(run.out, r"3 of 3 end in this minimum")
        r = self.result()
        self.assertEqual(r["restarts"], {"count": 3, "failed": 0, "not_converged": 0, "minima": [{"cost": r["cost"], "chi2": r["chi2"], "count": 3, "differs": {}}]})
        plain = self.calibrate("--force")
        self.assertEqual(plain.code, 0, plain.err)
        self.assertNotIn("restarts", self.result())
        self.assertEqual(self.result()["parameters"], r["parameters"])
        for wrong in ("0", "-1", "many"):
            self.assertEqual(self.run_kincal("calibrate", "rig.yaml", "samples.jsonl", "--out", "other", "--restarts", wrong).code, 1)

    def test_dry_run(self):
        run = self.run_kincal("calibrate", "rig.yaml", "samples.jsonl", "--dry-run")
        self.assertEqual((run.code, run.err), (0, ""))
        self.assertEqual(set(os.listdir(self.dir)), {"rig.yaml", "robot.urdf", "samples.jsonl"})
        self.assertEqual(self.calibrate().code, 0)
        for s in self.result()["steps"]:
            self.assertIn(s["step"], run.out)
            self.assertRegex(run.out, r"\b%d\b" % s["dof"])
        for name in ("sensor/tracker/pose", "joint/turn/scale", "joint/lift/offset", "target/plate/pose", "joint/tool_joint/origin"):
            self.assertIn(name, run.out)
        self.assertRegex(run.out, r"\b32\b")
        before = sorted(os.listdir(self.path("out")))
        self.assertEqual(self.calibrate("--dry-run").code, 0)       # an existing --out does not matter: nothing is written
        self.assertEqual(sorted(os.listdir(self.path("out"))), before)
        run = self.run_kincal("calibrate", "rig.yaml", "samples.jsonl", "--dry-run", "--step", "eyes", "--free", "sensor/eye/intrinsics")
        self.assertEqual(run.code, 0)
        self.assertIn("sensor/eye/intrinsics", run.out)
        self.assertNotIn("joint/turn/scale", run.out)

    def test_step_free_fix(self):
        self.assertEqual(self.calibrate("--step", "eyes", out="eyes").code, 0)
        r = self.result("eyes")
        self.assertEqual([s["step"] for s in r["steps"]], ["eyes"])
        self.assertEqual(set(r["parameters"]), {"sensor/tracker/pose", "sensor/eye/pose"})
        self.assertEqual(self.calibrate("--step", "all", out="all").code, 0)
        self.assertEqual(len(self.result("all")["steps"]), 2)
        # --free and --fix: the last step that runs
        # What is held here is far from the truth: the model does not explain the data any more.
        self.assertEqual(self.calibrate("--free", "sensor/eye/intrinsics", "--fix", "sensor/mocap/pose", "--fix", "joint/lift/*", out="mixed").code, 5)
        r = self.result("mixed")
        self.assertIn("sensor/eye/intrinsics", r["parameters"])
        self.assertEqual(len(r["parameters"]["sensor/eye/intrinsics"]["value"]), 4)
        self.assertEqual(r["parameters"]["sensor/eye/intrinsics"]["initial"], [500, 500, 320, 240])
        for name in ("sensor/mocap/pose", "joint/lift/offset"):
            self.assertNotIn(name, r["parameters"])
        self.assertEqual([s["dof"] for s in r["steps"]][0], [s["dof"] for s in self.result("eyes")["steps"]][0])
        # fixed in the last step, freed in the first: keeps the first's value and sigma
        self.assertEqual(self.calibrate("--fix", "sensor/eye/pose", out="kept").code, 0)
        a, b = self.result("eyes")["parameters"]["sensor/eye/pose"], self.result("kept")["parameters"]["sensor/eye/pose"]
        self.assertEqual((a["value"], a["sigma"], b["step"]), (b["value"], b["sigma"], "eyes"))
        # one component
        self.assertEqual(self.calibrate("--fix", "sensor/eye/pose.rz", out="component").code, 0)
        p = self.result("component")["parameters"]["sensor/eye/pose"]
        self.assertAlmostEqual(p["value"][5], a["value"][5], delta=1e-14)

    def test_noise_modes(self):
        dof = {}
        for mode in ("latent", "marginal", "point", "none"):
            self.assertEqual(self.calibrate("--noise", mode, out=mode).code, 0)
            r = self.result(mode)
            self.assertEqual(r["noise"], mode)
            dof[mode] = r["dof"]
        self.assertEqual(len(set(dof.values())), 1)

    def test_unused_and_held_out(self):
        """A glob leaves out what nothing depends on; a mounted target that only held-out samples see is `held_out`."""
        text = RIG.replace("free: [sensor/tracker/pose, sensor/eye/pose]", 'free: [sensor/tracker/pose, sensor/eye/pose, "joint/*/offset"]')
        self.write("rig.yaml", text)
        self.assertEqual(self.calibrate("--step", "eyes", "--fix", "joint/t*", "--fix", "joint/slide/*").code, 0)
        self.assertEqual(self.result()["steps"][0]["unused"], [])
        # the tracker alone on the arm: with boards only nothing depends on joints
        samples = [s for s in make_samples() if s["id"].startswith("board")]
        self.write("boards.jsonl", lines(samples))
        self.assertEqual(self.calibrate("--step", "eyes", "--fix", "sensor/tracker/pose", samples="boards.jsonl", out="boards").code, 0)
        self.assertEqual(set(self.result("boards")["steps"][0]["unused"]), {"joint/turn/offset", "joint/lift/offset", "joint/slide/offset"})
        text = RIG.replace("  plate:\n", "  spare:\n    type: points\n    points: [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]\n    mount: {link: base_link, pose: {xyz: [1, 0, 0], rpy: [0, 0, 0]}}\n  plate:\n")
        text = text.replace("target/plate/pose, joint", "target/plate/pose, target/spare/pose, joint")
        self.write("rig.yaml", text)
        samples = make_samples()
        t = mul(inverse(mul(frame([0.5, -2.0, 0.3], [0, 0, 1.2]), twist(TRUTH["tracker"]))), frame([1.1, 0.2, 0.05], [0.1, 0, 0.3]))
        samples.append({"id": "spare", "joints": {}, "split": "test",
                        "views": [{"sensor": "tracker", "target": "spare", "points": [move(t, p) for p in ([0, 0, 0], [0.1, 0, 0], [0, 0.1, 0])]}]})
        self.write("samples.jsonl", lines(samples))
        run = self.calibrate(out="spare")
        self.assertEqual(run.code, 0, run.err)
        r = self.result("spare")
        self.assertEqual(r["steps"][-1]["held_out"], ["target/spare/pose"])
        # the same by --free: listed and estimated
        self.write("rig.yaml", text.replace("target/plate/pose, target/spare/pose, joint", "target/plate/pose, joint"))
        run = self.calibrate("--free", "target/spare/pose", out="by_free")
        self.assertEqual((run.code, "has no effect" in run.out), (0, False), run.err)
        self.assertEqual(self.result("by_free")["steps"][-1]["held_out"], ["target/spare/pose"])
        self.assertEqual(self.result("by_free")["sensors"]["tracker"]["test"], r["sensors"]["tracker"]["test"])
        # held again by --fix: neither
        run = self.calibrate("--free", "target/spare/pose", "--fix", "target/spare/pose", out="by_fix")
        self.assertEqual(self.result("by_fix")["steps"][-1]["held_out"], [])
        self.assertGreater(self.result("by_fix")["sensors"]["tracker"]["test"]["rms"], 0.01)
        self.assertEqual(r["unobservable"], [])
        self.assertLess(r["sensors"]["tracker"]["test"]["rms"], 0.001)


def distance(a, b):
    e = mul(inverse(a), b)
    return max([abs(e[i][3]) for i in range(3)] + [abs(x) for x in log_rotation(e)] + [abs(a[i][j] - b[i][j]) for i in range(3) for j in range(3)])


class ExitCodes(Case):
    def test_planted_gauge(self):
        """The turntable's offset and the two instruments' poses: one direction, named with its coefficients; exit code 2; results written."""
        run = self.calibrate("--free", "joint/turn/offset", "--fix", "sensor/eye/pose")
        base = self.calibrate("--fix", "sensor/eye/pose", out="base")
        self.assertEqual(base.code, 0)
        self.assertEqual(run.code, 0, "eye holds the base: no gauge\n" + run.out)
        shutil.rmtree(self.path("out"))
        run = self.calibrate("--free", "joint/turn/offset")
        self.assertEqual(run.code, 2, run.out + run.err)
        self.assertEqual(sorted(os.listdir(self.path("out"))), FILES)
        r = self.result()
        self.assertEqual(r["status"], "unobservable")
        self.assertEqual(len(r["unobservable"]), 1)
        self.assertEqual(r["steps"][-1]["unobservable"], r["unobservable"])
        d = r["unobservable"][0]
        self.assertIn("joint/turn/offset", d)
        scale = d["joint/turn/offset"]
        # rotating the turntable's zero by a is rotating every instrument on the base by a about its axis: xi = Ad(base_T_sensor^-1) [0 0 0 0 0 a]
        for sensor in ("tracker", "mocap", "eye"):
            pose = r["parameters"]["sensor/%s/pose" % sensor]["pose"]
            t = from_quaternion(pose["xyz"], pose["quat"])
            w = [t[2][k] for k in range(3)]
            v = [sum(t[i][k] * c for i, c in enumerate((-t[1][3], t[0][3], 0.0))) for k in range(3)]
            expected = dict(zip(["x", "y", "z", "rx", "ry", "rz"], v + w))
            for c, e in expected.items():
                got = d.get("sensor/%s/pose.%s" % (sensor, c), 0.0) / scale
                self.assertAlmostEqual(abs(got), abs(e), delta=0.05 * max(1.0, abs(e)), msg="%s.%s" % (sensor, c))
        # the files are marked, and `apply` does not take such a result without --force
        for name in ("rig.yaml", "changes.yaml"):
            self.assertTrue(self.read("out", name).startswith("# kincal: status unobservable"), name)
        self.extra = {"out", "base"}
        self.fails(self.run_kincal("apply", "out", "robot.urdf", "--out", "applied.urdf"), "unobservable", "--force")
        self.assertEqual(self.run_kincal("apply", "out", "robot.urdf", "--out", "applied.urdf", "--force").code, 0)
        # sigmas of all that takes part are null; the others' as without the gauge
        self.assertEqual(r["parameters"]["joint/turn/offset"]["sigma"], [None])
        self.assertIsNone(r["parameters"]["sensor/tracker/pose"]["sigma"][0])
        # covariance.csv has nothing in their rows and columns, and `diff` says that it knows nothing
        with open(self.path("out", "covariance.csv"), newline="") as f:
            names, *c = list(csv.reader(f))
        components = ["x", "y", "z", "rx", "ry", "rz"]
        known = []
        for name in names:
            block, _, component = name.partition(".")
            known.append(r["parameters"][block]["sigma"][components.index(component) if component else 0] is not None)
        self.assertTrue(any(known) and not all(known))
        self.assertEqual([[x != "" for x in row] for row in c], [[a and b for b in known] for a in known])
        text = self.run_kincal("diff", "out", "base", "--frame", "sensor/tracker")
        self.assertEqual(text.code, 0, text.err)
        self.assertRegex(text.out, r"joint/turn/offset .* not determined +-\n")
        self.assertRegex(text.out, r"sensor/tracker +mm .* not determined +-\n")
        # a prior on it, however wide, holds the gauge
        with open(self.path("rig.yaml")) as f:
            rig = f.read()
        for width in ("1e-6", "0.01", "10"):
            with open(self.path("prior.yaml"), "w") as f:
                f.write(rig.replace("joint/turn/scale,", "joint/turn/scale, joint/turn/offset,").rstrip("\n") + "\n    priors: {joint/turn/offset: %s}\n" % width)
            run = self.run_kincal("calibrate", "prior.yaml", "samples.jsonl", "--out", "held", "--force")
            self.assertEqual(run.code, 0, run.out + run.err)
            held = self.result("held")
            self.assertAlmostEqual(held["parameters"]["joint/turn/offset"]["sigma"][0], float(width), delta=1e-4 * float(width))
            self.assertAlmostEqual(held["chi2_data"], held["chi2"], delta=1e-6 * held["chi2"])
            self.assertAlmostEqual(held["dof_data"], held["dof"], delta=1e-3)
        self.extra |= {"prior.yaml", "held"}
        lift = r["parameters"]["joint/lift/offset"]["sigma"][0]
        self.assertIsNotNone(lift)
        whole = self.calibrate(out="whole")
        self.assertEqual(whole.code, 0)
        w = self.result("whole")
        self.assertAlmostEqual(lift, w["parameters"]["joint/lift/offset"]["sigma"][0], delta=1e-4 * lift)
        self.assertAlmostEqual(r["chi2"], w["chi2"], delta=1e-7 * w["chi2"])
        self.assertEqual(r["dof"], w["dof"])
        for text in (run.out + run.err, " ".join(x["text"] for x in r["warnings"]) or run.out):
            self.assertIn("joint/turn/offset", text)
        # a second one, independent: both named apart
        run = self.calibrate("--free", "joint/turn/offset", "--free", "joint/tool_joint/origin.z", "--force")
        self.assertEqual(run.code, 2)
        r = self.result()
        self.assertEqual(len(r["unobservable"]), 2)
        gauge = [d for d in r["unobservable"] if "joint/slide/offset" in d]
        self.assertEqual(len(gauge), 1)
        self.assertNotIn("joint/turn/offset", gauge[0])
        # --quiet and --json end with 2 as well
        self.assertEqual(self.calibrate("--free", "joint/turn/offset", "--quiet", out="q").code, 2)
        self.assertEqual(self.calibrate("--free", "joint/turn/offset", "--json", out="j").code, 2)

    def test_without_data(self):
        """A plain name is freed though nothing depends on it: unobservable, named."""
        run = self.calibrate("--step", "eyes", "--free", "sensor/mocap/pose.x")
        self.assertEqual(run.code, 2, run.out + run.err)
        r = self.result()
        self.assertEqual(r["unobservable"], [{"sensor/mocap/pose.x": 1.0}])
        self.assertIsNone(r["parameters"]["sensor/mocap/pose"]["sigma"][0])
        self.assertEqual(r["parameters"]["sensor/mocap/pose"]["value"], [0.0] * 6)

    def test_not_converged(self):
        """Noise that is absurd (a radian a reading) and renewed at every turn: some of these do not settle in the iterations allowed."""
        for sigma, mode in (("1", "marginal"), ("0.3", "point"), ("100", "marginal"), ("30", "marginal"), ("0.5", "point")):
            self.write("rig.yaml", RIG.replace('"*": {sigma: 0.0005}', '"*": {sigma: %s}' % sigma).replace("slide: {sigma: 0.0002}", "slide: {sigma: %s}" % sigma))
            run = self.calibrate("--noise", mode, "--force", "--tables")
            self.assertIn(run.code, (0, 2, 3))
            if run.code == 3:
                break
        else:
            self.skipTest("everything converged")
        r = self.result()
        self.assertEqual(r["status"], "not_converged")
        self.assertIn("not_converged", [s["status"] for s in r["steps"]])
        self.assertEqual(sorted(os.listdir(self.path("out"))), FILES)
        self.assertIn("not_converged", [w["id"] for w in r["warnings"]])
        self.assertIn("converge", run.out + run.err)
        self.assertIn("Residuals (rms; a step did not converge)", run.out)

    def test_evaluate_not_converged(self):
        """The same of evaluate: the table says which of its numbers are not final."""
        free = [word for name in re.search(r"step: all\n +free: \[(.*?)\]", RIG, re.S).group(1).split(",") for word in ("--free", name.strip())]
        for sigma, mode in (("100", "marginal"), ("0.3", "point"), ("30", "marginal"), ("1", "marginal")):
            self.write("rig.yaml", RIG.replace('"*": {sigma: 0.0005}', '"*": {sigma: %s}' % sigma).replace("slide: {sigma: 0.0002}", "slide: {sigma: %s}" % sigma))
            run = self.run_kincal("evaluate", "rig.yaml", "samples.jsonl", "--noise", mode, *free)
            self.assertIn(run.code, (0, 3))
            self.assertEqual(run.code == 3, "not converged: rms" in run.out)
            self.assertEqual(run.code == 3, "did not converge" in run.err)
            if run.code == 3:
                self.assertRegex(run.out, r"not converged: rms\w* of (training|held-out data), in \d+ samples?, first '")
                return
        self.skipTest("everything converged")


class Simulate(Case):
    spread = ["--spread", "joint/lift/offset=0.01", "--spread", "joint/turn/scale=0.01", "--spread", "sensor/*/pose=0.01"]

    def simulate(self, out, *args, seed="1", samples="40"):
        return self.run_kincal("simulate", "rig.yaml", "--samples", samples, "--seed", seed, "--out", out, *args)

    def test_and_calibrate(self):
        """What is simulated is calibrated: chi2/dof near 1, truth within its sigmas."""
        self.assertEqual(self.simulate("sim", *self.spread).code, 0)
        self.assertEqual(sorted(os.listdir(self.path("sim"))), ["samples.jsonl", "truth.json"])
        samples = [strict_json(x) for x in self.read("sim", "samples.jsonl").splitlines()]
        self.assertEqual(len(samples), 40)
        self.assertEqual(len({s["id"] for s in samples}), 40)
        for s in samples:                                   # within the limits
            self.assertTrue(-1.21 < s["joints"]["lift"] < 1.21 and -0.01 < s["joints"]["slide"] < 0.41)
        truth = strict_json(self.read("sim", "truth.json"))["parameters"]
        names = ["joint/lift/offset", "joint/turn/scale"] + ["sensor/%s/pose.%s" % (s, c) for s in ("tracker", "mocap", "eye") for c in ("x", "y", "z", "rx", "ry", "rz")]
        self.assertEqual(set(truth), set(names))
        run = self.calibrate(samples="sim/samples.jsonl")
        self.assertEqual(run.code, 0, run.err)
        r = self.result()
        self.assertTrue(0.8 < r["chi2"] / r["dof"] < 1.2, r["chi2"] / r["dof"])
        errors = []
        for name in names:
            block, _, c = name.partition(".")
            p, i = r["parameters"][block], ["x", "y", "z", "rx", "ry", "rz"].index(c) if c else 0
            errors.append(((p["value"][i] - truth[name]["true"]) / p["sigma"][i]) ** 2)
        self.assertLess(max(errors), 25)
        self.assertTrue(0.2 < sum(errors) / len(errors) < 3)
        # diff with truth.json shows the same, and what the calibration did not estimate.
        run = self.run_kincal("diff", "out", "sim/truth.json", "--json")
        self.assertEqual((run.code, run.err), (0, ""))
        shown, squares = strict_json(run.out), []
        for name in names:
            block, _, c = name.partition(".")
            p, d, i = r["parameters"][block], shown["parameters"][block], ["x", "y", "z", "rx", "ry", "rz"].index(c) if c else 0
            self.assertAlmostEqual(d["difference"][i], p["value"][i] - truth[name]["true"], delta=1e-4 if c else 1e-12, msg=name)
            self.assertAlmostEqual(d["sigma"][i], p["sigma"][i], delta=1e-12)
        for name, d in shown["parameters"].items():
            squares += [s * s for s in d["in_sigmas"] if s is not None]
        self.assertEqual(shown["errors"]["estimated"]["components"], len(squares))
        self.assertAlmostEqual(shown["errors"]["estimated"]["rms_in_sigmas"], math.sqrt(sum(squares) / len(squares)), delta=1e-9)
        self.assertEqual(shown["errors"]["held"]["components"], 0)
        text = self.run_kincal("diff", "out", "sim/truth.json").out
        self.assertIn("  rms %.2f, largest %.2f, of %d components that were estimated" % (math.sqrt(sum(squares) / len(squares)), math.sqrt(max(squares)), len(squares)), text)
        self.assertRegex(text, r"parameter +unit +true +estimated +error +sigma +in sigmas")
        self.assertNotIn("not estimated, but not true", text)
        self.assertIn(self.calibrate("--fix", "joint/lift/offset", samples="sim/samples.jsonl", out="fixed").code, (0, 5))
        self.assertIn("not estimated, but not true: joint/lift/offset.", self.run_kincal("diff", "fixed", "sim/truth.json").out)

    def test_errors_of_new_poses(self):
        """A rig without the pose of a sensor: the result has a new value, no change; its error counts from the pose in truth.json, not from increments."""
        self.assertEqual(self.simulate("sim", *self.spread).code, 0)
        given = "    pose: {xyz: [0.5, -2.0, 0.3], rpy: [0, 0, 1.2]}\n"
        self.write("rig.yaml", RIG.replace(given, "").replace("sensor/tracker/pose, ", "sensor/tracker/pose, "))
        self.assertEqual(self.calibrate(samples="sim/samples.jsonl").code, 0)
        result = self.result()["parameters"]
        self.assertEqual([name for name, p in result.items() if p.get("nominal") is False], ["sensor/tracker/pose"])
        shown = self.run_kincal("show", "out").out
        self.assertNotIn("sensor/tracker/pose", shown.split("Largest changes")[1].split("\n\n")[0])
        new = shown.split("New, because the rig has no value")[1].split("\n\n")[0].split("\n")
        self.assertEqual(new[1].split()[:5], ["sensor/tracker/pose", "xyz"] + ["%.2f" % (1e3 * x) for x in result["sensor/tracker/pose"]["pose"]["xyz"]])
        self.assertEqual((new[2].split()[0], len(new)), ("rpy", 3))
        d = strict_json(self.run_kincal("diff", "out", "sim/truth.json", "--json").out)
        self.assertLess(max(map(abs, d["parameters"]["sensor/tracker/pose"]["in_sigmas"])), 5)
        # `values` give simulate the pose, too.
        truth = strict_json(self.read("sim", "truth.json"))
        self.assertEqual(self.simulate("again", "--truth", "sim/truth.json").code, 0)
        again = strict_json(self.read("again", "truth.json"))
        for key in ("xyz", "quat"):
            for x, y in zip(truth["values"]["sensor/tracker/pose"][key], again["values"]["sensor/tracker/pose"][key]):
                self.assertAlmostEqual(x, y, delta=1e-12)
        for values, words in (({"sensor/tracker/pos": {}}, ["sensor/tracker/pos", "nearest"]), ({"sensor/eye/intrinsics": [1, 2]}, ["values.sensor/eye/intrinsics"]),
                              ({"sensor/tracker/pose": [0, 0, 0]}, ["values.sensor/tracker/pose"])):
            self.extra = {"sim", "again", "out", "wrong.json"}
            self.write("wrong.json", json.dumps({"parameters": {}, "values": values}))
            self.fails(self.simulate("never", "--truth", "wrong.json"), *words)

    def test_seeds(self):
        for out, seed in (("a", "1"), ("b", "1"), ("c", "2")):
            self.assertEqual(self.simulate(out, *self.spread, seed=seed).code, 0)
        for f in ("samples.jsonl", "truth.json"):
            self.assertEqual(self.read("a", f), self.read("b", f))
            self.assertNotEqual(self.read("a", f), self.read("c", f))

    def test_truth(self):
        """A given truth comes back in truth.json; another seed, the same truth."""
        self.write("truth.json", json.dumps({"parameters": {"joint/lift/offset": 0.02, "sensor/tracker/pose": [0.01, 0, 0, 0, 0.02, 0]}}))
        self.assertEqual(self.simulate("sim", "--truth", "truth.json").code, 0)
        truth = {k: v["true"] for k, v in strict_json(self.read("sim", "truth.json"))["parameters"].items()}
        given = {"joint/lift/offset": 0.02, "sensor/tracker/pose.x": 0.01, "sensor/tracker/pose.ry": 0.02}
        for name in set(truth) | set(given):
            self.assertAlmostEqual(truth.get(name, 0.0), given.get(name, 0.0), delta=1e-14, msg=name)
        self.assertEqual(self.simulate("again", "--truth", "sim/truth.json").code, 0)
        a, b = ([float(x) for x in re.findall(r"-?\d+\.\d+(?:e[-+]\d+)?", self.read(d, "samples.jsonl"))] for d in ("sim", "again"))
        self.assertEqual(len(a), len(b))
        self.assertLess(max(abs(x - y) for x, y in zip(a, b)), 1e-9)

    def test_postures(self):
        self.write("postures.jsonl", '{"id": "p0", "joints": {"turn": 0.1, "lift": 0.2, "slide": 0.3}, "views": [{"sensor": "tracker", "target": "reflectors"}]}\n'
                                     '{"id": "p1", "joints": {"turn": 0.5, "lift": -0.2, "slide": 0.1}, "views": [{"sensor": "mocap", "target": "plate"}]}\n')
        run = self.simulate("sim", "--postures", "postures.jsonl", samples="2")
        self.assertEqual(run.code, 0, run.err)
        samples = [strict_json(x) for x in self.read("sim", "samples.jsonl").splitlines()]
        self.assertEqual([[v["sensor"] for v in s["views"]] for s in samples], [["tracker"], ["mocap"]])
        self.assertAlmostEqual(samples[0]["joints"]["turn"], 0.1, delta=0.004)

    def test_open_pose(self):
        """A pose that is absent and that a step frees wholly is never the identity without a word."""
        given = "    pose: {xyz: [0.5, -2.0, 0.3], rpy: [0, 0, 1.2]}\n"
        self.assertIn(given, RIG)
        self.write("rig.yaml", RIG.replace(given, "")[:RIG.replace(given, "").index("estimate:")])
        self.fails(self.simulate("sim"), "sensor/tracker/pose", "sensors.tracker.pose", "--truth", "--spread")
        self.fails(self.simulate("sim", "--spread", "sensor/tracker/pose=0.01"), "target/reflectors/pose", "targets.reflectors.mount.pose")
        self.assertEqual(self.simulate("sim", "--spread", "*/pose=0.01").code, 0)
        run = self.run_kincal("evaluate", "rig.yaml", "samples.jsonl", "--json")
        self.assertEqual(run.code, 0, run.err)
        self.assertIn("sensor/tracker/pose is missing in the rig", run.err)
        self.write("rig.yaml", RIG)
        given = self.run_kincal("evaluate", "rig.yaml", "samples.jsonl", "--json")
        self.assertLess(strict_json(run.out)["chi2"], strict_json(given.out)["chi2"])  # an estimate is no worse than where it is given

    def test_why_nothing_is_seen(self):
        """The board's front turned away, or a corner outside the image: counted; a truth that counts from a pose that the rig does not have."""
        rig = RIG[:RIG.index("  reflectors:")] + RIG[RIG.index("  board:"):RIG.index("  tracker:")] + RIG[RIG.index("  eye:"):RIG.index("estimate:")]
        self.write("rig.yaml", rig)
        places = [("[1.1, 0.1, 0.95]", "-1.5708")] + 2 * [("[1.1, 0.1, 0.95]", "1.5708")] + 3 * [("[1.1, 3, 0.95]", "-1.5708")]
        self.write("postures.jsonl", "".join('{"id": "p%d", "joints": {}, "targets": {"board": {"xyz": %s, "rpy": [-1.5708, 0, %s]}}}\n' % (k, *place) for k, place in enumerate(places)))
        run = self.simulate("sim", "--postures", "postures.jsonl", samples="6")
        self.assertEqual((run.code, run.err), (0, "kincal: warning: 5 of 6 samples are left out, because in these postures no sensor sees a whole target: a point is outside the image (3); its front is turned away (2)\n"))
        given = "    pose: {xyz: [0.1, 0, 0.9], rpy: [-1.5707963, 0, -1.5707963]}\n"
        self.write("open.yaml", rig.replace(given, ""))
        self.write("truth.json", json.dumps({"parameters": {"sensor/eye/pose": [0.01, 0, 0, 0, 0, 0]}}))
        why = "the rig has no sensor/eye/pose, so truth.json counts from the identity there: write nominal poses into the rig, or the true poses into `values` of the truth"
        run = self.run_kincal("simulate", "open.yaml", "--samples", "6", "--seed", "1", "--out", "open", "--truth", "truth.json", "--postures", "postures.jsonl")
        self.assertEqual(run.code, 1)
        self.assertIn(why, run.err)
        self.write("truth.json", json.dumps({"parameters": {}, "values": {"sensor/eye/pose": {"xyz": [0.1, 0, 0.9], "rpy": [-1.5707963, 0, -1.5707963]}}}))
        run = self.run_kincal("simulate", "open.yaml", "--samples", "6", "--seed", "1", "--out", "open", "--truth", "truth.json", "--postures", "postures.jsonl")
        self.assertEqual((run.code, "6 samples are left out" in run.err, "identity" in run.err), (0, True, False), run.err)

    def test_wrong(self):
        for args, words in ((["--spread", "joint/lift/ofset=0.01"], ["joint/lift/ofset", "nearest", "joint/lift/offset"]), (["--spread", "joint/lift/offset=x"], ["--spread", "joint/lift/offset=x"]),
                            (["--spread", "joint/lift/offset"], ["--spread", "joint/lift/offset"]), (["--spread", "joint/lift/offset=-1"], ["joint/lift/offset"]),
                            (["--truth", "none.json"], ["none.json"]), (["--truth", "rig.yaml"], ["rig.yaml: this is a rig, no truth.json"]), (["--postures", "none.jsonl"], ["none.jsonl"]),
                            (["--truth", "rig.yaml", "--spread", "joint/lift/offset=1"], ["--spread", "--truth"])):
            with self.subTest(args=args):
                self.fails(self.simulate("sim", *args), *words)
        for args in (dict(samples="0"), dict(samples="-3"), dict(samples="x"), dict(seed="x"), dict(seed="-1")):
            with self.subTest(args=args):
                run = self.simulate("sim", *self.spread, **args)
                shutil.rmtree(self.path("sim"), ignore_errors=True)
                self.fails(run)
        self.extra = {"sim"}
        self.assertEqual(self.simulate("sim", *self.spread).code, 0)
        before = self.read("sim", "samples.jsonl")
        self.fails(self.simulate("sim", *self.spread, seed="2"), "sim", "--force")
        self.assertEqual(self.read("sim", "samples.jsonl"), before)


class SameEverywhere(Case):
    def stripped(self, directory):
        r = self.result(directory)
        for key in ("command", "date"):
            r["input"].pop(key)
        for s in r["steps"]:
            s.pop("seconds")
        once = re.compile(r'"(command|date|seconds)": *("(?:[^"\\]|\\.)*"|[-+0-9.e]+)')
        return r, [once.sub("", self.read(directory, f)) for f in FILES]

    def test_threads(self):
        for n in ("1", "2", "3"):
            self.assertEqual(self.calibrate("--threads", n, out="t" + n).code, 0)
        first = self.stripped("t1")
        self.assertEqual(first, self.stripped("t2"))
        self.assertEqual(first, self.stripped("t3"))

    def test_directory(self):
        self.assertEqual(self.calibrate(out="here").code, 0)
        os.mkdir(self.path("elsewhere"))
        run = self.run_kincal("calibrate", "../rig.yaml", self.path("samples.jsonl"), "--out", "../there", cwd=self.path("elsewhere"))
        self.assertEqual(run.code, 0, run.err)
        self.assertEqual(self.stripped("here"), self.stripped("there"))

    def test_robot_path(self):
        """The robot's path counts from the rig; the written rig names the written robot."""
        os.mkdir(self.path("robots"))
        shutil.move(self.path("robot.urdf"), self.path("robots", "tiny.urdf"))
        self.write("rig.yaml", RIG.replace("robot: robot.urdf", "robot: robots/tiny.urdf"))
        run = self.run_kincal("calibrate", os.path.join(os.path.basename(self.dir), "rig.yaml"), self.path("samples.jsonl"), "--out", self.path("out"), cwd=self.root)
        self.assertEqual(run.code, 0, run.err)
        self.assertRegex(self.read("out", "rig.yaml"), r"(?m)^robot: \"?robot\.urdf\"?$")

    def test_locale(self):
        self.assertEqual(self.calibrate(out="c").code, 0)
        env = {"LC_ALL": "de_DE.UTF-8", "LANG": "de_DE.UTF-8"}
        installed = subprocess.run(["locale", "-a"], stdout=subprocess.PIPE).stdout.decode().lower()
        if "de_de.utf8" not in installed:
            made = shutil.which("localedef") and subprocess.run(["localedef", "-i", "de_DE", "-f", "UTF-8", self.path("de_DE.UTF-8")],
                                                                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode == 0
            if not made:
                self.skipTest("no German locale here")
            env["LOCPATH"] = self.dir
        run = self.calibrate(out="de", env=env)
        self.assertEqual(run.code, 0, run.err)
        self.assertEqual(self.stripped("c"), self.stripped("de"))
        a = self.run_kincal("evaluate", "c/rig.yaml", "samples.jsonl", "--json")
        b = self.run_kincal("evaluate", "c/rig.yaml", "samples.jsonl", "--json", env=env)
        self.assertEqual(a.out, b.out)

    def test_repeated(self):
        """Again, and with other addresses in memory: the same bytes in every file."""
        self.assertEqual(self.calibrate(out="a").code, 0)
        for i, size in enumerate((0, 3000, 60000)):
            self.assertEqual(self.calibrate(out="b%d" % i, env={"PADDING": "x" * size, "MALLOC_ARENA_TEST": str(i), "MALLOC_TOP_PAD_": str(size * 7)}).code, 0)
            self.assertEqual(self.stripped("a"), self.stripped("b%d" % i))

    def test_order_of_residuals(self):
        """residuals.csv goes through samples, views and points as the input does, training before held out."""
        self.assertEqual(self.calibrate().code, 0)
        with open(self.path("out", "residuals.csv"), newline="") as f:
            rows = [(x["sample"], x["sensor"]) for x in csv.DictReader(f)]
        ids = [x for i, x in enumerate(rows) if i == 0 or x != rows[i - 1]]
        self.assertEqual(ids, [(s["id"], v["sensor"]) for split in ("train", "test") for s in make_samples() if s.get("split", "train") == split for v in s["views"]])

    def test_order_of_samples(self):
        """Another order of the lines: the same optimum."""
        self.assertEqual(self.calibrate(out="a").code, 0)
        self.write("samples.jsonl", lines(reversed(make_samples())))
        self.assertEqual(self.calibrate(out="b").code, 0)
        a, b = self.result("a"), self.result("b")
        self.assertAlmostEqual(a["chi2"], b["chi2"], delta=1e-10 * a["chi2"])
        for name, p in a["parameters"].items():
            for x, y, s in zip(p["value"], b["parameters"][name]["value"], p["sigma"]):
                self.assertAlmostEqual(x, y, delta=max(1e-15, 1e-6 * s))

    def test_linear_solvers(self):
        self.assertEqual(self.calibrate("--linear-solver", "dense", out="a").code, 0)
        run = self.calibrate("--linear-solver", "cholmod", out="b")
        self.assertEqual(run.code, 0, run.err)
        a, b = self.result("a"), self.result("b")
        self.assertEqual({s["linear_solver"] for s in a["steps"]}, {"dense"})
        self.assertEqual(len({s["linear_solver"] for s in b["steps"]} - {"dense"}), 1)
        self.assertAlmostEqual(a["chi2"], b["chi2"], delta=1e-10 * a["chi2"])
        for name, p in a["parameters"].items():
            for x, y, s in zip(p["value"], b["parameters"][name]["value"], p["sigma"]):
                self.assertAlmostEqual(x, y, delta=max(1e-15, 1e-6 * s))


    def test_cholmod_is_loaded_where_it_is_needed(self):
        """A library of this name that is none: dense systems do not notice, sparse ones end with an error that says what to do."""
        with open(KINCAL, "rb") as f:
            if b"libcholmod.so." not in f.read():
                self.skipTest("built without CHOLMOD")
        os.mkdir(self.path("broken"))
        for major in range(2, 8):
            self.write(os.path.join("broken", "libcholmod.so.%d" % major), "no library")
        env = {"LD_LIBRARY_PATH": self.path("broken")}
        self.assertEqual(self.calibrate(out="dense", env=env).code, 0)
        self.extra = {"broken", "dense"}
        self.fails(self.calibrate("--linear-solver", "cholmod", env=env), "CHOLMOD", "libcholmod.so.", "Install", "dense")


class NoNoise(Case):
    def test_truth_is_recovered(self):
        """Without noise in the samples: the truth to 1e-7, chi2 zero; poses of instruments absent from the rig as well."""
        self.write("samples.jsonl", lines(make_samples(noise=0)))
        rig = re.sub(r"    pose: \{xyz: \[(0\.5|0, 2|0\.1, 0, 0\.9).*\n", "", RIG)
        self.assertEqual(rig.count("\n"), RIG.count("\n") - 3)
        self.write("absent.yaml", rig)
        for name in ("rig.yaml", "absent.yaml"):
            with self.subTest(rig=name):
                run = self.calibrate(rig=name, out=name + "_out")
                self.assertEqual(run.code, 0, run.err)
                r = self.result(name + "_out")
                self.assertLess(r["chi2"], 1e-6)
                self.assertAlmostEqual(r["parameters"]["joint/turn/scale"]["value"][0], TRUTH["scale"], delta=1e-7)
                self.assertAlmostEqual(r["parameters"]["joint/lift/offset"]["value"][0], TRUTH["lift"], delta=1e-7)
                tracker = mul(frame([0.5, -2.0, 0.3], [0, 0, 1.2]), twist(TRUTH["tracker"]))
                pose = r["parameters"]["sensor/tracker/pose"]["pose"]
                self.assertLess(distance(tracker, from_quaternion(pose["xyz"], pose["quat"])), 1e-7)

    def single_point_in_the_hand(self, rig):
        """An eye on the base sees one lamp in the hand in 30 postures: its pose is wanted, everything else is exact and known."""
        rng = random.Random(9)
        joints = read_joints(URDF)
        eye = mul(frame([2.5, 0.3, 0.9], [-1.5707963, 0, 1.5707963]), twist([0, 0, 0, 0.1, -0.05, 0.02]))
        samples = []
        while len(samples) < 30:
            q = {"turn": rng.uniform(-0.5, 0.5), "lift": rng.uniform(-1, 0.5), "slide": rng.uniform(0, 0.4)}
            p = move(mul(inverse(eye), link_pose(joints, "tool", q)), [0, 0, 0.05])
            samples.append({"id": "s%d" % len(samples), "joints": q, "views": [{"sensor": "eye", "target": "lamp", "pixels": [[500 * p[0] / p[2] + 320, 500 * p[1] / p[2] + 240]]}]})
            self.assertGreater(p[2], 0.3)
        self.write("samples.jsonl", lines(samples))
        head, tail = RIG[:RIG.index("targets:")], RIG[RIG.index("  eye:"):RIG.index("estimate:")]
        head += "targets:\n  lamp: {type: points, points: [[0, 0, 0.05]], mount: {link: tool}}\nsensors:\n"
        self.write("rig.yaml", head.replace("0.0005", "0").replace("0.0002", "0") + rig(tail) + "estimate:\n  - {step: eye, free: [sensor/eye/pose]}\n")
        run = self.calibrate()
        self.assertEqual(run.code, 0, run.err)
        pose = self.result()["parameters"]["sensor/eye/pose"]["pose"]
        self.assertLess(distance(eye, from_quaternion(pose["xyz"], pose["quat"])), 1e-6)

    def test_camera_by_single_points(self):
        self.single_point_in_the_hand(lambda tail: re.sub(r"pose: .*", "pose: {xyz: [2.4, 0.2, 1], rpy: [-1.5, 0, 1.5]}", tail))

    def test_unknown_camera_by_single_points(self):
        """The pose absent: a closed form over all samples (formats, "Starting values")."""
        self.single_point_in_the_hand(lambda tail: re.sub(r"    pose: .*\n", "", tail))


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: cli_test.py SOURCE_DIR KINCAL [TEST ...]")
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
