"""`kincal monitor`: python3 monitor_test.py SOURCE_DIR KINCAL [TEST ...]

The PR2-like robot of the examples, calibrated, and samples that it logs afterwards, by `simulate`. Proves: a robot that stays as it was gives exit code 0; a stereo baseline that changes by 0.5 mm and a shoulder
whose offset changes by 5 mrad are named, with size and sample, exit code 6, in words and as JSON; standard input gives the same as the file; a shifted picture is an outlier that is left out; noise that is twice
the stated one is told and is no drift; the state goes on from file to file; cameras that stand still are told from one whose picture shifts by 3 to 37 px, in the first picture; mistakes are named. The library core needs nothing but Eigen and the standard libraries. Does not prove: rates of false alarms (models/monitor/drift_watch_test.cpp).
"""
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import unittest

import helpers

SOURCE_DIR = KINCAL = None
AT = 70  # sample from which on something has moved


def run(*arguments, code=0, text=None):
    done = subprocess.run([KINCAL, *arguments], input=text, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=600)
    if done.returncode != code:
        raise AssertionError("%s\nended with %d, not %d\n%s%s" % (" ".join(arguments), done.returncode, code, done.stdout[-2000:], done.stderr[-2000:]))
    return done.stdout if code != 1 else done.stderr


class Monitor(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="kincal_monitor_")
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.example = os.path.join(SOURCE_DIR, "examples", "pr2")
        cls.rig = os.path.join(cls.example, "rig.yaml")
        with open(os.path.join(cls.example, "truth_values.json")) as f:
            cls.truth = json.load(f)
        run("calibrate", cls.rig, os.path.join(cls.example, "samples.jsonl"), "--out", cls.path("result"), "--quiet", "--no-report")
        cls.healthy = cls.simulated("healthy", {})

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder, name)

    @classmethod
    def simulated(cls, name, changes, rig=None):
        """128 samples, as mappings, of the robot with some parameters changed."""
        with open(cls.path(name + ".json"), "w") as f:
            json.dump({"parameters": {**cls.truth["parameters"], **changes}}, f)
        run("simulate", rig or cls.rig, "--samples", "128", "--seed", "31", "--truth", cls.path(name + ".json"), "--postures", os.path.join(cls.example, "postures.jsonl"),
            "--out", cls.path(name), "--quiet", "--force")
        with open(cls.path(os.path.join(name, "samples.jsonl"))) as f:
            return [dict(json.loads(line), id="s%03d" % i) for i, line in enumerate(f)]

    def written(self, name, samples):
        with open(self.path(name), "w") as f:
            f.write("".join(json.dumps(s) + "\n" for s in samples))
        return self.path(name)

    def monitored(self, samples, code=0):
        """What is said of each sample, as data, and the summary."""
        file = self.written("samples.jsonl", samples)
        lines = run("monitor", self.path("result"), file, "--json", code=code).splitlines()
        return [json.loads(line) for line in lines], run("monitor", self.path("result"), file, "--quiet", code=code)

    def test_nothing_moved(self):
        told, summary = self.monitored(self.healthy)
        self.assertEqual([t["sample"] for t in told], [s["id"] for s in self.healthy])
        self.assertTrue(all(t["state"] == "fits" and t["drift"] is None for t in told))
        self.assertIn("128 samples, 0 outliers. Nothing has moved (one false alarm in about 10000 samples).", summary)
        chi2, dof = (sum(t[key] for t in told) for key in ("chi2", "dof"))
        self.assertLess(abs(chi2 / dof - 1), 0.03)
        for t, sample in zip(told, self.healthy):
            self.assertEqual(set(t["sensors"]), {v["sensor"] for v in sample["views"]})

    def moved(self, changes, group, component, change, tolerance):
        samples = self.healthy[:AT] + self.simulated("moved", changes)[AT:]
        told, summary = self.monitored(samples, code=6)
        first = next(i for i, t in enumerate(told) if t["drift"])
        self.assertGreaterEqual(first, AT)
        self.assertLess(first, AT + 10)
        named = next(t["drift"] for t in told if t["drift"] and t["drift"]["named"])
        likeliest = named["groups"][0]
        self.assertEqual(likeliest["group"], group)
        self.assertGreater(likeliest["probability"], 0.5)
        self.assertLess(abs(int(likeliest["since"][1:]) - AT), 12)
        found = likeliest["changes"][component]
        self.assertLess(abs(found["change"] - change), tolerance)
        self.assertLess(abs(found["change"] - change), 4 * found["sigma"])
        self.assertIn(group, summary.split("Moved:")[1])
        words = run("monitor", self.path("result"), self.path("samples.jsonl"), code=6)
        self.assertIn("something has moved, maybe " + group, words)

    def test_baseline(self):
        self.moved({"sensor/narrow_right/baseline": 0.0916}, "sensor/narrow_right/baseline", "sensor/narrow_right/baseline", 0.0005, 0.0001)

    @helpers.slow("test_baseline takes the same way")
    def test_joint(self):
        name = "joint/l_shoulder_lift_joint/offset"
        self.moved({name: self.truth["parameters"][name] + 0.005}, name, name, 0.005, 0.0015)

    def test_standard_input(self):
        file = self.written("some.jsonl", self.healthy[:20])
        with open(file) as f:
            text = f.read()
        self.assertEqual(run("monitor", self.path("result"), "-", "--json", text=text), run("monitor", self.path("result"), file, "--json"))
        self.assertIn("standard input, line 2:1:", run("monitor", self.path("result"), "-", text=text.splitlines()[0] + "\nnonsense\n", code=1))

    def test_outlier(self):
        samples = json.loads(json.dumps(self.healthy))
        view = next(v for v in samples[40]["views"] if v["sensor"] == "wide_left")
        view["pixels"] = [[u + 3, v] for u, v in view["pixels"]]
        told, summary = self.monitored(samples)
        self.assertEqual([t["sample"] for t in told if t["state"] != "fits"], ["s040"])
        self.assertIn("128 samples, 1 outliers. Nothing has moved", summary)
        self.assertIn("s040: does not fit", run("monitor", self.path("result"), self.path("samples.jsonl")))

    def test_nothing_explains(self):
        """A change that is named maybe, and then contradicted by pictures that nothing explains, to the last sample."""
        samples = self.healthy[:AT] + self.simulated("moved", {"sensor/narrow_right/baseline": 0.0916})[AT:AT + 4]
        draw = random.Random(1)
        for sample in samples[AT + 2:]:
            for view in sample["views"]:
                if "pixels" in view:
                    view["pixels"] = [[u + draw.gauss(0, 20), v + draw.gauss(0, 20)] for u, v in view["pixels"]]
        file = self.written("contradicted.jsonl", samples)
        told = [json.loads(line) for line in run("monitor", self.path("result"), file, "--json", code=5).splitlines()]
        self.assertTrue(any(t["drift"] for t in told[AT:AT + 2]))
        self.assertTrue(told[-1]["unexplained"] or told[-2]["unexplained"])
        self.assertIn("no single change explains them", run("monitor", self.path("result"), file, "--quiet", code=5))

    def test_noise(self):
        with open(self.rig) as f:
            text = f.read().replace("sigma: 0.125", "sigma: 0.25")
        shutil.copy(os.path.join(self.example, "robot.urdf"), self.folder)
        with open(self.path("noisy.yaml"), "w") as f:
            f.write(text)
        _, summary = self.monitored(self.simulated("noisy", {}, self.path("noisy.yaml")))
        self.assertIn("Nothing has moved", summary)
        for camera in ("narrow_left", "narrow_right", "wide_left", "wide_right", "forearm_left", "forearm_right"):
            factor = float(summary.split("Noise of %s: " % camera)[1].split(" times")[0])
            self.assertLess(abs(factor - 2), 0.15)

    def test_mistakes(self):
        file = self.written("one.jsonl", self.healthy[:1])
        self.assertIn("has no covariance", run("monitor", self.rig, file, code=1))
        wrong = json.loads(json.dumps(self.healthy[:3]))
        wrong[2]["views"][0]["sensor"] = "nobody"
        self.assertIn("wrong.jsonl:3: views[0].sensor", run("monitor", self.path("result"), self.written("wrong.jsonl", wrong), code=1))
        self.assertIn("--false-alarms", run("monitor", self.path("result"), file, "--false-alarms", "1", code=1))


    def test_state(self):
        """Two logs with the state kept between are one log."""
        samples = self.healthy[:AT] + self.simulated("moved", {"sensor/narrow_right/baseline": 0.0916})[AT:]
        whole = run("monitor", self.path("result"), self.written("whole.jsonl", samples), "--quiet", code=6)
        state = self.path("monday.state")
        self.assertIn("Nothing has moved", run("monitor", self.path("result"), self.written("monday.jsonl", samples[:AT - 5]), "--quiet", "--state", state))
        tuesday = self.written("tuesday.jsonl", samples[AT - 5:])
        with open(state, "rb") as f:
            saved = f.read()
        self.assertEqual(run("monitor", self.path("result"), tuesday, "--quiet", "--state", state, code=6), whole)
        with open(state, "wb") as f:
            f.write(saved[:-1])
        self.assertIn("monday.state: state: it is truncated", run("monitor", self.path("result"), tuesday, "--quiet", "--state", state, code=1))
        with open(state, "wb") as f:
            f.write(saved)
        self.assertIn("belongs to another calibration, or to other options",
                      run("monitor", self.path("result"), tuesday, "--quiet", "--state", state, "--false-alarms", "500", code=1))


