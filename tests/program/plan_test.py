"""`kincal plan`: python3 plan_test.py SOURCE_DIR KINCAL [TEST ...]

An arm of six joints with a camera on its flange and a board on the table, and the PR2-like robot of the examples. Proves: planned postures are within limits, their views are possible, `simulate` takes them; robots that are calibrated with them are as
wrong as predicted and less than with random postures of the same candidates (pooled over 12 robots); a plan after samples is worth less than one without, and the same after their result; candidates of a file are chosen from; a tolerance is judged; links that come near each other are
left out; the same seed gives the same plan; its page has the forecast and the robot in each posture; mistakes are named, and nothing is written then. Does not prove: gains on real robots.
"""
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE_DIR = KINCAL = None
RIG = """format: kincal/1
robot: robot.urdf
base: base
joints:
  "*": {sigma: 0.0003}
targets:
  board: {type: chessboard, rows: 5, columns: 7, square: 0.03, mount: {link: base, pose: {xyz: [0.4, 0.1, 0], rpy: [3.14159265358979, 0, 0]}}}
sensors:
  camera: {type: camera, link: flange, model: pinhole, intrinsics: [600, 600, 320, 240], image_size: [640, 480], sigma: 0.1, pose: {xyz: [0.05, 0, 0.03]}}
estimate:
  - step: all
    free: ["joint/*/offset", sensor/camera/pose, target/board/pose]
    priors: {joint/turn/offset: 0.0005, joint/wrist_roll/offset: 0.0005}
"""
SPREAD = ["--spread", "joint/*/offset=0.0015", "--spread", "joint/turn/offset=0.0005", "--spread", "joint/wrist_roll/offset=0.0005", "--spread", "*/pose.[xyz]=0.002", "--spread", "*/pose.r[xyz]=0.005"]


