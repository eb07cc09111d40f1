"""Every kind of message through a whole import: python3 bag_kinds_test.py SOURCE_DIR KINCAL [TEST ...]

A recording of `simulate --bag` is written again with its images in another encoding, and imported. Proves: rgb8, bgr8 and PNG images of a grey scene give the samples of
mono8, mono16 (which is stretched) the same corners within 0.02 px and a Bayer pattern within 0.1 px; `--apply-offsets` gives the samples of a camera that is stamped late those of one that is
not, within their sigmas; PointCloud2 of a lidar and sweeps of a tilting laser become samples, the latter a calibration that is right within its covariance;
offsets of clocks that are 0.4 to 300 s apart are found, with and without times of reception; readings in a table beside a bag of images give the same samples;
JPEG images in a ROS 1 bag, in MCAP with ROS 1's messages and in MCAP with ROS 2's give the same corners within 0.05 px;
the program without OpenCV (the same sources without the search, not another build of OpenCV's absence) writes an image of each rest, `detect` goes on from there; killed
at any moment while it searches images, an import leaves the old samples or the new ones. Not proved: real recordings.
"""
import importlib.util
import json
import math
import os
import random
import struct
import subprocess
import sys
import time
import unittest
import zlib

import bags_test
import helpers
import recordings_test

SOURCE_DIR = KINCAL = None

COMPRESSED = "std_msgs/Header header\nstring format\nuint8[] data\n" + bags_test.HEADER
CLOUD = ("std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n"
         + bags_test.HEADER + bags_test.LINE + "sensor_msgs/PointField\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n")
STATE = bags_test.STATE.split("\n", 2)[2].replace("Header header", "std_msgs/Header header", 1) + bags_test.HEADER


def records(data, at=0):
    """(fields, data) of the records of a ROS 1 bag from a place on."""
    while at + 4 <= len(data):
        size = struct.unpack_from("<I", data, at)[0]
        header, at = data[at + 4:at + 4 + size], at + 4 + size
        fields, k = {}, 0
        while k < size:
            n = struct.unpack_from("<I", header, k)[0]
            name, value = header[k + 4:k + 4 + n].split(b"=", 1)
            fields[name.decode()] = value
            k += 4 + n
        size = struct.unpack_from("<I", data, at)[0]
        yield fields, data[at + 4:at + 4 + size]
        at += 4 + size


def read_bag(path):
    """Topics [name, type, definition] and messages (number of the topic, seconds, bytes) of a bag that is not packed."""
    with open(path, "rb") as file:
        data = file.read()
    topics, messages = {}, []
    for fields, chunk in records(data, len(b"#ROSBAG V2.0\n")):
        for one, content in (records(chunk) if fields["op"] == b"\x05" else ()):
            number = struct.unpack("<I", one["conn"])[0]
            if one["op"] == b"\x07":
                about = next(records(struct.pack("<I", len(content)) + content + b"\0\0\0\0"))[0]
                topics[number] = [one["topic"].decode(), about["type"].decode(), about["message_definition"].decode()]
            elif one["op"] == b"\x02":
                s, ns = struct.unpack("<II", one["time"])
                messages.append((number, s + 1e-9 * ns, content))
    assert sorted(topics) == list(range(len(topics)))
    return [topics[k] for k in sorted(topics)], messages


def mcap(topics, messages):
    """An MCAP with messages as ROS 1 writes them; topics and messages as bags_test.bag has them."""
    text = bags_test.text
    record = lambda op, data: bytes([op]) + struct.pack("<Q", len(data)) + data
    out = b"\x89MCAP0\r\n" + record(1, text("ros1") + text(""))
    for i, (name, kind, definition) in enumerate(topics):
        out += record(3, struct.pack("<H", i + 1) + text(kind) + text("ros1msg") + text(definition))
        out += record(4, struct.pack("<HH", i, i + 1) + text(name) + text("ros1") + struct.pack("<I", 0))
    for n, (topic, at, data) in enumerate(messages):
        out += record(5, struct.pack("<HIQQ", topic, n, int(1e9 * at), int(1e9 * at)) + data)
    return out + record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0)) + b"\x89MCAP0\r\n"


