"""What positions depend on beside the reading, through the program: python3 conditions_test.py SOURCE_DIR KINCAL [TEST ...]

An arm of five joints and a tracker of its hand, simulated with `backlash` and `time_offset` of the true robot's rig. Proves: the automatic path finds both from `approach` and `rates`, within
4 sigmas of the truth, and temperatures, a ripple (also of a ratio that the rig does not state), a coupling and the line time of a rolling shutter as well; the written rig gives the same errors in `evaluate`, `verify` goes by the conditions of its samples, and the rig is its own input; a robot without any gets none; steps estimate them; without conditions they are
unobservable, by name; mistakes are named with line, field and valid values. Not proved: how often a term is found that is not there (docs/results.md).
"""
import json
import os
import re
import subprocess
import sys
import unittest

from helpers import Folder, revolute

SOURCE_DIR = KINCAL = None
JOINTS = "abcde"
RIG = """format: kincal/1
robot: robot.urdf
base: base
targets:
  ball: {type: points, points: [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], mount: {link: hand, pose: {xyz: [0.05, 0.02, 0.1], rpy: [0, 0, 0]}}}
sensors:
  tracker: {type: point, link: base, pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}, sigma: 5.0e-05%s}
joints: {"*": {sigma: 0.00003}%s}
%s"""
PLAY = {"a": 0.0006, "b": -0.0004, "c": 0.0008, "d": 0.0011, "e": 0.0005}
CLOCK = 0.012


TERMS = {"temperature": {"a": 6e-5, "b": -4e-5, "c": 5e-5, "d": 8e-5, "e": 3e-5}, "ripple": {"c": [3e-4, -2e-4, 1e-4, 2e-4]}, "coupling": {"e": {"d": 0.05}}}
RATIO = {"c": 100, "b": 80}


CHAIN = [("a", "l1", "0 0 0.4", "0 0 1"), ("b", "l2", "0.1 0 0.1", "0 1 0"), ("c", "l3", "0 0 0.5", "0 1 0"), ("d", "l4", "0.4 0 0.05", "1 0 0"), ("e", "hand", "0.1 0 0", "0 1 0")]
URDF = '<robot name="r"><link name="base"/>%s</robot>' % "".join(revolute(CHAIN, "base", 2.4))


def with_terms(terms=None):
    """The entries of joints: gear ratios, and the terms of the true robot."""
    out = {joint: {"gear_ratio": ratio} for joint, ratio in RATIO.items()}
    for term, values in (terms or {}).items():
        for joint, value in values.items():
            out.setdefault(joint, {})[term] = value
    return RIG % ("", "".join(", %s: %s" % (joint, json.dumps(entry)) for joint, entry in out.items()), "")


def rig(play=None, clock=None, more=""):
    return RIG % ("" if clock is None else ", time_offset: %g" % clock, "".join(", %s: {backlash: %g}" % one for one in (play or {}).items()), more)


