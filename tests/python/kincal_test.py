"""The Python package: python3 kincal_test.py SOURCE_DIR KINCAL PACKAGE_DIR [TEST ...]   (PACKAGE_DIR has the folder kincal)

Proves: what the package computes is what the program writes, to the last bit (result.json, covariance.csv, every other file; check, evaluate,
simulate, detect, compensate; rigs and samples as dicts and arrays as well as files); forward() is that of a reader of URDFs written here, and of bending joints
that of simulated measurements; propagate() is J C J'; wrong input is an InputError with file, line and name, and harms nothing; arrays are read-only; results, rigs
and samples can be pickled and copied; progress is told and what its listener raises is passed on; SIGINT ends a calibration with KeyboardInterrupt
and other threads run meanwhile; the stubs are what the module has and mypy agrees with the package; the README's example. Data: the
same bits on the data sets (KINCAL_DATA). Not proved: how soon an interrupt comes, speed, other versions of Python than the one at hand.
"""
import copy
import csv
import io
import json
import os
import pickle
import random
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import unittest
import xml.etree.ElementTree as ElementTree

try:
    import numpy
except ImportError:
    numpy = None

SOURCE_DIR, KINCAL, PACKAGE = (os.path.abspath(p) for p in sys.argv[1:4])
sys.path[:0] = [PACKAGE, os.path.join(SOURCE_DIR, "tests", "program")]
import bending_test  # noqa: E402
from helpers import Folder, revolute  # noqa: E402

if numpy is not None:
    import kincal
PR2 = os.path.join(SOURCE_DIR, "examples", "pr2")
ARM = os.path.join(SOURCE_DIR, "examples", "arm")
DATA = os.environ.get("KINCAL_DATA", os.path.join(SOURCE_DIR, "..", "shared", "data"))


def program(*arguments, **more):
    """What the program prints."""
    done = subprocess.run([KINCAL, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, **more)
    if done.returncode not in (0, 2, 3, 5):
        raise AssertionError("%s\n%s" % (arguments, done.stderr))
    return done.stdout


def without_run(result):
    """result.json without what no two runs share."""
    result = copy.deepcopy(result)
    for key in ("command", "date"):
        result["input"].pop(key)
    for step in result["steps"]:
        step.pop("seconds")
    return result


class Same(Folder):
    maxDiff = 2000

    def compare(self, rig, samples, *switches, **options):
        """A calibration by both."""
        program("calibrate", rig, samples, "--out", self.path("program"), "--force", *switches)
        result = kincal.calibrate(rig, samples, **options)
        result.save(self.path("python"), force=True)
        self.assertEqual(sorted(os.listdir(self.path("program"))), sorted(os.listdir(self.path("python"))))
        for name in os.listdir(self.path("program")):
            if name not in ("result.json", "report.html"):  # which have date, command and seconds
                self.assertEqual(self.read("program", name), self.read("python", name), name)
        written = without_run(json.loads(self.read("program", "result.json")))
        self.assertEqual(written, without_run(result.to_dict()))
        for name, entry in written["parameters"].items():
            for key in ("initial", "value", "sigma"):
                numbers = [float("nan") if v is None else v for v in entry[key]]
                numpy.testing.assert_array_equal(getattr(result[name], key), numbers)
        rows = list(csv.reader(io.StringIO(self.read("program", "covariance.csv"))))
        self.assertEqual(tuple(rows[0]), result.components)
        numpy.testing.assert_array_equal(result.covariance, [[float(v) if v else numpy.nan for v in row] for row in rows[1:]])
        rows = list(csv.DictReader(io.StringIO(self.read("program", "residuals.csv"))))
        for sensor, residuals in result.residuals.items():
            mine = [row for row in rows if row["sensor"] == sensor]
            self.assertEqual(len(mine), len(residuals.after))
            self.assertEqual([row["sample"] for row in mine], [result.samples[i] for i in residuals.sample])
            self.assertEqual([row["target"] for row in mine], [list(result.rig.targets)[i] for i in residuals.target])
            self.assertEqual([row["id"] or "-1" for row in mine], [str(i) for i in residuals.point])
            for k, column in enumerate(("x", "y", "z", "rx", "ry", "rz")[:residuals.after.shape[1]]):
                numpy.testing.assert_array_equal(residuals.after[:, k], [float(row[column]) for row in mine])
            for k, column in enumerate(("before_x", "before_y", "before_z")[:residuals.before.shape[1]]):
                numpy.testing.assert_array_equal(residuals.before[:, k], [float(row[column] or "nan") for row in mine])
        return result

    def test_pr2(self):
        rig, samples = os.path.join(PR2, "rig.yaml"), os.path.join(PR2, "samples.jsonl")
        self.compare(rig, samples)
        self.compare(rig, samples, "--noise", "marginal", "--fix", "joint/l_*", "--holdout", "4", "--report-frame", "base_link", "--threads", "2",
                     noise="marginal", fix="joint/l_*", holdout=4, report_frame=["base_link"], threads=2)
        self.compare(rig, samples, "--free", "sensor/left_arm/pose.rx", free=["sensor/left_arm/pose.rx"])  # exit code 2

    def test_arm(self):
        if not shutil.which("kincal-detect", path=os.path.dirname(KINCAL)):
            self.skipTest("no kincal-detect")
        rig, images = os.path.join(ARM, "rig.yaml"), os.path.join(ARM, "images")
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.dir)  # images are named relative to where the samples are
        program("detect", rig, images, "--joints", os.path.join(ARM, "joints.csv"), "--out", self.path("samples.jsonl"))
        found = kincal.detect(rig, images, joints=os.path.join(ARM, "joints.csv"))
        self.assertEqual(found.text, self.read("samples.jsonl"))
        moved = kincal.Rig(dict(kincal.Rig(rig).to_dict()), urdf=os.path.join(ARM, "robot.urdf"))  # in no file: it is written for the program
        again = kincal.detect(moved, os.path.join(images, "0[12].png"), joints=os.path.join(ARM, "joints.csv"))
        self.assertEqual([s["views"][0]["pixels"].tolist() for s in again], [s["views"][0]["pixels"].tolist() for s in found[:2]])
        result = self.compare(rig, self.path("samples.jsonl"))
        self.assertEqual((result.status, result.use), ("converged", "good"))

    def test_dicts_and_arrays(self):
        rig = kincal.Rig(os.path.join(PR2, "rig.yaml"))
        entries = rig.to_dict()
        self.assertEqual(entries["format"], "kincal/1")
        made = kincal.Rig({**entries, "robot": "elsewhere.urdf"}, urdf=rig.urdf)
        samples = kincal.Samples(list(kincal.Samples(os.path.join(PR2, "samples.jsonl"))), rig=made)
        self.assertIsInstance(samples[0]["views"][1]["ids" if "ids" in samples[0]["views"][1] else "pixels"], numpy.ndarray)
        by_files, by_dicts = (kincal.calibrate(*both).to_dict() for both in ((rig, os.path.join(PR2, "samples.jsonl")), (made, samples)))
        for key in ("parameters", "chi2", "samples", "sensors", "verdict", "warnings"):
            self.assertEqual(by_files[key], by_dicts[key])

    def test_other_commands(self):
        rig, samples = os.path.join(PR2, "rig.yaml"), os.path.join(PR2, "samples.jsonl")
        self.assertEqual(kincal.check(rig, samples, compare=True).to_dict(), json.loads(program("check", rig, samples, "--json", "--compare")))
        evaluation = kincal.evaluate(rig, samples)
        self.assertEqual(evaluation.to_dict(), json.loads(program("evaluate", rig, samples, "--json")))
        self.assertEqual(evaluation.chi2, evaluation.to_dict()["chi2"])
        self.assertEqual(set(evaluation.residuals), set(evaluation.sensors))
        evaluation.report(self.path("evaluation.html"))
        self.assertIn("kincal-report-data", self.read("evaluation.html"))
        truth, postures = os.path.join(PR2, "truth_values.json"), os.path.join(PR2, "postures.jsonl")
        program("simulate", rig, "--samples", "10", "--seed", "2", "--truth", truth, "--postures", postures, "--out", self.path("made"), "--quiet")
        with open(truth, encoding="utf-8") as file:
            simulation = kincal.simulate(rig, 10, 2, truth=json.load(file), postures=postures)
        self.assertEqual(simulation.samples.text, self.read("made", "samples.jsonl"))
        self.assertEqual(simulation.truth, json.loads(self.read("made", "truth.json")))
        program("simulate", rig, "--samples", "5", "--seed", "3", "--spread", "joint/*_shoulder_*/offset=0.01", "--out", self.path("drawn"), "--quiet")
        drawn = kincal.simulate(rig, 5, 3, spread={"joint/*_shoulder_*/offset": 0.01})
        self.assertEqual(drawn.samples.text, self.read("drawn", "samples.jsonl"))


