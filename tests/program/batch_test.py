"""Many sample sets in one command: python3 batch_test.py SOURCE_DIR KINCAL [TEST ...]

Makes a fleet in a temporary directory: copies of examples/pr2 whose samples `kincal simulate` draws with a seed each. Proves: every
result of `kincal batch` is that of `kincal calibrate`, byte for byte but for times and the command line; the summary says what the
results say, and is the same for any number of jobs; a set that fails or crashes stops no other and is named; after a kill, an
interruption, a change of inputs or options only what must be is calibrated again; nothing half-written is ever visible; what is not the
batch's is left alone; wrong usage is told. It does not prove estimates (data_test.py, reference_test.py).
"""

import csv
import io
import json
import math
import os
import pty
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import unittest

import helpers

SOURCE_DIR = KINCAL = None
FILES = ["batch.json", "changes.yaml", "covariance.csv", "information.csv", "loops.csv", "report.html", "residuals.csv", "result.json", "rig.yaml", "robot.urdf", "samples.csv"]
FLEET = 6


class Run:
    def __init__(self, code, out, err):
        self.code, self.out, self.err = code, out, err


def read(*path):
    with open(os.path.join(*path), encoding="utf-8", newline="") as file:
        return file.read()


def write(text, *path):
    with open(os.path.join(*path), "w", encoding="utf-8", newline="") as file:
        file.write(text)


def without_time(result):
    """result.json but for what no two runs share."""
    result = json.loads(result)
    del result["input"]["command"], result["input"]["date"]
    for step in result["steps"]:
        del step["seconds"]
    return result


def quaternion(rpy):
    """x y z w with w >= 0 of fixed-axis roll, pitch, yaw."""
    (a, c), (b, d), (e, f) = [(math.sin(v / 2), math.cos(v / 2)) for v in rpy]
    q = [a * d * f - c * b * e, c * b * f + a * d * e, c * d * e - a * b * f, c * d * f + a * b * e]
    return q if q[3] >= 0 else [-v for v in q]


def children(pid):
    try:
        return [int(p) for p in read("/proc", str(pid), "task", str(pid), "children").split()]
    except OSError:
        return []


class Case(unittest.TestCase):
    maxDiff = 2000

    @classmethod
    def setUpClass(cls):
        cls.root = tempfile.mkdtemp(prefix="kincal_batch_")
        cls.original = os.path.join(cls.root, "original")
        example = os.path.join(SOURCE_DIR, "examples", "pr2")
        for i in range(FLEET):
            folder = os.path.join(cls.original, "robot_%d" % i)
            os.makedirs(folder)
            for name in ("rig.yaml", "robot.urdf"):
                shutil.copy(os.path.join(example, name), folder)
            subprocess.run([KINCAL, "simulate", os.path.join(example, "rig.yaml"), "--samples", "64", "--seed", str(i + 1), "--truth",
                            os.path.join(example, "truth_values.json"), "--postures", os.path.join(example, "postures.jsonl"), "--out",
                            os.path.join(cls.root, "simulated")], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
            shutil.move(os.path.join(cls.root, "simulated", "samples.jsonl"), folder)
            shutil.rmtree(os.path.join(cls.root, "simulated"))

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.root, ignore_errors=True)

    def setUp(self):
        self.dir = tempfile.mkdtemp(dir=self.root)
        shutil.copytree(self.original, self.path("fleet"))

    def path(self, *names):
        return os.path.join(self.dir, *names)

    def kincal(self, *args, **more):
        p = subprocess.run([KINCAL, *args], cwd=self.dir, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=300, **more)
        return Run(p.returncode, p.stdout.decode(), p.stderr.decode())

    def batch(self, *args, sets="fleet", out="out"):
        return self.kincal("batch", sets, "--out", out, *args)

    def start(self, *args):
        return helpers.start(self, [KINCAL, "batch", "fleet", "--out", "out", *args], start_new_session=True)

    def grow(self, count):
        """A larger fleet: the same robots under more names."""
        for i in range(FLEET, count):
            shutil.copytree(self.path("fleet", "robot_%d" % (i % FLEET)), self.path("fleet", "robot_%02d" % i))

    def spoil(self, name):
        text = read(self.dir, "fleet", name, "samples.jsonl").splitlines(True)
        write("".join(text[:3] + [text[3].replace('"pixels"', '"pixls"')] + text[4:]), self.dir, "fleet", name, "samples.jsonl")

    def summary(self, out="out"):
        return json.loads(read(self.dir, out, "summary.json"))

    def table(self, out="out"):
        return list(csv.DictReader(io.StringIO(read(self.dir, out, "summary.csv"))))

    def finished(self, out="out"):
        """Names of the result directories there are; each must be whole."""
        names = []
        for name in sorted(os.listdir(self.path(out))) if os.path.isdir(self.path(out)) else []:
            if name in (".batch", "report.html", "summary.csv", "summary.json"):
                continue
            self.assertEqual(sorted(os.listdir(self.path(out, name))), FILES, name)
            json.loads(read(self.dir, out, name, "result.json"))
            names.append(name)
        return names

    def times(self, out="out"):
        return {name: os.stat(self.path(out, name, "result.json")).st_mtime_ns for name in self.finished(out)}

    def refused(self, run, *words):
        self.assertEqual((run.code, run.out), (1, ""), run.err)
        self.assertEqual(run.err.count("kincal: error: "), 1, run.err)
        for word in words:
            self.assertIn(word, run.err)

    def done_before(self):
        """`batch` of the whole fleet has run: once for the class."""
        kept = os.path.join(self.root, "done_before")
        if not os.path.exists(kept):
            self.assertEqual(self.batch().code, 0)
            shutil.copytree(self.path("out"), kept)
        else:
            shutil.copytree(kept, self.path("out"))

    def wait_for(self, process, count):
        """Until so many sets are finished."""
        end = time.time() + 100
        while len(self.finished()) < count:
            self.assertIsNone(process.poll(), "it ended before")
            self.assertLess(time.time(), end)
            time.sleep(0.03)


