#!/usr/bin/env python3
"""From pictures to numbers: are the sigmas honest when pixels come from pictures?

    benchmarks/images.py                     # 30 robots: a camera in the hand (joints; poses of the flange), one in the room, a stereo pair on a head
    benchmarks/images.py --robots 6 --keep build/images

Robots like examples/arm, wrong by random offsets (10 mrad) and mounts (5 mm, 5 mrad), take 16 pictures of a ChArUco board (`simulate --render`:
a lens, blur, noise); `detect --sigma` finds it and says how well, `calibrate` frees what is wrong. Of some only the poses of the flange are known (0.1 mm, 0.2 mrad), not the joints.
Printed are chi2/dof and NEES/dof (squared errors against the truth by the covariance, mean over all numbers), with the 99 % intervals that honest ones would keep; and the
error of a corner in the pictures beside its true place (rms of a coordinate, and in sigmas of its view). It needs NumPy and SciPy.
"""
import argparse
import collections
import csv
import json
import os
import random
import shutil
import subprocess
import tempfile

import numpy
from scipy.stats import chi2

from hand_eye import make_robot

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
ARM = os.path.join(ROOT, "examples", "arm")
HEAD = """  <link name="neck"/><link name="head"/>
  <joint name="pan" type="revolute"><parent link="base"/><child link="neck"/><origin xyz="0.47 0.13 0"/><axis xyz="0 0 1"/>
    <limit lower="-0.5" upper="0.5" effort="1" velocity="1"/></joint>
  <joint name="tilt" type="revolute"><parent link="neck"/><child link="head"/><axis xyz="0 1 0"/>
    <limit lower="-0.5" upper="0.5" effort="1" velocity="1"/></joint>
"""
BOARD = "  board: {type: charuco, rows: 6, columns: 8, square: %s, marker: %s, dictionary: DICT_4X4_50, mount: {link: %s, pose: {xyz: [%s], rpy: [%s]}}}\n"
CAMERA = "  %s: {type: camera, link: %s, %s, image_size: [640, 480], sigma: %s, pose: {xyz: [%s], rpy: [%s]}}\n"
LENS = "model: brown_conrady, intrinsics: [600, 601, 318.6, 242.3], distortion: [-0.14, 0.04, 0.0003, -0.0006, 0]"
WIDE = "model: brown_conrady, intrinsics: [330, 331, 318.6, 242.3], distortion: [-0.1, 0.02, 0.0003, -0.0006, 0]"
HAND = ("0.052, 0.013, 0.061", "-1.5308, 0, -1.5708")
KINDS = ("hand", "flange", "room", "stereo")
ARM_JOINTS = ["lift", "bend", "forearm_roll", "wrist_bend"]   # the others are as the mounts


def rig(kind, sigma, flange=None):
    """`flange`: the poses of camera and board where no joints are known."""
    text = 'format: kincal/1\nrobot: robot.urdf\nbase: base\njoints: {"*": {sigma: 0.0003}}\ntargets:\n'
    freed = ["sensor/*/pose", "target/board/pose"] + ["joint/%s/offset" % j for j in ARM_JOINTS]
    if kind == "flange":
        text = text.replace("robot.urdf\nbase: base", "{base: base, flange: tool0}").replace("0.0003", "{translation: 0.0001, rotation: 0.0002}").replace('"*"', "flange")
        camera, board = ([", ".join("%.6f" % x for x in part) for part in (pose.t, pose.r.as_euler("xyz"))] for pose in flange)
        text += BOARD % (0.03, 0.0225, "base", *board) + "sensors:\n" + CAMERA % ("eye", "tool0", LENS, sigma, *camera)
        freed = freed[:2]
    elif kind == "hand":
        text += BOARD % (0.03, 0.0225, "base", "0.47, 0.13, 0.02", "3.1296, 0.008, 0.35") + "sensors:\n" + CAMERA % ("eye", "flange", LENS, sigma, *HAND)
    else:   # the board in the hand where the camera was, cameras on the table, looking up
        text += BOARD % (0.024, 0.018, "flange", "0.06, -0.059, -0.035", "0, -1.5708, 0") + "sensors:\n"
        if kind == "room":
            text += CAMERA % ("eye", "base", WIDE, sigma, "0.47, 0.13, 0.02", "0, 0, 0.4")
        else:
            text += CAMERA % ("left", "head", WIDE, sigma, "-0.04, 0, 0.02", "0, 0, 0") + CAMERA % ("right", "head", WIDE, sigma, "0.04, 0, 0.02", "0, 0, 0")
    return text + "estimate:\n  - {step: all, free: [%s]}\n" % ", ".join(freed)


def rms(values):
    return numpy.sqrt((values ** 2).mean())


