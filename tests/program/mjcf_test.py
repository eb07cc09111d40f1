"""MuJoCo models: python3 mjcf_test.py SOURCE_DIR KINCAL [TEST ...]

Proves: what `apply` writes into a model (MJCF) means the calibrated robot.urdf. Both are read here, by readers written for this test after
MuJoCo's and URDF's documentation; the poses of all bodies agree to 1e-9 m and rad at 20 postures of raw readings, for three models in the style
of public ones (an arm, a torso with two arms and cameras, a mobile base with a lift, an arm and a gripper): angles in degrees and radians,
quat, euler, axisangle, xyaxes and zaxis, classes, frames, ref, several joints a body, links that are fused, frames turned on their links. All
other bytes stay, models of other robots are refused, and so is what cannot be read. Not
proved: that MuJoCo itself loads what is written (MuJoCo 3.14 was asked once, by hand: it has all bodies, cameras and sites of these models
where robot.urdf has them, to 2e-15).
"""
import math
import os
import re
import subprocess
import sys
import unittest
from xml.etree import ElementTree

import numpy as np

import helpers

SOURCE_DIR = KINCAL = None


# ------------------------------------------------------------------------------------------------ independent readers
def turn(axis, angle):
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


X, Y, Z = np.eye(3)


def rigid(rotation=np.eye(3), xyz=(0, 0, 0)):
    t = np.eye(4)
    t[:3, :3], t[:3, 3] = rotation, xyz
    return t


def numbers(text):
    return [float(v) for v in text.split()]


class Urdf:
    def __init__(self, text):
        self.joints = {}
        for e in ElementTree.fromstring(text).findall("joint"):
            origin, axis, mimic = e.find("origin"), e.find("axis"), e.find("mimic")
            r, p, y = numbers(origin.get("rpy", "0 0 0")) if origin is not None else (0, 0, 0)
            self.joints[e.find("child").get("link")] = {
                "name": e.get("name"), "type": e.get("type"), "parent": e.find("parent").get("link"),
                "origin": rigid(turn(Z, y) @ turn(Y, p) @ turn(X, r), numbers(origin.get("xyz", "0 0 0")) if origin is not None else (0, 0, 0)),
                "axis": np.array(numbers(axis.get("xyz")) if axis is not None else X) / (np.linalg.norm(numbers(axis.get("xyz"))) if axis is not None else 1),
                "mimic": None if mimic is None else (mimic.get("joint"), float(mimic.get("multiplier", 1)), float(mimic.get("offset", 0)))}

    def moving(self):
        return [j for j in self.joints.values() if j["type"] != "fixed"]

    def positions(self, readings):
        out = dict(readings)
        for j in self.moving():
            if j["mimic"]:
                out[j["name"]] = j["mimic"][1] * out[j["mimic"][0]] + j["mimic"][2]
        return out

    def pose(self, link, positions):
        if link not in self.joints:
            return np.eye(4)
        j = self.joints[link]
        q = positions.get(j["name"], 0)
        motion = np.eye(4) if j["type"] == "fixed" else rigid(xyz=q * j["axis"]) if j["type"] == "prismatic" else rigid(turn(j["axis"], q))
        return self.pose(j["parent"], positions) @ j["origin"] @ motion


