"""From a simulated recording to a calibrated robot: python3 recordings_test.py SOURCE_DIR KINCAL [TEST ...]

Proves: `simulate --bag` -> `import` -> `calibrate` gives the truth within the stated covariance (e' C^-1 e in its 99.9 % interval), for an arm with one camera
(MCAP) and for a robot like the PR2, with boards in two hands (ROS 1; with KINCAL_SLOW); the offset in time is found within three sigmas and 1 ms, and no clock is called
unsteady; threads do not change the samples; `--list`, `--record-command`, `--images` and wrong use are said; nothing is written where no target is seen. Not proved: real
recordings. Ten seeds of each are in benchmarks/recordings.py, whose robots these are.
"""
import importlib.util
import json
import os
import subprocess
import sys
import unittest

import helpers

SOURCE_DIR = KINCAL = None


def benchmark():
    spec = importlib.util.spec_from_file_location("recordings", os.path.join(SOURCE_DIR, "benchmarks", "recordings.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def built():
    folder = os.path.dirname(KINCAL)
    return all(os.path.exists(os.path.join(folder, name)) for name in ("kincal-bags", "kincal-render"))


class Whole(unittest.TestCase):
    def whole_path(self, robot, seed, ending):
        if not built():
            self.skipTest("kincal-bags or kincal-render is not built")
        r = benchmark().one(KINCAL, robot, seed, ending)
        dof = r["numbers"]
        low, high = [(1 - 2 / (9 * dof) + z * (2 / (9 * dof)) ** 0.5) ** 3 for z in (-3.29, 3.29)]
        self.assertTrue(low < r["nees"] / dof < high, r)
        self.assertTrue(0.8 < r["chi2"] / r["dof"] < 1.25, r)
        self.assertEqual(r["clocks"], 0, r)
        self.assertTrue(r["offsets"], r)
        for offset, sigma in r["offsets"]:
            self.assertLess(abs(offset - r["delay"]), 1, r)
            self.assertLess(abs(offset - r["delay"]), 3 * sigma + 0.01, r)   # printed with two digits
        return r


class Arm(Whole):
    def test_to_the_truth(self):
        self.assertEqual(self.whole_path("arm", 2, ".mcap")["samples"], 16)


class Pr2(Whole):
    def test_to_the_truth(self):
        self.assertEqual(self.whole_path("pr2", 3, ".bag")["samples"], 24)


class Said(helpers.Folder):
    def setUp(self):
        super().setUp()
        if not built():
            self.skipTest("kincal-bags or kincal-render is not built")
        self.module = benchmark()
        self.module.arm(self.dir)

    def run_it(self, *arguments, code=0):
        p = subprocess.run([KINCAL, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, cwd=self.dir)
        self.assertEqual(p.returncode, code, p.stdout + p.stderr)
        return p.stdout, p.stderr

    def test_what_is_said(self):
        self.run_it("simulate", "rig.yaml", "--samples", "4", "--seed", "1", "--truth", "truth_values.json", "--postures", "postures.jsonl", "--out", "sim", "--bag", "a.bag",
                    "--rest", "0.8", "--move", "0.6", "--frame-rate", "5", "--quiet")
        out, _ = self.run_it("import", "a.bag", "--list", "--rig", "rig.yaml")
        self.assertIn("sensor camera: /camera/image_raw (guessed by its frame 'flange', its name, its lens)", out)
        self.assertIn("joints: /joint_states (6 of the robot)", out)
        out, err = self.run_it("import", "a.bag", "--rig", "rig.yaml", "--out", "one.jsonl", "--threads", "1")
        self.assertEqual(err, "")
        self.assertIn("rests of the joints: 4 of 0.5 s at least", out)
        self.assertIn("4 samples", out)
        self.run_it("import", "a.bag", "--rig", "rig.yaml", "--out", "three.jsonl", "--threads", "3")
        self.assertEqual(self.read("one.jsonl"), self.read("three.jsonl"))
        out, _ = self.run_it("import", "a.bag", "--rig", "rig.yaml", "--out", "few.jsonl", "--images", "2", "--no-offsets")
        self.assertIn("camera: 8 images searched; board in 4 rests", out)
        self.assertNotIn("offset in time", out)
        _, err = self.run_it("import", "a.bag", "--rig", "rig.yaml", "--out", "none.jsonl", "--rest", "3", code=1)
        self.assertRegex(err, r"no samples: joint '\w+' is never still for 3 s: it moves by")
        _, err = self.run_it("import", "a.bag", "--rig", "rig.yaml", "--out", "one.jsonl", code=1)
        self.assertIn("--force", err)
        self.write("other.yaml", self.read("rig.yaml").replace("DICT_4X4_50", "DICT_7X7_50"))
        _, err = self.run_it("import", "a.bag", "--rig", "other.yaml", "--out", "none.jsonl", code=1)
        self.assertIn("no target was found in the images of any rest", err)
        self.assertFalse(os.path.exists(os.path.join(self.dir, "none.jsonl")))
        self.write("other.yaml", self.read("rig.yaml").replace("type: camera", "type: camera\n    topic: /eye/image_raw"))
        _, err = self.run_it("import", "a.bag", "--rig", "other.yaml", "--out", "none.jsonl", code=1)
        self.assertIn("its topic '/eye/image_raw' has no images in the recording", err)

    def test_record_command(self):
        out, err = self.run_it("import", "--record-command", "rig.yaml")
        self.assertIn("rosbag record --lz4 -O calibration.bag /joint_states /camera/image_raw /camera/camera_info /robot_description\n", out)
        self.assertIn("ros2 bag record -s mcap -o calibration /joint_states", out)
        self.assertIn("the topic of camera 'camera' is taken to be /camera/image_raw", err)
        self.write("rig.yaml", self.read("rig.yaml").replace("type: camera", "type: camera\n    topic: /hand/image_rect/compressed").replace("joints:\n", "joints:\n  topic: [/a, /b]\n"))
        out, err = self.run_it("import", "--record-command", "rig.yaml")
        self.assertIn(" /a /b /hand/image_rect/compressed /hand/camera_info /robot_description\n", out)
        self.assertEqual(err, "")
        for wrong in (("rig.yaml", "--rest", "1"), ("--record-command", "rig.yaml", "--out", "x")):
            self.run_it("import", *wrong, code=1)


if __name__ == "__main__":
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    if sys.argv[3:] == ["Pr2"] and not os.environ.get("KINCAL_SLOW"):
        print("skipped: it takes a minute and a half; scripts/test-all sets KINCAL_SLOW")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