class Data(Same):
    def test_data(self):
        sets = [("aubo-i10", "rig_both.yaml", "samples.jsonl"), ("aubo-i10", "rig_images.yaml", "samples_images.jsonl"), ("aubo-i10", "rig_tracker.yaml", "samples_tracker.jsonl"),
                ("panda-sockets/panda_2", "rig.yaml", "samples.jsonl"), ("panda-sockets/panda_3", "rig.yaml", "samples.jsonl"), ("pr2-simulated", "rig.yaml", "samples.jsonl"),
                ("pr2-simulated-large", "rig.yaml", "samples.jsonl"), ("ros-industrial-charuco", "rig.yaml", "samples.jsonl"),
                ("ros-industrial-positioner", "rig.yaml", "samples.jsonl"), ("hrp2-real", "rig.yaml", "samples.jsonl"), ("ipa-ur10", "rig.yaml", "samples_60.jsonl")]
        found = [[os.path.join(DATA, folder, name) for name in names] for folder, *names in sets if os.path.isdir(os.path.join(DATA, folder))]
        if not found:
            self.skipTest("no data at " + DATA)
        for rig, samples in found:
            with self.subTest(rig):
                self.compare(rig, samples)

    test_pr2 = test_arm = test_dicts_and_arrays = test_other_commands = None


def transform(xyz, rpy):
    r, p, y = rpy
    rx = numpy.array([[1, 0, 0], [0, numpy.cos(r), -numpy.sin(r)], [0, numpy.sin(r), numpy.cos(r)]])
    ry = numpy.array([[numpy.cos(p), 0, numpy.sin(p)], [0, 1, 0], [-numpy.sin(p), 0, numpy.cos(p)]])
    rz = numpy.array([[numpy.cos(y), -numpy.sin(y), 0], [numpy.sin(y), numpy.cos(y), 0], [0, 0, 1]])
    out = numpy.eye(4)
    out[:3, :3], out[:3, 3] = rz @ ry @ rx, xyz
    return out


def forward(urdf, base, link, positions):
    """base_T_link of a URDF, rotations by Rodrigues' formula."""
    joints = {j.find("child").get("link"): j for j in ElementTree.fromstring(urdf).findall("joint")}
    out = numpy.eye(4)
    while link != base:
        joint = joints[link]
        numbers = lambda element, key: [float(v) for v in (element.get(key) if element is not None and element.get(key) else "0 0 0").split()]
        origin = transform(numbers(joint.find("origin"), "xyz"), numbers(joint.find("origin"), "rpy"))
        motion, q = numpy.eye(4), positions.get(joint.get("name"), 0.0)
        axis = joint.find("axis")
        if joint.get("type") in ("revolute", "continuous"):
            x, y, z = numpy.array(numbers(axis, "xyz")) / numpy.linalg.norm(numbers(axis, "xyz"))
            k = numpy.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            motion[:3, :3] += numpy.sin(q) * k + (1 - numpy.cos(q)) * k @ k
        elif joint.get("type") == "prismatic":
            motion[:3, 3] = q * numpy.array(numbers(axis, "xyz"))
        out, link = origin @ motion @ out, joint.find("parent").get("link")
    return out


