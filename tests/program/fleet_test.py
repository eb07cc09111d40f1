"""`kincal fleet` through the program. Usage: fleet_test.py SOURCE KINCAL

Proves, on robots simulated after examples/arm: one robot whose joint is off is named first, with that joint, and gives exit code 4; a fleet
without it gives 0; what is written agrees with what is printed, and is the same whatever the order of the results; serial and time come from
the rig, else from the folder's name; a robot over months is said to drift, by as much as planted, and the place of its board is not; information.csv is of the data alone (beside covariance.csv where there are no priors); results that
cannot be used are left out with the reason; bad input is said with file and field.
Does not prove: that results do not depend on priors of their rigs that the data contradict (they do where these move an estimate far); the shares of false alarms and of what is found: family_test.cpp, drift_test.cpp and benchmarks/fleet.py.
"""
import csv
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

import helpers

SOURCE, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
ARM = os.path.join(SOURCE, "examples", "arm")
BEND = 0.03  # rad, of the bad robot


def kincal(folder, *args, code=0):
    done = subprocess.run([KINCAL, *args], cwd=folder, capture_output=True, text=True)
    if done.returncode != code:
        raise AssertionError("exit %d, not %d: kincal %s\n%s%s" % (done.returncode, code, " ".join(args), done.stdout, done.stderr))
    return done.stdout, done.stderr


def make(folder):
    """Results of ten robots in results/, of robot 3 over eight months in months/."""
    postures = ("--postures", os.path.join(ARM, "postures.jsonl"), "--samples", "16", "--quiet")
    rig = os.path.join(ARM, "rig.yaml")
    kincal(folder, "simulate", rig, *postures, "--seed", "1", "--truth", os.path.join(ARM, "truth.json"), "--out", "first")
    kincal(folder, "calibrate", rig, "first/samples.jsonl", "--out", "drawn", "--quiet", "--no-report")
    with open(rig) as f:
        text = f.read().replace("robot: robot.urdf", "robot: " + os.path.join(ARM, "robot.urdf"))

    def robot(where, name, seed, parameters, head=""):
        with open(os.path.join(folder, "truth.json"), "w") as f:
            json.dump({"parameters": parameters}, f)
        kincal(folder, "simulate", "drawn/rig.yaml", *postures, "--seed", str(seed), "--truth", "truth.json", "--out", where + "/" + name)
        with open(os.path.join(folder, where, name, "rig.yaml"), "w") as f:
            f.write(text.replace("format: kincal/1\n", "format: kincal/1\n" + head))

    os.makedirs(os.path.join(folder, "sets"))
    os.makedirs(os.path.join(folder, "later"))
    def lattice(i):
        sign = [(i * k) % 5 - 2 for k in (1, 2, 3)]
        return {"joint/lift/offset": 0.001 * sign[0], "joint/bend/offset": 0.001 * sign[1], "joint/wrist_bend/offset": 0.001 * sign[2]}

    for i in range(10):
        truth = lattice(i)
        truth["joint/bend/offset"] += BEND if i == 6 else 0
        robot("sets", "r%d" % i, i + 2, truth, "serial: SN-%d\ntime: 2026-03-0%d\n" % (i, i + 1) if i < 7 else "")
    for t in range(8):
        truth = lattice(3)
        truth["joint/bend/offset"] += 0.0015 * (t + 1)
        truth["target/board/pose"] = [0.01 if t >= 4 else 0, 0, 0, 0, 0, 0.02 if t >= 4 else 0]
        robot("later", "SN-3_2026-%02d-15" % (t + 4), t + 50, truth)
    kincal(folder, "batch", "sets", "--out", "results", "--quiet", "--no-report")
    kincal(folder, "batch", "later", "--out", "months", "--quiet", "--no-report")


