"""From recordings to calibrated robots: python3 benchmarks/recordings.py [KINCAL] [--seeds 10] [--first 1] [--robots arm,pr2] [--mcap] [--scale]

Records an arm with one camera and a PR2-like robot as `kincal simulate --bag` does, imports the recordings, calibrates, and compares with the
truth. For each robot and seed it prints chi2/dof, NEES/dof (e' C^-1 e over all that is freed, of the covariance that the result states), and the
offsets in time that the import found beside those that were simulated (0, 10, 20, 50 ms in turn); at the end means of all seeds beside the 99 %
intervals of that many numbers. ROS 1 bags and MCAP take turns. The sigmas of cameras in the rigs below are what averaging over images of a rest
leaves of the errors of corners in rendered pictures: `--scale` prints the sigma that would make chi2/dof 1, by which they were set, on seeds that are not judged (arm: 101 to 114,
PR2: 101 to 103). Needs kincal, kincal-render, kincal-detect's library and kincal-bags; no Python packages.
"""
import argparse
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
EXAMPLES = os.path.join(os.path.dirname(HERE), "examples")
DELAYS = [0.0, 0.01, 0.02, 0.05]

ARM_STEPS = """
estimate:
  - step: all
    free: [sensor/camera/pose, target/board/pose, joint/lift/offset, joint/bend/offset, joint/forearm_roll/offset, joint/wrist_bend/offset]
"""
ARM_TRUTH = {"joint/lift/offset": -0.0121, "joint/bend/offset": 0.0163, "joint/forearm_roll/offset": 0.0087, "joint/wrist_bend/offset": -0.0142,
             "sensor/camera/pose": [0.003, -0.002, 0.004, 0.01, -0.008, 0.006], "target/board/pose": [-0.004, 0.003, 0.002, -0.007, 0.009, 0.012]}
PR2_FREE = ["joint/head_pan_joint/offset", "joint/narrow_stereo_frame_joint/origin", "sensor/narrow_right/baseline", "joint/*_shoulder_*/offset", "joint/*_upper_arm_roll_joint/offset", "joint/*_elbow_flex_joint/offset",
            "joint/*_forearm_roll_joint/offset", "joint/*_wrist_*/offset", "joint/*_forearm_cam_frame_joint/origin"] + [
                "sensor/*_arm/pose." + c for c in ("x", "y", "z", "ry", "rz")]


def read(*path):
    with open(os.path.join(*path), encoding="utf-8") as file:
        return file.read()


def write(path, text):
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


def multiply(a, b):
    return [[sum(x * y for x, y in zip(row, column)) for column in zip(*b)] for row in a]


