"""What rig and samples show by themselves, and words that agree: python3 input_test.py SOURCE_DIR KINCAL [TEST ...]

With the arms of newcomer_test.py: duplicates, points outside of an image, too few data, lengths in millimetres, intrinsics in another order
and the like are named by `calibrate` itself, before and beside any fit, and clean sets have none of these warnings. Errors and what the doctor
says of them do not contradict each other; what is bad beyond any noise is not called a matter of freeing more. What only held-out samples
see, priors without effect, noise that cannot be estimated, losses from a rough start and sizes that came out 1000 times smaller have words.
Not proved: thresholds on other robots.
"""

import copy
import json
import math
import os
import pty
import random
import subprocess
import sys
import unittest

import check_test
import newcomer_test
from newcomer_test import CAMERA, CAMERA_POSES, CAMERA_TRUTH, TRACKER, TRACKER_TRUTH, Case

GIVEN = CAMERA
for old, new in CAMERA_POSES:
    GIVEN = GIVEN.replace(old, new)
KINDS = ("duplicates", "outside_image", "few_data", "implausible", "unused_prior", "rescaled", "never_seen")


class Input(Case):
    def seen(self, rig=GIVEN, truth=None, **options):
        return self.simulate(rig, truth or CAMERA_TRUTH, **dict({"samples": 16}, **options))

    def run_calibrate(self, rig, samples, *options):
        """result.json, if there is one, and all that was printed; any exit code."""
        self.write("case.yaml", rig)
        self.write("samples.jsonl", "".join(json.dumps(s) + "\n" for s in samples))
        p = subprocess.run([newcomer_test.KINCAL, "calibrate", "case.yaml", "samples.jsonl", "--out", "case", "--force", "--no-report", *options],
                           capture_output=True, text=True, cwd=self.dir)
        result = None
        if p.returncode != 1:
            with open(self.path("case", "result.json"), encoding="utf-8") as file:
                result = json.load(file)
        return p.returncode, result, p.stdout + p.stderr

    def one(self, result, kind):
        found = [w for w in result["warnings"] if w["id"] == kind]
        self.assertEqual(len(found), 1, [w["id"] for w in result["warnings"]])
        return found[0]


