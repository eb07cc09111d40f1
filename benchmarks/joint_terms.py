#!/usr/bin/env python3
"""Are joints that bend, ripple and lag found, and are the sigmas of what is found honest? Simulated arms with one planted kind of term, without steps.

    benchmarks/joint_terms.py                          # three robots, six kinds of terms, 30 seeds each
    benchmarks/joint_terms.py --kind backlash --robot pr2 --seeds 5 --keep build/terms
    benchmarks/joint_terms.py --json out.json --jobs 2

  arm      the arm of examples/arm; a tracker at its base measures a body on the flange
  camera   the same arm; a camera on its flange, a board on the table
  pr2      the left arm of examples/pr2; a tracker on the torso measures a body at the wrist

`simulate` draws what every robot has (joint offsets with sigma 3 mrad, origins 0.3 mm and 0.5 mrad; squares of a board 1 %, a lens 3 px) and the
term as PLANTED says. The rig that is calibrated knows nothing of it (but of `ripple` the gear ratios); samples state the direction of approach, or
temperatures, where these matter. Judged are

  kept        planted groups that are estimated; other: robots in which a group that nobody planted is
  NEES/dof    e' C^-1 e / n of the n estimated numbers, e their error, C of covariance.csv; and of those of terms alone
  predicted/actual   of the place of what the flange carries, seen from what stands, in 50 fresh postures at readings without noise: root of the
              mean square predicted error over that of the actual one, all robots together (median of the robots); um: the actual one

Places are computed by the forward model here, which shares nothing with the program. It needs numpy, scipy and PyYAML.
"""
import argparse
import csv
import json
import math
import os
import re
import shutil
import tempfile
import xml.etree.ElementTree as xml

import automatic as base
import numpy as np
import yaml

ROOT, FRESH, GRAVITY = base.ROOT, 50, np.array([0, 0, -9.81])
USUAL = ["joint/%s/offset=0.003", "joint/%s/origin.[xyz]=0.0003", "joint/%s/origin.r[{}]=0.0005"]      # about the axis the offset turns
OF_CAMERA = ["target/board/square=0.0003", "sensor/camera/intrinsics=3"]
BODY = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]
ARM = ["turn", "lift", "bend", "forearm_roll", "wrist_bend", "wrist_roll"]
PR2 = ["l_%s_joint" % n for n in ("shoulder_pan", "shoulder_lift", "upper_arm_roll", "elbow_flex", "forearm_roll", "wrist_flex", "wrist_roll")]
TRACKER = {"targets": {"body": {"type": "points", "points": BODY, "mount": {"link": None, "pose": {"xyz": [0.05, 0.02, 0.1]}}}},
           "sensors": {"tracker": {"type": "point", "link": None, "sigma": 3e-5, "pose": {"xyz": [1.8, 0.4, 0.3], "rpy": [0.1, -0.2, 2.9]}}}}
ROBOTS = {   # joints of the arm, links of what stands and what moves
    "arm": (ARM, "base", "flange"), "camera": (ARM, "base", "flange"), "pr2": (PR2, "torso_lift_link", "l_wrist_roll_link")}
PLANTED = {  # samples; joints by index; keys of the true rig; how `simulate` draws the values
    "compliance": (120, (1, 2, 3), {}, ["joint/%s/compliance.axis=2e-5", "link/*/load=0.05"]),
    "curve": (250, (1, 2), {"model": "curve"}, ["joint/%s/curve=0.0004"]),
    "ripple": (120, (1, 2), {"gear_ratio": 97}, ["joint/%s/ripple=0.00015"]),
    "ripple found": (160, (1, 2), {"gear_ratio": 97}, ["joint/%s/ripple.???97=0.0003"]),
    "backlash": (120, None, {"backlash": 0}, ["joint/%s/backlash=0.0005"]),
    "temperature": (120, None, {"temperature": 0}, ["joint/%s/temperature=0.00005"])}
COMPONENTS = base.COMPONENTS
NOT_IN_PLACES = ("intrinsics", "distortion", "square", "points")      # these move no place, and are not judged


# ---- the forward model; values are by the program's names, poses of what is mounted absolute, origins as increments

