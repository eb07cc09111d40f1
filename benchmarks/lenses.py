#!/usr/bin/env python3
"""Lenses, scale and offset of ranges, planes that are seen and touched: are they as well known as the result says?

    benchmarks/lenses.py build/release/kincal               # 30 robots of each kind
    benchmarks/lenses.py build/release/kincal --kind unified --robots 100

Robots with a sensor on their flange that looks at a target beside them: a camera of each lens, a depth camera with scale and offset of its range, and one that sees a floor which a tip touches. The truth of all that is estimated
(lens or range, the poses of sensor and target) is drawn around the rig's values, samples are simulated, and `calibrate` frees all of it. Printed are chi2/dof and NEES/dof (e' C^-1 e
over all that is freed, of the covariance that the result states) of all robots, with the 99 % intervals that honest ones would keep, and the rms of single parameters in their sigmas.
"""
import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

RIG = """format: kincal/1
robot: {base: base, flange: tool0}
targets:
  target: {%s, mount: {link: base, pose: {xyz: [0.5, 0, 0], rpy: [0.1, -0.1, 0.2]}}}
sensors:
  sensor: {%s, link: tool0, pose: {xyz: [0.02, -0.03, 0.06], rpy: [0.2, -0.1, 0.3]}}
estimate:
  - {step: all, free: [sensor/sensor/pose, target/target/pose, %s], priors: {%s}}
"""
BOARD = "type: chessboard, rows: 6, columns: 8, square: 0.03"
CAMERA = "type: camera, model: %s, image_size: [1280, 1280], intrinsics: [%s], distortion: [%s], sigma: 0.05"
NUMBERS = {"brown_conrady": "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y", "unified": "xi k1 k2 p1 p2", "double_sphere": "xi alpha", "intrinsics": "fx fy cx cy", "pose": "x y z rx ry rz"}
POSES = {"sensor/sensor/pose": 0.004, "target/target/pose": 0.004}
LENS = {"sensor/sensor/intrinsics": 4.0}
BROWN = "-0.2, 0.05, 0.001, -0.001, -0.005, 0, 0, 0"
BENT = {"sensor/sensor/distortion.%s" % k: 0.004 for k in ("k1", "k2", "k3", "p*", "s*", "tau*")}
KINDS = {  # the sensor, which parameters are drawn how far from the rig, and how far from the axis it is pointed (degrees)
    "brown_conrady_12": (CAMERA % ("brown_conrady", "700, 705, 640, 635", BROWN + ", 0.002, -0.001, 0.001, 0.002"), BENT, 32),
    "brown_conrady_14": (CAMERA % ("brown_conrady", "700, 705, 640, 635", BROWN + ", 0.002, -0.001, 0.001, 0.002, 0.02, -0.03"), BENT, 32),
    "unified": (CAMERA % ("unified", "760, 764, 640, 635", "1.4, -0.05, 0.01, 0.001, -0.001"), {"sensor/sensor/distortion.xi": 0.05, "sensor/sensor/distortion.k*": 0.001,
                                                                                          "sensor/sensor/distortion.p*": 0.001}, 80),
    "double_sphere": (CAMERA % ("double_sphere", "300, 302, 640, 635", "-0.2, 0.6"), {"sensor/sensor/distortion": 0.01}, 70),
    "range": ("type: point, sigma: 0.001, range_scale: 1, range_offset: 0", {"sensor/sensor/range_scale": 0.01, "sensor/sensor/range_offset": 0.01}, 25),
    "plane": None,   # PLANE
}


PLANE = """format: kincal/1
robot: {base: base, flange: tool0}
targets:
  floor: {type: plane, mount: {link: base, pose: {xyz: [0.5, 0, 0.1], rpy: [0.05, -0.1, 0.3]}}}
sensors:
  depth: {type: surface, sigma: 0.001, link: tool0, pose: {xyz: [0.02, -0.03, 0.06], rpy: [0.2, -0.1, 0.3]}}
  tip: {type: surface, sigma: 0.0003, link: tool0, pose: {xyz: [0.01, 0.02, 0.15]}}
estimate:
  - {step: all, free: [sensor/depth/pose, sensor/tip/pose.x, sensor/tip/pose.y, sensor/tip/pose.z, target/floor/pose.z, target/floor/pose.rx, target/floor/pose.ry]}
"""


class Pose:
    def __init__(self, rotation, xyz):
        self.r, self.t = rotation, np.asarray(xyz, float)

    def __mul__(self, other):
        return Pose(self.r * other.r, self.t + self.r.apply(other.t))

    def inverse(self):
        return Pose(self.r.inv(), -self.r.inv().apply(self.t))


SENSOR = Pose(Rotation.from_euler("xyz", [0.2, -0.1, 0.3]), [0.02, -0.03, 0.06])
TARGET = Pose(Rotation.from_euler("xyz", [0.1, -0.1, 0.2]), [0.5, 0, 0])


