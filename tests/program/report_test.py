"""The page of a result: python3 report_test.py SOURCE_DIR KINCAL [TEST ...]

Proves: the data in report.html are those of the files beside it (every residual, sample, loop and correlation, to the digits that are
drawn); `report` makes the same page again from the folder alone; hostile names end no script and are no markup; what is missing or broken
is named; several results, and a batch, get a page that leads to each; the pages of evaluate and check have what these print. Browser (skipped without Chromium, node and npm, or without a network
for npm): the built template is what its sources build, the functions of the sources work, and a real browser shows every section with
the result's numbers, marks a chosen sample everywhere, turns the 3-D view and keeps hostile names as text (io/report/page/tests).
Not proved: that it reads well; pictures were looked at.
"""
import csv
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
HOSTILE = "<img src=x onerror=document.title=1></script><b>&amp;"
SKIPPED = 77


def rows_of(*path):
    with open(os.path.join(*path), newline="") as f:
        return list(csv.DictReader(f))


def data_of(page):
    with open(page, encoding="utf-8") as f:
        return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', f.read(), re.S).group(1))


class Case(unittest.TestCase):
    def setUp(self):
        self.dir = tempfile.mkdtemp(prefix="kincal_report_")
        self.addCleanup(shutil.rmtree, self.dir)

    def kincal(self, *arguments, code=0):
        done = subprocess.run([KINCAL, *arguments], cwd=self.dir, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.assertIn(done.returncode, (0, 1) if code is None else (code,), done.stderr.decode())
        return done.stdout.decode() + done.stderr.decode()

    def path(self, *parts):
        return os.path.join(self.dir, *parts)

    def example(self, folder="robot", samples=24, rename=None):
        """The example with some of its samples; `rename`: (old, new) names in rig and samples."""
        shutil.copytree(os.path.join(SOURCE_DIR, "examples", "pr2"), self.path(folder))
        with open(self.path(folder, "samples.jsonl")) as f:
            lines = f.readlines()[::64 // samples]
        held_out = json.loads(lines[3])
        held_out["split"] = "test"
        lines[3] = json.dumps(held_out) + "\n"
        text = "".join(lines)
        with open(self.path(folder, "rig.yaml")) as f:
            rig = f.read()
        if rename:
            text = text.replace('"%s"' % rename[0], json.dumps(rename[1]))
            rig = re.sub(r"\b%s\b" % rename[0], lambda _: json.dumps(rename[1]), rig)
        with open(self.path(folder, "samples.jsonl"), "w") as f:
            f.write(text)
        with open(self.path(folder, "rig.yaml"), "w") as f:
            f.write(rig.replace("format: kincal/1", 'format: kincal/1\nserial: "A-17 <7>"\ntime: 2026-03-01\n', 1))

    def calibrated(self, out="out", **more):
        self.example(**more)
        self.kincal("calibrate", "robot/rig.yaml", "robot/samples.jsonl", "--out", out, "--quiet")
        return data_of(self.path(out, "report.html"))


class Data(Case):
    def close(self, drawn, field, digits):
        if field == "":
            self.assertIsNone(drawn)
        else:
            self.assertAlmostEqual(drawn, float(field), delta=0.6 * 10 ** (1 - digits) * abs(float(field)))

    def test_residuals(self):
        data = self.calibrated()
        rows, r = rows_of(self.dir, "out", "residuals.csv"), data["residuals"]
        self.assertEqual(len(rows), len(r["x"]))
        for i, row in enumerate(rows):
            self.assertEqual(data["samples"]["id"][r["sample"][i]], row["sample"])
            self.assertEqual(data["names"]["sensors"][r["sensor"][i]], row["sensor"])
            self.assertEqual(data["names"]["targets"][r["target"][i]], row["target"])
            self.assertEqual(r["id"][i], int(row["id"]) if row["id"] else None)
            for key in ("x", "y", "z", "rx", "ry", "rz", "before_x", "before_y", "before_z", "whitened", "measured_1", "measured_2", "measured_3"):
                if key in r:
                    self.close(r[key][i], row[key], 5)
                else:
                    self.assertEqual(row[key], "")

    def test_whitened(self):
        """Their components make up the norm, of every kind of sensor."""
        self.calibrated()
        for row in rows_of(self.dir, "out", "residuals.csv"):
            parts = [float(row["whitened_%d" % k]) for k in range(1, 7) if row["whitened_%d" % k]]
            self.assertIn(len(parts), (2, 3, 6))
            self.assertAlmostEqual(math.hypot(*parts), float(row["whitened"]), delta=1e-4 * float(row["whitened"]) + 1e-9)

    def test_boxes(self):
        """What the URDF draws of a link is a box in the scene; meshes that cannot be read are counted."""
        self.example()
        with open(self.path("robot", "robot.urdf")) as f:
            urdf = re.sub(r"<(visual|collision)>.*?</\1>", "", f.read(), flags=re.S)
        names = re.findall(r'<link name="([^"]+)"', urdf)[:5]
        shapes = ['<box size="0.1 0.2 0.3"/>', '<cylinder radius="0.1" length="0.5"/>', '<mesh filename="a.stl" scale="2 1 1"/>',
                  '<mesh filename="package://robot/a.stl"/>', '<box size="a b c"/>']
        for name, shape in zip(names, shapes):
            drawn = '<visual><origin xyz="1 2 3"/><geometry>%s</geometry></visual>' % shape
            urdf = re.sub(r'<link name="%s"\s*(/>|>)' % re.escape(name),
                          lambda m: '<link name="%s">%s%s' % (name, drawn, "</link>" if m.group(1) == "/>" else ""), urdf, count=1)
        with open(self.path("robot", "robot.urdf"), "w") as f:
            f.write(urdf)
        with open(self.path("robot", "a.stl"), "w") as f:
            f.write("solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0.5 0 0\nvertex 0 0.25 0.125\nendloop\nendfacet\nendsolid a\n")
        self.kincal("calibrate", "robot/rig.yaml", "robot/samples.jsonl", "--out", "out", "--quiet")
        with open(self.path("out", "result.json")) as f:
            scene = json.load(f)["scene"]
        boxes = {link["name"]: link.get("boxes") for link in scene["links"]}
        self.assertEqual([boxes[name] and boxes[name][0]["size"] for name in names], [[0.1, 0.2, 0.3], [0.2, 0.2, 0.5], [1, 0.25, 0.125], None, None])
        self.assertEqual(boxes[names[0]][0]["pose"], [1, 2, 3, 0, 0, 0, 1])
        self.assertEqual(boxes[names[2]][0]["pose"][:3], [1.5, 2.125, 3.0625])
        self.assertEqual(scene["meshes_left_out"], 1)

    def test_many_loops(self):
        """Of so many samples that loops.csv would be the largest file it has every so-manieth, and result.json says which."""
        self.example(samples=64)
        with open(self.path("robot", "samples.jsonl")) as f:
            lines = [json.loads(line) for line in f]
        with open(self.path("robot", "samples.jsonl"), "w") as f:
            for copy in range(4):
                for sample in lines:
                    f.write(json.dumps({**sample, "id": "%s_%d" % (sample["id"], copy)}) + "\n")
        self.kincal("calibrate", "robot/rig.yaml", "robot/samples.jsonl", "--out", "out", "--quiet", code=None)
        with open(self.path("out", "result.json")) as f:
            result = json.load(f)
        every = result["loops_csv"]["every"]
        self.assertEqual(every, 3)                  # the least odd number
        order = {row["sample"]: i for i, row in enumerate(rows_of(self.dir, "out", "samples.csv"))}
        rows = rows_of(self.dir, "out", "loops.csv")
        self.assertLess(len(rows), 100000)
        self.assertEqual({order[row["sample"]] % every for row in rows}, {0})
        drawn = data_of(self.path("out", "report.html"))["loops"]
        self.assertEqual(drawn["every"] % every, 0)
        self.assertEqual({s % drawn["every"] for s in drawn["sample"]}, {0})
        self.assertGreater(sum(l["points"] for l in result["loops"]), 2 * len(rows))

    def test_samples(self):
        data = self.calibrated()
        rows, s = rows_of(self.dir, "out", "samples.csv"), data["samples"]
        self.assertEqual(s["id"], [row["sample"] for row in rows])
        self.assertEqual(s["train"], [int(row["split"] == "train") for row in rows])
        self.assertEqual(sum(s["train"]), len(rows) - 1)
        for i, row in enumerate(rows):
            for kind, group in (("reading", "joints"), ("error", "errors")):
                self.assertEqual({kind + "/" + name for name in s[group]}, {name for name in row if name.startswith(kind + "/")})
                for name, values in s[group].items():
                    self.close(values[i], row[kind + "/" + name], 7)
            for name, poses in s["targets"].items():
                fields = [row["target/%s/%s" % (name, n)] for n in ("x", "y", "z", "qx", "qy", "qz", "qw")]
                if poses[i] is None:
                    self.assertEqual(set(fields), {""})
                else:
                    for drawn, field in zip(poses[i], fields):
                        self.close(drawn, field, 7)

    def test_loops_and_correlations(self):
        data = self.calibrated()
        rows, l = rows_of(self.dir, "out", "loops.csv"), data["loops"]
        order = {name: i for i, name in enumerate(data["samples"]["id"])}
        rows = [row for row in rows if order[row["sample"]] % l["every"] == 0]
        self.assertEqual(len(rows), len(l["x"]))
        for i, row in enumerate(rows):
            self.assertEqual((data["names"]["sensors"][l["from"][i]], data["names"]["sensors"][l["to"][i]]), (row["from"], row["to"]))
            for key in ("before_x", "before_y", "x", "y"):
                self.close(l[key][i], row[key], 6)
        with open(self.path("out", "covariance.csv"), newline="") as f:
            table = list(csv.reader(f))
        c = data["covariance"]
        self.assertEqual(c["names"], table[0])
        for i, row in enumerate(c["correlation"]):
            self.assertEqual(len(row), i + 1)
            for j, drawn in enumerate(row):
                if table[i + 1][j] == "":
                    self.assertIsNone(drawn)
                else:
                    value = float(table[i + 1][j]) / math.sqrt(float(table[i + 1][i]) * float(table[j + 1][j]))
                    self.assertAlmostEqual(drawn, 1000 * value, delta=0.51)

    def test_result(self):
        """result.json stands in it, but for the samples; serial and time are the rig's."""
        data = self.calibrated()
        with open(self.path("out", "result.json")) as f:
            result = json.load(f)
        del result["samples"]
        self.assertEqual(data["result"], result)
        self.assertEqual((result["serial"], result["time"], data["title"]), ("A-17 <7>", "2026-03-01", "pr2_like"))
        scene = result["scene"]
        for i, link in enumerate(scene["links"]):
            self.assertLess(link["parent"], i)
        self.assertEqual([s["name"] for s in scene["sensors"]], [s for s in result["sensors"]])

    def test_hostile_names(self):
        data = self.calibrated(rename=("wide_left", HOSTILE))
        self.assertIn(HOSTILE, data["names"]["sensors"])
        with open(self.path("out", "report.html")) as f:
            page = f.read()
        self.assertNotIn(HOSTILE[:8], page)         # as \\u003c only
        self.assertEqual(page.count("</script>"), page.count("<script"))

    def test_no_report(self):
        self.example()
        self.kincal("calibrate", "robot/rig.yaml", "robot/samples.jsonl", "--out", "out", "--quiet", "--no-report")
        self.assertFalse(os.path.exists(self.path("out", "report.html")))
        self.kincal("report", "out")                # from what there is
        data = data_of(self.path("out", "report.html"))
        self.assertEqual(({len(column) for key, column in data["residuals"].items() if key != "every"}, data["loops"]), ({0}, None))
        self.assertEqual(len(data["samples"]["id"]), 32)


class Command(Case):
    def test_again(self):
        self.calibrated()
        with open(self.path("out", "report.html"), "rb") as f:
            page = f.read()
        os.remove(self.path("out", "report.html"))
        self.assertIn("Written to out/report.html", self.kincal("report", "out"))
        with open(self.path("out", "report.html"), "rb") as f:
            self.assertEqual(f.read(), page)
        self.kincal("report", "out")                # its own file it replaces
        self.kincal("report", "out", "--out", "page.html")
        self.assertIn("exists", self.kincal("report", "out", "--out", "page.html", code=1))
        self.kincal("report", "out", "--out", "page.html", "--force")
        self.kincal("calibrate", "robot/rig.yaml", "robot/samples.jsonl", "--out", "out", "--quiet", "--force")   # the page is no stranger's file

    def test_wrong(self):
        self.calibrated()
        self.assertRegex(self.kincal("report", "nowhere", code=1), "nowhere/result.json: cannot be read")
        self.assertRegex(self.kincal("report", "out", "out", code=1), "need --out FILE")
        with open(self.path("out", "result.json"), "w") as f:
            f.write("[1, 2")
        self.assertRegex(self.kincal("report", "out", code=1), "result.json: this is not a result.json of kincal")

    def test_tampered(self):
        """Files that somebody changed are named, whatever is missing in them."""
        self.calibrated()
        os.mkdir(self.path("bad"))
        for result in ('{"sensors": {"a": {}}}', '{"sensors": [1]}', '{"sensors": {"a": {"test": {"points": 0}, "train": {}, "unit": "m"}}}',
                       '{"sensors": {}, "parameters": {"p": {"value": [1], "sigma": [1], "initial": [], "unit": []}}}', '{"scene": 1}'):
            with open(self.path("bad", "result.json"), "w") as f:
                f.write(result)
            self.assertRegex(self.kincal("report", "out", "bad", "--out", "both.html", "--force", code=1 if "scene" not in result else None), "both.html|bad/result.json: this is no")
            self.assertRegex(self.kincal("show", "bad", code=1), "bad/result.json")
        for name in ("samples.csv", "residuals.csv", "loops.csv", "covariance.csv"):
            with open(self.path("out", name)) as f:
                text = f.read()
            with open(self.path("out", name), "w") as f:
                f.write(text + "one\n")
            self.assertRegex(self.kincal("report", "out", code=1), name + ": a row has 1 field")
            with open(self.path("out", name), "w") as f:
                f.write(text)

    def test_overview(self):
        self.calibrated(out="first")
        self.kincal("calibrate", "robot/rig.yaml", "robot/samples.jsonl", "--out", "second", "--quiet", "--no-report")
        os.mkdir(self.path("pages"))
        self.kincal("report", "first", "second", "--out", "pages/both.html")
        first, second = data_of(self.path("pages", "both.html"))["overview"]
        with open(self.path("first", "result.json")) as f:
            result = json.load(f)
        self.assertEqual((first["folder"], first["title"], first["serial"], first["verdict"]), ("first", "pr2_like", "A-17 <7>", result["verdict"]))
        self.assertAlmostEqual(first["chi2_dof"], result["chi2_data"] / result["dof_data"], places=12)
        self.assertEqual(first["link"], "../first/report.html")
        self.assertIsNone(second["link"])
        changes = {name: max(abs(v - i) for v, i, s in zip(p["value"], p["initial"], p["sigma"]) if s) for name, p in result["parameters"].items() if any(p["sigma"])}
        self.assertEqual(first["largest_change"]["parameter"], max(changes, key=changes.get))
        largest = first["largest_change"]["parameter"]
        # A pose that the rig leaves open did not change, however far it is from where its search began.
        result["parameters"]["sensor/forearm_left/pose"] = {"unit": ["m"] * 3 + ["rad"] * 3, "initial": [0] * 6, "value": [9] * 6, "sigma": [1] * 6, "step": "all"}
        next(s for s in result["scene"]["sensors"] if s["name"] == "forearm_left")["before"] = None
        os.mkdir(self.path("open"))
        with open(self.path("open", "result.json"), "w") as f:
            json.dump(result, f)
        self.kincal("report", "first", "open", "--out", "open.html")
        self.assertEqual([e["largest_change"]["parameter"] for e in data_of(self.path("open.html"))["overview"]], [largest, largest])
        for name, sensor in result["sensors"].items():
            split = "test" if sensor["test"]["points"] else "train"
            self.assertEqual(first["sensors"][name], {"unit": sensor["unit"], "before": sensor[split]["rms_before"], "after": sensor[split]["rms_as_read"], "from": split})

    def test_batch(self):
        for name in ("arm_1", "arm_2"):
            self.example(folder=os.path.join("fleet", name))
        self.example(folder=os.path.join("fleet", "broken"))
        with open(self.path("fleet", "broken", "samples.jsonl"), "a") as f:
            f.write("{<b>\n")
        self.assertIn("report.html shows all sets", self.kincal("batch", "fleet", "--out", "out", code=1))
        entries = {e["folder"]: e for e in data_of(self.path("out", "report.html"))["overview"]}
        self.assertEqual(set(entries), {"arm_1", "arm_2", "broken"})
        self.assertTrue(os.path.exists(self.path("out", entries["arm_1"]["link"])))
        self.assertEqual((entries["broken"]["status"], entries["broken"]["link"]), ("failed", None))
        self.assertRegex(entries["broken"]["verdict"]["text"], r"samples\.jsonl:33")
        self.kincal("batch", "fleet", "--out", "bare", "--no-report", "--quiet", code=1)
        self.assertFalse(os.path.exists(self.path("bare", "report.html")))


class Inputs(Case):
    """Pages of evaluate and check, which leave no folder."""

    def test_evaluate(self):
        """Every residual in it adds up to the printed figures; the folder of the result gets nothing."""
        self.calibrated()
        before = sorted(os.listdir(self.path("out")))
        printed = json.loads(self.kincal("evaluate", "out", "robot/samples.jsonl", "--json", "--report", "page.html"))
        self.assertEqual(sorted(os.listdir(self.path("out"))), before)
        data = data_of(self.path("page.html"))
        result, r = data["result"], data["residuals"]
        self.assertEqual((result["kind"], result["serial"], data["title"]), ("evaluation", "A-17 <7>", "pr2_like"))
        self.assertIn("evaluate out robot/samples.jsonl", result["input"]["command"])
        for key in ("chi2", "dof", "sensors", "warnings"):
            self.assertEqual(result[key], printed[key])
        for name, sensor in printed["sensors"].items():
            for split, train in (("train", 1), ("test", 0)):
                rows = [i for i, s in enumerate(r["sensor"]) if data["names"]["sensors"][s] == name and data["samples"]["train"][r["sample"][i]] == train]
                self.assertEqual(len(rows), sensor[split]["points"])
                if rows:
                    squares = sum((r[c][i] or 0) ** 2 for i in rows for c in ("x", "y", "z") if c in r)
                    self.assertAlmostEqual(math.sqrt(squares / len(rows)), sensor[split]["rms"], delta=1e-4 * sensor[split]["rms"])
        with open(self.path("robot", "samples.jsonl")) as f:
            self.assertEqual([json.loads(line)["id"] for line in f], data["samples"]["id"])

    def test_check(self):
        """What was found and looked for, the text that is printed, and where each sensor saw something."""
        self.example()
        with open(self.path("robot", "samples.jsonl")) as f:
            samples = [json.loads(line) for line in f]
        self.assertIn("Written to fine.html", self.kincal("check", "robot/rig.yaml", "robot/samples.jsonl", "--report", "fine.html"))
        fine = data_of(self.path("fine.html"))
        self.assertEqual((fine["result"]["kind"], fine["result"]["findings"], fine["result"]["explained"]), ("check", [], True))
        pixels = [z for s in samples for v in s["views"] if v["sensor"] == "wide_left" for z in v["pixels"]]
        index, r = fine["names"]["sensors"].index("wide_left"), fine["residuals"]
        seen = [(u, v) for s, u, v in zip(r["sensor"], r["measured_1"], r["measured_2"]) if s == index]
        self.assertEqual(len(seen), len(pixels))
        for (u, v), z in zip(seen, pixels):
            self.assertAlmostEqual(u, z[0], delta=1e-3)
            self.assertAlmostEqual(v, z[1], delta=1e-3)
        self.assertNotIn("x", r)                    # nothing was predicted
        for sample in samples:
            sample["joints"]["head_pan_joint"] *= -1
        with open(self.path("robot", "samples.jsonl"), "w") as f:
            f.writelines(json.dumps(sample) + "\n" for sample in samples)
        printed = json.loads(self.kincal("check", "robot/rig.yaml", "robot/samples.jsonl", "--json", "--report", "bad.html"))
        bad = data_of(self.path("bad.html"))["result"]
        self.assertEqual([bad[key] for key in ("findings", "tested", "chi2", "dof", "said")], [printed[key] for key in ("findings", "tested", "chi2", "dof", "verdict")])
        self.assertIn("head_pan_joint", bad["findings"][0]["text"])

    def test_files(self):
        """An existing file stays, before any work is done; without --report nothing is written."""
        self.example()
        with open(self.path("page.html"), "w") as f:
            f.write("mine")
        for command in ("evaluate", "check"):
            self.assertIn("page.html", self.kincal(command, "nowhere.yaml", "robot/samples.jsonl", "--report", "page.html", code=1))
            with open(self.path("page.html")) as f:
                self.assertEqual(f.read(), "mine")
            self.kincal(command, "robot/rig.yaml", "robot/samples.jsonl", "--force", code=1)       # of what?
        self.kincal("evaluate", "robot/rig.yaml", "robot/samples.jsonl", "--report", "page.html", "--force")
        self.assertEqual(data_of(self.path("page.html"))["result"]["kind"], "evaluation")
        self.assertEqual(sorted(os.listdir(self.dir)), ["page.html", "robot"])


class Show(Case):
    def test_show(self):
        """The verdict, every sensor's errors, the largest change: those of result.json, within 80 columns."""
        self.calibrated()
        with open(self.path("out", "result.json")) as f:
            result = json.load(f)
        shown = self.kincal("show", "out")
        self.assertEqual([line for line in shown.split("\n") if len(line) > 80], [])
        self.assertTrue(shown.startswith("%(use)s: %(why)s\nWhat to do: nothing\n\npr2_like, A-17 <7>, 2026-03-01; calibrated " % result["verdict"]), shown)
        self.assertIn("calibrated " + result["input"]["date"], shown)
        for name, sensor in result["sensors"].items():
            split, where = (sensor["test"], "held out") if sensor["test"]["points"] else (sensor["train"], "fit")
            factor = 1e3 if sensor["unit"] == "m" else 1
            line = next(line for line in shown.split("\n") if line.startswith("  " + name + " "))
            self.assertEqual(line.split()[-5 if where == "fit" else -6:][:3], ["%.3g" % (factor * split[key]) for key in ("rms_before", "rms", "rms_as_read")])
            self.assertTrue(line.endswith(where), line)
        largest = max(abs(v - i) for p in result["parameters"].values() for i, v in zip(p["initial"], p["value"]))
        self.assertIn("%.4g" % (1e3 * largest), shown.split("Largest changes")[1].split("\n")[1])
        self.assertIn("More: out/report.html", shown)
        result["parameters"]["sensor/wide_left/distortion"] = {"unit": [""] * 5, "initial": [0] * 5, "value": [0, 0, 9, 0, 0], "sigma": [1] * 5, "step": "all"}
        with open(self.path("lens.json"), "w") as f:
            json.dump(result, f)
        self.assertIn("sensor/wide_left/distortion.p1 ", self.kincal("show", "lens.json"))
        self.assertEqual(self.kincal("show", "out/result.json") + "\nMore: out/report.html (a browser), result.json\n", shown)

    def test_calibrate_prints(self):
        """Verdict, errors, five largest changes, warnings in 80 columns; what options ask for; where the rest is; all of it with --tables."""
        self.example()
        args = ("calibrate", "robot/rig.yaml", "robot/samples.jsonl", "--out", "out", "--force")
        printed = self.kincal(*args)
        with open(self.path("out", "result.json")) as f:
            result = json.load(f)
        self.assertEqual([line for line in printed.split("\n") if len(line) > 80], [])
        self.assertLess(len(printed.split("\n")), 45)
        self.assertTrue(printed.startswith("%(use)s: %(why)s\nWhat to do: nothing\n\n" % result["verdict"]), printed)
        self.assertEqual(len(printed.split("Largest changes")[1].split("\n\n")[0].split("\n")) - 1, 5)
        shown = self.kincal("show", "out")
        for part in printed.split("\n\n")[1:3]:     # as show tells them
            self.assertIn(part, shown)
        left = re.search(r"Not in robot.urdf, which cannot express it: .*?sensor/narrow_right/baseline.* and 2\s+more", printed, re.S)
        self.assertTrue(left, printed)
        self.assertIn("More: out/report.html (a browser), kincal show out, or this with --tables\n", printed)
        self.assertNotIn("report.html", self.kincal(*args, "--no-report"))
        tables = self.kincal(*args, "--tables")
        for heading in ("Residuals (rms)", "Loops (rms", "Parameters that changed most", "Mounts that no joint"):
            self.assertIn("\n" + heading, tables)
            self.assertNotIn(heading, printed)
        asked = self.kincal(*args, "--holdout", "4", "--restarts", "1", "--require", "chi2/dof<2", "--no-report")
        for words in ("held out", "Restarts from other starting values", "chi2/dof<2"):
            self.assertIn(words, asked)

    def test_narrow(self):
        """Names too long for a drawing beside them: the table goes without."""
        self.calibrated(rename=("wide_left", "the_camera_on_the_left_side_of_the_head"))
        for text in (self.kincal("show", "out"), self.kincal("calibrate", "robot/rig.yaml", "robot/samples.jsonl", "--out", "out", "--force")):
            self.assertNotIn("□", text)
            self.assertEqual([line for line in text.split("\n") if len(line) > 80 and not re.match(" +(joint|sensor)/", line)], [])

    def test_wrong(self):
        self.assertRegex(self.kincal("show", "nowhere", code=1), "nowhere: cannot be read")
        with open(self.path("other.json"), "w") as f:
            f.write("{}")
        self.assertRegex(self.kincal("show", "other.json", code=1), r"other.json:1: key 'verdict' is missing")


class Browser(Case):
    """Everything of it in one test: npm's packages are fetched once."""

    def run_there(self, *command):
        done = subprocess.run(command, cwd=self.path("page"), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=280)
        self.assertEqual(done.returncode, 0, " ".join(command) + "\n" + done.stdout.decode()[-3000:])

    def add_curves(self, path):
        """What a result with bending and curves has (curves_test.py, bending_test.py), made by hand; a sigma is unknown."""
        with open(self.path(path)) as f:
            result = json.load(f)
        sample, joint = next(iter(result["samples"])), "head_pan_joint"
        row = {"sensor": "narrow_left", "unit": "px", "points": 40, "blocks": 8, "by": "sample"}
        result["validation"]["stages"] = {"from": "test", "rows": [dict(row, added=[], rms=0.512, ratio=None, ratio_95=None),
                                                                   dict(row, added=["compliance", "curve/" + joint], rms=0.131, ratio=0.256, ratio_95=[0.21, 0.31])]}
        result["bending"] = {"sensor/" + HOSTILE: {"samples": 24, "mean": 0.00123, "largest": 0.00234, "sample": sample}}
        reading = [i / 50 - 2 for i in range(201)]
        result["curves"] = {joint: {"unit": "rad", "rms": 0.0004, "reading": reading, "error": [5e-4 * math.sin(9 * q) for q in reading],
                                    "sigma": [None if q < -1 else 1e-4 + 3e-4 * (q > 1) for q in reading]}}
        result["tried"] = [{"group": "compliance", "gain": 12.3, "outcome": "kept"}, {"group": "loads", "gain": None, "outcome": "no_evidence"}]
        with open(self.path(path), "w") as f:
            json.dump(result, f)

    def test_page(self):
        self.calibrated(rename=("wide_left", HOSTILE))
        self.kincal("report", "out", "out", "--out", "overview.html")
        page = os.path.join(SOURCE_DIR, "io", "report", "page")
        shutil.copytree(page, self.path("page"), ignore=shutil.ignore_patterns("node_modules"))
        fetched = subprocess.run(["npm", "ci", "--no-audit", "--no-fund"], cwd=self.path("page"), stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        if fetched.returncode != 0:
            print("skipped: npm fetches nothing here\n" + fetched.stdout.decode()[-1000:])
            sys.exit(SKIPPED)
        self.run_there("npm", "run", "build")
        with open(os.path.join(page, "built", "report.html"), "rb") as a, open(self.path("page", "built", "report.html"), "rb") as b:
            self.assertTrue(a.read() == b.read(), "io/report/page/built/report.html is not what its sources build: npm run build")
        self.run_there("npm", "test")
        # 1 s is asked of a machine that has nothing else to do; other tests run beside this one.
        self.run_there("node", "tests/browser.mjs", self.path("out", "report.html"), "--within", "3000")
        self.run_there("node", "tests/browser.mjs", self.path("overview.html"), "--within", "3000")
        self.add_curves("out/result.json")
        self.kincal("report", "out", "--out", "curves.html")
        self.run_there("node", "tests/browser.mjs", self.path("curves.html"), "--within", "3000")
        self.kincal("plan", "robot/rig.yaml", "--next", "5", "--candidates", "300", "--out", "postures.jsonl", "--report", "plan.html")
        self.run_there("node", "tests/browser.mjs", self.path("plan.html"), "--within", "3000")
        for command in ("evaluate", "check"):
            self.kincal(command, "robot/rig.yaml", "robot/samples.jsonl", "--report", command + ".html")
            self.run_there("node", "tests/browser.mjs", self.path(command + ".html"), "--within", "3000")


def main():
    global SOURCE_DIR, KINCAL
    SOURCE_DIR, KINCAL = (os.path.abspath(a) for a in sys.argv[1:3])
    if sys.argv[3:] == ["Browser"]:
        missing = [program for program in ("node", "npm", "chromium") if shutil.which(program) is None]
        if missing:
            print("skipped: there is no " + ", ".join(missing))
            sys.exit(SKIPPED)
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=2)


if __name__ == "__main__":
    main()
