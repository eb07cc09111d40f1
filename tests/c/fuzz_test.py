"""Texts and structs with mistakes for the C interface: python3 fuzz_test.py SOURCE_DIR KINCAL FUZZ_PROGRAM SECONDS [SEED]

Makes the cases of fuzz.c, whose head says what is proved, of the calibrations in tests/fuzz/corpus and of the arm of the examples, and runs it.
"""
import json
import os
import subprocess
import sys
import tempfile

SOURCE_DIR, KINCAL, FUZZ = (os.path.abspath(p) for p in sys.argv[1:4])
CORPUS = os.path.join(SOURCE_DIR, "tests", "fuzz", "corpus")
ARM = os.path.join(SOURCE_DIR, "examples", "arm")


def read(*names):
    with open(os.path.join(*names), encoding="utf-8") as file:
        return file.read()


def write(text, *names):
    with open(os.path.join(*names), "w", encoding="utf-8") as file:
        file.write(text)


def numbers_of(sample, joints, sensors, targets):
    """A sample as fuzz.c reads it."""
    out = [len(joints), *(sample["joints"].get(j, float("nan")) for j in joints), len(sample["views"])]
    for view in sample["views"]:
        out += [sensors.index(view["sensor"]), targets.index(view["target"])]
        if "pose" in view or not set(view) & {"pixels", "points", "rays"}:
            z = [*view["pose"]["xyz"], *view["pose"]["quat"]] if "pose" in view else []
            out += [0, len(z), *z]
            continue
        z = next(view[k] for k in ("pixels", "points", "rays") if k in view)
        ids = view.get("ids", list(range(len(z))))
        flat = [n for row in z for n in row]
        out += [len(ids), *ids, len(flat), *flat]
    return " ".join(map(repr, out))


def add_case(folder, number, urdf, rig, samples):
    write(urdf, folder, "%d.urdf" % number)
    write(rig, folder, "%d.yaml" % number)
    write(samples, folder, "%d.jsonl" % number)
    import yaml
    entries = yaml.safe_load(rig)
    joints = [j for j in names_of(urdf)]
    lines = [numbers_of(json.loads(line), joints, list(entries["sensors"]), list(entries["targets"])) for line in samples.splitlines() if line.strip()]
    write("\n".join(lines) + "\n", folder, "%d.txt" % number)


def names_of(urdf):
    """Joints with a reading, in the order of the URDF."""
    import xml.etree.ElementTree as ElementTree
    return [j.get("name") for j in ElementTree.fromstring(urdf).iter("joint")
            if j.get("type") in ("revolute", "continuous", "prismatic") and j.find("mimic") is None]


def main():
    try:
        import yaml  # noqa: F401
    except ImportError:
        print("no yaml")
        sys.exit(77)
    with tempfile.TemporaryDirectory(prefix="kincal_fuzz_") as folder:
        urdf = read(CORPUS, "urdf", "robot.urdf")
        for number, name in enumerate(sorted(os.listdir(os.path.join(CORPUS, "calibration")))):
            rig, samples = read(CORPUS, "calibration", name).split("---\n", 1)
            add_case(folder, number, urdf, rig, samples)
        subprocess.run([KINCAL, "simulate", os.path.join(ARM, "rig.yaml"), "--samples", "10", "--seed", "5", "--truth", os.path.join(ARM, "truth.json"),
                        "--postures", os.path.join(ARM, "postures.jsonl"), "--out", os.path.join(folder, "made"), "--quiet"], check=True)
        rig = read(ARM, "rig.yaml") + "\nestimate:\n  - {step: one, free: [joint/bend/offset, sensor/camera/pose, target/board/pose]}\n"
        add_case(folder, number + 1, read(ARM, "robot.urdf"), rig, read(folder, "made", "samples.jsonl"))
        done = subprocess.run([FUZZ, folder, *sys.argv[4:]], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
        print(done.stdout)
        if done.returncode != 0:
            print("ended with %d in round %s" % (done.returncode, read(folder, "last-round")))
            sys.exit(1)


if __name__ == "__main__":
    main()
