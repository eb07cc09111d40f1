#!/usr/bin/env python3
"""Hand-eye calibration from poses of the flange, beside OpenCV: the same rendered pictures, the same corners.

    ninja -C build/release kincal kincal-detect kincal-render opencv-hand-eye
    benchmarks/hand_eye.py               # 20 robots of each kind: camera in the hand and in the room, exact and noisy poses

Pictures of a ChArUco board are taken (`simulate --render`), `detect` finds it, then `calibrate` without steps, and OpenCV's calibrateHandEye (all five methods) and
calibrateRobotWorldHandEye (both) on solvePnP of the same corners. kincal is told nothing but the board and a lens; that of OpenCV is held. Printed are medians of how far the
camera's pose is from the truth, and for kincal the NEES of it. It needs NumPy and SciPy, and OpenCV at building time.
"""
import argparse
import collections
import json
import os
import shutil
import subprocess
import tempfile

import numpy as np
from scipy.spatial.transform import Rotation

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
    run(folder, kincal, "detect", "rig.yaml", "sim/samples.jsonl", "--out", "found.jsonl", "--quiet")
    run(folder, kincal, "calibrate", "rig.yaml", "found.jsonl", "--out", "result", "--quiet", "--no-report")
    found = {}
    for line in run(folder, programs + "/tests/opencv-hand-eye", "rig.yaml", "found.jsonl").splitlines():
        method, *numbers = line.split(",")
        found[method] = Pose(Rotation.from_quat([float(x) for x in numbers[3:]]), [float(x) for x in numbers[:3]])
    with open(os.path.join(folder, "result", "result.json")) as f:
        parameter = json.load(f)["parameters"]["sensor/camera/pose"]
    pose = parameter["pose"] if "pose" in parameter else None
    if pose is None:
        import yaml
        with open(os.path.join(folder, "result", "rig.yaml")) as f:
            pose = yaml.safe_load(f)["sensors"]["camera"]["pose"]
    found["kincal"] = Pose(Rotation.from_quat([float(x) for x in pose["quat"]]), [float(x) for x in pose["xyz"]])
    errors = {}
    for method, at in found.items():
        off = at.inverse() * camera
        errors[method] = (np.linalg.norm(off.t), np.linalg.norm(off.r.as_rotvec()))
    off = found["kincal"].inverse() * camera
    sigma = np.array(parameter["sigma"], float)
    return errors, np.mean((np.concatenate([off.t, off.r.as_rotvec()]) / sigma) ** 2)


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--robots", type=int, default=20)
    options.add_argument("--build", default=os.path.join(ROOT, "build", "release"), help="where the programs are")
    a = options.parse_args()
    for kind in ("hand", "room"):
        for noise in NOISE:
            errors, squares = collections.defaultdict(list), []
            for seed in range(a.robots):
                folder = tempfile.mkdtemp()
                try:
                    one, nees = try_robot(folder, os.path.abspath(a.build), kind, noise, seed)
                    squares.append(nees)
                    for method, e in one.items():
                        errors[method].append(e)
                except RuntimeError as error:
                    print("camera in the %s, %s poses, seed %d: %s" % (kind, noise, seed, error))
                finally:
                    shutil.rmtree(folder)
            print("camera in the %s, %s poses, %d robots; kincal's squared error over its sigmas squared: %.2f" % (kind, noise, len(squares), np.mean(squares)))
            for method, e in sorted(errors.items(), key=lambda entry: np.median([x[0] for x in entry[1]])):
                print("  %-18s %7.3f mm %7.3f mrad" % (method, *(1e3 * np.median(e, axis=0))), flush=True)


if __name__ == "__main__":
    main()
