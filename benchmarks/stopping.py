#!/usr/bin/env python3
"""When does a minimisation stop, and does it stop in the right place? Simulated sets with explicit steps.

    benchmarks/stopping.py                             # 1000 sets
    benchmarks/stopping.py --sets 100 --json out.json  # the same mixture, and everything that was measured
    benchmarks/stopping.py --sets 100 --reference --reference-arguments "--some-option NAME=VALUE"

With --reference every set is calibrated a second time, with these arguments added; words of the form NAME=VALUE go into the environment. Told is
the largest difference of a parameter, in its sigmas. What switches the stop rule off is to be named so.

  pr2-20 to pr2-1000    examples/pr2, so many samples of its postures in a random order, the far boards always among them
  pr2-simulated         the data set of that name, its postures; looked for in $KINCAL_DATA, else in ../shared/data beside the repository
  hand, tracker         random arms of automatic.py with a camera in the hand, or a tracker; mounts first, then everything that is wrong, with priors

Of the first two half have the truth that comes with the rig, half one that is drawn in what the steps free. In every tenth set of a kind the truth
is moved in what the steps hold: the model cannot explain it (lines with `unexplained`), and exit code 5 is right as well as 0. It needs numpy, scipy and PyYAML.
"""
import argparse
import json
import os
import re
import shlex
import shutil
import tempfile
import types

import automatic
import numpy as np

ROOT = automatic.ROOT
PR2 = os.path.join(ROOT, "examples", "pr2")
SIMULATED = os.path.join(os.environ.get("KINCAL_DATA", os.path.join(ROOT, "..", "shared", "data")), "pr2-simulated")
SHARES = {"pr2-20": 200, "pr2-60": 200, "pr2-100": 100, "pr2-200": 60, "pr2-1000": 10, "pr2-simulated": 130, "hand": 150, "tracker": 150}

UNEXPLAINED = ["joint/*/offset=0.02", "sensor/*/pose=0.02"]
FREED = ["joint/head_pan_joint/offset=0.02", "joint/*_stereo_frame_joint/origin=0.01", "sensor/narrow_right/baseline=0.001",
         "sensor/wide_right/baseline=0.001", "joint/laser_tilt_joint/origin.z=0.005", "joint/laser_tilt_joint/origin.rz=0.01", "joint/*_shoulder_*/offset=0.02",
         "joint/*_upper_arm_roll_joint/offset=0.02", "joint/*_elbow_flex_joint/offset=0.02", "joint/*_forearm_roll_joint/offset=0.02",
         "joint/*_wrist_flex_joint/offset=0.02", "joint/*_wrist_roll_joint/offset=0.02", "joint/*_forearm_cam_frame_joint/origin=0.01",
         "sensor/*_arm/pose.[xyz]=0.005", "sensor/*_arm/pose.r[yz]=0.01"]
FREED_EXAMPLE = FREED + ["joint/laser_tilt_mount_joint/offset=0.01", "joint/laser_tilt_mount_joint/scale=0.01", "joint/laser_tilt_joint/origin.rx=0.01"]
FREED_SIMULATED = FREED + ["joint/laser_tilt_mount_joint/origin.ry=0.01"]


def read_lines(path):
    with open(path) as f:
        return [json.loads(line) for line in f if line.strip()]


def postures_of(kind):
    """Postures of the example, or those of the data set, put together from its samples and its truth."""
    if kind != "pr2-simulated":
        return read_lines(os.path.join(PR2, "postures.jsonl"))
    with open(os.path.join(SIMULATED, "truth.json")) as f:
        truth = {s["id"]: s for s in json.load(f)["samples"]}
    postures = []
    for sample in read_lines(os.path.join(SIMULATED, "samples.jsonl")):
        true = truth[sample["id"]]
        posture = {"id": sample["id"], "joints": true["joints"], "views": [{"sensor": v["sensor"], "target": v["target"]} for v in sample["views"]]}
        if not any(v["sensor"].endswith("_arm") for v in sample["views"]):
            posture["targets"] = {true["target"]: true["base_T_target"]}
        postures.append(posture)
    return postures