class Fleet(helpers.Folder):
    @classmethod
    def setUpClass(cls):
        cls.made = tempfile.mkdtemp(prefix="kincal_fleet_")
        cls.addClassCleanup(shutil.rmtree, cls.made, ignore_errors=True)
        make(cls.made)

    def kincal(self, *args, code=0):
        return kincal(self.dir, *args, code=code)

    def result(self, *names):
        return os.path.join(self.made, *names)

    def rows(self, *names):
        with open(self.path(*names), newline="") as f:
            return list(csv.DictReader(f))

    def test_a_bad_robot_is_named(self):
        out, _ = self.kincal("fleet", self.result("results"), "--out", "out", code=4)
        found = json.loads(self.read("out", "fleet.json"))
        worst = found["robots"][0]
        self.assertEqual(worst["serial"], "SN-6")
        self.assertTrue(worst["family"]["out"])
        self.assertTrue(worst["family"]["left_out_of_mean"])
        self.assertEqual(found["out_of_family"], 1)
        self.assertEqual(worst["family"]["numbers"][0]["number"], "joint/bend/offset")
        self.assertAlmostEqual(worst["family"]["numbers"][0]["off"], BEND, delta=0.005)
        self.assertIn("1 of 10 robots", out)
        self.assertIn("No check of drift", out)
        rows = self.rows("out", "robots.csv")
        self.assertEqual([r["serial"] for r in rows], [r["serial"] for r in found["robots"]])
        self.assertEqual([r["out_of_family"] for r in rows], ["yes"] + 9 * ["no"])
        self.assertEqual(sorted(r["serial"] for r in rows)[:7], ["SN-%d" % i for i in range(7)])
        self.assertEqual(sorted(r["serial"] for r in rows)[7:], ["r7", "r8", "r9"])  # without serial: the folder's name
        self.assertEqual(next(r["time"] for r in rows if r["serial"] == "SN-4"), "2026-03-05")
        p = [float(r["p"]) for r in rows]
        self.assertEqual(p, sorted(p))
        first = next(r for r in self.rows("out", "family.csv") if r["serial"] == "SN-6")
        self.assertEqual((first["number"], first["unit"]), ("joint/bend/offset", "rad"))
        # The same in any order, and as --json.
        again, _ = self.kincal("fleet", *[self.result("results", "r%d" % i) for i in (8, 1, 0, 2, 3, 9, 4, 5, 6, 7)], "--out", "again", "--json", code=4)
        self.assertEqual(json.loads(again)["robots"][0]["serial"], "SN-6")
        self.assertEqual([r["serial"] for r in json.loads(again)["robots"]], [r["serial"] for r in found["robots"]])

    def test_a_healthy_fleet(self):
        healthy = [self.result("results", "r%d" % i) for i in range(10) if i != 6]
        self.kincal("fleet", *healthy, "--out", "out", "--level", "0.001")
        self.assertEqual(json.loads(self.read("out", "fleet.json"))["out_of_family"], 0)
        out, _ = self.kincal("fleet", *healthy[:3], "--out", "few")
        self.assertIn("it needs 8 robots, there are 3", out)
        self.assertIsNone(json.loads(self.read("few", "fleet.json"))["family"])
        _, err = self.kincal("fleet", *healthy, "--out", "out", code=1)
        self.assertIn("out", err)
        self.kincal("fleet", *healthy, "--out", "out", "--force", "--quiet", "--level", "0.001")

    def test_a_robot_over_months(self):
        out, _ = self.kincal("fleet", self.result("results", "r3"), self.result("months"), "--out", "out", code=4)
        found = json.loads(self.read("out", "fleet.json"))
        self.assertEqual([r["serial"] for r in found["robots"]], ["SN-3"])
        self.assertEqual([r["time"] for r in found["robots"][0]["results"]], ["2026-03-04"] + ["2026-%02d-15" % m for m in range(4, 12)])
        causes = found["robots"][0]["drift"]["causes"]
        self.assertEqual((causes[0]["number"], causes[0]["kind"]), ("joint/bend/offset", "line"))
        self.assertEqual(len(causes), 1)
        self.assertAlmostEqual(causes[0]["value"], 0.0015 * 12, delta=0.002)  # a year
        self.assertIn("steadily", out)
        self.assertFalse([r for r in self.rows("out", "drift.csv") if r["number"].startswith("target/board/pose")])

    def test_precise_sensors_elsewhere(self):
        """A tracker of 0.05 mm that every robot has at another place: of three robots over six months one has changed, in one number and once."""
        rig = """format: kincal/1
robot: %s
base: base
%sjoints:
  "*": {sigma: 0.0001}
targets:
  balls: {type: points, points: [[0.05, 0.06, 0], [0.05, -0.06, 0.02], [0.12, 0, 0.05], [0, 0.02, -0.07]], mount: {link: flange%s}}
sensors:
  tracker: {type: point, link: base, sigma: 0.00005%s}
"""
        urdf = os.path.join(ARM, "robot.urdf")
        draw = random.Random(5)
        os.mkdir(self.path("sets"))
        for robot in range(3):
            at, turned = ([m + 0.25 * draw.gauss(0, 1) for m in mean] for mean in ([2, 0.3, 0.5], [0, 0, 3]))
            offsets = {"joint/%s/offset" % j: 0.003 * draw.gauss(0, 1) for j in ("lift", "bend", "wrist_bend", "turn", "forearm_roll", "wrist_roll")}
            for month in range(6):
                truth = dict(offsets)
                if robot == 2 and month >= 3:
                    truth["joint/bend/offset"] += 0.002
                self.write("truth.json", json.dumps({"parameters": truth}))
                self.write("given.yaml", rig % (urdf, "", ", pose: {xyz: [0.02, 0.01, 0.08], rpy: [0, 0, 0.3]}", ", pose: {xyz: %s, rpy: %s}" % (at, turned)))
                name = "sets/SN-%d_2026-%02d-01" % (robot, month + 1)
                self.kincal("simulate", "given.yaml", "--postures", os.path.join(ARM, "postures.jsonl"), "--samples", "40", "--seed", str(100 * robot + month),
                            "--truth", "truth.json", "--out", name, "--quiet")
                self.write(os.path.join(name, "rig.yaml"), rig % (urdf, "", "", ""))
        self.kincal("batch", "sets", "--out", "results", "--quiet", "--no-report")
        self.kincal("fleet", "results", "--out", "out", code=4)
        robots = {r["serial"]: r["drift"]["causes"] for r in json.loads(self.read("out", "fleet.json"))["robots"]}
        self.assertEqual({serial: [c["number"] for c in causes] for serial, causes in robots.items()},
                         {"SN-0": [], "SN-1": [], "SN-2": ["joint/bend/offset"]})
        self.assertAlmostEqual(robots["SN-2"][0]["value"], 0.002, delta=0.0002)

    def test_information_is_of_the_data(self):
        # With steps and without priors: the inverse of the covariance.
        pr2 = os.path.join(SOURCE, "examples", "pr2")
        self.kincal("calibrate", os.path.join(pr2, "rig.yaml"), os.path.join(pr2, "samples.jsonl"), "--out", "pr2", "--quiet", "--no-report")
        with open(self.path("pr2", "covariance.csv"), newline="") as f:
            covariance = list(csv.reader(f))
        with open(self.path("pr2", "information.csv"), newline="") as f:
            information = list(csv.reader(f))
        names = covariance[0]
        self.assertEqual(information[0], ["pull"] + names)
        n = len(names)
        c = [[float(v) for v in row] for row in covariance[1:]]
        normal = [[float(information[1 + max(i, j)][1 + min(i, j)]) for j in range(n)] for i in range(n)]
        for i in range(n):
            self.assertTrue(all(v == "" for v in information[1 + i][2 + i:]))
            for j in range(n):
                product = sum(normal[i][k] * c[k][j] for k in range(n))
                self.assertAlmostEqual(product * (c[i][i] / c[j][j]) ** 0.5, float(i == j), delta=1e-5)
            # At the optimum nothing pulls, by more than the solver leaves.
            self.assertLess(abs(float(information[1 + i][0])) * c[i][i] ** 0.5, 1e-2)

    def test_left_out(self):
        shutil.copytree(self.result("results", "r0"), self.path("old"))
        os.remove(self.path("old", "information.csv"))
        shutil.copytree(self.result("results", "r1"), self.path("bad"))
        result = self.read("bad", "result.json").replace('"status": "converged"', '"status": "not_converged"', 1)
        self.write("bad/result.json", result)
        out, _ = self.kincal("fleet", "old", "bad", *[self.result("results", "r%d" % i) for i in (2, 3, 4, 5, 7)], "--out", "out")
        self.assertIn("old: it has no information.csv", out)
        self.assertIn("bad: its status is 'not_converged'", out)
        left = json.loads(self.read("out", "fleet.json"))["left_out"]
        self.assertEqual([one["result"] for one in left], ["old", "bad"])
        _, err = self.kincal("fleet", "old", "--out", "none", code=1)
        self.assertIn("old: it has no information.csv", err)
        self.assertFalse(os.path.exists(self.path("none")))

    def test_other_rigs(self):
        results = [self.result("results", "r%d" % i) for i in (1, 2, 3, 4, 5)]
        for name in ("narrow", "far"):
            shutil.copytree(self.result("results", "r0"), self.path(name))
        rig = self.read("narrow", "rig.yaml")
        self.assertIn("\npriors: {", rig)
        self.write("narrow/rig.yaml", rig.replace("\npriors: {", "\npriors: {joint/bend/offset: 0.005, "))
        result = json.loads(self.read("far", "result.json"))
        result["parameters"]["joint/bend/offset"]["initial"] = [0.4]
        self.write("far/result.json", json.dumps(result))
        out, _ = self.kincal("fleet", "narrow", "far", *results, "--out", "out")
        self.assertIn("Made with another rig than most", out)
        self.assertEqual(json.loads(self.read("out", "fleet.json"))["other_rigs"],
                         [{"result": "narrow", "how": "its rig has other priors than most"},
                          {"result": "far", "how": "joint/bend/offset began 0.4 rad from where it began in most"}])
        out, _ = self.kincal("fleet", *results, "--out", "same")
        self.assertNotIn("another rig", out)
        self.assertEqual(json.loads(self.read("same", "fleet.json"))["other_rigs"], [])

    def test_other_robots_and_broken_results(self):
        """Neither is judged with the others, neither stops it, wherever it stands."""
        results = [self.result("results", "r%d" % i) for i in (1, 2, 3, 4, 5, 7)]
        shutil.copytree(self.result("results", "r0"), self.path("broken"))
        self.write("broken/result.json", "{")
        shutil.copytree(self.result("results", "r0"), self.path("other"))
        for name in ("rig.yaml", "robot.urdf", "result.json", "information.csv", "covariance.csv", "changes.yaml"):
            text = self.read("other", name)
            self.write("other/" + name, re.sub(r"\b(lift|bend|turn|forearm_roll|wrist_bend|wrist_roll)\b", r"slide_\1", text))
        self.kincal("fleet", *results, "--out", "alone")
        out, _ = self.kincal("fleet", "other", "broken", *results, "--out", "out")
        self.assertRegex(out, r"broken: it cannot be read: broken/result.json:\d+:\d+: ")
        self.assertRegex(out, r"other: it is of another robot: 0 of its \d moving joints are among")
        alone, fleet = (json.loads(self.read(name, "fleet.json")) for name in ("alone", "out"))
        self.assertEqual(fleet["robots"], alone["robots"])
        self.assertEqual(len(fleet["left_out"]), 2)

    def test_wrong_input(self):
        os.mkdir(self.path("empty"))
        for args, words in (
                (["nowhere"], "nowhere: is not a directory"),
                (["empty"], "empty: there is no result directory in it"),
                ([self.result("results"), "--anew", "joint/bent/*"], "--anew: 'joint/bent/*' matches no parameter"),
                ([self.result("results"), "--level", "2"], "--level")):
            _, err = self.kincal("fleet", *args, "--out", "out", code=1)
            self.assertIn(words, err)
            self.assertFalse(os.path.exists(self.path("out")))
        shutil.copytree(self.result("results", "r0"), self.path("r0"))
        self.write("r0/result.json", self.read("r0", "result.json").replace('"time": "2026-03-01"', '"time": "in March"'))
        _, err = self.kincal("fleet", "r0", "--out", "out", code=1)
        self.assertIn("r0/result.json: time: 'in March' is not a date like 2026-03-01", err)
        shutil.copytree(self.result("results", "r1"), self.path("r1"))
        lines = self.read("r1", "information.csv").split("\n")
        self.write("r1/information.csv", "\n".join(lines[:3] + [lines[3].replace(",", ",x", 1)] + lines[4:]))
        _, err = self.kincal("fleet", "r1", "--out", "out", code=1)
        self.assertIn("r1/information.csv:4", err)
        self.write("r1/information.csv", "\n".join(lines[:3]))
        _, err = self.kincal("fleet", "r1", "--out", "out", code=1)
        self.assertIn("r1/information.csv: a header", err)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