class Model:
    """A MuJoCo model as its documentation says."""

    def __init__(self, text):
        root = ElementTree.fromstring(text)
        self.radian = any(c.get("angle") == "radian" for c in root.findall("compiler"))
        self.eulerseq = ([c.get("eulerseq") for c in root.findall("compiler") if c.get("eulerseq")] or ["xyz"])[-1]
        self.defaults = {}
        for e in root.findall("default"):
            self.read_default(e, {})
        self.bodies, self.marks = {}, {}
        for world in root.findall("worldbody"):
            self.read(world, None, np.eye(4), "main")

    def read_default(self, e, inherited):
        own = {tag: dict(inherited.get(tag, {})) for tag in ("joint", "camera", "site")}
        for tag, values in own.items():
            if e.find(tag) is not None:
                values.update(e.find(tag).attrib)
        self.defaults[e.get("class", "main")] = own
        for child in e.findall("default"):
            self.read_default(child, own)

    def attributes(self, e, childclass):
        return {**self.defaults.get(e.get("class", childclass), {}).get(e.tag, {}), **e.attrib}

    def angle(self, a):
        return a if self.radian else math.radians(a)

    def frame(self, a):
        r = np.eye(3)
        if "quat" in a:
            w, x, y, z = numbers(a["quat"])
            n = math.sqrt(w * w + x * x + y * y + z * z)
            s = math.sqrt(x * x + y * y + z * z)
            r = turn((x, y, z), 2 * math.atan2(s / n, w / n)) if s > 0 else np.eye(3)
        elif "axisangle" in a:
            n = numbers(a["axisangle"])
            r = turn(n[:3], self.angle(n[3]))
        elif "euler" in a:
            for letter, n in zip(self.eulerseq, numbers(a["euler"])):
                one = turn({"x": X, "y": Y, "z": Z}[letter.lower()], self.angle(n))
                r = r @ one if letter.islower() else one @ r
        elif "xyaxes" in a:
            n = np.array(numbers(a["xyaxes"]))
            x = n[:3] / np.linalg.norm(n[:3])
            y = n[3:] - x * (x @ n[3:])
            y = y / np.linalg.norm(y)
            r = np.column_stack([x, y, np.cross(x, y)])
        elif "zaxis" in a:
            n = np.array(numbers(a["zaxis"]))
            c = np.cross(Z, n)
            r = turn(c if np.linalg.norm(c) > 1e-10 else X, math.atan2(np.linalg.norm(c), n[2]))
        return rigid(r, numbers(a.get("pos", "0 0 0")))

    def read(self, e, body, offset, childclass):
        childclass = e.get("childclass", childclass)
        for child in e:
            a = self.attributes(child, child.get("childclass", childclass))
            if child.tag == "frame":
                self.read(child, body, offset @ self.frame(a), childclass)
            elif child.tag == "body":
                self.bodies[child.get("name")] = {"above": body, "pose": offset @ self.frame(a), "joints": []}
                self.read(child, child.get("name"), np.eye(4), childclass)
            elif child.tag == "joint":
                kind = a.get("type", "hinge")
                axis = np.array(numbers(a.get("axis", "0 0 1")))
                ref = float(a.get("ref", 0))
                self.bodies[body]["joints"].append((child.get("name"), kind, axis / np.linalg.norm(axis), np.array(numbers(a.get("pos", "0 0 0"))),
                                                    self.angle(ref) if kind == "hinge" else ref))
            elif child.tag in ("camera", "site"):
                self.marks[child.tag, child.get("name")] = (body, offset @ self.frame(a))

    def pose(self, name, q):
        """Position and frame as mj_kinematics makes them, joint after joint."""
        if name is None:
            return np.eye(4)
        body = self.bodies[name]
        t = self.pose(body["above"], q) @ body["pose"]
        for joint, kind, axis, pos, ref in body["joints"]:
            by = q[joint] - ref
            if kind == "slide":
                t = rigid(t[:3, :3], t[:3, 3] + t[:3, :3] @ axis * by)
            else:
                anchor = t[:3, :3] @ pos + t[:3, 3]
                r = t[:3, :3] @ turn(axis, by)
                t = rigid(r, anchor - r @ pos)
        return t

    def mark(self, kind, name, q):
        body, pose = self.marks[kind, name]
        return self.pose(body, q) @ pose


# ------------------------------------------------------------------------------------------------ models
def digits(values, count):
    return " ".join("%.*g" % (count, v + 0.0) for v in values)


def written(t, style, count=6):
    """The attributes of a pose in one of MuJoCo's ways; angles in degrees, but of rad_... in radians."""
    r = t[:3, :3]
    w = math.acos(max(-1, min(1, (np.trace(r) - 1) / 2)))
    v = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    axis = v / np.linalg.norm(v) if np.linalg.norm(v) > 1e-9 else X
    out = 'pos="%s"' % digits(t[:3, 3], count)
    if style == "quat":
        out += ' quat="%s"' % digits([math.cos(w / 2), *(math.sin(w / 2) * axis)], count)
    elif style == "axisangle":
        out += ' axisangle="%s"' % digits([*axis, math.degrees(w)], count)
    elif style == "xyaxes":
        out += ' xyaxes="%s"' % digits([*r[:, 0], *r[:, 1]], count)
    elif style in ("euler", "rad_euler"):  # x y z, turning along
        angles = [math.atan2(-r[1, 2], r[2, 2]), math.asin(r[0, 2]), math.atan2(-r[0, 1], r[0, 0])]
        out += ' euler="%s"' % digits(angles if style[0] == "r" else [math.degrees(a) for a in angles], count)
    elif style == "EULER":  # X Y Z, about fixed axes
        out += ' euler="%s"' % digits([math.degrees(a) for a in (math.atan2(r[2, 1], r[2, 2]), -math.asin(r[2, 0]), math.atan2(r[1, 0], r[0, 0]))], count)
    return out