def postures(draws, count, widest, kind):
    """Poses of the flange from which the sensor has the target `widest` degrees off its axis at most."""
    lines = []
    for k in range(count):
        angle, turn = np.radians(widest) * np.sqrt(draws.uniform()), draws.uniform(0, 2 * np.pi)
        away = Rotation.from_rotvec(angle * np.array([np.cos(turn), np.sin(turn), 0]))
        distance = draws.uniform(0.4, 0.7) if kind != "range" else draws.uniform(0.35, 2.0)
        seen = Pose(away * Rotation.from_euler("zxy", draws.normal(size=3) * [1.2, 0.35, 0.35]), away.apply([0, 0, distance]))
        seen = seen * Pose(Rotation.identity(), [-0.105, -0.075, 0])   # its middle is looked at
        flange = TARGET * seen.inverse() * SENSOR.inverse()
        lines.append(json.dumps({"id": "p%02d" % k, "joints": {"flange": {"xyz": list(flange.t), "quat": list(flange.r.as_quat())}}}))
    return "\n".join(lines) + "\n"


def exponential(xi):
    """The pose of an increment: translation by the left Jacobian of its rotation."""
    t, w = np.array(xi[:3]), np.array(xi[3:])
    angle = np.linalg.norm(w)
    cross = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    a, b = ((1 - np.cos(angle)) / angle ** 2, (angle - np.sin(angle)) / angle ** 3) if angle > 1e-9 else (0.5, 1 / 6)
    return Pose(Rotation.from_rotvec(w), (np.eye(3) + a * cross + b * cross @ cross) @ t)


def plane_samples(draws, count):
    """Half of the samples see the floor, half touch it; and the truth, as increments."""
    names = {"sensor/depth/pose": [0, 1, 2, 3, 4, 5], "sensor/tip/pose": [0, 1, 2], "target/floor/pose": [2, 3, 4]}
    given = {"sensor/depth/pose": SENSOR, "sensor/tip/pose": Pose(Rotation.identity(), [0.01, 0.02, 0.15]),
             "target/floor/pose": Pose(Rotation.from_euler("xyz", [0.05, -0.1, 0.3]), [0.5, 0, 0.1])}
    truth, at = {}, {}
    for name, components in names.items():
        truth[name] = [0.004 * draws.normal() if c in components else 0.0 for c in range(6)]
        at[name] = given[name] * exponential(truth[name])
    depth, tip, floor = (at[name] for name in names)
    lines = []
    for k in range(count):
        turn = Rotation.from_euler("x", np.pi) * Rotation.from_euler("zxy", [draws.uniform(0, 2 * np.pi), *(0.35 * draws.normal(size=2))])   # the flange looks down
        place = floor.t + floor.r.apply([*draws.uniform(-0.4, 0.4, 2), 0])
        normal = floor.r.apply([0, 0, 1])
        if k % 2:
            flange = Pose(turn, place + 0.0003 * draws.normal() * normal - turn.apply(tip.t))
            view = {"sensor": "tip", "points": [[0, 0, 0]]}
        else:
            flange = Pose(turn, place + normal * draws.uniform(0.4, 1.0))
            eye, points = flange * depth, []
            for _ in range(20):
                ray = eye.r.apply([*(0.35 * draws.uniform(-1, 1, 2)), 1])
                hit = eye.t + ray * (normal @ (floor.t - eye.t)) / (normal @ ray)
                points.append(list(eye.r.inv().apply(hit - eye.t) + 0.001 * draws.normal(size=3)))
            view = {"sensor": "depth", "points": points}
        lines.append(json.dumps({"id": "p%02d" % k, "joints": {"flange": {"xyz": list(flange.t), "quat": list(flange.r.as_quat())}}, "views": [dict(view, target="floor")]}))
    return "\n".join(lines) + "\n", truth


def run(folder, *arguments):
    done = subprocess.run(arguments, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)
    if done.returncode:
        raise RuntimeError("%s: %s" % (arguments[1], done.stderr or done.stdout[-300:]))


def numbers_of(parameters, key):
    """Every component's number: parameter.COMPONENT by place."""
    out = {}
    for name, entry in parameters.items():
        value = entry[key] if isinstance(entry, dict) else entry
        for i, v in enumerate(value if isinstance(value, list) else [value]):
            out[name, i] = v
    return out