class Warnings(Input):
    def test_clean_sets_have_none(self):
        for rig, truth in ((GIVEN, CAMERA_TRUTH), (TRACKER, TRACKER_TRUTH)):
            samples = self.simulate(rig, truth, samples=20, out="clean%d" % len(rig))
            code, result, said = self.run_calibrate(rig, samples)
            self.assertEqual(code, 0, said)
            self.assertEqual([w["id"] for w in result["warnings"] if w["id"] in KINDS], [])

    def test_duplicates(self):
        seen = self.seen()
        samples = seen + [dict(seen[3], id="again"), dict(seen[3], id="once more"), dict(seen[5], id="another")]
        _, result, _ = self.run_calibrate(GIVEN, samples)
        warning = self.one(result, "duplicates")
        self.assertEqual(sorted(warning["names"]), sorted(["again", "once more", "another", samples[3]["id"], samples[5]["id"]]))
        for words in ("5 samples", "2 measurements", "'again'", "'once more'"):
            self.assertIn(words, warning["text"])
        verdict = result["verdict"]
        _, result, _ = self.run_calibrate(GIVEN, seen + [dict(s, id="again " + s["id"]) for s in seen])  # so many are a doubt
        self.assertEqual(result["verdict"]["use"], "doubts")
        self.assertIn("leave out all but one of each", result["verdict"]["text"])
        self.assertNotIn("leave out all but one of each", verdict["text"])  # a few change little

    def test_points_outside_of_the_image(self):
        samples = self.seen()
        limits = ([-0.5, 3], [1279.5, 5], [7, 959.5], [7, -0.5])  # the outermost edges are inside
        for k, pixel in enumerate(limits):
            samples[k]["views"][0]["pixels"][0] = pixel
        _, result, _ = self.run_calibrate(GIVEN, samples)
        self.assertNotIn("outside_image", [w["id"] for w in result["warnings"]])
        samples[2]["views"][0]["pixels"][5] = [1279.6, 5]
        samples[4]["views"][0]["pixels"][5] = [40, 1001.5]
        _, result, _ = self.run_calibrate(GIVEN, samples)
        warning = self.one(result, "outside_image")
        self.assertEqual(warning["names"], ["cam"])
        for words in (" 2 of %d points" % sum(len(s["views"][0]["pixels"]) for s in samples), "1280 x 960", "42 px", "(40, 1001.5)", "'%s'" % samples[4]["id"]):
            self.assertIn(words, warning["text"])

    def test_width_and_height_exchanged(self):
        wrong = GIVEN.replace("[1280, 960]", "[960, 1280]")
        _, result, _ = self.run_calibrate(wrong, self.seen(samples=30))
        self.assertIn("if width and height are exchanged", self.one(result, "outside_image")["text"])

    def test_few_data(self):
        samples = self.seen()
        poses = GIVEN + "estimate: [{step: all, free: [sensor/cam/pose, target/board/pose]}]\n"
        for count, few in ((1, True), (2, True), (8, False)):
            _, result, said = self.run_calibrate(poses, samples[:count])
            self.assertEqual("few_data" in [w["id"] for w in result["warnings"]], few, said)
            if few:
                text = self.one(result, "few_data")["text"]
                self.assertIn("%d training sample" % count, text)
                self.assertIn("%d values" % (6 * count), text)
                self.assertIn("12 unknowns", text)

    def implausible(self, rig, samples, *words, name):
        _, result, said = self.run_calibrate(rig, samples)
        if result is None:  # no fit can start: the finding stands in the error
            first = said.split("kincal: error: ")[1].splitlines()[0]
            for word in words:
                self.assertIn(word, first)
            return
        warning = self.one(result, "implausible")
        self.assertIn(name, warning["names"])
        for word in words:
            self.assertIn(word, warning["text"])
        before = [w["id"] for w in result["warnings"]]
        self.assertLessEqual(set(before[:before.index("implausible")]), {"not_converged", "unobservable", "unexplained"})

    def test_sizes_in_millimetres(self):
        self.implausible(GIVEN.replace("square: 0.025", "square: 25"), self.seen(), "metres", "25 m", name="board")

    def test_measured_in_millimetres(self):
        samples = self.simulate(TRACKER, TRACKER_TRUTH)
        for s in samples:
            for v in s["views"]:
                v["points"] = [[1000 * x for x in p] for p in v["points"]]
        self.implausible(TRACKER, samples, "metres", "divided by 1000", name="tracker")

    def test_degrees(self):
        samples = self.seen()
        for s in samples:
            s["joints"] = {n: math.degrees(q) for n, q in s["joints"].items()}
        self.implausible(GIVEN, samples, "radians", "'j2'", name="j2")

    def test_order_of_intrinsics(self):
        samples = self.seen()
        for order, words in (("[1000, 640, 1000, 480]", "fx cx fy cy"), ("[640, 480, 1000, 1000]", "cx cy fx fy")):
            self.implausible(GIVEN.replace("[1000, 1000, 640, 480]", order), samples, words, "[1000, 1000, 640, 480]", name="cam")

    def test_another_resolution(self):
        samples = self.seen(samples=30)
        half = copy.deepcopy(samples)
        for s in half:
            s["views"][0]["pixels"] = [[0.5 * u - 0.25, 0.5 * v - 0.25] for u, v in s["views"][0]["pixels"]]
        self.implausible(GIVEN, half, "upper left quarter", name="cam")
        self.implausible(GIVEN.replace("[1000, 1000, 640, 480]", "[2000, 2000, 1280, 960]"), samples, "an image 2 times as large", name="cam")

    def test_another_image_size(self):
        """Also where it is not twice as large, as long as the intrinsics say where the middle is."""
        samples = self.seen(samples=30)
        larger = GIVEN.replace("[1280, 960]", "[1920, 1280]")
        self.implausible(larger, samples, "upper left 1280 x 960 pixels", "of 1920 x 1280", "correct image_size", name="cam")
        # a chip of that size, whose middle is its own
        _, result, _ = self.run_calibrate(larger.replace("640, 480]", "900, 600]"), samples)
        for w in result["warnings"]:
            self.assertNotIn("upper left", w["text"])

    def test_focal_lengths_in_millimetres(self):
        self.implausible(GIVEN.replace("[1000, 1000,", "[3.6, 3.6,"), self.seen(), "focal lengths", "3.6", "size of a pixel", name="cam")


