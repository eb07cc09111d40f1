"""`kincal compensate`: python3 compensate_test.py SOURCE_DIR KINCAL [TEST ...]

Robots whose joints bend and have error curves, as a result has them (rig.yaml beside rig_rigid.yaml), of six kinds: six axes in the stator's frame, seven in the rotor's with an arm beside them,
a slide among the axes, a follower, pan and tilt, six axes with ripples, couplings and temperatures. Proves: forward kinematics of the C99 header and of the Python module are those of the program (of `simulate`) to 1e-12 m; the readings that the three find are the same to 1e-6 rad (near singular postures rounding is that large), and the
real robot's tip is then where the rigid one has it (of six axes or more; of two, nearer than without); tables, JSON lines and poses; mistakes are named. After a calibration: the result's own files. Not proved: other compilers than
the machine's, and that a robot so commanded is where it should be (that is the calibration's part).
"""
import importlib.util
import json
import math
import os
import random
import shutil
import subprocess
import sys
import unittest

from helpers import Folder, revolute

SOURCE_DIR = KINCAL = None
SIX = [("a", "l1", "0 0 1", "0 0 0.3"), ("b", "l2", "0 1 0", "0.1 0 0.1"), ("c", "l3", "0 1 0", "0 0 0.5"), ("d", "l4", "1 0 0", "0.2 0 0.05"),
       ("e", "l5", "0 1 0", "0.3 0 0"), ("f", "hand", "1 0 0", "0.1 0 0")]
SEVEN = SIX[:5] + [("f", "l6", "1 0 0", "0.1 0 0"), ("g", "hand", "0 1 0", "0.05 0 0")]
RIG = """format: kincal/1
robot: robot.urdf
base: base
targets:
  ball: {type: points, points: [[0, 0, 0]], mount: {link: hand, pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}}
sensors:
  tracker: {type: pose, link: base, pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}, sigma: {translation: 1.0e-16, rotation: 1.0e-16}}
%s"""
DRIVER = r"""
#include <stdio.h>
#include "compensation.h"
int main(void) {
  double q[KINCAL_READINGS], p[KINCAL_READINGS], left[2], warm;
  for (;;) {
    struct kincal_pose tip;
    if (scanf("%lf", &warm) != 1) return 0;
    for (int i = 0; i < KINCAL_READINGS; ++i)
      if (scanf("%lf", p + i) != 1) return 0;
    kincal_temperature = warm;
    if (kincal_forward(&kincal_real, p, &tip)) return 2;
    kincal_temperature = 33;
    if (kincal_compensate(p, 6, q, left)) return 2;
    for (int i = 0; i < 3; ++i) printf("%.17g ", tip.p[i]);
    for (int i = 0; i < 9; ++i) printf("%.17g ", tip.r[i]);
    for (int i = 0; i < KINCAL_READINGS; ++i) printf("%.17g ", q[i]);
    printf("%.17g %.17g\n", left[0], left[1]);
  }
}
"""


def urdf(chain, more=""):
    return '<robot name="r"><link name="base"/>%s%s</robot>' % ("".join(revolute([(j, link, xyz, axis) for j, link, axis, xyz in chain], "base", 2.4)), more)


def elasticity(joints, frame, seed):
    draw = random.Random(seed)
    compliance = {j: [round(draw.uniform(-1, 4) * 1e-5, 8), round(draw.uniform(0, 1) * 1e-5, 8), round(draw.uniform(0, 1) * 1e-5, 8)] for j in joints}
    return "elasticity:\n  gravity: [0.3, -0.2, -9.8]\n  frame: %s\n  compliance: %s\n" % (frame, json.dumps(compliance))


def curve(seed):
    draw = random.Random(seed)
    return "{model: curve, curve: [%s]}" % ", ".join("%.9g" % (3e-4 * draw.gauss(0, 1)) for _ in range(96))


SLIDING = urdf(SIX).replace('<joint name="d" type="revolute"', '<joint name="d" type="prismatic"')
FOLLOWING = urdf(SIX).replace('<joint name="e" type="revolute">', '<joint name="e" type="revolute"><mimic joint="c" multiplier="-0.5" offset="0.1"/>')
TWO_ARMED = urdf(SEVEN, '<link name="o1"/><link name="o2"/><joint name="o" type="revolute"><parent link="l1"/><child link="o1"/><origin xyz="0 0.2 0.1"/>'
                        '<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint><joint name="w" type="revolute"><parent link="o1"/>'
                        '<child link="o2"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>')
