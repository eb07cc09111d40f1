"""Hostile and odd input through the program: python3 faults_test.py SOURCE_DIR KINCAL [TEST ...]

Proves, with the small robot of cli_test.py: input at which a program may crash, hang, fill the memory or write what it cannot read
itself ends in one clear error (exit code 1), or in a result that kincal and other readers take: names that YAML could misread, samples
from a pipe, results that were tampered with, nesting and sizes without bounds, samples with very many views, an end of the memory or of
threads. What units show by themselves is in the C++ tests.
"""

import hashlib
import json
import os
import random
import resource
import signal
import subprocess
import sys
import threading
import time
import unittest

import cli_test
import helpers
from cli_test import RIG, URDF, Case, lines, make_samples

try:
    import yaml
except ImportError:  # then only kincal reads what kincal wrote
    yaml = None


class Faults(Case):
    def replaced(self, name, text, *pairs):
        for old, new in pairs:
            self.assertIn(old, text)
            text = text.replace(old, new)
        return self.write(name, text)

    def limited(self, *args, megabytes, timeout=120):
        """A run with an address space of so many megabytes, where no sanitizer needs more; never a signal, never without an end."""
        def limit():
            resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))
        p = subprocess.Popen([cli_test.KINCAL] + list(args), stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL,
                             cwd=self.dir, preexec_fn=None if cli_test.sanitized() else limit)
        try:
            out, err = p.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            p.kill()
            p.communicate()
            self.fail("no end within %g s" % timeout)
        self.assertGreaterEqual(p.returncode, 0, "killed by signal %d; %s" % (-p.returncode, err.decode()[-500:]))
        return cli_test.Run(p, out.decode(), err.decode())

    def reads_back(self, directory="out"):
        """Every reader takes what was written."""
        run = self.run_kincal("evaluate", directory, "samples.jsonl")
        self.assertEqual(run.code, 0, run.err)
        if yaml:
            for name in ("rig.yaml", "changes.yaml"):
                with self.subTest(name):
                    yaml.safe_load(self.read(directory, name))
            return yaml.safe_load(self.read(directory, "changes.yaml"))
        return None


class Names(Faults):
    def test_globs_with_question_marks(self):
        self.replaced("rig.yaml", RIG, ("free: [sensor/tracker/pose, sensor/eye/pose]", "free:\n      - sensor/trac?er/pose\n      - sensor/eye/pose\n"
                                        "    priors:\n      sensor/e?e/pose: 0.1"))
        run = self.calibrate()
        self.assertEqual(run.code, 0, run.err)
        self.reads_back()

    def test_joint_names_that_are_yaml(self):
        for name in ("turn: b", "turn #b", "{turn", "!turn", "turn%", "*turn", "turn\u2028x", "turn\u0085x", "\ufeffturn", "turn?", "- turn"):
            with self.subTest(name=name):
                escaped = name.replace("\u0085", "&#x85;").replace("\ufeff", "&#xfeff;")
                self.replaced("robot.urdf", URDF, ('joint name="turn"', 'joint name="%s"' % escaped))
                quoted = json.dumps(name)
                self.replaced("rig.yaml", RIG, ("joint/turn/scale", json.dumps("joint/%s/scale" % name)), ("slide: {sigma", "%s: {sigma: 0.0005}\n  slide: {sigma" % quoted))
                self.write("samples.jsonl", lines(make_samples()).replace('"turn"', quoted))
                run = self.calibrate("--force")
                self.assertEqual(run.code, 0, run.err)
                changes = self.reads_back()
                if changes:
                    self.assertIn(name, changes["transmissions"])

    def test_sensor_and_target_names_with_line_separators(self):
        for mark in "\u0085\u2028\u2029\ufeff\u009f":
            with self.subTest(mark=ascii(mark)):
                name = "trac" + mark + "ker"
                self.replaced("rig.yaml", RIG, ("  tracker:\n", "  %s:\n" % json.dumps(name)), ("[tracker, eye]", "[%s, eye]" % json.dumps(name)),
                              ("sensor/tracker/pose", '"sensor/trac\\u%04xker/pose"' % ord(mark)))
                self.write("samples.jsonl", lines(make_samples()).replace('"tracker"', json.dumps(name)))
                run = self.calibrate("--force")
                self.assertEqual(run.code, 0, run.err)
                self.reads_back()
                if yaml:
                    self.assertIn(name, yaml.safe_load(self.read("out", "rig.yaml"))["sensors"])

    def test_long_names(self):
        long = "turn" + "x" * 1100
        self.replaced("robot.urdf", URDF, ('joint name="turn"', 'joint name="%s"' % long))
        self.fails(self.calibrate(), "robot.urdf:", "1104 bytes", "200")
        fits = "turn" + "x" * 196
        self.replaced("robot.urdf", URDF, ('joint name="turn"', 'joint name="%s"' % fits))
        self.replaced("rig.yaml", RIG, ("joint/turn/", "joint/%s/" % fits))
        self.write("samples.jsonl", lines(make_samples()).replace('"turn"', '"%s"' % fits))
        run = self.calibrate()
        self.assertEqual(run.code, 0, run.err)
        self.reads_back()
        self.extra = {"out"}
        self.write("robot.urdf", URDF)
        self.replaced("rig.yaml", RIG, ("  tracker:\n", "  %s:\n" % ("t" * 201)))
        self.fails(self.calibrate("--force"), "rig.yaml:", "201 bytes", "200")