def make_pr2(folder, kind, seed, unexplained, kincal):
    """Rig and samples of a PR2. Far boards stand first, so that few samples have them, too; the rest is in a random order."""
    home, truth = (SIMULATED, "truth.json") if kind == "pr2-simulated" else (PR2, "truth_values.json")
    postures = postures_of(kind)
    far, near = [p for p in postures if "targets" in p], [p for p in postures if "targets" not in p]
    order = np.random.default_rng(seed).permutation(len(near))
    path = os.path.join(folder, "postures.jsonl")
    with open(path, "w") as f:
        f.writelines(json.dumps(p) + "\n" for p in far + [near[i] for i in order])
    count = len(postures) if kind == "pr2-simulated" else int(kind.split("-")[1])
    if unexplained:
        spread = UNEXPLAINED
    else:
        spread = [] if seed % 2 == 0 else FREED_SIMULATED if kind == "pr2-simulated" else FREED_EXAMPLE
    what = [a for s in spread for a in ("--spread", s)] or ["--truth", os.path.join(home, truth)]
    out, rig = os.path.join(folder, "data"), os.path.join(home, "rig.yaml")
    code, _, _, error = automatic.run(kincal, "simulate", rig, "--samples", str(count), "--seed", str(seed), "--postures", path, "--out", out, *what)
    if code:
        raise SystemExit("simulate: exit %d: %s" % (code, error))
    return rig, os.path.join(out, "samples.jsonl")


def make_arm(folder, kind, seed, unexplained):
    """Rig and samples of a random arm. One that its model cannot explain has joint offsets of 10 or 20 mrad, and only its mounts are freed."""
    case = automatic.draw_case(seed, kind, False, True)
    for attempt in range(1, 1000):
        if not unexplained or case.wrong["offset"] >= 0.01:
            break
        case = automatic.draw_case(seed + 1000000 * attempt, kind, False, True)
    automatic.write_case(folder, case, types.SimpleNamespace(mounts_only=unexplained, known=not unexplained, exact=False))
    return os.path.join(folder, "rig.yaml"), os.path.join(folder, "samples.jsonl")


def calibrate(kincal, rig, samples, out, words):
    """One calibration: exit code, CPU seconds, and its result.json or None."""
    settings = [w for w in words if re.match(r"[A-Za-z_]\w*=", w)]
    environment = dict(os.environ, **dict(w.split("=", 1) for w in settings))
    code, seconds, _, error = automatic.run(kincal, "calibrate", rig, samples, "--out", out, "--no-report", "--quiet", "--threads", "1",
                                            *[w for w in words if w not in settings], environment=environment)
    if code == 1:
        raise SystemExit("calibrate: " + error)
    path = os.path.join(out, "result.json")
    if not os.path.exists(path):
        return code, seconds, None
    with open(path) as f:
        return code, seconds, json.load(f)


def furthest(a, b):
    """Component in which two results of the same data differ most, and by how many sigmas. Numbers without a sigma do not count."""
    worst = (0.0, "none")
    for name, p in a["parameters"].items():
        other = b["parameters"].get(name)
        for i, sigma in enumerate(p["sigma"]):
            if sigma and other:
                worst = max(worst, (abs(p["value"][i] - other["value"][i]) / sigma, "%s[%d]" % (name, i)))
    return worst


def measure(task):
    """One set, made, calibrated, and with a reference calibrated again."""
    kind, seed, unexplained, options = task
    outcome = {"kind": kind, "seed": seed, "unexplained": unexplained}
    folder = os.path.join(options.keep, "%s_%d" % (kind, seed)) if options.keep else tempfile.mkdtemp()
    try:
        if options.keep:
            shutil.rmtree(folder, ignore_errors=True)
            os.makedirs(folder)
        rig, samples = make_pr2(folder, kind, seed, unexplained, options.kincal) if kind.startswith("pr2") else make_arm(folder, kind, seed, unexplained)
        code, seconds, result = calibrate(options.kincal, rig, samples, os.path.join(folder, "result"), [])
        outcome.update(exit=code, seconds=seconds)
        if result:
            outcome["chi2_per_dof"] = result["chi2"] / max(1, result["dof"])
            outcome["steps"] = [[s["step"], s["status"], s["iterations"]] for s in result["steps"]]
        if options.reference:
            code, seconds, reference = calibrate(options.kincal, rig, samples, os.path.join(folder, "reference"), shlex.split(options.reference_arguments))
            outcome.update(reference_exit=code, reference_seconds=seconds)
            if result and reference:
                outcome["reference_chi2_per_dof"] = reference["chi2"] / max(1, reference["dof"])
                outcome["reference_steps"] = [[s["step"], s["status"], s["iterations"]] for s in reference["steps"]]
                outcome["difference"], outcome["differs_in"] = furthest(result, reference)
        return outcome
    finally:
        if not options.keep:
            shutil.rmtree(folder)


def mixture(count):
    """Kinds of so many sets, in shares as stated, the one that lacks most next: (kind, how many of it there were)."""
    shares = dict(SHARES)
    if not os.path.isdir(SIMULATED):
        print("pr2-simulated is left out: %s is not there" % SIMULATED)
        del shares["pr2-simulated"]
    total, made, order = sum(shares.values()), dict.fromkeys(shares, 0), []
    for i in range(count):
        kind = max(shares, key=lambda k: (i + 1) * shares[k] / total - made[k])
        order.append((kind, made[kind]))
        made[kind] += 1
    return order


