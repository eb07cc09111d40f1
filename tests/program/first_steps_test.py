"""The first steps of a newcomer: python3 first_steps_test.py SOURCE_DIR KINCAL [TEST ...]

A mount that is a fixed joint of the URDF is calibrated there, and ends where a free pose ends; `init` shows a robot and offers that joint; a
pose that no joint has can be copied; ROS's names of lenses; a joint that cancels needs no reading; a rig of which nothing can be estimated
says why. All data are simulated here. Not proved: that predicted errors are right with such a mount beyond those of the data below.
"""

import json
import math
import os
import re
import subprocess
import sys
import unittest
import xml.etree.ElementTree as xml

import helpers

SOURCE_DIR = KINCAL = None

RIGHT = {"camera_joint": ("0.03 0.01 0.06", "0.05 -0.02 0.1"), "wall_joint": ("1.7 0.1 0.45", "0.02 0.01 0.3")}
WRONG = {"camera_joint": ("0.03 0.31 0.06", "0.05 -0.02 1.67"), "wall_joint": ("1.7 0.1 0.75", "1.59 0.01 0.3")}  # 90 degrees, 30 cm


def urdf(mounts, torso=False):
    joints = [("j%d" % k, "j%d_link" % k, *joint) for k, joint in enumerate(helpers.ARM, 1)]
    if torso:
        joints.insert(0, ("torso", "torso_link", "0 0 0.2", "0 0 1"))
    lines = ['<robot name="arm"><link name="base"/>', *helpers.revolute(joints, "base", 0.8)]
    parent = joints[-1][1]
    wall = "torso_link" if torso else "base"
    for name, above, below, (xyz, rpy) in (("camera_joint", parent, "camera_link", mounts["camera_joint"]),
                                           ("optical_joint", "camera_link", "optical", ("0 0 0", "-1.5707963267948966 0 -1.5707963267948966")),
                                           ("wall_joint", wall, "wall", mounts["wall_joint"])):
        lines.append('<joint name="%s" type="fixed"><parent link="%s"/><child link="%s"/><origin xyz="%s" rpy="%s"/></joint><link name="%s"/>'
                     % (name, above, below, xyz, rpy, below))
    return "\n".join(lines + ["</robot>"])


RIG = """format: kincal/1
robot: arm.urdf
base: base
joints:
  "*": {sigma: 0.0002}
targets:
  board: {type: chessboard, rows: 6, columns: 9, square: 0.03, mount: {link: wall%s}%s}
sensors:
  cam: {type: camera, model: brown_conrady, link: optical, %simage_size: [1280, 960], intrinsics: [900, 900, 640, 480], sigma: 0.2}
"""
BOARD = ", pose: {xyz: [0, 0.1, 0.08], rpy: [-1.5708, 0, -1.5708]}"
BY_JOINT, BY_POSE = RIG % ("", "", "mount: joint/camera_joint, "), RIG % ("", "", "")
TRUTH = {"joint/j2/offset": 0.006, "joint/j3/offset": -0.004, "joint/j5/offset": 0.005}