def filled(template, urdf, count=6):
    """POSE(style parent child joint=ref ...) becomes the attributes of where the child is in the parent."""
    def one(match):
        style, parent, child, *refs = match.group(1).split()
        q = {name: float(value) for name, value in (ref.split("=") for ref in refs)}
        return written(np.linalg.inv(urdf.pose(parent, q)) @ urdf.pose(child, q), style, count)
    return re.sub(r"POSE\(([^)]*)\)", one, template)


def urdf_text(links, joints):
    """joints: (name, type, parent, child, xyz, rpy, axis, more)"""
    out = ['<robot name="robot">'] + ['<link name="%s"/>' % link for link in links]
    for name, kind, parent, child, xyz, rpy, axis, *more in joints:
        limit = '<limit lower="%s" upper="%s" effort="1" velocity="1"/>' % (("-0.1", "0.4") if kind == "prismatic" else ("-1.5", "1.5"))
        out.append('<joint name="%s" type="%s"><parent link="%s"/><child link="%s"/><origin xyz="%s" rpy="%s"/>%s%s</joint>'
                   % (name, kind, parent, child, xyz, rpy, '<axis xyz="%s"/>%s' % (axis, limit) if axis else "", "".join(more)))
    return "\n".join(out + ["</robot>", ""])


ARM = urdf_text(["base_link", "link1", "link2", "link3", "link4", "link5", "link6", "tool0"], [
    ("joint1", "revolute", "base_link", "link1", "0 0 0.333", "0 0 0.1", "0 0 1"),
    ("joint2", "revolute", "link1", "link2", "0 0.02 0", "-1.5707963267948966 0 0", "0 0 1"),
    ("joint3", "revolute", "link2", "link3", "0 -0.316 0", "1.5707963267948966 0 0.3", "0 0 1"),
    ("joint4", "revolute", "link3", "link4", "0.0825 0 0", "1.5707963267948966 0 0", "0 0.1 1"),
    ("joint5", "continuous", "link4", "link5", "-0.0825 0.384 0", "-1.5707963267948966 0.2 0", "0 0 1"),
    ("joint6", "revolute", "link5", "link6", "0.088 0 0", "1.5707963267948966 0 0", "0 -1 0"),
    ("tool", "fixed", "link6", "tool0", "0 0 0.107", "0 0.1 -0.7853981633974483", "")])
# link4's frame is turned on the robot's link, by half a turn about x: so its joint's axis is another, too
ARM_MODEL = """<mujoco model="arm">
  <!-- in the style of public arms -->
  <compiler angle="radian" meshdir="assets"/>
  <option integrator='implicitfast' />
  <default>
    <default class="arm">
      <joint armature="0.1" damping="1" range="-1.5 1.5"/>
      <default class="wrist"> <joint axis="0 -1 0" ref="0.25"/> <site size="0.01"/> </default>
      <default class="visual"><geom type="mesh" contype="0"/></default>
    </default>
  </default>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="base_link" pos="0.1 -0.2 0.8" euler="0 0 1" childclass="arm">
      <geom class="visual" pos="0 0 0.1"   quat="1 0 0 0"/>
      <body name="link1" POSE(quat base_link link1)>
        <inertial pos="0 -0.01 0" mass="3"/><joint name="joint1"/>
        <body name='link2' POSE(quat link1 link2)>
          <joint name="joint2"/>
          <body name="link3"
                POSE(rad_euler link2 link3)  >
            <joint name="joint3"  axis = "0 0 2"/>
            <body name="link4" LINK4><joint name="joint4" axis="0 -0.0995037 -0.995037"/>
              <body name="link5" LINK5>
                <joint name="joint5" type="hinge" limited="false"/>
                <body name="link6" POSE(quat link5 link6 joint6=0.25)>
                  <joint class="wrist" name="joint6"/>
                  <site name="tool0" class="wrist" POSE(quat link6 tool0)/>
                  <geom pos="0 0 0" size="0.1"/>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><position name="a1" joint="joint1" kp="10"/></actuator>
</mujoco>
"""

