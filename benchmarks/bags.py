#!/usr/bin/env python3
"""Speed and memory of the readers of recordings: python3 benchmarks/bags.py [--kincal build/release/kincal] [--size MB] [--only WORD]

Makes a bag of each container and compression in a temporary folder (--size of messages each, 400 MB by default): grey images of
640 x 480, half dark and half with noise, and joint states between them, in chunks of 768 kB as rosbag writes them. Then, from the page cache, thrice in turns: `cat`, the library that unpacks,
by itself on the same chunks, and `kincal import --list`, which reads every message. Prints seconds of CPU (user and system, the best of
three), MB of messages a second of CPU, and kincal's peak memory. The chunks are 16 different ones again and again, so that writing is
quick; nothing that is measured knows. Needs numpy, liblz4 and libzstd as kincal-bags does, and Debian's package time.
"""
import argparse
import bz2
import ctypes
import os
import shutil
import sqlite3
import struct
import subprocess
import tempfile
import time
import zlib

import numpy

CHUNK, START = 768 * 1024, 1700000000
LZ4, ZSTD = ctypes.CDLL("liblz4.so.1"), ctypes.CDLL("libzstd.so.1")
for function in (LZ4.LZ4F_compressFrameBound, LZ4.LZ4F_compressFrame, LZ4.LZ4F_decompress, ZSTD.ZSTD_compressBound, ZSTD.ZSTD_compress, ZSTD.ZSTD_decompress):
    function.restype = ctypes.c_size_t
JOINT_STATE = "Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
IMAGE = "Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n"
TOPICS = [("/joint_states", "sensor_msgs/JointState", JOINT_STATE), ("/eye/image_raw", "sensor_msgs/Image", IMAGE)]


def pack(how, data):
    if how == "bz2":
        return bz2.compress(data)
    if how == "lz4":
        out = ctypes.create_string_buffer(LZ4.LZ4F_compressFrameBound(ctypes.c_size_t(len(data)), None))
        count = LZ4.LZ4F_compressFrame(out, ctypes.c_size_t(len(out)), data, ctypes.c_size_t(len(data)), None)
        return out.raw[:count]
    if how == "zstd":
        out = ctypes.create_string_buffer(ZSTD.ZSTD_compressBound(ctypes.c_size_t(len(data))))
        count = ZSTD.ZSTD_compress(out, ctypes.c_size_t(len(out)), data, ctypes.c_size_t(len(data)), 3)
        return out.raw[:count]
    return data


def unpack_all(how, parts, size, times):
    """Seconds of CPU in which the library unpacks the parts, each of them so many times."""
    out = ctypes.create_string_buffer(size + 1)
    context = ctypes.c_void_p()
    if how == "lz4":
        LZ4.LZ4F_createDecompressionContext(ctypes.byref(context), 100)
    start = time.process_time()
    for _ in range(times):
        for part in parts:
            if how == "bz2":
                bz2.decompress(part)
            elif how == "zstd":
                ZSTD.ZSTD_decompress(out, ctypes.c_size_t(len(out)), part, ctypes.c_size_t(len(part)))
            else:
                at, left = 0, 1
                while left:
                    room, used = ctypes.c_size_t(size + 1), ctypes.c_size_t(len(part) - at)
                    left = LZ4.LZ4F_decompress(context, out, ctypes.byref(room), part[at:], ctypes.byref(used), None)
                    at += used.value
                    assert left < 1 << 32 and used.value > 0, "lz4"
    return time.process_time() - start


