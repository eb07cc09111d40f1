"""The built program against an independent implementation: python3 reference_test.py SOURCE_DIR KINCAL SET MODE

SET: pr2-simulated, aubo-i10, or others (the remaining data sets but the large one, with rms tables); MODE: latent, marginal,
point, none. The reference (plain Python with numpy, scipy and yaml; no code in common with the program) and the data are not
part of the repository: they are looked for beside the data at KINCAL_DATA, else at ../shared; without them 77 (skipped).
Proves, for every step: chi2 to 1e-6 relative, degrees of freedom; in the end: parameters to 0.01 sigma, sigmas to 1 %, the same
unobservable, unused and held-out names. It does not prove that both are right.
"""

import json
import os
import subprocess
import sys
import tempfile

OTHERS = [("hrp2-real", "rig.yaml", "samples.jsonl"), ("hrp2-real", "rig_mounted.yaml", "samples_camera_only.jsonl"), ("aubo-i10", "rig_images.yaml", "samples_images.jsonl"),
          ("aubo-i10", "rig_tracker.yaml", "samples_tracker.jsonl"), ("panda-sockets/panda_2", "rig.yaml", "samples.jsonl"), ("panda-sockets/panda_3", "rig.yaml", "samples.jsonl"),
          ("ros-industrial-charuco", "rig.yaml", "samples.jsonl"), ("ros-industrial-positioner", "rig.yaml", "samples.jsonl")]
SETS = {"pr2-simulated": [("pr2-simulated", "rig.yaml", "samples.jsonl")], "aubo-i10": [("aubo-i10", "rig_both.yaml", "samples.jsonl")], "others": OTHERS}


class Comparison:
    def __init__(self, title):
        self.title, self.failures, self.worst = title, [], {}

    def near(self, what, where, mine, reference, tolerance):
        """|mine - reference| in units of the tolerance; remembers the worst."""
        difference = abs(mine - reference) / tolerance if tolerance > 0 else float(mine != reference)
        self.worst[what] = max(self.worst.get(what, (0.0, "")), (difference, where))
        if not difference <= 1:
            self.failures.append("%s %s: %.12g, reference %.12g" % (what, where, mine, reference))

    def equal(self, what, mine, reference):
        if mine != reference:
            self.failures.append("%s: %s, reference %s" % (what, mine, reference))

    def report(self):
        print("%s: %s" % (self.title, "; ".join("%s %.2g of what is allowed (%s)" % (k, v[0], v[1]) for k, v in self.worst.items())))
        for f in self.failures[:20]:
            print("  FAILED " + f)
        if len(self.failures) > 20:
            print("  and %d more" % (len(self.failures) - 20))
        return not self.failures