def with_jpeg(data, jpeg):
    """An MCAP of ROS 2's messages as `simulate --bag` writes it, without its index, whose images are compressed."""
    def records(part):
        at = 0
        while at + 9 <= len(part):
            size = struct.unpack_from("<Q", part, at + 1)[0]
            yield part[at], part[at + 9:at + 9 + size]
            at += 9 + size
    flat = []
    for op, content in records(data[8:]):
        if op != 6:
            flat.append((op, content))
            continue
        n = struct.unpack_from("<I", content, 28)[0]
        assert n == 0   # not packed
        flat += list(records(content[32 + n + 8:]))
    string = lambda content, at: content[at + 4:at + 4 + struct.unpack_from("<I", content, at)[0]]
    images = {struct.unpack("<H", c[:2])[0] for op, c in flat if op == 4 and string(c, 4) == b"/camera/image_raw"}
    raw = {struct.unpack("<H", c[2:4])[0] for op, c in flat if op == 4 and struct.unpack("<H", c[:2])[0] in images}
    out = data[:8]
    for op, content in flat:
        if op == 3 and struct.unpack("<H", content[:2])[0] in raw:
            definition = COMPRESSED.replace("uint32 seq\n", "").replace("time stamp", "builtin_interfaces/Time stamp") + bags_test.LINE + "builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
            content = content[:2] + bags_test.text("sensor_msgs/msg/CompressedImage") + bags_test.text("ros2msg") + bags_test.text(definition)
        elif op == 5 and struct.unpack("<H", content[:2])[0] in images:
            padded = lambda b: b + b"\0" * (-(len(b) - 4) % 4)   # behind the four bytes of CDR
            cdr = content[22:]
            size = 4 + 8 + 4 + struct.unpack_from("<I", cdr, 12)[0]
            head = padded(cdr[:size])
            height, width = struct.unpack_from("<II", cdr, len(head))
            file = jpeg(width, height, cdr[-width * height:])
            content = content[:22] + padded(head + struct.pack("<I", 5) + b"jpeg\0") + struct.pack("<I", len(file)) + file
        elif op not in (1, 3, 4, 5):
            continue
        out += bytes([op]) + struct.pack("<Q", len(content)) + content
    end = lambda op, content: bytes([op]) + struct.pack("<Q", len(content)) + content
    return out + end(15, b"\0" * 4) + end(2, b"\0" * 20) + data[:8]