class Results(Case):
    def test_same_as_calibrate(self):
        run = self.batch("--jobs", "2")
        self.assertEqual(run.code, 0, run.err)
        self.assertEqual(self.finished(), ["robot_%d" % i for i in range(FLEET)])
        for i in range(FLEET):
            name = "robot_%d" % i
            single = self.kincal("calibrate", "fleet/%s/rig.yaml" % name, "fleet/%s/samples.jsonl" % name, "--out", "single")
            self.assertEqual(single.code, 0, single.err)
            for file in FILES:
                if file == "result.json":
                    self.assertEqual(without_time(read(self.dir, "single", file)), without_time(read(self.dir, "out", name, file)))
                elif file == "report.html":
                    self.assertEqual(*[re.sub(r'"(command|date|seconds)":("[^"]*"|[-+0-9.e]+)', "", read(self.dir, *path)) for path in (("single", file), ("out", name, file))])
                elif file != "batch.json":
                    self.assertEqual(read(self.dir, "single", file), read(self.dir, "out", name, file), name + "/" + file)
            shutil.rmtree(self.path("single"))
        self.assertEqual(os.listdir(self.path("out", ".batch")), ["lock"])
        # a result directory of a batch is one like any other
        self.assertEqual(self.kincal("evaluate", "out/robot_1", "fleet/robot_2/samples.jsonl").code, 0)
        self.assertEqual(self.kincal("apply", "out/robot_1", "fleet/robot_1/robot.urdf", "--out", "applied.urdf").code, 0)
        self.assertEqual(self.kincal("calibrate", "fleet/robot_1/rig.yaml", "fleet/robot_1/samples.jsonl", "--out", "out/robot_1", "--force").code, 0)

    def test_summary(self):
        self.spoil("robot_4")
        run = self.batch("--jobs", "2", "--write-reduction")
        self.assertEqual(run.code, 1)
        summary, table = self.summary(), self.table()
        self.assertEqual([summary[k] for k in ("sets", "converged", "unobservable", "not_converged", "failed", "ignored")], [6, 5, 0, 0, 1, 0])
        self.assertEqual(list(summary["results"]), ["robot_%d" % i for i in range(FLEET)])
        self.assertEqual([row["name"] for row in table], ["robot_%d" % i for i in range(FLEET)])
        self.assertNotIn("seconds", table[0])
        changed = set()
        for row in table:
            entry = summary["results"][row["name"]]
            self.assertEqual((row["status"], int(row["exit_code"]), row["error"]), (entry["status"], entry["exit_code"], entry["error"]))
            if row["name"] == "robot_4":
                self.assertEqual((entry["status"], entry["exit_code"]), ("failed", 1))
                self.assertIn("fleet/robot_4/samples.jsonl:4: views[", entry["error"])
                self.assertTrue(all(row[c] == "" for c in row if c not in ("name", "status", "exit_code", "error")), row)
                continue
            result = json.loads(read(self.dir, "out", row["name"], "result.json"))
            self.assertEqual((entry["status"], entry["chi2"], entry["dof"]), (result["status"], result["chi2"], result["dof"]))
            self.assertEqual((float(row["chi2"]), int(row["dof"])), (result["chi2"], result["dof"]))
            self.assertAlmostEqual(float(row["chi2_per_dof"]), result["chi2"] / result["dof"])
            self.assertEqual(int(row["warnings"]), len(result["warnings"]))
            self.assertEqual(entry["warnings"], ["%(id)s: %(text)s" % w for w in result["warnings"]])
            self.assertGreater(entry["seconds"], 0)
            for name, sensor in result["sensors"].items():
                self.assertEqual(entry["sensors"][name], {"unit": sensor["unit"], "train": sensor["train"]["rms"], "test": sensor["test"]["rms"]})
                self.assertEqual(float(row["rms %s train [%s]" % (name, sensor["unit"])]), sensor["train"]["rms"])
                if "rms_rotation" in sensor["train"]:
                    self.assertEqual(float(row["rms %s/rotation train [rad]" % name]), sensor["train"]["rms_rotation"])
            self.assertFalse([c for c in row if " test" in c])   # nothing is held out
            names = ["x", "y", "z", "rx", "ry", "rz"]
            for name, p in result["parameters"].items():
                for c, (unit, initial, value, sigma) in enumerate(zip(p["unit"], p["initial"], p["value"], p["sigma"])):
                    full = name + "." + names[c] if len(p["unit"]) == 6 else name
                    if sigma == 0:
                        self.assertNotIn(full, entry["parameters"])
                        continue
                    self.assertEqual(entry["parameters"][full], {"unit": unit, "initial": initial, "value": value, "sigma": sigma})
                    column = full + " [" + unit + "]" if unit else full
                    changed.add(column)
                    self.assertAlmostEqual(float(row[column]), value - initial, delta=1e-15)
                self.assertEqual(name in entry["poses"], "pose" in p)
                if "pose" not in p:
                    continue
                absolute = [float(row["absolute %s.%s" % (name, c)]) for c in ("x [m]", "y [m]", "z [m]", "roll [rad]", "pitch [rad]", "yaw [rad]")]
                self.assertEqual(absolute, entry["poses"][name]["xyz"] + entry["poses"][name]["rpy"])
                self.assertEqual(absolute[:3], p["pose"]["xyz"])
                for got, expected in zip(quaternion(absolute[3:]), p["pose"]["quat"]):
                    self.assertAlmostEqual(got, expected, delta=1e-12)
        self.assertEqual({c for c in table[0] if "/" in c and not c.startswith(("rms ", "absolute "))}, changed)
        # the table on standard output
        self.assertIn("6 sets, 5 converged, 1 failed", run.out)
        ratios = [float(row["chi2_per_dof"]) for row in table if row["chi2_per_dof"]]
        line = re.search(r"chi2/dof +(\S+) +(\S+) +(\S+)", run.out)
        self.assertAlmostEqual(float(line.group(1)), statistics.median(ratios), delta=1e-3)
        self.assertAlmostEqual(float(line.group(2)), max(ratios), delta=1e-3)
        self.assertEqual(line.group(3), max((float(r["chi2_per_dof"] or 0), r["name"]) for r in table)[1])
        self.assertRegex(run.out, r"robot_4 +failed +fleet/robot_4/samples.jsonl:4: ")

    def test_show_of_its_folder_says_where_the_results_are(self):
        self.batch("--no-report")
        run = self.kincal("show", "out")
        self.assertEqual(run.code, 1)
        self.assertRegex(run.err, "out is the folder of a batch: .*`kincal show out/SET`")

    def test_held_out(self):
        text = read(self.dir, "fleet", "robot_0", "samples.jsonl").splitlines(True)
        for i in range(0, len(text), 4):
            text[i] = text[i].replace('"split": "train"', '"split": "test"')
        write("".join(text), self.dir, "fleet", "robot_0", "samples.jsonl")
        self.assertEqual(self.batch().code, 0)
        first, second = self.table()[:2]
        self.assertGreater(float(first["rms wide_left test [px]"]), 0)
        self.assertEqual(second["rms wide_left test [px]"], "")

    def test_any_number_of_jobs(self):
        self.spoil("robot_2")
        self.assertEqual(self.batch("--jobs", "1", out="one").code, 1)
        self.assertEqual(self.batch("--jobs", "2", "--threads", "2", out="two").code, 1)
        self.assertEqual(self.batch("--jobs", "50", out="many").code, 1)
        csv_text = read(self.dir, "one", "summary.csv")
        self.assertEqual(read(self.dir, "two", "summary.csv"), csv_text)
        self.assertEqual(read(self.dir, "many", "summary.csv"), csv_text)

    def test_json_and_quiet(self):
        run = self.batch("--json")
        self.assertEqual((run.code, run.out, run.err), (0, read(self.dir, "out", "summary.json"), ""))
        run = self.batch("--quiet")
        self.assertEqual((run.code, run.out, run.err), (0, "", ""))
        self.spoil("robot_3")
        for option in ("--quiet", "--json"):
            run = self.batch(option)
            self.assertEqual(run.code, 1)
            self.assertEqual(run.out, "" if option == "--quiet" else read(self.dir, "out", "summary.json"))
            self.assertRegex(run.err, r"^kincal: error: robot_3: fleet/robot_3/samples.jsonl:4: .*\nkincal: error: 1 of 6 sets failed: robot_3\n$")

    def test_options(self):
        self.assertEqual(self.batch("--noise", "point", "--step", "arms", "--fix", "joint/l_elbow*", "--no-report", "--linear-solver", "dense").code, 0)
        self.assertFalse(os.path.exists(self.path("out", "robot_0", "residuals.csv")))
        result = json.loads(read(self.dir, "out", "robot_0", "result.json"))
        self.assertEqual((result["noise"], result["steps"][-1]["step"], result["steps"][-1]["linear_solver"]), ("point", "arms", "dense"))
        self.assertNotIn("joint/l_elbow_flex_joint/offset", result["parameters"])
        self.assertEqual(self.summary()["options"], "--noise point --linear-solver dense --step arms --fix joint/l_elbow* --no-report")

    def test_progress_on_a_terminal(self):
        main, terminal = pty.openpty()
        p = subprocess.Popen([KINCAL, "batch", "fleet", "--out", "out", "--jobs", "1"], cwd=self.dir, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=terminal)
        os.close(terminal)
        text = b""
        while True:
            try:
                part = os.read(main, 4096)
            except OSError:
                break
            if not part:
                break
            text += part
        os.close(main)
        self.assertEqual(p.wait(), 0)
        self.assertRegex(text.decode(), r"\r\x1b\[K\d of 6 sets, 0 failing, [\d.]+ a second, \d+ s left")
        self.assertRegex(text.decode(), r"\r\x1b\[K6 of 6 sets, 0 failing, [\d.]+ a second\r\n$")


    def test_a_sensor_that_moved(self):
        """Poses that the rig leaves open start anew in every set: their changes say nothing of a sensor that was moved between two of them, their
        absolute poses do."""
        shutil.rmtree(self.path("fleet"))
        moved = [0.4, 0.1, 1.0]
        for name, z in (("monday", 1.0), ("tuesday", 1.03)):
            os.makedirs(self.path("fleet", name))
            write(MOVED_URDF, self.dir, "fleet", name, "robot.urdf")
            known = MOVED_RIG % ", pose: {xyz: [0.4, 0.1, %r], rpy: [3.0, 0.1, 0.2]}" % z
            write(known, self.dir, "fleet", name, "known.yaml")
            run = self.kincal("simulate", "fleet/%s/known.yaml" % name, "--samples", "12", "--seed", "3", "--out", "sim_" + name)
            self.assertEqual(run.code, 0, run.err)
            shutil.move(self.path("sim_" + name, "samples.jsonl"), self.path("fleet", name))
            write(MOVED_RIG % "", self.dir, "fleet", name, "rig.yaml")
        self.assertEqual(self.batch().code, 0)
        monday, tuesday = self.table()
        poses = self.summary()["results"]["tuesday"]["poses"]["sensor/eye/pose"]
        self.assertAlmostEqual(poses["xyz"][2], 1.03, delta=2e-3)
        for c, expected in zip("xyz", moved):
            self.assertAlmostEqual(float(monday["absolute sensor/eye/pose.%s [m]" % c]), expected, delta=2e-3)
        z = "absolute sensor/eye/pose.z [m]"
        self.assertAlmostEqual(float(tuesday[z]) - float(monday[z]), 0.03, delta=2e-3)
        self.assertAlmostEqual(float(tuesday["absolute sensor/eye/pose.roll [rad]"]), 3.0, delta=5e-3)
        changes = [float(row["sensor/eye/pose.z [m]"] or 0) for row in (monday, tuesday)]
        self.assertLess(abs(changes[1] - changes[0]), 0.01)

    def test_progress_counts_this_run(self):
        """Sets that failed before are not among those of this run."""
        self.assertEqual(self.batch("--free", "sensor/left_arm/pose.rx").code, 1)   # all fail, and are done
        self.grow(7)
        run = self.batch("--free", "sensor/left_arm/pose.rx")
        self.assertEqual(run.code, 1)
        self.assertIn("7 sets, 6 done before", run.err)
        self.assertRegex(run.err, r"(?m)^1 of 1 set, 1 failing")
        self.assertIn("7 of 7 sets failed", run.err)


