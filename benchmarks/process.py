#!/usr/bin/env python3
"""CPU of whole processes, from files to files: python3 benchmarks/process.py [--kincal build/release/kincal] [--set DIR] [--runs 5]

Of a set with a rig.yaml and samples.jsonl (../shared/data/pr2-simulated beside the source): `calibrate --no-report --threads 1`, and
`check` as it is, with a joint's sign and with two samples' readings exchanged, in turns. Prints seconds of CPU (user and system): the
least and the median of the runs.
"""
import argparse
import json
import os
import statistics
import subprocess
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def seconds(command):
    """Of CPU, of a program that ends with 0."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = status
    if status != 0:
        raise SystemExit("failed: " + " ".join(command))
    return usage.ru_utime + usage.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kincal", default=os.path.join(ROOT, "build", "release", "kincal"))
    parser.add_argument("--set", default=os.path.join(ROOT, "..", "shared", "data", "pr2-simulated"))
    parser.add_argument("--runs", type=int, default=5)
    a = parser.parse_args()
    rig, clean = os.path.join(a.set, "rig.yaml"), os.path.join(a.set, "samples.jsonl")
    with open(clean, encoding="utf-8") as file:
        samples = [json.loads(line) for line in file]
    with tempfile.TemporaryDirectory() as folder:
        def spoilt(name, joints):
            path = os.path.join(folder, name + ".jsonl")
            with open(path, "w", encoding="utf-8") as file:
                for sample, values in zip(samples, joints):
                    file.write(json.dumps(dict(sample, joints=values)) + "\n")
            return path
        readings = [s["joints"] for s in samples]
        turned = max(readings[0], key=lambda name: min(abs(q.get(name, 0)) for q in readings[:5]))
        sign = [{name: -value if name == turned else value for name, value in q.items()} for q in readings]
        other = next(i for i, q in enumerate(readings) if i > 0 and set(q) == set(readings[0]))
        exchanged = [readings[other]] + readings[1:other] + [readings[0]] + readings[other + 1:]
        commands = {"calibrate": ["calibrate", rig, clean, "--no-report", "--threads", "1", "--force", "--out", os.path.join(folder, "out")],
                    "check": ["check", rig, clean], "check, sign of " + turned: ["check", rig, spoilt("sign", sign)],
                    "check, readings exchanged": ["check", rig, spoilt("exchanged", exchanged)]}
        found = {name: [] for name in commands}
        for _ in range(a.runs):
            for name, command in commands.items():
                found[name].append(seconds([a.kincal] + command))
    for name, values in found.items():
        print("%-45s %.3f s, median %.3f s" % (name, min(values), statistics.median(values)))


if __name__ == "__main__":
    main()
