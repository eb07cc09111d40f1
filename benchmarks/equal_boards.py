#!/usr/bin/env python3
"""Two boards of one print, from pictures to the robot: are they told apart, and are the sigmas honest?

    benchmarks/equal_boards.py                     # 20 robots of each kind
    benchmarks/equal_boards.py --robots 3 --keep build/equal

Kinds: a chessboard in each hand of a robot with two arms, before a camera in the middle (hands); the same with ChArUco boards of equal ids; two ChArUco boards on a table, seen by a
camera on the arm (table). Robots are wrong by random offsets (10 mrad) and mounts (5 mm, 5 mrad) and take 24 pictures (`simulate --render`: a lens, blur, noise); `detect --sigma` is given
pictures and joint readings alone, `calibrate` frees what is wrong. Printed are views found, of these the ones given to the wrong target (their corners are where the simulation has the
other one), chi2/dof and NEES/dof with the 99 % intervals that honest ones would keep. It needs NumPy and SciPy.
"""
import argparse
import collections
import csv
import json
import os
import random
import shutil
import tempfile

import numpy
from scipy.stats import chi2

import images
from images import ARM, ARM_JOINTS, CAMERA, HAND, LENS, ROOT, WIDE, run

KINDS = ("hands, chessboard", "hands, charuco", "table, charuco")
PRINTS = {"hands, chessboard": "type: chessboard, rows: 5, columns: 7, square: 0.024", "hands, charuco": "type: charuco, rows: 5, columns: 6, square: 0.04, marker: 0.03, dictionary: DICT_4X4_50",
          "table, charuco": "type: charuco, rows: 5, columns: 6, square: 0.03, marker: 0.0225, dictionary: DICT_4X4_50"}
IN_HAND = "0.06, -0.059, -0.035", "0, -1.5708, 0"
ON_TABLE = {"near": ("0.34, 0.04, 0.02", "3.1296, 0.008, 0.35"), "far": ("0.5, 0.3, 0.03", "3.13, -0.01, 0.2")}
SIDES = {"left": 0.3, "right": -0.3}   # m, y of the arms' bases


def rig(kind, sigma):
    print_ = PRINTS[kind]
    board = "  %s: {" + print_ + ", mount: {link: %s, pose: {xyz: [%s], rpy: [%s]}}}\n"
    text = 'format: kincal/1\nrobot: robot.urdf\nbase: base\njoints: {"*": {sigma: 0.0003}}\ntargets:\n'
    freed = ["sensor/eye/pose", "target/*/pose"]
    if kind.startswith("hands"):
        text += "".join(board % (side, side + "_flange", *IN_HAND) for side in SIDES) + "sensors:\n" + CAMERA % ("eye", "base", WIDE, sigma, "0.47, 0.06, -0.12", "0, 0, 0.4")
        freed += ["joint/%s_%s/offset" % (side, name) for side in SIDES for name in ARM_JOINTS]
    else:
        text += "".join(board % (name, "base", *place) for name, place in ON_TABLE.items()) + "sensors:\n" + CAMERA % ("eye", "flange", LENS, sigma, *HAND)
        freed += ["joint/%s/offset" % name for name in ARM_JOINTS]
    return text + "estimate:\n  - {step: all, free: [%s]}\n" % ", ".join(freed)


def write_robot(folder, kind, seed):
    """URDF and postures; returns what has to be spread."""
    draws = random.Random(seed)
    with open(os.path.join(ARM, "robot.urdf")) as f:
        urdf = f.read()
    with open(os.path.join(ARM, "postures.jsonl")) as f:
        known = [json.loads(line)["joints"] for line in f]
    names = list(known[0])
    prefixes = [""]
    if kind.startswith("hands"):
        links = urdf[urdf.index("  <link"):urdf.index("</robot>")]
        prefixes = [side + "_" for side in SIDES]
        urdf = '<robot name="two">\n  <link name="base"/>\n'
        for side, y in SIDES.items():
            urdf += links.replace('name="', 'name="%s_' % side).replace('link="', 'link="%s_' % side)
            urdf += '  <joint name="%s_foot" type="fixed"><parent link="base"/><child link="%s_base"/><origin xyz="0 %g 0"/></joint>\n' % (side, side, y)
        urdf += "</robot>\n"
    with open(os.path.join(folder, "robot.urdf"), "w") as out:
        out.write(urdf)
    with open(os.path.join(folder, "postures.jsonl"), "w") as out:
        for k in range(24):
            joints = {}
            for prefix in prefixes:
                posture = draws.choice(known)
                joints.update({prefix + name: posture[name] + draws.gauss(0, 0.06) for name in names})
            out.write(json.dumps({"id": "p%02d" % k, "joints": joints}) + "\n")
    spread = ["--spread", "sensor/*/pose=0.005", "--spread", "target/*/pose=0.005"]
    return spread + [word for prefix in prefixes for name in ARM_JOINTS for word in ("--spread", "joint/%s%s/offset=0.01" % (prefix, name))]


