#!/usr/bin/env python3
"""Does a newcomer learn what he did wrong? Each mistake of docs/doctor.md, planted alone and two at once.

    benchmarks/mistakes.py                      # examples/pr2
    benchmarks/mistakes.py --data ../shared/data    # real sets as well: aubo-i10's images, ros-industrial-charuco, panda_3
    benchmarks/mistakes.py --set aubo --only resolution --keep build/mistakes   # some of them, with their files

The rig's steps are removed, and the poses of sensors and mounted targets where they can be found from the data: `kincal calibrate`
chooses what to free. (Mistakes of held poses are tried with the rig's poses and one step that frees the targets' and nothing else.) A row
says how it ended, the first finding and the first warning that the clean set does not have, and one of
  first      the first finding is this mistake, and names what is wrong; or there is none, and the first warning is
  named      another finding is
  else       something is said, but not this
  SILENT     exit code 0, no finding, and no warning that the clean set does not have
  (first)    and the like, in brackets: docs/doctor.md says that this set does not show the mistake; it does not count
Pairs: of one of the two. It needs PyYAML.
"""
import argparse
import collections
import copy
import json
import math
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as xml

import yaml

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
SETS = {   # rig, samples, whether poses can be found from the data, what the set does not show (and why: docs/doctor.md)
    # (Of pr2 the forearm's camera has cx where fx is, its board of 4 x 5 with a column less is one of 5 x 4, and a sample has one arm:
    # exchanged readings and cameras lack joints, which is an error on reading.)
    "pr2": ("examples/pr2/rig.yaml", "examples/pr2/samples.jsonl", True,
            ["square 2 %", "rectified", "raw", "order fx cx fy cy", "board-columns -1", "swapped-cameras", "bad-samples",
             "joint-sign + bad-samples", "board-columns +1 + bad-samples", "degrees + bad-samples"]),
    "aubo": ("aubo-i10/rig_images.yaml", "aubo-i10/samples_images.jsonl", True,
             ["numbering all", "rows backwards", "square 2 %", "rectified", "raw"]),
    "charuco": ("ros-industrial-charuco/rig.yaml", "ros-industrial-charuco/samples.jsonl", True,
                ["numbering all", "rows backwards", "square 2 %", "rectified", "raw"]),
    "panda": ("panda-sockets/panda_3/rig.yaml", "panda-sockets/panda_3/samples.jsonl", False, []),
}


# ---- what is planted: a function of a Case; its answer is the words of which one must stand in `where`, None: it does not apply

class Case:
    """A copy of a set, to be spoilt. `held`: with poses, and a step that frees the targets' only."""

    def __init__(self, data, held):
        self.rig = copy.deepcopy(data.posed if held else data.rig)
        self.samples = copy.deepcopy(data.samples)
        self.moving, self.turning = data.moving, data.turning
        self.cameras = [n for n, s in self.rig["sensors"].items() if s["type"] == "camera"]
        self.boards = [n for n, t in self.rig["targets"].items() if "square" in t]
        self.random = random.Random(7)

    def views(self, sensor=None, target=None):
        for s in self.samples:
            for v in s["views"]:
                if sensor in (None, v["sensor"]) and target in (None, v["target"]):
                    yield v

    def numbered(self, target):
        """Views of a target's points that have ids, or could: a chain's have none."""
        return (v for v in self.views(target=target) if any(k in v for k in ("pixels", "points", "rays")))

    def camera(self):
        return self.cameras[-1] if self.cameras else None      # of the example a camera of a forearm, with a lens

    def board(self):
        return self.boards[0] if self.boards else None

    def some(self, count):
        seen = [s for s in self.samples if s["views"]]
        return self.random.sample(seen, count)


def scaled_square(factor):
    def plant(case):
        if not case.board():
            return None
        case.rig["targets"][case.board()]["square"] *= factor
        if "marker" in case.rig["targets"][case.board()]:
            case.rig["targets"][case.board()]["marker"] *= factor
        return [case.board()]
    return plant