class Endings(Input):
    STEPS = "estimate:\n  - {step: offsets, free: ['joint/j2/offset', 'joint/j3/offset']}\n  - {step: all, free: [sensor/cam/pose, target/board/pose, 'joint/j2/offset', 'joint/j3/offset']}\n"

    def test_a_start_behind_the_camera_is_no_riddle(self):
        turned = GIVEN.replace("rpy: [-1.5708, 0.02, 1.5908]", "rpy: [-1.5708, 0.02, -1.5508]")
        self.assertNotEqual(turned, GIVEN)
        code, _, said = self.run_calibrate(turned + self.STEPS, self.seen(), "--step", "offsets")
        self.assertEqual(code, 1, said)
        self.assertNotIn("nothing to explain", said)
        self.assertIn("sensor/cam/pose", said)
        self.assertIn("delete them", said)

    def test_the_finding_goes_before_the_error(self):
        given = "pose: {xyz: [2.2, 0.1, 0.5], rpy: [-1.5708, 0.02, 1.5908]}"
        inverse = check_test.pose(check_test.inverse(check_test.frame((2.2, 0.1, 0.5), (-1.5708, 0.02, 1.5908))))
        self.assertIn(given, GIVEN)
        code, _, said = self.run_calibrate(GIVEN.replace(given, "pose: " + json.dumps(inverse)) + self.STEPS, self.seen(), "--step", "offsets")
        self.assertEqual(code, 1, said)
        self.assertTrue(said.split("kincal: error: ")[1].startswith("inverted-pose: "), said)
        self.assertIn("So no calibration can start: ", said)

    def test_findings_stand_first(self):
        """Also of a result that was written."""
        samples = self.seen()
        for s in samples:
            s["joints"]["j3"] = -s["joints"]["j3"]
        code, result, said = self.run_calibrate(GIVEN + self.STEPS, samples)
        self.assertIn(code, (3, 5), said)
        self.assertEqual(result["findings"][0]["id"], "joint-sign")
        self.assertLess(said.index("joint-sign: joint 'j3'"), said.index("Errors, rms"))   # in the verdict, which is the first that is printed
        self.assertEqual(said.count("joint-sign"), 2)   # named in the first line, told in full once
        self.assertEqual(said.count("joint-sign: joint 'j3'"), 1)

    def test_beyond_noise_is_no_matter_of_freeing_more(self):
        samples = self.seen(samples=20)
        joints = [s["joints"] for s in samples]
        random.Random(4).shuffle(joints)
        for s, q in zip(samples, joints):
            s["joints"] = q
        self.write("case.yaml", GIVEN)
        self.write("samples.jsonl", "".join(json.dumps(s) + "\n" for s in samples))
        said = self.kincal("check", "case.yaml", "samples.jsonl")
        self.assertNotIn("run it before", said)
        self.assertIn("look for a mistake before more parameters are estimated", said)
        _, result, said = self.run_calibrate(GIVEN, samples)
        self.assertNotIn("--group", said)

    def test_gross_points_are_no_noise(self):
        samples, rng = self.seen(samples=20), random.Random(8)
        for s in samples:
            for pixel in s["views"][0]["pixels"]:
                if rng.random() < 0.08:
                    pixel[0] += rng.gauss(0, 40)
                    pixel[1] += rng.gauss(0, 40)
        code, result, said = self.run_calibrate(GIVEN, samples)
        self.assertEqual(code, 5, said)
        self.assertIn("A mistake is likelier than an understated noise: outlier-points", result["verdict"]["text"])
        self.assertNotIn("sigma", [f["id"] for f in result.get("findings", [])])

    def test_a_loss_from_a_rough_start(self):
        loss = "estimate:\n  - {step: all, free: [sensor/cam/pose, target/board/pose], loss: {tukey: 2}, priors: {sensor/cam/pose: 0.5}}\n"
        rough = GIVEN.replace("xyz: [2.2, 0.1, 0.5]", "xyz: [2.25, 0.14, 0.45]").replace("rpy: [-1.5708, 0.02, 1.5908]", "rpy: [-1.52, 0.06, 1.64]")
        code, result, said = self.run_calibrate(rough + loss, self.seen(), "--iterations", "3")
        self.assertEqual(code, 3, said)
        self.assertIn("add a step with loss huber or none", self.one(result, "not_converged")["text"])