def run(folder, *arguments):
    done = subprocess.run([KINCAL, *arguments, "--quiet"], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    if done.returncode:
        raise RuntimeError("%s: %s" % (arguments[0], done.stderr.decode() or done.stdout.decode()[-300:]))
    return done.stdout.decode()


def corner_errors(folder):
    """Of all corners that were found: errors of the coordinates, and the same in sigmas of the view."""
    def views(name):
        with open(os.path.join(folder, name)) as f:
            for line in f:
                sample = json.loads(line)
                for v in sample["views"]:
                    yield (sample["id"], v["sensor"]), dict(zip(v.get("ids") or range(len(v["pixels"])), v["pixels"])), v.get("sigma")
    true = {key: pixels for key, pixels, _ in views("exact/samples.jsonl")}
    both = [(numpy.subtract(p, true[key][i]), sigma) for key, found, sigma in views("found.jsonl") for i, p in found.items()]
    return numpy.array([e for e, _ in both]), numpy.array([e / sigma for e, sigma in both])


def write_robot(folder, kind, seed):
    """URDF and postures; returns what has to be spread, and of a flange the nominal poses of camera and board."""
    draws = random.Random(seed)
    spread = ["--spread", "sensor/*/pose=0.005", "--spread", "target/board/pose=0.005"]
    if kind == "flange":
        camera, board, postures = make_robot(numpy.random.default_rng(seed), "hand")
        with open(os.path.join(folder, "postures.jsonl"), "w") as out:
            out.write(postures)
        return spread, (camera, board)
    with open(os.path.join(ARM, "robot.urdf")) as f:
        urdf = f.read()
    with open(os.path.join(folder, "robot.urdf"), "w") as f:
        f.write(urdf.replace("</robot>", HEAD + "</robot>"))
    with open(os.path.join(ARM, "postures.jsonl")) as f, open(os.path.join(folder, "postures.jsonl"), "w") as out:
        for posture in map(json.loads, f):
            joints = {name: q + draws.gauss(0, 0.04) for name, q in posture["joints"].items()}
            out.write(json.dumps({"id": posture["id"], "joints": {**joints, "pan": draws.gauss(0, 0.1), "tilt": draws.gauss(0, 0.1)}}) + "\n")
    return spread + [word for name in ARM_JOINTS for word in ("--spread", "joint/%s/offset=0.01" % name)], None


def try_robot(folder, kind, seed):
    spread, flange = write_robot(folder, kind, seed)
    common = ["--samples", "16", "--seed", str(seed), "--postures", "postures.jsonl"]
    for name, px in (("rig.yaml", 0.2), ("exact.yaml", 1e-9)):
        with open(os.path.join(folder, name), "w") as f:
            f.write(rig(kind, px, flange))
    run(folder, "simulate", "rig.yaml", *common, *spread, "--out", "sim", "--render", "sim/images", "--blur", "0.8", "--image-noise", "2")
    run(folder, "simulate", "exact.yaml", *common, *spread, "--out", "exact")
    run(folder, "detect", "rig.yaml", "sim/samples.jsonl", "--out", "found.jsonl", "--sigma")
    run(folder, "calibrate", "rig.yaml", "found.jsonl", "--out", "result", "--no-report")
    return (*judge_result(folder), corner_errors(folder))


def judge_result(folder):
    """chi2, dof, NEES by the whole covariance and its numbers, of a result beside the simulation's truth."""
    with open(os.path.join(folder, "result", "result.json")) as f:
        result = json.load(f)
    with open(os.path.join(folder, "sim", "truth.json")) as f:
        truth = json.load(f)["parameters"]
    with open(os.path.join(folder, "result", "covariance.csv")) as f:
        rows = list(csv.reader(f))
    covariance = numpy.array([[float(x) for x in row[-len(rows) + 1:]] for row in rows[1:]])
    error = []
    for name in rows[0][-len(covariance):]:
        owner, _, last = name.rpartition(".")
        found = result["parameters"][owner]["value"]["x y z rx ry rz".split().index(last)] if owner else result["parameters"][name]["value"]
        error.append((found[0] if isinstance(found, list) else found) - truth.get(name, {"true": 0})["true"])
    error = numpy.array(error)
    return result["chi2"], result["dof"], error @ numpy.linalg.solve(covariance, error), len(error)


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--robots", type=int, default=30)
    options.add_argument("--first", type=int, default=0, help="the first seed")
    options.add_argument("--keep", help="a folder for all files")
    options.add_argument("--kincal", default=os.path.join(ROOT, "build", "release", "kincal"))
    a = options.parse_args()
    global KINCAL
    KINCAL = os.path.abspath(a.kincal)
    sums = collections.defaultdict(lambda: [0, 0.0, 0, 0.0, 0, [], []])
    for seed in range(a.first, a.first + a.robots):
        kind = KINDS[seed % len(KINDS)]
        folder = os.path.join(a.keep, str(seed)) if a.keep else tempfile.mkdtemp()
        os.makedirs(folder, exist_ok=True)
        try:
            chi, dof, nees, n, (errors, whitened) = try_robot(folder, kind, seed)
        except RuntimeError as error:
            print(seed, kind, error, flush=True)
            continue
        print("%d %s: chi2/dof %.3f (%d), NEES/dof %.2f (%d), corners %.4f px, %.3f sigmas"
              % (seed, kind, chi / dof, dof, nees / n, n, rms(errors), rms(whitened)), flush=True)
        for key in (kind, "all"):
            s = sums[key]
            for i, more in enumerate((1, chi, dof, nees, n, [errors], [whitened])):
                s[i] += more
        if not a.keep:
            shutil.rmtree(folder)
    print("\n| robots | | chi2/dof | 99 % | NEES/dof | 99 % | corners, px | in sigmas |\n| --- | --- | --- | --- | --- | --- | --- | --- |")
    for kind, (count, chi, dof, nees, n, errors, whitened) in sums.items():
        low, high = (numpy.array(chi2.ppf(p, [dof, n])) / [dof, n] for p in (0.005, 0.995))
        print("| %s | %d | %.3f | %.3f to %.3f | %.2f | %.2f to %.2f | %.4f | %.3f |"
              % (kind, count, chi / dof, low[0], high[0], nees / n, low[1], high[1], rms(numpy.concatenate(errors)), rms(numpy.concatenate(whitened))))


if __name__ == "__main__":
    main()
