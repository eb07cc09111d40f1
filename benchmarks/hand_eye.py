#!/usr/bin/env python3
"""Hand-eye calibration from poses of the flange, beside OpenCV: the same rendered pictures, the same corners.

    ninja -C build/release kincal kincal-detect kincal-render opencv-hand-eye
    benchmarks/hand_eye.py               # 20 robots of each kind: camera in the hand and in the room, exact and noisy poses

Pictures of a ChArUco board are taken (`simulate --render`), `detect --sigma` finds it and says how well, then `calibrate` without steps, and OpenCV's calibrateHandEye (all five
methods) and calibrateRobotWorldHandEye (both) on solvePnP of the same corners. kincal is told nothing but the board, a lens and the noise of the poses; the lens of OpenCV is held.
Printed are medians of how far the camera's pose is from the truth; for kincal the NEES of it over its 6 numbers (by its whole covariance); for each method of OpenCV on how many
robots it is nearer than kincal, the p of Wilcoxon's test of the pairs (two-sided), and how many times kincal's its error is (geometric mean and its 95 % interval by t). It needs NumPy and SciPy, and OpenCV at building time.
"""
import argparse
import collections
import csv
import json
import os
import shutil
import subprocess
import tempfile

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import t as student
from scipy.stats import wilcoxon

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
RIG = """format: kincal/1
robot: {base: base, flange: tool0}
%stargets:
  board: {type: charuco, rows: 6, columns: 8, square: 0.03, marker: 0.0225, dictionary: DICT_4X4_50, mount: {link: %s%s}}
sensors:
  camera: {type: camera, link: %s, model: brown_conrady, image_size: [640, 480], intrinsics: [600, 601, 318.6, 242.3],
    distortion: [-0.14, 0.04, 0.0003, -0.0006, 0], sigma: 0.035%s}
"""
NOISE = {"exact": (0, 0), "noisy": (3e-4, 6e-4)}   # m, rad


class Pose:
    def __init__(self, rotation, xyz):
        self.r, self.t = rotation, np.asarray(xyz, float)

    def __mul__(self, other):
        return Pose(self.r * other.r, self.t + self.r.apply(other.t))

    def inverse(self):
        return Pose(self.r.inv(), -self.r.inv().apply(self.t))

    def mapping(self):
        return {"xyz": list(self.t), "quat": list(self.r.as_quat())}


def make_robot(draws, kind):
    """Truth and postures: link_T_camera, link_T_board, and the poses of the flange."""
    camera = Pose(Rotation.from_rotvec(0.5 * draws.normal(size=3)), 0.05 * draws.normal(size=3) + [0, 0, 0.06])
    board = Pose(Rotation.from_rotvec(0.2 * draws.normal(size=3)), [0.5, 0, 0])
    if kind == "room":
        camera = Pose(Rotation.from_euler("x", np.pi) * Rotation.from_rotvec(0.1 * draws.normal(size=3)), [0.5, 0, 1.1])
        board = Pose(Rotation.from_rotvec(0.3 * draws.normal(size=3)), 0.02 * draws.normal(size=3) + [0, 0, 0.05])
    postures = []
    for k in range(16):
        seen = Pose(Rotation.from_euler("zxy", draws.normal(size=3) * [1.2, 0.35, 0.35]), draws.normal(size=3) * [0.03, 0.03, 0.05] + [0, 0, 0.45])
        seen = seen * Pose(Rotation.identity(), [-0.12, -0.09, 0])     # the board's middle is looked at
        flange = board * seen.inverse() * camera.inverse() if kind == "hand" else camera * seen * board.inverse()
        postures.append(json.dumps({"id": "p%02d" % k, "joints": {"flange": flange.mapping()}}))
    return camera, board, "\n".join(postures) + "\n"


def rig(kind, noise, camera=None, board=None):
    on = ("base", "tool0") if kind == "hand" else ("tool0", "base")
    sigma = "joints: {flange: {sigma: {translation: %g, rotation: %g}}}\n" % NOISE[noise]
    return RIG % (sigma, on[0], ", pose: " + json.dumps(board.mapping()) if board else "", on[1], ", pose: " + json.dumps(camera.mapping()) if camera else "")