def spline(c, angle):
    """A periodic cubic B-spline with coefficients c around the turn."""
    u = np.mod(angle * len(c) / (2 * math.pi), len(c))
    k, t = np.floor(u).astype(int), u - np.floor(u)
    weights = [(1 - t)**3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6, (-3 * t**3 + 3 * t**2 + 3 * t + 1) / 6, t**3 / 6]
    return sum(w * c[(k + i - 1) % len(c)] for i, w in enumerate(weights))


class Arm:
    """Joints of a URDF from the link that stands to the one that moves."""

    def __init__(self, urdf, stands, moves):
        parents = {j.find("child").get("link"): j for j in xml.parse(urdf).getroot().findall("joint")}
        self.names, self.origins, self.axes, self.links, self.limits = [], [], [], [], []
        while moves != stands:
            j = parents[moves]
            origin, axis, limit = j.find("origin"), j.find("axis"), j.find("limit")
            pose = {k: [float(v) for v in (origin.get(k, "0 0 0") if origin is not None else "0 0 0").split()] for k in ("xyz", "rpy")}
            self.names.insert(0, j.get("name"))
            self.origins.insert(0, base.read_pose(pose))
            self.axes.insert(0, None if j.get("type") == "fixed" else np.array([float(v) for v in axis.get("xyz").split()]))
            self.limits.insert(0, [float(limit.get(k, s)) for k, s in (("lower", -math.pi), ("upper", math.pi))] if limit is not None else None)
            self.links.insert(0, moves)
            moves = j.find("parent").get("link")

    def axis_of(self, name):
        return self.axes[self.names.index(name)]

    def position(self, v, name, readings, conditions):
        q = readings[name]
        out = q + v.get("joint/%s/offset" % name, [0])[0]
        for term, by in (("backlash", conditions["approach"].get(name, 0)), ("temperature", conditions["warmer"])):
            out = out + v.get("joint/%s/%s" % (name, term), [0])[0] * by
        if "joint/%s/curve" % name in v:
            out = out + spline(v["joint/%s/curve" % name], q)
        for n, r in zip(v.get("ratio/" + name, []), np.reshape(v.get("joint/%s/ripple" % name, []), (-1, 4))):
            out = out + r @ [np.cos(n * q), np.sin(n * q), np.cos(2 * n * q), np.sin(2 * n * q)]
        for other, c in zip(v.get("coupled/" + name, []), v.get("joint/%s/coupling" % name, [])):
            out = out + c * readings[other]
        return out

    def tip(self, v, readings, conditions):
        """stands_T_moves of all postures. Deflections: the fixed point of moments at the postures that they bend."""
        count = len(next(iter(readings.values())))
        fixed = [np.broadcast_to(o @ base.exp(v.get("joint/%s/origin" % n, np.zeros(6))), (count, 4, 4)) for n, o in zip(self.names, self.origins)]
        turned = lambda n, a: base.motion(base.rotation(np.multiply.outer(self.position(v, n, readings, conditions), a)))
        motions = [np.broadcast_to(np.eye(4), (count, 4, 4)) if a is None else turned(n, a) for n, a in zip(self.names, self.axes)]
        bends = [n for n in self.names if np.any(v.get("joint/%s/compliance" % n, 0))]
        delta = {n: np.zeros((count, 3)) for n in bends}
        for _ in range(8 if bends else 1):
            frame, frames, moments = np.broadcast_to(np.eye(4), (count, 4, 4)), {}, []
            for n, link, o, m in zip(self.names, self.links, fixed, motions):
                frames[n] = (frame @ o)[:, :3, :3]
                frame = frame @ o @ base.motion(base.rotation(delta[n])) @ m if n in delta else frame @ o @ m
                moments.append(frame[:, :3, :3] @ v.get("link/%s/load" % link, np.zeros(3)))
            for n in bends:
                axis = self.axis_of(n)
                side = np.eye(3)[np.argmin(abs(axis))]
                side = (side - (side @ axis) * axis) / np.linalg.norm(side - (side @ axis) * axis)
                basis = np.stack([axis, side, np.cross(axis, side)], 1)
                turns = motions[self.names.index(n)][:, :3, :3] @ basis if v.get("rotor") else np.broadcast_to(basis, (count, 3, 3))
                torque = np.swapaxes(frames[n], 1, 2) @ np.cross(sum(moments[self.names.index(n):]), GRAVITY)[..., None]
                delta[n] = (turns @ (np.array(v["joint/%s/compliance" % n])[:, None] * (np.swapaxes(turns, 1, 2) @ torque)))[..., 0]
        return frame

    def place(self, v, readings, conditions, seen, moving):
        """What moves as what stands sees it: (n, 3)."""
        return (base.inverse(v[seen]) @ self.tip(v, readings, conditions) @ v[moving])[:, :3, 3]


