"""The C interface: python3 c_test.py SOURCE_DIR KINCAL LIBRARY C_PROGRAM CC [TEST ...]   (LIBRARY: libkincal.so; C_PROGRAM: built of kincal_test.c)

Proves: Program: what kincal_test.c says at its head, and that the files of its result are those that the program writes, to the last bit but for command, date and seconds. Same: the same by ctypes, with options
and of a robot whose links bend (forward and compensate are those of the Python package), and plans and verifications; what the header says of structs is what ctypes needs to know. Abi: the library exports the functions of the header and nothing
else; sizes of structs, places of their members, and values of constants are those of abi.txt (`--renew` writes it anew: members may be added at the end, nothing else may change); the header compiles by itself in C99
without a warning, and in C++. Document: the program of docs/c.md (examples/programs) compiles and prints what the page shows. Does not prove: that a program of an older version runs (there is none).
"""
import ctypes
import json
import os
import re
import shutil
import subprocess
import sys
import unittest

RENEW = "--renew" in sys.argv
ARGUMENTS = [a for a in sys.argv if a != "--renew"]
SOURCE_DIR, KINCAL, LIBRARY, C_PROGRAM = (os.path.abspath(p) for p in ARGUMENTS[1:5])
CC = ARGUMENTS[5]
sys.path.insert(0, os.path.join(SOURCE_DIR, "tests", "program"))
from helpers import Folder, revolute  # noqa: E402

ARM = os.path.join(SOURCE_DIR, "examples", "arm")
PR2 = os.path.join(SOURCE_DIR, "examples", "pr2")
INCLUDE = os.path.join(SOURCE_DIR, "bindings", "c")
HEADER = os.path.join(INCLUDE, "kincal.h")
TABLE = os.path.join(SOURCE_DIR, "tests", "c", "abi.txt")


def run(*command, codes=(0,), **more):
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True, **more)
    if done.returncode not in codes:
        raise AssertionError("%s\nended with %d\n%s" % (command, done.returncode, done.stdout[-4000:]))
    return done.stdout


def read(path):
    with open(path, encoding="utf-8") as file:
        return file.read()


def sanitizer():
    """The flags of the sanitizer that the library has."""
    symbols = run("nm", "-D", "--undefined-only", LIBRARY)
    return ["-fsanitize=thread"] if "__tsan_" in symbols else ["-fsanitize=address,undefined"] if "__asan_" in symbols else []


def same_files(case, program, texts):
    """The files of a folder, and these texts by name."""
    case.assertEqual(sorted(os.listdir(program)), sorted(texts))
    for name, text in texts.items():
        if name == "result.json":
            written = [json.loads(t) for t in (read(os.path.join(program, name)), text)]
            for result in written:
                for key in ("command", "date"):
                    result["input"].pop(key)
                for step in result["steps"]:
                    step.pop("seconds")
            case.assertEqual(*written)
        elif name != "report.html":  # which has that, too
            case.assertEqual(read(os.path.join(program, name)), text, name)