class Robot(Folder):
    def test_forward(self):
        result = kincal.calibrate(os.path.join(PR2, "rig.yaml"), os.path.join(PR2, "samples.jsonl"))
        draw = numpy.random.default_rng(1)
        arm = [j for j in result.rig.joints if j.startswith("l_") and "gripper" not in j]
        joints = {**{j: draw.uniform(-1, 1, (3, 2)) for j in arm}, "torso_lift_joint": 0.1}
        frame = "l_wrist_roll_link"
        poses = result.forward(joints, frame)
        self.assertEqual(poses.shape, (3, 2, 4, 4))
        for i in range(3):
            for j in range(2):
                one = {name: numpy.broadcast_to(v, (3, 2))[i, j] for name, v in joints.items()}
                numpy.testing.assert_allclose(poses[i, j], forward(result.urdf, result.rig.base, frame, one), atol=1e-12)
                numpy.testing.assert_array_equal(poses[i, j], result.forward(one, frame))
        torso = result.forward(one, "torso_lift_link")
        numpy.testing.assert_allclose(torso @ result.forward(one, frame, base="torso_lift_link"), result.forward(one, frame), atol=1e-12)

    def test_propagate(self):
        result = kincal.calibrate(os.path.join(PR2, "rig.yaml"), os.path.join(PR2, "samples.jsonl"))
        jacobian = numpy.random.default_rng(2).normal(size=(4, len(result.components)))
        numpy.testing.assert_allclose(result.propagate(jacobian), jacobian @ result.covariance @ jacobian.T, rtol=1e-12)
        at = result.components.index("joint/l_elbow_flex_joint/offset")
        self.assertEqual(result.propagate(numpy.eye(len(result.components))[at])[0, 0], result.covariance[at, at])
        self.assertAlmostEqual(result["joint/l_elbow_flex_joint/offset"].sigma[0] ** 2, result.covariance[at, at], delta=1e-12)
        for name, parameter in result.parameters.items():
            numpy.testing.assert_array_equal(parameter.covariance, parameter.covariance.T)
            for k, component in enumerate(parameter.components):
                if component in result.components:
                    i = result.components.index(component)
                    self.assertEqual(parameter.covariance[k, k], result.covariance[i, i], name)

    def test_bending(self):
        chain = [("a", "l1", "0 0 1", "0 0 0.4"), ("b", "l2", "0 1 0", "0.1 0 0.1"), ("c", "l3", "0 1 0", "0 0 0.5"), ("d", "l4", "1 0 0", "0.4 0 0.05"), ("e", "hand", "0 1 0", "0.1 0 0")]
        urdf = self.write("robot.urdf", '<robot name="r"><link name="base"/>%s</robot>' % "".join(revolute([(n, l, o, a) for n, l, a, o in chain], "base", 2.4)))
        self.write("true.yaml", bending_test.RIG % bending_test.ELASTIC)
        self.write("rig.yaml", bending_test.RIG % "")
        made = kincal.simulate(self.path("true.yaml"), 120, 7)
        true = kincal.Rig(self.path("true.yaml"))
        result = kincal.calibrate(self.path("rig.yaml"), made.samples, no_report=True)
        self.assertIn("robot_unbent.urdf", result.files)
        off = {"calibrated": [], "as a URDF has it": []}
        for sample, values in zip(made.samples, made.truth["samples"].values()):  # true readings: no noise between
            seen = true.forward(values["joints"], "target/ball", "sensor/tracker")
            off["calibrated"].append(numpy.linalg.norm((result.forward(values["joints"], "target/ball", "sensor/tracker") - seen)[:3, 3]))
            rigid = kincal.Rig.from_text(result.files["rig_rigid.yaml"], result.urdf)
            off["as a URDF has it"].append(numpy.linalg.norm((rigid.forward(values["joints"], "target/ball", "sensor/tracker") - seen)[:3, 3]))
            pose = sample["views"][0]["pose"]
            self.assertLess(numpy.linalg.norm(seen[:3, 3] - pose["xyz"]), 2e-4)  # measured: noise of 20 um an axis, and of the joints
        self.assertLess(numpy.mean(off["calibrated"]), 0.35 * numpy.mean(off["as a URDF has it"]))
        # As the program compensates, from the folder that was written.
        result.save(self.path("result"))
        joints = {name: numpy.array([s["joints"][name] for s in made.samples[:20]]) for name in "abcde"}
        self.write("postures.csv", "a,b,c,d,e\n" + "".join(",".join(repr(joints[n][i]) for n in "abcde") + "\n" for i in range(20)))
        lines = program("compensate", self.path("result"), self.path("postures.csv"), "--tip", "target/ball", "--position").splitlines()
        found = result.compensate(joints, "target/ball", position_only=True)
        for i, line in enumerate(lines[1:]):
            self.assertEqual([float(v) for v in line.split(",")], [found.joints[n][i] for n in "abcde"])
        self.assertLess(found.position.max(), 1e-6)
        with self.assertRaisesRegex(kincal.InputError, "base: 'hand' does not stand still"):
            result.compensate(joints, "target/ball", base="hand")
        self.assertTrue(os.path.exists(urdf))


