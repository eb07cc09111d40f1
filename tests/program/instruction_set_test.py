"""The example's calibration with every instruction set: python3 instruction_set_test.py SOURCE_DIR KINCAL [TEST ...]

Proves, for each noise mode: with the environment's KINCAL_ISA at baseline, avx2, avx512 and without it, chi2 is the same to 1e-9 of it
and every number of every parameter to 1e-6 of its standard deviation, which is itself the same to 1e-6 of it; one set twice gives
the same bits, and so does one thread or two; the variable acts where the processor has what it names; what it does not know, and
what the processor lacks, leaves the best set (solver/kernels.h: the variable lowers). Where KINCAL_OTHER names the program of another processor
(scripts/cross-arm64), its results are as near, and it simulates the same samples. It does not prove that the numbers are right
(cli_test.py, data_test.py, reference_test.py).
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
from cli_test import strict_json

SOURCE_DIR = KINCAL = None
SETS = ("baseline", "avx2", "avx512")


def processor_flags():
    """What the processor has, as far as one is told; None: not told."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as f:
            found = re.search(r"^flags\s*:(.*)$", f.read(), re.M)
    except OSError:
        return None
    return set(found.group(1).split()) if found else None


class Case(unittest.TestCase):
    maxDiff = 2000

    @classmethod
    def setUpClass(cls):
        cls.dir = tempfile.mkdtemp(prefix="kincal_isa_")
        cls.count = 0

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.dir, ignore_errors=True)

    def calibrate(self, isa, *args, program=None):
        """(result.json, its text and the other numbers' files without what names the run)."""
        type(self).count += 1
        out = os.path.join(self.dir, "out%d" % self.count)
        env = {k: v for k, v in os.environ.items() if k != "KINCAL_ISA"}
        if isa is not None:
            env["KINCAL_ISA"] = isa
        example = os.path.join(SOURCE_DIR, "examples", "pr2")
        p = subprocess.run([program or KINCAL, "calibrate", os.path.join(example, "rig.yaml"), os.path.join(example, "samples.jsonl"), "--out", out]
                           + list(args), stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, env=env, timeout=300)
        self.assertEqual(p.returncode, 0, p.stderr.decode()[-500:])
        texts = []
        for name in ("result.json", "covariance.csv", "residuals.csv", "robot.urdf"):
            with open(os.path.join(out, name), encoding="utf-8", newline="") as f:
                texts.append(f.read())
        result = strict_json(texts[0])
        texts[0] = re.sub(r'"(command|seconds)": *("(?:[^"\\]|\\.)*"|[-+0-9.e]+)', "", texts[0])
        return result, texts

    def close(self, a, b):
        self.assertEqual(a["status"], b["status"])
        self.assertEqual(a["dof"], b["dof"])
        self.assertLess(abs(a["chi2"] - b["chi2"]), 1e-9 * a["chi2"])
        self.assertLess(abs(a["cost"] - b["cost"]), 1e-9 * a["cost"])
        for s, t in zip(a["steps"], b["steps"]):
            self.assertEqual((s["step"], s["status"], s["dof"]), (t["step"], t["status"], t["dof"]))
            self.assertLess(abs(s["chi2"] - t["chi2"]), 1e-9 * s["chi2"])
        self.assertEqual(list(a["parameters"]), list(b["parameters"]))
        compared = 0
        for name, p in a["parameters"].items():
            q = b["parameters"][name]
            for x, y, s, t in zip(p["value"], q["value"], p["sigma"], q["sigma"]):
                self.assertEqual(not s, not t, name)
                if not s:  # held
                    self.assertEqual(x, y, name)
                    continue
                self.assertLess(abs(x - y), 1e-6 * s, name)
                self.assertLess(abs(s - t), 1e-6 * s, name)
                compared += 1
        self.assertEqual(compared, 56)


class Sets(Case):
    def mode(self, noise):
        best, bits = self.calibrate(None, "--noise", noise)
        for isa in SETS:
            with self.subTest(isa=isa):
                result, again = self.calibrate(isa, "--noise", noise)
                self.close(best, result)
                self.assertEqual(self.calibrate(isa, "--noise", noise, "--threads", "2")[1], again)

    def test_latent(self):
        self.mode("latent")

    def test_marginal(self):
        self.mode("marginal")

    def test_point(self):
        self.mode("point")

    def test_none(self):
        self.mode("none")


@unittest.skipUnless(os.environ.get("KINCAL_OTHER"), "KINCAL_OTHER names no program")
class Other(Case):
    def test_calibrations(self):
        for noise in ("latent", "marginal", "point", "none"):
            with self.subTest(noise=noise):
                self.close(self.calibrate(None, "--noise", noise)[0], self.calibrate(None, "--noise", noise, program=os.environ["KINCAL_OTHER"])[0])

    def test_simulated_samples(self):
        example, texts = os.path.join(SOURCE_DIR, "examples", "pr2"), []
        for name, program in (("here", KINCAL), ("there", os.environ["KINCAL_OTHER"])):
            out = os.path.join(self.dir, name)
            subprocess.run([program, "simulate", os.path.join(example, "rig.yaml"), "--samples", "8", "--seed", "5", "--out", out, "--quiet"], check=True, timeout=300)
            with open(os.path.join(out, "samples.jsonl"), encoding="utf-8") as f:
                texts.append(f.read())
        number = r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
        self.assertEqual(*(re.sub(number, "0", text) for text in texts))
        pairs = list(zip(*(map(float, re.findall(number, text)) for text in texts)))
        self.assertGreater(len(pairs), 1000)
        for x, y in pairs:
            self.assertLessEqual(abs(x - y), 1e-9 * max(1, abs(x)))


class Choice(Case):
    def test_unknown_values_leave_the_best(self):
        best = self.calibrate(None)[1]
        for isa in ("", "AVX2", "sse2", "avx", "avx5120", "baseline ", "0"):
            with self.subTest(isa=isa):
                self.assertEqual(self.calibrate(isa)[1], best)

    def test_the_variable_acts(self):
        """Fused multiply-adds round once: the last bits of thousands of residuals cannot all be the same."""
        flags = processor_flags()
        if flags is None or not {"avx2", "fma"} <= flags:
            self.skipTest("the processor has no second set")
        results = [self.calibrate(isa)[1][2] for isa in SETS]
        self.assertNotEqual(results[0], results[1])
        if {"avx512f", "avx512dq", "avx512vl"} <= flags:
            self.assertNotEqual(results[1], results[2])
        else:  # not there: the best, which is avx2
            self.assertEqual(results[1], results[2])
        self.assertEqual(self.calibrate(None)[1][2], results[2])


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: instruction_set_test.py SOURCE_DIR KINCAL [TEST ...]")
    SOURCE_DIR, KINCAL = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