TORSO = urdf_text(["pelvis", "torso", "l_upper", "l_fore", "l_hand", "r_upper", "r_fore", "r_hand", "neck", "head", "cam_link", "eye_optical", "wrist_optical"], [
    ("waist", "fixed", "pelvis", "torso", "0 0 0.4", "0 0.05 0", ""),
    ("l_shoulder", "revolute", "torso", "l_upper", "0 0.25 0.3", "0.2 0 0", "0 1 0"),
    ("l_elbow", "revolute", "l_upper", "l_fore", "0.05 0.02 -0.3", "0 0 0.4", "0 1 0"),
    ("l_wrist", "revolute", "l_fore", "l_hand", "0.25 0 0", "0.3 0.2 0.1", "1 0 0"),
    ("r_shoulder", "revolute", "torso", "r_upper", "0 -0.25 0.3", "-0.2 0 0", "0 1 0"),
    ("r_elbow", "revolute", "r_upper", "r_fore", "0.05 -0.02 -0.3", "0 0 -0.4", "0 1 0"),
    ("r_wrist", "revolute", "r_fore", "r_hand", "0.25 0 0", "0.3 -0.2 0.1", "1 0 0"),
    ("pan", "revolute", "torso", "neck", "0.02 0 0.45", "0 0 0", "0 0 1"),
    ("tilt", "revolute", "neck", "head", "0.01 0 0.1", "0 0.1 0", "0 1 0"),
    ("cam_joint", "fixed", "head", "cam_link", "0.06 0.02 0.05", "0 0.02 0", ""),
    ("optical", "fixed", "cam_link", "eye_optical", "0 0.015 0", "-1.5707963267948966 0 -1.5707963267948966", ""),
    ("wrist_cam", "fixed", "l_hand", "wrist_optical", "0.05 0 0.04", "-1.2 0 -1.5", "")])
# the torso is fused into the world, which stands elsewhere
TORSO_MODEL = """<?xml version="1.0"?>
<mujoco>
  <compiler eulerseq="XYZ"/>
  <default><camera fovy="42"/></default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="l_upper" POSE(EULER torso l_upper)><joint name="l_shoulder" axis="0 1 0"/>
      <body name="l_fore" POSE(axisangle l_upper l_fore)><joint name="l_elbow" axis="0 1 0" pos="0 0.01 0"/>
        <body name="l_hand" POSE(xyaxes l_fore l_hand l_wrist=0.5235987755982988)><joint name="l_wrist" axis="1 0 0" ref="30"/>
          <frame euler="0 90 0" pos="0 0 0.01"><camera name="wrist_camera" pos="0 0 0" zaxis="1 2 3"/></frame>
        </body>
      </body>
    </body>
    <body name="r_upper" POSE(quat torso r_upper)><joint name="r_shoulder" axis="0 1 0"/>
      <body name="r_fore" POSE(EULER r_upper r_fore)><joint name="r_elbow" axis="0 1 0"/>
        <frame pos="0.1 0.02 0" axisangle="0 1 1 20">
          <body name="r_hand" RHAND><joint name="r_wrist" axis="1 0 0"/></body>
        </frame>
      </body>
    </body>
    <body name="neck" POSE(quat torso neck)><joint name="pan"/>
      <body name="head" POSE(xyaxes neck head)>
        <joint name="tilt" axis="0 1 0"/>
        <camera name="eye_optical" fovy="60"/> <!-- of the sensor called eye, by its link -->
      </body>
    </body>
    <body name="table" pos="1 0 0"><geom size="1 1 1"/></body>
  </worldbody>
</mujoco>
"""