class Unseen(Input):
    def test_what_only_held_out_samples_see(self):
        rig = TRACKER.replace("sensors:", "  spare: {type: points, points: [[0, 0, 0]], mount: {link: l4}}\n  nowhere: {type: points, points: [[0, 0, 0]], mount: {link: l4}}\nsensors:")
        samples = self.simulate(rig, dict(TRACKER_TRUTH, **{"target/spare/pose": [0.1, 0, 0, 0, 0, 0], "target/nowhere/pose": [0.1, 0, 0, 0, 0, 0]}))
        for i, s in enumerate(samples):
            s["views"] = [v for v in s["views"] if v["target"] != "nowhere" and (i >= 20 or v["target"] != "spare")]
            s["split"] = "test" if i >= 20 else "train"
        for given in (False, True):
            case = rig.replace("mount: {link: l4}", "mount: {link: l4, pose: {xyz: [0.1, 0, 0]}}") if given else rig
            _, result, said = self.run_calibrate(case, samples)
            text = self.one(result, "never_seen")["text"]
            self.assertIn("target/nowhere/pose: no training sample shows", text)
            self.assertIn("target/spare/pose: only held-out samples show", text)
            self.assertIn("for the test it is estimated from them alone", text)
            self.assertEqual("keeps the rig's value" in text, given)

    def test_a_prior_on_what_nothing_sees(self):
        samples = self.simulate(TRACKER, TRACKER_TRUTH)
        rig = TRACKER.replace("sensors:", "  spare: {type: points, points: [[0, 0, 0]], mount: {link: l4}}\nsensors:")
        for name, unused in (("target/spare/pose", True), ("joint/j2/offset", False), ("joint/*/offset", False)):
            _, result, said = self.run_calibrate(rig + "priors: {'%s': 0.05}\n" % name, samples)
            self.assertEqual([w["names"] for w in result["warnings"] if w["id"] == "unused_prior"], [[name]] if unused else [], said)
        # what is held, or belongs to a step that did not run, is another matter
        steps = TRACKER + "estimate:\n  - {step: a, free: ['sensor/tracker/pose', 'target/*/pose.x', 'target/*/pose.y', 'target/*/pose.z']}\n" \
            "  - {step: b, free: ['sensor/tracker/pose', 'joint/j2/offset'], priors: {'joint/j2/offset': 0.05}}\n"
        for options in (("--step", "a"), ("--fix", "joint/j2/offset")):
            _, result, said = self.run_calibrate(steps, samples, *options)
            self.assertEqual([w for w in result["warnings"] if w["id"] == "unused_prior"], [], said)

    def test_noise_that_cannot_be_estimated(self):
        samples = self.seen(samples=6)
        poses = GIVEN + "estimate: [{step: all, free: [sensor/cam/pose, target/board/pose, 'joint/j[2-5]/offset']}]\n"
        _, result, said = self.run_calibrate(poses, samples, "--estimate-noise")
        unknown = [n for n in result["noise_levels"] if n["seen"] is None]
        self.assertTrue(unknown, result["noise_levels"])
        text = self.one(result, "noise")["text"]
        self.assertIn("do not determine the noise of", text)
        self.assertIn(unknown[0]["of"], text)

    def test_a_size_that_came_out_as_another(self):
        rig = GIVEN.replace("square: 0.025", "square: 25") + "estimate: [{step: all, free: [sensor/cam/pose, target/board/pose, target/board/square]}]\n"
        rig = rig.replace(", pose: {xyz: [2.2, 0.1, 0.5], rpy: [-1.5708, 0.02, 1.5908]}", "").replace(", pose: {xyz: [0.05, -0.1, -0.06], rpy: [0.03, 1.5508, 0]}", "")
        code, result, said = self.run_calibrate(rig, self.seen(truth={"joint/j2/offset": 0.0}))
        square = result["parameters"]["target/board/square"]["value"][0]
        self.assertAlmostEqual(abs(square), 0.025, delta=0.001, msg=said)
        warning = self.one(result, "rescaled")
        self.assertEqual(warning["names"], ["target/board/square"])
        self.assertIn("0.001 times", warning["text"])

    def test_a_board_that_is_a_little_larger(self):
        samples = self.seen(samples=25)
        for size, expected in ((0.026, 1), (0.0251, 0)):  # 4 %; 0.4 %, within what a ruler does
            rig = GIVEN.replace("square: 0.025", "square: %g" % size)
            code, result, said = self.run_calibrate(rig, samples)
            self.assertEqual(code, 0, said)
            self.assertAlmostEqual(result["parameters"]["target/board/square"]["value"][0], 0.025, delta=2e-4, msg=said)
            self.assertEqual(len([w for w in result["warnings"] if w["id"] == "rescaled"]), expected, said)