def run(folder, *arguments):
    done = subprocess.run(arguments, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    if done.returncode:
        raise RuntimeError("%s: %s" % (arguments[1], done.stderr.decode() or done.stdout.decode()[-300:]))
    return done.stdout.decode()


def try_robot(folder, programs, kind, noise, seed):
    """Errors (m, rad) by method, and the NEES of kincal's."""
    kincal = programs + "/kincal"
    camera, board, postures = make_robot(np.random.default_rng(seed), kind)
    for name, text in (("postures.jsonl", postures), ("truth.yaml", rig(kind, noise, camera, board)), ("rig.yaml", rig(kind, noise))):
        with open(os.path.join(folder, name), "w") as f:
            f.write(text)
    run(folder, kincal, "simulate", "truth.yaml", "--samples", "16", "--seed", str(seed), "--postures", "postures.jsonl", "--out", "sim", "--render", "images",
        "--blur", "0.8", "--image-noise", "2", "--quiet")
    run(folder, kincal, "detect", "rig.yaml", "sim/samples.jsonl", "--out", "found.jsonl", "--sigma", "--quiet")
    run(folder, kincal, "calibrate", "rig.yaml", "found.jsonl", "--out", "result", "--quiet", "--no-report")
    found = {}
    for line in run(folder, programs + "/tests/opencv-hand-eye", "rig.yaml", "found.jsonl").splitlines():
        method, *numbers = line.split(",")
        numbers = [float(x) for x in numbers]
        if np.isfinite(numbers).all() and np.linalg.norm(numbers[3:]) > 0.5:   # else it found no rotation
            found[method] = Pose(Rotation.from_quat(numbers[3:]), numbers[:3])
    with open(os.path.join(folder, "result", "result.json")) as f:
        parameter = json.load(f)["parameters"]["sensor/camera/pose"]
    found["kincal"] = Pose(Rotation.from_quat(parameter["pose"]["quat"]), parameter["pose"]["xyz"])
    errors = {}
    for method, at in found.items():
        off = at.inverse() * camera
        errors[method] = (np.linalg.norm(off.t), np.linalg.norm(off.r.as_rotvec()))
    with open(os.path.join(folder, "result", "covariance.csv")) as f:
        rows = list(csv.reader(f))
    names = rows[0][-len(rows) + 1:]
    pose = [i for i, name in enumerate(names) if name.startswith("sensor/camera/pose.")]
    covariance = np.array([[float(x) for x in row[-len(names):]] for row in rows[1:]])[np.ix_(pose, pose)]
    off = found["kincal"].inverse() * camera    # the numbers of a pose move it in its own frame
    error = np.concatenate([off.t, off.r.as_rotvec()])
    return errors, error @ np.linalg.solve(covariance, error) / 6


def show(kind, noise, robots, failed):
    """Medians of each method; `robots`: errors and NEES of each."""
    everything = [one for one, _ in robots]
    print("camera in the %s, %s poses, %d robots%s; kincal's NEES/dof: %.2f" % (kind, noise, len(robots), failed, np.mean([nees for _, nees in robots])))
    rows = []
    for method in sorted(set(name for one in everything for name in one)):
        own = np.array([one[method] for one in everything if method in one])
        pairs = np.array([(one[method], one["kincal"]) for one in everything if method in one])
        beside = ""
        for k, unit in enumerate(("mm", "mrad")):
            if method != "kincal":
                off = pairs[:, 0, k] - pairs[:, 1, k]
                ratio = np.log(pairs[:, 0, k] / pairs[:, 1, k])
                half = student.ppf(0.975, len(off) - 1) * ratio.std(ddof=1) / np.sqrt(len(off))
                times = tuple(np.exp(ratio.mean() + half * side) for side in (0, -1, 1))
                beside += "   nearer in %s: %d of %d (p %.2g), %.3f times (%.3f to %.3f)" % (unit, (off < 0).sum(), len(off), wilcoxon(off).pvalue, *times)
        rows.append((*np.median(own, axis=0), method, beside))
    for metres, radians, method, beside in sorted(rows):
        print("  %-18s %7.3f mm %7.3f mrad%s" % (method, 1e3 * metres, 1e3 * radians, beside), flush=True)


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--robots", type=int, default=20)
    options.add_argument("--kind", choices=("hand", "room"), help="where the camera is; without it both, in turn")
    options.add_argument("--noise", choices=NOISE, help="of the poses; without it both, in turn")
    options.add_argument("--build", default=os.path.join(ROOT, "build", "release"), help="where the programs are")
    a = options.parse_args()
    for kind in (a.kind,) if a.kind else ("hand", "room"):
        for noise in (a.noise,) if a.noise else NOISE:
            robots, failed = [], ""
            for seed in range(a.robots):
                folder = tempfile.mkdtemp()
                try:
                    robots.append(try_robot(folder, os.path.abspath(a.build), kind, noise, seed))
                except RuntimeError as error:
                    print("camera in the %s, %s poses, seed %d: %s" % (kind, noise, seed, error))
                    failed = " (others failed)"
                finally:
                    shutil.rmtree(folder)
            show(kind, noise, robots, failed)


if __name__ == "__main__":
    main()
