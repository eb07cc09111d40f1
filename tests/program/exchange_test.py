"""Files of other programs, out and in: python3 exchange_test.py SOURCE_DIR KINCAL [TEST ...]

Proves: what `export` writes is what ROS, OpenCV, Kalibr and easy_handeye read, as far as a YAML reader and their own formulas (written
here) tell: camera_info's P projects as the rig's camera does, T_cn_cnm1, the static transforms, URDF and xacro are where the rig's frames are,
also for a driver's own frame; `import` of what was exported gives the same numbers; files as those programs write them are read, and what
kincal does not have is refused with file, line, field and what is valid; poses of a flange in the conventions of six makers against elementary rotations; samples of hand-eye
programs, calibrated, give the pose that they were made with. Not proved: that every version of these programs takes the files.
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

SOURCE_DIR = KINCAL = None

URDF = """<robot name="arm"><link name="base"/><link name="arm"/><link name="tool"/><link name="cam_mount"/><link name="optical"/><link name="second"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="j2" type="revolute"><parent link="arm"/><child link="tool"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="cam_joint" type="fixed"><parent link="tool"/><child link="optical"/><origin xyz="0.01 0.02 0.03" rpy="0.1 0.2 0.3"/></joint>
<joint name="mount2" type="fixed"><parent link="tool"/><child link="second"/><origin xyz="0.1 0 0.03" rpy="0.1 -0.2 0.3"/></joint>
<joint name="wall" type="fixed"><parent link="base"/><child link="cam_mount"/><origin xyz="1 0 0.5" rpy="0 0 3"/></joint></robot>
"""

RIG = """# my rig: this comment stays
format: kincal/1
robot: arm.urdf   # the arm
base: base
targets:
  board:          # on the wall
    type: chessboard
    rows: 4       # inner corners
    columns: 5
    square: 0.03
    mount: {link: base, pose: {xyz: [1, 0.1, 0.2], rpy: [0.1, 0.2, 0.3]}}
  held: {type: points, points: [[0, 0, 0]], mount: {link: tool, pose: {xyz: [0.2, 0, 0.01]}}}
sensors:
  # the first camera
  left:
    type: camera
    link: optical
    pose: {xyz: [0.001, 0.00002, 0.003], rpy: [0.01, 0.02, 0.03]}
    model: brown_conrady         # the lens
    image_size: [640, 480]
    intrinsics: [500.5, 501.25, 320.125, 240.75]   # fx fy cx cy
    distortion: [-0.21, 0.11, 0.001, -0.002, 0.03]
    sigma: 0.2
  right:
    type: camera
    link: second
    pose: {xyz: [0, 0.1, 0], rpy: [0.2, 0, 0]}
    model: kannala_brandt
    image_size: [800, 600]
    intrinsics: [300, 301, 400, 300]
    distortion: [0.01, -0.02, 0.003, -0.0004]
    sigma: 0.2
  fixed: {type: camera, link: cam_mount, pose: {xyz: [0, 0, 0.2], rpy: [1, 0, 0]}, model: brown_conrady, image_size: [1280, 960],
          intrinsics: [900, 901, 640, 480], distortion: [0.1, 0.2, 0.001, 0.002, 0.3, 0.01, 0.02, 0.03], sigma: 0.2}
  stereo:
    type: camera
    link: optical
    model: pinhole
    intrinsics: [400, 400, 320, 240]
    image_size: [640, 480]
    baseline: 0.09
    sigma: 0.2