def compare(title, mine, reference, rms):
    c = Comparison(title)
    judged = mine["status"] == "unexplained" and reference["status"] == "converged"  # the reference does not judge
    c.equal("status", "converged" if judged else mine["status"], reference["status"])
    c.equal("dof", mine["dof"], reference["dof"])
    c.near("chi2", "final", mine["chi2"], reference["chi2"], 1e-6 * reference["chi2"])
    c.near("cost", "final", mine["cost"], reference["cost"], 1e-6 * reference["cost"])
    c.equal("steps", [s["step"] for s in mine["steps"]], [s["step"] for s in reference["steps"]])
    for a, b in zip(mine["steps"], reference["steps"]):
        c.near("chi2", a["step"], a["chi2"], b["chi2"], 1e-6 * b["chi2"])
        for key in ("dof", "status"):
            c.equal(key + " of " + a["step"], a[key], b[key])
        for key in ("unused", "held_out"):
            c.equal(key + " of " + a["step"], sorted(a[key]), sorted(b.get(key, [])))
        c.equal("unobservable of " + a["step"], len(a["unobservable"]), len(b.get("unobservable", [])))
    c.equal("parameters", sorted(mine["parameters"]), sorted(reference["parameters"]))
    for name in sorted(set(mine["parameters"]) & set(reference["parameters"])):
        a, b = mine["parameters"][name], reference["parameters"][name]
        c.equal("step of " + name, a["step"], b["step"])
        c.equal("size of " + name, len(a["value"]), len(b["value"]))
        for i, (x, y, s, t) in enumerate(zip(a["value"], b["value"], a["sigma"], b["sigma"])):
            where = "%s[%d]" % (name, i)
            c.equal("initial of " + where, float(a["initial"][i]), float(b["initial"][i]))
            c.equal("null sigma of " + where, s is None, t is None)
            if s is not None and t is not None:
                c.near("value", where, x, y, max(0.01 * t, 1e-13))
                c.near("sigma", where, s, t, 0.01 * t)
    if rms:
        for name, s in reference["sensors"].items():
            for split in ("train", "test"):
                if split not in s:
                    continue
                for key, y in s[split].items():
                    if y is None or key == "points":
                        c.equal("%s %s %s" % (name, split, key), mine["sensors"][name][split].get(key), y)
                    else:
                        x = mine["sensors"][name][split].get(key)
                        if x is None:
                            c.failures.append("%s %s: no %s" % (name, split, key))
                        else:
                            c.near("rms", "%s %s %s" % (name, split, key), x, y, 1e-4 * y + 1e-12)
    return c.report()


def main():
    if len(sys.argv) != 5 or sys.argv[3] not in SETS:
        sys.exit("usage: reference_test.py SOURCE_DIR KINCAL pr2-simulated|aubo-i10|others latent|marginal|point|none")
    source, kincal, name, mode = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2]), sys.argv[3], sys.argv[4]
    data = os.path.abspath(os.environ.get("KINCAL_DATA") or os.path.join(source, "..", "shared", "data"))
    reference = os.path.join(data, "..", "reference", "kincal_reference.py")
    if not os.path.isdir(data) or not os.path.isfile(reference):
        print("skipped: no data or no reference implementation here")
        sys.exit(77)
    if (name, mode) == ("pr2-simulated", "point") and not os.environ.get("KINCAL_SLOW"):
        print("skipped: the reference takes two minutes; scripts/test-all sets KINCAL_SLOW, and aubo-i10 is compared in this mode")
        sys.exit(77)
    try:
        import numpy, scipy, yaml  # noqa: F401, E401
    except ImportError as error:
        print("skipped: the reference needs numpy, scipy and yaml: %s" % error)
        sys.exit(77)
    environment = dict(os.environ, OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1")
    good = True
    with tempfile.TemporaryDirectory(prefix="kincal_reference_") as work:
        for i, (folder, rig, samples) in enumerate(SETS[name]):
            files = [os.path.join(data, folder, rig), os.path.join(data, folder, samples)]
            rms = name == "others"
            out = os.path.join(work, "%d.json" % i)
            p = subprocess.run([sys.executable, reference, "solve", *files, "--noise", mode, "--out", out] + ([] if rms else ["--no-rms"]), env=environment,
                               stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            if p.returncode not in (0, 2, 3) or not os.path.exists(out):
                sys.exit("the reference failed (%d): %s" % (p.returncode, p.stdout.decode()[-1000:]))
            with open(out) as f:
                theirs = json.load(f)
            q = subprocess.run([kincal, "calibrate", *files, "--noise", mode, "--out", os.path.join(work, "result%d" % i), "--json", "--no-report"], stdout=subprocess.PIPE)
            if q.returncode not in (0, 2, 3, 5):
                sys.exit("kincal failed (%d) on %s" % (q.returncode, folder))
            if q.returncode != p.returncode and (q.returncode, p.returncode) != (5, 0):  # the reference does not judge
                print("exit code %d, the reference's %d" % (q.returncode, p.returncode))
                good = False
            good = compare("%s %s %s" % (folder, rig, mode), json.loads(q.stdout), theirs, rms) and good
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
