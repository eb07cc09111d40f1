"""Many samples, and one that cannot be evaluated, through the program: python3 many_samples_test.py SOURCE_DIR KINCAL [TEST ...]

Memory: the simulated PR2 of examples/pr2, everything freed in one step, with 3,000 and 9,000 samples. What a further sample takes beyond its line
in the file is bounded, and 9,000 samples take no more iterations. (Not proven: time, which is benchmarks' business; other rigs, whose samples
have more or less in them.) Progress: on a terminal every stage that lasts has a share.
"""

import json
import math
import os
import pty
import re
import subprocess
import sys
import unittest

from helpers import Folder, revolute

SOURCE_DIR = KINCAL = None


class ManySamples(Folder):
    MOST = 10e3  # bytes a sample beyond its line

    def rig(self):
        """The example's rig with the one step `all`, which frees what its steps free."""
        example = os.path.join(SOURCE_DIR, "examples", "pr2")
        with open(os.path.join(example, "rig.yaml"), encoding="utf-8") as file:
            text = file.read().replace("robot: robot.urdf", "robot: " + os.path.join(example, "robot.urdf"))
        start = text.index("\nestimate:")
        steps = text[start:]
        last = steps[steps.rindex("\n  - step:"):]
        return self.write("rig.yaml", text[:start] + "\nestimate:" + last), os.path.join(example, "postures.jsonl")

    def calibrated(self, rig, postures, count):
        """result.json, the largest memory of the process, and the size of its samples file, bytes."""
        name = "s%d" % count
        made = subprocess.run([KINCAL, "simulate", rig, "--samples", str(count), "--seed", "3", "--postures", postures, "--out", self.path(name), "--quiet"],
                              capture_output=True, text=True)
        self.assertEqual(made.returncode, 0, made.stderr)
        samples, out = self.path(name, "samples.jsonl"), self.path("out%d" % count)
        pid = os.fork()
        if pid == 0:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, 1)
            os.dup2(null, 2)
            os.execv(KINCAL, [KINCAL, "calibrate", rig, samples, "--out", out, "--no-report"])
        _, status, used = os.wait4(pid, 0)
        self.assertEqual(os.WEXITSTATUS(status), 0)
        with open(os.path.join(out, "result.json"), encoding="utf-8") as file:
            text = file.read()
        self.assertLess(len(text), 200e3)  # what is of single samples stands in samples.csv
        return json.loads(text), used.ru_maxrss * 1024, os.path.getsize(samples)

    def test_memory(self):
        rig, postures = self.rig()
        few, many = (self.calibrated(rig, postures, count) for count in (3000, 9000))
        each = ((many[1] - many[2]) - (few[1] - few[2])) / 6000
        self.assertLess(each, self.MOST)
        iterations = [sum(step["iterations"] for step in result["steps"]) for result in (few[0], many[0])]
        self.assertLessEqual(iterations[1], iterations[0] + 1)

    def test_progress(self):
        """Lines on a terminal, with a share of starting values and residuals (uncertainties are done before a second line is due)."""
        rig, postures = self.rig()
        subprocess.run([KINCAL, "simulate", rig, "--samples", "1500", "--seed", "4", "--postures", postures, "--out", self.path("s"), "--quiet"], check=True,
                       stdout=subprocess.DEVNULL)
        pid, terminal = pty.fork()
        if pid == 0:
            os.execv(KINCAL, [KINCAL, "calibrate", rig, self.path("s", "samples.jsonl"), "--out", self.path("out"), "--no-report"])
        text = b""
        while True:
            try:
                part = os.read(terminal, 65536)
            except OSError:  # the other end is closed
                break
            if not part:
                break
            text += part
        os.close(terminal)
        self.assertEqual(os.WEXITSTATUS(os.waitpid(pid, 0)[1]), 0)
        lines = re.sub(r"\x1b\[K", "", text.decode("utf-8")).split("\r")
        for stage in ("starting values", "uncertainties and residuals"):
            self.assertTrue(any(re.match(r"(all: )?%s \d+ %%" % stage, line) for line in lines), stage)
        self.assertFalse([line for line in lines if "100 %" in line])  # a stage that is done is gone


class Behind(Folder):
    """A camera that pans before a board: where a reading is half a turn off the board is behind it."""

    def setUp(self):
        super().setUp()
        self.write("robot.urdf", '<robot name="r"><link name="base"/>%s</robot>' % "".join(revolute([("pan", "head", "0 0 1", "0 0 1")], "base", 3.2)))
        self.write("rig.yaml", """format: kincal/1
robot: robot.urdf
base: base
targets:
  board: {type: chessboard, rows: 4, columns: 5, square: 0.05, mount: {link: base, pose: {xyz: [1.5, 0.1, 0.9], rpy: [-1.5707963, 0, -1.5707963]}}}
sensors:
  eye: {type: camera, link: head, pose: {xyz: [0.05, 0, 0], rpy: [-1.5707963, 0, -1.5707963]}, model: pinhole, image_size: [640, 480],
        intrinsics: [500, 500, 320, 240], sigma: 0.2}
estimate:
  - {step: pose, free: [sensor/eye/pose]}
""")
        postures = self.write("postures.jsonl", "".join(json.dumps({"id": "s%d" % i, "joints": {"pan": 0.04 * i - 0.1}, "views": [
            {"sensor": "eye", "target": "board"}]}) + "\n" for i in range(6)))
        self.kincal("simulate", "rig.yaml", "--samples", "6", "--seed", "1", "--postures", postures, "--out", "made", "--quiet")
        self.samples = [json.loads(line) for line in self.read("made", "samples.jsonl").splitlines()]

    def kincal(self, *args, code=0):
        p = subprocess.run([KINCAL, *args], cwd=self.dir, capture_output=True, text=True)
        self.assertEqual(p.returncode, code, p.stderr)
        return p

    def evaluate(self, turned, code=0):
        for i in turned:
            self.samples[i]["joints"]["pan"] += math.pi
        self.write("samples.jsonl", "".join(json.dumps(s) + "\n" for s in self.samples))
        return self.kincal("evaluate", "rig.yaml", "samples.jsonl", "--json", code=code)

    def test_one(self):
        """It is named and left out; the others' numbers are what they are without it."""
        alone = self.samples[:2] + self.samples[3:]
        run = self.evaluate([2])
        found = json.loads(run.stdout)
        self.assertEqual([w["id"] for w in found["warnings"]], ["undefined"])
        self.assertEqual(found["warnings"][0]["names"], ["s2"])
        self.assertIn("sample 's2' cannot be evaluated", run.stderr)
        self.samples = alone
        without = json.loads(self.evaluate([]).stdout)
        self.assertEqual(without["warnings"], [])
        self.assertEqual(found["sensors"], without["sensors"])
        self.assertEqual((found["chi2"], found["dof"]), (without["chi2"], without["dof"]))

    def test_all(self):
        run = self.evaluate(range(6), code=1)
        self.assertEqual(run.stdout, "")
        self.assertIn("no sample can be evaluated: in 's0' a point lies behind a camera", run.stderr)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    SOURCE_DIR, KINCAL = (os.path.abspath(p) for p in sys.argv[1:3])
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:])