"""


# ------------------------------------------------------------------------------------------------ independent formulas
def rpy(r, p, y):
    rx = np.array([[1, 0, 0], [0, math.cos(r), -math.sin(r)], [0, math.sin(r), math.cos(r)]])
    ry = np.array([[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]])
    rz = np.array([[math.cos(y), -math.sin(y), 0], [math.sin(y), math.cos(y), 0], [0, 0, 1]])
    return rz @ ry @ rx


def pose(xyz=(0, 0, 0), angles=(0, 0, 0)):
    t = np.eye(4)
    t[:3, :3], t[:3, 3] = rpy(*angles), xyz
    return t


def from_quat(xyz, q):
    x, y, z, w = q
    t = np.eye(4)
    t[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    t[:3, 3] = xyz
    return t


class Case(helpers.Folder):
    def setUp(self):
        super().setUp()
        self.write("arm.urdf", URDF)
        self.write("rig.yaml", RIG)

    def run_kincal(self, *arguments):
        return subprocess.run([KINCAL, *arguments], cwd=self.dir, capture_output=True, text=True, timeout=120)

    def good(self, *arguments):
        run = self.run_kincal(*arguments)
        self.assertEqual(run.returncode, 0, run.stderr)
        return run

    def fails(self, arguments, *words):
        run = self.run_kincal(*arguments)
        self.assertEqual(run.returncode, 1, run.stdout)
        self.assertEqual(run.stdout, "")
        for word in words:
            self.assertIn(word, run.stderr)
        self.assertEqual(run.stderr.count("\n"), 1, run.stderr)

    def check_numbers(self, text):
        """Whatever looks like a number in the text must be one for yaml.safe_load."""
        def texts(node):
            if isinstance(node, dict):
                return [t for pair in node.items() for part in pair for t in texts(part)]
            if isinstance(node, list):
                return [t for part in node for t in texts(part)]
            return [node] if isinstance(node, str) else []
        for one in texts(yaml.safe_load(text)):
            self.assertIsNone(re.fullmatch(r"[-+]?[0-9.]+[eE][-+]?[0-9]+", one), one)

    def exported(self, *arguments):
        return self.good("export", "rig.yaml", "--as", *arguments).stdout

    def sensor(self, rig, name):
        return yaml.safe_load(self.read(rig))["sensors"][name]

    def same_camera(self, a, b, baseline=True):
        for key in ("model", "image_size", "intrinsics", "distortion") + (("baseline",) if baseline else ()):
            plain = [[float(v) for v in one] if isinstance(one, list) else one for one in (a.get(key), b.get(key))]  # PyYAML takes 4e-04 for a text
            self.assertEqual(plain[0], plain[1], key)


# ------------------------------------------------------------------------------------------------ out
class Export(Case):
    def test_camera_info(self):
        info = yaml.safe_load(self.exported("camera_info", "--sensor", "left"))
        self.assertEqual((info["image_width"], info["image_height"], info["camera_name"], info["distortion_model"]), (640, 480, "left", "plumb_bob"))
        self.assertEqual(info["camera_matrix"], {"rows": 3, "cols": 3, "data": [500.5, 0, 320.125, 0, 501.25, 240.75, 0, 0, 1]})
        self.assertEqual(info["distortion_coefficients"], {"rows": 1, "cols": 5, "data": [-0.21, 0.11, 0.001, -0.002, 0.03]})
        self.assertEqual(info["rectification_matrix"]["data"], [1, 0, 0, 0, 1, 0, 0, 0, 1])
        self.assertEqual(info["projection_matrix"], {"rows": 3, "cols": 4, "data": [500.5, 0, 320.125, 0, 0, 501.25, 240.75, 0, 0, 0, 1, 0]})
        self.assertTrue(all(isinstance(v, float) for v in info["camera_matrix"]["data"]))
        self.assertEqual(yaml.safe_load(self.exported("camera_info", "--sensor", "right"))["distortion_model"], "equidistant")
        self.assertEqual(yaml.safe_load(self.exported("camera_info", "--sensor", "fixed"))["distortion_model"], "rational_polynomial")

    def test_right_camera_of_a_pair(self):
        p = np.reshape(yaml.safe_load(self.exported("camera_info", "--sensor", "stereo"))["projection_matrix"]["data"], (3, 4))
        point = np.array([0.3, -0.1, 2.0, 1.0])
        u = p @ point
        self.assertAlmostEqual(u[0] / u[2], 400 * (0.3 - 0.09) / 2 + 320, places=9)

    def test_opencv(self):
        text = self.exported("opencv", "--sensor", "right")
        self.assertTrue(text.startswith("%YAML:1.0\n---\n"))
        data = yaml.safe_load(text.split("---\n")[1].replace("!!opencv-matrix", ""))
        self.assertEqual(data["camera_matrix"], {"rows": 3, "cols": 3, "dt": "d", "data": [300, 0, 400, 0, 301, 300, 0, 0, 1]})
        self.assertEqual((data["distortion_coefficients"]["rows"], data["distortion_coefficients"]["data"]), (4, [0.01, -0.02, 0.003, -0.0004]))
        self.assertEqual(data["fisheye_model"], 1)
        self.assertIn("baseline", self.good("export", "rig.yaml", "--as", "opencv", "--sensor", "stereo").stderr)

    def test_kalibr(self):
        self.fails(["export", "rig.yaml", "--as", "kalibr", "--sensor", "left"], "radtan", "k3", "--fix 'sensor/left/distortion.k3'")
        self.write("rig.yaml", RIG.replace("-0.002, 0.03]", "-0.002, 0]"))
        run = self.good("export", "rig.yaml", "--as", "kalibr", "--sensor", "left", "--sensor", "right", "--sensor", "stereo")
        chain = yaml.safe_load(run.stdout)
        self.assertEqual(list(chain), ["cam0", "cam1", "cam2"])
        self.assertEqual(chain["cam0"]["distortion_coeffs"], [-0.21, 0.11, 0.001, -0.002])
        self.assertEqual((chain["cam1"]["camera_model"], chain["cam1"]["distortion_model"]), ("pinhole", "equidistant"))
        self.assertEqual(chain["cam1"]["resolution"], [800, 600])
        tool_left = pose((0.01, 0.02, 0.03), (0.1, 0.2, 0.3)) @ pose((0.001, 0.00002, 0.003), (0.01, 0.02, 0.03))
        tool_right = pose((0.1, 0, 0.03), (0.1, -0.2, 0.3)) @ pose((0, 0.1, 0), (0.2, 0, 0))
        np.testing.assert_allclose(chain["cam1"]["T_cn_cnm1"], np.linalg.inv(tool_right) @ tool_left, atol=1e-12)
        self.assertNotIn("T_cn_cnm1", chain["cam0"])
        self.assertNotIn("T_cn_cnm1", chain["cam2"])  # its pose is not in the rig
        self.assertIn("cam2", run.stderr)
        moving = self.good("export", "rig.yaml", "--as", "kalibr", "--sensor", "right", "--sensor", "left")
        self.assertEqual(moving.stderr, "")

    def test_static_transforms(self):
        lines = self.exported("static_transforms").splitlines()
        ros2 = [line.split() for line in lines if line.startswith("ros2 run tf2_ros static_transform_publisher")]
        ros1 = [line.split() for line in lines if line.startswith("# ROS 1: rosrun tf2_ros static_transform_publisher")]
        self.assertEqual([words[-1] for words in ros2], ["left", "right", "fixed", "board", "held"])
        words = dict(zip(ros2[0][4::2], ros2[0][5::2]))
        self.assertEqual((words["--frame-id"], words["--child-frame-id"]), ("optical", "left"))
        found = from_quat([float(words["--" + k]) for k in "xyz"], [float(words["--q" + k]) for k in "xyzw"])
        np.testing.assert_allclose(found, pose((0.001, 0.00002, 0.003), (0.01, 0.02, 0.03)), atol=1e-12)
        self.assertEqual([float(v) for v in ros1[0][6:13]], [float(words[k]) for k in ("--x", "--y", "--z", "--qx", "--qy", "--qz", "--qw")])
        self.assertEqual(ros1[0][13:], ["optical", "left"])
        self.assertEqual(self.exported("static_transforms", "--sensor", "fixed").count("ros2 run"), 1)

    def test_easy_handeye(self):
        data = yaml.safe_load(self.exported("easy_handeye", "--sensor", "left"))
        self.assertEqual(data["parameters"]["eye_on_hand"], True)
        self.assertEqual(data["parameters"]["robot_base_frame"], "base")
        self.assertEqual(data["parameters"]["robot_effector_frame"], "optical")
        t = data["transformation"]
        self.assertTrue(all(isinstance(v, float) for v in t.values()), t)  # 2e-05 would be a text
        np.testing.assert_allclose(from_quat([t["x"], t["y"], t["z"]], [t["qx"], t["qy"], t["qz"], t["qw"]]),
                                   pose((0.001, 0.00002, 0.003), (0.01, 0.02, 0.03)), atol=1e-12)
        data = yaml.safe_load(self.exported("easy_handeye", "--sensor", "fixed"))
        self.assertEqual(data["parameters"]["eye_on_hand"], False)
        self.assertEqual((data["parameters"]["robot_effector_frame"], data["parameters"]["tracking_marker_frame"]), ("tool", "held"))
        t = data["transformation"]
        np.testing.assert_allclose(from_quat([t["x"], t["y"], t["z"]], [t["qx"], t["qy"], t["qz"], t["qw"]]),
                                   pose((1, 0, 0.5), (0, 0, 3)) @ pose((0, 0, 0.2), (1, 0, 0)), atol=1e-12)
        two = yaml.safe_load(self.exported("easy_handeye2", "--sensor", "fixed"))
        self.assertEqual((two["parameters"]["calibration_type"], two["parameters"]["name"]), ("eye_on_base", "fixed"))
        self.assertEqual([two["transform"]["translation"][k] for k in "xyz"] + [two["transform"]["rotation"][k] for k in "xyzw"],
                         [t[k] for k in ("x", "y", "z", "qx", "qy", "qz", "qw")])

    def test_a_joint_as_mount(self):
        self.write("rig.yaml", RIG.replace("pose: {xyz: [0.001, 0.00002, 0.003], rpy: [0.01, 0.02, 0.03]}", "mount: joint/cam_joint"))
        data = yaml.safe_load(self.exported("easy_handeye", "--sensor", "left"))
        self.assertEqual((data["parameters"]["robot_effector_frame"], data["parameters"]["tracking_base_frame"]), ("tool", "optical"))
        t = data["transformation"]
        np.testing.assert_allclose(from_quat([t["x"], t["y"], t["z"]], [t["qx"], t["qy"], t["qz"], t["qw"]]),
                                   pose((0.01, 0.02, 0.03), (0.1, 0.2, 0.3)), atol=1e-12)
        text = self.exported("static_transforms", "--sensor", "left")
        self.assertIn("--frame-id tool --child-frame-id optical", text)
        self.assertIn("already", text)

    def test_wrong(self):
        self.fails(["export", "rig.yaml", "--as", "camera_inf"], "--as", "camera_info", "kalibr")
        self.fails(["export", "rig.yaml", "--as", "camera_info"], "one sensor", "left, right, fixed, stereo")
        self.fails(["export", "rig.yaml", "--as", "camera_info", "--sensor", "lef"], "'lef'", "nearest: left")
        self.fails(["export", "rig.yaml", "--as", "easy_handeye", "--sensor", "stereo"], "sensors.stereo", "pose", "kincal calibrate")
        self.write("rig.yaml", RIG.replace("    image_size: [640, 480]\n    intrinsics: [500.5", "    intrinsics: [500.5"))
        self.fails(["export", "rig.yaml", "--as", "camera_info", "--sensor", "left"], "sensors.left", "image_size")
        self.fails(["export", "nowhere", "--as", "kalibr"], "nowhere")
        self.good("export", "rig.yaml", "--as", "opencv", "--sensor", "left", "--out", "file.yml")
        self.fails(["export", "rig.yaml", "--as", "opencv", "--sensor", "left", "--out", "file.yml"], "file.yml", "--force")


def origin_of(element):
    numbers = lambda key: [float(v) for v in element.get(key).split()]
    return pose(numbers("xyz"), numbers("rpy"))


def expanded(xacro):
    """What xacro makes of the few things that are written: properties, and ${NAME} in attributes."""
    root = ElementTree.fromstring('<robot xmlns:xacro="http://www.ros.org/wiki/xacro">%s</robot>' % xacro)
    values = {}
    for node in root.findall("{http://www.ros.org/wiki/xacro}property"):
        assert re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", node.get("name")), node.get("name")
        values[node.get("name")] = node.get("value")
        root.remove(node)
    for node in root.iter():
        for key, text in node.attrib.items():
            node.set(key, re.sub(r"\$\{(\w+)\}", lambda m: values[m.group(1)], text))
    return root


class Mounts(Case):
    """Where people put it: on their description of the robot, by the frame of the sensor's driver."""
    OPTICAL = pose((0.01, 0.02, 0.03), (0.1, 0.2, 0.3)) @ pose((0.001, 0.00002, 0.003), (0.01, 0.02, 0.03))  # of left, in tool

    def test_urdf(self):
        robot = ElementTree.fromstring("<robot>%s</robot>" % self.exported("urdf"))
        self.assertEqual([link.get("name") for link in robot.findall("link")], ["left", "right", "fixed", "board", "held"])
        joints = {joint.find("child").get("link"): joint for joint in robot.findall("joint")}
        self.assertEqual({joint.get("type") for joint in joints.values()}, {"fixed"})
        self.assertEqual(joints["right"].find("parent").get("link"), "second")
        np.testing.assert_allclose(origin_of(joints["right"].find("origin")), pose((0, 0.1, 0), (0.2, 0, 0)), atol=1e-12)
        self.assertIn("stereo", self.good("export", "rig.yaml", "--as", "urdf").stderr)  # it has no pose

    def test_xacro_is_the_urdf(self):
        for more in ([], ["--sensor", "fixed"], ["--sensor", "left", "--child", "camera_link", "--known", "0.1 0 0 0 0 0.5"]):
            plain, with_properties = self.exported("urdf", *more), self.exported("xacro", *more)
            self.assertIn("${", with_properties)
            texts = [ElementTree.tostring(root).decode().split() for root in (ElementTree.fromstring("<robot>%s</robot>" % plain), expanded(with_properties))]
            self.assertEqual("".join(texts[0]), "".join(texts[1]))
        self.write("rig.yaml", RIG.replace("  right:", "  9-right.a:"))
        self.assertIn('name="_9_right_a_xyz"', self.exported("xacro", "--sensor", "9-right.a"))

    def test_frame_of_a_driver(self):
        """camera_link is not the optical frame: the driver says what is between."""
        link_optical = pose((0.0175, -0.01, 0.0125), (-math.pi / 2, 0, -math.pi / 2 + 0.002))
        x, y, z, w = quat_of(link_optical[:3, :3])
        for known in ("0.0175 -0.01 0.0125 %.17g 0 %.17g" % (-math.pi / 2, -math.pi / 2 + 0.002), "0.0175, -0.01, 0.0125, %.17g, %.17g, %.17g, %.17g" % (x, y, z, w)):
            robot = ElementTree.fromstring("<robot>%s</robot>" % self.exported("urdf", "--sensor", "left", "--child", "camera_link", "--known", known))
            joint = robot.find("joint")
            self.assertEqual((joint.find("parent").get("link"), joint.find("child").get("link"), robot.find("link").get("name")), ("optical", "camera_link", "camera_link"))
            placed = pose((0.01, 0.02, 0.03), (0.1, 0.2, 0.3)) @ origin_of(joint.find("origin"))
            np.testing.assert_allclose(placed @ link_optical, self.OPTICAL, atol=1e-12)
        line = self.exported("static_transforms", "--sensor", "left", "--child", "camera_link", "--known", known).splitlines()[1].split()
        words = dict(zip(line[4::2], line[5::2]))
        self.assertEqual((words["--frame-id"], words["--child-frame-id"]), ("optical", "camera_link"))
        np.testing.assert_allclose(from_quat([float(words["--" + k]) for k in "xyz"], [float(words["--q" + k]) for k in "xyzw"]), origin_of(joint.find("origin")), atol=1e-12)

    def test_frame_that_the_robot_has(self):
        """The joint above camera_link gets another origin; what is below it stays as it is."""
        below = pose((0, 0.015, 0.001), (-1.57, 0, -1.57))
        self.write("arm.urdf", URDF.replace('<joint name="cam_joint"', '<link name="camera_link"/><joint name="cam_joint"').replace(
            '<child link="optical"/><origin xyz="0.01 0.02 0.03" rpy="0.1 0.2 0.3"/></joint>', '<child link="camera_link"/><origin xyz="0.01 0.02 0.03" rpy="0.1 0.2 0.3"/></joint>'
            '<joint name="optical_joint" type="fixed"><parent link="camera_link"/><child link="optical"/><origin xyz="0 0.015 0.001" rpy="-1.57 0 -1.57"/></joint>'))
        sensor = pose((0.001, 0.00002, 0.003), (0.01, 0.02, 0.03))
        for known in ([], ["--known", "optical"], ["--known", "0 0.015 0.001 -1.57 0 -1.57"]):
            text = self.exported("urdf", "--sensor", "left", "--child", "camera_link", *known)
            self.assertIn("in place of the robot's joint 'cam_joint'", text)
            robot = ElementTree.fromstring("<robot>%s</robot>" % text)
            self.assertEqual(robot.findall("link"), [])
            joint = robot.find("joint")
            self.assertEqual((joint.get("name"), joint.find("parent").get("link"), joint.find("child").get("link")), ("cam_joint", "tool", "camera_link"))
            np.testing.assert_allclose(origin_of(joint.find("origin")) @ below, pose((0.01, 0.02, 0.03), (0.1, 0.2, 0.3)) @ below @ sensor, atol=1e-12)
        # a sensor of the rig that sits on the flange, with the driver's frames beside it
        self.write("rig.yaml", RIG.replace("    link: optical\n    pose: {xyz: [0.001, 0.00002, 0.003]", "    link: tool\n    pose: {xyz: [0.001, 0.00002, 0.003]"))
        joint = ElementTree.fromstring("<robot>%s</robot>" % self.exported("urdf", "--sensor", "left", "--child", "camera_link", "--known", "optical")).find("joint")
        np.testing.assert_allclose(origin_of(joint.find("origin")) @ below, sensor, atol=1e-12)
        self.fails(["export", "rig.yaml", "--as", "urdf", "--sensor", "left", "--child", "camera_link"], "--child", "'tool'", "--known")

    def test_poses(self):
        """Numbers of controllers, against elementary rotations; and all formats through `import`, whose formulas are tested below."""
        shall = pose((0.2, 0, 0.01)) , pose((0, 0, 0.2), (1, 0, 0))
        rows = {}
        for format in ("kuka", "fanuc", "abb", "rotvec", "xyzw", "wxyz", "rpy", "rpy_deg", "matrix"):
            text = self.exported("poses", "--pose-format", format)
            lines = [line.split(",") for line in text.splitlines()]
            self.assertEqual([line[:2] for line in lines[1:]], [["left", "optical"], ["right", "second"], ["fixed", "cam_mount"], ["board", "base"], ["held", "tool"]])
            rows[format] = {line[0]: [float(v) for v in line[2:]] for line in lines[1:]}
            self.write("p.csv", text)
            read = [json.loads(line) for line in self.good("import", "p.csv", "--pose-format", format).stdout.splitlines()]
            self.assertEqual([line["id"] for line in read], ["left", "right", "fixed", "board", "held"])
            for line, t in ((read[4], shall[0]), (read[2], shall[1]), (read[3], pose((1, 0.1, 0.2), (0.1, 0.2, 0.3)))):
                flange = line["joints"]["flange"]
                np.testing.assert_allclose(from_quat(flange["xyz"], flange["quat"]), t, atol=1e-12)
        x, y, z, a, b, c = rows["kuka"]["board"]
        np.testing.assert_allclose(about(Z, a * DEG) @ about(Y, b * DEG) @ about(X, c * DEG), rpy(0.1, 0.2, 0.3), atol=1e-12)
        np.testing.assert_allclose([x, y, z], [1000, 100, 200], atol=1e-9)
        x, y, z, w, p, r = rows["fanuc"]["board"]
        np.testing.assert_allclose(about(Z, r * DEG) @ about(Y, p * DEG) @ about(X, w * DEG), rpy(0.1, 0.2, 0.3), atol=1e-12)
        turned = np.array(rows["rotvec"]["board"][3:])
        np.testing.assert_allclose(about(turned / np.linalg.norm(turned), np.linalg.norm(turned)), rpy(0.1, 0.2, 0.3), atol=1e-12)
        np.testing.assert_allclose(np.reshape(rows["matrix"]["board"], (4, 4)), pose((1, 0.1, 0.2), (0.1, 0.2, 0.3)), atol=1e-12)
        self.assertEqual(rows["abb"]["held"], [200, 0, 10, 1, 0, 0, 0])
        # what a joint places, and a driver's frame
        self.write("rig.yaml", RIG.replace("    link: optical\n    pose: {xyz: [0.001,", "    link: optical\n    mount: joint/cam_joint\n    pose: {xyz: [0.001,"))
        name, link, *numbers = self.exported("poses", "--pose-format", "matrix", "--sensor", "left").splitlines()[1].split(",")
        self.assertEqual((name, link), ("left", "tool"))
        np.testing.assert_allclose(np.reshape([float(v) for v in numbers], (4, 4)), self.OPTICAL, atol=1e-12)
        self.assertIn("left,tool,", self.exported("poses", "--pose-format", "kuka", "--sensor", "left", "--child", "camera_link", "--known", "0 0 0 0 0 0"))
        self.fails(["export", "rig.yaml", "--as", "poses"], "--pose-format is missing", "kuka")
        self.fails(["export", "rig.yaml", "--as", "poses", "--pose-format", "kuk"], "--pose-format", "kuka")
        self.fails(["export", "rig.yaml", "--as", "urdf", "--pose-format", "kuka"], "--pose-format", "poses")

    def test_wrong(self):
        base = ["export", "rig.yaml", "--as", "urdf"]
        self.fails([*base, "--child", "camera_link", "--known", "0 0 0 0 0 0"], "--child is about one sensor", "left, right")
        self.fails([*base, "--sensor", "left", "--child", "camera_link"], "'camera_link' is not a link", "--known")
        self.fails([*base, "--sensor", "left", "--child", "optica"], "nearest: optical")
        self.fails([*base, "--sensor", "left", "--child", "optical", "--known", "0 0 0"], "--known", "'0 0 0'")
        self.fails([*base, "--sensor", "left", "--child", "a", "--known", "0 0 0 1 1 0 0"], "--known", "length")
        self.fails([*base, "--sensor", "left", "--child", "tool"], "'tool'", "moves")
        self.fails([*base, "--sensor", "left", "--child", "base", "--known", "0 0 0 0 0 0"], "root")
        self.fails([*base, "--sensor", "left", "--known", "0 0 0 0 0 0"], "--known needs --child")
        self.fails([*base, "--sensor", "stereo", "--child", "a", "--known", "0 0 0 0 0 0"], "sensors.stereo", "kincal calibrate")
        self.fails(["export", "rig.yaml", "--as", "kalibr", "--child", "a"], "--child", "static_transforms, urdf, xacro, poses")


