"""`kincal verify`: python3 verify_test.py SOURCE_DIR KINCAL [TEST ...]

An arm of six joints with a reflector on its flange before a tracker; two data sets of real robots where KINCAL_DATA has them. Proves: figures of positions, distances, repeated postures and of the nominal robot's distances are those of a script of its own (forward
kinematics of the written URDF, plain Python) to four digits; a wide tolerance passes, a narrow one fails, one at the figure is not provable and says how many postures it takes; samples that the calibration has seen, too few, in one place, or of the wrong
instrument are refused, and nothing is written then; a tracker that was set up anew is fitted; noise that the rig does not state is taken out of no figure; the certificate has answer, names, dates and hashes, no script, and two sheets of print. Does not prove: rates of wrong decisions (tests/models/verify).
"""
import hashlib
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
from cli_test import axis_angle, frame, from_quaternion, inverse, link_pose, log_rotation, move, mul, read_joints

SOURCE_DIR = KINCAL = None
RIG = """format: kincal/1
robot: robot.urdf
base: base
serial: A-17
joints:
  "*": {sigma: 0.00002}
targets:
  reflector: {type: points, points: [[0, 0, 0]], mount: {link: flange, pose: {xyz: [0.02, 0.03, 0.1]}}}
sensors:
  tracker: {type: point, link: base, pose: {xyz: [2, 0.3, 0.5], rpy: [0, 0, 3]}, sigma: 0.00003}
estimate:
  - step: all
    free: [joint/lift/offset, joint/bend/offset, joint/forearm_roll/offset, joint/wrist_bend/offset, sensor/tracker/pose, "target/reflector/pose.[xyz]"]
"""
SPREAD = ["--spread", "joint/*/offset=0.003", "--spread", "joint/bend/origin.[xyz]=0.0003", "--spread", "joint/wrist_bend/origin.[xyz]=0.0003", "--spread", "*/pose.[xyz]=0.003"]


