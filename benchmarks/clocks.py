#!/usr/bin/env python3
"""Cameras and joints on computers without a common clock: python3 benchmarks/clocks.py [KINCAL] [--seeds 10] [--first 1] [--apart 0.4,1.3,5,37,300] [--postures 14]

Simulates an arm with one camera that goes from posture to posture (another path for each seed), moves the stamps of its images by so many seconds (later for odd
seeds, sooner for even ones), and imports the recording: once as one recorder has it (`received`: each message with the time at which it was received, images
20 to 80 ms after they were taken, readings 1 to 3 ms), and once as a bag that was written again (`rewritten`: times of reception are the stamps, so that only the
motion tells). Of each import it prints whether the offset was found within 3 sigmas, refused (with the cause), or WRONG: an offset that is not within 3 sigmas, or
samples that pair an image with readings of another posture without a word. At the end the table. Needs kincal, kincal-render and kincal-bags; no Python packages.
"""
import argparse
import collections
import importlib.util
import json
import os
import random
import re
import struct
import subprocess
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
KINDS = ("received", "rewritten")
SECOND = 10**9


def recordings():
    spec = importlib.util.spec_from_file_location("recordings", os.path.join(HERE, "recordings.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def simulate(kincal, folder, seed, postures, more=()):
    """A recording a.bag of an arm, its rig and its samples sim/samples.jsonl."""
    module = recordings()
    module.arm(folder)
    path = lambda name: os.path.join(folder, name)
    lines = module.read(path("postures.jsonl")).splitlines()
    random.Random(seed).shuffle(lines)
    module.write(path("postures.jsonl"), "\n".join(lines[:postures]) + "\n")
    module.run(kincal, "simulate", path("rig.yaml"), "--samples", str(postures), "--seed", str(seed), "--truth", path("truth_values.json"), "--postures", path("postures.jsonl"),
               "--out", path("sim"), "--bag", path("a.bag"), "--rest", "1.2", "--move", "1", "--frame-rate", "5", "--quiet", *more)


def records(data, at, end):
    """Records of a ROS 1 bag: its fields, and where its header and its data are."""
    while at + 4 <= end:
        size = struct.unpack_from("<I", data, at)[0]
        header, k, fields = at + 4, at + 4, {}
        while k < header + size:
            n = struct.unpack_from("<I", data, k)[0]
            name, value = bytes(data[k + 4:k + 4 + n]).split(b"=", 1)
            fields[name.decode()] = (value, k + 4 + len(name) + 1)
            k += 4 + n
        at = header + size
        size = struct.unpack_from("<I", data, at)[0]
        yield fields, at + 4, at + 4 + size
        at += 4 + size


def with_clock(bag, out, apart, rewritten, seed):
    """The same recording with images that are stamped `apart` s later."""
    with open(bag, "rb") as file:
        data = bytearray(file.read())
    draws, images = random.Random(seed), set()
    for fields, first, end in list(records(data, len(b"#ROSBAG V2.0\n"), len(data))):
        if fields["op"][0] != b"\x05":
            continue
        for one, at, _ in list(records(data, first, end)):
            number = struct.unpack("<I", one["conn"][0])[0]
            if one["op"][0] == b"\x07" and one["topic"][0].startswith(b"/camera/"):
                images.add(number)
            if one["op"][0] != b"\x02":
                continue
            received = one["time"][1]
            seconds, nanoseconds = struct.unpack_from("<II", data, received)
            taken = seconds * SECOND + nanoseconds
            stamp = taken + (round(apart * SECOND) if number in images else 0)
            if struct.unpack_from("<II", data, at + 4) == (seconds, nanoseconds):   # it has a header
                struct.pack_into("<II", data, at + 4, *divmod(stamp, SECOND))
            under_way = draws.uniform(0.02, 0.08) if number in images else draws.uniform(0.001, 0.003)
            struct.pack_into("<II", data, received, *divmod(stamp if rewritten else taken + round(under_way * SECOND), SECOND))
    with open(out, "wb") as file:
        file.write(data)


def wrong_pairs(given, got):
    """How many samples have the image of another posture than their readings'."""
    wrong = 0
    for sample in got:
        true = min(given, key=lambda s: sum((s["joints"][j] - v) ** 2 for j, v in sample["joints"].items()))
        far = max(abs(true["joints"][j] - v) for j, v in sample["joints"].items())
        here, there = (dict(zip(map(str, v.get("ids", range(len(v["pixels"])))), v["pixels"])) for v in (sample["views"][0], true["views"][0]))
        common = set(here) & set(there)
        off = max((abs(here[c][k] - there[c][k]) for c in common for k in (0, 1)), default=1e9)
        wrong += far > 0.01 or off > 2
    return wrong


def judged(kincal, folder, bag, apart, *more):
    """What an import of a bag comes to: kind, and a line about it."""
    out = os.path.join(folder, "got.jsonl")
    if os.path.exists(out):
        os.remove(out)
    p = subprocess.run([kincal, "import", bag, "--rig", os.path.join(folder, "rig.yaml"), "--out", out, "--quiet", *more], stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)
    read = lambda path: [json.loads(line) for line in open(path, encoding="utf-8")]
    samples = read(out) if p.returncode == 0 else []
    wrong = wrong_pairs(read(os.path.join(folder, "sim", "samples.jsonl")), samples)
    found = re.search(r"stamped (-?[\d.]+) \+- ([\d.]+) ms", p.stdout)
    about = "%d samples, %d wrong pairs" % (len(samples), wrong)
    if found:
        error, sigma = float(found[1]) - 1e3 * apart, float(found[2])
        about += ", off by %.2f +- %.2f ms" % (error, sigma)
        return ("found" if abs(error) < 3 * sigma + 0.01 and wrong == 0 and samples else "WRONG"), about
    said = re.search(r"(?:no samples: |offset in time of camera: not known.*?: )(.*)", p.stdout + p.stderr)
    return ("refused" if said and not samples else "not known" if said and wrong == 0 else "WRONG"), about + ": " + (said[1] if said else p.stdout + p.stderr)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("kincal", nargs="?", default=os.path.join(os.path.dirname(HERE), "build", "release", "kincal"))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--apart", default="0.4,1.3,5,37,300")
    parser.add_argument("--postures", type=int, default=14)
    parser.add_argument("--kinds", default=",".join(KINDS))
    a = parser.parse_args()
    apart, kinds, table = [float(d) for d in a.apart.split(",")], a.kinds.split(","), collections.Counter()
    for seed in range(a.first, a.first + a.seeds):
        with tempfile.TemporaryDirectory() as folder:
            simulate(a.kincal, folder, seed, a.postures)
            for seconds in apart:
                for kind in kinds:
                    by, bag = seconds if seed % 2 else -seconds, os.path.join(folder, "moved.bag")
                    with_clock(os.path.join(folder, "a.bag"), bag, by, kind == "rewritten", seed)
                    came, about = judged(a.kincal, folder, bag, by)
                    table[kind, seconds, came] += 1
                    print("seed %d, %g s, %s: %s; %s" % (seed, by, kind, came, about), flush=True)
    ends = ("found", "refused", "not known", "WRONG")
    print("| s apart | " + " | ".join("%s: %s" % (kind, end) for kind in kinds for end in ends) + " |\n|" + " --- |" * (1 + len(kinds) * len(ends)))
    for seconds in apart:
        print("| %g | " % seconds + " | ".join(str(table[kind, seconds, end]) for kind in kinds for end in ends) + " |")


if __name__ == "__main__":
    main()
