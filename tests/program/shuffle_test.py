"""The order of what was measured does not matter: python3 shuffle_test.py SOURCE_DIR KINCAL [GROUP ...]

Samples, the views in them and the points in a view (ids alike) are shuffled, and everything is calibrated again. No estimated number
may move by more than 1e-6 of its sigma, no sigma by more than 1e-6 of itself, no free target or joint error by more than 1e-9 m or rad;
status and degrees of freedom stay. In every noise mode, with losses, and with poses that are to be found from the data. On the example, and on the data sets beside it (KINCAL_DATA, else ../shared/data; what needs them is skipped without, code 77 if that is
all). Proves nothing for directions that the data do not determine (sigma null), and nothing for data where two minima are equally good.
"""

import json
import math
import os
import random
import re
import subprocess
import sys
import tempfile

LIMIT = 1e-6
MODES = ("latent", "marginal", "point", "none")
AUBO = "aubo-i10"

POSE = re.compile(r",? *pose: \{xyz: \[[^\]]*\], rpy: \[[^\]]*\]\}")


def same(text):
    return text


def without_poses(*names):
    """Takes the poses of these sensors and targets out of a rig's text: they are to be found from the data."""

    def change(text):
        lines, inside = [], None
        for line in text.split("\n"):
            name = re.match(r"  (\w+):", line)
            inside = name.group(1) if name else inside
            line = POSE.sub("", line) if inside in names else line
            if line.strip():
                lines.append(line)
        return "\n".join(lines) + "\n"

    return change


def with_loss(kind):
    """A loss for every step."""
    return lambda text: re.sub(r"^(  - step: .*)$", "\\1\n    loss: {%s: 3.0}" % kind, text, flags=re.M)


def groups(source, data):
    """Group: [(title, rig, samples, what is done to the rig's text, number of poses that are to be found from the data)]"""
    pr2, aubo, panda, charuco, positioner, hrp2 = (os.path.join(data, *p.split("/")) for p in ("pr2-simulated", "aubo-i10", "panda-sockets/panda_3", "ros-industrial-charuco", "ros-industrial-positioner", "hrp2-real"))

    def one(title, folder, rig="rig.yaml", samples="samples.jsonl", change=same, absent=0):
        return title, os.path.join(folder, rig), os.path.join(folder, samples), change, absent

    return {
        "Example": [one("example", os.path.join(source, "examples", "pr2"))],
        "Pr2Simulated": [one("pr2-simulated", pr2), one("pr2-simulated, huber", pr2, change=with_loss("huber"))],
        "Aubo": [one("aubo-i10 both", aubo, "rig_both.yaml"), one("aubo-i10 images", aubo, "rig_images.yaml", "samples_images.jsonl"),
                 one("aubo-i10 images, cauchy, four wrong samples", aubo, "rig_images.yaml", "samples_with_bad_group.jsonl", change=with_loss("cauchy"))],
        "AbsentPoses": [one("aubo-i10 both, three poses absent", aubo, "rig_both.yaml", change=without_poses("camera", "board", "tracker"), absent=3),
                        one("ros-industrial-charuco, both poses absent", charuco, change=without_poses("camera", "charuco"), absent=2),
                        one("hrp2-real, hand's board absent", hrp2, change=without_poses("left_arm"), absent=1),
                        one("hrp2-real mounted, board absent", hrp2, "rig_mounted.yaml", "samples_camera_only.jsonl", change=without_poses("board"), absent=1)],
        "Others": [one("panda_3", panda), one("ros-industrial-charuco", charuco), one("ros-industrial-positioner", positioner), one("hrp2-real", hrp2)],
    }


def shuffled(lines, seed):
    """Lines of samples.jsonl in another order, within them views, within these points."""
    rng = random.Random(seed)
    out = []
    for line in lines:
        sample = json.loads(line)
        for view in sample["views"]:
            key = next((k for k in ("pixels", "points", "rays") if k in view), None)
            if key is None:
                continue
            n = len(view[key])
            order = list(range(n))
            rng.shuffle(order)
            ids = view.get("ids", list(range(n)))
            view["ids"] = [ids[i] for i in order]
            view[key] = [view[key][i] for i in order]
            covariance = view.get("covariance")
            if covariance and isinstance(covariance[0][0], list):
                view["covariance"] = [covariance[i] for i in order]
        rng.shuffle(sample["views"])
        out.append(json.dumps(sample))
    rng.shuffle(out)
    return out


def increment(a, b):
    """Of two nearly equal poses {xyz, quat}: translation and rotation of a^-1 b, first order."""
    x, y, z, w = a["quat"]
    p, q = [-x, -y, -z, w], b["quat"]
    if sum(i * j for i, j in zip(a["quat"], q)) < 0:
        q = [-i for i in q]
    turn = [p[3] * q[i] + q[3] * p[i] + p[(i + 1) % 3] * q[(i + 2) % 3] - p[(i + 2) % 3] * q[(i + 1) % 3] for i in range(3)]
    d = [j - i for i, j in zip(a["xyz"], b["xyz"])]
    cross = lambda u, v: [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]  # noqa: E731
    t = [2 * c for c in cross(p[:3], d)]
    moved = [d[i] + w * t[i] + cross(p[:3], t)[i] for i in range(3)]
    return moved + [2 * v for v in turn]


