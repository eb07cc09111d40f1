"""`kincal verify`: python3 verify_test.py SOURCE_DIR KINCAL [TEST ...]

An arm of six joints with a reflector on its flange before a tracker; two data sets of real robots where KINCAL_DATA has them. Proves: figures of positions, distances, repeated postures and of the nominal robot's distances are those of a script of its own (forward
kinematics of the written URDF, plain Python) to four digits; a wide tolerance passes, a narrow one fails, one at the figure is not provable and says how many postures it takes; samples that the calibration has seen, too few, in one place, or of the wrong
instrument are refused, and nothing is written then; tolerances on the largest error and on rotations are judged within their limits; the test poses of ISO 9283 lie where they should, within
the joints' limits, and accuracy, repeatability and vAP of their simulated cycles are those of the script, also of a robot with a planted error; rigs without such poses are refused with the cause; a tracker that was set up anew is fitted; noise that the rig does not state is taken out of no figure; the certificate has answer, names, dates and hashes, no script, and two sheets of print. Does not prove: rates of wrong decisions (tests/models/verify).
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
        cases = [("few", samples[:4], "4 different postures are too few"), ("again", samples + renamed[:3], "have the same readings as samples that"), ("same", [samples[0]] * 1 + [dict(samples[0], id="r%d" % i) for i in range(9)], "1 different postures"),
                 ("near", near, "all postures are in one place"), ("none", [dict(s, views=[]) for s in samples], "no sample has a view")]
        out = self.path("refused")
        self.assertIn("is the file that", run("verify", self.result, self.path("sim/samples.jsonl"), "--out", out, code=1))
        for name, content, words in cases:
            self.assertIn(words, run("verify", self.result, write_samples(self.path(name + ".jsonl"), content), "--out", out, code=1))
        for more, words in ((["--tolerance", "frame/nobody<1mm"], "there is no frame 'nobody'"), (["--tolerance", "frame/flange<1mm"], "write frame/target/reflector"), (["--tolerance", "frame/elbow<1mm"], "is not on the body"),
                            (["--tolerance", "sensor/tracker<1mm"], "an error of a frame is judged"), (["--tolerance", "maximum frame/flange<1mm"], "or its largest, 'max frame/NAME<0.8mm'"),
                            (["--tolerance", "max frame/target/reflector<1px"], "'px' is no unit of a frame"), (["--tolerance", "frame/target/reflector<1mrad"], "distances have no rotations"),
                            (["--standard", "iso9283", "--tolerance", "frame/target/reflector<0.1deg"], "measures points, no rotations"), (["--standard", "din"], "--standard"), (["--sensor", "eye"], "no view is of sensor 'eye'")):
            self.assertIn(words, run("verify", self.result, self.samples, *more, "--out", out, code=1))
        self.assertIn("result directory of a calibration is expected", run("verify", self.path("rig.yaml"), self.samples, code=1))
        self.assertFalse(os.path.exists(out))

    def test_largest(self):
        for standard, kind in (("distances", "distance"), ("iso9283", "position")):
            one = self.told(self.samples, "--standard", standard)["after"][kind]
            self.assertTrue(one["max_lower"] < one["max"] < one["max_upper"])
            for limit, code, answer in ((1.01 * one["max_upper"], 0, "pass"), (one["max"], 5, "not provable"), (0.99 * one["max_lower"], 4, "fail")):
                told = self.told(self.samples, "--standard", standard, "--tolerance", "max frame/target/reflector<%.9fmm" % (1000 * limit), code=code)
                self.assertEqual((told["answer"], told["tolerance"]["of"], told["tolerance"]["quantity"], told["tolerance"]["needed"]), (answer, "max", kind, None))
                self.assertIn("largest error of %ss of target/reflector is %.4g mm" % (kind, 1000 * one["max"]), told["text"])
                self.assertAlmostEqual(told["tolerance"]["share"], 0.02275 ** (1 / (60 if kind == "position" else 30)), 4)
            self.assertIn("not more postures but repeated ones", self.told(self.samples, "--standard", standard, "--tolerance", "max frame/target/reflector<%.9fmm" % (1000 * one["max"]), code=5)["text"])

    def test_rotations(self):
        rig, result = self.path("poses.yaml"), self.path("of_poses")
        with open(rig, "w") as f:
            f.write(RIG.replace("type: point,", "type: pose,").replace("sigma: 0.00003", "sigma: {translation: 0.00003, rotation: 0.0001}").replace('"target/reflector/pose.[xyz]"', "target/reflector/pose"))
        run("simulate", rig, "--samples", "40", "--seed", "3", *SPREAD, "--spread", "joint/wrist_bend/origin.r[xyz]=0.001", "--out", self.path("poses"))
        run("calibrate", rig, self.path("poses/samples.jsonl"), "--out", result, "--quiet")
        run("simulate", rig, "--samples", "60", "--seed", "4", "--truth", self.path("poses/truth.json"), "--out", self.path("poses_later"))
        samples = self.path("poses_later/samples.jsonl")
        told = json.loads(run("verify", result, samples, "--json"))
        one = told["after"]["rotation"]
        script = Script(result, self.mount)
        angles = [norm(log_rotation(mul(inverse(script.predicted(s)), from_quaternion(s["views"][0]["pose"]["xyz"], s["views"][0]["pose"]["quat"])))) for s in samples_of(samples)]
        self.close(one["seen"], rms(angles))
        self.close(one["max"], max(angles))
        self.close(one["instrument"], math.sqrt(3) * 1e-4)
        self.close(one["rms"], math.sqrt(one["seen"] ** 2 - one["instrument"] ** 2))
        self.assertGreater(one["max_lower"], 0)
        for words, of in (("", ""), ("max ", "max_")):
            for limit, code in ((1.01 * one[of + "upper"], 0), (0.99 * one[of + "lower"], 4)):
                limit = math.degrees(limit)
                told = json.loads(run("verify", result, samples, "--standard", "iso9283", "--tolerance", "%sframe/flange<%.9fdeg" % (words, limit), "--json", code=code))
                self.assertEqual(told["tolerance"]["quantity"], "rotation")
                self.assertIn("error of rotations of flange is", told["text"])
                self.assertIn(" %.4g deg" % limit, told["text"])

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

    def planned(self, *more, rig=None, code=0):
        """What `plan --verify` says, and its postures."""
        out = self.path("planned.jsonl")
        told = run("plan", rig or self.result, "--verify", "--standard", "iso9283", *more, "--out", out, "--force", "--json", code=code)
        return (told, None) if code else (json.loads(told), samples_of(out))

    def position(self, script, joints):
        """Of the reflector, in the base."""
        return [mul(link_pose(script.joints, "flange", joints), script.pose["target/reflector/pose"])[i][3] for i in range(3)]

    def test_protocol(self):
        plan, postures = self.planned()
        self.assertEqual((self.planned()), (plan, postures))
        self.assertEqual((plan["cycles"], len(postures), plan["postures"]), (30, 150, [p["id"] for p in postures]))
        self.assertEqual([p["id"] for p in postures[:6]], ["P5_01", "P4_01", "P3_01", "P2_01", "P1_01", "P5_02"])
        limits = {"turn": 2.9, "lift": 2.0, "bend": 2.6, "forearm_roll": 3.1, "wrist_bend": 2.2, "wrist_roll": 3.1}
        script, edge, centre = Script(self.result, self.mount), plan["cube"]["edge"], plan["cube"]["centre"]
        self.assertGreater(edge, 0.5)  # of an arm that reaches 0.9 m round its shoulder
        points = {}
        for pose in plan["poses"]:
            points[pose["name"]] = self.position(script, pose["joints"])
            self.assertLess(norm(minus(points[pose["name"]], pose["xyz"])), 2e-6)
            self.assertTrue(all(abs(pose["joints"][name]) <= limit for name, limit in limits.items()))
        self.assertLess(norm(minus(points["P1"], centre)), 2e-6)
        for name in ("P2", "P3", "P4", "P5"):
            self.close(norm(minus(points[name], centre)), 0.8 * edge * math.sqrt(3) / 2)

        # The robot as it is has an error that the calibration does not know.
        with open(self.path("sim/truth.json")) as f:
            truth = json.load(f)
        known = truth["parameters"].get("joint/bend/offset", 0)
        truth["parameters"]["joint/bend/offset"] = (known["true"] if isinstance(known, dict) else known) + 0.01
        with open(self.path("bent.json"), "w") as f:
            json.dump({"parameters": truth["parameters"]}, f)
        for number, name in enumerate(("sim/truth.json", "bent.json")):
            out = self.path("cycles%d" % number)
            run("simulate", self.path("rig.yaml"), "--samples", "150", "--seed", "9", "--truth", self.path(name), "--postures", self.path("planned.jsonl"), "--out", out)
            measured = os.path.join(out, "samples.jsonl")
            told = self.told(measured, "--standard", "iso9283", "--tolerance", "max frame/target/reflector<2mm", code=4 if number else 0)
            self.assertEqual((told["counts"], [one["count"] for one in told["repeated"]]), ({"postures": 5, "views": 150}, [30] * 5))
            for one in told["repeated"]:
                both = script.positions([s for s in samples_of(measured) if s["id"][:2] == one["posture"][:2]])
                mean, expected = ([sum(b[w][k] for b in both) / 30 for k in range(3)] for w in (0, 1))
                lengths = [norm(minus(m, mean)) for m, _ in both]
                middle = sum(lengths) / 30
                self.close(one["ap"], norm(minus(mean, expected)))
                self.close(one["rp"], middle + 3 * math.sqrt(sum((x - middle) ** 2 for x in lengths) / 29))
            self.close(told["after"]["position"]["seen"], rms([one["ap"] for one in told["repeated"]]))
            self.assertEqual(max(one["ap"] for one in told["repeated"]) > 2e-3, number == 1)
            self.assertLess(max(one["rp"] for one in told["repeated"]), 3e-4)

    def test_region(self):
        plan, _ = self.planned("--region", "0.3,-0.5,0,1,0.5,1", "--cycles", "1")
        edge, centre = plan["cube"]["edge"], plan["cube"]["centre"]
        self.assertGreater(edge, 0.3)
        for low, high, middle in zip((0.3, -0.5, 0), (1, 0.5, 1), centre):
            self.assertTrue(low <= middle - edge / 2 and middle + edge / 2 <= high)

    def test_approaches(self):
        plan, postures = self.planned("--approaches", "--cycles", "3")
        self.assertEqual([p["id"] for p in postures[:11]], ["P5_01", "P4_01@x", "P4_01@y", "P4_01@z", "P3_01", "P2_01@x", "P2_01@y", "P2_01@z", "P1_01@x", "P1_01@y", "P1_01@z"])
        self.assertEqual((len(postures), plan["cycles"]), (33, 3))
        script, edge, centre = Script(self.result, self.mount), plan["cube"]["edge"], plan["cube"]["centre"]
        for posture in postures[:11]:
            self.assertEqual("from" in posture, "@" in posture["id"])
            if "from" not in posture:
                continue
            at = self.position(script, posture["joints"])
            way = minus(at, self.position(script, posture["from"]))
            axis = "xyz".index(posture["id"][-1])
            self.assertLess(max(abs(w) for k, w in enumerate(way) if k != axis), 5e-6)
            self.assertAlmostEqual(abs(way[axis]), 0.1 * edge, 5)
            outwards = 1 if posture["id"].startswith("P1") else at[axis] - centre[axis]
            self.assertGreater(way[axis] * outwards, 0)
        run("simulate", self.path("rig.yaml"), "--samples", "33", "--seed", "9", "--truth", self.path("sim/truth.json"), "--postures", self.path("planned.jsonl"), "--out", self.path("ways"))
        told = self.told(self.path("ways/samples.jsonl"), "--standard", "iso9283")
        self.assertEqual({one["posture"][:2]: one["count"] for one in told["repeated"]}, {"P1": 9, "P2": 9, "P3": 3, "P4": 9, "P5": 3})
        for one in told["repeated"]:
            self.assertEqual("vap" in one, one["count"] == 9)
            if one["count"] < 9:
                continue
            views = [s for s in samples_of(self.path("ways/samples.jsonl")) if s["id"][:2] == one["posture"][:2]]
            means = [[sum(m[k] for m, _ in script.positions([s for s in views if s["id"].endswith(way)])) / 3 for k in range(3)] for way in "xyz"]
            self.close(one["vap"], max(norm(minus(a, b)) for a in means for b in means))

    def test_protocol_refused(self):
        urdf = text_of(self.path("robot.urdf"))
        shutil.rmtree(self.path("other"), ignore_errors=True)
        os.mkdir(self.path("other"))

        def refused(words, rig=RIG, robot=urdf, more=()):
            for name, text in (("rig.yaml", rig), ("robot.urdf", robot)):
                with open(self.path("other/" + name), "w") as f:
                    f.write(text)
            self.assertIn(words, self.planned(*more, rig=self.path("other/rig.yaml"), code=1)[0])

        refused("'tracker' is a camera: an instrument that measures points or poses is expected", re.sub("type: point, link: base,", "type: camera, link: base, model: pinhole, intrinsics: [600, 600, 320, 240], image_size: [640, 480],", RIG).replace("sigma: 0.00003}", "sigma: 0.1}"))
        refused("stands still", RIG.replace("link: flange, pose: {xyz: [0.02", "link: base, pose: {xyz: [0.02"))
        refused("'tracker' moves with the robot", RIG.replace("type: point, link: base", "type: point, link: elbow"))
        refused("sensor/tracker/pose is not known: give its pose, or plan with the result of a calibration", RIG.replace("pose: {xyz: [2, 0.3, 0.5], rpy: [0, 0, 3]}, ", ""))
        second = re.search("  tracker: .*\n", RIG)[0]
        refused("choose with --sensor", RIG.replace(second, second + second.replace("tracker:", "other:")))
        refused("no sensor 'eye' sees a target", more=["--sensor", "eye"])
        flat = re.sub('(<joint name="(?!turn)[a-z_]*" type=)"revolute"', '\\1"fixed"', urdf)
        refused("no cube fits in the space where target 'reflector' is reached and sensor 'tracker' sees it", re.sub("joint/(?!turn)[a-z_]*/offset, ", "", RIG), flat)
        for more, words in ((["--next", "3"], "--next excludes --verify"), (["--standard", "din"], "--standard"), (["--cycles", "0"], "--cycles")):
            self.assertIn(words, self.planned(*more, code=1)[0])
        self.assertIn("--cycles requires --verify", run("plan", self.result, "--cycles", "3", "--out", self.path("x.jsonl"), code=1))
        for region, words in (("0,0,0,1,1", "--region"), ("1,0,0,0,1,1", "the first corner is not below the second"), ("5,5,5,6,6,6", "no cube fits in the space")):
            self.assertIn(words, self.planned("--region", region, code=1)[0])
        # A joint without limits turns once at most.
        with open(self.path("other/rig.yaml"), "w") as f:
            f.write(RIG)
        with open(self.path("other/robot.urdf"), "w") as f:
            f.write(re.sub('(<joint name="turn" type=)"revolute"', '\\1"continuous"', urdf))
        plan, postures = self.planned("--cycles", "1", rig=self.path("other/rig.yaml"))
        self.assertEqual(len(postures), 5)
        self.assertTrue(all(abs(p["joints"]["turn"]) <= math.pi for p in postures))

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