# ---- rigs, samples and results

def make_rig(robot, stands, moves):
    """The nominal rig with true poses of what is mounted."""
    folder = os.path.join(ROOT, "examples", "pr2" if robot == "pr2" else "arm")
    if robot == "camera":
        with open(os.path.join(folder, "rig.yaml")) as f:
            rig = yaml.safe_load(f)
        with open(os.path.join(folder, "truth.json")) as f:
            truth = json.load(f)["parameters"]
        pose = lambda name: base.pose_entry(base.exp([truth["%s.%s" % (name, c)]["true"] for c in COMPONENTS]))
        rig["sensors"]["camera"].update(pose=pose("sensor/camera/pose"), sigma=0.05)
        rig["targets"]["board"]["mount"]["pose"] = pose("target/board/pose")
        del rig["priors"]
    else:
        rig = {"format": "kincal/1", "base": "base_footprint" if robot == "pr2" else stands, **json.loads(json.dumps(TRACKER))}
        rig["sensors"]["tracker"]["link"], rig["targets"]["body"]["mount"]["link"] = stands, moves
    rig.update(robot=os.path.join(folder, "robot.urdf"), joints={"*": {"sigma": 5e-5}})
    return rig


def write(path, rig):
    with open(path, "w") as f:
        yaml.safe_dump(rig, f, sort_keys=False)


def true_values(truth):
    out = {}
    for name, value in truth["parameters"].items():
        values = np.atleast_1d(np.array(value["true"] if isinstance(value, dict) else value, float))
        parameter, dot, part = name.rpartition(".")
        if not dot:
            out[name] = values
        if not dot or parameter.rpartition("/")[2] in NOT_IN_PLACES:
            continue
        out.setdefault(parameter, np.zeros({"curve": 96, "origin": 6, "ripple": 4}.get(parameter.rpartition("/")[2], 3)))
        out[parameter][index_of(part)] = values[0]
    out.update((n, base.read_pose(v)) for n, v in truth["values"].items() if n.endswith("/pose"))
    return out


def index_of(part, components=()):
    """Of a component in its parameter."""
    for names in (components, COMPONENTS, ("axis", "u", "v")):
        if part in names:
            return list(names).index(part)
    return 2 * (int(part[3:]) == 194) + (part[:3] == "sin") if part[:3] in ("cos", "sin") else int(part)


def estimates(folder):
    """Values of a result; header and covariance of covariance.csv; by number of the header: its parameter, its index there, and whether it was estimated."""
    with open(os.path.join(folder, "result.json")) as f:
        result = json.load(f)
    with open(os.path.join(folder, "rig.yaml")) as f:
        rig = yaml.safe_load(f)
    with open(os.path.join(folder, "covariance.csv")) as f:
        rows = list(csv.reader(f))
    out = {}
    for name, p in result["parameters"].items():
        out[name] = base.read_pose(p["pose"]) if name.endswith("/pose") else np.atleast_1d(np.array(p["value"], float))
    for name, entry in (rig.get("joints") or {}).items():
        out["ratio/" + name] = list(np.atleast_1d(entry.get("gear_ratio", [])))
        out["coupled/" + name] = list(entry.get("coupling", {}))
    elastic = rig.get("elasticity") or {}
    out["rotor"] = elastic.get("frame") == "rotor"
    out.update(("link/%s/load" % link, np.array(load, float)) for link, load in (elastic.get("load") or {}).items())
    numbers = []
    for name in rows[0]:
        parameter, dot, part = name.rpartition(".")
        if not dot:
            parameter, part = name, "0"
        known = result["parameters"].get(parameter, {})
        if parameter.rpartition("/")[2] in NOT_IN_PLACES:
            numbers.append((parameter, 0, False))
            continue
        index = index_of(part, known.get("components", ()))
        numbers.append((parameter, index, bool(known) and np.atleast_1d(known["sigma"])[index] > 0))
    covariance = np.array([[float(x or 0) for x in row] for row in rows[1:]]).reshape(-1, len(rows[0]))
    return result, out, numbers, covariance


