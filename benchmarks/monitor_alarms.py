#!/usr/bin/env python3
"""False alarms of `kincal monitor` on robots that stay as they were calibrated: monitor_alarms.py KINCAL

Each robot of an example is simulated with its own noise (and, of the arm, postures), calibrated from its first samples and monitored over the following ones. Stated is
one false alarm in 10,000 samples. Prints the number of robots with an alarm beside the expected one, and the 95 % interval of the share.
"""
import argparse
import json
import math
import pathlib
import subprocess
import tempfile

EXAMPLES = pathlib.Path(__file__).resolve().parent.parent / "examples"
EVERY = 10000
CALIBRATED = {"arm": 30, "pr2": 64}
TRUTH = {"arm": "truth.json", "pr2": "truth_values.json"}


def simulate(program, robot, seed, samples, folder):
    command = [program, "simulate", EXAMPLES / robot / "rig.yaml", "--samples", samples, "--seed", seed, "--out", folder / "data"]
    command += ["--truth", EXAMPLES / robot / TRUTH[robot]]
    if robot == "pr2":  # each posture of the example again and again
        postures = [json.loads(line) for line in (EXAMPLES / robot / "postures.jsonl").read_text().splitlines()]
        again = [dict(postures[i % len(postures)], id=f"s{i}") for i in range(samples)]
        (folder / "postures.jsonl").write_text("".join(json.dumps(p) + "\n" for p in again))
        command += ["--postures", folder / "postures.jsonl"]
    subprocess.run([str(c) for c in command], check=True, capture_output=True)
    return (folder / "data" / "samples.jsonl").read_text().splitlines(keepends=True)


def alarm(program, robot, seed, samples):
    """Whether a healthy robot raises one; None: it could not be calibrated."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        first = CALIBRATED[robot]
        lines = simulate(program, robot, seed, first + samples, folder)
        (folder / "first.jsonl").write_text("".join(lines[:first]))
        (folder / "later.jsonl").write_text("".join(lines[first:]))
        calibrated = subprocess.run([program, "calibrate", EXAMPLES / robot / "rig.yaml", folder / "first.jsonl", "--out", folder / "result"], capture_output=True)
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