MOBILE = urdf_text(["footprint", "chassis", "mast", "lift_link", "pan_link", "tilt_link", "arm1", "arm2", "palm", "finger_a", "finger_b", "mark"], [
    ("base_joint", "fixed", "footprint", "chassis", "0 0 0.1", "0 0 0", ""),
    ("mast_joint", "fixed", "chassis", "mast", "-0.1 0 0.2", "0 0 0.01", ""),
    ("lift", "prismatic", "mast", "lift_link", "0 0 0.3", "0.01 0 0", "0 0 1"),
    ("pan", "revolute", "lift_link", "pan_link", "0.05 0 0.1", "0 0 0.2", "0 0 1"),
    ("tilt", "revolute", "pan_link", "tilt_link", "0.03 0.01 0.04", "0 0.1 0", "0 1 0"),
    ("arm_joint1", "revolute", "lift_link", "arm1", "0.1 0.2 0", "0 1.5 0", "1 0 0"),
    ("arm_joint2", "revolute", "arm1", "arm2", "0 0.05 0.25", "0.5 0 0", "0 1 0"),
    ("palm_joint", "fixed", "arm2", "palm", "0.2 0 0", "0 0 0.3", ""),
    ("finger_joint", "revolute", "palm", "finger_a", "0.05 0.02 0", "0 0 0", "0 0 1"),
    ("finger_follower", "revolute", "palm", "finger_b", "0.05 -0.02 0", "0 0 0", "0 0 1", '<mimic joint="finger_joint" multiplier="-1.5" offset="0.1"/>'),
    ("mark_joint", "fixed", "tilt_link", "mark", "0.1 0 0", "0.3 0 0", "")])
# pan_link and mast are fused: both joints of the head are the tilt_link's, and the first one's axis is not at its origin
MOBILE_MODEL = """<mujoco model="mobile">
<compiler angle="degree" autolimits="true"/>
<worldbody>
  <body name="chassis" pos="3 4 0.1" quat="0.9 0.1 0 0.3">
    <freejoint name="floating"/>
    <body name="lift_link" POSE(quat chassis lift_link lift=0.05)>
      <joint name="lift" type="slide" axis="0 0 1" ref="0.05" range="-0.1 0.4"/>
      <body name="tilt_link" POSE(euler lift_link tilt_link)>
        <joint name="pan" axis="PANAXIS" pos="PANPOS"/>
        <joint name="tilt" axis="0 1 0"/>
        <body name="mark" POSE(axisangle tilt_link mark)/>
      </body>
      <body name="riser" pos="0.02 0.01 0.1" euler="10 20 30"><geom size="0.1"/>
        <body name="arm1" ARM1><joint name="arm_joint1" axis="1 0 0"/>
          <body name="arm2" POSE(quat arm1 arm2)><joint axis="0 1 0"/>
            <body name="finger_a" POSE(quat arm2 finger_a)><joint name="finger_joint"/></body>
            <body name="finger_b" POSE(quat arm2 finger_b)><joint name="finger_follower"/></body>
            <site name="palm" POSE(quat arm2 palm)/><site name="elsewhere" pos="1 2 3"/>
          </body>
        </body>
      </body>
    </body>
  </body>
</worldbody>
<equality><joint joint1="finger_follower" joint2="finger_joint" polycoef="0.1 -1.5 0 0 0"/></equality>
</mujoco>
"""

CAMERA = "    model: pinhole\n    image_size: [640, 480]\n    intrinsics: [500, 500, 320, 240]\n    sigma: 0.2\n"


def rig_text(tips, base, cameras=""):
    """A tracker at the base sees a rigid set of points on every tip."""
    points = "[[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]"
    targets = "".join("  on_%s: {type: points, points: %s, mount: {link: %s, pose: {xyz: [0, 0, 0.05]}}}\n" % (tip, points, tip) for tip in tips)
    return """format: kincal/1
robot: robot.urdf
targets:
%ssensors:
  tracker: {type: point, link: %s, pose: {xyz: [2, 0, 1], rpy: [0, 0, 3]}, sigma: 0.0005}
%sestimate:
- step: all
  free: ["joint/*/offset", "joint/*/origin"]
  priors: {"joint/*/offset": 0.03, "joint/*/origin": {translation: 0.005, rotation: 0.01}}
""" % (targets, base, cameras)