class Image:
    """A grey sensor_msgs/Image, to be written in other ways."""

    def __init__(self, data):
        size = 12 + 4 + struct.unpack_from("<I", data, 12)[0]
        self.header = data[:size]
        self.height, self.width, n = struct.unpack_from("<III", data, size)
        assert data[size + 12:size + 12 + n] == b"mono8"
        self.pixels = data[size + 12 + n + 9:]
        assert len(self.pixels) == self.height * self.width

    def raw(self, encoding, pixels, step):
        return (self.header + struct.pack("<II", self.height, self.width) + bags_test.text(encoding) + struct.pack("<BII", 0, step, len(pixels)) + pixels)

    def colours(self, encoding):
        three = bytearray(3 * len(self.pixels))
        for k in range(3):
            three[k::3] = self.pixels
        return self.raw(encoding, bytes(three), 3 * self.width)

    def deep(self, encoding):
        two = bytearray(2 * len(self.pixels))
        two[0::2] = two[1::2] = self.pixels
        return self.raw(encoding, bytes(two), 2 * self.width)

    def bayer(self, encoding):
        return self.raw(encoding, self.pixels, self.width)

    def png(self):
        chunk = lambda name, data: struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        lines = b"".join(b"\0" + self.pixels[r * self.width:(r + 1) * self.width] for r in range(self.height))
        data = (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", self.width, self.height, 8, 0, 0, 0, 0)) + chunk(b"IDAT", zlib.compress(lines, 1)) + chunk(b"IEND", b""))
        return self.header + bags_test.text("mono8; png compressed ") + struct.pack("<I", len(data)) + data


    def jpeg(self):
        data = jpeg_of(self.width, self.height, self.pixels)
        return self.header + bags_test.text("mono8; jpeg compressed ") + struct.pack("<I", len(data)) + data


def jpeg_of(width, height, pixels):
    program = os.path.join(os.path.dirname(KINCAL), "tests", "jpeg-of-grey")
    return subprocess.run([program, str(width), str(height), "95"], input=pixels, stdout=subprocess.PIPE, check=True).stdout


class Recorded(helpers.Folder):
    def setUp(self):
        super().setUp()
        if not recordings_test.built():
            self.skipTest("kincal-bags or kincal-render is not built")

    def run_it(self, *arguments, code=0, program=None):
        p = subprocess.run([program or KINCAL, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, cwd=self.dir)
        self.assertEqual(p.returncode, code, p.stdout + p.stderr)
        return p.stdout

    def samples(self, name):
        return [json.loads(line) for line in self.read(name).splitlines()]

    recorded = {}   # the bytes of each recording, which is made once

    def record_arm(self, name, *more, samples="2"):
        recordings_test.benchmark().arm(self.dir)
        key = (os.path.splitext(name)[1], more, samples)
        if key in self.recorded:
            self.write(name, self.recorded[key])
            return
        self.run_it("simulate", "rig.yaml", "--samples", samples, "--seed", "1", "--truth", "truth_values.json", "--postures", "postures.jsonl", "--out", "sim", "--bag", name,
                    "--rest", "0.8", "--move", "0.6", "--frame-rate", "5", "--quiet", "--force", *more)
        with open(self.path(name), "rb") as file:
            self.recorded[key] = file.read()

    def import_it(self, bag, *more):
        self.run_it("import", bag, "--rig", "rig.yaml", "--out", bag + ".jsonl", "--no-offsets", "--quiet", *more)
        return self.samples(bag + ".jsonl")


class Kinds(Recorded):
    def test_encodings(self):
        self.record_arm("a.bag")
        given = self.import_it("a.bag")
        self.assertEqual(len(given), 2)
        topics, messages = read_bag(self.path("a.bag"))
        k = [t[0] for t in topics].index("/camera/image_raw")
        ways = {"rgb8": lambda i: i.colours("rgb8"), "bgr8": lambda i: i.colours("bgr8"), "mono16": lambda i: i.deep("mono16"), "bayer_rggb8": lambda i: i.bayer("bayer_rggb8"),
                "png": Image.png}
        for name, way in ways.items():
            other = [list(t) for t in topics]
            if name == "png":
                other[k] = ["/camera/image_raw/compressed", "sensor_msgs/CompressedImage", COMPRESSED]
            self.write(name + ".bag", bags_test.bag(other, [(t, at, way(Image(data)) if t == k else data) for t, at, data in messages]))
            got = self.import_it(name + ".bag")
            if name not in ("mono16", "bayer_rggb8"):
                self.assertEqual(got, given, name)
                continue
            self.assertEqual([s["joints"] for s in got], [s["joints"] for s in given])
            for a, b in zip(got, given):
                pixels = [dict(zip(map(str, v["ids"]), v["pixels"])) for v in (a["views"][0], b["views"][0])]
                common = set(pixels[0]) & set(pixels[1])
                self.assertGreater(len(common), 0.9 * len(pixels[1]))
                self.assertLess(max(abs(p - q) for c in common for p, q in zip(pixels[0][c], pixels[1][c])), 0.02 if name == "mono16" else 0.1, name)

    def compare(self, got, given, most):
        """The same samples, corners within `most` px (rms)."""
        self.assertEqual([s["joints"] for s in got], [s["joints"] for s in given])
        squares = []
        for a, b in zip(got, given):
            p, q = (dict(zip(map(str, v["ids"]), v["pixels"])) for v in (a["views"][0], b["views"][0]))
            self.assertGreater(len(set(p) & set(q)), 0.9 * len(q))
            squares += [(p[c][k] - q[c][k]) ** 2 for c in set(p) & set(q) for k in (0, 1)]
        self.assertLess(math.sqrt(sum(squares) / len(squares)), most)
        self.assertGreater(max(squares), 0)   # it is another picture

    def test_jpeg(self):
        if not os.path.exists(os.path.join(os.path.dirname(KINCAL), "tests", "jpeg-of-grey")):
            self.skipTest("jpeg-of-grey is not built")
        self.record_arm("a.bag")
        self.record_arm("two.mcap")
        given = self.import_it("a.bag")
        self.assertEqual(len(given), 2)
        topics, messages = read_bag(self.path("a.bag"))
        k = [t[0] for t in topics].index("/camera/image_raw")
        other = [list(t) for t in topics]
        other[k] = ["/camera/image_raw/compressed", "sensor_msgs/CompressedImage", COMPRESSED]
        packed = [(t, at, Image(data).jpeg() if t == k else data) for t, at, data in messages]
        self.write("jpeg.bag", bags_test.bag(other, packed))
        self.write("one.mcap", mcap(other, packed))
        self.compare(self.import_it("jpeg.bag"), given, 0.05)
        self.compare(self.import_it("one.mcap"), given, 0.05)
        self.assertEqual(self.samples("one.mcap.jsonl"), self.samples("jpeg.bag.jsonl"))
        with open(self.path("two.mcap"), "rb") as file:
            self.write("packed.mcap", with_jpeg(file.read(), jpeg_of))
        self.compare(self.import_it("packed.mcap"), self.import_it("two.mcap"), 0.05)

    def test_a_late_camera(self):
        """Its samples, with the offset applied, are those of a camera that is on time."""
        self.record_arm("a.bag", samples="8")
        self.record_arm("late.bag", "--camera-delay", "0.05", samples="8")
        given = self.import_it("a.bag")
        self.run_it("import", "late.bag", "--rig", "rig.yaml", "--out", "late.jsonl", "--apply-offsets", "--quiet")
        got = self.samples("late.jsonl")
        self.assertEqual(len(got), len(given))
        worst = 0
        for a, b in zip(got, given):
            self.assertLess(abs(a["time"] - b["time"]), 0.02)
            for j, value in b["joints"].items():
                worst = max(worst, abs(a["joints"][j] - value) / b["joint_sigma"][j])
            v, w = a["views"][0], b["views"][0]
            p, q = (dict(zip(x.get("ids", range(len(x["pixels"]))), x["pixels"])) for x in (v, w))
            self.assertGreater(len(set(p) & set(q)), 0.9 * len(q))
            squares = [(p[c][k] - q[c][k]) ** 2 for c in set(p) & set(q) for k in (0, 1)]
            self.assertLess(math.sqrt(sum(squares) / len(squares)), w["sigma"])
        self.assertLess(worst, 1)
        # The rig's first step is about a camera of which nothing was recorded: the clocks are compared all the same.
        rig = self.read("rig.yaml").replace("\nestimate:", "\n  other: {type: camera, link: base, model: pinhole, intrinsics: [500, 500, 320, 240], image_size: [64, 48], sigma: 0.2}\n"
                                            "\nestimate:\n  - {step: first, sensors: [other], free: [sensor/other/pose]}")
        self.write("more.yaml", rig)
        out = self.run_it("import", "late.bag", "--rig", "more.yaml", "--out", "more.jsonl", "--quiet")
        self.assertIn("clocks are compared without the rig's steps: step 'first': no training sample has a view of its sensors", out)
        self.assertRegex(out, r"offset in time of camera: images are stamped (49\.[89]|50\.[01])")

    def test_without_opencv(self):
        """One image of each rest, beside the samples, from which `detect` goes on."""
        bare = os.path.join(os.path.dirname(KINCAL), "tests", "kincal-bags-without-images")
        if not os.path.exists(bare):
            self.skipTest("kincal-bags-without-images is not built")
        self.record_arm("a.bag")
        said = self.run_it("a.bag", "--rig", "rig.yaml", "--out", "bare.jsonl", "--quiet", program=bare)
        self.assertIn("images are in bare.jsonl.images: this program was built without target detection; run `kincal detect` on the samples", said)
        self.assertEqual(len(os.listdir(self.path("bare.jsonl.images"))), 2)
        self.assertTrue(all("pixels" not in v for s in self.samples("bare.jsonl") for v in s["views"]))
        self.run_it("detect", "rig.yaml", "bare.jsonl", "--out", "found.jsonl", "--quiet")
        given, got = self.import_it("a.bag"), self.samples("found.jsonl")
        self.assertEqual(len(got), 2)
        for a, b in zip(got, given):
            for j, value in b["joints"].items():
                self.assertLess(abs(a["joints"][j] - value), 3 * b["joint_sigma"][j])
            p, q = (dict(zip(x["views"][0].get("ids", range(len(x["views"][0]["pixels"]))), x["views"][0]["pixels"])) for x in (a, b))
            self.assertGreater(len(set(p) & set(q)), 0.8 * len(q))
            self.assertLess(max(abs(p[c][k] - q[c][k]) for c in set(p) & set(q) for k in (0, 1)), 0.2)

    def test_clouds(self):
        """A reflector before a lidar at rest in two postures."""
        self.write("arm.urdf", bags_test.URDF)
        self.write("rig.yaml", """format: kincal/1
robot: arm.urdf
base: base
targets:
  reflector: {type: points, points: [[0, 0, 0]], mount: {link: tool}}
sensors:
  lidar: {type: point, link: base, topic: /points, sigma: 0.005}
""")
        random.seed(3)
        topics, messages = [["/joint_states", "sensor_msgs/JointState", STATE], ["/points", "sensor_msgs/PointCloud2", CLOUD]], []
        places = {0: (0.2, 2.0, 0.3), 1: (-0.4, 2.4, -0.2)}   # j1 and where the reflector is
        for i in range(500):
            t, k = 1700000000 + 0.01 * i, int(i >= 250)
            moving = max(0, min(1, (i - 220) / 60))
            q = places[0][0] + moving * (places[1][0] - places[0][0])
            messages.append((0, t, bags_test.state({"j1": q + random.gauss(0, 1e-5), "j2": random.gauss(0, 1e-5), "tilt": 0.0}, t)))
            if i % 20 or 200 < i < 300:
                continue
            points = []
            x0, y0 = places[k][1], places[k][2]
            for _ in range(20000):
                yaw, pitch = random.uniform(-0.3, 0.3), random.uniform(-0.2, 0.2)
                near = math.hypot(x0 * yaw - y0, x0 * pitch) < 0.05
                r = (x0 if near else 4) * math.sqrt(1 + yaw * yaw + pitch * pitch) + random.gauss(0, 0.004)
                d = r / math.sqrt(1 + yaw * yaw + pitch * pitch)
                points.append(struct.pack("<ffff", d, d * yaw, d * pitch, random.gauss(900 if near else 100, 10)))
            field = lambda name, at: bags_test.text(name) + struct.pack("<IBI", at, 7, 1)
            data = b"".join(points)
            messages.append((1, t, bags_test.header(t) + struct.pack("<II", 1, len(points)) + bags_test.array([field("x", 0), field("y", 4), field("z", 8), field("intensity", 12)])
                             + struct.pack("<BIII", 0, 16, len(data), len(data)) + data + b"\1"))
        self.write("a.bag", bags_test.bag(topics, messages))
        got = self.import_it("a.bag")
        self.assertEqual(len(got), 2)
        for sample, (q, x, y) in zip(got, places.values()):
            self.assertAlmostEqual(sample["joints"]["j1"], q, delta=1e-4)
            view = sample["views"][0]
            self.assertEqual((view["sensor"], view["target"]), ("lidar", "reflector"))
            for found, true in zip(view["points"][0], (x, y, 0)):
                self.assertLess(abs(found - true), 0.005)


class Clocks(Recorded):
    def setUp(self):
        super().setUp()
        spec = importlib.util.spec_from_file_location("clocks", os.path.join(SOURCE_DIR, "benchmarks", "clocks.py"))
        self.module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self.module)

    def test_apart(self):
        """Computers without a common clock: the whole table is in benchmarks/clocks.py."""
        self.module.simulate(KINCAL, self.dir, 1, 10)
        for apart, rewritten in helpers.some(((0.4, True), (300, False), (1.3, True), (-5, False), (37, True)), 2):
            self.module.with_clock(self.path("a.bag"), self.path("moved.bag"), apart, rewritten, 1)
            came, about = self.module.judged(KINCAL, self.dir, self.path("moved.bag"), apart)
            self.assertEqual(came, "found", (apart, rewritten, about))

    def test_a_table_of_readings(self):
        """Joints in a CSV beside a bag of images give the samples of the bag that has both."""
        self.record_arm("a.bag")
        given = self.import_it("a.bag")
        topics, messages = read_bag(self.path("a.bag"))
        k = [t[0] for t in topics].index("/joint_states")
        rows, names = [], []
        for t, at, data in messages:
            if t != k:
                continue
            count, place = struct.unpack_from("<I", data, 12 + 4 + struct.unpack_from("<I", data, 12)[0])[0], 12 + 4 + struct.unpack_from("<I", data, 12)[0] + 4
            names = []
            for _ in range(count):
                n = struct.unpack_from("<I", data, place)[0]
                names.append(data[place + 4:place + 4 + n].decode())
                place += 4 + n
            rows.append("%.9f" % at + "".join(",%r" % v for v in struct.unpack_from("<%dd" % count, data, place + 4)))
        self.write("joints.csv", "\n".join([",".join(["time", *names])] + rows) + "\n")
        self.write("images.bag", bags_test.bag(topics, [m for m in messages if m[0] != k]))
        self.assertIn("joints: joints.csv (6 of the robot)", self.run_it("import", "images.bag", "joints.csv", "--list", "--rig", "rig.yaml"))
        got = self.import_it("images.bag", "joints.csv")
        self.assertEqual(len(got), len(given))
        for a, b in zip(got, given):
            self.assertEqual(a["views"], b["views"])
            self.assertAlmostEqual(a["time"], b["time"], delta=1e-4)
            for j, value in b["joints"].items():
                self.assertAlmostEqual(a["joints"][j], value, delta=0.1 * b["joint_sigma"][j])   # its times are rounded


class Sweeps(Recorded):
    def test_to_the_truth(self):
        """Two rests with a sweep up and one down in each: the laser's mount within its covariance."""
        self.write("arm.urdf", bags_test.URDF)
        self.write("rig.yaml", """format: kincal/1
robot: arm.urdf
base: base
targets:
  board: {type: chessboard, rows: 6, columns: 7, square: 0.108, mount: {link: base, pose: {xyz: [2.8, 0.32, 1.27], quat: [-0.5, 0.5, -0.5, 0.5]}}}
sensors:
  laser: {type: tilting_laser, link: head, joint: tilt, pose: {xyz: [0.03, 0, 0]}, sigma: {joint: 0.0001, bearing: 0.0001, range: 0.008}}
estimate:
  - {step: all, free: [sensor/laser/pose]}
""")
        true = [0.01, -0.008, 0.012, 0.006, -0.009, 0.008]
        self.write("truth_values.json", json.dumps({"parameters": {"sensor/laser/pose": true}}))
        self.write("postures.jsonl", "".join(json.dumps({"id": "p%d" % k, "joints": {"j1": 0.3 * k, "j2": 0.2, "tilt": 0.0}, "views": [{"sensor": "laser", "target": "board"}]}) + "\n"
                                             for k in range(2)))
        self.run_it("simulate", "rig.yaml", "--samples", "2", "--seed", "3", "--truth", "truth_values.json", "--postures", "postures.jsonl", "--out", "sim", "--bag", "a.bag",
                    "--sweeps", "4", "--rest", "9", "--move", "0.6", "--quiet")
        got = self.import_it("a.bag")
        self.assertEqual(sum(len(s["views"]) for s in got), 4)   # nothing here hangs on j1, so it may be one rest
        self.run_it("calibrate", "rig.yaml", "a.bag.jsonl", "--out", "result", "--quiet")
        module = recordings_test.benchmark()
        errors, numbers = module.nees(self.dir, json.loads(self.read("result", "result.json")))
        self.assertEqual(numbers, 6)
        self.assertLess(errors, 22.5)   # of chi2 with 6 numbers in 99.9 %


class Killed(Recorded):
    def test_images(self):
        """The old samples or the new ones, whole, and the next run is not in its way."""
        self.record_arm("a.bag")
        command = [KINCAL, "import", "a.bag", "--rig", "rig.yaml", "--out", "samples.jsonl", "--force", "--quiet"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": self.dir}
        start = time.monotonic()
        subprocess.run(command, check=True, **quiet)
        took, new, seen = time.monotonic() - start, self.read("samples.jsonl"), []
        random.seed(7)
        for _ in range(int(os.environ.get("KINCAL_KILLS", "10" if helpers.SLOW else "4"))):
            self.write("samples.jsonl", "old\n")
            p = subprocess.Popen(command, **quiet)
            time.sleep(random.uniform(0, 1.2 * took))
            p.kill()
            p.wait()
            self.assertIn(self.read("samples.jsonl"), ("old\n", new))
            seen.append(self.read("samples.jsonl") == new)
        print("killed %d times: %d old, %d new" % (len(seen), seen.count(False), seen.count(True)))
        subprocess.run(command, check=True, **quiet)
        self.assertEqual([name for name in os.listdir(self.dir) if "writing" in name or "replaced" in name], [])


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    recordings_test.SOURCE_DIR, recordings_test.KINCAL = SOURCE_DIR, KINCAL
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
