"""A robot known by the poses of its flange, and what is said of too little motion and of unstated noise: python3 flange_test.py SOURCE_DIR KINCAL [TEST ...]

Makes poses of a flange and what a camera on it reports of a board (poses). Proves: one and two poses, sliding alone and turns about one
axis are told in the words of hand-eye calibration, with what to record, in the warning and in the verdict; noise that nobody stated is
called that, with the entry that states it, which kincal reads; a stated one is compared with what is seen. Not proved: the estimates
(models/calibration/floating_test.cpp).
"""
import json
import os
import re
import subprocess
import sys
import unittest

import numpy as np

import helpers

SOURCE_DIR = KINCAL = None
RIG = """format: kincal/1
robot: {base: base, flange: tool0}
%s
targets:
  board: {type: points, points: [[0, 0, 0]], mount: {link: base}}
sensors:
  cam: {type: pose, link: tool0, sigma: {translation: 0.0005, rotation: 0.001}}
"""


def turned(w):
    angle = np.linalg.norm(w)
    k = np.cross(np.eye(3), np.array(w) / (angle or 1))
    return np.eye(3) - np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def motion(xyz, w):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turned(w), xyz
    return out


def pose(m):
    """xyz and rotation as 'rpy' of Rz Ry Rx."""
    r = m[:3, :3]
    rpy = [np.arctan2(r[2, 1], r[2, 2]), -np.arcsin(r[2, 0]), np.arctan2(r[1, 0], r[0, 0])]
    return {"xyz": [float(v) for v in m[:3, 3]], "rpy": [float(v) for v in rpy]}


X, Y = motion([0.05, -0.03, 0.09], [0.1, -0.05, 1.2]), motion([0.5, 0.1, 0.02], [0.3, 0.2, 0.4])


def samples(count, turns, slides=0.1, noise=3e-4, seed=1):
    """Poses around one, turned by up to `turns` about x, y, z."""
    draws = np.random.RandomState(seed)
    lines = []
    for i in range(count):
        flange = motion([0.4, 0, 0.5], [0.2, 0.4, 0.1]) @ motion(draws.uniform(-slides, slides, 3), draws.uniform(-1, 1, 3) * turns)
        seen = np.linalg.inv(flange @ X) @ Y @ motion(draws.normal(0, 5e-4, 3), draws.normal(0, 1e-3, 3))
        read = flange @ motion(draws.normal(0, noise, 3), draws.normal(0, noise, 3))
        lines.append(json.dumps({"id": "s%d" % i, "joints": {"flange": pose(read)}, "views": [{"sensor": "cam", "target": "board", "pose": pose(seen)}]}) + "\n")
    return "".join(lines)


CAMERA = """format: kincal/1
robot: {base: base, flange: tool0}
%s
targets:
  board: {type: chessboard, rows: 5, columns: 7, square: 0.03, mount: {link: base}}
sensors:
  cam: {type: camera, link: tool0, model: brown_conrady, image_size: [1280, 960], intrinsics: [1280, 1280, 639.5, 479.5], sigma: 0.2}
"""


