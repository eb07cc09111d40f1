"""Local offsets through the program: python3 local_test.py SOURCE_DIR KINCAL [TEST ...]

Makes an arm with six joints and a tracker, and a robot of it whose third joint turns by a sin(q) further than it reads, which no rigid
model has. Proves: after a calibration of such a robot over its workspace, `kincal local` at a posture finds what is left there, the offsets put
into the rig's joints halve the error of fresh samples near, and the error elsewhere is why the file says "not for use elsewhere"; on
a robot without such an error, calibrated likewise, nothing is claimed; file and --json say the same; every way of giving a posture, and
everything wrong with one, is told. It does not prove the statistics (models/trials/local_test.cpp).
"""

import json
import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE_DIR = KINCAL = None
CENTRE = [0.3, -0.8, 1.2, 0.2, 0.9, -0.4]
NEAR = ",".join("j%d=%g" % (i + 1, q) for i, q in enumerate(CENTRE))
ORIGINS = [("0 0 0.3", "0 0 0"), ("0 0 0", "-1.5708 0 0"), ("0.4 0 0", "0 0 0"), ("0.05 0 0", "-1.5708 0 0"), ("0 0 0.35", "1.5708 0 0"),
           ("0 0 0", "-1.5708 0 0")]
RIG = """format: kincal/1
robot: robot.urdf
base: base
joints: {"j?": {sigma: 0.00005}}
targets:
  reflectors:
    type: points
    points: [[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0.02]]
    mount: {link: l6, pose: {xyz: [0.03, 0.02, 0.1]}}
sensors:
  tracker: {type: point, link: base, pose: {xyz: [1, 0.2, 0.1], rpy: [0, 0, 1]}, sigma: 0.00005}
estimate:
  - step: all
    free: [sensor/tracker/pose, joint/j2/offset, joint/j3/offset, joint/j4/offset, joint/j5/offset]
"""


def write(path, text):
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


def read(path):
    with open(path, encoding="utf-8") as file:
        return file.read()


def robot():
    text = '<robot name="arm"><link name="base"/>'
    for i, (xyz, rpy) in enumerate(ORIGINS, 1):
        text += ('<link name="l%d"/><joint name="j%d" type="revolute"><parent link="%s"/><child link="l%d"/><origin xyz="%s" rpy="%s"/>'
                 '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>\n' %
                 (i, i, "l%d" % (i - 1) if i > 1 else "base", i, xyz, rpy))
    text += '<link name="tool"/><joint name="fixed" type="fixed"><parent link="l6"/><child link="tool"/></joint></robot>\n'
    return text