def messages(cdr):
    """16 chunks of messages (topic, time in ns, bytes), each about as large as a chunk of rosbag."""
    random = numpy.random.default_rng(3)
    smooth = 100 + 60 * numpy.sin(numpy.arange(640) / 40)[None, :] * numpy.cos(numpy.arange(480) / 30)[:, None]
    def text(t):
        t += "\0" if cdr else ""
        return struct.pack("<I", len(t)) + t.encode()
    def header(k):
        return (b"\0\1\0\0" if cdr else struct.pack("<I", k)) + struct.pack("<II", START + k // 30, k % 30 * 33000000)
    out = []
    for c in range(16):
        chunk, k = [], 0
        while sum(len(m[2]) for m in chunk) < CHUNK:
            pixels = smooth + random.normal(0, 2, smooth.shape)
            pixels[:240] = 16
            pixels = pixels.astype(numpy.uint8).tobytes()
            for _ in range(3):
                chunk.append((0, (START + c) * 10**9 + k * 10**7, header(k) + random.bytes(150)))   # listed, not decoded
                k += 1
            chunk.append((1, (START + c) * 10**9 + k * 10**7, header(k) + text("eye") + random.bytes(20) + pixels))
        out.append(chunk)
    return out


def field(name, value):
    return struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" + value


def record(header, data):
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def ros1(path, how, size):
    u32 = lambda n: struct.pack("<I", n)
    connections = b"".join(record(field("conn", u32(i)) + field("op", b"\7") + field("topic", name.encode()),
                                  field("topic", name.encode()) + field("type", kind.encode()) + field("md5sum", b"*") + field("message_definition", text.encode()))
                           for i, (name, kind, text) in enumerate(TOPICS))
    raw = [connections + b"".join(record(field("conn", u32(t)) + field("op", b"\2") + field("time", struct.pack("<II", *divmod(ns, 10**9))), data) for t, ns, data in chunk)
           for chunk in messages(False)]
    parts = [pack(how, r) for r in raw]
    times = max(1, int(size * 1e6 / sum(map(len, raw))))
    with open(path, "wb") as file:
        def head(index):
            header = field("op", b"\3") + field("index_pos", struct.pack("<Q", index)) + field("conn_count", u32(2)) + field("chunk_count", u32(16 * times))
            return record(header, b" " * (4096 - 8 - len(header)))
        file.write(b"#ROSBAG V2.0\n" + head(0))
        for _ in range(times):
            for r, part in zip(raw, parts):
                file.write(record(field("compression", how.encode()) + field("op", b"\5") + field("size", u32(len(r))), part))
        index = file.tell()
        file.write(connections)
        file.seek(13)
        file.write(head(index))
    return raw, parts, times


def mcap(path, how, size):
    text = lambda t: struct.pack("<I", len(t)) + t
    item = lambda kind, data: bytes([kind]) + struct.pack("<Q", len(data)) + data
    channels = b"".join(item(3, struct.pack("<H", i + 1) + text(kind.replace("/", "/msg/").encode()) + text(b"ros2msg") + text(definition.encode())) +
                        item(4, struct.pack("<HH", i + 1, i + 1) + text(name.encode()) + text(b"cdr") + text(b"")) for i, (name, kind, definition) in enumerate(TOPICS))
    raw = [channels + b"".join(item(5, struct.pack("<HIQQ", t + 1, 0, ns, ns) + data) for t, ns, data in chunk) for chunk in messages(True)]
    parts = [pack(how, r) for r in raw]
    times = max(1, int(size * 1e6 / sum(map(len, raw))))
    with open(path, "wb") as file:
        file.write(b"\x89MCAP0\r\n" + item(1, text(b"ros2") + text(b"")))
        for _ in range(times):
            for r, part in zip(raw, parts):
                file.write(item(6, struct.pack("<QQQI", 0, 0, len(r), zlib.crc32(r)) + text(b"" if how == "none" else how.encode()) + struct.pack("<Q", len(part)) + part))
        file.write(item(15, bytes(4)) + item(2, bytes(20)) + b"\x89MCAP0\r\n")
    return raw, parts, times


def sqlite(path, how, size):
    """`zstd messages` gets its folder; `zstd file` is packed as a whole."""
    chunks = messages(True)
    raw = [data for chunk in chunks for _, _, data in chunk]
    parts = [pack("zstd", r) for r in raw] if how == "zstd messages" else raw
    times = max(1, int(size * 1e6 / sum(map(len, raw))))
    db = sqlite3.connect(path)
    db.executescript("PRAGMA journal_mode = MEMORY; PRAGMA synchronous = OFF;"
                     "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
                     "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL); CREATE INDEX timestamp_idx ON messages (timestamp ASC);")
    for i, (name, kind, _) in enumerate(TOPICS):
        db.execute("INSERT INTO topics VALUES(?, ?, ?, 'cdr', '')", (i + 1, name, kind.replace("/", "/msg/")))
    heads = [(t + 1, ns) for chunk in chunks for t, ns, _ in chunk]
    for _ in range(times):
        db.executemany("INSERT INTO messages VALUES(NULL, ?, ?, ?)", [head + (part,) for head, part in zip(heads, parts)])
    db.commit()
    db.close()
    if how == "zstd file":
        subprocess.run(["zstd", "-q", "-3", "--rm", path, "-o", path + ".zstd"], check=True)
    return raw, parts, times


def cost(*command):
    """Seconds of CPU, and MB of peak memory, by `time` (memory of our own would be counted as that of a child); with the output."""
    with tempfile.NamedTemporaryFile() as used:
        out = subprocess.run(["/usr/bin/time", "-o", used.name, "-f", "%U %S %M", *command], stdout=subprocess.PIPE, check=True).stdout
        user, system, memory = used.read().split()
    return float(user) + float(system), float(memory) / 1024, out


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--kincal", default="build/release/kincal")
    options.add_argument("--size", type=float, default=400, help="MB of messages")
    options.add_argument("--only", default="", help="containers with this word in their name")
    a = options.parse_args()
    print("| container | file, MB | messages, MB | `cat` of the file, s | library, s | kincal, s | MB/s | peak memory, MB |\n| --- | --- | --- | --- | --- | --- | --- | --- |")
    for kind, write, hows in (("ROS 1", ros1, ("none", "lz4", "bz2")), ("MCAP", mcap, ("none", "lz4", "zstd")), ("SQLite", sqlite, ("none", "zstd messages", "zstd file"))):
        for how in hows:
            name = "%s, %s" % (kind, how)
            if a.only not in name or (how == "zstd file" and not shutil.which("zstd")):
                continue
            with tempfile.TemporaryDirectory(prefix="kincal-bags-") as folder:
                file = os.path.join(folder, {"ROS 1": "a.bag", "MCAP": "a.mcap", "SQLite": "a.db3"}[kind])
                raw, parts, times = write(file, how, a.size / (8 if how == "bz2" else 1))
                bag = file = file + ".zstd" if how == "zstd file" else file
                if how == "zstd messages":
                    with open(os.path.join(folder, "metadata.yaml"), "w") as yaml:
                        yaml.write("rosbag2_bagfile_information:\n  relative_file_paths: [a.db3]\n  compression_mode: MESSAGE\n")
                    bag = folder
                sizes = os.path.getsize(file) / 1e6, sum(map(len, raw)) * times / 1e6
                cats, libraries, runs = [], [], []
                for _ in range(3):
                    cats.append(cost("sh", "-c", "cat '%s' > /dev/null" % file)[0])
                    if how == "zstd file":
                        libraries.append(cost("sh", "-c", "zstd -dcq '%s' > /dev/null" % file)[0])
                    elif how != "none":
                        libraries.append(unpack_all(how.split()[0], parts, max(map(len, raw)), times))
                    runs.append(cost(a.kincal, "import", bag, "--list", "--quiet"))
                    assert b"LOST" not in runs[-1][2], runs[-1][2].decode()
                print("| %s | %.0f | %.0f | %.2f | %s | %.2f | %.0f | %.0f |" % (name, *sizes, min(cats), "%.2f" % min(libraries) if libraries else "", min(r[0] for r in runs),
                                                                              sizes[1] / min(r[0] for r in runs), max(r[1] for r in runs)), flush=True)


if __name__ == "__main__":
    main()