class Static(unittest.TestCase):
    """Two cameras on tripods see a board and some points of the background."""
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="kincal_static_")
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def file(self, samples):
        path = os.path.join(self.folder, "samples.jsonl")
        with open(path, "w") as f:
            f.write("".join(json.dumps(s) + "\n" for s in samples))
        return path

    def samples(self, count, moved_at=None, by=(0, 0)):
        draw = random.Random(3)
        board = [(300 + 40 * (i % 6), 200 + 40 * (i // 6)) for i in range(30)]
        background = [(draw.uniform(0, 1280), draw.uniform(0, 720)) for _ in range(12)]
        out = []
        for n in range(count):
            views = []
            for sensor in ("left", "right"):
                shift = by if sensor == "right" and moved_at is not None and n >= moved_at else (0, 0)
                for target, points, extra in (("board", board, {}), ("background", background, {"ids": list(range(12))})):
                    pixels = [[u + shift[0] + draw.gauss(0, 0.1), v + shift[1] + draw.gauss(0, 0.1)] for u, v in points]
                    views.append({"sensor": sensor, "target": target, "pixels": pixels, **extra})
            out.append({"id": "p%03d" % n, "views": views})
        return out

    def test_still(self):
        told = run("monitor", "--static", self.file(self.samples(60)))
        self.assertIn("60 samples. Nothing has moved (one false alarm in about 10000 samples of a camera).", told)
        noise = float(told.split("right: 42 points, noise ")[1].split(" px")[0])
        self.assertLess(abs(noise - 0.1), 0.01)

    def test_moved(self):
        for size in (3, 10, 37):
            file = self.file(self.samples(60, 40, (0.6 * size, -0.8 * size)))
            lines = [json.loads(line) for line in run("monitor", "--static", file, "--json", code=6).splitlines()]
            moved = [(line["sample"], name) for line in lines for name, one in line["sensors"].items() if one["moved"]]
            self.assertEqual(moved, [("p040", "right")])
            found = lines[40]["sensors"]["right"]["moved"]
            self.assertEqual((found["what"], found["since"]), ("camera", "p040"))
            for shift, sigma, by in zip(found["shift"], found["sigma"], (0.6, -0.8)):
                self.assertLess(abs(shift - by * size), 5 * sigma)
        with open(file) as f:
            text = f.read()
        words = run("monitor", "--static", "-", text=text, code=6)
        self.assertIn("p040: right has moved: its picture by +22.", words)
        self.assertIn("since sample 'p040'", words)

    def test_mistakes(self):
        samples = self.samples(3)
        samples[1]["views"][1]["ids"] = [1]
        self.assertIn("samples.jsonl:2: views[1].ids: as many as 'pixels' are expected: 12", run("monitor", "--static", self.file(samples), code=1))
        samples = self.samples(3)
        samples[2]["views"][1]["target"] = "board"
        self.assertIn("samples.jsonl:3: views[1]: board, point 0 occurs twice", run("monitor", "--static", self.file(samples), code=1))
        file = self.file(self.samples(3))
        self.assertIn("--static takes only SAMPLES", run("monitor", "--static", file, file, code=1))
        self.assertIn("SAMPLES is missing", run("monitor", file, code=1))
        self.assertIn("all of them to learn from (10 are needed)", run("monitor", "--static", file))


class Core(unittest.TestCase):
    def test_needs_nothing(self):
        """Of the libraries that a robot's own computer links: no streams, locales, files, nor anybody's library."""
        folder = os.path.dirname(os.path.abspath(KINCAL))
        libraries = [os.path.join(folder, "libkincal_%s.a" % name) for name in ("core", "solver", "kinematics")]
        if not all(map(os.path.exists, libraries)):
            self.skipTest("no libraries beside the program")
        symbols = subprocess.run(["nm", "-C", "-u", *libraries], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=True).stdout
        needed = {line.split(" U ", 1)[1].strip() for line in symbols.splitlines() if " U " in line}
        self.assertGreater(len(needed), 50)
        for word in ("std::locale", "std::basic_ostream", "std::basic_istream", "std::ios_base", "fopen", "std::filesystem", "cholmod_", "YAML::", "pugi::", "nlohmann", "urdf::"):
            self.assertEqual([s for s in needed if word in s], [], word)


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = (os.path.abspath(p) for p in sys.argv[1:3])
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=2)
