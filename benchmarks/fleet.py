#!/usr/bin/env python3
"""Are false alarms of `kincal fleet` as rare as it says, and how much does it find? Simulated robots through the program.

    benchmarks/fleet.py                          # 1,000 healthy robots; 50 robots for each planted offset; robots over months
    benchmarks/fleet.py --robots 100 --planted 10 --months 0  # a quick one

Every robot is the arm of examples/arm: 16 pictures' worth of corners, calibrated without steps by `kincal batch`. Tolerances (normal): four joint
offsets 2 mrad, the camera's place 1 mm and 2 mrad, the board's 5 mm and 10 mrad. Planted: the offset of joint `bend` off by so many of its
tolerances, in robots of their own beside the healthy ones. Over months: one robot a dozen times, the board put up anew each time; planted is
a line, or a step in the middle, of `bend`, in sigmas of its slope or step (as drift.csv has it).

Prints how many are called out of family at levels of 5, 1 and 0.1 %, with the interval that holds the right number 95 times in 100, and the
share of planted ones that are found. Works in a folder of its own; --keep keeps it. Only Python's own library is needed.
"""
import argparse
import csv
import json
import math
import os
import random
import shutil
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
ARM = os.path.join(ROOT, "examples", "arm")
JOINTS = ["lift", "bend", "forearm_roll", "wrist_bend"]
OFFSET, CAMERA, BOARD = 0.002, (0.001, 0.002), (0.005, 0.01)
LEVELS = (0.05, 0.01, 0.001)


def interval(count, level):
    """The numbers of alarms that a binomial draw gives 95 times in 100."""
    p, low, high, total = (1 - level) ** count, None, None, 0.0
    for k in range(count + 1):
        total += p
        if low is None and total > 0.025:
            low = k
        if total >= 0.975:
            high = k
            break
        p *= (count - k) / (k + 1) * level / (1 - level)
    return low, high