class Program(Folder):
    def simulated(self, name, seed, **changes):
        """24 samples of the arm, with some true values changed, as JSON lines and as numbers."""
        truth = json.loads(read(os.path.join(ARM, "truth.json")))
        for parameter, change in changes.items():
            truth["parameters"][parameter.replace("__", "/")]["true"] += change
        truth.pop("samples")
        run(KINCAL, "simulate", os.path.join(ARM, "rig.yaml"), "--samples", "24", "--seed", str(seed), "--truth", self.write("truth.json", json.dumps(truth)),
            "--postures", os.path.join(ARM, "postures.jsonl"), "--out", self.path("made"), "--force", "--quiet")
        text = self.read("made", "samples.jsonl")
        self.write(name + ".jsonl", text)
        lines = []
        for sample in map(json.loads, text.splitlines()):
            (view,) = sample["views"]
            numbers = list(sample["joints"].values()) + [len(view["ids"])]
            for point, pixel in zip(view["ids"], view["pixels"]):
                numbers += [point, *pixel]
            lines.append(" ".join(map(repr, numbers)))
        self.write(name + ".txt", "\n".join(lines) + "\n")

    def behind(self):
        """A rig whose camera looks away from what it saw."""
        chain = [("a", "l1", "0 0 0.4", "0 0 1"), ("b", "l2", "0.1 0 0.1", "0 1 0"), ("c", "hand", "0 0 0.5", "0 1 0")]
        self.write("behind.urdf", '<robot name="r"><link name="base"/>%s</robot>' % "".join(revolute(chain, "base", 2.4)))
        rig = {"format": "kincal/1", "robot": "behind.urdf", "joints": {"*": {"sigma": 1e-4}}, "estimate": [{"step": "one", "free": ["joint/b/offset", "joint/c/offset"]}],
               "targets": {"board": {"type": "chessboard", "rows": 5, "columns": 6, "square": 0.04, "mount": {"link": "hand", "pose": {"xyz": [0.1, 0, 0.1], "rpy": [0, 1.57, 0]}}}},
               "sensors": {"cam": {"type": "camera", "link": "base", "model": "pinhole", "intrinsics": [1000, 1000, 640, 480], "image_size": [1280, 960], "sigma": 0.2,
                                   "pose": {"xyz": [2.2, 0.1, 0.5], "rpy": [-1.5708, 0.02, 1.5908]}}}}
        run(KINCAL, "simulate", self.write("behind.yaml", json.dumps(rig)), "--samples", "12", "--seed", "1", "--out", self.path("made"), "--force", "--quiet")
        shutil.copy(self.path("made", "samples.jsonl"), self.path("behind.jsonl"))
        rig["sensors"]["cam"]["pose"]["rpy"] = [-1.5708, 0.02, -1.5508]
        self.write("behind.yaml", json.dumps(rig))

    def test_program(self):
        for name in ("rig.yaml", "robot.urdf"):
            shutil.copy(os.path.join(ARM, name), self.path(name))
        self.simulated("samples", 5)
        self.simulated("later", 9)
        self.simulated("moved", 10, **{"sensor__camera__pose.x": 0.002})
        self.behind()
        os.mkdir(self.path("c"))
        self.assertEqual(run(C_PROGRAM, self.dir, timeout=500), "0 failures\n")
        run(KINCAL, "calibrate", "rig.yaml", "samples.jsonl", "--out", "program", "--quiet", cwd=self.dir)
        same_files(self, self.path("program"), {name: self.read("c", name) for name in os.listdir(self.path("c"))})


# ---------------------------------------------------------------------------- ctypes
class Error(ctypes.Structure):
    _fields_ = [("size", ctypes.c_size_t), ("status", ctypes.c_int32), ("line", ctypes.c_int32), ("message", ctypes.c_char * 2048), ("file", ctypes.c_char * 512),
                ("name", ctypes.c_char * 256)]


class Text(ctypes.Structure):
    _fields_ = [("data", ctypes.c_char_p), ("size", ctypes.c_size_t), ("name", ctypes.c_char_p)]


class Compensation(ctypes.Structure):
    _fields_ = [("size", ctypes.c_size_t), ("tip", ctypes.c_char_p), ("base", ctypes.c_char_p), ("planned", ctypes.POINTER(ctypes.c_double)),
                ("readings", ctypes.POINTER(ctypes.c_double)), ("count", ctypes.c_size_t), ("position", ctypes.c_double), ("rotation", ctypes.c_double),
                ("position_only", ctypes.c_int32), ("reserved", ctypes.c_int32)]


def text_of(path):
    data = read(path).encode()
    return Text(data, len(data), path.encode())