def pose_text(xi):
    """The rig's words for exp(xi), xi = translation and rotation of an increment from the identity."""
    v, w = xi[:3], xi[3:]
    angle = math.sqrt(sum(x * x for x in w))
    k = [[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]
    kk = multiply(k, k)
    b, c = (1 - math.cos(angle)) / angle ** 2, (angle - math.sin(angle)) / angle ** 3
    j = [[(i == n) + b * k[i][n] + c * kk[i][n] for n in range(3)] for i in range(3)]
    xyz = [sum(x * y for x, y in zip(row, v)) for row in j]
    quat = [math.sin(angle / 2) * x / angle for x in w] + [math.cos(angle / 2)]
    return "{xyz: [%.9g, %.9g, %.9g], quat: [%.12g, %.12g, %.12g, %.12g]}" % (*xyz, *quat)


def arm(folder):
    truth = json.loads(read(EXAMPLES, "arm", "truth.json"))["parameters"]
    pose = {name: [truth.get("%s/pose.%s" % (name, c), {"true": 0})["true"] for c in ("x", "y", "z", "rx", "ry", "rz")] for name in ("sensor/camera", "target/board")}
    rig = read(EXAMPLES, "arm", "rig.yaml").split("\npriors:")[0]
    rig = re.sub(r"sigma: 0\.005 .*", "sigma: %s\n    pose: %s" % (SIGMAS["arm"], pose_text(pose["sensor/camera"])), rig)
    rig = rig.replace("mount: {link: base}", "mount: {link: base, pose: %s}" % pose_text(pose["target/board"]))
    write(os.path.join(folder, "rig.yaml"), rig + ARM_STEPS)
    shutil.copy(os.path.join(EXAMPLES, "arm", "robot.urdf"), folder)
    shutil.copy(os.path.join(EXAMPLES, "arm", "postures.jsonl"), folder)
    write(os.path.join(folder, "truth_values.json"), json.dumps({"parameters": ARM_TRUTH}))
    return 16


def pr2(folder):
    rig = read(EXAMPLES, "pr2", "rig.yaml").split("\nestimate:")[0]
    rig = re.sub(r"\n  large_board:.*?(?=\nsensors:)", "\n", rig, flags=re.DOTALL)
    rig = re.sub(r"\n  wide_left:.*?(?=\n\n  # One camera in each forearm)", "", rig, flags=re.DOTALL)
    rig = re.sub(r"\n  tilt_laser:.*?(?=\n  # An arm that holds)", "\n", rig, flags=re.DOTALL)
    rig = rig.replace("sigma: 0.125", "sigma: %s" % SIGMAS["pr2"])
    rig += "\nestimate:\n  - step: all\n    free: [%s]\n" % ", ".join('"%s"' % f for f in PR2_FREE)
    write(os.path.join(folder, "rig.yaml"), rig)
    shutil.copy(os.path.join(EXAMPLES, "pr2", "robot.urdf"), folder)
    postures = [json.loads(line) for line in read(EXAMPLES, "pr2", "postures.jsonl").splitlines()]
    chosen = [p for side in ("left", "right") for p in [q for q in postures if q["id"].startswith(side)][:12]]
    for posture in chosen:
        posture["views"] = [v for v in posture["views"] if v["sensor"] != "tilt_laser" and not v["sensor"].startswith("wide")]
    write(os.path.join(folder, "postures.jsonl"), "".join(json.dumps(p) + "\n" for p in chosen))
    truth = json.loads(read(EXAMPLES, "pr2", "truth_values.json"))["parameters"]
    write(os.path.join(folder, "truth_values.json"), json.dumps({"parameters": {k: v for k, v in truth.items() if "laser" not in k and "wide" not in k}}))
    return len(chosen)


ROBOTS = {"arm": arm, "pr2": pr2}
SIGMAS = {"arm": 0.0008, "pr2": 0.0028}  # px, see above
# A recording of a rest is short here, to have many.
RECORDING = {"arm": ["--rest", "1.2", "--move", "1", "--frame-rate", "5"], "pr2": ["--rest", "1.2", "--move", "0.6", "--frame-rate", "5"]}


def solved(matrix, e):
    """e' M^-1 e of a symmetric positive definite M, by Cholesky."""
    n = len(e)
    low = [[0.0] * n for _ in range(n)]
    y = [0.0] * n
    for i in range(n):
        for j in range(i + 1):
            s = matrix[i][j] - sum(low[i][k] * low[j][k] for k in range(j))
            low[i][j] = math.sqrt(s) if i == j else s / low[j][j]
        y[i] = (e[i] - sum(low[i][k] * y[k] for k in range(i))) / low[i][i]
    return sum(v * v for v in y)


def components(name, value):
    if not isinstance(value, list):
        return {name: value}
    return dict(zip(["%s.%s" % (name, c) for c in ("x", "y", "z", "rx", "ry", "rz")], value)) if len(value) == 6 else {name: value[0]}


def nees(folder, result):
    truth = {}
    for name, value in json.loads(read(folder, "truth_values.json"))["parameters"].items():
        truth.update(components(name, value))
    found = {}
    for name, estimate in result["parameters"].items():
        value = estimate["value"]
        found.update(components(name, value if isinstance(value, list) else [value]))
    rows = read(folder, "result", "covariance.csv").splitlines()
    names = rows[0].split(",")
    covariance = [[float(x) for x in row.split(",")] for row in rows[1:]]
    e = [found[n] - truth.get(n, 0.0) for n in names]
    return solved(covariance, e), len(names)


def interval(dof):
    """99 % of chi2/dof, by Wilson and Hilferty."""
    return [(1 - 2 / (9 * dof) + z * math.sqrt(2 / (9 * dof))) ** 3 for z in (-2.5758, 2.5758)]


def run(kincal, *arguments, codes=(0,)):
    p = subprocess.run([kincal, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)
    if p.returncode not in codes:
        sys.exit(" ".join([kincal, *arguments]) + "\n" + p.stdout + p.stderr)
    return p.stdout + p.stderr


def view_squares(samples):
    """Squared sigmas of the views of cameras, px^2."""
    return [v["sigma"] ** 2 for line in read(samples).splitlines() for v in json.loads(line)["views"] if "pixels" in v and "sigma" in v]


def one(kincal, robot, seed, ending):
    with tempfile.TemporaryDirectory() as folder:
        count = ROBOTS[robot](folder)
        delay = DELAYS[seed % len(DELAYS)]
        path = lambda name: os.path.join(folder, name)
        run(kincal, "simulate", path("rig.yaml"), "--samples", str(count), "--seed", str(seed), "--truth", path("truth_values.json"), "--postures", path("postures.jsonl"),
            "--out", path("sim"), "--bag", path("a" + ending), "--camera-delay", str(delay), *RECORDING[robot])
        said = run(kincal, "import", path("a" + ending), "--rig", path("rig.yaml"), "--out", path("samples.jsonl"))
        run(kincal, "calibrate", path("rig.yaml"), path("samples.jsonl"), "--out", path("result"), "--quiet")
        result = json.loads(read(folder, "result", "result.json"))
        step = result["steps"][-1]
        offsets = [(float(a), float(b)) for a, b in re.findall(r"stamped (-?[\d.]+) \+- ([\d.]+) ms", said)]
        errors, numbers = nees(folder, result)
        return {"robot": robot, "seed": seed, "ending": ending, "samples": int(re.search(r": (\d+) samples\n", said).group(1)), "chi2": step["chi2"], "dof": step["dof"],
                "nees": errors, "numbers": numbers, "squares": view_squares(path("samples.jsonl")), "delay": 1e3 * delay, "offsets": offsets, "clocks": said.count("THE CLOCK")}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("kincal", nargs="?", default=os.path.join(os.path.dirname(HERE), "build", "release", "kincal"))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--robots", default="arm,pr2")
    parser.add_argument("--scale", action="store_true")
    a = parser.parse_args()
    for robot in a.robots.split(","):
        all_runs = []
        for seed in range(a.first, a.first + a.seeds):
            r = one(a.kincal, robot, seed, ".bag" if seed % 2 else ".mcap")
            all_runs.append(r)
            worst = max(r["offsets"], key=lambda o: abs(o[0] - r["delay"]), default=(math.nan, math.nan))
            sigmas = max((abs(o - r["delay"]) / s for o, s in r["offsets"] if s > 0), default=math.nan)
            print("%s %s seed %d: %d samples, chi2/dof %.3f (%d), NEES/dof %.3f (%d), offset %g ms: %d cameras, worst %.2f +- %.2f ms, %.1f sigmas at most%s"
                  % (robot, r["ending"], seed, r["samples"], r["chi2"] / r["dof"], r["dof"], r["nees"] / r["numbers"], r["numbers"], r["delay"], len(r["offsets"]), *worst, sigmas,
                     "; A CLOCK IS CALLED UNSTEADY" if r["clocks"] else ""), flush=True)
        total = lambda key: sum(r[key] for r in all_runs)
        offsets = [(o - r["delay"], s) for r in all_runs for o, s in r["offsets"]]
        print("%s, %d seeds: chi2/dof %.4f [%.4f, %.4f], NEES/dof %.3f [%.3f, %.3f]; offsets: rms of error %.3f ms, worst %.3f ms, mean of (error / sigma)^2 %.2f"
              % (robot, len(all_runs), total("chi2") / total("dof"), *interval(total("dof")), total("nees") / total("numbers"), *interval(total("numbers")),
                 math.sqrt(sum(e * e for e, _ in offsets) / len(offsets)), max(abs(e) for e, _ in offsets), sum((e / s) ** 2 for e, s in offsets if s > 0) / len(offsets)))
        if a.scale:
            # A view's sigma^2 is scatter^2 / n + the rig's sigma^2, and only the rig's can be wrong.
            squares = [s for r in all_runs for s in r["squares"]]
            mean = sum(squares) / len(squares)
            own = SIGMAS[robot] ** 2 + (total("chi2") / total("dof") - 1) * mean
            print("  views have %.4f px (rms), the rig %.4f of it; chi2/dof would be 1 with about %.4f" % (math.sqrt(mean), SIGMAS[robot], math.sqrt(max(0, own))))


if __name__ == "__main__":
    main()
