"""Error curves of joints through the program: python3 curves_test.py SOURCE_DIR KINCAL [TEST ...]

An arm of four joints and a tracker that sees the pose of its hand, simulated: the encoder of one joint has an error of 0.5 mrad with 9 cycles a turn, which stands in
the true robot's rig as `model: curve`. Proves: the automatic path finds the curve of that joint and of no other, and its held-out errors are what the
sensor's noise allows, several times less than without; the estimated curve is the true one at the angles that were visited, and not estimated, as uncertain as its width, where no reading was; the
written rig gives the same errors in `evaluate`; a robot without such errors gets no curve, and that is said. Not proved: curves of real encoders (docs/results.md has those of a UR10), and how
often a curve is found that is not there (docs/results.md).
"""
import json
import math
import os
import subprocess
import sys
import unittest

from helpers import Folder, revolute

SOURCE_DIR = KINCAL = None
JOINTS = ["a", "b", "c", "d"]
VALUES = 96
RIG = """format: kincal/1
robot: robot.urdf
base: base
targets:
  ball: {type: points, points: [[0, 0, 0]], mount: {link: hand, pose: {xyz: [0.05, 0.02, 0.1], rpy: [0, 0, 0]}}}
sensors:
  tracker: {type: pose, link: base, pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}, sigma: {translation: 2.0e-05, rotation: 5.0e-05}}
joints: {"*": {sigma: 0.00003}%s}
"""


def true_curve(q):
    return 0.0005 * math.sin(9 * q + 0.4)


