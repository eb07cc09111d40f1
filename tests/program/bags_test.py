"""Recordings through the program, `kincal import` of bags: python3 bags_test.py SOURCE_DIR KINCAL [TEST ...]

Proves: what `--list` says of a ROS 1 bag written here as its specification says; messages of the paper's tool become samples that
`kincal check` reads, and their ids find sensors and targets by name and `topic`; a bag that is cut off, no bag, or not of such messages
is said; killed at any moment, an import leaves whole samples or none. Data.Hrp2: the paper's tool's own recording gives the samples that are
there. Others (skipped without node, npm, a network for npm, kincal-render): the readers of npm's @foxglove/rosbag and @mcap/core find in what
`kincal simulate --bag` writes the samples of the simulation, and kincal reads what @mcap/core writes, with lz4 and zstd. Not proved: other
messages (images, joint states). The containers, damage and decoding are in tests/recordings/bag_test.cpp; Debian's python3-rosbag reads written
bags in render_test.py.
"""
import json
import os
import random
import shutil
import struct
import subprocess
import sys
import time
import unittest

import helpers

SOURCE_DIR = KINCAL = None
DATA = os.environ.get("KINCAL_DATA")

LINE = "=" * 80 + "\nMSG: "
HEADER = LINE + "std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
STATE = LINE + "sensor_msgs/JointState\nHeader header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
MEASUREMENT = ("string sample_id\nstring target_id\nstring chain_id\nCameraMeasurement[] M_cam\nLaserMeasurement[] M_laser\nChainMeasurement[] M_chain\n"
               + LINE + "calibration_msgs/CameraMeasurement\nHeader header\nstring camera_id\ngeometry_msgs/Point[] image_points\n"
               + LINE + "calibration_msgs/LaserMeasurement\nHeader header\nstring laser_id\nsensor_msgs/JointState[] joint_points\n"
               + LINE + "calibration_msgs/ChainMeasurement\nHeader header\nstring chain_id\nsensor_msgs/JointState chain_state\n"
               + LINE + "geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n" + HEADER + STATE)


def text(t):
    return struct.pack("<I", len(t)) + t.encode()


def array(items):
    return struct.pack("<I", len(items)) + b"".join(items)


def header(stamp=0.0):
    return struct.pack("<III", 0, int(stamp), int(stamp % 1 * 1e9)) + text("")


def state(joints, stamp=0.0):
    return header(stamp) + array([text(j) for j in joints]) + array([struct.pack("<d", p) for p in joints.values()]) + array([]) + array([])


def measurement(name, joints, pixels, rays=(), target="plate", camera="eye", chain="arm_chain", stamp=1700000000.5):
    cameras = [header(stamp) + text(camera) + array([struct.pack("<ddd", u, v, 0) for u, v in pixels])]
    lasers = [header(stamp) + text("tilt_laser") + array([state(dict(zip("abc", ray))) for ray in rays])] if rays else []
    return (text(name) + text(target) + text(chain) + array(cameras) + array(lasers) +
            array([header(stamp) + text(chain) + state(joints, stamp)]))


def record(fields, data):
    parts = b"".join(struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in fields)
    return struct.pack("<I", len(parts)) + parts + struct.pack("<I", len(data)) + data


def bag(topics, messages):
    """topics: (name, type, definition); messages: (topic's number, time, bytes), each in a chunk of its own; no index."""
    out = b"#ROSBAG V2.0\n" + record([("op", b"\x03"), ("index_pos", struct.pack("<Q", 0)), ("conn_count", b"\0" * 4), ("chunk_count", b"\0" * 4)], b" " * 100)
    for i, (name, kind, definition) in enumerate(topics):
        about = record([("topic", name.encode()), ("type", kind.encode()), ("md5sum", b"*"), ("message_definition", definition.encode())], b"")
        size = struct.unpack("<I", about[:4])[0]
        out += record([("conn", struct.pack("<I", i)), ("op", b"\x07"), ("topic", name.encode())], about[4:4 + size])
    for topic, time, data in messages:
        one = record([("conn", struct.pack("<I", topic)), ("op", b"\x02"), ("time", struct.pack("<II", int(time), int(time % 1 * 1e9)))], data)
        out += record([("compression", b"none"), ("op", b"\x05"), ("size", struct.pack("<I", len(one)))], one)
    return out