# ------------------------------------------------------------------------------------------------ in
class Import(Case):
    def round_trip(self, format, name, file="camera.yaml", *more):
        self.good("export", "rig.yaml", "--as", format, "--sensor", name, "--out", file, "--force")
        blank = RIG.replace("[500.5, 501.25, 320.125, 240.75]", "[1, 1, 0, 0]").replace("[300, 301, 400, 300]", "[1, 1, 0, 0]")
        blank = blank.replace("[-0.21, 0.11, 0.001, -0.002, 0.03]", "[0, 0, 0, 0, 0]").replace("    baseline: 0.09\n", "")
        self.write("blank.yaml", blank)
        self.good("import", file, "--rig", "blank.yaml", "--sensor", name, "--out", "new.yaml", "--force", *more)
        self.same_camera(self.sensor("new.yaml", name), self.sensor("rig.yaml", name), format == "camera_info")

    def test_round_trips(self):
        for format in ("camera_info", "opencv"):
            for name in ("left", "right", "fixed", "stereo"):
                with self.subTest(format=format, name=name):
                    self.round_trip(format, name)
        self.write("rig.yaml", RIG.replace("-0.002, 0.03]", "-0.002, 0]"))
        for name in ("left", "right"):
            self.round_trip("kalibr", name)

    def test_what_the_file_does_not_know_stays(self):
        """A baseline is not in OpenCV's and Kalibr's files, nor in a camera_info whose P is not taken: the rig's stays."""
        for format in ("opencv", "kalibr", "camera_info"):
            with self.subTest(format=format):
                self.good("export", "rig.yaml", "--as", format, "--sensor", "stereo", "--out", "c.yaml", "--force")
                if format == "camera_info":
                    self.write("c.yaml", self.read("c.yaml").split("projection_matrix")[0])
                self.good("import", "c.yaml", "--rig", "rig.yaml", "--sensor", "stereo", "--out", "new.yaml", "--force")
                self.same_camera(self.sensor("new.yaml", "stereo"), self.sensor("rig.yaml", "stereo"))
        # a P that is filled in says that there is none
        self.write("c.yaml", self.exported("camera_info", "--sensor", "stereo").replace("-36.0, 0.0, 400.0", "0.0, 0.0, 400.0"))
        self.good("import", "c.yaml", "--rig", "rig.yaml", "--sensor", "stereo", "--out", "new.yaml", "--force")
        self.assertNotIn("baseline", self.sensor("new.yaml", "stereo"))

    def test_comments_stay(self):
        self.good("export", "rig.yaml", "--as", "camera_info", "--sensor", "right", "--out", "c.yaml")
        run = self.good("import", "c.yaml", "--rig", "rig.yaml", "--sensor", "left", "--out", "new.yaml")
        self.assertIn("800 x 600", run.stderr)  # another size than the rig's
        old, new = RIG.splitlines(), self.read("new.yaml").splitlines()
        self.assertEqual(len(old), len(new))
        changed = [(a, b) for a, b in zip(old, new) if a != b]
        self.assertEqual([b.split(":")[0].strip() for a, b in changed], ["model", "image_size", "intrinsics", "distortion"])
        self.assertEqual(changed[0][1], "    model: kannala_brandt        # the lens")
        self.assertIn("# fx fy cx cy", changed[2][1])

    def test_flow_style(self):
        """An entry in brackets is written anew, on one line, on two, and with a last bracket of its own; all else stays."""
        self.good("export", "rig.yaml", "--as", "camera_info", "--sensor", "right", "--out", "c.yaml")
        head, tail = RIG.split("  fixed: {")
        entry = "  fixed: {" + tail.split("\n  stereo")[0]
        for text in (entry, entry.replace("\n         ", " "), entry.replace("sigma: 0.2}", "sigma: 0.2\n         }")):
            self.write("rig.yaml", RIG.replace(entry, text))
            run = self.good("import", "c.yaml", "--rig", "rig.yaml", "--sensor", "fixed", "--out", "new.yaml", "--force")
            self.assertNotIn("comments", run.stderr)
            new = self.read("new.yaml")
            self.assertTrue(new.startswith(head), new)
            self.assertTrue(new.endswith("\n  stereo" + RIG.split("\n  stereo")[1]), new)
            self.same_camera(self.sensor("new.yaml", "fixed"), self.sensor("rig.yaml", "right"))
        self.write("rig.yaml", RIG.replace("sensors:\n", "sensors: {one: {type: camera, link: optical, model: pinhole, intrinsics: [1, 1, 0, 0], sigma: 1}}\n#")
                   .split("#  # the first")[0])
        run = self.good("import", "c.yaml", "--rig", "rig.yaml", "--out", "new.yaml", "--force")
        self.assertIn("its comments are lost", run.stderr)
        self.same_camera(self.sensor("new.yaml", "one"), yaml.safe_load(RIG)["sensors"]["right"])

    def test_another_folder(self):
        os.mkdir(self.path("sub"))
        self.good("export", "rig.yaml", "--as", "camera_info", "--sensor", "left", "--out", "c.yaml")
        self.good("import", "c.yaml", "--rig", "rig.yaml", "--sensor", "left", "--out", "sub/new.yaml")
        self.assertIn("robot: ../arm.urdf", self.read("sub/new.yaml"))
        self.assertIn("# the arm", self.read("sub/new.yaml"))

    def test_printed(self):
        self.good("export", "rig.yaml", "--as", "camera_info", "--sensor", "left", "--out", "c.yaml")
        keys = yaml.safe_load(self.good("import", "c.yaml").stdout)
        self.assertEqual(keys, {"model": "brown_conrady", "image_size": [640, 480], "intrinsics": [500.5, 501.25, 320.125, 240.75],
                                "distortion": [-0.21, 0.11, 0.001, -0.002, 0.03]})

    def test_message(self):
        """As `ros2 topic echo --once` and `rostopic echo` print it."""
        for k, d, r, p in (("k", "d", "r", "p"), ("K", "D", "R", "P")):
            self.write("m.yaml", f"""header:
  stamp:
    sec: 1
    nanosec: 2
  frame_id: cam
height: 480
width: 640
distortion_model: rational_polynomial
{d}:
- 0.1
- 0.2
- 0.001
- 0.002
- 0.3
- 0.4
- 0.5
- 0.6
{k}: [600.0, 0.0, 320.0, 0.0, 601.0, 240.0, 0.0, 0.0, 1.0]
{r}: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
{p}: [600.0, 0.0, 320.0, -60.0, 0.0, 601.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
roi:
  x_offset: 0
  width: 0
---
""")
            keys = yaml.safe_load(self.good("import", "m.yaml").stdout)
            self.assertEqual(keys, {"model": "brown_conrady", "image_size": [640, 480], "intrinsics": [600, 601, 320, 240],
                                    "distortion": [0.1, 0.2, 0.001, 0.002, 0.3, 0.4, 0.5, 0.6], "baseline": 0.1})
            for key in ("binning_x: ", "  width: "):
                self.assertNotIn("full", self.good("import", "m.yaml").stderr)
                self.write("m.yaml", self.read("m.yaml").replace(key + "0", key + "2"))
                self.assertIn("full resolution", self.good("import", "m.yaml").stderr)
                self.write("m.yaml", self.read("m.yaml").replace(key + "2", key + "0"))

    def test_rectified(self):
        text = self.exported("camera_info", "--sensor", "left")
        turned = text.replace("data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]", "data: [0.8, -0.6, 0.0, 0.6, 0.8, 0.0, 0.0, 0.0, 1.0]")
        turned = turned.replace("[500.5, 0.0, 320.125, 0.0, 0.0, 501.25, 240.75, 0.0,", "[450.0, 0.0, 330.0, -45.0, 0.0, 450.0, 230.0, 0.0,")
        self.assertEqual(turned.count("450.0"), 2)
        self.write("c.yaml", turned)
        run = self.good("import", "c.yaml")
        self.assertIn("--rectified", run.stderr)
        self.assertEqual(yaml.safe_load(run.stdout)["intrinsics"], [500.5, 501.25, 320.125, 240.75])
        self.assertNotIn("baseline", run.stdout)
        run = self.good("import", "c.yaml", "--rectified")
        self.assertIn("baseline", run.stderr)
        self.assertEqual(yaml.safe_load(run.stdout), {"model": "pinhole", "image_size": [640, 480], "intrinsics": [450, 450, 330, 230], "baseline": 0.1})

    def test_projection_that_nobody_filled_in(self):
        text = self.exported("camera_info", "--sensor", "left")
        for p in ("[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]", "[]"):
            self.write("c.yaml", text.split("projection_matrix")[0] + "projection_matrix:\n  data: " + p + "\n")
            run = self.good("import", "c.yaml")
            self.assertEqual((run.stderr, yaml.safe_load(run.stdout)["intrinsics"]), ("", [500.5, 501.25, 320.125, 240.75]))
            self.fails(["import", "c.yaml", "--rectified"], "projection_matrix")

    def test_opencv(self):
        """As OpenCV's own calibration programs write it, in both of its texts."""
        self.write("c.yml", """%YAML:1.0
---
calibration_time: "Mon Nov 23 03:02:04 2026"
image_width: 640
image_height: 480
flags: 0
fisheye_model: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 6.5746697810243404e+02, 0., 3.1950000000000000e+02, 0.,
       6.5746697810243404e+02, 2.3950000000000000e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -2.6637260909660682e-01, -3.8588898922304653e-02, 1.7831947042852964e-03,
       -2.8122100441115472e-04, 2.3839153080878486e-01 ]
avg_reprojection_error: 2.2
""")
        self.write("c.xml", """<?xml version="1.0"?>
<opencv_storage>
<calibration_time>"Mon Nov 23 03:02:04 2026"</calibration_time>
<image_width>640</image_width>
<image_height>480</image_height>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>
    6.5746697810243404e+02 0. 3.1950000000000000e+02 0.
    6.5746697810243404e+02 2.3950000000000000e+02 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>5</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>
    -2.6637260909660682e-01 -3.8588898922304653e-02
    1.7831947042852964e-03 -2.8122100441115472e-04
    2.3839153080878486e-01</data></distortion_coefficients>
</opencv_storage>
""")
        expected = {"model": "brown_conrady", "image_size": [640, 480], "intrinsics": [657.46697810243404] * 2 + [319.5, 239.5],
                    "distortion": [-0.26637260909660682, -0.038588898922304653, 0.0017831947042852964, -0.00028122100441115472, 0.23839153080878486]}
        for name in ("c.yml", "c.xml"):
            self.assertEqual(yaml.safe_load(self.good("import", name).stdout), expected)
        self.write("f.yml", "%YAML:1.0\n---\nK: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 300., 0., 400., 0., 301., 300., 0., 0., 1. ]\n"
                            "D: !!opencv-matrix\n   rows: 4\n   cols: 1\n   dt: d\n   data: [ 0.1, 0.2, 0.3, 0.4 ]\n")
        self.assertEqual(yaml.safe_load(self.good("import", "f.yml").stdout)["distortion"], [0.1, 0.2, 0.3, 0.4, 0])
        self.assertEqual(yaml.safe_load(self.good("import", "f.yml", "--fisheye").stdout),
                         {"model": "kannala_brandt", "intrinsics": [300, 301, 400, 300], "distortion": [0.1, 0.2, 0.3, 0.4]})

    def test_stereo_pair(self):
        matrix = "%s: !!opencv-matrix\n   rows: %d\n   cols: %d\n   dt: d\n   data: [ %s ]\n"
        self.write("s.yml", "%YAML:1.0\n---\n" + "".join(
            matrix % ("M%d" % i, 3, 3, "%d00., 0., 320., 0., %d00., 240., 0., 0., 1." % (i + 5, i + 5)) +
            matrix % ("D%d" % i, 1, 5, "0.%d, 0., 0., 0., 0." % i) for i in (1, 2)))
        self.fails(["import", "s.yml"], "s.yml", "--camera 1")
        keys = yaml.safe_load(self.good("import", "s.yml", "--camera", "2").stdout)
        self.assertEqual((keys["intrinsics"], keys["distortion"][0]), ([700, 700, 320, 240], 0.2))

    def test_wrong_cameras(self):
        good = self.exported("camera_info", "--sensor", "left")

        def refused(text, *words):
            self.write("c.yaml", text)
            self.fails(["import", "c.yaml", "--rig", "rig.yaml", "--sensor", "left", "--out", "new.yaml"], "c.yaml", *words)
            self.assertFalse(os.path.exists(self.path("new.yaml")))

        refused(good.replace("plumb_bob", "plum_bob"), "c.yaml:8: distortion_model", "'plum_bob'", "plumb_bob", "equidistant")
        refused(good.replace("501.25, 240.75, 0.0, 0.0, 1.0]", "501.25, 240.75, 0.0, 0.0]", 1), "c.yaml:7: camera_matrix.data", "rows x cols")
        refused(good.replace("data: [500.5, 0.0, 320.125, 0.0,", "data: [500.5, 2.0, 320.125, 0.0,", 1), "camera_matrix", "skew of 2 px")
        refused(good.replace("500.5", "0").replace("501.25", "0"), "camera_matrix", "not calibrated")
        refused(good.replace("data: [-0.21, 0.11,", "data: [.nan, 0.11,"), "distortion_coefficients")
        refused(good.replace("camera_matrix", "camera_matrx"), "no camera in this file", "camera_matrix", "cam0")
        refused("", "empty")
        refused("<robot/>", "opencv_storage")
        refused("PK\x03\x04", "zip")
        chain = "cam0:\n  camera_model: %s\n  intrinsics: [0.5, 400, 400, 320, 240]\n  distortion_model: %s\n  distortion_coeffs: [0, 0, 0, 0]\n  resolution: [640, 480]\n"
        refused(chain % ("eucm", "none"), "c.yaml:2: cam0.camera_model", "'eucm'", "radtan", "equidistant", "ds")
        refused(chain % ("omni", "equidistant"), "c.yaml:4: cam0.distortion_model", "'equidistant'", "radtan")
        refused(chain % ("ds", "none"), "cam0.intrinsics", "6")
        refused((chain % ("pinhole", "fov")).replace("0.5, ", ""), "c.yaml:4: cam0.distortion_model", "'fov'", "radtan")
        refused(chain % ("pinhole", "radtan"), "cam0.intrinsics", "4")
        self.write("c.yaml", good)
        self.fails(["import", "c.yaml", "--rig", "rig.yaml", "--out", "new.yaml"], "--sensor", "left, right, fixed, stereo")
        self.fails(["import", "c.yaml", "--rig", "rig.yaml", "--sensor", "lft", "--out", "new.yaml"], "'lft'", "left")
        self.fails(["import", "c.yaml", "--rig", "rig.yaml", "--sensor", "left"], "--out")
        self.fails(["import", "c.yaml", "--out", "new.yaml"], "--rig")
        self.fails(["import", "rig.yaml"], "this is a rig")

    def test_camchain(self):
        self.write("c.yaml", """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.2, 0.1, 0.001, 0.002]
  distortion_model: radtan
  intrinsics: [461.6, 460.3, 362.7, 246.6]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.99, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [0.1, 0.2, 0.3, 0.4]
  distortion_model: equidistant
  intrinsics: [461.6, 460.3, 362.7, 246.6]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
""")
        self.fails(["import", "c.yaml"], "--camera", "cam0, cam1")
        self.fails(["import", "c.yaml", "--camera", "cam3"], "cam3", "cam0, cam1")
        self.assertEqual(yaml.safe_load(self.good("import", "c.yaml", "--camera", "cam0").stdout),
                         {"model": "brown_conrady", "image_size": [752, 480], "intrinsics": [461.6, 460.3, 362.7, 246.6], "distortion": [-0.2, 0.1, 0.001, 0.002, 0]})
        run = self.good("import", "c.yaml", "--camera", "cam1")
        self.assertIn("T_cn_cnm1", run.stderr)
        self.assertEqual(yaml.safe_load(run.stdout)["model"], "kannala_brandt")

    def printed(self, name, text, *more):
        self.write(name, text)
        run = self.good("import", name, *more)
        return yaml.safe_load(run.stdout), run.stderr

    def test_new_lenses(self):
        """Double sphere, unified, 12 and 14 numbers: out to the formats that have them, in again; refused by those that do not."""
        numbers = {"unified": [1.2, -0.1, 0.02, 0.001, -0.002], "double_sphere": [-0.27, 0.57],
                   "brown_conrady": [0.1, -0.2, 0.001, -0.002, 0.05, 0.3, -0.1, 0.02, 0.001, -0.002, 0.003, 0.0005]}
        for model, distortion, formats in (("unified", numbers["unified"], ["kalibr"]), ("double_sphere", numbers["double_sphere"], ["kalibr"]),
                                           ("brown_conrady", numbers["brown_conrady"], ["opencv"]), ("brown_conrady", numbers["brown_conrady"] + [0.01, -0.02], ["opencv"])):
            self.write("rig.yaml", RIG.replace("model: brown_conrady", "model: " + model, 1).replace("[-0.21, 0.11, 0.001, -0.002, 0.03]", str(distortion), 1))
            for format in ("camera_info", "opencv", "kalibr"):
                with self.subTest(model=model, numbers=len(distortion), format=format):
                    if format in formats:
                        self.good("export", "rig.yaml", "--as", format, "--sensor", "left", "--out", "c.yaml", "--force")
                        keys = yaml.safe_load(self.good("import", "c.yaml").stdout)
                        self.assertEqual((keys["model"], keys["intrinsics"], keys["distortion"]), (model, [500.5, 501.25, 320.125, 240.75], distortion))
                    else:
                        self.fails(["export", "rig.yaml", "--as", format, "--sensor", "left"], "sensors.left", "--as")

    def test_other_programs(self):
        """VINS, Basalt, mrcal, MC-Calib, ost.txt, RealSense: the numbers, or what is not supported and what to do."""
        vins = "%YAML:1.0\n---\nmodel_type: {}\ncamera_name: eye\nimage_width: 640\nimage_height: 480\n"
        radtan = "distortion_parameters:\n   k1: -0.1\n   k2: 0.02\n   p1: 0.001\n   p2: -0.002\n"
        keys, _ = self.printed("v.yaml", vins.format("PINHOLE") + radtan + "projection_parameters:\n   fx: 400.5\n   fy: 401.5\n   cx: 320\n   cy: 240\n")
        self.assertEqual(keys, {"model": "brown_conrady", "image_size": [640, 480], "intrinsics": [400.5, 401.5, 320, 240], "distortion": [-0.1, 0.02, 0.001, -0.002, 0]})
        keys, _ = self.printed("v.yaml", vins.format("MEI") + "mirror_parameters:\n   xi: 1.5\n" + radtan +
                               "projection_parameters:\n   gamma1: 900\n   gamma2: 901\n   u0: 320\n   v0: 240\n")
        self.assertEqual((keys["model"], keys["intrinsics"], keys["distortion"]), ("unified", [900, 901, 320, 240], [1.5, -0.1, 0.02, 0.001, -0.002]))
        fisheye = "projection_parameters:\n   k2: -0.003\n   k3: 0.04\n   k4: -0.03\n   k5: 0.006\n   mu: 286.5\n   mv: 286\n   u0: 320\n   v0: 240\n"
        keys, _ = self.printed("v.yaml", vins.format("KANNALA_BRANDT") + fisheye)
        self.assertEqual((keys["model"], keys["intrinsics"], keys["distortion"]), ("kannala_brandt", [286.5, 286, 320, 240], [-0.003, 0.04, -0.03, 0.006]))
        self.write("v.yaml", vins.format("SCARAMUZZA"))
        self.fails(["import", "v.yaml"], "v.yaml:3: model_type", "'SCARAMUZZA'", "KANNALA_BRANDT", "kincal intrinsics")

        def basalt(kind, **numbers):
            camera = {"camera_type": kind, "intrinsics": dict(fx=380.5, fy=381, cx=510, cy=514, **numbers)}
            return json.dumps({"value0": {"T_imu_cam": [{"px": 0}], "intrinsics": [camera, camera], "resolution": [[1024, 1000], [640, 480]]}})
        self.write("b.json", basalt("ds", xi=-0.2, alpha=0.6))
        self.fails(["import", "b.json"], "--camera", "cam0, cam1")
        keys, said = self.printed("b.json", basalt("ds", xi=-0.2, alpha=0.6), "--camera", "cam0")
        self.assertEqual(keys, {"model": "double_sphere", "image_size": [1024, 1000], "intrinsics": [380.5, 381, 510, 514], "distortion": [-0.2, 0.6]})
        self.assertIn("T_imu_cam", said)
        keys, _ = self.printed("b.json", basalt("kb4", k1=0.01, k2=0.02, k3=0.03, k4=0.04), "--camera", "cam1")
        self.assertEqual((keys["model"], keys["image_size"], keys["distortion"]), ("kannala_brandt", [640, 480], [0.01, 0.02, 0.03, 0.04]))
        keys, _ = self.printed("b.json", basalt("ucm", alpha=0.5), "--camera", "cam0")
        self.assertEqual((keys["model"], keys["intrinsics"], keys["distortion"]), ("unified", [761, 762, 510, 514], [1, 0, 0, 0, 0]))
        self.assertEqual(self.printed("b.json", basalt("pinhole"), "--camera", "cam0")[0]["model"], "pinhole")
        self.write("b.json", basalt("eucm", alpha=0.5, beta=1.0))
        self.fails(["import", "b.json", "--camera", "cam0"], "camera_type", "'eucm'", "ds")

        mrcal = "# made on a day\n{\n    'lensmodel':  'LENSMODEL_%s',\n    # fx fy cx cy\n    'intrinsics': [ 600, 601, 320, 240, %s],\n    'extrinsics': [ 0, 0, 0, 0, 0, %s ],\n    'imagersize': [ 640, 480 ]\n}\n"
        for count in (4, 5, 8, 12):
            d = [0.01 * (i + 1) for i in range(count)]
            keys, said = self.printed("m.cameramodel", mrcal % ("OPENCV%d" % count, "".join("%g, " % v for v in d), "0"))
            self.assertEqual((keys["model"], keys["distortion"]), ("brown_conrady", [round(v, 9) for v in d] + [0] * (count == 4)))
            self.assertNotIn("extrinsics", said)
        keys, said = self.printed("m.cameramodel", mrcal.split("\n", 1)[1] % ("PINHOLE", "", "1"))  # and without a line before it
        self.assertEqual(keys, {"model": "pinhole", "image_size": [640, 480], "intrinsics": [600, 601, 320, 240]})
        self.assertIn("extrinsics", said)
        self.write("m.cameramodel", mrcal % ("SPLINED_STEREOGRAPHIC_order=3", "1, ", "0"))
        self.fails(["import", "m.cameramodel"], "lensmodel", "SPLINED", "mrcal-convert-lensmodel")
        self.write("m.cameramodel", mrcal % ("OPENCV8", "1, ", "0"))
        self.fails(["import", "m.cameramodel"], "intrinsics", "12 numbers")

        camera = ("camera_%d:\n   camera_matrix: !!opencv-matrix\n      rows: 3\n      cols: 3\n      dt: d\n      data: [ 1213., 0., 640., 0., 1212., 361., 0., 0., 1. ]\n"
                  "   distortion_vector: !!opencv-matrix\n      rows: 1\n      cols: %d\n      dt: d\n      data: [ %s ]\n   distortion_type: %d\n   camera_group: 0\n"
                  "   img_width: 1280\n   img_height: 720\n")
        both = "%YAML:1.0\n---\nnb_camera: 2\n" + camera % (0, 5, "-0.1, 0.05, 0., 0., 0.", 0) + camera % (1, 4, "0.01, 0.02, 0.03, 0.04", 1)
        self.write("mc.yml", both)
        self.fails(["import", "mc.yml"], "--camera", "camera_0, camera_1")
        keys, _ = self.printed("mc.yml", both, "--camera", "camera_1")
        self.assertEqual(keys, {"model": "kannala_brandt", "image_size": [1280, 720], "intrinsics": [1213, 1212, 640, 361], "distortion": [0.01, 0.02, 0.03, 0.04]})
        self.assertEqual(self.printed("mc.yml", both, "--camera", "camera_0")[0]["model"], "brown_conrady")

        ost = ("# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n640\n\nheight\n480\n\n[narrow_stereo]\n\ncamera matrix\n601.5 0.000000 318.5\n0.000000 600.5 243.25\n"
               "0.000000 0.000000 1.000000\n\ndistortion\n%s\n\nrectification\n1.0 0.0 0.0\n0.0 1.0 0.0\n0.0 0.0 1.0\n\nprojection\n590.1 0.0 318.0 0.0\n0.0 592.0 243.0 0.0\n0.0 0.0 1.0 0.0\n\n")
        keys, _ = self.printed("ost.txt", ost % "-0.14 0.039 0.0003 -0.0006 0.0")
        self.assertEqual(keys, {"model": "brown_conrady", "image_size": [640, 480], "intrinsics": [601.5, 600.5, 318.5, 243.25], "distortion": [-0.14, 0.039, 0.0003, -0.0006, 0]})
        self.assertEqual(len(self.printed("ost.txt", ost % "0.1 0.2 0 0 0.1 0.1 0.2 0.1")[0]["distortion"]), 8)
        self.assertEqual(self.printed("ost.txt", ost % "0 0 0 0 0", "--rectified")[0]["intrinsics"], [590.1, 592, 318, 243])

        real = ' Intrinsic of "%s" / 1280x720 / {YUYV/RGB8}\n  Width:        1280\n  Height:       720\n  PPX:          644.125\n  PPY:          362.5\n  Fx:           913.5\n  Fy:           912.25\n' \
               "  Distortion:   %s\n  Coeffs:       %s\n  FOV (deg):    70.0 x 43.1\n\n"
        keys, _ = self.printed("rs.txt", real % ("Color", "Inverse Brown Conrady", "0  0  0  0  0"))
        self.assertEqual(keys, {"model": "pinhole", "image_size": [1280, 720], "intrinsics": [913.5, 912.25, 644.125, 362.5]})
        self.write("rs.txt", real % ("Color", "Inverse Brown Conrady", "0.1  0  0  0  0"))
        self.fails(["import", "rs.txt"], "Distortion", "'Inverse Brown Conrady'", "kincal intrinsics")
        two = real % ("Color", "Brown Conrady", "0.1 0 0 0 0") + real % ("Fisheye", "Kannala Brandt4", "0.1 0.2 0.3 0.4 0")
        self.write("rs.txt", two)
        self.fails(["import", "rs.txt"], "--camera", "Color 1280x720", "Fisheye 1280x720")
        self.assertEqual(self.printed("rs.txt", two, "--camera", "Fisheye 1280x720")[0]["distortion"], [0.1, 0.2, 0.3, 0.4])
        self.write("m.txt", "fc = [ 657.4 ; 657.9 ];\ncc = [ 303.1 ; 242.5 ];\nalpha_c = 0.0004;\nkc = [ -0.25 ; 0.12 ; -0.0002 ; 0.00002 ; 0.0 ];\n")
        self.fails(["import", "m.txt"], "MATLAB", "brown_conrady")

    def test_what_looks_right(self):
        """A fisheye that says so as camera_model; skews; mirrored and turning lenses; a baseline with the wrong sign."""
        text = self.exported("camera_info", "--sensor", "right")
        keys, said = self.printed("c.yaml", text.replace("distortion_model: equidistant", "camera_model: fisheye"))
        self.assertEqual((keys["model"], keys["distortion"], said), ("kannala_brandt", [0.01, -0.02, 0.003, -0.0004], ""))
        self.write("c.yaml", text.replace("[300.0, 0.0, 400.0,", "[300.0, -0.95, 400.0,", 1))
        self.fails(["import", "c.yaml"], "skew of -0.95 px", "CALIB_FIX_SKEW")
        self.write("c.yaml", text.replace("[300.0, 0.0, 400.0,", "[-300.0, 0.0, 400.0,", 1))
        self.fails(["import", "c.yaml"], "mirrored", "width - 1 - cx")
        keys, said = self.printed("c.yaml", re.sub(r"data: \[0.01, -0.02, 0.003, [^]]*\]", "data: [-1.15, 2.91, -2.48, 0.18]", text))
        self.assertEqual(keys["distortion"], [-1.15, 2.91, -2.48, 0.18])
        self.assertIn("turns back", said)
        _, said = self.printed("c.yaml", self.exported("camera_info", "--sensor", "stereo").replace("-36.0, 0.0, 400.0", "36.0, 0.0, 400.0"))
        self.assertIn("negative", said)
        self.write("c.yaml", "%YAML:1.0\n---\nK: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 300., 0., 400., 0., 301., 300., 0., 0., 1. ]\n"
                   "D: !!opencv-matrix\n   rows: 1\n   cols: 14\n   dt: d\n   data: [ 0.1, -0.2, 0., 0., 0.05, 0., 0., 0., 0., 0., 0., 0., 0., 0. ]\n")
        self.assertEqual(len(yaml.safe_load(self.good("import", "c.yaml").stdout)["distortion"]), 8)
        self.fails(["import", "rig.yaml"], "this is a rig", "--rig")

    def test_targets(self):
        self.write("a.yaml", "target_type: 'aprilgrid' #gridtype\ntagCols: 6\ntagRows: 5\ntagSize: 0.088\ntagSpacing: 0.3\ncodeOffset: 0\n")
        self.good("import", "a.yaml", "--rig", "rig.yaml", "--target", "board", "--out", "new.yaml")
        board = yaml.safe_load(self.read("new.yaml"))["targets"]["board"]
        mount = board.pop("mount")
        self.assertEqual(mount["link"], "base")
        self.assertEqual(board, {"type": "apriltag_grid", "rows": 5, "columns": 6, "tag": 0.088, "spacing": 0.3, "family": "tag36h11"})
        self.assertIn("# on the wall", self.read("new.yaml"))
        self.write("c.yaml", "target_type: 'checkerboard'\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: 0.06\ncolSpacingMeters: 0.06\n")
        self.assertEqual(yaml.safe_load(self.good("import", "c.yaml").stdout), {"type": "chessboard", "rows": 7, "columns": 6, "square": 0.06})
        self.write("g.yaml", "target_type: 'circlegrid'\ntargetCols: 6\ntargetRows: 7\nspacingMeters: 0.02\nasymmetricGrid: True\n")
        self.assertEqual(yaml.safe_load(self.good("import", "g.yaml").stdout), {"type": "circles", "rows": 7, "columns": 6, "spacing": 0.02, "asymmetric": True})
        self.good("import", "g.yaml", "--rig", "new.yaml", "--target", "held", "--out", "other.yaml")
        held = yaml.safe_load(self.read("other.yaml"))["targets"]["held"]
        self.assertEqual((held["type"], held["mount"]["link"], held.get("points")), ("circles", "tool", None))
        for text, words in (("target_type: ring\n", ("a.yaml:1: target_type", "checkerboard, circlegrid, aprilgrid")),
                            ("target_type: aprilgrid\ntagCols: 6\ntagRows: 0\n", ("a.yaml:3: tagRows", "integer")),
                            ("target_type: aprilgrid\ntagCols: 6\ntagRows: 6\ncodeOffset: 4\n", ("codeOffset", "tag 0")),
                            ("target_type: checkerboard\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: 0.06\ncolSpacingMeters: 0.05\n", ("colSpacingMeters", "squares"))):
            self.write("a.yaml", text)
            self.fails(["import", "a.yaml"], *words)
        self.write("c2.yaml", self.exported("camera_info", "--sensor", "left"))
        self.fails(["import", "c2.yaml", "--target", "board"], "target_type")