def views_of(path):
    with open(path) as f:
        for line in f:
            sample = json.loads(line)
            for v in sample["views"]:
                yield (sample["id"], v["target"]), dict(zip(v.get("ids") or range(len(v["pixels"])), v["pixels"]))


def wrong_views(folder):
    """Views that were found, and those whose corners are where the simulation has another target's. (It has only boards that are seen whole.)"""
    true = dict(views_of(os.path.join(folder, "exact", "samples.jsonl")))
    found = wrong = 0
    for key, pixels in views_of(os.path.join(folder, "found.jsonl")):
        found += 1
        for other, there in true.items():
            both = [i for i in pixels if i in there]
            if other[0] == key[0] and other[1] != key[1] and both:
                middles = [numpy.mean([p[i] for i in both], axis=0) for p in (pixels, there)]
                wrong += numpy.linalg.norm(middles[0] - middles[1]) < 5
    return found, wrong


def try_robot(folder, kind, seed):
    spread = write_robot(folder, kind, seed)
    common = ["--samples", "24", "--seed", str(seed), "--postures", "postures.jsonl"]
    for name, px in (("rig.yaml", 0.2), ("exact.yaml", 1e-9)):
        with open(os.path.join(folder, name), "w") as f:
            f.write(rig(kind, px))
    run(folder, "simulate", "rig.yaml", *common, *spread, "--out", "sim", "--render", "sim/images", "--blur", "0.8", "--image-noise", "2")
    run(folder, "simulate", "exact.yaml", *common, *spread, "--out", "exact")
    run(folder, "detect", "rig.yaml", "sim/images", "--joints", "sim/joints.csv", "--out", "found.jsonl", "--sigma")
    run(folder, "calibrate", "rig.yaml", "found.jsonl", "--out", "result", "--no-report")
    return (*images.judge_result(folder), *wrong_views(folder))


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--robots", type=int, default=20)
    options.add_argument("--first", type=int, default=0, help="the first seed")
    options.add_argument("--kinds", nargs="*", default=KINDS)
    options.add_argument("--keep", help="a folder for all files")
    options.add_argument("--kincal", default=os.path.join(ROOT, "build", "release", "kincal"))
    a = options.parse_args()
    images.KINCAL = os.path.abspath(a.kincal)
    sums = collections.defaultdict(lambda: numpy.zeros(7))
    for kind in a.kinds:
        for seed in range(a.first, a.first + a.robots):
            folder = os.path.join(a.keep, kind.replace(", ", "-"), str(seed)) if a.keep else tempfile.mkdtemp()
            os.makedirs(folder, exist_ok=True)
            try:
                chi, dof, nees, n, found, wrong = try_robot(folder, kind, seed)
            except RuntimeError as error:
                print(seed, kind, error, flush=True)
                continue
            print("%d %s: %d views, %d wrong, chi2/dof %.3f (%d), NEES/dof %.2f (%d)" % (seed, kind, found, wrong, chi / dof, dof, nees / n, n), flush=True)
            sums[kind] += (1, chi, dof, nees, n, found, wrong)
            if not a.keep:
                shutil.rmtree(folder)
    print("\n| equal boards | robots | views | wrong | chi2/dof | 99 % | NEES/dof | 99 % |\n| --- | --- | --- | --- | --- | --- | --- | --- |")
    for kind, (count, chi, dof, nees, n, found, wrong) in sums.items():
        low, high = (numpy.array(chi2.ppf(p, [dof, n])) / [dof, n] for p in (0.005, 0.995))
        print("| %s | %d | %d | %d | %.3f | %.3f to %.3f | %.2f | %.2f to %.2f |" % (kind, count, found, wrong, chi / dof, low[0], high[0], nees / n, low[1], high[1]))


if __name__ == "__main__":
    main()