def run(*arguments, code=0):
    done = subprocess.run([KINCAL, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=600)
    if done.returncode != code:
        raise AssertionError("%s\nended with %d, not %d\n%s%s" % (" ".join(arguments), done.returncode, code, done.stdout[-2000:], done.stderr[-2000:]))
    return done.stdout if code != 1 else done.stderr


class Plan(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="kincal_plan_")
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        shutil.copy(os.path.join(SOURCE_DIR, "examples", "arm", "robot.urdf"), cls.folder)
        cls.rig = cls.path("rig.yaml")
        with open(cls.rig, "w") as f:
            f.write(RIG)
        cls.pr2 = os.path.join(SOURCE_DIR, "examples", "pr2", "rig.yaml")

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder, name)

    def plan(self, *more, rig=None, code=0):
        """The forecast, and the postures."""
        out = self.path("postures.jsonl")
        told = json.loads(run("plan", rig or self.rig, *more, "--out", out, "--force", "--json", code=code))
        with open(out) as f:
            return told, [json.loads(line) for line in f]

    def offset_errors(self, postures, seed):
        """Errors and sigmas of the joints' offsets, of a calibration of a simulated robot."""
        file = self.path("some.jsonl")
        with open(file, "w") as f:
            f.write("".join(json.dumps(p) + "\n" for p in postures))
        run("simulate", self.rig, "--samples", str(len(postures)), "--seed", str(seed), "--postures", file, "--out", self.path("sim"), "--force", "--quiet", *SPREAD)
        run("calibrate", self.rig, self.path("sim/samples.jsonl"), "--out", self.path("result"), "--force", "--quiet", "--no-report")
        with open(self.path("result/result.json")) as f:
            result = json.load(f)
        with open(self.path("sim/truth.json")) as f:
            truth = json.load(f)["parameters"]
        out = []
        for name, one in result["parameters"].items():
            if not name.endswith("/offset"):
                continue
            true = truth.get(name, 0.0)
            true = true["true"] if isinstance(true, dict) else true
            true = true[0] if isinstance(true, list) else true
            out.append((one["value"][0] - true, one["sigma"][0]))
        return out

    def test_better_than_random(self):
        told, planned = self.plan("--next", "15", "--candidates", "400")
        self.assertEqual(len(planned), 15)
        last = told["forecast"][-1]
        self.assertEqual(last["postures"], 15)
        self.assertLess(last["planned"], 0.85 * last["random"])
        self.assertLess(told["forecast"][3]["planned"], told["forecast"][0]["planned"])
        _, pool = self.plan("--next", "400", "--candidates", "400")
        pool.sort(key=lambda p: p["id"])
        squares = {"planned": 0, "random": 0}
        normal = count = 0
        for seed in range(12):
            some = [pool[(37 * seed + 23 * i) % len(pool)] for i in range(15)]
            for name, postures in (("planned", planned), ("random", some)):
                for error, sigma in self.offset_errors(postures, 100 + seed):
                    squares[name] += error ** 2
                    if name == "planned":
                        normal += (error / sigma) ** 2
                        count += 1
        self.assertLess(squares["planned"], squares["random"])
        self.assertEqual(count, 72)
        self.assertLess(abs(normal / count - 1), 4 * math.sqrt(2 / count))

    def test_postures(self):
        told, postures = self.plan("--next", "10", "--candidates", "200")
        again, same = self.plan("--next", "10", "--candidates", "200")
        self.assertEqual((told, postures), (again, same))
        limits = {"turn": 2.9, "lift": 2.0, "bend": 2.6, "forearm_roll": 3.1, "wrist_bend": 2.2, "wrist_roll": 3.1}
        for posture in postures:
            self.assertEqual(set(posture["joints"]), set(limits))
            for name, limit in limits.items():
                self.assertLessEqual(abs(posture["joints"][name]), limit)
            self.assertEqual(posture["views"], [{"sensor": "camera", "target": "board"}])
        with open(self.path("safe.jsonl"), "w") as f:
            f.write("".join(json.dumps(p) + "\n" for p in postures))
            away = dict(postures[0]["joints"], turn=-postures[0]["joints"]["turn"], wrist_bend=0.0, lift=-1.5)
            f.write(json.dumps({"id": "away", "joints": away}) + "\n")
        few, chosen = self.plan("--next", "4", "--postures", self.path("safe.jsonl"))
        self.assertEqual(few["candidates"], 11)
        self.assertEqual(sum(count for why, count in few["left_out"].items() if why.startswith("no sensor sees a target whole, a point is ")), 1, few["left_out"])
        self.assertLess({p["id"] for p in chosen}, {p["id"] for p in postures})
        told = run("simulate", self.rig, "--samples", "4", "--seed", "1", "--postures", self.path("postures.jsonl"), "--out", self.path("s"), "--force")
        self.assertIn("4 samples, camera 4 views", told)

    def test_after_samples(self):
        told, postures = self.plan("--next", "10", "--candidates", "200")
        run("simulate", self.rig, "--samples", "10", "--seed", "3", "--postures", self.path("postures.jsonl"), "--out", self.path("first"), "--force", "--quiet")
        more, _ = self.plan(self.path("first/samples.jsonl"), "--next", "10", "--candidates", "200")
        self.assertAlmostEqual(more["forecast"][0]["planned"] / told["forecast"][-1]["planned"], 1, delta=0.2)
        self.assertLess(more["forecast"][-1]["planned"], more["forecast"][0]["planned"])
        run("calibrate", self.rig, self.path("first/samples.jsonl"), "--out", self.path("first/result"), "--quiet", "--no-report")
        of_result, _ = self.plan("--next", "10", "--candidates", "200", rig=self.path("first/result"))
        for own, others in zip(of_result["forecast"], more["forecast"]):
            self.assertAlmostEqual(own["planned"] / others["planned"], 1, delta=0.05)

    def test_undetermined_zeros(self):
        """Without steps: what the samples do not determine counts, whether the plan is after samples or after their result, and no posture helps against it."""
        with open(self.path("bare.yaml"), "w") as f:
            f.write(RIG[:RIG.index("estimate:")])
        run("simulate", self.rig, "--samples", "40", "--seed", "3", "--out", self.path("bare"), "--force", "--quiet", *SPREAD)
        samples = self.path("bare/samples.jsonl")
        run("calibrate", self.path("bare.yaml"), samples, "--out", self.path("bare_result"), "--force", "--quiet", "--no-report")
        goal = ["--next", "3", "--candidates", "300", "--goal", "frame/flange<0.3mm"]
        after_samples, _ = self.plan(samples, *goal, rig=self.path("bare.yaml"), code=4)
        after_result, _ = self.plan(*goal, rig=self.path("bare_result"), code=4)
        first = [told["forecast"][0]["planned"] for told in (after_samples, after_result)]
        self.assertGreater(first[0], 1e-3)
        self.assertLess(abs(first[0] / first[1] - 1), 0.05)
        for told in (after_samples, after_result):
            self.assertIsNone(told["needed"])
            self.assertGreater(told["floor"]["error"], 0.9 * first[0])

    def test_goal(self):
        told, _ = self.plan("--next", "10", "--candidates", "200", "--goal", "frame/flange<3mm")
        self.assertEqual(told["tolerance"], 0.003)
        self.assertGreater(told["needed"], 1)
        told, _ = self.plan("--next", "10", "--candidates", "200", "--goal", "frame/flange<0.01mm", code=4)
        self.assertIsNone(told["needed"])
        words = run("plan", self.rig, "--next", "10", "--candidates", "200", "--goal", "frame/flange<0.01mm", "--out", self.path("p"), "--force", code=4)
        self.assertIn("out of reach, because the noise of the joints' readings alone is larger", words)
        told, _ = self.plan("--next", "10", "--candidates", "200", "--goal", "joint/lift/offset")
        self.assertEqual(told["unit"], "")

    def test_fewer_than_asked(self):
        told = run("plan", self.rig, "--next", "20", "--candidates", "10", "--out", self.path("few.jsonl"), "--force")
        with open(self.path("few.jsonl")) as f:
            count = len(f.readlines())
        self.assertLess(count, 20)
        self.assertIn("Only %d of 20 postures: no other candidate is left." % count, told)
        self.assertNotIn("Only", run("plan", self.rig, "--next", "2", "--candidates", "100", "--out", self.path("few.jsonl"), "--force"))

    def test_clearance(self):
        told, _ = self.plan("--next", "5", "--candidates", "200", rig=self.pr2)
        near = [why for why in told["left_out"] if " comes near " in why]
        self.assertTrue(near)
        without, _ = self.plan("--next", "5", "--candidates", "200", "--no-clearance", rig=self.pr2)
        self.assertFalse([why for why in without["left_out"] if " comes near " in why])

    def test_page(self):
        """Its forecast and postures are those printed and written, the robot is drawn in each; a page that exists stays, and no file is written then."""
        page = self.path("plan.html")
        told, postures = self.plan("--next", "5", "--candidates", "200", "--report", page)
        with open(page, encoding="utf-8") as f:
            data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', f.read(), re.S).group(1))
        views = data["result"]["plan"].pop("views")
        self.assertEqual((data["result"]["kind"], data["result"]["plan"]), ("plan", told))
        self.assertEqual(data["samples"]["id"], [p["id"] for p in postures])
        self.assertEqual(views, [[[v["sensor"], v["target"]] for v in p["views"]] for p in postures])
        for name in postures[0]["joints"]:
            for drawn, posture in zip(data["samples"]["joints"][name], postures):
                self.assertAlmostEqual(drawn, posture["joints"][name], delta=1e-6)
        self.assertEqual(data["result"]["scene"]["sensors"][0]["before"], data["result"]["scene"]["sensors"][0]["after"])
        free, postures = self.plan("--next", "5", "--candidates", "200", "--report", self.path("pr2.html"), rig=self.pr2)
        with open(self.path("pr2.html"), encoding="utf-8") as f:
            data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', f.read(), re.S).group(1))
        for i, posture in enumerate(postures):
            for target, pose in posture.get("targets", {}).items():
                for drawn, given in zip(data["samples"]["targets"][target][i], pose["xyz"]):
                    self.assertAlmostEqual(drawn, given, delta=1e-5)
        self.assertIn("exists", run("plan", self.rig, "--candidates", "10", "--out", self.path("new.jsonl"), "--report", page, code=1))
        self.assertFalse(os.path.exists(self.path("new.jsonl")))

    def test_mistakes(self):
        out = self.path("none.jsonl")
        for more, words in ((["--goal", "frame/nobody"], "--goal: there is no frame 'nobody'"), (["--goal", "frame/flange<3px"], "--goal 'frame/flange<3px': 'px' is no unit of a frame"), (["--goal", "joint/lfit/offset"], "matches no parameter"),
                            (["--goal", "sensor/camera/intrinsics"], "nothing that this calibration estimates changes it"), (["--next", "0"], "--next")):
            self.assertIn(words, run("plan", self.rig, "--out", out, *more, code=1))
        with open(self.path("open.yaml"), "w") as f:
            f.write(RIG.replace(", pose: {xyz: [0.05, 0, 0.03]}", ""))
        self.assertIn("the rig has no value of sensor/camera/pose, so that", run("plan", self.path("open.yaml"), "--out", out, code=1))
        with open(self.path("behind.yaml"), "w") as f:
            f.write(RIG.replace("rpy: [3.14159265358979, 0, 0]", "rpy: [0, 0, 0]").replace("xyz: [0.4, 0.1, 0]", "xyz: [40, 0.1, 0]"))
        self.assertIn("no random posture shows enough", run("plan", self.path("behind.yaml"), "--candidates", "10", "--out", out, code=1))
        self.assertFalse(os.path.exists(out))
        with open(out, "w") as f:
            f.write("mine")
        self.assertIn("exists", run("plan", self.rig, "--out", out, code=1))


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = (os.path.abspath(p) for p in sys.argv[1:3])
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=2)