def run(*arguments, code=0):
    done = subprocess.run([KINCAL, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=600)
    if done.returncode != code:
        raise AssertionError("%s\nended with %d, not %d\n%s%s" % (" ".join(arguments), done.returncode, code, done.stdout[-2000:], done.stderr[-2000:]))
    return done.stdout if code != 1 else done.stderr


def text_of(path):
    with open(path, encoding="utf-8") as f:
        return f.read()


def samples_of(path):
    return [json.loads(line) for line in text_of(path).splitlines()]


def write_samples(path, samples):
    with open(path, "w", encoding="utf-8") as f:
        f.writelines(json.dumps(s) + "\n" for s in samples)
    return path


def rms(values):
    return math.sqrt(sum(v * v for v in values) / len(values))


def norm(v):
    return math.sqrt(sum(x * x for x in v))


def minus(a, b):
    return [x - y for x, y in zip(a, b)]


class Script:
    """Where a result's files put the target: robot.urdf, and poses and gear scales of result.json; no bending, no curves."""

    def __init__(self, result, mount, urdf=None):
        told = json.loads(text_of(os.path.join(result, "result.json")))["parameters"]
        self.joints = read_joints(text_of(urdf or os.path.join(result, "robot.urdf")))
        self.sensor, self.target, self.sensor_link, self.target_link = mount
        self.pose = {kind: from_quaternion(told[kind]["pose"]["xyz"], told[kind]["pose"]["quat"]) for kind in (self.sensor, self.target) if kind in told}
        self.scale = {name.split("/")[1]: told[name]["value"][0] for name in told if re.fullmatch("joint/[^/]*/scale", name)} if urdf is None else {}

    def predicted(self, sample):
        """sensor_T_target."""
        readings = {name: self.scale.get(name, 1) * value for name, value in sample["joints"].items()}
        there = mul(link_pose(self.joints, self.sensor_link, readings), self.pose[self.sensor])
        return mul(inverse(there), mul(link_pose(self.joints, self.target_link, readings), self.pose[self.target]))

    def positions(self, samples):
        """(measured, predicted) of each sample with one view."""
        out = []
        for sample in samples:
            view, t = sample["views"][0], self.predicted(sample)
            out.append((view["points"][0] if "points" in view else view["pose"]["xyz"], [t[i][3] for i in range(3)]))
        return out

    def figures(self, samples):
        """rms and largest errors of positions and of distances."""
        both = self.positions(samples)
        position = [norm(minus(m, p)) for m, p in both]
        distance = [norm(minus(both[i][0], both[j][0])) - norm(minus(both[i][1], both[j][1])) for i in range(len(both)) for j in range(i)]
        return {"position": (rms(position), max(position)), "distance": (rms(distance), max(map(abs, distance)))}


class Case(unittest.TestCase):
    def close(self, a, b, what=""):
        """Equal to four digits."""
        self.assertLess(abs(a - b), 5e-5 * abs(b), "%s: %r, %r" % (what, a, b))

    def same_figures(self, told, figures):
        for kind, (seen, largest) in figures.items():
            self.close(told[kind]["seen"], seen, kind)
            self.close(told[kind]["max"], largest, kind)


class Verify(Case):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="kincal_verify_")
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        shutil.copy(os.path.join(SOURCE_DIR, "examples", "arm", "robot.urdf"), cls.folder)
        with open(cls.path("rig.yaml"), "w") as f:
            f.write(RIG)
        run("simulate", cls.path("rig.yaml"), "--samples", "40", "--seed", "3", *SPREAD, "--out", cls.path("sim"))
        cls.result = cls.path("result")
        run("calibrate", cls.path("rig.yaml"), cls.path("sim/samples.jsonl"), "--out", cls.result, "--quiet")
        run("simulate", cls.path("rig.yaml"), "--samples", "60", "--seed", "4", "--truth", cls.path("sim/truth.json"), "--out", cls.path("later"))
        cls.samples = cls.path("later/samples.jsonl")
        cls.mount = ("sensor/tracker/pose", "target/reflector/pose", "base", "flange")

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder, name)

    def told(self, samples, *more, code=0):
        return json.loads(run("verify", self.result, samples, "--json", *more, code=code))

    def test_figures(self):
        told = self.told(self.samples)
        self.assertEqual((told["answer"], told["counts"]), ("none", {"postures": 60, "views": 60}))
        samples = samples_of(self.samples)
        self.same_figures(told["after"], Script(self.result, self.mount).figures(samples))
        self.close(told["before"]["distance"]["seen"], Script(self.result, self.mount, self.path("robot.urdf")).figures(samples)["distance"][0])
        self.assertGreater(told["before"]["position"]["rms"], 1.5 * told["after"]["position"]["rms"])
        for kind, noise in (("position", math.sqrt(3) * 3e-5), ("distance", math.sqrt(2) * 3e-5)):
            one = told["after"][kind]
            self.close(one["instrument"], noise)
            self.close(one["rms"], math.sqrt(one["seen"] ** 2 - noise ** 2))
            self.assertTrue(one["lower"] < one["rms"] < one["upper"])
        errors = [p["error"] for p in told["postures"]]
        self.close(rms(errors), told["after"]["position"]["seen"])

    def test_answers(self):
        for standard, kind in (("distances", "distance"), ("iso9283", "position")):
            found = self.told(self.samples, "--standard", standard)["after"][kind]["rms"] * 1000
            for factor, code, answer in ((2, 0, "pass"), (0.5, 4, "fail"), (1.03, 5, "not provable")):
                tolerance = ["--standard", standard, "--tolerance", "frame/target/reflector<%.9fmm" % (factor * found)]
                told = self.told(self.samples, *tolerance, code=code)
                self.assertEqual(told["answer"], answer)
                self.assertEqual(told["tolerance"]["needed"] == 60, code != 5)
                words = run("verify", self.result, self.samples, *tolerance, code=code)
                self.assertTrue(words.startswith(answer), words)
                if code == 5:
                    self.assertGreater(told["tolerance"]["needed"], 100)
                    self.assertIn("about %d postures would" % told["tolerance"]["needed"], words)
        samples = samples_of(self.samples)
        for sample in samples:  # an instrument that is much worse
            sample["views"][0]["sigma"] = 0.002
        blind = write_samples(self.path("blind.jsonl"), samples)
        told = self.told(blind, "--tolerance", "frame/target/reflector<0.05mm", code=5)
        self.assertIsNone(told["tolerance"]["needed"])
        self.assertIn("no number of postures can prove it", told["text"])
        self.assertIn("stated too large", " ".join(told["notes"]))

    def test_refused(self):
        samples, seen = samples_of(self.samples), samples_of(self.path("sim/samples.jsonl"))
        renamed = [dict(s, id="new_%d" % i) for i, s in enumerate(seen)]
        near = [dict(s, joints={name: samples[0]["joints"][name] + 0.01 * math.sin(i + k) for k, name in enumerate(s["joints"])}) for i, s in enumerate(samples)]
        cases = [("few", samples[:5], "5 different postures are too few"), ("again", samples + renamed[:3], "have the same readings as samples that"), ("same", [samples[0]] * 1 + [dict(samples[0], id="r%d" % i) for i in range(9)], "1 different postures"),
                 ("near", near, "all postures are in one place"), ("none", [dict(s, views=[]) for s in samples], "no sample has a view")]
        out = self.path("refused")
        self.assertIn("is the file that", run("verify", self.result, self.path("sim/samples.jsonl"), "--out", out, code=1))
        for name, content, words in cases:
            self.assertIn(words, run("verify", self.result, write_samples(self.path(name + ".jsonl"), content), "--out", out, code=1))
        for more, words in ((["--tolerance", "frame/nobody<1mm"], "there is no frame 'nobody'"), (["--tolerance", "frame/flange<1mm"], "write frame/target/reflector"), (["--tolerance", "frame/elbow<1mm"], "is not on the body"),
                            (["--tolerance", "sensor/tracker<1mm"], "the position of a frame is judged"), (["--tolerance", "frame/target/reflector<1mrad"], "the position of a frame is judged"), (["--standard", "din"], "--standard"), (["--sensor", "eye"], "no view is of sensor 'eye'")):
            self.assertIn(words, run("verify", self.result, self.samples, *more, "--out", out, code=1))
        self.assertIn("result directory of a calibration is expected", run("verify", self.path("rig.yaml"), self.samples, code=1))
        self.assertFalse(os.path.exists(out))

    def test_set_up_anew(self):
        anew = mul(frame((0.4, -0.2, 0.1)), axis_angle((1, 2, 3), 0.2))
        samples = samples_of(self.samples)
        for sample in samples:
            sample["views"][0]["points"] = [move(anew, sample["views"][0]["points"][0])]
        moved = write_samples(self.path("moved.jsonl"), samples)
        there, fitted, here = self.told(moved)["after"], self.told(moved, "--refit-base")["after"], self.told(self.samples, "--refit-base")["after"]
        self.assertGreater(there["position"]["rms"], 0.1)
        self.close(there["distance"]["rms"], self.told(self.samples)["after"]["distance"]["rms"])
        self.close(fitted["position"]["rms"], here["position"]["rms"])
        self.assertLess(fitted["position"]["max"], 0.002)

    def test_repeated(self):
        samples = samples_of(self.samples)[:12]
        more = []
        for i in range(2):
            for k in range(6):
                shift = [1e-4 * math.sin(3 * i + 2 * k), 1e-4 * math.cos(5 * k), (-1) ** k * 5e-5]
                again = json.loads(json.dumps(samples[i]))
                again["id"] = "p%d_%d@%s" % (i, k, "left" if k % 2 else "right")
                again["views"][0]["points"] = [[a + b for a, b in zip(again["views"][0]["points"][0], shift)]]
                more.append(again)
        told = self.told(write_samples(self.path("repeated.jsonl"), samples[2:] + more))
        self.assertEqual((told["counts"], len(told["repeated"])), ({"postures": 12, "views": 22}, 2))
        for i, one in enumerate(told["repeated"]):
            both = Script(self.result, self.mount).positions(more[6 * i:6 * i + 6])
            mean = [sum(m[k] for m, _ in both) / 6 for k in range(3)]
            lengths = [norm(minus(m, mean)) for m, _ in both]
            middle = sum(lengths) / 6
            self.close(one["ap"], norm(minus(mean, both[0][1])))
            self.close(one["rp"], middle + 3 * math.sqrt(sum((x - middle) ** 2 for x in lengths) / 5))
            ways = [[sum(m[k] for m, _ in both[w::2]) / 3 for k in range(3)] for w in (0, 1)]
            self.close(one["vap"], norm(minus(*ways)))

    def test_noise_not_stated(self):
        rig, result = self.path("guess.yaml"), self.path("guessed")
        with open(rig, "w") as f:
            f.write(re.sub("estimate:.*", "", RIG, flags=re.S).replace("sigma: 0.00003", "sigma: {guess: 0.0001}"))
        run("calibrate", rig, self.path("sim/samples.jsonl"), "--out", result, "--quiet")
        told = json.loads(run("verify", result, self.samples, "--json"))
        self.assertIn("does not state the instrument's noise", " ".join(told["notes"]))
        self.close(told["after"]["distance"]["rms"], told["after"]["distance"]["seen"])
        samples = samples_of(self.samples)
        for sample in samples:
            sample["views"][0]["sigma"] = 0.00003
        told = json.loads(run("verify", result, write_samples(self.path("stated.jsonl"), samples), "--json"))
        self.close(told["after"]["distance"]["instrument"], math.sqrt(2) * 3e-5)
        self.assertLess(told["after"]["distance"]["rms"], told["after"]["distance"]["seen"])

    def test_certificate(self):
        out = self.path("certificate")
        run("verify", self.result, self.samples, "--tolerance", "frame/target/reflector<2mm", "--out", out, "--instrument", "Tracker <7> & co", "--environment", "21 °C", "--measured", "2026-03-04", "--quiet")
        self.assertEqual(sorted(os.listdir(out)), ["certificate.html", "certificate.json"])
        told, page = json.loads(text_of(os.path.join(out, "certificate.json"))), text_of(os.path.join(out, "certificate.html"))
        self.assertEqual((told["answer"], told["robot"], told["environment"]), ("pass", {"name": "arm", "serial": "A-17"}, "21 °C"))
        for name in ("result.json", "rig.yaml", "robot.urdf"):
            self.assertEqual(told["sha256"][name], hashlib.sha256(text_of(os.path.join(self.result, name)).encode()).hexdigest())
        self.assertEqual(told["sha256"]["samples"], hashlib.sha256(text_of(self.samples).encode()).hexdigest())
        calibrated = json.loads(text_of(os.path.join(self.result, "result.json")))["input"]["date"]
        for words in ("A-17", "Tracker &lt;7&gt; &amp; co", "21 °C", "2026-03-04", calibrated, told["sha256"]["samples"], "Statement of uncertainty", "%.4g" % (1000 * told["after"]["distance"]["rms"]), 'class="answer pass"'):
            self.assertIn(words, page)
        for words in ("<script", "http://", "https://", "src="):
            self.assertNotIn(words, page)
        before = page
        self.assertIn("exists", run("verify", self.result, self.samples, "--out", out, code=1))
        self.assertIn("has a calibration result", run("verify", self.result, self.samples, "--out", self.result, "--force", code=1))
        self.assertEqual(text_of(os.path.join(out, "certificate.html")), before)
        run("verify", self.result, self.samples, "--out", out, "--force", "--quiet")
        self.assertNotEqual(text_of(os.path.join(out, "certificate.html")), before)