def pictures(count, focal, seed=1, noise=3e-4, bent=0.0):
    """Corners of a board below the robot, in pixels of a camera that looks down. `bent`: how far its middle stands out, along x."""
    draws = np.random.RandomState(seed)
    mount, board = motion([0.03, -0.02, 0.06], [0, 0, 0.3]), motion([0.4, 0.1, 0], [0, 0, 0.2])
    corners = np.array([[0.03 * (i % 7), 0.03 * (i // 7), bent * (1 - (i % 7 / 3 - 1) ** 2), 1] for i in range(35)]).T
    lines = []
    for i in range(count):
        flange = motion([0.48, 0.15, 0.55], [np.pi, 0, 0]) @ motion(draws.uniform(-0.05, 0.05, 3), draws.uniform(-0.4, 0.4, 3))
        p = np.linalg.inv(flange @ mount) @ board @ corners
        x = p[:2] / p[2]
        pixels = focal * x * (1 - 0.1 * (x ** 2).sum(axis=0)) + np.array([[639.5], [479.5]]) + draws.normal(0, 0.2, (2, 35))
        read = flange @ motion(draws.normal(0, noise, 3), draws.normal(0, noise, 3))
        lines.append({"id": "s%d" % i, "joints": {"flange": pose(read)},
                      "views": [{"sensor": "cam", "target": "board", "ids": list(range(35)), "pixels": pixels.T.tolist()}]})
    return lines


class Flange(helpers.Folder):
    def calibrate(self, text, code, entry="", rig=None):
        self.write("rig.yaml", rig or RIG % entry)
        self.write("samples.jsonl", text)
        done = subprocess.run([KINCAL, "calibrate", "rig.yaml", "samples.jsonl", "--out", "out", "--force"], cwd=self.dir, capture_output=True, text=True)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        result = json.loads(self.read("out", "result.json"))
        return result, {w["id"]: w["text"] for w in result["warnings"]}

    def told(self, text, *words):
        result, _ = self.calibrate(text, 2)
        said = result["verdict"]["text"]
        self.assertEqual(result["verdict"]["use"], "no")
        for word in words:
            self.assertIn(word, said)
        self.assertNotIn("flange.d", said)

    def test_few_poses(self):
        self.told(samples(1, 0.5), "1 pose of the flange ('tool0') is too few", "take at least 3 poses, better 15", "about at least two axes that are not parallel")
        self.told(samples(2, 0.5), "2 poses of the flange ('tool0') are too few")

    def test_sliding(self):
        self.told(samples(15, 0), "the flange ('tool0') hardly turned", "turn it about at least two axes that are not parallel")

    def test_one_axis(self):
        self.told(samples(15, [0, 0, 0.6]), "the flange ('tool0') turned about one axis only", "turn it about at least two axes that are not parallel")

    def test_noise_that_nobody_stated(self):
        result, said = self.calibrate(samples(20, 1.2, 0.3, noise=5e-4), 0)
        self.assertIn("the rig does not state the noise, so it was found from the data: joint/flange translation ", said["noise"])
        found = {level["part"]: level["used"] for level in result["noise_levels"] if level["of"] == "joint/flange"}
        result, said = self.calibrate(samples(20, 1.2, 0.3, noise=5e-4), 0, "joints: {flange: {sigma: {translation: %g, rotation: %g}}}" % (
            found["translation"], found["rotation"]))
        self.assertNotIn("noise", said)

    def test_much_noise_that_nobody_stated(self):
        """Seventeen and three times the noise that is guessed at first, of four points seen to 0.5 mm: no mistake, and nothing is wrong with the sensor."""
        body = np.array([[0, 0, 0, 1], [0.15, 0, 0, 1], [0, 0.2, 0.03, 1], [0.1, 0.1, 0.1, 1]]).T
        rig = (RIG % "").replace("board: {type: points, points: [[0, 0, 0]]", "board: {type: points, points: %s" % body[:3].T.tolist()) \
            .replace("type: pose, link: tool0, sigma: {translation: 0.0005, rotation: 0.001}", "type: point, link: tool0, sigma: 0.0005")
        for seed, noise in ((1, 5e-3), (2, 5e-3), (3, 5e-3), (4, 1e-3), (5, 1e-3)):
            draws = np.random.RandomState(seed)
            text = ""
            for i in range(20):
                flange = motion([0.4, 0, 0.5], [0.2, 0.4, 0.1]) @ motion(draws.uniform(-0.3, 0.3, 3), draws.uniform(-1, 1, 3))
                seen = (np.linalg.inv(flange @ X) @ Y @ body)[:3].T + draws.normal(0, 5e-4, (4, 3))
                read = flange @ motion(draws.normal(0, noise, 3), draws.normal(0, noise, 3))
                text += json.dumps({"id": "s%d" % i, "joints": {"flange": pose(read)},
                                    "views": [{"sensor": "cam", "target": "board", "points": seen.tolist()}]}) + "\n"
            result, said = self.calibrate(text, 0, rig=rig)
            self.assertEqual(result["verdict"]["use"], "good", result["verdict"]["text"])
            self.assertIn("the rig does not state the noise, so it was found from the data: joint/flange translation ", said["noise"])
            levels = {(level["of"], level["part"]): level["used"] for level in result["noise_levels"]}
            for part in ("translation", "rotation") if noise > 2e-3 else ("translation",):  # (less in the turns the points do not show)
                self.assertLess(abs(levels["joint/flange", part] / noise - 1), 0.4)
            self.assertEqual(levels["sensor/cam", ""], 5e-4)

    def test_noise_stated_too_small(self):
        _, said = self.calibrate(samples(20, 0.6, noise=1e-3), 0, "joints: {flange: {sigma: {translation: 0.0001, rotation: 0.0002}}}")
        self.assertIn("with the stated sigmas chi2/dof is", said["noise"])
        self.assertIn("sensor/cam translation: ", said["noise"])
        self.assertIn(", stated 0.0005", said["noise"])
        self.assertNotIn("not stated", said["noise"])

    def test_guessed_lens(self):
        """It takes up what somebody was mistaken about: mistakes are looked for in the rig as it was found."""
        text = "".join(json.dumps(line) + "\n" for line in pictures(15, 1012))
        result, said = self.calibrate(text, 0, rig=CAMERA % "")
        lens = result["parameters"]["sensor/cam/intrinsics"]
        for c in (0, 1):
            self.assertLess(abs(lens["value"][c] - 1012), 4 * lens["sigma"][c])
        self.assertIn("sensor/cam/intrinsics", said["rescaled"])

    def test_lens_of_intrinsics(self):
        """First the lens, then the robot: what the first leaves open of the lens the second knows. From the same pictures no corner counts
        twice; from others the lens is known better than by these alone. Errors of the mount over 24 robots, beside what is predicted of them."""
        entry = "joints: {flange: {sigma: {translation: 0.0001, rotation: 0.0001}}}"
        self.write("rig.yaml", CAMERA % entry)
        errors = {"same.jsonl": [], "other.jsonl": []}
        for seed in range(12):
            for name, first in (("same.jsonl", seed), ("other.jsonl", 100 + seed)):
                self.write(name, "".join(json.dumps(line) + "\n" for line in pictures(15, 1012, first, 1e-4)))
            lens = ["intrinsics", "rig.yaml", "same.jsonl", "--out", "lens", "--force", "--quiet", "--model", "brown_conrady_4"]
            for name, all_errors in errors.items():
                for arguments in (lens, ["calibrate", "lens", name, "--out", "out", "--force", "--quiet"]):
                    done = subprocess.run([KINCAL, *arguments], cwd=self.dir, capture_output=True, text=True)
                    self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
                rows = json.loads(self.read("out", "result.json"))["parameters"]
                self.assertGreater(rows["sensor/cam/intrinsics"]["sigma"][2], 0.1)  # px; never exact
                mount = rows["sensor/cam/pose"]
                found = motion(mount["pose"]["xyz"], [0, 0, 0])
                x, y, z, w = mount["pose"]["quat"]
                found[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                                 [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
                off = np.linalg.inv(found) @ motion([0.03, -0.02, 0.06], [0, 0, 0.3])
                error = np.append(off[:3, 3], [off[2, 1], off[0, 2], off[1, 0]]) / mount["sigma"]
                all_errors.append(np.abs(error))
        for name, all_errors in errors.items():
            self.assertLess(np.max(all_errors), 4, name)
            self.assertTrue(0.7 < np.sqrt(np.mean(np.square(all_errors))) < 1.3, (name, np.sqrt(np.mean(np.square(all_errors)))))

    def test_bent_board(self):
        """Without steps its warp is estimated, though the residuals do not show it; with steps that leave it out it is named. Never of a flat one."""
        rig = CAMERA % "joints: {flange: {sigma: {translation: 0.0001, rotation: 0.0001}}}"
        steps = rig + "estimate:\n  - {step: all, free: [sensor/cam/pose, target/board/pose, sensor/cam/intrinsics, sensor/cam/distortion]}\n"
        for seed in range(10):
            flat, bent = ("".join(json.dumps(line) + "\n" for line in pictures(20, 1280, seed, 1e-4, by)) for by in (0, 1e-3))
            for name, samples in (("flat", flat), ("bent", bent)):
                result, _ = self.calibrate(samples, 0, rig=rig)
                self.assertEqual(result["verdict"]["use"], "good")
                self.assertEqual([t["group"] for t in result["tried"] if t["outcome"] == "kept"], ["warps"] if name == "bent" else [])
                if name == "bent":
                    found = result["parameters"]["target/board/warp"]
                    for value, sigma, true in zip(found["value"], found["sigma"], (1e-3, 0)):
                        self.assertLess(abs(value - true), 4 * sigma)
                        self.assertLess(sigma, 5e-5)
                    for key in ("warp", "print"):  # named by a prior, it is estimated with that
                        prior = rig.replace("square: 0.03,", "square: 0.03, %s: [0, 0]," % key) + "priors: {target/board/%s: 0.001}\n" % key
                        self.assertIn("target/board/" + key, self.calibrate(samples, 0, rig=prior)[0]["parameters"])
                text = self.calibrate(samples, 0, rig=steps)[0]["verdict"]["text"]
                self.assertEqual("target 'board' is not flat" in text, name == "bent", text)
                self.assertEqual('"warp: [0, 0]"' in text, name == "bent", text)

    def test_ids_from_one(self):
        """Of pictures that do not show the last point."""
        self.write("rig.yaml", CAMERA % "")
        for by, words, shown in ((1, "are one too large", range(34)), (-1, "are one too small", range(1, 35))):
            lines = pictures(15, 1280)
            for line in lines:
                view = line["views"][0]
                view["ids"], view["pixels"] = [i + by for i in shown], [view["pixels"][i] for i in shown]
            self.write("samples.jsonl", "".join(json.dumps(line) + "\n" for line in lines))
            done = subprocess.run([KINCAL, "check", "rig.yaml", "samples.jsonl"], cwd=self.dir, capture_output=True, text=True)
            self.assertTrue(done.stdout.startswith("numbering: The ids of the points of target 'board' " + words), done.stdout + done.stderr)

    def test_pictures_of_nothing(self):
        lines = pictures(15, 1280)
        for line in lines:
            line["views"][0]["pixels"] = [[0, 0]] * 35
        self.write("rig.yaml", CAMERA % "" + "priors: {sensor/cam/distortion.k1: 0.01}\n")
        self.write("samples.jsonl", "".join(json.dumps(line) + "\n" for line in lines))
        done = subprocess.run([KINCAL, "calibrate", "rig.yaml", "samples.jsonl", "--out", "out"], cwd=self.dir, capture_output=True, text=True)
        self.assertIn(done.returncode, (1, 2, 3, 5), done.stdout + done.stderr)
        self.assertNotIn("vector::", done.stderr)

    def test_batch(self):
        """A fleet of such robots: what is done is done, and a mistake is named as calibrate names it."""
        entry = "joints: {flange: {sigma: {translation: 0.0003, rotation: 0.0003}}}"
        text = samples(20, 0.6)
        lines = [json.loads(line) for line in text.splitlines()]
        for line in lines:
            line["joints"]["flange"]["xyz"] = [1000 * v for v in line["joints"]["flange"]["xyz"]]
        for name, these in (("good", text), ("mm", "".join(json.dumps(line) + "\n" for line in lines))):
            self.write("fleet/%s/rig.yaml" % name, RIG % entry)
            self.write("fleet/%s/samples.jsonl" % name, these)
        for again in (False, True):
            done = subprocess.run([KINCAL, "batch", "fleet", "--out", "out", "--jobs", "2"], cwd=self.dir, capture_output=True, text=True)
            self.assertEqual(done.returncode, 1, done.stdout + done.stderr)
            sets = json.loads(self.read("out", "summary.json"))["results"]
            self.assertEqual((sets["good"]["status"], sets["good"]["exit_code"]), ("converged", 0))
            self.assertIn("Look first at units", sets["mm"]["error"])
            self.assertIn("millimetres", sets["mm"]["error"])
            if again:
                self.assertEqual(os.stat(self.path("out", "good", "result.json")).st_mtime_ns, before)
            before = os.stat(self.path("out", "good", "result.json")).st_mtime_ns


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:])