class Case(helpers.Folder):
    def run_kincal(self, *arguments):
        return subprocess.run([KINCAL, *arguments], cwd=self.dir, capture_output=True, text=True, timeout=120)

    def calibrated(self, urdf, rig, spread=("joint/*/offset=0.02", "joint/*/origin=0.004")):
        self.write("robot.urdf", urdf)
        self.write("rig.yaml", rig)
        for arguments in (["simulate", "rig.yaml", "--samples", "12", "--seed", "3", *("--spread=" + one for one in spread), "--out", "sim"],
                          ["calibrate", "rig.yaml", "sim/samples.jsonl", "--out", "result", "--quiet", "--no-report"]):
            run = self.run_kincal(*arguments)
            self.assertEqual(run.returncode, 0, run.stderr)
        return Urdf(urdf), Urdf(self.read("result", "robot.urdf"))

    def applied(self, model, *more):
        self.write("model.xml", model)
        run = self.run_kincal("apply", "result", "model.xml", "--out", "new.xml", "--force", *more)
        self.assertEqual(run.returncode, 0, run.stderr)
        return self.read("new.xml"), run.stderr

    def fails(self, model, *words):
        self.write("model.xml", model)
        run = self.run_kincal("apply", "result", "model.xml", "--out", "none.xml")
        self.assertEqual((run.returncode, run.stdout), (1, ""))
        for word in words:
            self.assertIn(word, run.stderr)
        self.assertEqual(run.stderr.count("\n"), 1, run.stderr)
        self.assertFalse(os.path.exists(self.path("none.xml")))

    def same_poses(self, text, urdf, base, tolerance, also={}, turned={}, moving=()):
        """Bodies of `text` against links: relative to `base`, a link and where it stands in the model's world."""
        model, rng = Model(text), np.random.default_rng(4)
        link, world_T_link = base
        compared = 0
        for _ in range(20):
            readings = {j["name"]: rng.uniform(-0.1, 0.4) if j["type"] == "prismatic" else rng.uniform(-1.5, 1.5) for j in urdf.moving()}
            positions = urdf.positions(readings)
            q = {**positions, None: positions.get("arm_joint2")}
            shall_be = lambda l: world_T_link @ np.linalg.inv(urdf.pose(link, positions)) @ urdf.pose(l, positions)
            for name in model.bodies:
                if name == link or name in urdf.joints:
                    compared += 1
                    np.testing.assert_allclose(model.pose(name, q), shall_be(name) @ turned.get(name, np.eye(4)), atol=tolerance, err_msg=name)
            for (kind, name), (l, pose) in also.items():
                np.testing.assert_allclose(model.mark(kind, name, q), shall_be(l) @ pose, atol=tolerance, err_msg=name)
        return compared

    def same_bytes(self, before, after):
        """But for numbers of the attributes that say where things are, and for how these are called."""
        strip = lambda text: re.sub(r"""\s(pos|quat|euler|axisangle|xyaxes|zaxis|axis)\s*=\s*("[^"]*"|'[^']*')""", "", text)
        self.assertEqual(strip(before), strip(after))
        kept = lambda text: re.findall(r"<!--.*?-->|<(?:geom|light|inertial|option|compiler|default|actuator|equality|position)\b[^>]*>", text)
        self.assertEqual(kept(before), kept(after))


FLIP = np.diag([1.0, -1, -1, 1])  # MuJoCo's cameras look along -z
HALF = rigid(turn(X, math.pi))


def arm_model(urdf, count=6):
    none, pose = {}, urdf.pose
    inside = lambda parent, child: np.linalg.inv(pose(parent, none)) @ pose(child, none)
    text = ARM_MODEL.replace("LINK4", written(inside("link3", "link4") @ HALF, "rad_euler", count))
    return filled(text.replace("LINK5", written(HALF.T @ inside("link4", "link5"), "quat", count)), urdf, count)