class Same(Folder):
    def setUp(self):
        super().setUp()
        if sanitizer():
            self.skipTest("no interpreter loads a library with a sanitizer")
        self.library = ctypes.CDLL(LIBRARY)
        self.library.kincal_result_file_name.restype = self.library.kincal_result_name.restype = ctypes.c_char_p
        self.library.kincal_result_file_name.argtypes = [ctypes.c_void_p, ctypes.c_size_t]
        self.library.kincal_result_name.argtypes = [ctypes.c_void_p, ctypes.c_int32, ctypes.c_size_t]

    def call(self, name, *arguments):
        error = Error(ctypes.sizeof(Error))
        status = getattr(self.library, name)(*arguments, ctypes.byref(error))
        self.assertEqual((status, error.message), (0, b""))

    def file(self, result, name):
        needed = ctypes.c_size_t()
        self.call("kincal_result_file", result, name, None, ctypes.c_size_t(0), ctypes.byref(needed))
        buffer = ctypes.create_string_buffer(needed.value)
        self.call("kincal_result_file", result, name, buffer, needed, None)
        return buffer.value.decode()

    def text(self, answer, name=None):
        function, names = ("kincal_answer_file", [name]) if name else ("kincal_answer_json", [])
        needed = ctypes.c_size_t()
        self.call(function, answer, *names, None, ctypes.c_size_t(0), ctypes.byref(needed))
        buffer = ctypes.create_string_buffer(needed.value)
        self.call(function, answer, *names, buffer, needed, None)
        return buffer.value.decode()

    def answer(self, function, *arguments):
        answer = ctypes.c_void_p()
        self.call(function, *arguments, ctypes.byref(answer))
        self.addCleanup(self.library.kincal_answer_free, answer)
        return answer

    def problem(self, rig, urdf, samples=None):
        problem = ctypes.c_void_p()
        self.call("kincal_problem_new", *(ctypes.byref(text_of(p)) if p else None for p in (rig, urdf, samples)), ctypes.byref(problem))
        return problem

    def calibrated(self, rig, urdf, samples, settings=None):
        problem, result = self.problem(rig, urdf, samples), ctypes.c_void_p()
        self.call("kincal_calibrate", problem, settings, None, ctypes.byref(result))
        self.library.kincal_problem_free(problem)
        self.addCleanup(self.library.kincal_result_free, result)
        return result

    def files(self, result):
        names, i = [], 0
        while self.library.kincal_result_file_name(result, i):
            names.append(self.library.kincal_result_file_name(result, i))
            i += 1
        return {name.decode(): self.file(result, name) for name in names}

    def test_pr2(self):
        rig, urdf, samples = (os.path.join(PR2, n) for n in ("rig.yaml", "robot.urdf", "samples.jsonl"))
        for settings, switches in ((None, []), (b'{"noise": "marginal", "fix": "joint/l_*", "holdout": 4, "report_frame": ["base_link"], "threads": 2}',
                                               ["--noise", "marginal", "--fix", "joint/l_*", "--holdout", "4", "--report-frame", "base_link", "--threads", "2"]),
                                   (b'{"free": ["sensor/left_arm/pose.rx"]}', ["--free", "sensor/left_arm/pose.rx"])):
            run(KINCAL, "calibrate", rig, samples, "--out", self.path("program"), "--force", "--quiet", *switches, codes=(0, 2))
            result = self.calibrated(rig, urdf, samples, settings)
            same_files(self, self.path("program"), self.files(result))
            command = json.loads(self.file(result, b"result.json"))["input"]["command"]
            self.assertEqual(command, "kincal_calibrate(%s, %s, %s)" % (rig, samples, settings.decode() if settings else "NULL"))

    def test_bending(self):
        """Of a robot whose links bend: the Python package's poses and readings."""
        import bending_test
        sys.path.insert(0, os.path.join(os.path.dirname(KINCAL), "python"))
        try:
            import kincal
            import numpy
        except ImportError:
            self.skipTest("the Python package is not built")
        chain = [("a", "l1", "0 0 0.4", "0 0 1"), ("b", "l2", "0.1 0 0.1", "0 1 0"), ("c", "l3", "0 0 0.5", "0 1 0"), ("d", "l4", "0.4 0 0.05", "1 0 0"), ("e", "hand", "0.1 0 0", "0 1 0")]
        urdf = self.write("robot.urdf", '<robot name="r"><link name="base"/>%s</robot>' % "".join(revolute(chain, "base", 2.4)))
        self.write("true.yaml", bending_test.RIG % bending_test.ELASTIC)
        rig, samples = self.write("rig.yaml", bending_test.RIG % ""), self.path("made", "samples.jsonl")
        run(KINCAL, "simulate", self.path("true.yaml"), "--samples", "120", "--seed", "7", "--out", self.path("made"), "--quiet")
        result = self.calibrated(rig, urdf, samples, b'{"no_report": true}')
        other = kincal.calibrate(rig, samples, no_report=True)
        self.assertIn("rig_rigid.yaml", other.files)
        for name, text in self.files(result).items():
            if name not in ("result.json", "report.html"):
                self.assertEqual(text, other.files[name], name)
        joints, i = [], 0
        while self.library.kincal_result_name(result, 0, i):
            joints.append(self.library.kincal_result_name(result, 0, i).decode())
            i += 1
        self.assertEqual(joints, list(other.rig.joints))
        readings = [0.1 * (k + 1) for k in range(len(joints))]
        given = (ctypes.c_double * len(joints))(*readings)
        found = (ctypes.c_double * len(joints))()
        pose = (ctypes.c_double * 16)()
        (tip,) = [f for f in other.rig.targets]
        self.call("kincal_result_forward", result, given, ctypes.c_size_t(len(joints)), ("target/" + tip).encode(), None, pose)
        by_name = dict(zip(joints, readings))
        numpy.testing.assert_array_equal(numpy.reshape(pose, (4, 4)), other.forward(by_name, "target/" + tip))
        wish = Compensation(ctypes.sizeof(Compensation), ("target/" + tip).encode(), None, given, found, len(joints), 0, 0, 1, 0)
        self.call("kincal_result_compensate", result, ctypes.byref(wish))
        expected = other.compensate(by_name, "target/" + tip, position_only=True)
        self.assertEqual(list(found), [expected.joints[j] for j in joints])
        self.assertEqual(wish.position, float(expected.position))
        self.assertGreater(max(abs(a - b) for a, b in zip(found, readings)), 1e-5)

    def test_temperature(self):
        """Readings of a robot whose joints depend on the temperature: those of the Python package."""
        import conditions_test
        sys.path.insert(0, os.path.join(os.path.dirname(KINCAL), "python"))
        try:
            import kincal
        except ImportError:
            self.skipTest("the Python package is not built")
        urdf = self.write("robot.urdf", conditions_test.URDF)
        true = self.write("true.yaml", conditions_test.with_terms({"temperature": conditions_test.TERMS["temperature"]}))
        rig, samples = self.write("rig.yaml", conditions_test.with_terms()), self.path("made", "samples.jsonl")
        run(KINCAL, "simulate", true, "--samples", "100", "--seed", "7", "--out", self.path("made"), "--quiet")
        result = self.calibrated(rig, urdf, samples, b'{"no_report": true}')
        other = kincal.calibrate(rig, samples, no_report=True)
        joints = list(other.rig.joints)
        readings = [0.1 * (k + 1) for k in range(len(joints))]
        given, found = (ctypes.c_double * len(joints))(*readings), (ctypes.c_double * len(joints))()
        wish = Compensation(ctypes.sizeof(Compensation), b"hand", None, given, found, len(joints), 0, 0, 1, 0)
        at = {}
        for temperature in (15.0, 30.0):
            self.call("kincal_result_compensate_at", result, ctypes.c_double(temperature), ctypes.byref(wish))
            expected = other.compensate(dict(zip(joints, readings)), "hand", position_only=True, temperature=temperature)
            at[temperature] = list(found)
            self.assertEqual(at[temperature], [expected.joints[j] for j in joints])
        self.assertGreater(max(abs(a - b) for a, b in zip(*at.values())), 1e-5)
        for call, said in ((("kincal_result_compensate", result, ctypes.byref(wish)), "temperature"),
                           (("kincal_result_compensate_at", result, ctypes.c_double(float("nan")), ctypes.byref(wish)), "finite")):
            with self.assertRaisesRegex(Exception, said):
                self.call(*call)

    def test_plan_and_verify(self):
        """Plans and verifications are those of the program."""
        import verify_test
        rig, urdf = os.path.join(PR2, "rig.yaml"), os.path.join(PR2, "robot.urdf")
        problem = self.problem(rig, urdf)
        self.addCleanup(self.library.kincal_problem_free, problem)
        answer = self.answer("kincal_plan", problem, b'{"next": 5, "candidates": 200, "seed": 3}', None)
        out = run(KINCAL, "plan", rig, "--next", "5", "--candidates", "200", "--seed", "3", "--json", "--quiet", "--out", self.path("p.jsonl"))
        self.assertEqual(json.loads(self.text(answer)), json.loads(out))
        self.assertEqual(self.text(answer, b"postures.jsonl"), self.read("p.jsonl"))

        shutil.copy(os.path.join(ARM, "robot.urdf"), self.path("robot.urdf"))
        rig, urdf = self.write("rig.yaml", verify_test.RIG), self.path("robot.urdf")
        run(KINCAL, "simulate", rig, "--samples", "40", "--seed", "1", "--spread", "joint/lift/offset=0.003", "--spread", "joint/bend/offset=0.003", "--spread", "*/pose.[xyz]=0.003", "--out", self.path("first"), "--quiet")
        run(KINCAL, "calibrate", rig, self.path("first", "samples.jsonl"), "--out", self.path("result"), "--quiet")
        result = self.calibrated(rig, urdf, self.path("first", "samples.jsonl"))
        rig, urdf = self.path("result", "rig.yaml"), self.path("result", "robot.urdf")
        problem = self.problem(rig, urdf)
        self.addCleanup(self.library.kincal_problem_free, problem)
        answer = self.answer("kincal_plan_verification", problem, b'{"cycles": 4, "region": [-2, -2, 0, 2, 2, 2]}', None)
        out = run(KINCAL, "plan", self.path("result"), "--verify", "--cycles", "4", "--region=-2,-2,0,2,2,2", "--json", "--quiet", "--out", self.path("poses.jsonl"))
        self.assertEqual(json.loads(self.text(answer)), json.loads(out))
        self.assertEqual(self.text(answer, b"postures.jsonl"), self.read("poses.jsonl"))
        later = self.path("later", "samples.jsonl")
        run(KINCAL, "simulate", self.path("rig.yaml"), "--samples", "30", "--seed", "4", "--truth", self.path("first", "truth.json"), "--out", self.path("later"), "--quiet")
        answer = self.answer("kincal_verify", result, ctypes.byref(text_of(later)), b'{"tolerance": "frame/target/reflector<0.5mm", "instrument": "tracker 7"}')
        out = run(KINCAL, "verify", self.path("result"), later, "--tolerance", "frame/target/reflector<0.5mm", "--instrument", "tracker 7", "--json")
        mine, theirs = json.loads(self.text(answer)), json.loads(out)
        self.assertEqual(mine["answer"], theirs["answer"])
        self.assertEqual({k for k in mine if mine[k] != theirs[k]} - {"command", "date", "sha256"}, set())
        self.assertIn("tracker 7", self.text(answer, b"certificate.html"))
        error, none = Error(ctypes.sizeof(Error)), ctypes.c_void_p()
        used = ctypes.byref(text_of(self.path("first", "samples.jsonl")))
        self.assertEqual(self.library.kincal_verify(result, used, None, ctypes.byref(none), ctypes.byref(error)), 1)
        self.assertIn(b"was calibrated with", error.message)
        self.assertIsNone(none.value)