class Case(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="kincal_local_")
        write(cls.path("robot.urdf"), robot())
        write(cls.path("rig.yaml"), RIG)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder, name)

    def run_it(self, *arguments, code=0):
        done = subprocess.run([KINCAL, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL)
        self.assertEqual(done.returncode, code, done.stderr.decode())
        return done.stdout.decode(), done.stderr.decode()

    @classmethod
    def samples(cls, name, seed, workspace, near, spread, a):
        """Postures over the workspace, and around CENTRE; returns the file."""
        draws = random.Random(seed)
        postures = [[draws.uniform(-2, 2) for _ in CENTRE] for _ in range(workspace)]
        postures += [[q + draws.uniform(-spread, spread) for q in CENTRE] for _ in range(near)]
        write(cls.path("postures.jsonl"), "".join(
            json.dumps({"id": "p%d" % i, "joints": {"j%d" % (k + 1): q[k] for k in range(6)}}) + "\n" for i, q in enumerate(postures)))
        subprocess.run([KINCAL, "simulate", cls.path("rig.yaml"), "--samples", str(len(postures)), "--seed", str(seed), "--postures",
                        cls.path("postures.jsonl"), "--out", cls.path("simulated"), "--force"], check=True, stdout=subprocess.DEVNULL)
        lines = []
        for line in read(os.path.join(cls.path("simulated"), "samples.jsonl")).splitlines():
            sample = json.loads(line)
            position = reading = sample["joints"]["j3"]
            for _ in range(50):
                reading = position - a * math.sin(reading)
            sample["joints"]["j3"] = reading
            lines.append(json.dumps(sample) + "\n")
        write(cls.path(name), "".join(lines))
        return cls.path(name)

    def calibrated(self, name, samples):
        result = self.path(name)
        self.run_it("calibrate", self.path("rig.yaml"), samples, "--out", result, "--force", "--quiet")
        return result

    def rms(self, rig, samples):
        return json.loads(self.run_it("evaluate", rig, samples, "--json", "--noise", "none")[0])["sensors"]["tracker"]["train"]["rms"]


class Planted(Case):
    def test_found_after_a_calibration(self):
        """The workspace's calibration knows the mean of a sin(q); the rest is local."""
        for seed in range(1, 4):
            samples = self.samples("all.jsonl", seed, 150, 40, 0.2, 0.004)
            result = self.calibrated("result", samples)
            out = self.path("local.yaml")
            said, _ = self.run_it("local", result, samples, "--near", NEAR, "--out", out, "--force", "--within", "0.5")
            self.assertIn("Valid while no joint is further than", said)
            local = json.loads(self.run_it("local", result, samples, "--near", NEAR, "--within", "0.5", "--json")[0])
            self.assertTrue(local["gain"])
            self.assertGreater(local["radius"], 0.17)
            sensor = local["sensors"]["tracker"]["left_out"]
            self.assertLess(sensor["after"], 0.6 * sensor["before"])

            text = read(os.path.join(result, "rig.yaml"))
            joints = "".join('\n  %s: {offset: %r}' % (name, value["offset"]) for name, value in local["offsets"].items())
            at = text.index("joints:")
            end = text.index("\n", text.index("j?", at))
            os.makedirs(self.path("with_local"), exist_ok=True)
            shutil.copy(os.path.join(result, "robot.urdf"), self.path("with_local"))
            write(os.path.join(self.path("with_local"), "rig.yaml"), text[:end] + joints + text[end:])
            near = self.samples("fresh.jsonl", 100 + seed, 0, 40, 0.15, 0.004)
            far = self.samples("far.jsonl", 200 + seed, 60, 0, 0.15, 0.004)
            before, after = (self.rms(rig, near) for rig in (result, self.path("with_local")))
            self.assertLess(after, 0.6 * before)
            self.assertGreater(self.rms(self.path("with_local"), far), self.rms(result, far))

    def test_nothing_where_there_is_nothing(self):
        for seed in range(1, 11):
            samples = self.samples("all.jsonl", seed, 60, 30, 0.2, 0)
            result = self.calibrated("result", samples)
            said, _ = self.run_it("local", result, samples, "--near", NEAR, "--out", self.path("local.yaml"), "--force")
            self.assertIn("No gain: the global calibration is equally good here", said)
            text = read(self.path("local.yaml"))
            self.assertTrue(text.startswith("# No local offsets: the global calibration is as good here"), text[:200])
            self.assertIn("gain: false", text)
            self.assertIn("radius: null", text)
            for joint in range(1, 7):
                self.assertIn("j%d: {offset: 0, unit: rad}" % joint, text.replace("0.0,", "0,"))


class File(Case):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.data = cls.samples("samples.jsonl", 1, 0, 30, 0.2, 0.004)
        cls.rig = cls.path("rig.yaml")

    def local(self, near, *more, code=0):
        return self.run_it("local", self.rig, self.data, "--near", near, *more, code=code)

    def wrong(self, near, *words, more=(), code=1):
        out, error = self.local(near, "--out", self.path("never.yaml"), *more, code=code)
        self.assertEqual(out, "")
        self.assertTrue(error.startswith("kincal: error: "), error)
        for word in words:
            self.assertIn(word, error)
        self.assertFalse(os.path.exists(self.path("never.yaml")))

    def test_file_says_what_it_is_for(self):
        out = self.path("local.yaml")
        self.local(NEAR, "--out", out, "--force")
        text = read(out)
        for words in ("Use only around this posture", "Do not fold into the URDF", "format: kincal-local/1",
                      "gain: true"):
            self.assertIn(words, text)
        local = json.loads(self.local(NEAR, "--json")[0])
        self.assertEqual(local["format"], "kincal-local/1")
        self.assertEqual(local["near"], NEAR)
        for key in ("rig", "samples", "urdf"):
            self.assertRegex(local["input"][key], "^[0-9a-f]{64}$")
        self.assertEqual(local["posture"], {"j%d" % (i + 1): q for i, q in enumerate(CENTRE)})
        for name, value in local["offsets"].items():
            self.assertEqual(set(value), {"offset", "sigma", "variation", "unit", "determined"})
            self.assertIn("%s: " % name, text)
            self.assertIn("offset: %r" % value["offset"], text)
        truth = 0.004 * math.sin(CENTRE[2])
        self.assertLess(abs(local["offsets"]["j3"]["offset"] - truth), 3 * local["offsets"]["j3"]["sigma"])
        # The file is there: not without --force.
        self.local(NEAR, "--out", out, code=1)
        self.assertEqual(read(out), text)

    def test_ways_to_give_a_posture(self):
        one = json.loads(self.local(NEAR, "--json")[0])
        write(self.path("posture.yaml"), "".join("j%d: %r\n" % (i + 1, q) for i, q in enumerate(CENTRE)))
        write(self.path("posture.json"), json.dumps({"j%d" % (i + 1): q for i, q in enumerate(CENTRE)}))
        for name in ("posture.yaml", "posture.json"):
            other = json.loads(self.local(self.path(name), "--json")[0])
            for key in ("posture", "offsets", "radius", "sensors"):
                self.assertEqual(other[key], one[key])
        sample = json.loads(read(self.data).splitlines()[4])
        by_id = json.loads(self.local(sample["id"], "--json")[0])
        self.assertEqual(by_id["posture"], sample["joints"])
        self.assertEqual(by_id["nearest"], 0)
        self.assertEqual(list(json.loads(self.local("j3=1.2,j5=0.9", "--json")[0])["offsets"]), ["j3", "j5"])

    def test_wrong_postures(self):
        self.wrong("j3=1.2,joint4=0.2", "--near", "unknown joint 'joint4'")
        self.wrong("j3=1.2,j7=0.2", "unknown joint 'j7'", "nearest: j")
        self.wrong("j3=high", "j3", "'high'")
        self.wrong("j3=1,j3=2", "twice")
        self.wrong("j3=1,,j4=2", "joint=value")
        self.wrong("fixed=1", "does not move")
        self.wrong("p333", "not the id of a sample", "nearest: p")
        write(self.path("bad.yaml"), "j1: 0.1\nj33: 0.2\n")
        self.wrong(self.path("bad.yaml"), "bad.yaml:2", "unknown joint 'j33'", "nearest: j3")
        write(self.path("bad.yaml"), "[1, 2]\n")
        self.wrong(self.path("bad.yaml"), "mapping of joints")
        self.wrong(NEAR, "--within", more=("--within", "-1"))

    def test_too_few(self):
        self.wrong("j3=2.9", "0 samples within", "at least 8", "nearest of all samples are at 1.5", code=2)
        self.wrong(NEAR, "0 samples within 0.01", more=("--within", "0.01"), code=2)


def main():
    global SOURCE_DIR, KINCAL
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=sys.argv[:1] + sys.argv[3:], verbosity=1)


if __name__ == "__main__":
    main()