class Values(Folder):
    @classmethod
    def setUpClass(cls):
        cls.rig, cls.samples = kincal.Rig(os.path.join(PR2, "rig.yaml")), kincal.Samples(os.path.join(PR2, "samples.jsonl"))
        cls.result = kincal.calibrate(cls.rig, cls.samples, holdout=4)

    def test_read_only(self):
        result, sample = self.result, self.samples[0]
        arrays = [result.covariance, result.parameters["joint/l_elbow_flex_joint/offset"].value, result.residuals["wide_left"].after]
        arrays += [v for view in sample["views"] for v in view.values() if isinstance(v, numpy.ndarray)]
        self.assertGreater(len(arrays), 4)
        for array in arrays:
            with self.assertRaises(ValueError):
                array[...] = 0
        with self.assertRaises(TypeError):
            result.parameters["x"] = 1
        with self.assertRaises(AttributeError):
            result.parameters["joint/l_elbow_flex_joint/offset"].value = 1
        result.to_dict().clear()
        self.rig.to_dict().clear()
        self.assertEqual(result.to_dict()["status"], "converged")

    def test_pickle_and_copy(self):
        for one in (pickle.loads(pickle.dumps(self.result)), copy.copy(self.result), copy.deepcopy(self.result)):
            self.assertEqual(one.files, self.result.files)
            numpy.testing.assert_array_equal(one.covariance, self.result.covariance)
            numpy.testing.assert_array_equal(one.residuals["wide_left"].whitened, self.result.residuals["wide_left"].whitened)
            with self.assertRaises(ValueError):
                one.covariance[0, 0] = 0
            joints = {j: 0.1 for j in one.rig.joints}
            numpy.testing.assert_array_equal(one.forward(joints, "sensor/left_arm"), self.result.forward(joints, "sensor/left_arm"))
        for one in (pickle.loads(pickle.dumps(self.rig)), copy.deepcopy(self.rig)):
            self.assertEqual((one, one.path, one.to_dict()), (self.rig, self.rig.path, self.rig.to_dict()))
        for one in (pickle.loads(pickle.dumps(self.samples)), copy.deepcopy(self.samples)):
            self.assertEqual((one, one.path, len(one)), (self.samples, self.samples.path, 64))
        flange = kincal.Rig({"format": "kincal/1", "robot": {"base": "b", "flange": "f"}, "targets": {"t": {"type": "points", "points": [[0, 0, 0]], "mount": {"link": "b"}}},
                             "sensors": {"s": {"type": "point", "link": "f", "sigma": 0.001}}})
        self.assertEqual(pickle.loads(pickle.dumps(flange)).to_dict(), flange.to_dict())

    def test_words(self):
        for one, words in ((self.rig, ("pr2_like", "wide_left (camera)")), (self.samples, ("64 samples",)),
                           (self.result, (self.result.to_dict()["verdict"]["text"], "joint/laser_tilt_mount_joint/scale", "degrees of freedom"))):
            for word in words:
                self.assertIn(word, repr(one))
            self.assertLess(repr(one).count("\n"), 20)

    def test_dataframe(self):
        try:
            import pandas
        except ImportError:
            self.skipTest("no pandas")
        frame = self.result.to_dataframe()
        self.assertIsInstance(frame, pandas.DataFrame)
        self.assertEqual(frame.loc["joint/l_elbow_flex_joint/offset", "value"], self.result["joint/l_elbow_flex_joint/offset"].value[0])
        self.assertEqual(len(frame), sum(len(p.components) for p in self.result.parameters.values()))
        readings = self.samples.to_dataframe()
        self.assertEqual(readings.loc[self.samples[3]["id"], "l_elbow_flex_joint"], self.samples[3]["joints"]["l_elbow_flex_joint"])

    def test_files(self):
        self.result.report(self.path("x.html"))
        self.assertIn("kincal-report-data", self.read("x.html"))
        with self.assertRaisesRegex(kincal.InputError, "force"):
            self.result.report(self.path("x.html"))
        self.samples[:3].save(self.path("some.jsonl"))
        self.assertEqual(len(kincal.Samples(self.path("some.jsonl"), rig=self.rig)), 3)
        self.assertEqual(self.result.unmet, [])
        strict = kincal.calibrate(self.rig, self.samples, require="sensor/wide_left<0.001px")
        self.assertEqual(len(strict.unmet), 1)
        self.assertIn("wide_left", strict.unmet[0])