# ---------------------------------------------------------------------------- the binary interface
class Abi(Folder):
    def described(self):
        """The header's functions, structs with their members, and constants, by a program made of it."""
        header = re.sub(r"/\*.*?\*/", "", read(HEADER), flags=re.DOTALL)
        lines = []
        for members, name in re.findall(r"typedef struct \w+ \{(.*?)\} (\w+);", header, re.DOTALL):
            lines.append('printf("struct %s %%zu\\n", sizeof(%s));' % (name, name))
            for declaration in members.split(";"):
                for member in re.findall(r"(\w+)(?:\[\d+\])?\s*(?:,|$)", declaration.strip()):
                    lines.append('printf("member %s.%s %%zu %%zu\\n", offsetof(%s, %s), sizeof(((%s*)0)->%s));' % (name, member, name, member, name, member))
        for constants in re.findall(r"enum \{(.*?)\}", header, re.DOTALL):
            for constant in re.findall(r"(KINCAL_\w+) =", constants):
                lines.append('printf("value %s %%d\\n", (int)%s);' % (constant, constant))
        code = "#include <kincal.h>\n#include <stdio.h>\nint main(void) {\n%s\nreturn 0;\n}\n" % "\n".join(lines)
        program = self.path("describe")
        run(CC, "-std=c99", "-I", INCLUDE, self.write("describe.c", code), "-o", program)
        functions = sorted(re.findall(r"KINCAL_API [\w ]+?\*?\s*(kincal_\w+)\(", header))
        return ["function " + f for f in functions] + run(program).splitlines(), functions

    def test_table(self):
        described, functions = self.described()
        symbols = re.findall(r"^\S+ (\S) (\S+)$", run("nm", "-D", "--defined-only", LIBRARY), re.M)
        self.assertEqual(sorted(symbols), [("T", f) for f in functions])
        if ctypes.sizeof(ctypes.c_void_p) != 8:
            self.skipTest("the table is for pointers of 64 bits")
        if RENEW:
            with open(TABLE, "w", encoding="utf-8") as file:
                file.write("\n".join(described) + "\n")
        self.assertEqual(read(TABLE).splitlines(), described)
        self.assertGreater(len(described), 120)
        self.assertIn("SONAME", run("readelf", "-d", LIBRARY))
        self.assertIn("libkincal.so.0", run("readelf", "-d", LIBRARY))

    def test_documented(self):
        """Every function says which threads may call it."""
        text = read(HEADER)
        for match in re.finditer(r"KINCAL_API [\w ]+?\*?\s*(kincal_\w+)\(", text):
            comment = text[:match.start()].rstrip()
            self.assertTrue(comment.endswith("*/"), match[1])
            self.assertRegex(comment[comment.rindex("/*"):], r"\[(any|shared|one)\]", match[1])

    def test_header_alone(self):
        source = self.write("alone.c", "#include <kincal.h>\n#include <kincal.h>\nint main(void) { kincal_error e = KINCAL_ERROR_INIT; return (int)e.status; }\n")
        for language in (["-x", "c", "-std=c99"], ["-x", "c", "-std=c11"], ["-x", "c++", "-std=c++11"]):
            run(CC, *language, "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I", INCLUDE, "-fsyntax-only", source)