URDF = ('<robot name="arm"><link name="base"/>%s<joint name="tilt" type="revolute"><parent link="base"/><child link="head"/><origin xyz="0 0 1"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint><link name="head"/></robot>'
        % "".join(helpers.revolute([("j1", "l1", "0 0 0.3", "0 0 1"), ("j2", "tool", "0.3 0 0", "0 1 0")], "base", 2)))

RIG = """format: kincal/1
robot: arm.urdf
base: base
targets:
  board: {type: points, points: [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]], mount: free}
sensors:
  left: {type: camera, link: base, model: pinhole, intrinsics: [500, 500, 320, 240], sigma: 0.3%s}
  right: {type: camera, link: base, model: pinhole, intrinsics: [500, 500, 320, 240], sigma: 0.3}
  hand: {type: chain, link: tool, sigma: {translation: 0.001, rotation: 0.001}}
  laser: {type: tilting_laser, link: head, joint: tilt, sigma: {joint: 0.001, bearing: 0.001, range: 0.01}}
"""

PIXELS = [[10.5, 20.25], [30, 20], [10, 40], [30, 40.125]]
RAYS = [[0.1, 0.2, 1.5], [0.11, 0.2, 1.5], [0.1, 0.25, 1.5], [0.11, 0.25, 1.5]]


