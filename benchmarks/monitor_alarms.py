#!/usr/bin/env python3
"""False alarms of `kincal monitor` on robots that stay as they were calibrated: monitor_alarms.py KINCAL

Each robot is an example (`tracker`: the arm of the example, with three reflectors on its flange and a tracker), simulated with its own noise (and postures, but for pr2),
calibrated from its first samples and monitored over the following ones. Stated is one false alarm in 10,000 samples. Prints the number of robots with an alarm beside the expected one, and the 95 % interval of the share.
"""
import argparse
import json
import math
import pathlib
import subprocess
import tempfile

EXAMPLES = pathlib.Path(__file__).resolve().parent.parent / "examples"
EVERY = 10000
CALIBRATED = {"arm": 30, "pr2": 64, "tracker": 40}
TRUTH = {"arm": "truth.json", "pr2": "truth_values.json"}
TRACKER = {"joint/lift/offset": -0.012, "joint/bend/offset": 0.016, "sensor/tracker/pose": [2, 0.5, 0.2, 0, 0, 3], "target/reflectors/pose": [0.06, 0.02, 0.05, 0, 0, 0]}


def files(program, robot, folder):
    """The rig and the truth."""
    if robot != "tracker":
        return EXAMPLES / robot / "rig.yaml", EXAMPLES / robot / TRUTH[robot]
    subprocess.run([program, "init", str(EXAMPLES / "arm" / "robot.urdf"), "--sensor", "point:base:tracker", "--target", "points:0,0,0;0.1,0,0;0,0.1,0.05@flange:reflectors",
                    "--out", str(folder / "rig.yaml")], check=True, capture_output=True)
    (folder / "truth.json").write_text(json.dumps({"parameters": TRACKER}))
    return folder / "rig.yaml", folder / "truth.json"


def simulate(program, robot, seed, samples, folder):
    rig, truth = files(program, robot, folder)
    command = [program, "simulate", rig, "--samples", samples, "--seed", seed, "--out", folder / "data", "--truth", truth]
    if robot == "pr2":  # each posture of the example again and again
        postures = [json.loads(line) for line in (EXAMPLES / robot / "postures.jsonl").read_text().splitlines()]
        again = [dict(postures[i % len(postures)], id=f"s{i}") for i in range(samples)]
        (folder / "postures.jsonl").write_text("".join(json.dumps(p) + "\n" for p in again))
        command += ["--postures", folder / "postures.jsonl"]
    subprocess.run([str(c) for c in command], check=True, capture_output=True)
    return rig, (folder / "data" / "samples.jsonl").read_text().splitlines(keepends=True)


def alarm(program, robot, seed, samples):
    """Whether a healthy robot raises one; None: it could not be calibrated."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        first = CALIBRATED[robot]
        rig, lines = simulate(program, robot, seed, first + samples, folder)
        (folder / "first.jsonl").write_text("".join(lines[:first]))
        (folder / "later.jsonl").write_text("".join(lines[first:]))
        calibrated = subprocess.run([program, "calibrate", rig, folder / "first.jsonl", "--out", folder / "result", "--no-report"], capture_output=True)
        if calibrated.returncode != 0:
            return None
        told = subprocess.run([program, "monitor", folder / "result", folder / "later.jsonl", "--quiet"], capture_output=True)
        if told.returncode not in (0, 5, 6):
            raise RuntimeError(told.stderr.decode())
        return told.returncode != 0


def interval(found, of):
    """Wilson's, 95 %."""
    z, share = 1.96, found / of
    middle, half = share + z * z / (2 * of), z * math.sqrt(share * (1 - share) / of + z * z / (4 * of * of))
    return (middle - half) / (1 + z * z / of), (middle + half) / (1 + z * z / of)


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("program")
parser.add_argument("--robots", type=int, default=100)
parser.add_argument("--samples", type=int, default=2000)
parser.add_argument("--robot", choices=sorted(CALIBRATED), default="arm")
given = parser.parse_args()
program = str(pathlib.Path(given.program).resolve())
alarms = [alarm(program, given.robot, 1000 + i, given.samples) for i in range(given.robots)]
judged = [a for a in alarms if a is not None]
low, high = interval(sum(judged), len(judged))
expected = 1 - math.exp(-given.samples / EVERY)
print(f"{given.robot}: {sum(judged)} of {len(judged)} robots with an alarm in {given.samples} samples, {100 * sum(judged) / len(judged):.1f} % "
      f"({100 * low:.1f} to {100 * high:.1f} %); stated {100 * expected:.1f} %; {len(alarms) - len(judged)} not calibrated")