# ------------------------------------------------------------------------------------------------ poses
def about(axis, angle):
    """Rodrigues."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


X, Y, Z = np.eye(3)


def quat_of(r):
    """x y z w of a rotation by its eigenvector: another way than the program's."""
    values, vectors = np.linalg.eig(r)
    axis = np.real(vectors[:, np.argmin(np.abs(values - 1))])
    axis /= np.linalg.norm(axis)
    angle = math.atan2(np.dot([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]], axis), np.trace(r) - 1)
    return [*(axis * math.sin(angle / 2)), math.cos(angle / 2)]


DEG = math.pi / 180


class Poses(Case):
    def lines(self, *arguments):
        return [json.loads(line) for line in self.good("import", *arguments).stdout.splitlines()]

    def flange(self, line):
        reading = line["joints"]["flange"]
        return from_quat(reading["xyz"], reading["quat"])

    def test_columns_of_another_format(self):
        """A header that names another convention is not taken by the order of its columns."""
        self.write("p.csv", "X,Y,Z,A,B,C\n100,200,300,10,20,30\n")
        self.fails(["import", "p.csv", "--pose-format", "fanuc"], "p.csv:1", "--pose-format kuka", "not of fanuc")
        self.assertEqual(len(self.lines("p.csv", "--pose-format", "kuka")), 1)

    def test_formats(self):
        """Each convention against elementary rotations by Rodrigues' formula."""
        rng = np.random.default_rng(1)
        for _ in range(5):
            a, b, c = rng.uniform(-1.4, 1.4, 3)
            xyz = rng.uniform(-1, 1, 3)
            zyx = about(Z, c) @ about(Y, b) @ about(X, a)  # rpy (a, b, c)
            x, y, z, w = quat_of(zyx)
            axis = rng.normal(size=3)
            axis /= np.linalg.norm(axis)
            t = np.eye(4)
            t[:3, :3], t[:3, 3] = zyx, xyz
            for format, numbers, rotation in (
                    ("xyzw", [*xyz, x, y, z, w], zyx), ("wxyz", [*xyz, w, x, y, z], zyx), ("abb", [*(1000 * xyz), w, x, y, z], zyx),
                    ("rpy", [*xyz, a, b, c], zyx), ("rpy_deg", [*xyz, a / DEG, b / DEG, c / DEG], zyx),
                    ("fanuc", [*(1000 * xyz), a / DEG, b / DEG, c / DEG], about(Z, c) @ about(Y, b) @ about(X, a)),
                    ("kuka", [*(1000 * xyz), a / DEG, b / DEG, c / DEG], about(Z, a) @ about(Y, b) @ about(X, c)),
                    ("rotvec_deg", [*xyz, *(axis * a / DEG)], about(axis, a)),
                    ("yaskawa", [*(1000 * xyz), a / DEG, b / DEG, c / DEG], about(Z, c) @ about(Y, b) @ about(X, a)),
                    ("zyz", [*(1000 * xyz), a / DEG, b / DEG, c / DEG], about(Z, a) @ about(Y, b) @ about(Z, c)),
                    ("staubli", [*(1000 * xyz), a / DEG, b / DEG, c / DEG], about(X, a) @ about(Y, b) @ about(Z, c)),
                    ("rotvec", [*xyz, *(axis * a)], about(axis, a)), ("matrix", list(t.flatten()), zyx)):
                with self.subTest(format=format):
                    self.write("p.csv", ",".join("%.17g" % n for n in numbers) + "\n")
                    found = self.flange(self.lines("p.csv", "--pose-format", format)[0])
                    np.testing.assert_allclose(found[:3, :3], rotation, atol=1e-12)
                    np.testing.assert_allclose(found[:3, 3], xyz, atol=1e-12)

    def test_columns(self):
        self.write("p.csv", "image,time,C,B,A,Z,Y,X,speed\nimages/0001.png,12.5,30,20,10,300,200,100,1\nimages/0002.png,13.5,0,0,0,0,0,0,2\n")
        lines = self.lines("p.csv", "--pose-format", "kuka")
        self.assertEqual([line["id"] for line in lines], ["0001", "0002"])
        self.assertEqual((lines[0]["time"], lines[0]["image"]), (12.5, "images/0001.png"))
        t = self.flange(lines[0])
        np.testing.assert_allclose(t[:3, 3], [0.1, 0.2, 0.3])
        np.testing.assert_allclose(t[:3, :3], about(Z, 10 * DEG) @ about(Y, 20 * DEG) @ about(X, 30 * DEG), atol=1e-12)
        lines = self.lines("p.csv", "--pose-format", "kuka", "--sensor", "cam", "--target", "board")
        self.assertEqual(lines[0]["views"], [{"sensor": "cam", "target": "board", "image": "images/0001.png"}])
        self.write("p.csv", "0.1 0.2 0.3 0 0 0 1\n0.2 0.2 0.3 0 0 0 1\n")
        self.assertEqual([line["id"] for line in self.lines("p.csv", "--pose-format", "xyzw")], ["pose_001", "pose_002"])
        self.write("p.csv", "\ufeffimage,x,y,z,rx,ry,rz\r\nb.png,0.1,0.2,0.3,0,0,0\r\n")  # as Excel saves it
        line = self.lines("p.csv", "--pose-format", "rotvec")[0]
        self.assertEqual((line["image"], line["joints"]["flange"]["xyz"]), ("b.png", [0.1, 0.2, 0.3]))
        self.write("p.csv", "p[0.1, 0.2, 0.3, 0, 0, 0]\n")  # as Universal Robots writes it
        self.assertEqual(self.lines("p.csv", "--pose-format", "rotvec")[0]["joints"]["flange"]["xyz"], [0.1, 0.2, 0.3])
        self.write("p.csv", "a.png;100;200;300;0;0;0;1\n")
        line = self.lines("p.csv", "--pose-format", "xyzw", "--unit", "mm")[0]
        self.assertEqual((line["id"], line["image"]), ("a", "a.png"))
        self.assertEqual(line["joints"]["flange"]["xyz"], [0.1, 0.2, 0.3])
        self.good("import", "p.csv", "--pose-format", "xyzw", "--unit", "mm", "--out", "p.jsonl")
        self.assertEqual(json.loads(self.read("p.jsonl")), line)
        self.assertIn("m", self.good("import", "p.csv", "--pose-format", "xyzw").stderr)  # 300 m away

    def test_wrong(self):
        for text, arguments, words in (
                ("1,2,3,0.5,0.5,0,0\n", ["--pose-format", "xyzw"], ("p.csv:1", "length 1", "qx, qy, qz, qw")),
                ("x,y,z,rx,ry,rz\n0,0,0,90,0,0\n", ["--pose-format", "rotvec"], ("p.csv:2: rx", "90", "rad")),
                ("x,y,z,rx,ry\n", ["--pose-format", "rotvec"], ("p.csv", "no row of numbers")),
                ("x,y,z,rx,ry\n1,2,3,0,0\n", ["--pose-format", "rotvec"], ("p.csv:1", "x, y, z, rx, ry, rz")),
                ("0,0,0,1,0,0\n0,0,0,1,0\n", ["--pose-format", "rotvec"], ("p.csv:2", "5 cells")),
                ("0,0,0,1,zero,0\n", ["--pose-format", "rotvec"], ("p.csv:1: ry", "'zero'")),
                ("0,0,0,1,nan,0\n", ["--pose-format", "rotvec"], ("p.csv:1: ry", "'nan'")),
                ("0,1;0,2;0,3;0,5;0,5;1,0,5\n", ["--pose-format", "rotvec"], ("p.csv:1: rz", "'1,0,5'", "write a point")),
                ("1,0,0,0,0,1,0,0,0,0,1,0,1,2,3,1\n", ["--pose-format", "matrix"], ("p.csv:1", "rigid motion", "a different order")),
                ("x,y\n", ["--pose-format", "eulr"], ("--pose-format", "kuka", "fanuc")),
                ("", ["--pose-format", "rpy"], ("the file is empty",)),
                ("0,0,0,1,0,0\n", ["--pose-format", "rpy", "--unit", "inch"], ("--unit", "mm")),
                ("0,0,0,1,0,0\n", ["--pose-format", "rpy", "--sensor", "cam"], ("--target",)),
                ("0,0,0,1,0,0\n", ["--pose-format", "rpy", "--sensor", "cam", "--target", "board"], ("p.csv:1", "no image", "--rig")),
                ("x,y,z\n1,2,3\n", ["--pose-format", "rpy"], ("p.csv:1", "roll", "there are x, y, z"))):
            with self.subTest(text=text, arguments=arguments):
                self.write("p.csv", text)
                self.fails(["import", "p.csv", *arguments], *words)