class Quiet(Input):
    def on_terminal(self, *arguments):
        """Standard error of a command that has a terminal there."""
        main, terminal = pty.openpty()
        p = subprocess.Popen([newcomer_test.KINCAL, *arguments], stdout=subprocess.DEVNULL, stderr=terminal, cwd=self.dir)
        os.close(terminal)
        said = b""
        while True:
            try:
                part = os.read(main, 65536)
            except OSError:  # the other end is closed
                break
            if not part:
                break
            said += part
        os.close(main)
        self.assertEqual(p.wait(), 0)
        return said.decode()

    def test_progress(self):
        """Commands that take long say how far they are, and nothing of that with --quiet."""
        samples = [dict(s, id="%d_%s" % (k, s["id"])) for k in range(10) for s in self.simulate(GIVEN, CAMERA_TRUTH, samples=1000, out="sim_%d" % k)]
        self.write("samples.jsonl", "".join(json.dumps(s) + "\n" for s in samples))
        for command, word in ((("evaluate", "rig.yaml", "samples.jsonl"), "evaluating"),
                              (("local", "rig.yaml", "samples.jsonl", "--near", samples[0]["id"], "--within", "3"), "calibrating locally"),
                              (("simulate", "rig.yaml", "--samples", "10000", "--seed", "1", "--force", "--out", "quiet"), "simulating")):
            with self.subTest(command=command[0]):
                self.assertRegex(self.on_terminal(*command), word + r" \d+ %")
                self.assertNotIn(word, self.on_terminal(*command, "--quiet"))


if __name__ == "__main__":
    newcomer_test.SOURCE_DIR, newcomer_test.KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:], verbosity=1)