def rows_columns(case):
    board = case.rig["targets"].get(case.board())
    if not board or board["rows"] == board["columns"]:
        return None
    board["rows"], board["columns"] = board["columns"], board["rows"]
    return [case.board()]


def other_columns(change):
    """The rig's board has another number of columns, and as many rows as all ids need."""
    def plant(case):
        board = case.rig["targets"].get(case.board())
        if not board:
            return None
        most = max(i for v in case.numbered(case.board()) for i in ids(case, v)) + 1
        for v in case.numbered(case.board()):
            v["ids"] = ids(case, v)
        corners = 1 if board["type"] == "charuco" else 0
        board["columns"] += change
        board["rows"] = corners + -(-most // (board["columns"] - corners))
        return [case.board()]
    return plant


def ids(case, view):
    return view.get("ids") or list(range(len(next((view[k] for k in ("pixels", "points", "rays") if k in view), []))))


def reversed_views(count=None):
    def plant(case):
        views = [v for v in case.views(case.camera()) if "pixels" in v]
        if not views:
            return None
        for v in views if count is None else case.random.sample(views, count):
            board = case.rig["targets"][v["target"]]
            corners = board["type"] == "charuco"
            points = (board["rows"] - corners) * (board["columns"] - corners)
            v["ids"] = [points - 1 - i for i in ids(case, v)]
        return [case.camera(), case.board()]
    return plant


def rows_backwards(case):
    for v in case.views(case.camera()):
        if "pixels" not in v:
            return None
        board = case.rig["targets"][v["target"]]
        columns = board["columns"] - (board["type"] == "charuco")
        v["ids"] = [i - i % columns + columns - 1 - i % columns for i in ids(case, v)]
    return [case.camera(), case.board()] if case.camera() else None


def pixels(change):
    """change(u, v, the camera's rig) of all views of one camera."""
    def plant(case):
        if not case.camera():
            return None
        for v in case.views(case.camera()):
            v["pixels"] = [list(change(u, w, case.rig["sensors"][case.camera()])) for u, w in v["pixels"]]
        return [case.camera()]
    return plant


def resized(factor):
    return pixels(lambda u, v, camera: ((u + 0.5) * factor - 0.5, (v + 0.5) * factor - 0.5))


def intrinsics(change):
    def plant(case):
        if not case.camera():
            return None
        camera = case.rig["sensors"][case.camera()]
        camera["intrinsics"] = change(*camera["intrinsics"])
        return [case.camera()]
    return plant


def normalised(u, v, camera):
    fx, fy, cx, cy = camera["intrinsics"]
    return (u - cx) / fx, (v - cy) / fy


def middle_joint(case):
    """Of those that move much, the middle one."""
    return case.moving[len(case.moving) // 2]


def reading(change, name=middle_joint):
    def plant(case):
        for s in case.samples:
            if name(case) in s["joints"]:
                s["joints"][name(case)] = change(s["joints"][name(case)])
        return [name(case)]
    return plant


def degrees(case):
    for s in case.samples:
        s["joints"] = {n: math.degrees(q) if n in case.turning else q for n, q in s["joints"].items()}
    return case.turning


def exchanged_readings(case):
    chosen = case.some(3)
    joints = [s["joints"] for s in chosen]
    for s, q in zip(chosen, joints[1:] + joints[:1]):
        s["joints"] = q
    return [s["id"] for s in chosen]


def far_points(case):
    chosen = case.some(min(10, len(case.samples) // 2))
    for s in chosen:
        points = [p for v in s["views"] for p in v.get("pixels", [])]
        if not points:
            continue
        p = case.random.choice(points)
        p[0] += case.random.choice((-1, 1)) * case.random.uniform(40, 150)
    return [s["id"] for s in chosen] if case.cameras else None


def twice(case):
    chosen = case.some(2)
    case.samples += [dict(copy.deepcopy(s), id="again_" + s["id"]) for s in chosen]
    return [s["id"] for s in chosen]


def exchanged_links(case):
    if not case.camera():
        return None
    for v in case.views(case.camera()):
        mount = case.rig["targets"][v["target"]]["mount"]
        if isinstance(mount, dict):
            camera = case.rig["sensors"][case.camera()]
            camera["link"], mount["link"] = mount["link"], camera["link"]
            return [case.camera(), v["target"]]
    return None


def exchanged_cameras(case):
    if len(case.cameras) < 2:
        return None
    a, b = case.cameras[-2:]
    for v in case.views():
        v["sensor"] = {a: b, b: a}.get(v["sensor"], v["sensor"])
    return [a, b]


def lens(coefficients):
    """The rig's lens is none although there is one, or one although there is none: both as the images go."""
    def plant(case):
        if not case.camera():
            return None
        camera = case.rig["sensors"][case.camera()]
        had = any(camera.get("distortion", []))
        if had != (coefficients is None):
            return None
        camera["model"], camera["distortion"] = "brown_conrady", coefficients or [0, 0, 0, 0, 0]
        return [case.camera()]
    return plant


def millimetres(case):
    found = None
    for v in case.views():
        for p in v.get("points", []):
            if any(p):
                p[:] = [1000 * x for x in p]
                found = [v["sensor"]]
    for name, t in case.rig["targets"].items():
        if t["type"] == "points":
            t["points"] = [[1000 * x for x in p] for p in t["points"]]
            found = (found or []) + [name]
    return found


def rotation(rpy):
    (a, b, c), (i, j, k) = [[f(x) for x in rpy] for f in (math.cos, math.sin)]
    return [[c * b, c * j * i - k * a, c * j * a + k * i], [k * b, k * j * i + c * a, k * j * a - c * i], [-j, b * i, b * a]]


def of_quaternion(x, y, z, w):
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]


def product(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def rpy_of(r):
    return [math.atan2(r[2][1], r[2][2]), math.asin(max(-1, min(1, -r[2][0]))), math.atan2(r[1][0], r[0][0])]


def turned(rpy):
    """The camera's held pose, turned about its own axes."""
    def plant(case):
        pose = case.rig["sensors"].get(case.camera(), {}).get("pose")
        if not pose or "estimate" not in case.rig:
            return None
        pose["rpy"] = rpy_of(product(rotation(pose["rpy"]), rotation(rpy)))
        return [case.camera()]
    return plant


def inverted(case):
    pose = case.rig["sensors"].get(case.camera(), {}).get("pose")
    if not pose or "estimate" not in case.rig:
        return None
    r = [list(row) for row in zip(*rotation(pose["rpy"]))]
    pose["xyz"] = [-sum(r[i][k] * pose["xyz"][k] for k in range(3)) for i in range(3)]
    pose["rpy"] = rpy_of(r)
    return [case.camera()]


HALF = math.pi / 2
PLANTS = collections.OrderedDict([     # name: ids that name it, what plants it
    ("square mm", (["square"], scaled_square(1000))),
    ("square 7 %", (["square"], scaled_square(1.07))),
    ("square 2 %", (["square"], scaled_square(1.02))),
    ("points mm", (["square"], millimetres)),
    ("rows-columns", (["rows-columns"], rows_columns)),
    ("board-columns +1", (["board-columns"], other_columns(1))),
    ("board-columns -1", (["board-columns"], other_columns(-1))),
    ("numbering all", (["numbering"], reversed_views())),
    ("numbering 2", (["numbering"], reversed_views(2))),
    ("rows backwards", (["mirrored"], rows_backwards)),
    ("mirrored u", (["mirrored"], pixels(lambda u, v, c: (c["image_size"][0] - 1 - u, v)))),
    ("mirrored v", (["mirrored"], pixels(lambda u, v, c: (u, c["image_size"][1] - 1 - v)))),
    ("exchanged-axes", (["exchanged-axes"], pixels(lambda u, v, c: (v, u)))),
    ("resolution half", (["resolution"], resized(0.5))),
    ("resolution double", (["resolution"], resized(2))),
    ("resolution 2/3", (["resolution"], resized(2 / 3))),
    ("resolution cropped", (["resolution"], pixels(lambda u, v, c: (u - 0.12 * c["image_size"][0], v - 0.1 * c["image_size"][1])))),
    ("order fx cx fy cy", (["intrinsics"], intrinsics(lambda fx, fy, cx, cy: [fx, cx, fy, cy]))),
    ("order cx cy fx fy", (["intrinsics"], intrinsics(lambda fx, fy, cx, cy: [cx, cy, fx, fy]))),
    ("order fx fy cy cx", (["intrinsics"], intrinsics(lambda fx, fy, cx, cy: [fx, fy, cy, cx]))),
    ("normalised views", (["normalised"], pixels(normalised))),
    ("normalised rig", (["normalised"], intrinsics(lambda *k: [1, 1, 0, 0]))),
    ("rectified", (["rectified"], lens([-0.2, 0, 0, 0, 0]))),
    ("raw", (["rectified"], lens(None))),
    ("joint-sign", (["joint-sign"], reading(lambda q: -q))),
    ("joint-sign first", (["joint-sign"], reading(lambda q: -q, lambda case: case.moving[1]))),
    ("degrees", (["degrees"], degrees)),
    ("still-joint", (["still-joint"], reading(lambda q: 0.1))),
    ("eye-in-hand", (["eye-in-hand"], exchanged_links)),
    ("swapped-cameras", (["swapped-cameras"], exchanged_cameras)),
    ("duplicates", (["duplicates"], twice)),
    ("bad-samples", (["bad-samples"], exchanged_readings)),
    ("outlier-points", (["outlier-points"], far_points)),
])
HELD = collections.OrderedDict([
    ("inverted-pose", (["inverted-pose"], inverted)),
    ("turned-pose x 180", (["turned-pose"], turned([math.pi, 0, 0]))),
    ("turned-pose z 90", (["turned-pose"], turned([0, 0, HALF]))),
    ("turned-pose optical", (["turned-pose"], turned([-HALF, 0, -HALF]))),
])
PAIRS = [("square mm", "joint-sign"), ("rows-columns", "degrees"), ("joint-sign", "joint-sign first"), ("joint-sign", "bad-samples"),
         ("exchanged-axes", "square 7 %"), ("resolution half", "joint-sign"), ("mirrored u", "degrees"), ("outlier-points", "square 7 %"),
         ("order fx cx fy cy", "rows-columns"), ("board-columns +1", "bad-samples"), ("resolution double", "outlier-points"),
         ("degrees", "outlier-points"), ("still-joint", "square mm"), ("points mm", "joint-sign"), ("degrees", "bad-samples")]


# ---- sets and runs

class Data:
    def __init__(self, name, folder):
        rig, samples, found, self.unseen = SETS[name]
        base = ROOT if name == "pr2" else folder
        self.name = name
        with open(os.path.join(base, rig), encoding="utf-8") as f:
            self.posed = yaml.safe_load(f)
        with open(os.path.join(base, samples), encoding="utf-8") as f:
            self.samples = [json.loads(line) for line in f if line.strip()]
        self.posed["robot"] = os.path.join(base, os.path.dirname(rig), self.posed["robot"])
        self.posed.pop("estimate", None)
        self.rig = copy.deepcopy(self.posed)
        if found:
            for sensor in self.rig["sensors"].values():
                sensor.pop("pose", None)
            for target in self.rig["targets"].values():
                if isinstance(target["mount"], dict):
                    target["mount"].pop("pose", None)
        mounted = [t for t in self.posed["targets"].values() if isinstance(t["mount"], dict)]
        if found and mounted:
            self.posed["estimate"] = [{"step": "targets", "free": ["target/*/pose"]}]
        ranges = collections.defaultdict(list)
        for s in self.samples:
            for joint, q in s["joints"].items():
                ranges[joint].append(q)
        self.moving = [j for j, q in ranges.items() if max(q) - min(q) > 0.2]
        self.turning = [j.get("name") for j in xml.parse(self.rig["robot"]).getroot().iter("joint") if j.get("type") in ("revolute", "continuous")]

    def take_poses(self, result):
        """Those that are held are known: what the clean set's calibration found, lenses too."""
        with open(os.path.join(result, "rig.yaml"), encoding="utf-8") as f:
            found = yaml.safe_load(f)
        if "estimate" not in self.posed:
            return
        found["robot"] = os.path.join(result, found["robot"])
        found["estimate"] = self.posed["estimate"]
        for key in ("priors", "nominal"):
            found.pop(key, None)
        for part in list(found["sensors"].values()) + [t["mount"] for t in found["targets"].values() if isinstance(t["mount"], dict)]:
            if "quat" in part.get("pose", {}):
                part["pose"]["rpy"] = rpy_of(of_quaternion(*part["pose"].pop("quat")))
        self.posed = found


def calibrate(program, folder, rig, samples):
    """Exit code, ids and places of findings, ids of warnings, what an error says."""
    os.makedirs(folder)
    with open(os.path.join(folder, "rig.yaml"), "w", encoding="utf-8") as f:
        yaml.safe_dump(rig, f, sort_keys=False)
    with open(os.path.join(folder, "samples.jsonl"), "w", encoding="utf-8") as f:
        f.writelines(json.dumps(s) + "\n" for s in samples)
    run = subprocess.run([program, "calibrate", os.path.join(folder, "rig.yaml"), os.path.join(folder, "samples.jsonl"), "--out",
                          os.path.join(folder, "out"), "--json", "--no-report"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    result, error = {}, run.stderr.decode()
    try:
        result = json.loads(run.stdout.decode())
    except ValueError:      # an error: findings follow it as text
        pass
    findings = [(f["id"], f["where"]) for f in result.get("findings", [])]
    if not findings and run.returncode == 1:
        findings = [(f.group(1), re.findall(r"'([^']+)'", f.group(2))) for f in re.finditer(r"(?m)^([a-z-]+): (.*)$", error) if f.group(1) != "kincal"]
    warnings = [w["id"] for w in result.get("warnings", [])]
    return run.returncode, findings, warnings, error.strip().split("\n")[0]


def judge(code, findings, warnings, wanted, clean_warnings):
    """`wanted`: (ids, words of which one must stand in `where`), of each mistake."""
    right = [any(i in ids and set(words) & set(where) for ids, words in wanted) for i, where in findings]
    if right and right[0]:
        return "first"
    if any(right):
        return "named"
    new = [w for w in warnings if w not in clean_warnings]
    if not findings and new and any(new[0] in ids for ids, _ in wanted):    # said without the doctor: duplicates
        return "first"
    return "else" if code or findings or set(warnings) - set(clean_warnings) else "SILENT"


def by_evidence(program, folder, wanted):
    """What the log odds of all that `check` tries say (above ln 99, else nothing): the likeliest, the next, and the verdict on that."""
    run = subprocess.run([program, "check", os.path.join(folder, "rig.yaml"), os.path.join(folder, "samples.jsonl"), "--json", "--compare", "--quiet"],
                         stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    try:
        tried = [a for a in json.loads(run.stdout.decode())["alternatives"] if a["log_odds"] is not None]
    except ValueError:
        return "-", "no answer"
    said = "; ".join("%s %s %.0f" % (a["id"], ",".join(a["where"][:2]), a["log_odds"]) for a in tried[:2])
    found = [a for a in tried if a["log_odds"] > math.log(99)]
    right = [any(a["id"] in ids and set(words) & set(a["where"]) for ids, words in wanted) for a in found]
    return said or "-", "nothing" if not right else "first" if right[0] else "named" if any(right) else "else"


def report(name, code, findings, warnings, error, clean_warnings, verdict):
    new = [w for w in warnings if w not in clean_warnings]
    said = "; ".join("%s %s" % (i, ",".join(where[:3])) for i, where in findings[:2])
    if not said and code == 1:
        said = error[-90:]
    print("| %-42s | %d | %-60s | %-16s | %s |" % (name, code, said or "-", new[0] if new else "-", verdict), flush=True)


def run_set(data, program, folder, only, no_pairs, compare):
    """A row for each mistake; returns how often each verdict was, of single mistakes and of pairs."""
    def beside(place, wanted, verdict):
        if not compare:
            return
        said, other = by_evidence(program, place, wanted)
        counts["evidence"][verdict, other] += 1
        print("|   by evidence | | %s | | %s |" % (said, other), flush=True)

    print("\n%s: %d samples\n| mistake | exit | first findings | first warning | verdict |\n| --- | --- | --- | --- | --- |"
          % (data.name, len(data.samples)))
    counts = {"single": collections.Counter(), "pairs": collections.Counter(), "clean": collections.Counter(), "evidence": collections.Counter()}
    code, findings, clean_warnings, error = calibrate(program, os.path.join(folder, data.name + "_clean"), data.rig, data.samples)
    clean = "no finding" if not findings and code in (0, 2) else "FALSE ALARM"
    data.take_poses(os.path.join(folder, data.name + "_clean", "out"))
    report("(clean)", code, findings, clean_warnings, error, [], clean)
    counts["clean"][clean] += 1
    beside(os.path.join(folder, data.name + "_clean"), [], clean)
    plants = [(name, [plant], False) for name, plant in PLANTS.items()] + [(name, [plant], True) for name, plant in HELD.items()]
    plants += [(a + " + " + b, [PLANTS[a], PLANTS[b]], False) for a, b in ([] if no_pairs else PAIRS)]
    for name, parts, held in plants:
        if only and not any(o in name for o in only):
            continue
        case = Case(data, held)
        if held and "estimate" not in case.rig:
            continue
        words = [plant(case) for _, plant in parts]
        if any(w is None for w in words):
            continue
        place = os.path.join(folder, data.name + "_" + re.sub(r"[^\w+-]", "_", name))
        code, findings, warnings, error = calibrate(program, place, case.rig, case.samples)
        wanted = [(part[0], w) for part, w in zip(parts, words)]
        verdict = judge(code, findings, warnings, wanted, clean_warnings)
        if name in data.unseen:
            report(name, code, findings, warnings, error, clean_warnings, "(%s)" % verdict)
            continue
        counts["single" if len(parts) == 1 else "pairs"][verdict] += 1
        report(name, code, findings, warnings, error, clean_warnings, verdict)
        beside(place, wanted, verdict)
    return counts


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default=os.path.join(ROOT, "build", "release", "kincal"))
    parser.add_argument("--data", help="the folder with the real sets; without it only examples/pr2", type=os.path.abspath)
    parser.add_argument("--set", action="append", choices=list(SETS))
    parser.add_argument("--only", action="append", help="mistakes whose name has this; may be repeated")
    parser.add_argument("--no-pairs", action="store_true")
    parser.add_argument("--compare", action="store_true", help="beside the findings what the evidence of all that is tried says: a confusion matrix")
    parser.add_argument("--keep", help="keep the files in this folder")
    options = parser.parse_args()
    folder = options.keep or tempfile.mkdtemp(prefix="kincal_mistakes_")
    total = {"single": collections.Counter(), "pairs": collections.Counter(), "clean": collections.Counter(), "evidence": collections.Counter()}
    try:
        for name in options.set or list(SETS):
            if name != "pr2" and not options.data:
                continue
            for kind, counts in run_set(Data(name, options.data), options.program, folder, options.only, options.no_pairs, options.compare).items():
                total[kind] += counts
    finally:
        if not options.keep:
            shutil.rmtree(folder, ignore_errors=True)
    print()
    for kind, counts in total.items():
        if counts:
            print("%s: %d: %s" % (kind, sum(counts.values()), ", ".join("%s %d" % (k if isinstance(k, str) else " / ".join(k), c) for k, c in sorted(counts.items()))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