def moved(values, parameter, index, step):
    out = dict(values)
    if parameter.endswith("/pose"):
        out[parameter] = values[parameter] @ base.exp(step * np.eye(6)[index])
        return out
    size = {"curve": 96, "origin": 6, "ripple": 4, "compliance": 3, "load": 3}.get(parameter.rpartition("/")[2], 1)
    out[parameter] = np.array(values.get(parameter, np.zeros(size)), float)
    out[parameter][index] += step
    return out


def error_of(values, true, parameter, index):
    if parameter.endswith("/pose"):
        return base.log(base.inverse(true[parameter]) @ values[parameter])[index]
    return sum(sign * v[parameter][index] for sign, v in ((1, values), (-1, true)) if parameter in v)


def judge(arm, estimate, true, numbers, covariance, seen, moving, seed):
    """NEES of all that was estimated and of the terms alone, squares of predicted and actual error of places."""
    rng = np.random.default_rng(seed)
    readings = {n: rng.uniform(*l, FRESH) for n, l in zip(arm.names, arm.limits) if l}
    conditions = {"approach": {n: rng.choice([-1.0, 1.0], FRESH) for n in readings}, "warmer": rng.uniform(-10, 10, FRESH)}
    jacobian = np.zeros((3 * FRESH, len(numbers)))
    for i, (parameter, index, _) in enumerate(numbers):
        if parameter.rpartition("/")[2] in NOT_IN_PLACES:
            continue
        step = 1e-7 if parameter.endswith("/compliance") else 1e-5
        plus, minus = (arm.place(moved(estimate, parameter, index, s), readings, conditions, seen, moving) for s in (step, -step))
        jacobian[:, i] = np.ravel(plus - minus) / (2 * step)
    predicted = np.sum((jacobian @ covariance) * jacobian) / FRESH
    actual = np.sum((arm.place(estimate, readings, conditions, seen, moving) - arm.place(true, readings, conditions, seen, moving))**2) / FRESH
    which = [i for i, n in enumerate(numbers) if n[2]]
    terms = [i for i in which if numbers[i][0].rpartition("/")[2] in base.FURTHER]

    def nees(which):
        error = np.array([error_of(estimate, true, *numbers[i][:2]) for i in which])
        return error @ np.linalg.solve(covariance[np.ix_(which, which)], error) if which else 0

    return {"nees": nees(which), "numbers": len(which), "nees_terms": nees(terms), "terms": len(terms), "predicted": predicted, "actual": actual}


def groups_of(kind, names, joints):
    """What is to be found."""
    kind = kind.split()[0]
    return {"%s/%s" % (kind, names[j]) for j in joints} if kind in ("curve", "ripple") else {kind}