class Conditions(Folder):
    def setUp(self):
        super().setUp()
        self.write("robot.urdf", URDF)

    def run_kincal(self, *arguments):
        return subprocess.run([KINCAL, *arguments], cwd=self.dir, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)

    def kincal(self, *arguments):
        run = self.run_kincal(*arguments)
        self.assertEqual(run.returncode, 0, run.stderr + run.stdout)
        return run.stdout

    def recorded(self, play, clock):
        """Samples of a robot with these, which state all conditions."""
        self.write("true.yaml", rig(play, clock))
        self.kincal("simulate", "true.yaml", "--samples", "90", "--seed", "7", "--out", "made", "--quiet")
        samples = [json.loads(line) for line in self.read("made", "samples.jsonl").splitlines()]
        self.write("samples.jsonl", "".join(json.dumps(dict(s, split="test" if i % 4 == 0 else "train")) + "\n" for i, s in enumerate(samples)))
        return samples

    def result(self, name):
        with open(self.path(name, "result.json"), encoding="utf-8") as file:
            return json.load(file)

    def near(self, result, name, truth):
        found = result["parameters"][name]
        value, sigma = (found[key][0] if isinstance(found[key], list) else found[key] for key in ("value", "sigma"))
        self.assertLess(abs(value - truth), 4 * sigma, name)
        self.assertLess(sigma, abs(truth) / 3, name)

    def test_found(self):
        samples = self.recorded(PLAY, CLOCK)
        self.assertEqual(set(samples[0]["approach"].values()) | {1, -1}, {1, -1})
        self.assertEqual(set(samples[0]["rates"]), set(JOINTS))
        self.write("rig.yaml", rig())
        said = self.kincal("calibrate", "rig.yaml", "samples.jsonl", "--out", "found", "--no-report")
        self.assertIn("Not in robot.urdf", said)
        result = self.result("found")
        kept = {g["group"] for g in result["automatic"] if not g.get("held")}
        self.assertTrue({"backlash", "time offsets"} <= kept, kept)
        for joint in JOINTS:
            self.near(result, "joint/%s/backlash" % joint, PLAY[joint])
        self.near(result, "sensor/tracker/time_offset", CLOCK)
        self.assertFalse(os.path.exists(self.path("found", "rig_rigid.yaml")))
        self.kincal("simulate", "true.yaml", "--samples", "40", "--seed", "8", "--out", "later", "--quiet")
        later = [json.loads(line) for line in self.read("later", "samples.jsonl").splitlines()]
        self.write("bare.jsonl", "".join(json.dumps({k: v for k, v in s.items() if k not in ("approach", "rates")}) + "\n" for s in later))
        positions = [json.loads(self.kincal("verify", "found", samples, "--json"))["after"]["position"]["rms"] for samples in (self.path("later", "samples.jsonl"), "bare.jsonl")]
        self.assertLess(positions[0], 2e-4)
        self.assertGreater(positions[1], 10 * positions[0])
        evaluated = json.loads(self.kincal("evaluate", self.path("found", "rig.yaml"), "samples.jsonl", "--json"))
        held_out = result["sensors"]["tracker"]["test"]["rms_as_read"]
        self.assertAlmostEqual(evaluated["sensors"]["tracker"]["test"]["rms_as_read"], held_out, delta=1e-2 * held_out)
        self.assertLess(held_out, 2.5e-4)
        self.kincal("calibrate", self.path("found", "rig.yaml"), "samples.jsonl", "--out", "again", "--no-report")
        again = self.result("again")["parameters"]
        for name, value in result["parameters"].items():
            if name.endswith(("/backlash", "/time_offset")):
                self.assertAlmostEqual(again[name]["value"][0] if isinstance(again[name]["value"], list) else again[name]["value"],
                                       value["value"][0] if isinstance(value["value"], list) else value["value"], delta=1e-6)

    def test_none(self):
        self.recorded(dict.fromkeys(JOINTS, 0), 0)
        self.write("rig.yaml", rig())
        self.kincal("calibrate", "rig.yaml", "samples.jsonl", "--out", "out", "--no-report")
        self.assertEqual([name for name in self.result("out")["parameters"] if name.endswith(("/backlash", "/time_offset"))], [])
        for name in ("backlash", "time_offset"):
            self.assertNotIn(name, self.read("out", "rig.yaml"))

    def test_terms(self):
        self.write("true.yaml", with_terms(TERMS))
        self.kincal("simulate", "true.yaml", "--samples", "160", "--seed", "5", "--out", "made", "--quiet")
        samples = [json.loads(line) for line in self.read("made", "samples.jsonl").splitlines()]
        self.assertTrue(all(10 <= s["temperature"] <= 30 for s in samples))
        self.write("samples.jsonl", "".join(json.dumps(dict(s, split="test" if i % 4 == 0 else "train")) + "\n" for i, s in enumerate(samples)))
        self.write("rig.yaml", with_terms())
        self.kincal("calibrate", "rig.yaml", "samples.jsonl", "--out", "found", "--no-report")
        result = self.result("found")
        kept = {g["group"] for g in result["automatic"] if not g.get("held")}
        self.assertTrue({"temperature", "ripple/c", "coupling/e"} <= kept, kept)
        self.assertFalse({"ripple/b", "coupling/a", "coupling/b"} & kept, kept)
        self.assertEqual(result["verdict"]["use"], "good")
        self.assertIn("kincal compensate", result["verdict"]["next"][0])
        for joint, value in TERMS["temperature"].items():
            self.near(result, "joint/%s/temperature" % joint, value)
        for k, value in enumerate(TERMS["ripple"]["c"]):
            found = result["parameters"]["joint/c/ripple"]
            self.assertLess(abs(found["value"][k] - value), 4 * found["sigma"][k])
        coupling = result["parameters"]["joint/e/coupling"]
        self.assertLess(abs(coupling["value"][0] - 0.05), 4 * coupling["sigma"][0])
        evaluated = json.loads(self.kincal("evaluate", self.path("found", "rig.yaml"), "samples.jsonl", "--json"))
        held_out = result["sensors"]["tracker"]["test"]["rms_as_read"]
        self.assertAlmostEqual(evaluated["sensors"]["tracker"]["test"]["rms_as_read"], held_out, delta=1e-2 * held_out)
        self.assertLess(held_out, 2.5e-4)
        self.assertLess(held_out, 0.2 * result["sensors"]["tracker"]["test"]["rms_uncorrected"])
        self.write("postures.csv", "a,b,c,d,e\n0.1,0.2,0.3,0.4,0.5\n")
        self.assertIn("--temperature is required", self.run_kincal("compensate", "found", "postures.csv", "--tip", "hand").stderr)
        self.kincal("compensate", "found", "postures.csv", "--tip", "hand", "--temperature", "25")
        self.kincal("calibrate", self.path("found", "rig.yaml"), "samples.jsonl", "--out", "again", "--no-report")
        again = self.result("again")["parameters"]
        for name, value in result["parameters"].items():
            if name.endswith(("/temperature", "/ripple", "/coupling")):
                for a, b, sigma in zip(again[name]["value"], value["value"], value["sigma"]):
                    self.assertLess(abs(a - b), 0.05 * sigma, name)  # (noise and widths are learned anew)

    def test_ripple_without_ratio(self):
        self.write("true.yaml", with_terms({"ripple": TERMS["ripple"]}))
        self.kincal("simulate", "true.yaml", "--samples", "160", "--seed", "7", "--out", "made", "--quiet")
        self.write("rig.yaml", rig())
        self.kincal("calibrate", "rig.yaml", self.path("made", "samples.jsonl"), "--out", "found", "--no-report")
        result = self.result("found")
        self.assertEqual([g["group"] for g in result["automatic"] if g["group"].startswith("ripple/") and not g.get("held")], ["ripple/c"])
        self.assertIn("gear_ratio: 100", self.read("found", "rig.yaml").replace("[100]", "100"))
        found = result["parameters"]["joint/c/ripple"]
        for value, sigma, truth in zip(found["value"], found["sigma"], TERMS["ripple"]["c"]):
            self.assertLess(abs(value - truth), 4 * sigma)

    def test_ripple_taken_for_noise(self):
        """Less than twice the noise of a reading. Before it is found, the noise of the joints contains it."""
        self.write("true.yaml", with_terms({"ripple": {"c": [4e-5, -4e-5, 0, 0]}}))
        self.kincal("simulate", "true.yaml", "--samples", "160", "--seed", "7", "--out", "made", "--quiet")
        self.write("rig.yaml", rig())
        self.kincal("calibrate", "rig.yaml", self.path("made", "samples.jsonl"), "--out", "found", "--no-report")
        self.assertIn("ripple/c", [g["group"] for g in self.result("found")["automatic"] if not g.get("held")])

    def test_no_terms(self):
        self.write("true.yaml", with_terms({"temperature": dict.fromkeys(JOINTS, 0)}))
        self.kincal("simulate", "true.yaml", "--samples", "120", "--seed", "6", "--out", "made", "--quiet")
        self.write("rig.yaml", with_terms())
        self.kincal("calibrate", "rig.yaml", self.path("made", "samples.jsonl"), "--out", "out", "--no-report")
        self.assertEqual([n for n in self.result("out")["parameters"] if n.endswith(("/temperature", "/ripple", "/coupling"))], [])
        for name in ("temperature", "ripple", "coupling"):
            self.assertNotIn(name, self.read("out", "rig.yaml"))

    def test_steps(self):
        samples = self.recorded(PLAY, CLOCK)
        steps = ("estimate:\n  - {step: all, free: [target/ball/pose, joint/*/offset, joint/*/backlash, sensor/tracker/time_offset], "
                 "priors: {joint/*/offset: 0.01}}\n")
        self.write("rig.yaml", rig(dict.fromkeys(JOINTS, 0), 0, steps))
        self.kincal("calibrate", "rig.yaml", "samples.jsonl", "--out", "out", "--no-report")
        for joint in JOINTS:
            self.near(self.result("out"), "joint/%s/backlash" % joint, PLAY[joint])
        self.near(self.result("out"), "sensor/tracker/time_offset", CLOCK)
        bare = [{k: v for k, v in s.items() if k not in ("approach", "rates")} for s in samples]
        self.write("bare.jsonl", "".join(json.dumps(s) + "\n" for s in bare))
        run = self.run_kincal("calibrate", "rig.yaml", "bare.jsonl", "--out", "bare", "--no-report")
        self.assertEqual(run.returncode, 2, run.stderr)
        said = " ".join(run.stdout.split())
        self.assertIn("no sample states the approach of joint 'a'", said)
        self.assertIn("state `approach` in the samples, or fix joint/a/backlash", said)
        self.assertIn("sensor/tracker/time_offset", json.dumps(self.result("bare")["unobservable"]))

    def test_rolling_shutter(self):
        row = 2.5e-5
        camera = ("format: kincal/1\nrobot: robot.urdf\nbase: base\ntargets:\n  board: {type: chessboard, rows: 5, columns: 7, square: 0.04, mount: {link: base%s}}\n"
                  "sensors:\n  camera: {type: camera, link: hand%s, model: pinhole, intrinsics: [600, 600, 320, 240], image_size: [640, 480], line_time: %g, sigma: 0.1}\n"
                  "joints: {\"*\": {sigma: 0.0001}}\n%s")
        self.write("true.yaml", camera % (", pose: {xyz: [0.9, 0.1, 0.1], rpy: [0, 0, 0]}", ", pose: {xyz: [0.02, 0, 0.05], rpy: [-1.5, 0.1, -1.6]}", row, ""))
        self.kincal("simulate", "true.yaml", "--samples", "60", "--seed", "3", "--out", "made", "--quiet")
        steps = "estimate:\n  - {step: all, free: [sensor/camera/pose, target/board/pose, sensor/camera/line_time]}\n"
        for name, more in (("automatic", ""), ("steps", steps)):
            self.write("rig.yaml", camera % ("", "", 0, more))
            self.kincal("calibrate", "rig.yaml", self.path("made", "samples.jsonl"), "--out", name, "--no-report")
            result = self.result(name)
            self.assertEqual(result["verdict"]["use"], "good")
            self.near(result, "sensor/camera/line_time", row)
            found = result["parameters"]["sensor/camera/line_time"]["value"]
            written = re.search("line_time: (.*)", self.read(name, "rig.yaml"))
            self.assertEqual(float(written[1]), found[0] if isinstance(found, list) else found)
        for entry, said in (("line_time: 1.0", "sensors.camera.line_time: seconds from one row of the image to the next are expected, 0.001 at most"),
                            ("line_time: slow", "sensors.camera.line_time: a finite number is expected, not 'slow'")):
            self.write("wrong.yaml", (camera % ("", "", row, "")).replace("line_time: %g" % row, entry))
            run = self.run_kincal("check", "wrong.yaml", self.path("made", "samples.jsonl"))
            self.assertEqual(run.returncode, 1, run.stdout)
            self.assertIn(said, run.stderr)
        self.write("wrong.yaml", RIG % (", line_time: 1.0e-05", "", ""))
        self.assertIn("line_time", self.run_kincal("check", "wrong.yaml", self.path("made", "samples.jsonl")).stderr)

    def test_mistakes(self):
        samples = self.recorded(PLAY, None)
        self.write("rig.yaml", rig())
        for key, value, said in (("approach", {"x": 1}, "approach.x: unknown joint 'x'"),
                                 ("approach", {"x": 1}, "a, b, c, d, e"),
                                 ("approach", {"a": 0.5}, "approach.a: the direction of the joint's last motion, 1 or -1, is expected, not 0.5"),
                                 ("approach", {"a": "up"}, "approach.a: a finite number is expected, not 'up'"),
                                 ("approach", [1, 1], "approach: a mapping of joint names to numbers is expected"),
                                 ("temperature", 298.15, "temperature: degrees Celsius are expected, -100 to 200, not 298.15 (kelvin? then it is 25)"),
                                 ("temperature", {"a": 20}, "temperature: a finite number is expected"),
                                 ("rates", {"shoulder": 1}, "rates.shoulder: unknown joint 'shoulder'")):
            with self.subTest(said):
                self.write("wrong.jsonl", "\n" + json.dumps(dict(samples[0], **{key: value})) + "\n")
                run = self.run_kincal("check", "rig.yaml", "wrong.jsonl")
                self.assertEqual(run.returncode, 1, run.stdout)
                self.assertIn("wrong.jsonl:2", run.stderr)
                self.assertIn(said, run.stderr)
        for entry, said in (("{ripple: [0, 0, 0, 0]}", "joints.a.ripple: joint 'a' has no gear_ratio"),
                            ("{gear_ratio: 0}", "joints.a.gear_ratio: a ratio greater than 0 is expected, not 0"),
                            ("{gear_ratio: [100, 50]}", "joints.a.gear_ratio: 100 cycles in a turn are those of 50, twice as many"),
                            ("{gear_ratio: [100, 80], ripple: [0, 0, 0, 0]}", "joints.a.ripple: a list of 8 numbers is expected, not a list of 4"),
                            ("{coupling: {a: 0.1}}", "joints.a.coupling.a: 'a' is no other joint that turns and has a reading"),
                            ("{coupling: 0.1}", "joints.a.coupling: a mapping of joint names to numbers is expected"),
                            ("{temperature: hot}", "joints.a.temperature: a finite number is expected, not 'hot'")):
            with self.subTest(said):
                self.write("wrong.yaml", RIG % ("", ", a: " + entry, ""))
                run = self.run_kincal("check", "wrong.yaml", "made/samples.jsonl")
                self.assertEqual(run.returncode, 1, run.stdout)
                self.assertIn("wrong.yaml:", run.stderr)
                self.assertIn(said, run.stderr)


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = (os.path.abspath(p) for p in sys.argv[1:3])
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:])