class Models(Case):
    def test_arm(self):
        before, after = self.calibrated(ARM, rig_text(["tool0", "link3"], "base_link"))
        model = arm_model(before)
        base = ("base_link", rigid(turn(Z, 1), (0.1, -0.2, 0.8)))
        marks = {("site", "tool0"): ("tool0", np.eye(4))}
        self.same_poses(model, before, base, 1e-5, marks, {"link4": HALF})
        new, said = self.applied(model)
        self.assertEqual(self.same_poses(new, after, base, 1e-9, marks, {"link4": self.frame_kept(new, after, "link4")}), 20 * 7)
        np.testing.assert_allclose(self.frame_kept(new, after, "link4"), HALF, atol=1e-5)
        self.same_bytes(model, new)
        self.assertIn("`quat` now: link3, link4", said)
        self.assertIn("stay so on them: link4", said)
        self.assertNotIn("euler", re.search('<body name="link3"[^>]*>', new).group(0))
        self.fails(new, "model.xml:", "body 'link1'", "already has the changes of the result")

    def test_names_and_rounding(self):
        """Names lack a prefix, numbers have four digits, and the lowest body is a link that the arm does not hang on."""
        urdf = ARM.replace('<link name="tool0"/>', '<link name="tool0"/><link name="plate"/>').replace(
            "</robot>", '<joint name="plate_joint" type="fixed"><parent link="base_link"/><child link="plate"/><origin xyz="0.1 0 0" rpy="0 0 3.1"/></joint></robot>')
        before, after = self.calibrated(re.sub('(link|joint name|link name|child link)="', r'\1="r_', urdf), rig_text(["r_tool0", "r_link3"], "r_base_link"))
        without = lambda text: text.replace('"r_', '"')
        before, after = Urdf(without(urdf)), Urdf(without(self.read("result", "robot.urdf")))
        model = arm_model(before, 4).replace('name="base_link"', 'name="plate"')
        on_plate = np.linalg.inv(before.pose("plate", {})) @ before.pose("link1", {})
        model = re.sub('<body name="link1" [^>]*>', lambda _: '<body name="link1" %s>' % written(on_plate, "quat", 4), model)
        new, said = self.applied(model)
        self.assertIn("without 'r_'", said)
        self.assertRegex(said, "up to [0-9.e-]+ m or rad from the robot before the calibration")
        base = ("plate", rigid(turn(Z, 1), (0.1, -0.2, 0.8)))
        kept = self.frame_kept(new, after, "link4", "plate")
        np.testing.assert_allclose(kept, HALF, atol=1e-3)
        self.assertEqual(self.same_poses(new, after, base, 1e-9, {("site", "tool0"): ("tool0", np.eye(4))}, {"link4": kept}), 20 * 7)

    def frame_kept(self, text, urdf, name, base="base_link"):
        model = Model(text)
        q = {j["name"]: 0 for j in urdf.moving()}
        return np.linalg.inv(urdf.pose(name, q)) @ urdf.pose(base, q) @ np.linalg.inv(model.pose(base, q)) @ model.pose(name, q)

    def test_torso(self):
        rig = rig_text(["l_hand", "r_hand", "cam_link"], "pelvis", "  eye:\n    type: camera\n    link: eye_optical\n    pose: {xyz: [0.001, 0.002, 0.003], rpy: [0.01, 0.02, 0.03]}\n" + CAMERA
                       + "  wrist_camera:\n    type: camera\n    link: wrist_optical\n    pose: {}\n" + CAMERA
                       + "  third:\n    type: camera\n    link: l_fore\n    pose: {}\n" + CAMERA)
        before, after = self.calibrated(TORSO, rig)
        none = {}
        frame = rigid(turn([0, 1, 1], math.radians(20)), (0.1, 0.02, 0))
        hand = np.linalg.inv(frame) @ np.linalg.inv(before.pose("r_fore", none)) @ before.pose("r_hand", none)
        model = filled(TORSO_MODEL.replace("RHAND", written(hand, "quat")), before)
        base = ("torso", np.eye(4))
        self.same_poses(model, before, base, 1e-5)
        new, said = self.applied(model)
        eye = rigid(turn(Z, 0.03) @ turn(Y, 0.02) @ turn(X, 0.01), (0.001, 0.002, 0.003)) @ FLIP
        # the world stands on the pelvis as the left upper arm has it in the model: the fixed joint below the torso is calibrated as well
        q = {name: 0 for name in ("l_shoulder", "l_elbow", "r_shoulder", "r_elbow", "r_wrist", "pan", "tilt", "l_wrist")}
        base = ("pelvis", Model(model).pose("l_upper", q) @ np.linalg.inv(before.pose("l_upper", q)))
        self.assertEqual(self.same_poses(new, after, base, 1e-9, {("camera", "eye_optical"): ("eye_optical", eye), ("camera", "wrist_camera"): ("wrist_optical", FLIP)}), 20 * 8)
        self.same_bytes(model, new)
        self.assertIn("sensor 'third' is left out", said)
        self.assertRegex(said, "`quat` now: .*wrist_camera")

    def test_mobile(self):
        before, after = self.calibrated(MOBILE, rig_text(["mark", "palm", "finger_a", "finger_b"], "footprint"))
        q = {}
        inside = lambda parent, child: np.linalg.inv(before.pose(parent, q)) @ before.pose(child, q)
        pan = inside("tilt_link", "pan_link")
        riser = rigid(turn(X, math.radians(10)) @ turn(Y, math.radians(20)) @ turn(Z, math.radians(30)), (0.02, 0.01, 0.1))
        model = MOBILE_MODEL.replace("PANAXIS", digits(pan[:3, 2], 6)).replace("PANPOS", digits(pan[:3, 3], 6))
        model = filled(model.replace("ARM1", written(np.linalg.inv(riser) @ inside("lift_link", "arm1"), "euler")), before)
        base = ("chassis", Model(model).pose("chassis", {}))
        marks = {("site", "palm"): ("palm", np.eye(4))}
        self.same_poses(model, before, base, 1e-5, marks)
        new, said = self.applied(model)
        self.assertEqual(self.same_poses(new, after, base, 1e-9, marks), 20 * 8)
        self.same_bytes(model, new)
        self.assertIn('<site name="elsewhere" pos="1 2 3"/>', new)
        self.assertIn("changes are left out: joints base_joint", said)
        self.assertIn('quat="0.9 0.1 0 0.3">\n    <freejoint name="floating"/>', new)


