"""Lenses and ranges from samples to the truth: python3 lenses_test.py SOURCE_DIR KINCAL [TEST ...]

Proves: `simulate` -> `calibrate` gives the truth within the stated covariance (e' C^-1 e of four robots in its 99.9 % interval) for the unified and the double sphere camera, Brown-Conrady
of 12 and 14 numbers, a depth camera with scale and offset of its range, and a floor that one sees and a tip touches; the page and `show` name their numbers; the automatic path estimates a range that the rig states. Not
proved: real sensors. Thirty robots of each are in benchmarks/lenses.py, whose robots these are.
"""
import importlib.util
import json
import os
import subprocess
import sys
import unittest

import yaml

import helpers

SOURCE_DIR = KINCAL = None


def benchmark():
    spec = importlib.util.spec_from_file_location("lenses", os.path.join(SOURCE_DIR, "benchmarks", "lenses.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Truth(helpers.Folder):
    def run_kincal(self, *arguments):
        return subprocess.run([KINCAL, *arguments], cwd=self.dir, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True).stdout

    def near(self, kind):
        from scipy.stats import chi2
        nees, count = 0, 0
        for seed in (5, 6, 7, 8):
            folder = self.path("%s_%d" % (kind, seed))
            os.mkdir(folder)
            squares, dof, of_errors, off = benchmark().try_robot(folder, KINCAL, kind, seed, 40)
            self.assertTrue(0.9 < squares / dof < 1.1, squares / dof)
            nees, count = nees + of_errors, count + len(off)
        low, high = chi2.ppf([0.0005, 0.9995], count) / count
        self.assertTrue(low < nees / count < high, nees / count)
        return folder

    def test_brown_conrady_12(self):
        self.near("brown_conrady_12")

    def test_brown_conrady_14(self):
        folder = self.near("brown_conrady_14")
        with open(os.path.join(folder, "result", "result.json")) as f:
            distortion = json.load(f)["parameters"]["sensor/sensor/distortion"]
        self.assertEqual(distortion["components"][-6:], ["s1", "s2", "s3", "s4", "tau_x", "tau_y"])
        self.assertEqual(distortion["unit"][-3:], ["", "rad", "rad"])

    def test_unified(self):
        self.near("unified")

    def test_double_sphere(self):
        folder = self.near("double_sphere")
        self.assertIn("sensor/sensor/distortion.alpha", self.run_kincal("show", os.path.join(folder, "result")))

    def test_plane(self):
        """By steps, and on the automatic path, which holds what moves a plane in itself; wrong pairs of sensors and targets are refused."""
        folder = self.near("plane")
        text = self.read(folder, "rig.yaml")
        self.write(os.path.join(folder, "free.yaml"), text.split("estimate:")[0])
        self.run_kincal("calibrate", os.path.join(folder, "free.yaml"), os.path.join(folder, "samples.jsonl"), "--out", self.path("auto"), "--no-report")
        result = json.loads(self.read("auto", "result.json"))
        self.assertEqual(result["status"], "converged")
        floor = result["parameters"]["target/floor/pose"]
        self.assertEqual([sigma > 0 for sigma in floor["sigma"]], [False, False, True, True, True, False])
        self.write("wrong.yaml", text.replace("tip: {type: surface", "tip: {type: point"))
        run = subprocess.run([KINCAL, "calibrate", "wrong.yaml", os.path.join(folder, "samples.jsonl"), "--out", "x"], cwd=self.dir, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)
        self.assertEqual(run.returncode, 1)
        self.assertIn("'tip' is a point, 'floor' a plane", run.stderr)

    def test_range(self):
        """By steps, and on the automatic path, where the rig states it; the result's rig has what was found."""
        folder = self.near("range")
        text = self.read(folder, "rig.yaml").split("estimate:")[0]
        truth = json.loads(self.read(folder, "sim", "truth.json"))["parameters"]
        for stated in (True, False):
            self.write(os.path.join(folder, "free.yaml"), text if stated else text.replace(", range_scale: 1, range_offset: 0", ""))
            self.run_kincal("calibrate", os.path.join(folder, "free.yaml"), os.path.join(folder, "sim", "samples.jsonl"), "--out", self.path("auto"), "--force", "--no-report")
            parameters = json.loads(self.read("auto", "result.json"))["parameters"]
            for name in ("range_scale", "range_offset"):
                key = "sensor/sensor/" + name
                self.assertEqual(key in parameters, stated)
                if stated:
                    found = parameters[key]
                    self.assertLess(abs(found["value"][0] - truth[key]["true"]), 5 * found["sigma"][0])
                    self.assertEqual(yaml.safe_load(self.read("auto", "rig.yaml"))["sensors"]["sensor"][name], found["value"][0])


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