MOVED_URDF = """<robot name="r"><link name="base"/><link name="arm"/><link name="hand"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0.4 0 0.2" rpy="0 0 0"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="lift" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="0 0 0.1" rpy="0 0 0"/><axis xyz="0 1 0"/>
<limit lower="-0.3" upper="0.3" effort="1" velocity="1"/></joint></robot>
"""
MOVED_RIG = """format: kincal/1
robot: robot.urdf
targets:
  plate: {type: points, points: [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.05]], mount: {link: hand, pose: {xyz: [0.05, 0, 0.02], rpy: [0, 0, 0]}}}
sensors:
  eye: {type: point, link: base, sigma: 0.0002%s}
estimate:
  - step: all
    free: [sensor/eye/pose, joint/lift/offset]
"""


class Failing(Case):
    def test_broken_input(self):
        """One error of every kind; the others are calibrated."""
        self.spoil("robot_0")
        os.remove(self.path("fleet", "robot_1", "samples.jsonl"))
        os.remove(self.path("fleet", "robot_2", "rig.yaml"))
        os.remove(self.path("fleet", "robot_3", "robot.urdf"))
        os.makedirs(self.path("fleet", "notes", "old"))
        write("hello", self.dir, "fleet", "README")
        run = self.batch("--jobs", "2")
        self.assertEqual(run.code, 1)
        self.assertEqual(self.finished(), ["robot_4", "robot_5"])
        results = self.summary()["results"]
        self.assertEqual([r["status"] for r in results.values()], ["failed"] * 4 + ["converged"] * 2)
        for i, words in enumerate(("samples.jsonl:4", "no samples.jsonl", "no rig.yaml", "robot.urdf' does not exist")):
            self.assertIn(words, results["robot_%d" % i]["error"])
            self.assertRegex(run.out, r"robot_%d +failed +" % i)
            self.assertIn("kincal: error: robot_%d: " % i, run.err)
        self.assertEqual(self.summary()["ignored"], 1)
        self.assertIn("1 other folder", run.out)
        self.assertIn("4 of 6 sets failed: robot_0, robot_1, robot_2, robot_3", run.err.splitlines()[-1])
        # mended, only these are done
        before = self.times()
        shutil.rmtree(self.path("fleet"))
        shutil.copytree(self.original, self.path("fleet"))
        self.assertEqual(self.batch("--jobs", "2").code, 0)
        after = self.times()
        self.assertEqual(len(after), 6)
        self.assertEqual({k: after[k] for k in before}, before)

    def test_unobservable(self):
        """Written and marked as by calibrate, and named: it is not what one may rely on."""
        run = self.batch("--free", "sensor/left_arm/pose.rx")
        self.assertEqual(run.code, 1)
        self.assertEqual(len(self.finished()), 6)
        entry = self.summary()["results"]["robot_0"]
        self.assertEqual((entry["status"], entry["exit_code"]), ("unobservable", 2))
        self.assertIn("l_wrist_roll_joint/offset", entry["error"])
        self.assertIn("6 sets, 6 unobservable", run.out)
        self.assertRegex(run.out, r"robot_5 +unobservable +.*the data do not determine")
        before = self.times()
        run = self.batch("--free", "sensor/left_arm/pose.rx")   # done is done, and still failing
        self.assertEqual((run.code, self.times()), (1, before))

    def test_mistakes(self):
        """They are looked for as calibrate does: named where a set ends badly, and where it does not but has taken one up."""
        def edit(robot, change):
            lines = [json.loads(line) for line in read(self.path("fleet", robot, "samples.jsonl")).splitlines()]
            for line in lines:
                change(line)
            write("".join(json.dumps(line) + "\n" for line in lines), self.path("fleet", robot, "samples.jsonl"))

        def other_way(sample):
            sample["joints"]["l_elbow_flex_joint"] = -sample["joints"].get("l_elbow_flex_joint", 0)
        edit("robot_1", other_way)
        rig = read(self.path("fleet", "robot_2", "rig.yaml"))
        rig = rig[:rig.index("estimate:")].replace("square: 0.0245", "square: 0.0265")   # no steps: the size is free
        write(rig, self.path("fleet", "robot_2", "rig.yaml"))
        for robot in ("robot_3", "robot_4", "robot_5"):
            shutil.rmtree(self.path("fleet", robot))
        run = self.batch("--jobs", "2")
        self.assertEqual(run.code, 1)
        results = self.summary()["results"]
        self.assertEqual(results["robot_0"]["verdict"], "good")
        self.assertEqual(results["robot_0"]["error"], "")
        self.assertIn("joint-sign", results["robot_1"]["error"])
        self.assertEqual((results["robot_2"]["verdict"], results["robot_2"]["exit_code"]), ("doubts", 0))
        self.assertIn("small_board", results["robot_2"]["error"])
        self.assertRegex(run.out, r"With doubts\n +robot_2 +.*small_board")

    def test_crash(self):
        """A child that is killed is a failing set; the next run does it again."""
        self.grow(12)
        p = self.start("--jobs", "2", "--quiet")
        self.wait_for(p, 2)
        old = new = set(children(p.pid))
        while not new - old:      # one that has just begun
            self.assertIsNone(p.poll())
            time.sleep(0.001)
            new = set(children(p.pid))
        os.kill((new - old).pop(), signal.SIGKILL)
        out, err = p.communicate(timeout=100)
        self.assertEqual(p.returncode, 1)
        failed = [name for name, r in self.summary()["results"].items() if r["status"] == "failed"]
        self.assertEqual(len(failed), 1)
        entry = self.summary()["results"][failed[0]]
        self.assertEqual((entry["exit_code"], entry["error"]), (137, "ended by signal 9 (Killed)"))
        self.assertIn("kincal: error: %s: ended by signal 9" % failed[0], err.decode())
        self.assertEqual(len(self.finished()), 11)
        before = self.times()
        self.assertEqual(self.batch().code, 0)
        after = self.times()
        self.assertEqual({k: v for k, v in after.items() if k not in failed}, before)

    def test_children_killed(self):
        """Whenever a child is killed one set is lost at most, and a set whose result is there has not failed."""
        self.grow(12)
        p = self.start("--jobs", "2", "--quiet")
        kills = 0

        def results():
            return sum(name.startswith("robot_") for name in os.listdir(self.path("out"))) if os.path.isdir(self.path("out")) else 0
        while p.poll() is None:
            before = results()
            while p.poll() is None and results() == before:
                time.sleep(0.0005)
            for child in children(p.pid)[:1]:  # as soon as there is one more
                try:
                    os.kill(child, signal.SIGKILL)
                    kills += 1
                except ProcessLookupError:
                    pass
        p.communicate()
        told = self.summary()["results"]
        self.assertEqual(len(told), 12)
        lost = sorted(name for name, r in told.items() if r["status"] == "failed")
        self.assertLessEqual(len(lost), kills)
        self.assertEqual(sorted(set(told) - set(self.finished())), lost)
        self.assertIn(self.batch("--jobs", "2").code, (0, 1))
        self.assertEqual(self.batch("--jobs", "2").code, 0)

    def test_not_utf8(self):
        """The bytes of a broken file do not break the table."""
        with open(self.path("fleet", "robot_0", "rig.yaml"), "ab") as file:
            file.write(b"\nsensors: {x: {type: cam\xff}}\n")
        self.assertEqual(self.batch("--jobs", "2").code, 1)
        with open(self.path("out", "summary.csv"), "rb") as file:
            self.assertIn("robot_0", file.read().decode("utf-8"))

    def test_full_disk(self):
        import resource

        def limit():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
        run = self.kincal("batch", "fleet", "--out", "out", preexec_fn=limit, restore_signals=False)
        self.assertEqual(run.code, 1)
        self.assertEqual(self.finished(), [])
        self.assertIn("cannot be written", run.err)
        self.assertEqual(self.batch().code, 0)


