#!/usr/bin/env python3
"""Seconds of the tests by layer, after scripts/test: benchmarks/test_times.py [BUILD] > docs/results/test_times.csv

Reads ctest's log of its last run (in BUILD, by default build/release). Two tests run at a time on two processors, so the sum is twice the
wall time. Tests of real data count only where they ran.
"""

import collections
import os
import re
import sys

LAYERS = [  # (how a test's name begins, layer); the first that fits
    ("reference.", "beside the independent reference"), ("instruction_sets.", "unit tests with other instruction sets"), ("c.", "C"),
    ("python.", "Python"), ("fuzz.", "malformed texts"), ("install.", "installed package"), ("deb.", "installed package"),
    ("package.", "installed package"), ("documents", "documents"), ("structure", "sources"), ("words", "sources")]


def layer(name, programs):
    for begin, of in LAYERS:
        if name.startswith(begin):
            return of
    begin = name.split(".")[0]
    return "program: " + begin if begin in programs and ": " not in name else "unit tests"


def main():
    root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    build = sys.argv[1] if len(sys.argv) > 1 else os.path.join(root, "build", "release")
    programs = {f[:-len("_test.py")] for f in os.listdir(os.path.join(root, "tests", "program")) if f.endswith("_test.py")}
    count, seconds = collections.Counter(), collections.Counter()
    with open(os.path.join(build, "Testing", "Temporary", "LastTest.log"), encoding="utf-8", errors="replace") as f:
        for name, cost in re.findall(r"^\d+/\d+ Testing: (.*?)$.*?^Test time = +([\d.]+) sec$", f.read(), re.MULTILINE | re.DOTALL):
            count[layer(name, programs)] += 1
            seconds[layer(name, programs)] += float(cost)
    print("layer,tests,seconds")
    for of, s in seconds.most_common():
        print(f"{of},{count[of]},{s:.0f}")
    print(f"all,{sum(count.values())},{sum(seconds.values()):.0f}")


if __name__ == "__main__":
    main()