def iterations(steps):
    return "%6.1f %5.0f %5d" % (np.median(steps), np.percentile(steps, 95), max(steps)) if steps else "-"


def tell(outcomes, options):
    titles = sorted({(list(SHARES).index(o["kind"]), o["unexplained"]) for o in outcomes}, key=lambda t: (t[1], t[0]))
    groups = []
    for k, bad in titles:
        kind = list(SHARES)[k]
        groups.append((kind + ", unexplained" * bad, [o for o in outcomes if o["kind"] == kind and o["unexplained"] == bad]))
    groups += [("all", [o for o in outcomes if not o["unexplained"]]), ("all, unexplained", [o for o in outcomes if o["unexplained"]])]
    print("%-28s %5s  %-26s %-34s %9s %9s  %s" % ("kind", "sets", "exit codes: sets", "chi2/dof: median (5 to 95 %)", "CPU, s", "worst",
                                                 "iterations of a step: median, 95 %, worst"))
    for title, group in groups:
        if group:
            codes = {c: sum(o["exit"] == c for o in group) for c in sorted({o["exit"] for o in group})}
            levels = [o["chi2_per_dof"] for o in group if "steps" in o]
            print("%-28s %5d  %-26s %-34s %9.3f %9.3f  %s" % (title, len(group), ", ".join("%d: %d" % c for c in codes.items()),
                  "%.4g (%.4g to %.4g)" % tuple(np.percentile(levels, [50, 5, 95])) if levels else "-", np.mean([o["seconds"] for o in group]),
                  max(o["seconds"] for o in group), iterations([s[2] for o in group for s in o.get("steps", [])])))
    print("\nIterations by step: median, 95 %, worst")
    for title, group in groups[:-2]:
        names = dict.fromkeys(s[0] for o in group for s in o.get("steps", []))
        print("%-28s %s" % (title, "; ".join("%s %s" % (n, iterations([s[2] for o in group for s in o.get("steps", []) if s[0] == n])) for n in names)))
    bad = [o for o in outcomes if o["exit"] != 0 and not o["unexplained"]]
    print("\nOther exit codes than 0 where the model explains the data: %d sets" % len(bad))
    for o in bad:
        print("  %s, seed %d: exit %d, steps not converged: %s" % (o["kind"], o["seed"], o["exit"], [s[0] for s in o.get("steps", []) if s[1] != "converged"]))
    if not options.reference:
        return
    print("\nBeside the reference (%s)" % options.reference_arguments)
    # 0 and 5 both converged: an older reference does not judge whether the model explains the data.
    print("%-28s %8s %14s %14s %16s  %s" % ("kind", "compared", "other exit", "CPU, s", "iterations", "largest difference, sigmas: median, 95 %, worst"))
    for title, group in groups:
        both = [o for o in group if "difference" in o]
        if both:
            differences = [o["difference"] for o in both]
            worst = max(both, key=lambda o: o["difference"])
            steps = [s[2] for o in both for s in o["reference_steps"]]
            print("%-28s %8d %14d %14.3f %16s  %.2g, %.2g, %.2g (%s, seed %d, %s)" % (
                title, len(both), sum(o["exit"] % 5 != o["reference_exit"] % 5 for o in group), np.mean([o["reference_seconds"] for o in both]), iterations(steps).strip(),
                np.median(differences), np.percentile(differences, 95), worst["difference"], worst["kind"], worst["seed"], worst["differs_in"]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0, help="of the first set of each kind; the next has the number after it")
    parser.add_argument("--kind", choices=list(SHARES), help="only the sets of this kind")
    parser.add_argument("--reference", action="store_true", help="calibrate each set a second time")
    parser.add_argument("--reference-arguments", metavar="WORDS", default="", help="what the second time has besides")
    parser.add_argument("--keep", metavar="DIR", help="keep each set's files and results here")
    parser.add_argument("--kincal", metavar="PATH", default=os.path.join(ROOT, "build", "release", "kincal"))
    parser.add_argument("--jobs", type=int, default=1, help="sets at once")
    parser.add_argument("--json", metavar="FILE", help="write everything that was measured")
    options = parser.parse_args()
    tasks = [(kind, options.seed + number, number % 10 == 5, options) for kind, number in mixture(options.sets) if options.kind in (None, kind)]
    tell(automatic.measured(measure, tasks, options), options)


if __name__ == "__main__":
    main()