# ---------------------------------------------------------------------------------------------------------------------------------
# Rigid motions as 4 x 4 lists: independent of the program.
def mul(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def motion(rotation, xyz):
    return [list(rotation[i]) + [xyz[i]] for i in range(3)] + [[0, 0, 0, 1]]


def from_rpy(xyz, rpy):
    (cr, cp, cy), (sr, sp, sy) = [math.cos(v) for v in rpy], [math.sin(v) for v in rpy]
    return motion([[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                   [-sp, cp * sr, cp * cr]], xyz)


def from_quat(xyz, q):
    x, y, z, w = q
    return motion([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                   [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]], xyz)


def about(axis, angle):
    s = math.sin(angle / 2)
    return from_quat([0, 0, 0], [axis[0] * s, axis[1] * s, axis[2] * s, math.cos(angle / 2)])


def numbers(text):
    return [float(v) for v in text.split()]


def frame(text, link, readings):
    """base_T_link of a URDF."""
    joints = {j.find("child").get("link"): j for j in xml.fromstring(text).findall("joint")}
    out = from_rpy([0, 0, 0], [0, 0, 0])
    while link in joints:
        joint, origin = joints[link], joints[link].find("origin")
        here = from_rpy(numbers(origin.get("xyz", "0 0 0")), numbers(origin.get("rpy", "0 0 0")))
        if joint.get("type") == "revolute":
            here = mul(here, about(numbers(joint.find("axis").get("xyz")), readings.get(joint.get("name"), 0)))
        out, link = mul(here, out), joint.find("parent").get("link")
    return out


def apart(a, b):
    """m, rad."""
    metres = math.dist([a[i][3] for i in range(3)], [b[i][3] for i in range(3)])
    squares = sum((a[i][j] - b[i][j]) ** 2 for i in range(3) for j in range(3))
    return metres, 2 * math.asin(min(1, math.sqrt(squares / 8)))


POSTURES = [{"j%d" % k: 0.3 * math.sin(i + k) for k in range(1, 7)} for i in range(5)]


class Case(helpers.Folder):
    def kincal(self, *arguments, code=0):
        p = subprocess.run([KINCAL, *arguments], capture_output=True, text=True, cwd=self.dir)
        if code is not None:
            self.assertEqual(p.returncode, code, p.stdout + p.stderr)
        return p.stdout + p.stderr

    def simulate(self, samples=25, seed=1, truth=TRUTH, rig=RIG % (BOARD, "", ""), robot=None):
        """Samples of the right robot."""
        self.write("arm.urdf", robot or urdf(RIGHT))
        self.write("right.yaml", rig.replace("link: optical, image", "link: optical, pose: {xyz: [0, 0, 0]}, image"))
        self.write("truth.json", json.dumps({"parameters": truth}))
        self.kincal("simulate", "right.yaml", "--samples", str(samples), "--seed", str(seed), "--truth", "truth.json", "--out", "sim", "--force")

    def calibrate(self, rig, *options, code=0, out="out", samples="sim/samples.jsonl"):
        self.write(out + ".yaml", rig)
        self.printed = self.kincal("calibrate", out + ".yaml", samples, "--out", out, "--force", "--tables", *options, code=code)
        return json.loads(self.read(out, "result.json"))

    def camera(self, result, out="out"):
        """base_T_camera of a result in some postures."""
        pose = result["parameters"].get("sensor/cam/pose", {"pose": {"xyz": [0, 0, 0], "quat": [0, 0, 0, 1]}})["pose"]
        return [mul(frame(self.read(out, "robot.urdf"), "optical", q), from_quat(pose["xyz"], pose["quat"])) for q in POSTURES]

    def assertSame(self, frames, others, metres, radians):
        for a, b in zip(frames, others):
            m, r = apart(a, b)
            self.assertLess(m, metres)
            self.assertLess(r, radians)


class Mount(Case):
    def test_a_wrong_mount_is_corrected_in_the_urdf(self):
        self.simulate()
        self.write("arm.urdf", urdf(WRONG))
        result = self.calibrate(BY_JOINT)
        self.assertNotIn("sensor/cam/pose", result["parameters"])
        self.assertIn("joint/camera_joint/origin", result["parameters"])
        self.assertIn("mount: joint/camera_joint", self.read("out", "rig.yaml"))
        self.assertNotIn("camera_joint", str(result["held"]))
        self.assertNotIn("joint/camera_joint", self.read("out", "rig.yaml").split("nominal:")[1])
        # The right mount, and what a free pose gives.
        mine = self.read("out", "robot.urdf")
        self.assertSame([frame(mine, "camera_link", {})], [frame(urdf(RIGHT), "camera_link", {})], 0.01, 0.02)  # with all the arm's errors
        by_pose = self.calibrate(BY_POSE, out="pose")
        self.assertIn("sensor/cam/pose", by_pose["parameters"])
        self.assertSame(self.camera(result), self.camera(by_pose, "pose"), 2e-6, 2e-6)
        self.assertAlmostEqual(result["chi2_data"], by_pose["chi2_data"], delta=1e-4 * by_pose["chi2_data"])
        # Once more, and the other commands.
        self.kincal("calibrate", "out/rig.yaml", "sim/samples.jsonl", "--out", "again")
        again = json.loads(self.read("again", "result.json"))
        self.assertSame(self.camera(again, "again"), self.camera(result), 2e-5, 2e-5)
        self.assertIn("Nothing found", self.kincal("check", "out.yaml", "sim/samples.jsonl"))
        self.assertIn("Nothing found", self.kincal("check", "out/rig.yaml", "sim/samples.jsonl"))
        self.assertIn("cam", self.kincal("evaluate", "out/rig.yaml", "sim/samples.jsonl"))
        self.assertIn("joint/camera_joint/origin", self.kincal("diff", "out.yaml", "out"))
        self.assertIn("joint/camera_joint/origin", self.kincal("calibrate", "out.yaml", "sim/samples.jsonl", "--dry-run"))
        self.kincal("simulate", "out/rig.yaml", "--samples", "3", "--seed", "1", "--out", "drawn")

    def test_what_a_camera_knows_it_keeps(self):
        """A right mount needs no other start."""
        self.simulate()
        result = self.calibrate(BY_JOINT)
        self.assertEqual([w["id"] for w in result["warnings"] if w["id"] in ("given_pose", "moved", "identity")], [])

    def test_a_sigma_that_is_stated_too_small(self):
        """What the doctor frees on the way to that finding leaves out poses that a joint stands for."""
        self.simulate()
        wrong = BY_JOINT.replace("sigma: 0.2}", "sigma: 0.05}")
        self.write("wrong.yaml", wrong)
        self.assertIn("chi2/dof is 15", self.kincal("check", "wrong.yaml", "sim/samples.jsonl"))
        result = self.calibrate(wrong, code=None)
        self.assertIn("joint/camera_joint/origin", result["parameters"])

    def test_the_joint_of_a_target(self):
        self.simulate()
        self.write("arm.urdf", urdf(dict(RIGHT, wall_joint=WRONG["wall_joint"])))
        result = self.calibrate(RIG % (BOARD, ", mount_joint: joint/wall_joint", ""))
        self.assertNotIn("target/board/pose", result["parameters"])
        self.assertIn("joint/wall_joint/origin", result["parameters"])
        self.assertSame([frame(self.read("out", "robot.urdf"), "wall", {})], [frame(urdf(RIGHT), "wall", {})], 0.01, 0.02)
        by_pose = self.calibrate(RIG % ("", "", ""), out="pose")
        self.assertSame(self.camera(result), self.camera(by_pose, "pose"), 2e-6, 2e-6)

    def test_both_by_joints(self):
        self.simulate()
        self.write("arm.urdf", urdf(WRONG))
        result = self.calibrate(RIG % (BOARD, ", mount_joint: joint/wall_joint", "mount: joint/camera_joint, "))
        self.assertEqual([n for n in result["parameters"] if n.endswith("/pose")], [])
        self.assertSame(self.camera(result), self.camera(self.calibrate(BY_POSE, out="pose"), "pose"), 2e-6, 2e-6)

    def test_a_rectified_pair_on_one_joint(self):
        """The other camera is as far off as the first: neither may be believed. One name is enough for both."""
        def pair(left, right, board=""):
            head, line = (RIG % (board, "", "@")).rsplit("  cam:", 1)
            return (head + "  cam:" + line.replace("@", left) +
                    "  right:" + line.replace("@", right).replace("sigma: 0.2", "sigma: 0.2, baseline: 0.1"))

        self.simulate(rig=pair("", "", BOARD))
        self.write("arm.urdf", urdf(WRONG))
        mount = "mount: joint/camera_joint, "
        for left, right in ((mount, mount), (mount, ""), ("", mount)):
            result = self.calibrate(pair(left, right))
            self.assertEqual([n for n in result["parameters"] if "/pose" in n], ["target/board/pose"])
            self.assertSame([frame(self.read("out", "robot.urdf"), "camera_link", {})], [frame(urdf(RIGHT), "camera_link", {})], 0.02, 0.02)
            self.assertIn("Nothing found", self.kincal("check", "out.yaml", "sim/samples.jsonl"))

    def test_with_steps(self):
        self.simulate(truth={})
        self.write("arm.urdf", urdf(WRONG))
        steps = "estimate:\n  - {step: all, free: [joint/camera_joint/origin, target/board/pose]}\n"
        result = self.calibrate(BY_JOINT + steps)
        self.assertSame([frame(self.read("out", "robot.urdf"), "camera_link", {})], [frame(urdf(RIGHT), "camera_link", {})], 0.002, 0.002)
        self.assertEqual(list(result["parameters"]), ["joint/camera_joint/origin", "target/board/pose"])
        for name in ("sensor/cam/pose", "sensor/*/pose", "sensor/cam/pose.x"):
            self.write("wrong.yaml", BY_JOINT + steps.replace("joint/camera_joint/origin", '"%s"' % name))
            text = self.kincal("calibrate", "wrong.yaml", "sim/samples.jsonl", "--out", "no", code=1)
            self.assertIn("the rig calibrates joint/camera_joint/origin in place of sensor/cam/pose", text)
        self.kincal("calibrate", "out.yaml", "sim/samples.jsonl", "--out", "glob", "--free", "*/pose")

    def test_errors_teach(self):
        self.simulate(samples=3)
        for rig, part in ((BY_JOINT.replace("camera_joint", "camera_jont"), "valid: joint/optical_joint, joint/camera_joint"),
                          (BY_JOINT.replace("joint/camera_joint", "camera_joint"), "valid: joint/optical_joint, joint/camera_joint"),
                          (BY_JOINT.replace("camera_joint", "wall_joint"), "is not a fixed joint that link 'optical' hangs on"),
                          (BY_JOINT.replace("camera_joint", "j6"), "is not a fixed joint that link 'optical' hangs on"),
                          (BY_JOINT.replace("link: optical", "link: j6_link"), "valid: none, for joint 'j6' above it is not fixed"),
                          (BY_JOINT.replace("link: optical", "link: base"), "valid: none: the link is the robot's root"),
                          ((RIG % ("", ", mount_joint: joint/wall_joint", "")).replace("mount: {link: wall}", "mount: free"), "a free target is not on a joint")):
            self.write("wrong.yaml", rig)
            self.assertIn(part, self.kincal("check", "wrong.yaml", "sim/samples.jsonl", code=1))


class Init(Case):
    CAMERA = ("--sensor", "camera:optical:cam", "--intrinsics", "900,900,640,480", "--image-size", "1280x960")
    BOARD = ("--target", "chessboard:6x9:0.03@wall:board")

    def setUp(self):
        super().setUp()
        self.write("arm.urdf", urdf(RIGHT))

    def test_the_robot_alone_is_shown(self):
        text = self.kincal("init", "arm.urdf")
        self.assertEqual(os.listdir(self.dir), ["arm.urdf"])
        lines = [re.sub(" +", " ", line).strip() for line in text.splitlines()]
        self.assertIn("j2_link j2 revolute -0.8 to 0.8 rad axis 0 1 0", lines)
        self.assertIn("camera_link camera_joint fixed", lines)
        self.assertIn("base", lines)
        self.assertIn("--sensor", text)
        depth = {line.split()[0]: len(line) - len(line.lstrip()) for line in text.splitlines() if line.strip()}
        self.assertLess(depth["j6_link"], depth["camera_link"])
        self.assertEqual(depth["j1_link"], depth["wall"])
        for missing, given in (("--target", self.CAMERA), ("--sensor", self.BOARD)):
            self.assertIn(missing + ": at least one is needed", self.kincal("init", "arm.urdf", *given, code=1))
        self.assertIn("at least one is needed", self.kincal("init", "arm.urdf", "--out", "rig.yaml", code=1))

    def test_the_mount_is_offered(self):
        text = self.kincal("init", "arm.urdf", *self.CAMERA, *self.BOARD)
        self.assertRegex(text, r"(?m)^    mount: joint/camera_joint ")
        self.assertIn("free: [joint/camera_joint/origin, target/board/pose]", text)
        self.simulate()
        self.write("arm.urdf", urdf(WRONG))
        self.kincal("init", "arm.urdf", *self.CAMERA, *self.BOARD, "--out", "mine.yaml")
        self.kincal("calibrate", "mine.yaml", "sim/samples.jsonl", "--out", "out")
        self.assertSame([frame(self.read("out", "robot.urdf"), "camera_link", {})], [frame(urdf(RIGHT), "camera_link", {})], 0.01, 0.02)

    def test_it_is_a_comment_where_more_moves_along(self):
        for more, what in ((("--sensor", "point:camera_link:probe"), "sensor probe"), (("--target", "points:0,0,0@camera_link:ball"), "target ball")):
            text = self.kincal("init", "arm.urdf", *self.CAMERA, *self.BOARD, *more)
            self.assertRegex(text, r"(?m)^    # mount: joint/camera_joint .*" + what + " would move along")
            self.assertIn("sensor/cam/pose", text)
        self.write("arm.urdf", urdf(RIGHT).replace("</robot>", '<joint name="zoom" type="prismatic"><parent link="camera_link"/><child link="lens"/>'
                                                    '<limit lower="0" upper="0.1" effort="1" velocity="1"/></joint><link name="lens"/></robot>'))
        text = self.kincal("init", "arm.urdf", *self.CAMERA, *self.BOARD)
        self.assertRegex(text, r"(?m)^    mount: joint/optical_joint ")  # the camera's own, without the lens
        # A link without the axes of an optical frame may be a flange's.
        text = self.kincal("init", "arm.urdf", "--sensor", "camera:wall:room", "--image-size", "640x480", "--target", "chessboard:6x9:0.03@j6_link")
        self.assertRegex(text, r"(?m)^    # mount: joint/wall_joint .* if this joint is the camera's own")
        # on a link that moves there is nothing to offer
        self.assertNotIn("mount: joint", self.kincal("init", "arm.urdf", "--sensor", "camera:j6_link", "--image-size", "640x480", *self.BOARD))


class Mounts(Case):
    def test_a_pose_can_be_copied(self):
        self.simulate(rig=(RIG % (BOARD, "", "")).replace("cam:", "my cam:"))
        result = self.calibrate((RIG % ("", "", "")).replace("cam:", "my cam:"))
        self.assertIn("Mounts that no joint of robot.urdf has", self.printed)
        elements = re.findall(r"<link name=[^\n]*\n *<joint[^\n]*", self.printed)
        self.assertEqual(len(elements), 2, self.printed)
        whole = self.read("out", "robot.urdf").replace("</robot>", "".join(elements) + "</robot>")
        for name, link, child in (("sensor/my cam/pose", "optical", "my cam"), ("target/board/pose", "wall", "board")):
            pose = result["parameters"][name]["pose"]
            there = mul(frame(whole, link, POSTURES[0]), from_quat(pose["xyz"], pose["quat"]))
            self.assertSame([frame(whole, child, POSTURES[0])], [there], 1e-9, 1e-7)
            line = [l for l in self.printed.splitlines() if "static_transform_publisher" in l and "--frame-id " + link in l]
            self.assertEqual(len(line), 1, self.printed)
            given = dict(re.findall(r"--(\w+) (-?[\d.e-]+)", line[0]))
            self.assertSame([from_quat(pose["xyz"], pose["quat"])],
                            [from_quat([float(given[k]) for k in "xyz"], [float(given["q" + k]) for k in "xyzw"])], 1e-9, 1e-7)
        self.assertIn("--child-frame-id 'my cam'", self.printed)
        changes = self.read("out", "changes.yaml")
        self.assertIn("mounts:", changes)
        for text in elements[0].splitlines() + [line[0]]:
            self.assertIn("      " + text.strip(), changes)

    def test_none_where_joints_have_all(self):
        self.simulate()
        self.calibrate(RIG % (BOARD, ", mount_joint: joint/wall_joint", "mount: joint/camera_joint, "))
        self.assertNotIn("static_transform_publisher", self.printed)
        self.assertNotIn("mounts:", self.read("out", "changes.yaml"))


class Words(Case):
    def test_names_of_lenses(self):
        self.simulate()
        chi2 = {}
        for name, distortion in (("brown_conrady", ""), ("plumb_bob", ""), ("rational_polynomial", ""), ("brown_conrady", "distortion: [0, 0, 0, 0, 0, 0, 0, 0], "),
                                 ("kannala_brandt", ""), ("equidistant", ""), ("fisheye", "")):
            result = self.calibrate(BY_POSE.replace("model: brown_conrady, ", "model: %s, %s" % (name, distortion)), "--no-group", "*", code=None)
            chi2[name + distortion[:1]] = result["chi2"]
            if name != "brown_conrady":
                self.assertIn("model: " + name, self.read("out", "rig.yaml"))
        self.assertEqual(chi2["plumb_bob"], chi2["brown_conrady"])
        self.assertEqual(chi2["rational_polynomial"], chi2["brown_conradyd"])
        self.assertEqual(chi2["equidistant"], chi2["kannala_brandt"])
        self.assertEqual(chi2["fisheye"], chi2["kannala_brandt"])
        self.write("wrong.yaml", BY_POSE.replace("brown_conrady", "plumbbob"))
        text = self.kincal("check", "wrong.yaml", "sim/samples.jsonl", code=1)
        for part in ("unknown model 'plumbbob'; nearest: plumb_bob", "valid: pinhole (no distortion), brown_conrady (k1 k2 p1 p2 k3", "ROS calls it equidistant"):
            self.assertIn(part, text)

    def test_a_free_board_that_one_camera_sees_alone(self):
        """Its own pose in every sample explains everything: what to do is said, wherever it ends."""
        self.simulate()
        free = BY_POSE.replace("mount: {link: wall}", "mount: free")
        result = self.calibrate(free, code=2)
        for text in (result["verdict"]["text"], self.printed):
            self.assertIn("mount board on the link that carries it (the base, if nothing moves), or let a second sensor see it", text)
        self.assertIn("Mount 'board' (`mount: {link: NAME}`) on the link that carries it", self.kincal("check", "out.yaml", "sim/samples.jsonl"))
        text = self.kincal("calibrate", "out.yaml", "sim/samples.jsonl", "--out", "no", "--no-group", "*", "--fix", "sensor/*/pose", code=1)
        self.assertIn("nothing can be estimated: everything that may be wrong is fixed by options", text)
        # A tracker on the base's own body, whose mount is a joint that nothing depends on.
        tracker = re.sub("cam: .*", "cam: {type: point, link: optical, mount: joint/camera_joint, sigma: 0.001}", free).replace("base: base", "base: camera_link")
        self.write("mounted.yaml", tracker.replace("mount: free", "mount: {link: wall%s}" % BOARD))
        self.kincal("simulate", "mounted.yaml", "--samples", "8", "--seed", "1", "--out", "points")
        self.write("tracker.yaml", tracker)
        text = self.kincal("calibrate", "tracker.yaml", "points/samples.jsonl", "--out", "no", code=1)
        self.assertIn("nothing can be estimated; target 'board' is free and seen by sensor 'cam' alone", text)
        self.assertIn("Mount it (`mount: {link: NAME}`) on the link that carries it, or let a second sensor see it", text)

    def test_a_joint_that_cancels_needs_no_reading(self):
        """Board and arm both turn with the torso."""
        robot = urdf(RIGHT, torso=True)
        self.simulate(robot=robot)
        lines = [json.loads(line) for line in self.read("sim", "samples.jsonl").splitlines()]
        self.assertIn("torso", lines[0]["joints"])
        known = self.calibrate(BY_POSE)
        for line in lines:
            del line["joints"]["torso"]
        self.write("without.jsonl", "".join(json.dumps(line) + "\n" for line in lines))
        without = self.calibrate(BY_POSE, out="without", samples="without.jsonl")
        self.assertEqual(without["status"], "converged")
        self.assertAlmostEqual(without["chi2"], known["chi2"], delta=1e-6 * known["chi2"])
        self.assertSame(self.camera(without, "without"), self.camera(known), 1e-6, 1e-6)
        for command in ("check", "evaluate"):
            self.kincal(command, "without.yaml", "without.jsonl")
        # Each other joint is needed, and the torso's as soon as the board stands on the floor, or a sensor does.
        for line in lines:
            line["joints"].pop("j3")
        self.write("wrong.jsonl", json.dumps(lines[0]) + "\n")
        self.assertIn("sensor 'cam' needs joint 'j3', which the sample lacks", self.kincal("check", "without.yaml", "wrong.jsonl", code=1))
        self.write("floor.yaml", BY_POSE.replace("link: wall", "link: base"))
        self.assertIn("sensor 'cam' needs joint 'torso', which the sample lacks", self.kincal("check", "floor.yaml", "without.jsonl", code=1))


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:], verbosity=1)