def measure(task):
    robot, kind, seed, options = task
    names, stands, moves = ROBOTS[robot]
    samples, joints, entry, spread = PLANTED[kind]
    joints = range(len(names)) if joints is None else joints
    folder = os.path.join(options.keep, ("%s_%s_%d" % (robot, kind, seed)).replace(" ", "_")) if options.keep else tempfile.mkdtemp()
    os.makedirs(folder, exist_ok=True)
    at = lambda *name: os.path.join(folder, *name)
    try:
        rig = make_rig(robot, stands, moves)
        arm = Arm(rig["robot"], stands, moves)
        true = json.loads(json.dumps(rig))
        true["joints"].update((names[j], entry) for j in joints if entry)
        if kind == "compliance":
            true["elasticity"] = {"compliance": {names[j]: [0, 0, 0] for j in joints}}
        write(at("true.yaml"), true)
        draw = OF_CAMERA * (robot == "camera") + [w.format("".join(c for c, a in zip("xyz", arm.axis_of(n)) if not a)) % n for n in names for w in USUAL]
        draw += [w % names[j] if "%s" in w else w for w in spread for j in joints]
        code, _, _, error = base.run(options.program, "simulate", at("true.yaml"), "--samples", str(samples), "--seed", str(seed), "--out", at("made"),
                                     "--force", "--quiet", *[a for d in draw for a in ("--spread", d)])
        if code:
            return {"robot": robot, "kind": kind, "seed": seed, "exit": code, "error": error}
        if kind == "ripple":
            rig["joints"].update((names[j], entry) for j in joints)
        write(at("rig.yaml"), rig)
        code, _, _, error = base.run(options.program, "calibrate", at("rig.yaml"), at("made", "samples.jsonl"), "--out", at("result"),
                                     "--force", "--no-report", "--quiet", "--threads", "1")
        outcome = {"robot": robot, "kind": kind, "seed": seed, "exit": code}
        if code not in (0, 5):
            return {**outcome, "error": error}
        result, estimate, numbers, covariance = estimates(at("result"))
        with open(at("made", "truth.json")) as f:
            truth = true_values(json.load(f))
        truth.update(("ratio/" + names[j], [entry["gear_ratio"]]) for j in joints if "gear_ratio" in entry)
        for n in names:
            if "joint/%s/ripple" % n in estimate and estimate["ratio/" + n] != truth.get("ratio/" + n):
                return {**outcome, "error": "ripple of %s: %s" % (n, estimate["ratio/" + n])}
        kept = {g["group"] for g in result["automatic"] if not g.get("held") and any(p in base.FURTHER for p in re.split("[/ ]", g["group"]))} | \
               {g["group"] for g in result["automatic"] if not g.get("held") and g["group"] in ("loads", "time offsets")}
        wanted = groups_of(kind, names, joints)
        seen, moving = ("target/board/pose", "sensor/camera/pose") if robot == "camera" else ("sensor/tracker/pose", "target/body/pose")
        judged = judge(arm, estimate, truth, numbers, covariance, seen, moving, seed)
        other = kept - wanted - ({"loads"} if kind == "compliance" else set())
        return {**outcome, "kept": sorted(kept), "found": len(wanted & kept) / len(wanted), "other": sorted(other), **judged}
    finally:
        if not options.keep:
            shutil.rmtree(folder)


def tell(outcomes):
    print("%-14s %-8s %6s %6s %6s %9s %9s %26s %6s" % ("kind", "robot", "robots", "kept", "other", "NEES/dof", "of terms", "predicted/actual (median)", "um"))
    for kind in PLANTED:
        for robot in (*ROBOTS, "all"):
            some = [o for o in outcomes if o["kind"] == kind and robot in (o["robot"], "all")]
            good = [o for o in some if "nees" in o]
            if good:
                ratios = [math.sqrt(o["predicted"] / o["actual"]) for o in good]
                per_number = lambda nees, numbers: sum(o[nees] for o in good) / max(1, sum(o[numbers] for o in good))
                print("%-14s %-8s %6d %5.0f%% %6d %9.2f %9.2f %19.2f (%.2f) %6.0f" % (
                    kind, robot, len(some), 100 * np.mean([o["found"] for o in good]), sum(bool(o["other"]) for o in good), 
                    per_number("nees", "numbers"), per_number("nees_terms", "terms"),
                    math.sqrt(sum(o["predicted"] for o in good) / sum(o["actual"] for o in good)), np.median(ratios),
                    1e6 * math.sqrt(np.mean([o["actual"] for o in good]))))
    for o in outcomes:
        if "error" in o:
            print("%s, %s, seed %d: exit %d: %s" % (o["kind"], o["robot"], o["seed"], o["exit"], o["error"].strip()))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=30, help="of each robot and kind")
    parser.add_argument("--seed", type=int, default=1, help="the first")
    parser.add_argument("--kind", choices=list(PLANTED), action="append")
    parser.add_argument("--robot", choices=list(ROBOTS), action="append")
    parser.add_argument("--keep", metavar="DIR", help="keep all files here")
    parser.add_argument("--program", metavar="PATH", default=os.path.join(ROOT, "build", "release", "kincal"))
    parser.add_argument("--jobs", type=int, default=1, help="robots at once")
    parser.add_argument("--json", metavar="FILE", help="write everything that was measured")
    options = parser.parse_args()
    tasks = [(r, k, options.seed + s, options) for k in options.kind or PLANTED for r in options.robot or ROBOTS for s in range(options.seeds)]
    tell(base.measured(measure, tasks, options))


if __name__ == "__main__":
    main()