class Errors(Folder):
    @classmethod
    def setUpClass(cls):
        cls.rig, cls.samples = kincal.Rig(os.path.join(PR2, "rig.yaml")), kincal.Samples(os.path.join(PR2, "samples.jsonl"))

    def fails(self, call, words, **place):
        with self.assertRaises(kincal.InputError) as caught:
            call()
        self.assertIn(words, str(caught.exception))
        for key, value in place.items():
            self.assertEqual(getattr(caught.exception, key), value, str(caught.exception))

    def test_options(self):
        run = lambda **options: lambda: kincal.calibrate(self.rig, self.samples, **options)
        self.fails(run(free="joint/l_elbow_flex/offset"), "matches no parameter", name="free", file=None)
        self.fails(run(options={"fre": "x"}), "nearest: free", name="fre")
        self.fails(run(noise="late"), "valid: latent", name="noise")
        self.fails(run(free=[1]), "a list of names is expected, not [1]", name="free")
        self.fails(run(threads=0), "is not in 1 .. 1024", name="threads")
        self.fails(run(threads=1.5), "an integer is expected", name="threads")
        self.fails(run(holdout=1), "is not in 2 .. 1000", name="holdout")
        self.fails(run(step="nothing"), "there is no step", name="step")
        self.fails(run(group="gears"), "for rigs without `estimate`; this rig's steps list the estimated parameters (free frees more of them)", name="group")
        self.fails(run(require="wide_left<1"), "require 'wide_left<1'", name="require")
        self.fails(run(report_frame="nowhere"), "nowhere", name="report_frame")
        with self.assertRaises(TypeError):
            kincal.calibrate(self.rig, self.samples, fre="x")
        self.fails(lambda: kincal.simulate(self.rig, 0, 1), "0 is no integer in 1 .. 1000000", name="samples")
        self.fails(lambda: kincal.simulate(self.rig, 5, 1, spread={"joint/nothing": 0.1}), "matches no parameter", name="spread")
        self.fails(lambda: kincal.simulate(self.rig, 5, 1, spread={"joint/*/offset": -1}), "a number from 0 on is expected", name="spread")
        self.fails(lambda: kincal.evaluate(self.rig, self.samples, free="nothing"), "matches no parameter", name="free")

    def test_files(self):
        path = self.path("rig.yaml")
        self.fails(lambda: kincal.Rig(path), "cannot be read", file=path)
        shutil.copy(os.path.join(PR2, "robot.urdf"), self.dir)
        with open(os.path.join(PR2, "rig.yaml"), encoding="utf-8") as file:
            text = file.read()
        line = [i for i, row in enumerate(text.split("\n"), 1) if "type: tilting_laser" in row]
        self.write("rig.yaml", text.replace("tilting_laser", "tilting_lasr"))
        with self.assertRaises(kincal.InputError) as caught:
            kincal.Rig(path)
        said = subprocess.run([KINCAL, "check", path, os.path.join(PR2, "samples.jsonl")], stderr=subprocess.PIPE, universal_newlines=True).stderr
        self.assertEqual("kincal: error: %s\n" % caught.exception, said)  # the program's own message
        self.assertEqual((caught.exception.file, [caught.exception.line]), (path, line))
        self.assertIn("type", caught.exception.name)

    def test_not_utf8(self):
        """A robot with a comment in Latin-1, in a folder with such a name."""
        folder = os.path.join(os.fsencode(self.dir), b"caf\xe9")
        os.mkdir(folder)
        with open(os.path.join(PR2, "robot.urdf"), "rb") as file:
            urdf = file.read().replace(b"</robot>", b"<!-- caf\xe9 --></robot>")
        with open(os.path.join(folder, b"robot.urdf"), "wb") as file:
            file.write(urdf)
        shutil.copy(os.path.join(PR2, "rig.yaml"), os.fsdecode(folder))
        rig = os.path.join(os.fsdecode(folder), "rig.yaml")
        result = kincal.calibrate(rig, self.samples)
        result.save(os.path.join(os.fsdecode(folder), "out"))
        with open(os.path.join(folder, b"out", b"robot.urdf"), "rb") as file:
            self.assertIn(b"<!-- caf\xe9 -->", file.read())
        self.assertEqual(pickle.loads(pickle.dumps(result)).urdf, result.urdf)
        self.fails(lambda: kincal.Rig(rig + "x"), "cannot be read", file=rig + "x")

    def test_samples(self):
        given = [copy.deepcopy(s) for s in self.samples[:3]]
        view = next(k for k, v in enumerate(given[2]["views"]) if "pixels" in v)

        def changed(change):
            samples = [copy.deepcopy(s) for s in given]
            change(samples)
            return lambda: kincal.calibrate(self.rig, samples)

        def set_pixels(pixels):
            return lambda samples: samples[2]["views"][view].update(pixels=pixels)

        pixels = numpy.array(given[2]["views"][view]["pixels"])
        self.fails(changed(set_pixels(pixels[:-1])), "views[%d]" % view, file="samples", line=3)
        self.fails(changed(set_pixels(numpy.hstack([pixels, pixels]))), "views[%d]" % view, file="samples", line=3)
        broken = pixels.copy()
        broken[4, 1] = numpy.nan
        self.fails(changed(set_pixels(broken)), "nan is not finite", name="samples[2].views[%d].pixels[4][1]" % view)
        self.fails(changed(lambda samples: samples[1]["joints"].update(l_elbow_flex_joint=float("inf"))), "inf is not finite", name="samples[1].joints.l_elbow_flex_joint")
        self.fails(changed(lambda samples: samples[1]["joints"].pop("l_elbow_flex_joint")), "l_elbow_flex_joint", file="samples", line=2)
        self.fails(changed(lambda samples: samples[0]["views"][0].update(sensor="camera")), "camera", file="samples", line=1)
        self.fails(changed(lambda samples: samples[1].update(id=samples[0]["id"])), "id", file="samples", line=2)
        self.fails(changed(lambda samples: samples[1].update(extra=object())), "a object is no number", name="samples[1].extra")

    def test_robot(self):
        result = kincal.calibrate(self.rig, self.samples)
        self.fails(lambda: result.forward({}, "l_wrist"), "there is no frame 'l_wrist'", name="frame")
        self.fails(lambda: result.forward({}, "sensor/left_arm"), "there is no reading of joint", name="joints")
        self.fails(lambda: result.forward({"l_elbow": 1}, "sensor/left_arm"), "is no joint with a reading; nearest: l_elbow_flex_joint", name="joints")
        self.fails(lambda: result.forward({"l_elbow_flex_joint": float("nan")}, "base_link"), "is not finite", name="joints")
        self.fails(lambda: result.forward({"l_elbow_flex_joint": [1, 2], "r_elbow_flex_joint": [1, 2, 3]}, "base_link"), "one shape", name="joints")
        self.fails(lambda: result.propagate([[1, 2]]), "entries are expected", name="jacobian")
        self.fails(lambda: result["joint/l_elbow/offset"], "was not estimated")
        self.fails(lambda: result.compensate({}, "base_link"), "nothing to compensate")

    def test_what_was_not_estimated(self):
        """A held parameter with its reason; a pose that the rig does not have is new, no change."""
        values = {k: v for k, v in self.rig.to_dict().items() if k != "estimate"}
        del values["sensors"]["left_arm"]["pose"]
        result = kincal.calibrate(kincal.Rig(values, urdf=os.path.join(PR2, "robot.urdf")), self.samples)
        held = result.to_dict()["held"]
        self.assertTrue(held)
        self.fails(lambda: result[held[0]["parameter"]], "was kept at its nominal value: " + held[0]["text"])
        changes, *new = repr(result).split("  new: ")
        self.assertNotIn("sensor/left_arm/pose", changes)
        self.assertIn(["sensor/left_arm/pose", "xyz"] + ["%.5g" % x for x in result["sensor/left_arm/pose"].pose["xyz"]], [one.split()[:5] for one in new])

    def test_nothing_changed(self):
        before = pickle.dumps((self.rig, self.samples)), kincal.calibrate(self.rig, self.samples).to_dict()["parameters"]
        for options in ({"free": "nothing"}, {"step": "nothing"}, {"threads": -1}):
            self.fails(lambda: kincal.calibrate(self.rig, self.samples, **options), "")
        self.assertEqual(before, (pickle.dumps((self.rig, self.samples)), kincal.calibrate(self.rig, self.samples).to_dict()["parameters"]))

    def test_no_start(self):
        """A camera that looks away: what may be wrong is said, as the program says it first."""
        chain = [("a", "l1", "0 0 0.4", "0 0 1"), ("b", "l2", "0.1 0 0.1", "0 1 0"), ("c", "hand", "0 0 0.5", "0 1 0")]
        urdf = '<robot name="r"><link name="base"/>%s</robot>' % "".join(revolute(chain, "base", 2.4))
        entries = {"format": "kincal/1", "robot": "robot.urdf", "joints": {"*": {"sigma": 1e-4}}, "estimate": [{"step": "one", "free": ["joint/b/offset", "joint/c/offset"]}],
                   "targets": {"board": {"type": "chessboard", "rows": 5, "columns": 6, "square": 0.04, "mount": {"link": "hand", "pose": {"xyz": [0.1, 0, 0.1], "rpy": [0, 1.57, 0]}}}},
                   "sensors": {"cam": {"type": "camera", "link": "base", "model": "pinhole", "intrinsics": [1000, 1000, 640, 480], "image_size": [1280, 960], "sigma": 0.2,
                                       "pose": {"xyz": [2.2, 0.1, 0.5], "rpy": [-1.5708, 0.02, 1.5908]}}}}
        samples = kincal.simulate(kincal.Rig(entries, urdf=urdf), 12, 1).samples
        self.assertEqual(kincal.calibrate(kincal.Rig(entries, urdf=urdf), samples).status, "converged")
        entries["sensors"]["cam"]["pose"]["rpy"] = [-1.5708, 0.02, -1.5508]
        with self.assertRaises(kincal.StartError) as caught:
            kincal.calibrate(kincal.Rig(entries, urdf=urdf), samples)
        self.write("robot.urdf", urdf)
        self.write("rig.yaml", json.dumps(entries))
        samples.save(self.path("samples.jsonl"))
        done = subprocess.run([KINCAL, "calibrate", "rig.yaml", "samples.jsonl", "--out", "out"], cwd=self.dir, stderr=subprocess.PIPE, universal_newlines=True)
        self.assertEqual(done.returncode, 1)
        self.assertTrue(done.stderr.startswith("kincal: error: " + str(caught.exception).split("\n")[0]), (done.stderr, str(caught.exception)))