class Pipes(Faults):
    def hash_of(self, directory="out"):
        return self.result(directory)["input"]["samples"]

    def test_samples_from_a_pipe(self):
        text = self.read("samples.jsonl").encode()
        self.extra = {"pipe"}
        os.mkfifo(self.path("pipe"))
        for command in (("calibrate", "rig.yaml", "pipe", "--out", "out"), ("local", "out", "pipe", "--near", "arm_000", "--within", "9", "--out", "local.yaml")):
            def feed():
                with open(self.path("pipe"), "wb") as f:
                    f.write(text)
            writer = threading.Thread(target=feed, daemon=True)
            writer.start()
            p = subprocess.Popen([cli_test.KINCAL] + list(command), cwd=self.dir, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
            try:
                err = p.communicate(timeout=60)[1]
            except subprocess.TimeoutExpired:
                p.kill()
                p.communicate()
                self.fail("%s reads its samples a second time" % command[0])
            self.assertEqual(p.returncode, 0, err.decode())
            writer.join(10)
        self.assertEqual(self.hash_of(), hashlib.sha256(text).hexdigest())
        self.assertIn(hashlib.sha256(text).hexdigest(), self.read("local.yaml"))

    def test_samples_from_a_pipe_without_a_name(self):
        read, write = os.pipe()
        text = self.read("samples.jsonl").encode()
        threading.Thread(target=lambda: (os.write(write, text[:60000]), os.write(write, text[60000:]), os.close(write)), daemon=True).start()
        run = self.run_kincal("calibrate", "rig.yaml", "/dev/fd/%d" % read, "--out", "out", pass_fds=[read])
        os.close(read)
        self.assertEqual(run.code, 0, run.err)
        self.assertEqual(self.hash_of(), hashlib.sha256(text).hexdigest())


class Tampered(Faults):
    def setUp(self):
        super().setUp()
        self.replaced("rig.yaml", RIG, ("target/plate/pose,", "target/plate/pose.x, target/plate/pose.ry, target/plate/pose.rx,"))
        run = self.calibrate()
        self.assertEqual(run.code, 0, run.err)
        self.good = self.result()
        self.extra = {"out"}

    def tampered(self, change, *words, commands=("apply", "diff")):
        result = json.loads(json.dumps(self.good))
        change(result)
        self.write("out/result.json", json.dumps(result, indent=1))
        for command in commands:
            with self.subTest(words=words, command=command):
                args = ("apply", "out", "robot.urdf", "--out", "other.urdf") if command == "apply" else ("diff", "out", "out")
                self.fails(self.run_kincal(*args), "result.json:", *words)

    def test_lists_for_mappings(self):
        for key in ("joints", "reductions"):
            for wrong in ([{"offset": 1}], [], [1], "text", 3):
                self.tampered(lambda r: r["robot"].update({key: wrong}), "robot." + key, "a mapping is expected")
        self.tampered(lambda r: r["robot"].update(mimics=[1, 2]), "robot.mimics", "a mapping is expected", commands=("apply",))
        self.tampered(lambda r: r.update(parameters=[{"sigma": [1]}]), "parameters", "a mapping is expected", commands=("diff",))
        self.tampered(lambda r: r["robot"].update(joint_models=[["turn"]]), "robot.joint_models", "a mapping is expected", commands=("apply",))
        self.tampered(lambda r: r["robot"].update(joint_models={"turn": [1]}), "robot.joint_models.turn", "a mapping is expected", commands=("apply",))

    def test_indices(self):
        reduction = {"scale": 1.5, "old": 1, "new": 2, "written": True}
        for joint in ("tool_joint", "follower", "nobody"):  # fixed, mimic, absent
            self.tampered(lambda r: r["robot"]["reductions"].update({joint: reduction}), "robot.reductions." + joint, "another robot", commands=("diff",))
        for value in ([0.5], [], [0, 0, 0, 0, 0, 0, 0], {"a": 1}, None):
            self.tampered(lambda r: r["parameters"]["target/plate/pose"].update(value=value), "parameters.target/plate/pose.value", commands=("diff",))
        self.tampered(lambda r: r["parameters"]["target/plate/pose"].update(sigma={"x": 1}), "parameters.target/plate/pose.sigma", commands=("diff",))

    def test_numbers_that_do_not_fit(self):
        joint = next(name for name, entry in self.good["robot"]["joints"].items() if entry["offset"] != 0)

        def entry(result):
            return result["robot"]["joints"][joint]
        place = "robot.joints." + joint + ".new.rotation"
        for rotation in ([[1, 0, 0], [0, 1, 0], [0, 0, 5e9]], [[1, 0, 0], [0, 1, 0], [0, 0, -1]], [[0, 0, 0]] * 3, [[1e200, 0, 0], [0, 1, 0], [0, 0, 1]]):
            self.tampered(lambda r: entry(r)["new"].update(rotation=rotation), place, "not a rotation", commands=("apply",))
        self.tampered(lambda r: entry(r).update(offset=1e17), "robot: its values are inconsistent", commands=("apply",))


def needs_bounds(test):
    """What is only seen where the memory ends."""
    def bounded(self):
        if cli_test.sanitized():
            self.skipTest("a sanitizer needs address space without bounds")
        test(self)
    return bounded


class Sizes(Faults):
    def test_nested_xml(self):
        deep = "<a>" * 100000 + "</a>" * 100000
        self.replaced("robot.urdf", URDF, ("</robot>", "\n" + deep + "</robot>"))
        started = time.time()
        self.fails(self.calibrate(), "robot.urdf:%d:" % (URDF.count("\n") + 1), "nested more than 100 levels deep")
        self.assertLess(time.time() - started, 20)
        self.replaced("robot.urdf", URDF, ("</robot>", "<a>" * 99 + "</a>" * 99 + "</robot>"))
        self.assertEqual(self.calibrate("--dry-run").code, 0)

    def test_board(self):
        self.replaced("rig.yaml", RIG, ("    rows: 3", "    rows: 10000"), ("    columns: 4", "    columns: 10000"))
        self.fails(self.calibrate(), "rig.yaml:", "targets.board.columns", "10000 x 10000", "1000000")
        self.replaced("rig.yaml", RIG, ("    rows: 3", "    rows: 1000"), ("    columns: 4", "    columns: 1000"))
        self.assertEqual(self.calibrate("--dry-run").code, 0)

    @needs_bounds
    def test_threads_that_cannot_be_started(self):
        run = self.limited("calibrate", "rig.yaml", "samples.jsonl", "--out", "out", "--threads", "1024", megabytes=600)
        self.fails(run, "of 1024 threads can be started")

    @needs_bounds
    def test_memory_that_ends_in_reading(self):
        self.extra = {"large.jsonl"}
        with open(self.path("large.jsonl"), "wb") as f:
            f.truncate(20 << 30)  # sparse
        for command in (("calibrate", "rig.yaml", "large.jsonl", "--out", "out"), ("evaluate", "rig.yaml", "large.jsonl")):
            self.fails(self.limited(*command, megabytes=300), "out of memory", "reading", "large.jsonl")

    @needs_bounds
    def test_memory_that_ends_in_a_step(self):
        """8,000 free points are 24,000 unknowns, whose matrix has 4.6 GB."""
        points = [[0.001 * (i % 100), 0.001 * (i // 100), 0] for i in range(8000)]
        self.write("rig.yaml", RIG[:RIG.index("targets:")] + "targets:\n  cloud:\n    type: points\n    points: " + json.dumps(points) +
                   "\n    mount: {link: tool}\n" + RIG[RIG.index("sensors:"):RIG.index("estimate:")] +
                   "estimate:\n  - {step: cloudy, free: [target/cloud/points], priors: {target/cloud/points: 0.1}}\n")
        self.write("samples.jsonl", lines([{"id": "one", "joints": {"turn": 0, "lift": 0, "slide": 0}, "views": [
            {"sensor": "tracker", "target": "cloud", "points": points}]}]))
        run = self.limited("calibrate", "rig.yaml", "samples.jsonl", "--out", "out", "--linear-solver", "dense", megabytes=1000)
        self.fails(run, "out of memory", "calibrating", "cloudy")

    @needs_bounds
    def test_memory_that_ends_in_a_batch(self):
        os.mkdir(self.path("sets"))
        for name in ("good", "bad"):
            os.mkdir(self.path("sets", name))
            self.write("sets/%s/robot.urdf" % name, URDF)
            self.write("sets/%s/rig.yaml" % name, RIG)
            self.write("sets/%s/samples.jsonl" % name, lines(make_samples()))
        with open(self.path("sets", "bad", "samples.jsonl"), "wb") as f:
            f.truncate(20 << 30)
        run = self.limited("batch", "sets", "--out", "results", megabytes=300)
        self.assertEqual(run.code, 1)
        self.assertIn("converged", self.read("results", "summary.csv"))
        self.assertIn("out of memory while reading", self.read("results", "summary.csv"))


class Gauges(Faults):
    """Many directions that narrow priors alone hold, all alike beside the data: a decomposition could give no numbers there, and the words
    about a direction without parameters crashed. The robots are those of a search at which that happened."""

    def two_branches(self, arm, neck, base, rotation):
        """A camera on a neck and a hand that holds a board on an arm, of so many joints; below both so many fixed ones."""
        robot, last = '<robot name="two_branches"><link name="world"/>\n', "world"

        def joint(name, parent, xyz, axis="0 0 1", rpy="0 0 0", kind="revolute"):
            nonlocal robot
            robot += ('<link name="%s_link"/><joint name="%s" type="%s"><parent link="%s"/><child link="%s_link"/><origin xyz="%s" rpy="%s"/><axis xyz="%s"/>'
                      '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>\n') % (name, name, kind, parent, name, xyz, rpy, axis)
            return name + "_link"
        for i in range(base):
            last = joint("base%d" % i, last, "0 0 0.05", rpy="0 0 0" if i else "0 3.14159 3.14159", kind="fixed")
        trunk = last = joint("waist", last, "0 0 0.3")
        for i in range(neck):
            last = joint("neck%d" % i, last, "0 0 0.1", ("0 1 0", "1 0 0", "0 0 1")[i % 3])
        joint("eye", last, "0.05 0 0.05", rpy="-1.57 0 -1.57", kind="fixed")
        last = trunk
        for i in range(arm):
            last = joint("arm%d" % i, last, "0.1 0.05 0" if i else "0.15 0.1 0", ("0 1 0", "0 0 1", "1 0 0")[i % 3])
        joint("palm", last, "0.05 0 0", kind="fixed")
        self.write("robot.urdf", robot + "</robot>\n")
        self.write("rig.yaml", """format: kincal/1
robot: robot.urdf
targets:
  board: {type: chessboard, rows: 4, columns: 5, square: 0.025, mount: free}
sensors:
  eye: {type: camera, link: eye_link, pose: {xyz: [0.01, 0, 0]}, model: brown_conrady, image_size: [1280, 960], intrinsics: [700, 700, 639.5, 479.5],
        sigma: 0.2}
  hand: {type: chain, link: palm_link, pose: {xyz: [0.05, 0, 0], rpy: [1.5, 0, 1.5]}, sigma: {translation: 0.0002, rotation: 0.0005}}
estimate:
  - step: mounts
    free: [sensor/eye/pose, sensor/hand/pose]
  - step: all
    free: [sensor/eye/pose, sensor/hand/pose, "joint/*/offset", "joint/*/origin", target/board/square, sensor/eye/intrinsics]
    priors: {"joint/*/offset": 0.0074, "joint/*/origin": {translation: 2.4e-5, rotation: %g}, target/board/square: 0.0005,
             "sensor/eye/intrinsics.f?": 5, "sensor/eye/intrinsics.c?": 5}
""" % rotation)

    def test_held_by_narrow_priors(self):
        robots = [(5, 3, 4, 1.8e-5, 16), (5, 4, 6, 1.55e-5, 11), (7, 3, 8, 1.65e-5, 13)]
        for arm, neck, base, rotation, seed in robots[:1] if cli_test.sanitized() else robots:
            with self.subTest(seed=seed):
                self.two_branches(arm, neck, base, rotation)
                run = self.run_kincal("simulate", "rig.yaml", "--samples", "40", "--seed", str(seed), "--out", "simulated", "--force", "--spread", "sensor/*/pose=0.01",
                                      "--spread", "joint/*/offset=0.005")
                self.assertEqual(run.code, 0, run.err)
                run = self.limited("calibrate", "rig.yaml", "simulated/samples.jsonl", "--out", "out", "--force", "--no-report", megabytes=4000, timeout=500)
                self.assertEqual(run.code, 0, run.err)
                result = self.result()
                self.assertEqual(result["unobservable"], [])  # their priors hold them
                held = [w for w in result["weak_directions"] if w["sigma"] is None]
                self.assertGreater(len(held), 6 * base)
                for w in held:
                    self.assertTrue(w["parameters"] and w["why"])


class Endless(Faults):
    def test_few_samples_that_fit_nothing(self):
        """No hypothesis has enough numbers in them for a first look."""
        rng = random.Random(3)
        samples = make_samples(6, 3, seed=4)
        for s in samples:
            for v in s["views"]:
                if "pixels" in v:
                    v["pixels"] = [[x + rng.gauss(0, 60), y + rng.gauss(0, 60)] for x, y in v["pixels"]]
        samples[1]["views"] = []
        self.write("samples.jsonl", lines(samples))
        self.write("rig.yaml", RIG[:RIG.index("estimate:")].replace("    sigma: 0.2\n", "    sigma: 0.0002\n"))
        run = self.limited("check", "rig.yaml", "samples.jsonl", megabytes=4000)
        self.assertEqual(run.code, 0, run.err)

    def test_numbers_that_overflow(self):
        samples = make_samples()
        samples[3]["views"][0]["sigma"] = 1e-200
        samples[3]["split"] = "train"
        self.write("samples.jsonl", lines(samples))
        self.fails(self.calibrate(), "in sample 'arm_003'", "sigma is far too small")
        samples = make_samples()
        samples[4]["views"][0]["points"] = [[1e200, 1e200, 1e200]] * 3
        self.write("samples.jsonl", lines(samples))
        self.fails(self.calibrate(), "in sample 'arm_004'", "measured number far too large")

    def crowded(self, views):
        """Ten samples that nothing explains, one with very many views of free boards."""
        rng = random.Random(8)
        samples = make_samples(10, 3, seed=5)
        targets = ""
        for k in range(views):
            targets += "  board%d: {type: chessboard, rows: 3, columns: 4, square: 0.05, mount: {link: tool, pose: {xyz: [0, 0, %g]}}}\n" % (k, 0.01 * k)
            samples[0]["views"].append({"sensor": "tracker", "target": "board%d" % k,
                                        "points": [[rng.uniform(-0.5, 0.5) + x for x in (0.5, 2.0, 0.3)] for _ in range(12)]})
        self.write("samples.jsonl", lines(samples))
        self.replaced("rig.yaml", RIG, ("  board:\n", targets + "  board:\n"))

    def test_a_sample_with_very_many_views(self):
        seconds = []
        for views in (20,) if cli_test.sanitized() or not helpers.SLOW else (20, 80):   # scripts/test-all: how the time grows
            self.crowded(views)
            started = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime  # whatever else the machine does
            run = self.limited("calibrate", "rig.yaml", "samples.jsonl", "--out", "out", "--force", "--reject", "--no-report", megabytes=4000, timeout=300)
            seconds.append(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - started)
            self.assertIn(run.code, (0, 2, 3, 5), run.err)  # 5: the outliers are in the data
        # Four times the views: by squares the search of outliers took 16 times as long. Each view has a board of its own here, six parameters,
        # and the evidence of the mistakes that are looked for is dense in these (7 to 10 times as long).
        self.assertLess(seconds[-1], 14 * seconds[0] + 1)

    def test_interrupted_while_looking_for_outliers(self):
        self.crowded(200)
        p = subprocess.Popen([cli_test.KINCAL, "calibrate", "rig.yaml", "samples.jsonl", "--out", "out", "--reject"], cwd=self.dir,
                             stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(1.5)
        p.send_signal(signal.SIGINT)
        try:
            p.wait(timeout=30)
        except subprocess.TimeoutExpired:
            p.kill()
            p.wait()
            self.fail("SIGINT is not looked at")
        self.assertIn(p.returncode, (0, 2, 3, 130))


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: faults_test.py SOURCE_DIR KINCAL [TEST ...]")
    cli_test.SOURCE_DIR, cli_test.KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