class Bench:
    def __init__(self, kincal, folder):
        self.kincal, self.folder = kincal, folder
        self.sets = []

    def run(self, *args, codes=(0,)):
        done = subprocess.run([self.kincal, *args], cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode not in codes:
            sys.exit("%s\nexit %d: kincal %s" % (done.stdout, done.returncode, " ".join(args)))
        return done.stdout

    def first(self):
        """The arm with its camera and board where the first calibration finds them: what all robots are made like."""
        self.run("simulate", os.path.join(ARM, "rig.yaml"), "--samples", "16", "--seed", "1", "--truth", os.path.join(ARM, "truth.json"),
                 "--postures", os.path.join(ARM, "postures.jsonl"), "--out", "first", "--quiet")
        self.run("calibrate", os.path.join(ARM, "rig.yaml"), "first/samples.jsonl", "--out", "drawn", "--quiet", "--no-report")
        with open(os.path.join(ARM, "rig.yaml")) as f:
            self.rig = f.read().replace("robot: robot.urdf", "robot: " + os.path.join(ARM, "robot.urdf"))

    def robot(self, name, seed, truth, serial=None, time=None):
        """Records a robot whose numbers are off by `truth` (of drawn/rig.yaml)."""
        with open(os.path.join(self.folder, "truth.json"), "w") as f:
            json.dump({"parameters": truth}, f)
        self.run("simulate", "drawn/rig.yaml", "--samples", "16", "--seed", str(seed), "--truth", "truth.json", "--postures",
                 os.path.join(ARM, "postures.jsonl"), "--out", "sets/" + name, "--quiet")
        head = ("serial: %s\n" % serial if serial else "") + ("time: %s\n" % time if time else "")
        with open(os.path.join(self.folder, "sets", name, "rig.yaml"), "w") as f:
            f.write(self.rig.replace("format: kincal/1\n", "format: kincal/1\n" + head))

    def fleet(self, out, folders, level):
        self.run("fleet", *folders, "--out", out, "--force", "--quiet", "--level", str(level), codes=(0, 4))
        with open(os.path.join(self.folder, out, "robots.csv"), newline="") as f:
            return list(csv.DictReader(f))


def pose(draw, size):
    return [draw.gauss(0, size[0]) for _ in range(3)] + [draw.gauss(0, size[1]) for _ in range(3)]


def truth_of(draw, bend=0.0):
    truth = {"joint/%s/offset" % j: draw.gauss(0, OFFSET) for j in JOINTS}
    truth["joint/bend/offset"] += bend
    truth["sensor/camera/pose"] = pose(draw, CAMERA)
    truth["target/board/pose"] = pose(draw, BOARD)
    return truth


def family(bench, args):
    draw = random.Random(args.seed)
    planted = {s: args.planted for s in (1, 2, 3, 5, 8)}
    names = []
    for i in range(args.robots):
        names.append("healthy%04d" % i)
        bench.robot(names[-1], i + 10, truth_of(draw))
    for sigmas, count in planted.items():
        for i in range(count):
            names.append("off%d_%04d" % (sigmas, i))
            bench.robot(names[-1], 100000 * sigmas + i, truth_of(draw, sigmas * OFFSET))
    bench.run("batch", "sets", "--out", "results", "--quiet", "--no-report", "--jobs", str(args.jobs), codes=(0, 1))
    folders = [os.path.join("results", n) for n in names if os.path.exists(os.path.join(bench.folder, "results", n))]
    healthy = [f for f in folders if "healthy" in f]
    rows = bench.fleet("out", healthy, 0.01)
    print("%d healthy robots, %s equations each" % (len(rows), " to ".join(sorted({r["equations"] for r in rows}))))
    for level in LEVELS:
        found = sum(float(r["family_p"]) < level for r in rows)
        print("  level %g: %d out of family (95 %%: %d to %d)" % ((level, found) + interval(len(rows), level)))
    for sigmas, count in planted.items():
        # Planted ones come a few at a time among some healthy ones, so that the fleet is healthy but for them.
        own = [f for f in folders if "off%d_" % sigmas in f]
        found = {level: 0 for level in LEVELS}
        some = healthy[:200]
        named, together = 0, max(1, len(some) // 20)
        for k in range(0, len(own), together):
            for r in bench.fleet("out", some + own[k:k + together], 0.01):
                if r["serial"].startswith("off"):
                    for level in LEVELS:
                        found[level] += float(r["family_p"]) < level
                    named += r["out_of_family"] == "yes" and r["number"] == "joint/bend/offset"
        print("  bend off by %d tolerances: found %s; named right %.0f %%" % (
            sigmas, ", ".join("%.0f %% (level %g)" % (100 * found[level] / len(own), level) for level in LEVELS), 100 * named / len(own)))


def months(bench, args):
    draw = random.Random(args.seed + 1)
    sigma = {}
    for kind in ("none", "line", "step"):
        for sigmas in (0,) if kind == "none" else (1, 2, 3, 5, 8):
            robots = args.months if sigmas else 2 * args.months
            shutil.rmtree(os.path.join(bench.folder, "sets"), ignore_errors=True)
            os.makedirs(os.path.join(bench.folder, "sets"))
            for i in range(robots):
                own = truth_of(draw)
                for t in range(12):
                    truth = dict(own)
                    truth["target/board/pose"] = pose(draw, BOARD)
                    f = t / 12 if kind == "line" else float(t >= 6)
                    truth["joint/bend/offset"] = own["joint/bend/offset"] + (sigmas * sigma[kind] * f if sigmas else 0)
                    bench.robot("r%02d_%02d" % (i, t), 1000 * i + t + 7, truth, "r%02d" % i, "2025-%02d-01" % (t + 1))
            out = "months_%s_%d" % (kind, sigmas)
            bench.run("batch", "sets", "--out", out, "--quiet", "--no-report", "--jobs", str(args.jobs), codes=(0, 1))
            rows = bench.fleet("out", [out], 0.01)
            found = sum(r["drifts"] == "yes" for r in rows)
            if not sigmas:
                with open(os.path.join(bench.folder, "out", "drift.csv"), newline="") as f:
                    own = [r for r in csv.DictReader(f) if r["number"] == "joint/bend/offset"]
                sigma["line"] = sum(float(r["per_year_sigma"]) for r in own) / len(own)
                sigma["step"] = sigma["line"] / math.sqrt(3)  # f has this much more scatter; near enough
                print("12 months, nothing moves: %d of %d robots drift (level 0.01); sigma of a line %.2g mrad a year" % (
                    found, len(rows), 1e3 * sigma["line"]))
            else:
                print("  %s of %d sigmas: found %d of %d" % (kind, sigmas, found, len(rows)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kincal", default=os.path.join(ROOT, "build", "release", "kincal"))
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--planted", type=int, default=50, help="robots for each planted offset")
    parser.add_argument("--months", type=int, default=10, help="robots for each drift; 0: none")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--keep", help="a new folder for all files")
    args = parser.parse_args()
    folder = args.keep or tempfile.mkdtemp(prefix="kincal-fleet-")
    os.makedirs(os.path.join(folder, "sets"))
    try:
        bench = Bench(os.path.abspath(args.kincal), folder)
        bench.first()
        family(bench, args)
        if args.months:
            months(bench, args)
    finally:
        if not args.keep:
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