def random_poses(count, seed):
    rng = np.random.default_rng(seed)
    return [pose(rng.uniform(-1, 1, 3), rng.uniform(-1.4, 1.4, 3)) for _ in range(count)]


def rotation_vector(t):
    x, y, z, w = quat_of(t[:3, :3])
    n = math.sqrt(x * x + y * y + z * z)
    return np.array([x, y, z]) / n * 2 * math.atan2(n, w)


class Tables(Case):
    """The same poses in every kind of file that people have them in."""

    def setUp(self):
        super().setUp()
        self.poses = random_poses(4, 3)
        self.board = random_poses(4, 4)

    def read_poses(self, *arguments):
        lines = [json.loads(line) for line in self.good("import", *arguments).stdout.splitlines()]
        return [from_quat(line["joints"]["flange"]["xyz"], line["joints"]["flange"]["quat"]) for line in lines]

    def pairs(self, *arguments):
        run = self.good("import", *arguments, "--setup", "eye_in_hand", "--out", "pairs", "--force")
        lines = [json.loads(line) for line in self.read("pairs/samples.jsonl").splitlines()]
        flange = [from_quat(line["joints"]["flange"]["xyz"], line["joints"]["flange"]["quat"]) for line in lines]
        seen = [from_quat(line["views"][0]["pose"]["xyz"], line["views"][0]["pose"]["quat"]) for line in lines]
        return flange, seen, run.stderr

    def same(self, found, expected):
        self.assertEqual(len(found), len(expected))
        for a, b in zip(found, expected):
            np.testing.assert_allclose(a, b, atol=1e-12)

    def test_matrices(self):
        numbers = ["%.17g" % v for t in self.poses for v in t.flatten()]
        rows = [" ".join(numbers[4 * i:4 * i + 4]) for i in range(16)]
        self.write("blocks.txt", "\n".join(r + ("\n" if i % 4 == 3 else "") for i, r in enumerate(rows)))
        wide = np.hstack(self.poses)
        self.write("wide.csv", "\n".join(",".join("%.17g" % v for v in row) for row in wide))
        self.write("twelve.csv", "\n".join(";".join(("%.17g" % v).replace(".", ",") for v in t[:3].flatten()) for t in self.poses))
        self.write("list.json", json.dumps([{"robot_pose": t.tolist()} for t in self.poses]))
        self.write("flat.json", json.dumps({"poses": [list(t.flatten()) for t in self.poses]}))
        np.save(os.path.join(self.dir, "stack.npy"), np.array(self.poses))
        np.save(os.path.join(self.dir, "columns.npy"), np.asfortranarray(np.array(self.poses)[:, :3]))
        for name in ("blocks.txt", "wide.csv", "twelve.csv", "list.json", "flat.json", "stack.npy", "columns.npy"):
            with self.subTest(name=name):
                self.same(self.read_poses(name, "--pose-format", "matrix"), self.poses)
                guess = self.good("import", name).stdout
                self.assertIn("4 rows of 1", guess)
                self.assertIn("seems to have poses (matrix)", guess)

    def test_kuka_program(self):
        rows = []
        for t in self.poses:
            a, b, c = math.atan2(t[1, 0], t[0, 0]), math.asin(-t[2, 0]), math.atan2(t[2, 1], t[2, 2])
            rows.append("X %.17g, Y %.17g, Z %.17g, A %.17g, B %.17g, C %.17g, S 6, T 27, E1 0.0" % (*(1000 * t[:3, 3]), a / DEG, b / DEG, c / DEG))
        self.write("p.txt", "\n".join("{E6POS: " + r + "}" for r in rows))
        self.same(self.read_poses("p.txt", "--pose-format", "kuka"), self.poses)
        self.write("p.dat", "DEFDAT P\n" + "\n".join("DECL E6POS XP%d={%s}" % (i, r) for i, r in enumerate(rows)) + "\nENDDAT\n")
        run = self.good("import", "p.dat", "--pose-format", "kuka")
        self.assertEqual([json.loads(line)["id"] for line in run.stdout.splitlines()], ["XP0", "XP1", "XP2", "XP3"])

    def test_universal_robots_recorder(self):
        header = "timestamp " + " ".join("actual_TCP_pose_%d" % i for i in range(6))
        rows = [" ".join("%.17g" % v for v in [i, *t[:3, 3], *rotation_vector(t)]) for i, t in enumerate(self.poses)]
        self.write("rtde.csv", "\n".join([header] + rows))
        self.same(self.read_poses("rtde.csv", "--pose-format", "rotvec"), self.poses)

    def test_pairs(self):
        def row(t):
            return [*t[:3, 3], *rotation_vector(t)]
        names = ["x", "y", "z", "rx", "ry", "rz"]
        self.write("both.csv", ",".join(names + ["m" + n for n in names]) + "\n" + "\n".join(
            ",".join("%.17g" % v for v in row(a) + row(b)) for a, b in zip(self.poses, self.board)))
        self.write("bare.csv", "\n".join(",".join("%.17g" % v for v in row(a) + row(b)) for a, b in zip(self.poses, self.board)))
        self.write("flange.csv", "\n".join("%d," % i + ",".join("%.17g" % v for v in [*t[:3, 3], *quat_of(t[:3, :3])]) for i, t in enumerate(self.poses)))
        self.write("board.csv", "\n".join("%d," % i + ",".join("%.17g" % v for v in [*(1000 * t[:3, 3]), *(rotation_vector(t) / DEG)])
                                          for i, t in reversed(list(enumerate(self.board)))))
        both = {"moved": [{"robot": a.tolist(), "camera": b.tolist()} for a, b in zip(self.poses, self.board)]}
        self.write("both.json", json.dumps(both))
        for i, (a, b) in enumerate(zip(self.poses, self.board)):
            self.write("visp_fPe_%d.yaml" % (i + 9), "rows: 6\ncols: 1\ndata:\n" + "".join("  - [%.17g]\n" % v for v in row(a)))
            self.write("visp_cPo_%d.yaml" % (i + 9), "rows: 6\ncols: 1\ndata:\n" + "".join("  - [%.17g]\n" % v for v in row(b)))
            mm = b.copy()
            mm[:3, 3] *= 1000
            self.write("pos%02d.yaml" % (i + 9), "__version__:\n  serializer: 1\nFloatMatrix:\n  Data: %s\n" % json.dumps(mm.tolist()))
            self.write("cv%02d.yml" % (i + 9), "%%YAML:1.0\n---\nT: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: %s\n" % json.dumps(list(b.flatten())))
        fpe = ["visp_fPe_%d.yaml" % i for i in range(9, 13)]
        for arguments in (["both.csv", "--pose-format", "rotvec"], ["bare.csv", "--pose-format", "rotvec"],
                          ["flange.csv", "--pose-format", "xyzw", "--target-poses", "board.csv", "--target-format", "rotvec_deg", "--target-unit", "mm"],
                          ["both.json"], [*fpe, "--target-poses", *("visp_cPo_%d.yaml" % i for i in range(9, 13))],
                          [*fpe, "--target-poses", *("pos%02d.yaml" % i for i in range(9, 13))],
                          [*fpe, "--target-poses", *("cv%02d.yml" % i for i in range(9, 13))]):
            with self.subTest(arguments=arguments):
                flange, seen, said = self.pairs(*arguments)
                self.same(flange, self.poses)
                self.same(seen, self.board)
                self.assertIn("note: ", said)
        self.assertIn("import visp_fPe_*.yaml --target-poses visp_cPo_*.yaml", self.good("import", *fpe, *("visp_cPo_%d.yaml" % i for i in range(9, 13))).stdout)
        self.assertIn("two poses in each row", self.good("import", "both.csv").stdout)

    def test_pairs_wrong(self):
        self.write("a.csv", "0,0,0,0,0,0,1\n1,0,0,0,0,0,1\n")
        self.write("b.csv", "0,0,0,0,0,0,1\n")
        self.write("c.csv", "one,0,0,0,0,0,0,1\ntwo,1,0,0,0,0,0,1\n")
        self.write("d.csv", "one,0,0,0,0,0,0,1\nthree,1,0,0,0,0,0,1\n")
        base = ["--setup", "eye_in_hand", "--out", "pairs"]
        self.fails(["import", "a.csv", "--pose-format", "xyzw", "--target-poses", "b.csv", *base], "b.csv:1", "1 measured poses", "2 of the flange")
        self.fails(["import", "c.csv", "--pose-format", "xyzw", "--target-poses", "d.csv", *base], "c.csv:2", "'two'")
        self.fails(["import", "a.csv", "--target-poses", "b.csv", *base], "a.csv", "--pose-format", "xyzw", "kuka")
        self.fails(["import", "a.csv", "--pose-format", "xyzw", *base], "a.csv", "--target-poses")
        self.assertFalse(os.path.exists(os.path.join(self.dir, "pairs")))

    def test_damaged_arrays(self):
        np.save(os.path.join(self.dir, "a.npy"), np.array(self.poses))
        with open(os.path.join(self.dir, "a.npy"), "rb") as f:
            whole = f.read()
        for count, word in ((8, "header"), (60, "header"), (len(whole) - 8, "fewer")):
            with open(os.path.join(self.dir, "b.npy"), "wb") as f:
                f.write(whole[:count])
            self.fails(["import", "b.npy", "--pose-format", "matrix"], "b.npy", word)
        np.save(os.path.join(self.dir, "c.npy"), np.array(["a", "b"]))
        self.fails(["import", "c.npy", "--pose-format", "matrix"], "c.npy", "<f8")

    def test_measured(self):
        """Joints beside what was measured there, as samples of a rig."""
        self.write("track.yaml", """format: kincal/1
robot: arm.urdf
base: base
targets: {ball: {type: points, points: [[0, 0, 0]], mount: {link: tool, pose: {xyz: [0.2, 0, 0.01]}}}}
sensors: {tracker: {type: point, link: base, sigma: 0.0001}, mocap: {type: pose, link: base, sigma: {translation: 0.001, rotation: 0.001}}}
""")
        base = ["--rig", "track.yaml", "--sensor", "tracker"]
        self.write("a.csv", "A1;A2;px;py;pz\n45,5;-30;1000,5;2;3\n0;0;1;2;3\n")
        run = self.good("import", "a.csv", *base, "--map", "A1=j1", "--map", "A2=j2", "--map", "px=x", "--map", "py=y", "--map", "pz=z",
                        "--angles", "deg", "--unit", "mm")
        line = json.loads(run.stdout.splitlines()[0])
        np.testing.assert_allclose([line["joints"]["j1"], line["joints"]["j2"]], [45.5 * DEG, -30 * DEG], rtol=1e-15)
        self.assertEqual(line["views"][0]["target"], "ball")
        np.testing.assert_allclose(line["views"][0]["points"], [[1.0005, 0.002, 0.003]], rtol=1e-15)
        t = self.poses[0]
        self.write("b.csv", "j1,j2,x,y,z,qx,qy,qz,qw\n0.1,0.2," + ",".join("%.17g" % v for v in [*t[:3, 3], *quat_of(t[:3, :3])]) + "\n")
        run = self.good("import", "b.csv", "--rig", "track.yaml", "--sensor", "mocap", "--out", "b.jsonl")
        seen = json.loads(self.read("b.jsonl"))["views"][0]["pose"]
        np.testing.assert_allclose(from_quat(seen["xyz"], seen["quat"]), t, atol=1e-12)
        self.assertEqual(self.run_kincal("evaluate", "track.yaml", "b.jsonl").returncode, 0)
        for text, arguments, words in (
                ("j1,j2,px\n0,0,1\n", base, ("a.csv:1", "x, y and z", "--map", "px")),
                ("j1,j3,x,y,z\n0,0,1,2,3\n", base, ("a.csv:1", "'j3'", "j2")),
                ("q,r,x,y,z\n0,0,1,2,3\n", base, ("no column is a joint", "j1, j2", "--map")),
                ("j1,j2,x,y,z\n0,0,1,2\n", base, ("a.csv:2", "4 cells", "5")),
                ("j1,j2,x,y,z\n0,0,1,2,e\n", base, ("a.csv:2: z", "'e'")),
                ("j1,j2,x,y,z\n0,0,1,2,3\n", [*base, "--map", "A1=j1"], ("--map", "'A1'", "j1, j2")),
                ("A1,j2,x,y,z\n0,0,1,2,3\n", [*base, "--map", "A1=j7"], ("--map", "'j7'", "j1, j2")),
                ("j1,j2,x,y,z\n0,0,1,2,3\n", [*base, "--angles", "grad"], ("--angles", "deg")),
                ("j1,j2,x,y,z\n0,0,1,2,3\n", ["--rig", "track.yaml"], ("--sensor", "tracker, mocap")),
                ("0,0,1,2,3\n", base, ("a.csv:1", "header"))):
            with self.subTest(text=text, arguments=arguments):
                self.write("a.csv", text)
                self.fails(["import", "a.csv", *arguments], *words)

    def test_a_joint_with_the_name_of_a_measured_column(self):
        """A SCARA's slide is called z, as is what the tracker measures."""
        self.write("z.urdf", self.read("arm.urdf").replace('"j2" type="revolute"', '"z" type="prismatic"'))
        self.write("track.yaml", """format: kincal/1
robot: z.urdf
base: base
targets: {ball: {type: points, points: [[0, 0, 0]], mount: {link: tool}}}
sensors: {tracker: {type: point, link: base, sigma: 0.0001}}
""")
        base = ["--rig", "track.yaml", "--sensor", "tracker"]
        for header, maps in (("j1,joint/z,x,y,z", []), ("j1,J3,x,y,z", ["--map", "J3=joint/z"]),
                             ("j1,z,tx,ty,tz", ["--map", "z=joint/z", "--map", "tx=x", "--map", "ty=y", "--map", "tz=z"])):
            with self.subTest(header=header):
                self.write("a.csv", header + "\n0.5,0.25,1,2,3\n")
                line = json.loads(self.good("import", "a.csv", *base, *maps).stdout)
                self.assertEqual(line["joints"], {"j1": 0.5, "z": 0.25})
                self.assertEqual(line["views"][0]["points"], [[1, 2, 3]])
        self.write("a.csv", "j1,joint/z,x,y,z\n90,250,1000,2000,3000\n")   # the unit of lengths is that of the slide, too
        line = json.loads(self.good("import", "a.csv", *base, "--unit", "mm", "--angles", "deg").stdout)
        self.assertEqual(line["joints"], {"j1": 90 * DEG, "z": 0.25})
        self.assertEqual(line["views"][0]["points"], [[1, 2, 3]])
        self.write("a.csv", "j1,z,x,y,z\n0.5,0.25,1,2,3\n")
        self.fails(["import", "a.csv", *base], "a.csv:1", "two columns 'z'", "'joint/z'")

    def test_atom(self):
        """A data set of ATOM as its documentation has it: joints, and labels of cameras."""
        self.write("dataset.json", json.dumps({
            "calibration_config": {"sensors": {"left": {"link": "optical"}, "lidar": {"link": "base"}}}, "collections": {
                "000": {"joints": {"j1": {"position": 0.1}, "j2": {"position": 0.2}, "gripper": {"position": 1}}, "transforms": {}, "labels": {"board": {
                    "left": {"detected": True, "idxs": [{"id": 3, "x": 10.5, "y": 20.25}, {"id": 4, "x": 11, "y": 21}]},
                    "lidar": {"detected": True, "idxs": [1, 2, 3]}}}},
                "001": {"joints": {"j1": {"position": 0.3}, "j2": {"position": 0.4}}, "transforms": {}, "labels": {"board": {"left": {"detected": False, "idxs": []}}}}}}))
        run = self.good("import", "dataset.json", "--rig", "rig.yaml")
        self.assertEqual([json.loads(line) for line in run.stdout.splitlines()], [{
            "id": "000", "joints": {"j1": 0.1, "j2": 0.2}, "views": [{"sensor": "left", "target": "board", "ids": [3, 4], "pixels": [[10.5, 20.25], [11, 21]]}]}])
        self.assertIn("lidar", run.stderr)
        self.fails(["import", "dataset.json"], "dataset.json", "ATOM", "--rig")