class Bytes(Case):
    def test_only_what_changes(self):
        """A model with all digits of which one joint's zero is calibrated: one body is written."""
        rig = rig_text(["tool0"], "base_link").replace('["joint/*/offset", "joint/*/origin"]', '["joint/joint3/offset"]').replace(
            'priors: {"joint/*/offset": 0.03, "joint/*/origin": {translation: 0.005, rotation: 0.01}}', "loss: {huber: 3}")
        before, after = self.calibrated(ARM, rig, ["joint/joint3/offset=0.02"])
        model = arm_model(before, 17)
        new, _ = self.applied(model)
        differing = [(a, b) for a, b in zip(model.split("\n"), new.split("\n")) if a != b]
        self.assertEqual(len(differing), 1, differing)
        self.assertIn("euler", differing[0][0])
        self.assertIn("quat", differing[0][1])
        self.same_poses(new, after, ("base_link", rigid(turn(Z, 1), (0.1, -0.2, 0.8))), 1e-9, turned={"link4": HALF})


class Wrong(Case):
    def test_wrong(self):
        before, _ = self.calibrated(ARM, rig_text(["tool0", "link3"], "base_link"))
        good = arm_model(before)
        change = lambda old, new: self.assertIn(old, good) or good.replace(old, new, 1)
        self.fails(change("<worldbody>", '<include file="arm.xml"/><worldbody>'), "model.xml:", "<include>", "included files are not read")
        self.fails(change('angle="radian"', 'coordinate="global"'), "model.xml:3", "coordinate", "global")
        self.fails(change('angle="radian"', 'angle="rad"'), "degree or radian")
        self.fails(change('angle="radian"', 'eulerseq="abc"'), "eulerseq")
        self.fails(change('<light pos="0 0 3"/>', '<replicate count="2"><body/></replicate>'), "replicate")
        self.fails(change('axis = "0 0 2"', 'axis = "0 0 -2"'), "joint 'joint3'", "the other way")
        self.fails(change('axis = "0 0 2"', 'axis = "0 0.1 1"'), "joint 'joint3'", "another robot")
        self.fails(change('axis = "0 0 2"', 'axis = "0 0 0"'), "joint 'joint3'", "zero")
        self.fails(change('axis = "0 0 2"', 'axis = "0 0 2" pos="0.01 0 0"'), "joint 'joint3'", "0.01 m")
        self.fails(change('<joint name="joint3"', '<joint name="joint9"'), "body 'link3'", "joint9", "joint3")
        self.fails(change('<joint name="joint2"/>', ""), "body 'link2'", "has no joint 'joint2'")
        self.fails(change('<joint name="joint2"/>', '<joint name="joint2" type="slide"/>'), "joint 'joint2' is a slide")
        self.fails(change('<joint name="joint2"/>', '<joint name="joint2" class="nobody"/>'), "class 'nobody' is not defined")
        self.fails(change("body name='link2'", "body name='link5'").replace('body name="link5"', 'body name="link2"'), "body 'link5'")
        self.fails(change('<body name="link1" pos="', '<body name="link1" euler="0 0 0" pos="'), "quat and euler")
        self.fails(re.sub('body name=(.)link', r'body name=\1part', good), "body 'part1' is not called as the link that it moves, 'link1'")
        self.fails(good.replace("</mujoco>", ""), "not well-formed")
        self.fails('<mujoco><worldbody/></mujoco>', "no body has the name of a link")
        self.fails("<sdf/>", "not a URDF", "<robot>")
        self.fails(change('<joint name="joint1"/>', '<joint name="joint1"/>').replace('<body name="link1"', '<body name="shoulder"'), "joint1")


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:], verbosity=2)