class Document(Folder):
    def test_program(self):
        """examples/programs/from_memory.c prints what docs/c.md shows, in a folder with the files of examples/pr2; the page shows lines of it."""
        blocks = re.findall(r"^```(\w*)\n(.*?)^```$", read(os.path.join(SOURCE_DIR, "docs", "c.md")), re.M | re.DOTALL)
        (shown,) = [text for kind, text in blocks if kind == "c"]
        (output,) = [text for kind, text in blocks if kind == ""]
        code = read(os.path.join(SOURCE_DIR, "examples", "programs", "from_memory.c"))
        rest = iter([line.strip() for line in code.splitlines()])
        for line in shown.splitlines():
            self.assertIn(line.strip(), rest)
        run(CC, "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", *sanitizer(), "-I", INCLUDE, self.write("main.c", code), LIBRARY, "-o", self.path("main"), "-lm")
        for name in ("rig.yaml", "robot.urdf", "samples.jsonl"):
            shutil.copy(os.path.join(PR2, name), self.path(name))
        environment = {**os.environ, "LD_LIBRARY_PATH": os.path.dirname(LIBRARY)}
        self.assertEqual(run(self.path("main"), cwd=self.dir, env=environment), output)


if __name__ == "__main__":
    unittest.main(argv=ARGUMENTS[:1] + ARGUMENTS[6:], verbosity=2)