class HandEye(Case):
    """A camera that sees the whole pose of a board, on the hand and beside the robot."""

    def simulated(self, in_hand, count=12):
        rng = np.random.default_rng(2)
        hand_sensor, base_target = pose((0.05, 0.02, 0.1), (0.2, 0.1, 1.5)), pose((0.8, 0.1, 0.05), (0.1, 3, 0.2))
        base_sensor, hand_target = pose((1.2, 0.3, 0.6), (2, 0.1, 1)), pose((0.02, 0.03, 0.12), (0.1, 0.2, 0.3))
        pairs = []
        for _ in range(count):
            flange = pose(rng.uniform(-0.3, 0.3, 3) + [0.5, 0, 0.5], rng.uniform(-1, 1, 3))
            seen = np.linalg.inv(hand_sensor) @ np.linalg.inv(flange) @ base_target if in_hand else np.linalg.inv(base_sensor) @ flange @ hand_target
            pairs.append((flange, seen))
        return pairs, hand_sensor if in_hand else base_sensor

    def check(self, folder, pairs, in_hand):
        lines = [json.loads(line) for line in self.read(folder + "/samples.jsonl").splitlines()]
        self.assertEqual(len(lines), len(pairs))
        for line, (flange, seen) in zip(lines, pairs):
            for found, expected in ((line["joints"]["flange"], flange), (line["views"][0]["pose"], seen)):
                np.testing.assert_allclose(from_quat(found["xyz"], found["quat"]), expected, atol=1e-9)
        rig = yaml.safe_load(self.read(folder + "/rig.yaml"))
        self.assertEqual(rig["robot"], {"base": "base", "flange": "tool0"})
        self.assertEqual((rig["sensors"]["camera"]["link"], rig["targets"]["board"]["mount"]["link"]),
                         ("tool0", "base") if in_hand else ("base", "tool0"))

    def transform(self, t):
        x, y, z, w = quat_of(t[:3, :3])
        return {"translation": dict(zip("xyz", map(float, t[:3, 3]))), "rotation": {"x": float(x), "y": float(y), "z": float(z), "w": float(w)}}

    def test_moveit(self):
        for in_hand, setup in ((True, "eye_in_hand"), (False, "eye_to_hand")):
            pairs, _ = self.simulated(in_hand)
            self.write("s.yaml", yaml.safe_dump([{"effector_wrt_world": [float(v) for v in f.flatten()], "object_wrt_sensor": [float(v) for v in s.flatten()]}
                                                 for f, s in pairs]))
            self.good("import", "s.yaml", "--setup", setup, "--out", setup)
            self.check(setup, pairs, in_hand)

    def test_easy_handeye(self):
        """eye on base: easy_handeye stores the robot's transform the other way round."""
        for in_hand, setup in ((True, "eye_in_hand"), (False, "eye_on_base")):
            pairs, _ = self.simulated(in_hand)
            robot = [self.transform(f if in_hand else np.linalg.inv(f)) for f, _ in pairs]
            tracking = [self.transform(s) for _, s in pairs]
            self.write("two.samples", yaml.safe_dump({"samples": [{"robot": r, "tracking": t} for r, t in zip(robot, tracking)]}))
            self.write("one.yaml", yaml.safe_dump({"samples": {"hand_world_samples": robot, "camera_marker_samples": tracking}}))
            self.write("list.samples", yaml.safe_dump([{"robot": r, "tracking": t} for r, t in zip(robot, tracking)]))
            for name in ("two.samples", "one.yaml", "list.samples"):
                self.good("import", name, "--setup", setup, "--out", setup, "--force")
                self.check(setup, pairs, in_hand)

    def test_calibrated(self):
        """From the samples of a hand-eye program to the camera's pose, and out again."""
        for in_hand, setup in ((True, "eye_in_hand"), (False, "eye_to_hand")):
            pairs, truth = self.simulated(in_hand, 20)
            self.write("s.yaml", yaml.safe_dump([{"effector_wrt_world": [float(v) for v in f.flatten()], "object_wrt_sensor": [float(v) for v in s.flatten()]}
                                                 for f, s in pairs]))
            self.good("import", "s.yaml", "--setup", setup, "--out", setup)
            self.run_kincal("calibrate", setup + "/rig.yaml", setup + "/samples.jsonl", "--out", setup + "_result", "--quiet")
            data = yaml.safe_load(self.good("export", setup + "_result", "--as", "easy_handeye").stdout)
            self.assertEqual(data["parameters"]["eye_on_hand"], in_hand)
            t = data["transformation"]
            np.testing.assert_allclose(from_quat([t["x"], t["y"], t["z"]], [t["qx"], t["qy"], t["qz"], t["qw"]]), truth, atol=1e-6)
            for name in ("rig.yaml", "changes.yaml"):
                self.check_numbers(self.read(setup + "_result/" + name))
            result = self.path(setup + "_result/result.json")
            sure = self.read(result)
            doubted = json.loads(sure)
            doubted.update(chi2=5400, dof=100, verdict={"use": "doubts", "text": "converged, but look here"})
            self.write(result, json.dumps(doubted))
            said = self.good("export", setup + "_result", "--as", "easy_handeye").stderr
            self.assertEqual(said, "kincal: warning: %s_result: its verdict is 'doubts' (chi2/dof 54): converged, but look here\n" % setup)
            self.write(result, sure)
            self.write(result, self.read(result).replace('"status": "converged"', '"status": "not_converged"'))
            self.fails(["export", setup + "_result", "--as", "easy_handeye"], "not_converged", "--force")
            self.good("export", setup + "_result", "--as", "easy_handeye", "--force")

    def test_wrong(self):
        self.write("s.yaml", yaml.safe_dump([{"effector_wrt_world": [1] * 16, "object_wrt_sensor": [1] * 16}]))
        self.fails(["import", "s.yaml", "--out", "x"], "--setup is missing", "--setup eye_to_hand", "import s.yaml --setup eye_in_hand --out x")
        self.fails(["import", "s.yaml", "--setup", "eye_in_hand"], "--out")
        self.fails(["import", "s.yaml", "--setup", "in_hand", "--out", "x"], "--setup", "eye_to_hand")
        self.fails(["import", "s.yaml", "--setup", "eye_in_hand", "--out", "x"], "s.yaml", "effector_wrt_world", "rigid motion")
        self.write("s.yaml", "- effector_wrt_world: [1, 2]\n  object_wrt_sensor: []\n")
        self.fails(["import", "s.yaml", "--setup", "eye_in_hand", "--out", "x"], "s.yaml:1: [0].effector_wrt_world", "16")
        self.write("s.yaml", "samples:\n- robot: {translation: {x: 0, y: 0, z: 0}, rotation: {x: 0, y: 0, z: 0, w: 0}}\n")
        self.fails(["import", "s.yaml", "--setup", "eye_in_hand", "--out", "x"], "s.yaml:2: samples[0].robot.rotation", "length 1")
        self.write("s.yaml", "samples: []\n")
        self.fails(["import", "s.yaml", "--setup", "eye_in_hand", "--out", "x"], "no sample")