ROBOTS = {
    "six": (urdf(SIX), "joints: {b: %s, e: %s}\n" % (curve(1), curve(2)) + elasticity("abcdef", "stator", 3)),
    "two arms": (TWO_ARMED, "joints: {c: %s}\n" % curve(4) + elasticity("abcdefgow", "rotor", 5)),
    "slide": (SLIDING, elasticity("abcef", "stator", 6)),
    "follower": (FOLLOWING, "joints: {c: %s}\n" % curve(7) + elasticity("abcf", "rotor", 8)),
    "terms": (urdf(SIX), "joints: {a: {temperature: 5.0e-05}, b: {gear_ratio: [100, 31.5], ripple: [0.0002, -0.0001, 0.0003, 0.0001, -0.0001, 0.0002, 0.0001, 0.0003]}, "
                         "c: {coupling: {b: -0.04, d: 0.02}}, e: {temperature: -3.0e-05, gear_ratio: 80, ripple: [0, 0.0002, 0, 0]}, f: {coupling: {e: 0.05}}}\n"),
    "pan and tilt": (urdf(SIX[:1] + [("b", "hand", "0 1 0", "0.1 0 0.1")]), "joints: {a: %s, b: %s}\n" % (curve(9), curve(10))),
}


class Compensate(Folder):
    def run_kincal(self, *arguments):
        return subprocess.run([KINCAL, *arguments], cwd=self.dir, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)

    def kincal(self, *arguments):
        run = self.run_kincal(*arguments)
        self.assertEqual(run.returncode, 0, run.stderr)
        return run

    def result_of(self, kind):
        robot, bent = ROBOTS[kind]
        self.write("robot.urdf", robot)
        self.write("rig.yaml", RIG % bent)
        self.write("rig_rigid.yaml", RIG % "")

    def simulated(self, count):
        shutil.rmtree(self.path("made"), ignore_errors=True)
        self.kincal("simulate", "rig.yaml", "--samples", str(count), "--seed", "3", "--out", "made", "--quiet")
        return [json.loads(line) for line in self.read("made", "samples.jsonl").splitlines()]

    def module(self, name):
        spec = importlib.util.spec_from_file_location(name, self.path("compensation.py"))
        out = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(out)
        return out

    def test_c_and_python(self):
        compiler = shutil.which("cc")
        if not compiler:
            self.skipTest("there is no C compiler")
        for number, kind in enumerate(ROBOTS):
            with self.subTest(kind):
                self.result_of(kind)
                samples = self.simulated(200)
                self.kincal("compensate", "rig.yaml", "--tip", "hand", "--c-header", "compensation.h", "--python", "compensation.py", "--json", "compensation.json", "--force")
                python = self.module("compensation_%d" % number)
                names = json.loads(self.read("compensation.json"))["readings"]
                self.assertEqual(names, python.DATA["readings"])
                self.write("driver.c", DRIVER)
                build = subprocess.run([compiler, "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1", "driver.c", "-o", "driver", "-lm"], cwd=self.dir,
                                       stderr=subprocess.PIPE, universal_newlines=True)
                self.assertEqual(build.returncode, 0, build.stderr)
                postures = [[s["joints"].get(n, 0) for n in names] for s in samples]
                told = subprocess.run([self.path("driver")], input="".join(" ".join(repr(v) for v in [s.get("temperature", 20)] + p) + "\n" for s, p in zip(samples, postures)), stdout=subprocess.PIPE,
                                      universal_newlines=True)
                self.assertEqual(told.returncode, 0)
                rows = [[float(v) for v in line.split()] for line in told.stdout.splitlines()]
                self.assertEqual(len(rows), len(samples))
                self.write("postures.csv", ",".join(names) + "\n" + "".join(",".join(repr(v) for v in p) + "\n" for p in postures))
                found = self.kincal("compensate", "rig.yaml", "postures.csv", "--tip", "hand", "--temperature", "33").stdout.splitlines()
                columns = found[0].split(",")
                for i, (sample, row) in enumerate(zip(samples, rows)):
                    z = sample["views"][0]["pose"] if "pose" in sample["views"][0] else sample["views"][0]["z"]
                    xyz = z["xyz"] if isinstance(z, dict) else z[:3]
                    self.assertLess(max(abs(a - b) for a, b in zip(row, xyz)), 1e-12)
                    if i < 50:
                        python.temperature = sample.get("temperature", 20)
                        tip = python.forward(postures[i])
                        self.assertLess(max(abs(tip[k, 3] - row[k]) for k in range(3)), 1e-12)
                        self.assertLess(max(abs(tip[k // 3, k % 3] - row[3 + k]) for k in range(9)), 1e-12)
                        python.temperature = 33
                        readings, position, rotation = python.compensate(postures[i])
                        self.assertLess(max(abs(a - b) for a, b in zip(readings, row[12:])), 1e-6)
                    program = dict(zip(columns, (float(v) for v in found[1 + i].split(","))))
                    self.assertLess(max(abs(program[n] - row[12 + k]) for k, n in enumerate(names)), 1e-6)
                    if kind in ("six", "two arms", "terms") and abs(math.sin(sample["joints"]["e"])) > 0.1 and abs(math.sin(sample["joints"]["c"])) > 0.1:
                        self.assertLess(max(row[-2:]), 1e-9)

    def test_tables(self):
        self.result_of("six")
        samples = self.simulated(20)
        self.write("postures.jsonl", "".join(json.dumps({"joints": s["joints"]}) + "\n" for s in samples))
        run = self.kincal("compensate", "rig.yaml", "postures.jsonl", "--tip", "target/ball", "--out", "commanded.jsonl")
        self.assertEqual(run.stdout, "")
        self.assertRegex(run.stderr, r"20 postures: without this the tip is off by [0-9.]+ mm \(rms\), at most [0-9.]+ mm; readings change by at most [0-9.]+ mrad")
        lines = [json.loads(line)["joints"] for line in self.read("commanded.jsonl").splitlines()]
        # The real robot at these readings is where the rigid one was planned: its clean samples say so.
        self.write("commanded_samples.jsonl", "".join(json.dumps(dict(s, joints=q)) + "\n" for s, q in zip(samples, lines)))
        self.kincal("compensate", "rig.yaml", "commanded.jsonl", "--tip", "hand", "--out", "commanded.csv")
        self.assertEqual(self.read("commanded.csv").splitlines()[0], "a,b,c,d,e,f")
        again = self.run_kincal("compensate", "rig.yaml", "postures.jsonl", "--tip", "hand", "--out", "commanded.csv")
        self.assertEqual(again.returncode, 1)
        self.assertIn("--force", again.stderr)
        nearer = self.kincal("compensate", "rig.yaml", "postures.jsonl", "--tip", "hand", "--position")
        self.assertIn("left: ", nearer.stderr)

    def test_poses(self):
        """Readings for poses: where the real robot is at simulated readings, it is again at those that are found (its clean samples show both)."""
        for kind in ("six", "two arms"):
            with self.subTest(kind):
                self.result_of(kind)
                samples = self.simulated(20)
                poses = [s["views"][0]["pose"] for s in samples]
                self.write("poses.csv", "x,y,z,qx,qy,qz,qw\n" + "".join(",".join(repr(v) for v in p["xyz"] + p["quat"]) + "\n" for p in poses))
                run = self.kincal("compensate", "rig.yaml", "poses.csv", "--pose-format", "xyzw", "--tip", "target/ball", "--out", "found.jsonl", "--force")
                self.assertIn("20 postures: ", run.stderr)
                found = [json.loads(line)["joints"] for line in self.read("found.jsonl").splitlines()]
                self.write("again.jsonl", "".join(json.dumps({"id": s["id"], "joints": q, "views": [{"sensor": "tracker", "target": "ball"}]}) + "\n"
                                                  for s, q in zip(samples, found)))
                self.kincal("simulate", "rig.yaml", "--postures", "again.jsonl", "--samples", "20", "--seed", "1", "--out", "again", "--quiet", "--force")
                for line, p in zip(self.read("again", "samples.jsonl").splitlines(), poses):
                    q = json.loads(line)["views"][0]["pose"]
                    self.assertLess(max(abs(a - b) for a, b in zip(p["xyz"], q["xyz"])), 1e-9)
                    self.assertLess(1 - abs(sum(a * b for a, b in zip(p["quat"], q["quat"]))), 1e-12)
        self.write("far.csv", "x,y,z,qx,qy,qz,qw\n9,0,0,0,0,0,1\n")
        run = self.run_kincal("compensate", "rig.yaml", "far.csv", "--pose-format", "xyzw", "--tip", "hand")
        self.assertEqual(run.returncode, 1)
        self.assertIn("far.csv:2: no posture within the joints' limits was found in which 'hand' stands at this pose relative to 'sensor/tracker'", run.stderr)
        run = self.run_kincal("compensate", "rig.yaml", "far.csv", "--unit", "mm", "--tip", "hand")
        self.assertEqual(run.returncode, 1)
        self.assertIn("--unit requires --pose-format", run.stderr)

    def test_mistakes(self):
        self.result_of("six")
        self.write("postures.csv", "a,b,c,d,e\n0,0,0,0,0\n")
        for arguments, said in ((["rig.yaml", "postures.csv", "--tip", "hand"], "postures.csv:2: there is no reading of joint 'f', which moves 'hand'"),
                                (["rig.yaml", "postures.csv", "--tip", "hnd"], "--tip: there is no frame 'hnd'"),
                                (["rig.yaml", "--tip", "hand"], "nothing to do"),
                                (["rig.yaml", "postures.csv", "--tip", "hand", "--from", "hand"], "--from: 'hand' does not stand still; one of sensor/tracker"),
                                (["nowhere", "postures.csv", "--tip", "hand"], "nowhere")):
            run = self.run_kincal("compensate", *arguments)
            self.assertEqual(run.returncode, 1, run.stderr)
            self.assertIn(said, run.stderr)
        self.result_of("terms")
        self.write("postures.csv", "a,b,c,d,e,f\n0,0,0,0,0,0\n")
        run = self.run_kincal("compensate", "rig.yaml", "postures.csv", "--tip", "hand")
        self.assertEqual(run.returncode, 1)
        self.assertIn("--temperature is required", run.stderr)
        os.remove(self.path("rig_rigid.yaml"))
        run = self.run_kincal("compensate", "rig.yaml", "postures.csv", "--tip", "hand")
        self.assertEqual(run.returncode, 1)
        self.assertIn("nothing to compensate", run.stderr)


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = (os.path.abspath(p) for p in sys.argv[1:3])
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:])