def run(*arguments, **more):
    return subprocess.run([KINCAL, "import"] + list(arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, **more)


@unittest.skipUnless(os.path.exists(os.path.join(os.path.dirname(sys.argv[2]) if len(sys.argv) > 2 else "", "kincal-bags")), "kincal-bags is not built")
class Bags(helpers.Folder):
    def setUp(self):
        super().setUp()
        self.write("arm.urdf", URDF)
        self.rig = self.write("rig.yaml", RIG % ", topic: eye")
        joints = {"j1": 0.25, "j2": -0.5, "tilt": 0.125, "gripper": 0.01}
        self.messages = [(0, 1700000000 + i, measurement("s%d" % i, joints, PIXELS, RAYS if i else ())) for i in range(3)]
        self.topics = [("robot_measurement", "calibration_msgs/RobotMeasurement", MEASUREMENT), ("/own", "mine/Thing", "float64 x\nmine/Other[] rest\n" + LINE + "mine/Other\nint8 y\n")]

    def test_samples(self):
        """Ids of the recording are the rig's names, topics, or the only one; joints that the robot has not are left out, and said."""
        path = self.write("a.bag", bag(self.topics, self.messages))
        p = run(path, "--rig", self.rig, "--out", self.path("samples.jsonl"))
        self.assertEqual(p.returncode, 0, p.stderr)
        self.assertIn("3 samples", p.stdout)
        self.assertIn("joint 'gripper' of the recording is not in the robot", p.stderr)
        samples = [json.loads(line) for line in self.read("samples.jsonl").splitlines()]
        self.assertEqual([s["id"] for s in samples], ["s0", "s1", "s2"])
        self.assertAlmostEqual(samples[0]["time"], 1700000000.5)
        self.assertEqual(samples[0]["joints"], {"j1": 0.25, "j2": -0.5, "tilt": 0.125})
        self.assertEqual([v["sensor"] for v in samples[1]["views"]], ["left", "laser", "hand"])
        self.assertEqual(samples[1]["views"][0]["pixels"], PIXELS)
        self.assertEqual(samples[1]["views"][1]["rays"], RAYS)
        self.assertEqual(len(samples[0]["views"]), 2)
        self.assertIn("--force", run(path, "--rig", self.rig, "--out", self.path("samples.jsonl")).stderr)

    def test_unknown_ids(self):
        """What the rig does not have is left out, with what to write."""
        self.write("rig.yaml", RIG % "")
        path = self.write("a.bag", bag(self.topics, self.messages))
        p = run(path, "--rig", self.rig, "--out", self.path("samples.jsonl"))
        self.assertEqual(p.returncode, 0, p.stderr)
        self.assertIn("camera 'eye' of the recording is not a sensor of the rig (left, right): write `topic: eye`", p.stderr)
        few = self.write("few.bag", bag(self.topics, [(0, 1, measurement("s", {}, PIXELS[:3]))]))
        self.write("rig.yaml", RIG % ", topic: eye")
        p = run(few, "--rig", self.rig, "--out", self.path("few.jsonl"))
        self.assertIn("sample 's': 'left' has 3 points, target 'board' has 4: left out", p.stderr)

    def test_calibration_data(self):
        """robot_calibration's own bags: points of a depth camera, or of a camera through the lens beside them, and an arm that holds the target."""
        info = LINE + "sensor_msgs/CameraInfo\nHeader header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] D\nfloat64[9] K\n"
        definition = ("sensor_msgs/JointState joint_states\nObservation[] observations\n"
                      + LINE + "robot_calibration_msgs/Observation\nstring sensor_name\ngeometry_msgs/PointStamped[] features\nExtendedCameraInfo ext_camera_info\n"
                      + LINE + "robot_calibration_msgs/ExtendedCameraInfo\nsensor_msgs/CameraInfo camera_info\n" + info
                      + LINE + "geometry_msgs/PointStamped\nHeader header\ngeometry_msgs/Point point\n" + LINE + "geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n" + HEADER + STATE)
        points = [[0.25, -0.5, 1], [0.5, 0, 2], [1, 1, 4], [0, 0.5, 2]]

        def observation(name, features):
            lens = header() + struct.pack("<II", 480, 640) + text("plumb_bob") + array([]) + struct.pack("<9d", 500, 0, 320, 0, 400, 240, 0, 0, 1)
            return text(name) + array([header() + struct.pack("<ddd", *p) for p in features]) + lens

        joints = {"j1": 0.25, "j2": -0.5, "gripper": 0.01}
        data = [(0, 1700000000, state(joints, 1700000000.5) + array([observation("depth", points), observation("left", points), observation("hand", points),
                                                                    observation("unknown", points)]))]
        path = self.write("c.bag", bag([("/calibration_data", "robot_calibration_msgs/CalibrationData", definition)], data))
        self.write("rig.yaml", RIG % "" + "  depth: {type: point, link: base, sigma: 0.001}\n")
        p = run(path, "--rig", self.rig, "--out", self.path("samples.jsonl"))
        self.assertEqual(p.returncode, 0, p.stderr)
        sample = json.loads(self.read("samples.jsonl"))
        self.assertEqual(sample["joints"], {"j1": 0.25, "j2": -0.5})
        self.assertAlmostEqual(sample["time"], 1700000000.5)
        self.assertEqual(sample["views"], [{"sensor": "depth", "target": "board", "ids": [0, 1, 2, 3], "points": points},
                                           {"sensor": "left", "target": "board", "ids": [0, 1, 2, 3], "pixels": [[445, 40], [445, 240], [445, 340], [320, 340]]},
                                           {"sensor": "hand", "target": "board"}])
        self.assertIn("'unknown'", p.stderr)
        self.write("rig.yaml", (RIG % "").replace("hand:", "other:"))
        p = run(path, "--rig", self.rig, "--out", self.path("left.jsonl"))
        self.assertEqual([v["sensor"] for v in json.loads(self.read("left.jsonl"))["views"]], ["left"], p.stderr)

    def test_an_id_that_is_no_text(self):
        """A sample_id that is no UTF-8 made a file of samples that nothing could read."""
        message = measurement("s_", {"j1": 0.25, "j2": -0.5, "tilt": 0.125}, PIXELS).replace(b"s_", b"s\xb1", 1)
        path = self.write("a.bag", bag(self.topics, [(0, 1700000000, message)]))
        p = run(path, "--rig", self.rig, "--out", self.path("samples.jsonl"))
        self.assertEqual(p.returncode, 0, p.stderr)
        self.assertIn("a sample_id is no UTF-8", p.stderr)
        self.assertEqual([json.loads(line)["id"] for line in self.read("samples.jsonl").splitlines()], ["measurement_1"])

    def test_list(self):
        """Topics, types, counts, rates, gaps; fields of what is not known."""
        path = self.write("a.bag", bag(self.topics, self.messages + [(1, 1700000012.5, struct.pack("<dI", 1, 0))]))
        p = run(path, "--list")
        self.assertEqual(p.returncode, 0, p.stderr)
        self.assertIn("ROS 1 bag; 4 messages in 12.500 s from 2023-11-14 22:13:20 UTC", p.stdout)
        self.assertRegex(p.stdout, r"robot_measurement +calibration_msgs/RobotMeasurement +3 +1\.0 +0\.000 s +1\.000 s")
        self.assertRegex(p.stdout, r"/own +mine/Thing +1 +- +12\.500 s +-")
        self.assertIn("mine/Thing (/own) has: x, rest[]", p.stdout)

    def test_compressed_video(self):
        """What it is, that it is not read, and what to do."""
        video = "std_msgs/Header header\nuint8[] data\nstring format\n" + HEADER
        image = "std_msgs/Header header\nstring format\nuint8[] data\n" + HEADER
        for name, kind, definition, data, said in (
                ("/eye/video", "foxglove_msgs/CompressedVideo", video, header(1700000000.0) + array([b"\0"]) + text("h264"), "foxglove_msgs/CompressedVideo"),
                ("/eye/image_raw/compressed", "sensor_msgs/CompressedImage", image, header(1700000000.0) + text("H264") + array([b"\0"]), "sensor_msgs/CompressedImage, H264")):
            path = self.write("v.bag", bag([(name, kind, definition), ("/joint_states", "sensor_msgs/JointState", STATE.split("\n", 2)[2] + HEADER)],
                                           [(0, 1700000000 + 0.1 * i, data) for i in range(30)] +
                                           [(1, 1700000000 + 0.01 * i, state({"j1": 0.1, "j2": 0.2, "tilt": 0.0}, 1700000000 + 0.01 * i)) for i in range(300)]))
            self.write("rig.yaml", RIG % "")
            for arguments in (("--list",), ("--out", self.path("samples.jsonl"))):
                p = run(path, "--rig", self.rig, *arguments)
                self.assertEqual(p.returncode, 0 if "--list" in arguments else 1, p.stderr)
                self.assertIn("%s is compressed video (%s), which is not read" % (name, said), p.stdout + p.stderr)
                self.assertIn("Record raw, PNG or JPEG images; or extract images of the video", p.stdout + p.stderr)

    def test_damaged(self):
        """What is whole becomes samples; what is lost is said; nothing at all is exit code 1."""
        whole = bag(self.topics, self.messages)
        path = self.write("cut.bag", whole[:-40])
        p = run(path, "--rig", self.rig, "--out", self.path("samples.jsonl"))
        self.assertEqual(p.returncode, 0, p.stderr)
        self.assertIn("warning: lost: %s: bytes" % path, p.stderr)
        self.assertEqual(len(self.read("samples.jsonl").splitlines()), 2)
        p = run(self.write("none.bag", whole[:200]), "--rig", self.rig, "--out", self.path("none.jsonl"))
        self.assertEqual(p.returncode, 1)
        self.assertFalse(os.path.exists(self.path("none.jsonl")))
        p = run(self.path("none.bag"), "--list")
        self.assertEqual((p.returncode, p.stderr), (1, "kincal: error: %s: no messages that could be read\n" % self.path("none.bag")))
        self.assertIn("0 messages", p.stdout)

    def test_many_wrong_messages(self):
        """Twenty are told, the others counted."""
        wrong = [(0, 1700000100 + i, self.messages[0][2][:-3]) for i in range(25)]
        p = run(self.write("a.bag", bag(self.topics, self.messages + wrong)), "--rig", self.rig, "--out", self.path("samples.jsonl"))
        self.assertEqual(p.returncode, 0, p.stderr)
        self.assertEqual(p.stderr.count("a message of robot_measurement"), 20)
        self.assertIn("a.bag: and 5 more messages", p.stderr)
        self.assertEqual(len(self.read("samples.jsonl").splitlines()), 3)

    def test_wrong_use(self):
        os.mkdir(self.path("hollow"))
        path = self.write("a.bag", bag(self.topics, self.messages))
        for arguments, word in (((path,), "--rig is missing"), ((path, "--rig", self.rig), "--out is missing"),
                                ((path, "--sensor", "left", "--list"), "is a recording"), ((path, "--rectified", "--list"), "is a recording"), ((self.rig, "--list"), "--list is for recordings"),
                                ((path, self.path("gone.bag"), "--list"), "gone.bag: no such file"), ((self.path("gone.bag"), "--list"), "gone.bag: no such file"),
                                ((self.write("text.bag", "hello\n"), "--list"), "text.bag: neither a ROS 1 bag"), ((self.write("none.mcap", ""), "--list"), "the file is empty"),
                                ((self.path("hollow"), "--list"), "a folder without metadata.yaml, .mcap, .db3 or .bag")):
            p = run(*arguments)
            self.assertEqual(p.returncode, 1, arguments)
            self.assertIn(word, p.stderr)
        other = self.write("other.bag", bag(self.topics, [(1, 5, struct.pack("<dI", 1, 0))]))
        p = run(other, "--rig", self.rig, "--out", self.path("x.jsonl"))
        self.assertEqual(p.returncode, 1)
        self.assertIn("no samples: it has no messages of joints, poses, images or scans", p.stderr)


    def test_killed(self):
        """Killed at any moment: the old samples or the new ones, whole; and the next run is not in its way."""
        path = self.write("a.bag", bag(self.topics, [(0, 1700000000 + i, measurement("s%d" % i, {"j1": 0.25, "j2": -0.5, "tilt": 0.125}, PIXELS, RAYS)) for i in range(300)]))
        out, command = self.path("samples.jsonl"), [KINCAL, "import", path, "--rig", self.rig, "--out", self.path("samples.jsonl"), "--force", "--quiet"]
        start = time.monotonic()
        subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
        took, new, seen = time.monotonic() - start, self.read("samples.jsonl"), set()
        random.seed(5)
        for _ in range(int(os.environ.get("KINCAL_KILLS", "20"))):
            self.write("samples.jsonl", "old\n")
            p = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            time.sleep(random.uniform(0, 1.2 * took))
            p.kill()
            p.wait()
            self.assertIn(self.read("samples.jsonl"), ("old\n", new))
            seen.add(self.read("samples.jsonl") == new)
        print("killed: old and new seen" if len(seen) == 2 else "killed: only %s seen" % ("new" if seen == {True} else "old"))
        subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
        self.assertEqual([name for name in os.listdir(os.path.dirname(out)) if "writing" in name or "replaced" in name], [])


class Others(helpers.Folder):
    """What is not kincal's reads what kincal writes, and the reverse."""

    def setUp(self):
        super().setUp()
        missing = [p for p in ("node", "npm") if shutil.which(p) is None] + [p for p in ("kincal-render", "kincal-bags") if not os.path.exists(os.path.join(os.path.dirname(KINCAL), p))]
        if missing:
            self.skipTest("without " + ", ".join(missing))
        shutil.copytree(os.path.join(SOURCE_DIR, "tests", "program", "readers"), self.path("readers"), ignore=shutil.ignore_patterns("node_modules"))
        fetched = subprocess.run(["npm", "ci", "--no-audit", "--no-fund"], cwd=self.path("readers"), stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        if fetched.returncode != 0:
            self.skipTest("npm fetches nothing here: " + fetched.stdout.decode()[-300:])

    def node(self, *arguments):
        p = subprocess.run(["node", self.path("readers", "bags.js"), *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.assertEqual(p.returncode, 0, p.stderr.decode())
        return p.stdout

    def test_written(self):
        """One simulation as both kinds of bags: the same messages, whose joints and images are those of its samples."""
        self.write("arm.urdf", URDF)
        self.write("rig.yaml", """format: kincal/1
robot: arm.urdf
base: base
targets:
  board: {type: chessboard, rows: 6, columns: 9, square: 0.02, mount: free}
sensors:
  eye: {type: camera, link: tool, model: brown_conrady, intrinsics: [130, 130, 80, 60], distortion: [-0.1, 0.02, 0, 0, 0], image_size: [160, 120], sigma: 0.2, pose: {xyz: [0.05, 0, 0.04]}}
""")
        read = {}
        for name in ("a.bag", "a.mcap"):
            p = subprocess.run([KINCAL, "simulate", self.path("rig.yaml"), "--samples", "3", "--seed", "4", "--out", self.path("sim"), "--force", "--bag", self.path(name),
                                "--rest", "0.4", "--move", "0.3", "--scatter", "0"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            self.assertEqual(p.returncode, 0, p.stderr.decode())
            read[name] = json.loads(self.node("read", self.path(name)))
        start = 1767225600 * 10**9
        for name, messages in read.items():
            joints, images, cameras, texts = ([m for m in messages if m[0] == topic] for topic in ("/joint_states", "/eye/image_raw", "/eye/camera_info", "/robot_description"))
            self.assertEqual((len(joints), len(images), len(cameras), len(texts), len(messages)), (181, 18, 18, 1, 218), name)
            self.assertEqual([int(m[2]) - start for m in joints], [10**7 * i for i in range(181)])
            self.assertTrue(all(m[3]["stamp"] == m[2] for m in joints + images + cameras))
            samples = [json.loads(line) for line in self.read("sim/samples.jsonl").splitlines()]
            for k, sample in enumerate(samples):   # at rest, and without scatter, each is the sample's
                for i in (70 * k, 70 * k + 20, 70 * k + 40):
                    self.assertEqual(dict(zip(joints[i][3]["name"], joints[i][3]["position"])), sample["joints"])
            self.assertEqual([images[0][3][key] for key in ("width", "height", "step", "encoding")], [160, 120, 160, "mono8"])
            self.assertEqual((images[0][3]["data"][0], cameras[0][3]["k"], cameras[0][3]["d"]), (160 * 120, [130, 0, 80, 0, 130, 60, 0, 0, 1], [-0.1, 0.02, 0, 0, 0]))
            self.assertEqual(texts[0][3]["data"], URDF)
        for a, b in zip(*(sorted(m, key=lambda one: (one[0], int(one[2]))) for m in read.values())):
            self.assertEqual((a[0], a[1].replace("/", "/msg/"), a[2], a[3]), (b[0], b[1], b[2], b[3]))

    def test_read(self):
        for how in ("lz4", "zstd"):
            self.node("write", self.path("a.mcap"), how)
            p = run(self.path("a.mcap"), "--list")
            self.assertEqual(p.returncode, 0, p.stderr)
            self.assertIn("MCAP, %s; 200 messages in 1.990 s from 2023-11-14 22:13:20 UTC" % how, p.stdout)
            self.assertRegex(p.stdout, r"/joint_states sensor_msgs/JointState +200 +100.0 +0.000 s +0.010 s")
            self.assertNotIn("LOST", p.stdout)


class Data(helpers.Folder):
    def test_hrp2(self):
        """The paper's tool's own recording gives the samples that its README calls equal (pixels rounded to 4 decimals there)."""
        folder = os.path.join(DATA or os.path.join(os.path.dirname(SOURCE_DIR), "shared", "data"), "hrp2-real")
        if not os.path.isdir(folder) or not os.path.exists(os.path.join(os.path.dirname(KINCAL), "kincal-bags")):
            self.skipTest("no data, or no kincal-bags")
        p = run(os.path.join(folder, "cal_measurements0.bag"), "--rig", os.path.join(folder, "rig.yaml"), "--out", self.path("samples.jsonl"))
        self.assertEqual((p.returncode, p.stderr), (0, ""))
        got = [json.loads(line) for line in self.read("samples.jsonl").splitlines()]
        with open(os.path.join(folder, "samples.jsonl"), encoding="utf-8") as file:
            given = [json.loads(line) for line in file]
        self.assertEqual(len(got), 47)
        for a, b in zip(got, given):
            self.assertEqual((a["id"], a["joints"]), (b["id"], b["joints"]))
            self.assertAlmostEqual(a["time"], b["time"], delta=1e-6)
            self.assertEqual([(v["sensor"], v["target"]) for v in a["views"]], [(v["sensor"], v["target"]) for v in b["views"]])
            for p, q in zip(a["views"][0]["pixels"], b["views"][0]["pixels"]):
                self.assertLess(max(abs(p[0] - q[0]), abs(p[1] - q[1])), 5.1e-5)


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    result = unittest.main(argv=[sys.argv[0]] + sys.argv[3:], exit=False).result
    skipped = len(result.skipped) == result.testsRun
    sys.exit(77 if skipped and result.wasSuccessful() else not result.wasSuccessful())