class Numbers(Case):
    """Readers of YAML 1.1 (PyYAML, ROS) take 4e-04 for a text: it is written 4.0e-04."""

    def test_rigs(self):
        run = self.good("init", "arm.urdf", "--sensor", "camera:optical:cam", "--intrinsics", "500,500,320,240", "--image-size", "640x480",
                        "--target", "chessboard:4x5:0.00002@base:board", "--target", "points:0.00003,1e-7,2e20@tool:ball")
        self.assertIn("2.0e-05", run.stdout)
        self.check_numbers(run.stdout)

    def test_exports(self):
        rig = RIG.replace("500.5, 501.25", "4e-4, 5e+20").replace("0.01, -0.02, 0.003, -0.0004", "1e-5, -0.00002, 3e-7, -4e-9").replace("[0, 0.1, 0]", "[0, 0.00001, 2e-5]")
        self.write("rig.yaml", rig)
        for arguments in (["camera_info", "--sensor", "left"], ["kalibr", "--sensor", "right"], ["easy_handeye", "--sensor", "right"], ["easy_handeye2", "--sensor", "right"]):
            text = self.exported(*arguments)
            self.assertRegex(text, "[0-9]\\.[0-9]+e-")
            self.check_numbers(text)
        self.write("lens.yaml", self.exported("camera_info", "--sensor", "right"))
        self.good("import", "lens.yaml", "--rig", "rig.yaml", "--sensor", "fixed", "--out", "new.yaml")
        self.check_numbers(self.read("new.yaml").replace("4e-4", "0").replace("5e+20", "0").replace("2e-5]", "0]").replace("1e-5, -0.00002, 3e-7, -4e-9", "0"))


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:], verbosity=2)