class Watching(Folder):
    def test_monitor(self):
        """The same as the program, of a result in memory and of its folder."""
        rig = os.path.join(PR2, "rig.yaml")
        result = kincal.calibrate(rig, os.path.join(PR2, "samples.jsonl"), no_report=True)
        result.save(self.path("watched"))
        later = kincal.simulate(rig, 64, 3, truth=os.path.join(PR2, "truth_values.json"), postures=os.path.join(PR2, "postures.jsonl")).samples
        with open(self.path("later.jsonl"), "w") as file:
            file.write(later.text)
        told = subprocess.run([KINCAL, "monitor", self.path("watched"), self.path("later.jsonl"), "--json"], stdout=subprocess.PIPE, text=True, check=True).stdout
        monitors = [kincal.Monitor(result), kincal.Monitor(self.path("watched"))]
        for line, sample in zip(told.splitlines(), later):
            for monitor in monitors:
                self.assertEqual(monitor.add(sample), json.loads(line))
        self.assertEqual(monitors[0].moved, [])
        self.assertIn("64 samples, 0 outliers. Nothing has moved", repr(monitors[0]))
        self.assertLess(abs(monitors[0].noise["narrow_left"] - 1), 0.1)

    def test_mistakes(self):
        kincal.calibrate(os.path.join(PR2, "rig.yaml"), os.path.join(PR2, "samples.jsonl"), no_report=True).save(self.path("wrong"))
        monitor = kincal.Monitor(self.path("wrong"))
        sample = dict(kincal.Samples(os.path.join(PR2, "samples.jsonl"))[0])
        first = monitor.add(sample)
        with self.assertRaises(kincal.InputError) as wrong:
            monitor.add(dict(sample, id="two", views=[{"sensor": "nobody", "target": "small_board"}]))
        self.assertEqual((wrong.exception.file, wrong.exception.line), ("samples", 1))
        self.assertIn("1 samples", repr(monitor))
        self.assertEqual(kincal.Monitor(self.path("wrong")).add(sample), first)
        for bad in (dict(false_alarms=1), dict(false_alarms=float("nan"))):
            with self.assertRaises(kincal.InputError):
                kincal.Monitor(self.path("wrong"), **bad)
        with self.assertRaises(kincal.InputError):
            kincal.Monitor(os.path.join(PR2, "rig.yaml"))


    def test_state_and_recalibration(self):
        rig = os.path.join(PR2, "rig.yaml")
        with open(os.path.join(PR2, "truth_values.json")) as file:
            truth = json.load(file)["parameters"]
        result = kincal.calibrate(rig, os.path.join(PR2, "samples.jsonl"), no_report=True)
        name = "sensor/narrow_right/baseline"
        moved = {"parameters": dict(truth, **{name: truth[name] + 0.0005})}
        later = list(kincal.simulate(rig, 64, 4, truth=moved, postures=os.path.join(PR2, "postures.jsonl")).samples)
        one, other = kincal.Monitor(result), kincal.Monitor(result)
        for sample in later[:30]:
            one.add(sample)
        state = one.save()
        other.load(state)
        self.assertEqual(one.add(later[30]), other.add(later[30]))
        self.assertEqual(one.moved, other.moved)
        self.assertEqual(one.moved[0][0]["group"], name)
        before = other.save()
        for wrong in (state[:-1], b"", state[:100] + b"x" + state[101:]):
            with self.assertRaises(kincal.InputError):
                other.load(wrong)
        self.assertEqual(other.save(), before)
        for groups in ([], [name]):
            done = one.recalibrated(later, groups)
            self.assertEqual(done["samples"], 64)
            found = done["values"][name]
            self.assertTrue(found["determined"])
            self.assertLess(abs(found["change"] - 0.0005), 4 * found["sigma"])
            self.assertLess(found["sigma"], 0.0001)
        with self.assertRaises(kincal.InputError) as wrong:
            one.recalibrated(later, ["sensor/narrow_rihgt/baseline"])
        self.assertIn("nearest: sensor/narrow_right/baseline", str(wrong.exception))

    def test_static_views(self):
        draw = random.Random(1)
        views, shift = kincal.StaticViews(), 0
        for n in range(40):
            shift = 3 if n == 30 else shift
            pixels = [[100 * (i % 5) + shift + draw.gauss(0, 0.1), 100 * (i // 5) + draw.gauss(0, 0.1)] for i in range(20)]
            told = views.add({"id": str(n), "views": [{"sensor": "eye", "pixels": pixels}]})["sensors"]["eye"]
            self.assertEqual(told["learning"], n < 10 or n > 30)
            self.assertEqual(told["moved"] is not None, n == 30)
        self.assertIn("eye has moved", repr(views))
        with self.assertRaises(kincal.InputError):
            views.add({"views": [{"sensor": "eye"}]})


class Planning(Folder):
    def test_plan(self):
        """The same as the program; and after samples, of candidates of one's own."""
        rig = os.path.join(PR2, "rig.yaml")
        made = kincal.plan(rig, next=8, candidates=200, seed=3)
        out = subprocess.run([KINCAL, "plan", rig, "--next", "8", "--candidates", "200", "--seed", "3", "--json", "--out", self.path("p.jsonl")], stdout=subprocess.PIPE, text=True, check=True).stdout
        self.assertEqual(made.forecast, json.loads(out))
        with open(self.path("p.jsonl")) as file:
            self.assertEqual(made.postures, [json.loads(line) for line in file])
        self.assertIn("Predicted error of the calibration", repr(made))
        more = kincal.plan(rig, os.path.join(PR2, "samples.jsonl"), next=3, postures=made.postures, clearance=None)
        self.assertEqual(more.forecast["candidates"], 8)
        self.assertLess(more.forecast["forecast"][0]["planned"], 0.1 * made.forecast["forecast"][0]["planned"])
        samples = kincal.simulate(rig, 8, 1, postures=made.postures, spread={"joint/*/offset": 0.001}).samples
        self.assertEqual(len(samples), 8)
        for bad in (dict(next=0), dict(clearance=-1.0), dict(goal="frame/nobody"), dict(goal="frame/base_link<1px")):
            with self.assertRaises(kincal.InputError) as wrong:
                kincal.plan(rig, **bad)
            self.assertIn(next(iter(bad)), str(wrong.exception))


class Verifying(Folder):
    RIG = """{format: kincal/1, robot: robot.urdf, base: base, joints: {"*": {sigma: 0.00002}},
targets: {reflector: {type: points, points: [[0, 0, 0]], mount: {link: flange, pose: {xyz: [0.02, 0.03, 0.1]}}}},
sensors: {tracker: {type: point, link: base, pose: {xyz: [2, 0.3, 0.5], rpy: [0, 0, 3]}, sigma: 0.00003}},
estimate: [{step: all, free: [joint/lift/offset, joint/bend/offset, joint/wrist_bend/offset, sensor/tracker/pose, "target/reflector/pose.[xyz]"]}]}"""

    def test_circle(self):
        """Test poses, their samples and the certificate are those of the program."""
        path = self.path("rig.yaml")
        shutil.copy(os.path.join(SOURCE_DIR, "examples", "arm", "robot.urdf"), self.path("robot.urdf"))
        with open(path, "w") as file:
            file.write(self.RIG)
        spread = {"joint/lift/offset": 0.003, "joint/bend/offset": 0.003, "*/pose.[xyz]": 0.003}
        first = kincal.simulate(path, 40, 3, spread=spread)
        result = kincal.calibrate(path, first.samples)
        result.save(self.path("result"))
        planned = kincal.plan_verification(result.rig, cycles=4, region=[-2, -2, 0, 2, 2, 2])
        out = subprocess.run([KINCAL, "plan", self.path("result"), "--verify", "--cycles", "4", "--region=-2,-2,0,2,2,2", "--json", "--out", self.path("poses.jsonl")], stdout=subprocess.PIPE, text=True, check=True).stdout
        self.assertEqual(planned.plan, json.loads(out))
        with open(self.path("poses.jsonl")) as file:
            self.assertEqual(planned.postures, [json.loads(line) for line in file])
        self.assertIn("ISO 9283: 5 poses of target 'reflector'", repr(planned))
        later = kincal.simulate(path, 20, 4, truth=first.truth, postures=planned.postures).samples
        later.save(self.path("later.jsonl"))
        found = kincal.verify(result, later, standard="iso9283", tolerance="max frame/target/reflector<0.5mm", instrument="tracker 7")
        out = subprocess.run([KINCAL, "verify", self.path("result"), self.path("later.jsonl"), "--standard", "iso9283", "--tolerance", "max frame/target/reflector<0.5mm", "--instrument", "tracker 7", "--json"],
                             stdout=subprocess.PIPE, text=True, check=True).stdout
        told, printed = found.to_dict(), json.loads(out)
        self.assertEqual(found.answer, "pass")
        for key in ("after", "before", "tolerance", "repeated", "counts", "instrument", "text"):
            self.assertEqual(told[key], printed[key], key)
        self.assertTrue(repr(found).startswith("pass: largest error of positions"))
        found.save(self.path("certificate"))
        self.assertEqual(sorted(os.listdir(self.path("certificate"))), ["certificate.html", "certificate.json"])
        for bad, words in ((dict(tolerance="frame/flange<1px"), "tolerance"), (dict(standard="din"), "standard: 'distances' or 'iso9283'"), (dict(sensor="eye"), "eye")):
            with self.assertRaises(kincal.InputError) as wrong:
                kincal.verify(self.path("result"), later, **bad)
            self.assertIn(words, str(wrong.exception))
        for bad in (dict(cycles=0), dict(region=[1, 2]), dict(sensor="eye")):
            with self.assertRaises(kincal.InputError) as wrong:
                kincal.plan_verification(path, **bad)
            self.assertIn(next(iter(bad)), str(wrong.exception))


class Running(Folder):
    def test_progress(self):
        told = []
        plain = kincal.calibrate(os.path.join(PR2, "rig.yaml"), os.path.join(PR2, "samples.jsonl"))
        result = kincal.calibrate(os.path.join(PR2, "rig.yaml"), os.path.join(PR2, "samples.jsonl"), cross_validate=3, progress=told.append)
        self.assertEqual(plain.to_dict()["parameters"], result.to_dict()["parameters"])
        steps = {t.what for t in told if t.iteration >= 0}
        self.assertLessEqual({"head", "arms", "all"}, steps)
        self.assertTrue(any("fold 2 of 3" in step for step in steps), steps)
        chi2 = [t.chi2 for t in told if t.what == "all" and t.iteration > 0]
        self.assertAlmostEqual(chi2[-1], result.to_dict()["steps"][-1]["history"][-1][0], delta=1e-6 * chi2[-1])
        self.assertTrue(any(t.share is not None for t in told))

    def test_listener_raises(self):
        def listener(told):
            raise KeyError(told.what)
        begin = threading.active_count()
        with self.assertRaises(KeyError):
            kincal.calibrate(os.path.join(PR2, "rig.yaml"), os.path.join(PR2, "samples.jsonl"), cross_validate=20, progress=listener)
        self.assertEqual(threading.active_count(), begin)
        with self.assertRaises(KeyError):
            kincal.check(os.path.join(PR2, "rig.yaml"), os.path.join(PR2, "samples.jsonl"), progress=listener)
        with self.assertRaises(KeyError):
            kincal.simulate(os.path.join(PR2, "rig.yaml"), 50, 1, progress=listener)

    def test_other_threads_run(self):
        counted, over = [0], threading.Event()

        def count():
            while not over.is_set():
                counted[0] += 1
                time.sleep(0)
        thread = threading.Thread(target=count)
        thread.start()
        results = [None, None]

        def calibrate(i):
            results[i] = kincal.calibrate(os.path.join(PR2, "rig.yaml"), os.path.join(PR2, "samples.jsonl"), cross_validate=5).to_dict()["parameters"]
        others = [threading.Thread(target=calibrate, args=(i,)) for i in range(2)]
        before = counted[0]
        for other in others:
            other.start()
        for other in others:
            other.join()
        self.assertGreater(counted[0], before + 100)
        over.set()
        thread.join()
        self.assertEqual(results[0], results[1])
        self.assertIsNotNone(results[0])

    def test_interrupt(self):
        code = ("import sys; sys.path.insert(0, %r); import kincal\n"
                "def listener(told):\n  if told.iteration == 1: print('started', flush=True)\n"
                "try:\n  kincal.calibrate(%r, %r, restarts=10000, progress=listener)\n"
                "except KeyboardInterrupt:\n  print('interrupted', flush=True)\n  print(len(kincal.calibrate(%r, %r).components))\n"
                % ((PACKAGE,) + (os.path.join(PR2, "rig.yaml"), os.path.join(PR2, "samples.jsonl")) * 2))
        process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)
        self.addCleanup(process.kill)
        self.assertEqual(process.stdout.readline(), "started\n")
        process.send_signal(signal.SIGINT)
        out, errors = process.communicate(timeout=60)
        lines = [line for line in out.splitlines() if line != "started"]
        self.assertEqual((lines, process.returncode, errors), (["interrupted", "56"], 0, ""))

    def test_no_detect(self):
        shutil.copytree(os.path.join(PACKAGE, "kincal"), self.path("alone", "a", "b", "kincal"))
        code = "import sys; sys.path.insert(0, %r); import kincal; kincal.detect(%r, 'x')" % (self.path("alone", "a", "b"), os.path.join(ARM, "rig.yaml"))
        done = subprocess.run([sys.executable, "-c", code], stderr=subprocess.PIPE, universal_newlines=True, env={**os.environ, "PATH": self.dir})
        self.assertIn("FileNotFoundError: kincal-detect is neither beside this package nor on PATH", done.stderr)


class Types(Folder):
    def test_stubs(self):
        from kincal import _kincal
        with open(os.path.join(PACKAGE, "kincal", "_kincal.pyi"), encoding="utf-8") as file:
            stubs = file.read()
        names = set(re.findall(r"^(?:def|class) (\w+)", stubs, re.M))
        self.assertEqual(names, {name for name, value in vars(_kincal).items() if callable(value)})
        self.assertTrue(os.path.exists(os.path.join(PACKAGE, "kincal", "py.typed")))

    def test_mypy(self):
        if not shutil.which("mypy"):
            self.skipTest("no mypy")
        self.write("use.py", "import kincal\nresult = kincal.calibrate('a', [{}], free=['x'])\nnumber: float = result['x'].value[0]\nshape: int = result.covariance.shape[0]\n"
                             "wrong: str = result.covariance\nkincal.calibrate('a', 'b', threads='x')\n")
        environment = {**os.environ, "MYPYPATH": PACKAGE}
        done = subprocess.run(["mypy", "--strict", "--cache-dir", self.path("cache"), os.path.join(PACKAGE, "kincal")], stdout=subprocess.PIPE, universal_newlines=True, env=environment)
        self.assertEqual(done.returncode, 0, done.stdout)
        done = subprocess.run(["mypy", "--strict", "--cache-dir", self.path("cache"), self.path("use.py")], stdout=subprocess.PIPE, universal_newlines=True, env=environment)
        self.assertEqual([int(n) for n in re.findall(r"use.py:(\d+): error", done.stdout)], [5, 6], done.stdout)


class Readme(Folder):
    def test_example(self):
        """The README's ten lines, run where they say; what they print is what the program found."""
        with open(os.path.join(SOURCE_DIR, "README.md"), encoding="utf-8") as file:
            code = re.search(r"```python\n(.*?)```", file.read(), re.S).group(1)
        self.assertLessEqual(len(code.splitlines()), 10)
        self.write("example.py", code)
        os.mkdir(self.path("build"))
        shutil.copytree(os.path.join(SOURCE_DIR, "examples", "pr2"), self.path("examples", "pr2"))
        done = subprocess.run([sys.executable, self.path("example.py")], stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, cwd=self.dir,
                              env={**os.environ, "PYTHONPATH": PACKAGE})
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        program("calibrate", "examples/pr2/rig.yaml", "examples/pr2/samples.jsonl", "--out", "program", cwd=self.dir)
        result = json.loads(self.read("program", "result.json"))
        self.assertIn(repr(result["parameters"]["joint/l_elbow_flex_joint/offset"]["value"][0]), done.stdout)
        self.assertEqual(without_run(result), without_run(json.loads(self.read("build", "python", "result.json"))))


if __name__ == "__main__":
    if numpy is None or not os.path.isdir(os.path.join(PACKAGE, "kincal")):
        print("skipped: no numpy or no package")
        sys.exit(77)
    result = unittest.main(argv=sys.argv[:1] + sys.argv[4:], exit=False).result
    for _, reason in result.skipped:
        print("skipped: " + reason)
    sys.exit(1 if not result.wasSuccessful() else 77 if len(result.skipped) == result.testsRun else 0)