class Data(Case):
    """Real robots: samples that were held out, in a file of their own."""

    @classmethod
    def setUpClass(cls):
        cls.data = os.path.abspath(os.environ.get("KINCAL_DATA") or os.path.join(SOURCE_DIR, "..", "shared", "data"))
        if not os.path.isdir(cls.data):
            raise unittest.SkipTest("no data at KINCAL_DATA or beside the source")
        cls.folder = tempfile.mkdtemp(prefix="kincal_verify_data_")
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)

    def verified(self, files, mount, *more):
        """What verify says, and what the script says."""
        name, rig, samples = files
        result = os.path.join(self.folder, name)
        run("calibrate", os.path.join(self.data, name, rig), os.path.join(self.data, name, samples), "--out", result, "--quiet", *more)
        held_out = [s for s in samples_of(os.path.join(self.data, name, samples)) if s.get("split") == "test"]
        later = write_samples(result + ".jsonl", held_out)
        told = json.loads(run("verify", result, later, "--json"))
        script = Script(result, mount)
        self.same_figures(told["after"], script.figures(held_out))
        return told, script, held_out

    def test_aubo(self):
        told, _, held_out = self.verified(("aubo-i10", "rig_tracker.yaml", "samples_tracker.jsonl"), ("sensor/tracker/pose", "target/reflector/pose", "base_link", "flange"))
        self.assertEqual((told["counts"]["postures"], len(held_out)), (30, 30))

    def test_ipa(self):
        told, script, held_out = self.verified(("ipa-ur10", "rig.yaml", "samples_60.jsonl"), ("sensor/tracker/pose", "target/tmac/pose", "base", "wrist_3_joint_end"), "--no-group", "curve/*", "--no-group", "compliance", "--no-group", "compliance across", "--no-group", "loads")
        angles = []
        for sample in held_out:
            pose = sample["views"][0]["pose"]
            angles.append(norm(log_rotation(mul(inverse(script.predicted(sample)), from_quaternion(pose["xyz"], pose["quat"])))))
        self.close(told["after"]["rotation"]["seen"], rms(angles))
        self.close(told["after"]["rotation"]["max"], max(angles))


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = (os.path.abspath(p) for p in sys.argv[1:3])
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=2)