def compare(first, second):
    """(largest change in sigmas, whose), (largest relative change of a sigma, whose), what differs otherwise."""
    moved, wider, other = (0.0, "-"), (0.0, "-"), []
    for sample, a in first["samples"].items():  # without sigmas: m and rad
        b = second["samples"][sample]
        if sorted(a["targets"]) != sorted(b["targets"]) or sorted(a["joint_errors"]) != sorted(b["joint_errors"]):
            other.append("other unknowns of sample " + sample)
            continue
        worst = max([0.0] + [abs(d) for t in a["targets"] for d in increment(a["targets"][t], b["targets"][t])] +
                    [abs(b["joint_errors"][j] - e) for j, e in a["joint_errors"].items()])
        if worst > 1e-9:
            other.append("sample %s moved by %.2g" % (sample, worst))
    for key in ("status", "dof"):
        if first[key] != second[key]:
            other.append("%s %s, %s" % (key, first[key], second[key]))
    if sorted(first["parameters"]) != sorted(second["parameters"]):
        other.append("other parameters")
        return moved, wider, other
    for name, a in first["parameters"].items():
        b = second["parameters"][name]
        if "pose" in a and all(s != 0 for s in a["sigma"]):
            change = increment(a["pose"], b["pose"])
        else:
            change = [y - x for x, y in zip(a["value"], b["value"])]
        for i, (s, t, d) in enumerate(zip(a["sigma"], b["sigma"], change)):
            where = "%s[%d]" % (name, i)
            if (s is None) != (t is None) or (s == 0) != (t == 0):
                other.append("sigma of %s: %s, %s" % (where, s, t))
            elif s:
                moved = max(moved, (abs(d) / s, where))
                wider = max(wider, (abs(t / s - 1), where))
    return moved, wider, other


def run(kincal, rig, samples, work, options):
    out = os.path.join(work, "out")
    p = subprocess.run([kincal, "calibrate", rig, samples, "--out", out, "--force", "--json", "--no-report"] + options, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    if p.returncode not in (0, 2, 5):  # 5: without its poses a set need not be explained
        raise RuntimeError("exit %d: %s" % (p.returncode, p.stderr.decode()[-500:]))
    return json.loads(p.stdout.decode())


def check(kincal, title, rig, samples, change, absent, modes, seeds, work):
    with open(rig, encoding="utf-8") as f:
        original = f.read()
    text = change(original)
    robot = re.search(r"^robot: *(\S+)", text, re.M).group(1)
    text = text.replace("robot: " + robot, "robot: " + os.path.join(os.path.dirname(os.path.abspath(rig)), robot), 1)
    if len(POSE.findall(original)) - len(POSE.findall(text)) != absent:
        raise RuntimeError("%s: %d poses were to be taken out" % (title, absent))
    changed = os.path.join(work, "rig.yaml")
    with open(changed, "w", encoding="utf-8") as f:
        f.write(text)
    with open(samples, encoding="utf-8") as f:
        lines = [line for line in f.read().split("\n") if line.strip()]
    good = True
    for mode in modes:
        first = run(kincal, changed, samples, work, ["--noise", mode])
        for seed in seeds:
            path = os.path.join(work, "shuffled.jsonl")
            with open(path, "w", encoding="utf-8") as f:
                f.write("\n".join(shuffled(lines, seed)) + "\n")
            second = run(kincal, changed, path, work, ["--noise", mode])
            moved, wider, other = compare(first, second)
            fine = moved[0] <= LIMIT and wider[0] <= LIMIT and not other
            good = good and fine
            print("%s %s, seed %d: %.2g sigma (%s), sigmas %.2g (%s), chi2 %.2g%s%s" %
                  ((title, mode, seed) + moved + wider + (abs(second["chi2"] / first["chi2"] - 1), "".join("; " + o for o in other[:5]), "" if fine else "   FAILED")))
    return good


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    source, kincal = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    data = os.path.abspath(os.environ.get("KINCAL_DATA") or os.path.join(source, "..", "shared", "data"))
    all_groups = groups(source, data)
    names = sys.argv[3:] or sorted(all_groups)
    good, ran = True, 0
    with tempfile.TemporaryDirectory(prefix="kincal_shuffle_") as work:
        for name in names:
            for title, rig, samples, change, absent in all_groups[name]:
                if not os.path.isfile(rig):
                    print("skipped: no %s here" % title)
                    continue
                ran += 1
                good = check(kincal, title, rig, samples, change, absent, MODES, (1, 2), work) and good
    sys.exit(1 if not good else 77 if not ran else 0)


if __name__ == "__main__":
    main()