class Resume(Case):
    def test_nothing_to_do(self):
        self.done_before()
        before, text, summary = self.times(), read(self.dir, "out", "summary.csv"), read(self.dir, "out", "summary.json")
        run = self.batch()
        self.assertEqual((run.code, self.times()), (0, before))
        self.assertIn("6 sets, 6 done before", run.err)
        self.assertEqual((read(self.dir, "out", "summary.csv"), read(self.dir, "out", "summary.json")), (text, summary))
        # from elsewhere, by other paths, with other threads
        shutil.copytree(self.path("out"), self.path("copy"))
        run = self.batch("--threads", "2", sets=self.path("fleet"), out=self.path("copy") + "/")
        self.assertIn("6 done before", run.err)

    def test_changed_inputs(self):
        self.done_before()
        before = self.times()
        for name, file, old, new in (("robot_1", "samples.jsonl", '"id": "', '"id":  "'), ("robot_2", "rig.yaml", "format:", "# changed\nformat:"),
                                     ("robot_3", "robot.urdf", "<robot ", "<!-- changed --><robot ")):
            text = read(self.dir, "fleet", name, file)
            write(text.replace(old, new, 1), self.dir, "fleet", name, file)
            self.assertNotEqual(text, read(self.dir, "fleet", name, file))
        run = self.batch()
        self.assertEqual(run.code, 0, run.err)
        self.assertIn("3 done before, 3 again: robot_1 (samples changed), robot_2 (rig changed), robot_3 (robot changed)", run.err)
        after = self.times()
        self.assertEqual([n for n in before if before[n] != after[n]], ["robot_1", "robot_2", "robot_3"])
        self.assertIn("<!-- changed -->", read(self.dir, "out", "robot_3", "robot.urdf"))

    def test_changed_options(self):
        self.done_before()
        before = self.times()
        run = self.batch("--noise", "none")
        self.assertIn("6 again: robot_0 (options changed), ", run.err)
        self.assertIn("and 1 more", run.err)
        after = self.times()
        self.assertTrue(all(before[n] != after[n] for n in before))
        self.assertEqual(json.loads(read(self.dir, "out", "robot_0", "result.json"))["noise"], "none")

    def test_other_version_and_damage(self):
        self.done_before()
        record = read(self.dir, "out", "robot_0", "batch.json")
        write(re.sub(r'"kincal": "[^"]*"', '"kincal": "0.0.1"', record), self.dir, "out", "robot_0", "batch.json")
        os.remove(self.path("out", "robot_1", "result.json"))
        write("{", self.dir, "out", "robot_2", "batch.json")
        run = self.batch()
        self.assertEqual(run.code, 0, run.err)
        self.assertIn("3 again: robot_0 (version of kincal changed), robot_1 (result damaged), robot_2 (result damaged)", run.err)
        self.assertEqual(len(self.finished()), 6)

    def test_input_that_breaks(self):
        """The old result stays, and the summary says that it is old."""
        self.done_before()
        before = self.times()
        self.spoil("robot_3")
        self.assertEqual(self.batch().code, 1)
        self.assertEqual(self.times(), before)
        entry = self.summary()["results"]["robot_3"]
        self.assertEqual(entry["status"], "failed")
        self.assertIn("out/robot_3 is the result of before", entry["error"])

    def test_killed(self):
        """kill -9 of the parent: the children end too, nothing half-written is there, the same command goes on."""
        self.grow(12)
        for count in (1, 4, 7):
            p = self.start("--jobs", "2", "--quiet")
            self.wait_for(p, count)
            running = children(p.pid)
            p.kill()
            p.communicate()
            end = time.time() + 10
            while any(os.path.exists("/proc/%d" % pid) and read("/proc", str(pid), "stat").split()[2] != "Z" for pid in running):
                self.assertLess(time.time(), end, "children live on")
                time.sleep(0.01)
            before = self.times()
            self.assertGreaterEqual(len(before), count)
            self.assertLess(len(before), 12)
            self.assertFalse(os.path.exists(self.path("out", "summary.csv")))
        write("left over", self.dir, "out", ".batch", "robot_1.writing-12")
        run = self.batch("--jobs", "2")
        self.assertEqual(run.code, 0, run.err)
        self.assertIn("%d done before" % len(before), run.err)
        after = self.times()
        self.assertEqual((len(after), {k: after[k] for k in before}), (12, before))
        self.assertEqual(os.listdir(self.path("out", ".batch")), ["lock"])
        self.assertEqual(self.batch("--jobs", "2", out="fresh").code, 0)
        self.assertEqual(read(self.dir, "out", "summary.csv"), read(self.dir, "fresh", "summary.csv"))

    def test_replacing(self):
        """Every result directory is the old or the new one, at any moment of a run that replaces them all."""
        self.grow(8)
        self.assertEqual(self.batch().code, 0)
        names = self.finished()
        p = self.start("--jobs", "2", "--quiet", "--no-report")
        while p.poll() is None:
            for name in names:
                try:
                    folder = os.stat(self.path("out", name)).st_ino
                    files = os.listdir(self.path("out", name))
                    if os.stat(self.path("out", name)).st_ino != folder:
                        continue      # replaced while it was read
                except FileNotFoundError:
                    continue
                self.assertIn(len(files), (len(FILES) - 3, len(FILES)), name)   # without a report, and with
        self.assertEqual(p.wait(), 0)
        p.communicate()

    def test_interrupted(self):
        """Ctrl-C to all, or SIGTERM to the parent: 130, what is finished stays, and a line says how to go on."""
        self.grow(12)
        before = {}
        for count, send in ((2, lambda p: os.killpg(p.pid, signal.SIGINT)), (5, lambda p: p.terminate())):
            p = self.start("--jobs", "2")
            self.wait_for(p, count)
            running = children(p.pid)
            send(p)
            out, err = p.communicate(timeout=20)
            self.assertEqual((p.returncode, out), (130, b""), err)
            self.assertRegex(err.decode(), r"kincal: interrupted; \d+ of 12 sets done, the same command goes on\n$")
            self.assertNotIn("error", err.decode())
            self.assertFalse(any(os.path.exists("/proc/%d" % pid) for pid in running))
            self.assertEqual(os.listdir(self.path("out", ".batch")), ["lock"])
            after = self.times()
            self.assertEqual({k: after[k] for k in before}, before)
            before = after
        self.assertEqual(self.batch("--jobs", "2").code, 0)
        after = self.times()
        self.assertEqual((len(after), {k: after[k] for k in before}), (12, before))