class Curves(Folder):
    def setUp(self):
        super().setUp()
        chain = [("a", "l1", "0 0 1", "0 0 0.4"), ("b", "l2", "0 1 0", "0.1 0 0.1"), ("c", "l3", "0 1 0", "0 0 0.5"), ("d", "hand", "1 0 0", "0.4 0 0.05")]
        self.write("robot.urdf", '<robot name="r"><link name="base"/>%s</robot>' % "".join(revolute(chain, "base", 2.4)))

    def kincal(self, *arguments):
        run = subprocess.run([KINCAL, *arguments], cwd=self.dir, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)
        self.assertEqual(run.returncode, 0, run.stderr)
        return run.stdout

    def recorded(self, joints):
        """Samples of a robot with these settings; the rig without them is rig.yaml."""
        self.write("true.yaml", RIG % joints)
        self.kincal("simulate", "true.yaml", "--samples", "200", "--seed", "7", "--out", "made", "--quiet")
        self.write("rig.yaml", RIG % "")
        samples = self.read("made", "samples.jsonl").splitlines()
        samples = [dict(json.loads(line), split="test" if i % 4 == 0 else "train") for i, line in enumerate(samples)]
        self.write("samples.jsonl", "".join(json.dumps(s) + "\n" for s in samples))
        return samples

    def calibrated(self, out, *arguments):
        text = self.kincal("calibrate", "rig.yaml", "samples.jsonl", "--out", out, "--no-report", *arguments)
        with open(self.path(out, "result.json"), encoding="utf-8") as file:
            return json.load(file), text

    def held_out(self, result):
        return result["sensors"]["tracker"]["test"]["rms_as_read"]

    def check_curve(self, result, samples):
        """Over the readings: the true curve but for its mean, within its band; a wide band where no sample was; what was tried, and the gain on held-out samples."""
        self.assertEqual(list(result["curves"]), ["c"])
        curve, wide = result["curves"]["c"], result["automatic"]
        wide = next(group["width"] for group in wide if group["group"] == "curve/c")
        read = sorted(s["joints"]["c"] for s in samples if s["split"] == "train")
        mean = sum(true_curve(q) for q in read) / len(read)
        near, far = [], []
        for q, error, sigma in zip(curve["reading"], curve["error"], curve["sigma"]):
            distance = min(abs(q - r) for r in read)
            if distance < 0.02:
                near.append((error - true_curve(q) + mean) / sigma)
            if distance > 8 * math.pi / VALUES:
                far.append(sigma)
        self.assertGreater(len(near), 50)
        self.assertLess(math.sqrt(sum(e * e for e in near) / len(near)), 2)
        self.assertAlmostEqual(curve["rms"], 0.0005 / math.sqrt(2), delta=1e-4)
        for sigma in far:
            self.assertGreater(sigma, 0.5 * wide)
        tried = {one["group"]: one for one in result["tried"]}
        self.assertEqual([name for name, one in tried.items() if one["outcome"] == "kept"], ["curve/c"])
        self.assertEqual({one["outcome"] for name, one in tried.items() if name != "curve/c"} - {"no_evidence", "no_better_held_out", "lost"}, set())
        self.assertGreater(tried["curve/c"]["gain"], 3)
        stages = result["validation"]["stages"]
        rigid, curved = [row for row in stages["rows"] if row["unit"] == "m"]
        self.assertEqual((stages["from"], rigid["added"], rigid["ratio"], curved["added"]), ("test", [], None, ["curve/c"]))
        test = result["sensors"]["tracker"]["test"]
        for row, key in ((rigid, "rms_uncorrected"), (curved, "rms_as_read")):
            self.assertAlmostEqual(row["rms"] / test[key], 1, places=9)
        self.assertAlmostEqual(curved["ratio"], curved["rms"] / rigid["rms"], places=12)
        self.assertTrue(curved["ratio_95"][0] < curved["ratio"] < curved["ratio_95"][1] < 1)

    def test_found(self):
        values = [true_curve(2 * math.pi * k / VALUES) for k in range(VALUES)]
        samples = self.recorded(", c: {model: curve, curve: [%s]}" % ", ".join("%.9g" % v for v in values))
        with_curves, _ = self.calibrated("with", "--report-frame", "sensor/tracker")
        without, _ = self.calibrated("without", "--no-group", "curve/*", "--no-group", "ripple/*")
        curves = [name for name in with_curves["parameters"] if name.endswith("/curve")]
        self.assertEqual(curves, ["joint/c/curve"])
        self.assertLess(self.held_out(with_curves), 0.4 * self.held_out(without))
        frame = with_curves["validation"]["frames"]["sensor/tracker"]["workspaces"]["samples"]
        pose = with_curves["parameters"]["sensor/tracker/pose"]
        for sigma, of in ((frame["position"]["rms"], pose["sigma"][:3]), (frame["rotation"]["rms"], pose["sigma"][3:])):
            self.assertAlmostEqual(sigma / math.sqrt(sum(s * s for s in of)), 1, delta=0.01)  # the sensor stands on the base
        curve = with_curves["parameters"]["joint/c/curve"]
        visited = {int(math.floor(s["joints"]["c"] * VALUES / (2 * math.pi))) % VALUES for s in samples}
        inside = [k for k in range(VALUES) if all((k + d) % VALUES in visited for d in range(-3, 4))]
        outside = [k for k in range(VALUES) if not any((k + d) % VALUES in visited for d in range(-3, 4))]
        self.assertGreater(len(inside), 20)
        self.assertGreater(len(outside), 5)
        self.check_curve(with_curves, samples)
        off = [curve["value"][k] - values[k] for k in inside]
        mean = sum(off) / len(off)  # the offset has it
        self.assertLess(math.sqrt(sum((o - mean) ** 2 for o in off) / len(off)), 0.00015)
        self.assertTrue(all(curve["value"][k] == 0 for k in outside))
        group, = (g for g in with_curves["automatic"] if g["group"] == "curve/c")
        self.assertTrue({"joint/c/curve.%d" % k for k in outside} <= set(group["unseen"]))
        self.assertGreater(group["width"], 0.0002)
        self.assertLess(sorted(curve["sigma"][k] for k in inside)[len(inside) // 2], 0.4 * group["width"])
        evaluated = json.loads(self.kincal("evaluate", self.path("with", "rig.yaml"), "samples.jsonl", "--json"))
        self.assertIn("tracker", evaluated["sensors"])
        with open(self.path("with", "rig.yaml"), encoding="utf-8") as file:
            self.assertIn("model: curve", file.read())

    def test_none(self):
        self.recorded("")
        result, text = self.calibrated("out", "--group", "curve/*")
        self.assertEqual([name for name in result["parameters"] if name.endswith("/curve")], [])
        self.assertIn("the data give no evidence for it", " ".join(text.split()) + json.dumps(result))


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = (os.path.abspath(p) for p in sys.argv[1:3])
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:])