def try_robot(folder, kincal, kind, seed, samples):
    """chi2, dof, e' C^-1 e, and each number's error in its sigmas."""
    if kind == "plane":
        text, truth = plane_samples(np.random.default_rng(seed), samples)
        for name, content in (("rig.yaml", PLANE), ("samples.jsonl", text)):
            with open(os.path.join(folder, name), "w") as f:
                f.write(content)
        return judged(folder, kincal, "samples.jsonl", truth, "")
    sensor, spread, widest = KINDS[kind]
    if kind.startswith("brown"):   # p1 p2 and a tilt do nearly the same: one pair is held
        spread = {name: sigma for name, sigma in spread.items() if (".tau" if kind == "brown_conrady_12" else ".p") not in name}
    freed = ", ".join('"%s"' % name for name in spread) + (", sensor/sensor/intrinsics" if kind != "range" else "")
    # Within what a unified lens sees, k1 and k2 do nearly what xi does: they are known as well as they were drawn.
    priors = ", ".join('"%s": %g' % one for one in spread.items() if kind == "unified" and ".k" in one[0])
    for name, text in (("rig.yaml", RIG % (BOARD, sensor, freed, priors)), ("postures.jsonl", postures(np.random.default_rng(seed), samples, widest, kind))):
        with open(os.path.join(folder, name), "w") as f:
            f.write(text)
    drawn = dict(POSES, **spread, **(LENS if kind != "range" else {}))
    run(folder, kincal, "simulate", "rig.yaml", "--samples", str(samples), "--seed", str(seed), "--postures", "postures.jsonl", "--out", "sim", "--quiet",
        *[word for one in drawn.items() for word in ("--spread", "%s=%g" % one)])
    with open(os.path.join(folder, "sim", "truth.json")) as f:
        truth = json.load(f)["parameters"]
    return judged(folder, kincal, "sim/samples.jsonl", truth, sensor.split("model: ")[-1].split(",")[0])


def judged(folder, kincal, samples, truth, lens):
    """Calibrates rig.yaml; `lens` as the rig calls it."""
    run(folder, kincal, "calibrate", "rig.yaml", samples, "--out", "result", "--quiet", "--no-report")
    with open(os.path.join(folder, "result", "result.json")) as f:
        result = json.load(f)
    with open(os.path.join(folder, "result", "covariance.csv")) as f:
        rows = list(csv.reader(f))
    names = rows[0][-len(rows) + 1:]
    covariance = np.array([[float(x) for x in row[-len(names):]] for row in rows[1:]])
    found = numbers_of(result["parameters"], "value")
    error = np.empty(len(names))
    for i, name in enumerate(names):
        parameter = next(p for p in result["parameters"] if name == p or name.startswith(p + "."))
        part = name[len(parameter) + 1:]
        kind_of = parameter.rsplit("/", 1)[-1]
        place = NUMBERS[lens if kind_of == "distortion" else kind_of].split().index(part) if part else 0
        entry = truth.get(name, truth.get(parameter))
        if entry is None:
            raise RuntimeError("no truth of " + name)
        true = entry["true"] if isinstance(entry, dict) else entry
        error[i] = found[parameter, place] - (true[place] if isinstance(true, list) else true)
    step = result["steps"][-1]
    return step["chi2"], step["dof"], error @ np.linalg.solve(covariance, error), dict(zip(names, error / np.sqrt(np.diag(covariance))))


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("kincal")
    options.add_argument("--robots", type=int, default=30)
    options.add_argument("--samples", type=int, default=40)
    options.add_argument("--first", type=int, default=1, help="seed of the first robot")
    options.add_argument("--kind", choices=KINDS, help="without it all, in turn")
    a = options.parse_args()
    print("| | robots | chi2/dof | 99 % | NEES/dof | 99 % | worst number, rms in sigmas |\n| --- | --- | --- | --- | --- | --- | --- |")
    for kind in (a.kind,) if a.kind else KINDS:
        sums, sigmas, robots = np.zeros(3), {}, 0
        for seed in range(a.first, a.first + a.robots):
            with tempfile.TemporaryDirectory() as folder:
                try:
                    squares, dof, nees, off = try_robot(folder, os.path.abspath(a.kincal), kind, seed, a.samples)
                except RuntimeError as error:
                    print("%s, seed %d: %s" % (kind, seed, error), file=sys.stderr)
                    continue
            sums += (squares, dof, nees)
            robots += 1
            for name, value in off.items():
                sigmas.setdefault(name, []).append(value)
        n = robots * len(sigmas)
        if not n:
            continue
        rms = {name: np.sqrt(np.mean(np.square(v))) for name, v in sigmas.items()}
        worst = max(rms, key=lambda name: abs(np.log(rms[name])))
        interval = lambda dof: "%.3f to %.3f" % tuple(chi2.ppf(p, dof) / dof for p in (0.005, 0.995))
        print("| %s | %d | %.3f | %s | %.3f | %s | `%s` %.2f |" % (kind, robots, sums[0] / sums[1], interval(sums[1]), sums[2] / n, interval(n), worst, rms[worst]), flush=True)


if __name__ == "__main__":
    main()