class Sets(Case):
    def test_list(self):
        """Paths relative to the list, quotes, tabs, comments; names from the folder of a samples.jsonl or the file, or given."""
        os.makedirs(self.path("logs", "two words"))
        shutil.copy(self.path("fleet", "robot_1", "samples.jsonl"), self.path("logs", "noon.jsonl"))
        shutil.copy(self.path("fleet", "robot_2", "samples.jsonl"), self.path("logs", "two words", "samples.jsonl"))
        shutil.copy(self.path("fleet", "robot_3", "samples.jsonl"), self.path("logs", "two words", "late.jsonl"))
        write("\ufeff# a day's logs, written by Windows\n\n../fleet/robot_0/rig.yaml ../fleet/robot_0/samples.jsonl\r\n"
              "  ../fleet/robot_0 noon.jsonl   # the rig's folder will do\n"
              "../fleet/robot_0/rig.yaml \"two words/samples.jsonl\"\n"
              "../fleet/robot_0/rig.yaml\ttwo words/late.jsonl\n"
              "../fleet/robot_0/rig.yaml noon.jsonl \"noon again\"\n"
              "%s gone.jsonl" % self.path("fleet", "robot_0", "rig.yaml"), self.dir, "logs", "list.txt")
        run = self.batch(sets="logs/list.txt")
        self.assertEqual(run.code, 1, run.err)
        results = self.summary()["results"]
        self.assertEqual(list(results), ["robot_0", "noon", "two words", "late", "noon again", "gone"])
        self.assertEqual([r["status"] for r in results.values()], ["converged"] * 5 + ["failed"])
        self.assertIn("logs/gone.jsonl: cannot be read", results["gone"]["error"])
        self.assertEqual({k: v for k, v in results["noon"].items() if k != "seconds"}, {k: v for k, v in results["noon again"].items() if k != "seconds"})

    def test_wrong_lists(self):
        line = "fleet/robot_0/rig.yaml fleet/robot_0/samples.jsonl"
        for text, words in ((line + "\n# x\n" + line + "\n", ("list.txt:3", "'robot_0'", "line 1")), ("\n" + "rig.yaml\n", ("list.txt:2", "RIG SAMPLES", "1 word")),
                            (line + " a b\n", ("list.txt:1", "4 words")), ("# nothing\n", ("list.txt", "no set")), ("", ("list.txt", "no set")),
                            ("rig.yaml \"a b\n", ("list.txt:1", "quote")), (line + " a/b\n", ("list.txt:1", "'a/b'")), (line + " ..\n", ("list.txt:1", "'..'")),
                            (line + " summary.csv\n", ("list.txt:1", "summary.csv"))):
            with self.subTest(text=text):
                write(text, self.dir, "list.txt")
                self.refused(self.batch(sets="list.txt"), *words)
                self.assertFalse(os.path.exists(self.path("out")))

    def test_wrong_folders(self):
        os.makedirs(self.path("empty", "a"))
        self.refused(self.batch(sets="empty"), "empty", "rig.yaml", "samples.jsonl", "1 folder")
        self.refused(self.batch(sets="fleet/robot_0"), "fleet/robot_0", "kincal calibrate")
        self.refused(self.batch(sets="none"), "none", "cannot be read")
        self.assertFalse(os.path.exists(self.path("out")))

    def test_out(self):
        """Only a new or empty folder, or one of a batch."""
        os.mkdir(self.path("mine"))
        write("mine", self.dir, "mine", "thesis.txt")
        self.refused(self.batch(out="mine"), "mine", "not of a batch")
        self.assertEqual(os.listdir(self.path("mine")), ["thesis.txt"])
        self.refused(self.batch(out="fleet"), "fleet", "not of a batch")
        write("", self.dir, "file")
        self.refused(self.batch(out="file"), "file", "not a directory")
        self.refused(self.batch(out="a/b"), "a/b", "cannot be made")
        os.mkdir(self.path("out"))
        self.assertEqual(self.batch("--quiet").code, 0)
        self.assertEqual(self.batch("--quiet", out="fleet/out").code, 0)   # inside of the sets' folder
        self.assertEqual(self.batch("--quiet", out="fleet/out").code, 0)
        self.assertEqual(self.summary("fleet/out")["ignored"], 0)

    def test_what_is_not_the_batch_s(self):
        """A result put there by hand is not replaced, neither is one with a file of the user's in it."""
        self.assertEqual(self.kincal("calibrate", "fleet/robot_1/rig.yaml", "fleet/robot_1/samples.jsonl", "--out", "by_hand", "--noise", "none").code, 0)
        self.assertEqual(self.batch().code, 0)
        shutil.rmtree(self.path("out", "robot_1"))
        shutil.move(self.path("by_hand"), self.path("out", "robot_1"))
        write("mine", self.dir, "out", "robot_2", "notes.txt")
        text = read(self.dir, "out", "robot_1", "result.json")
        run = self.batch("--no-report")
        self.assertEqual(run.code, 1)
        self.assertEqual(read(self.dir, "out", "robot_1", "result.json"), text)
        self.assertEqual(read(self.dir, "out", "robot_2", "notes.txt"), "mine")
        results = self.summary()["results"]
        self.assertEqual([r["status"] for r in results.values()], ["converged", "failed", "failed"] + ["converged"] * 3)
        self.assertIn("move it away", results["robot_1"]["error"])
        self.assertIn("notes.txt", results["robot_2"]["error"])

    def test_two_at_once(self):
        self.grow(40)
        p = self.start("--jobs", "1", "--quiet")
        self.wait_for(p, 1)
        p.send_signal(signal.SIGSTOP)
        try:
            self.refused(self.batch(), "out", "another batch")
        finally:
            p.send_signal(signal.SIGCONT)
            p.kill()
            p.communicate()

    def test_arguments(self):
        self.refused(self.kincal("batch", "fleet"), "--out")
        self.refused(self.kincal("batch", "--out", "out"), "SETS")
        self.refused(self.batch("--jobs", "0"), "jobs")
        self.refused(self.batch("--noise", "latnt"), "latnt", "latent")
        self.refused(self.batch("--force"), "--force")
        self.refused(self.kincal("bach", "fleet"), "nearest: batch", "calibrate, batch, evaluate")
        self.assertFalse(os.path.exists(self.path("out")))
        text = self.kincal("--help").out
        self.assertIn("kincal batch ", text)
        text = self.kincal("batch", "--help").out
        for word in ("--out", "--jobs", "--noise", "--threads", "--step", "--free", "--fix", "--linear-solver", "--no-report", "--write-reduction", "--quiet",
                     "--json", "130", "SETS"):
            self.assertIn(word, text)

    def test_names_that_no_set_has(self):
        """Told once, before anything runs; a set that has it is enough to start."""
        for args, words in ((("--step", "arm"), ("--step: there is no step 'arm' in any set; nearest: arms", "robot_0 has head, baselines")),
                            (("--free", "joint/l_elbow_flex_jont/offset"), ("--free", "in any set; nearest: joint/l_elbow_flex_joint/offset")),
                            (("--fix", "jiont/*"), ("--fix: 'jiont/*' matches no parameter in any set",)),
                            (("--require", "sensor/wide_lft<0.3px"), ("--require 'sensor/wide_lft<0.3px'", "wide_left")),
                            (("--require", "sensor/wide_left<0.3"), ("a unit is missing",)),
                            (("--group", "sizes"), ("--group: 'sizes' is for rigs without `estimate`", "--free frees more")),
                            (("--no-group", "sizes"), ("--no-group: 'sizes' is for rigs without", "--fix holds more")),
                            (("--report-frame", "l_gripper"), ("--report-frame", "l_gripper"))):
            with self.subTest(args=args):
                run = self.batch(*args)
                self.refused(run, *words)
                self.assertEqual(run.err.count("\n"), 1)
                self.assertFalse(os.path.exists(self.path("out")))
        rig = read(self.path("fleet"), "robot_3", "rig.yaml")
        write(rig.replace("step: arms", "step: limbs"), self.path("fleet"), "robot_3", "rig.yaml")
        write("broken", self.path("fleet"), "robot_0", "rig.yaml")
        run = self.batch("--step", "limbs")
        self.assertEqual(run.code, 1)
        self.assertIn("robot_1: --step: there is no step 'limbs'", run.err)
        self.assertTrue(os.path.exists(self.path("out/robot_3/result.json")))

    def test_groups_that_no_set_has(self):
        """A wrong group of an automatic rig is told once with the nearest; calibrate refuses groups where steps say what is free."""
        for i in range(2):
            folder = self.path("fleet/robot_%d" % i)
            rig = re.sub(r"(?ms)^estimate:.*?(?=^\S|\Z)", "", read(folder, "rig.yaml"))
            write(rig, folder, "rig.yaml")
        run = self.batch("--no-group", "ofsets")
        self.refused(run, "ofsets", "offsets")
        self.assertEqual(run.err.count("\n"), 1)
        self.assertFalse(os.path.exists(self.path("out")))
        with_steps = self.path("fleet/robot_2")
        self.refused(self.kincal("calibrate", with_steps + "/rig.yaml", with_steps + "/samples.jsonl", "--out", self.path("one"), "--group", "gears"),
                     "--group: 'gears' is for rigs without `estimate`")
        self.assertFalse(os.path.exists(self.path("one")))

    def test_results_of_sets_that_are_gone(self):
        """They stay, and are named."""
        self.assertEqual(self.batch("--no-report").code, 0)
        before = read(self.path("out/robot_1"), "result.json")
        shutil.rmtree(self.path("fleet/robot_1"))
        run = self.batch("--no-report")
        self.assertEqual(run.code, 0)
        self.assertIn("also has 1 result of no set of this batch, which `kincal fleet` counts: robot_1", run.err)
        self.assertEqual(read(self.path("out/robot_1"), "result.json"), before)
        self.assertNotIn("robot_1", read(self.path("out"), "summary.csv"))


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    SOURCE_DIR, KINCAL = (os.path.abspath(p) for p in sys.argv[1:3])
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:])
