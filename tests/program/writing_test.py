"""Results are never lost or half written, and the program ends when it is told to: python3 writing_test.py SOURCE_DIR KINCAL [TEST ...]

Works with the small robot of cli_test.py and proves: the program killed before or after any call that changes the folder of its output
leaves the old result or the new one, whole, and the next run clears away what is left and says so, also where the system cannot
exchange two names; two runs into one new folder do not replace each other's result; files that cannot be read, symbolic links, pipes and devices are not replaced by an output;
signals end every command at any moment, in a read from a pipe too; closed or full standard streams are errors and get into no file; what
is shown on a terminal is gone at the end; bytes that are no UTF-8 cost no result; the program is hardened.
It does not prove what a crash of the machine leaves.
"""

import fcntl
import json
import os
import pty
import shutil
import signal
import stat
import subprocess
import sys
import threading
import time
import unittest

import cli_test
import helpers
from cli_test import FILES

KINCAL = None

# Ends the process by SIGKILL before the KILL_AT-th call that changes a folder or a file (so after the one before it); writes their
# number to KILL_COUNT.
# NO_RENAMEAT2: a file system that neither exchanges names nor refuses to replace.
SHIM = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>
static int calls;
static int number(const char* name) { const char* text = getenv(name); return text ? atoi(text) : 0; }
static void count(void) {
  if (++calls == number("KILL_AT")) kill(getpid(), SIGKILL);
}
#define CALL(type, name, parameters, arguments)                        \
  type name parameters {                                               \
    static type(*real) parameters;                                     \
    if (!real) real = (type(*) parameters)dlsym(RTLD_NEXT, #name);     \
    count();                                                           \
    return real arguments;                                             \
  }
CALL(int, rename, (const char* a, const char* b), (a, b))
CALL(int, unlink, (const char* a), (a))
CALL(int, unlinkat, (int d, const char* a, int f), (d, a, f))
CALL(int, rmdir, (const char* a), (a))
CALL(int, remove, (const char* a), (a))
CALL(int, link, (const char* a, const char* b), (a, b))
CALL(int, mkdir, (const char* a, mode_t m), (a, m))
CALL(int, fsync, (int d), (d))
CALL(ssize_t, write, (int d, const void* b, size_t n), (d, b, n))
static int (*real_renameat2)(int, const char*, int, const char*, unsigned);
int renameat2(int a, const char* b, int c, const char* d, unsigned f) {
  if (number("NO_RENAMEAT2")) { errno = EINVAL; return -1; }
  if (!real_renameat2) real_renameat2 = dlsym(RTLD_NEXT, "renameat2");
  count();
  return real_renameat2(a, b, c, d, f);
}
int open(const char* path, int flags, ...) {
  static int (*real)(const char*, int, ...);
  if (!real) real = (int (*)(const char*, int, ...))dlsym(RTLD_NEXT, "open");
  va_list list;
  va_start(list, flags);
  mode_t mode = flags & O_CREAT ? va_arg(list, mode_t) : 0;
  va_end(list);
  if (flags & O_CREAT) count();
  return real(path, flags, mode);
}
__attribute__((destructor)) static void end(void) {
  const char* path = getenv("KILL_COUNT");
  FILE* file = path ? fopen(path, "w") : 0;
  if (file) { fprintf(file, "%d", calls); fclose(file); }
}
"""


class Case(cli_test.Case):
    def start(self, *args, **more):
        return helpers.start(self, [KINCAL, *args], **more)

    def names(self):
        return set(os.listdir(self.dir)) - {"robot.urdf", "rig.yaml", "samples.jsonl"}

    def bytes(self, *names):
        with open(self.path(*names), "rb") as f:
            return f.read()

    def contents(self, name):
        """The files of a folder, or a file; without the seconds in result.json."""
        if not os.path.isdir(self.path(name)):
            return self.bytes(name)
        out = {}
        for file in sorted(os.listdir(self.path(name))):
            text = self.bytes(name, file)
            if file == "result.json":
                result = json.loads(text)
                result["input"].pop("command")
                for step in result["steps"]:
                    step.pop("seconds")
                text = json.dumps(result)
            out[file] = text
        return out


class Killed(Case):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
        if not compiler or not sys.platform.startswith("linux"):
            raise unittest.SkipTest("no compiler for the shim")
        cls.shim = os.path.join(cls.root, "shim.so")
        source = os.path.join(cls.root, "shim.c")
        with open(source, "w") as f:
            f.write(SHIM)
        subprocess.run([compiler, "-w", "-shared", "-fPIC", "-o", cls.shim, source, "-ldl"], check=True)
        if cli_test.sanitized():
            raise unittest.SkipTest("sanitizers want to be loaded first")

    def killed(self, args, at, **environment):
        env = dict(os.environ, LD_PRELOAD=self.shim, KILL_AT=str(at), SOURCE_DATE_EPOCH="0", **environment)   # the same date in all results
        return subprocess.run([KINCAL, *args], cwd=self.dir, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def kill_everywhere(self, args, prepare, out, old, new, **environment):
        """Kills at every call; afterwards `out` is `old` or `new`, and another run leaves nothing beside."""
        prepare()
        count = self.path("count")
        self.assertEqual(self.killed(args, 0, KILL_COUNT=count, **environment).returncode, 0)
        calls = int(self.read("count"))
        os.remove(count)
        self.assertGreaterEqual(calls, 5)
        seen, cleared = set(), 0
        # scripts/test: every third, and the last ones, where one name takes the place of another.
        for at in range(1, calls + 1) if helpers.SLOW else [*range(1, calls - 5, 3), *range(max(1, calls - 5), calls + 1)]:
            with self.subTest(at=at):
                prepare()
                self.assertEqual(self.killed(args, at, **environment).returncode, -signal.SIGKILL)
                left = {x for x in self.names() if x.startswith(out + ".")}
                there = os.path.lexists(self.path(out))
                if there or old is None or not environment:
                    now = self.contents(out) if there else None
                    self.assertIn(now, (old, new))
                    seen.add("old" if now == old else "new")
                run = self.killed([*args, *([] if "--force" in args else ["--force"])], 0)
                self.assertEqual(run.returncode, 0, run.stderr)
                self.assertEqual(self.contents(out), new)
                for name in left:
                    self.assertIn(name.encode(), run.stderr)
                    cleared += 1
                self.assertFalse({x for x in self.names() if x.startswith(out + ".")})
        self.assertEqual(seen, {"old", "new"})
        self.assertGreater(cleared, 1)

    def remove(self, name):
        if os.path.isdir(self.path(name)):
            shutil.rmtree(self.path(name))
        elif os.path.lexists(self.path(name)):
            os.remove(self.path(name))

    def result_folders(self, force, **environment):
        self.assertEqual(self.calibrate(out="before").code, 0)
        args = ["calibrate", "rig.yaml", "samples.jsonl", "--out", "out", "--step", "eyes", "--no-report", "--quiet"]
        self.assertEqual(self.killed([x if x != "out" else "after" for x in args], 0).returncode, 0)

        def prepare():
            self.remove("out")
            if force:
                shutil.copytree(self.path("before"), self.path("out"))
        self.kill_everywhere(args + ["--force"] * force, prepare, "out", self.contents("before") if force else None, self.contents("after"), **environment)

    def test_new_folder(self):
        self.result_folders(False)

    def test_replaced_folder(self):
        self.result_folders(True)

    def test_replaced_folder_without_exchange(self):
        """Where names cannot be exchanged, there is a moment without a result: the next run puts the old one back."""
        self.result_folders(True, NO_RENAMEAT2="1")
        self.remove("out")
        os.rename(self.path("before"), self.path("out.replaced-4711"))
        run = self.calibrate()
        self.assertEqual(run.code, 1)
        self.assertIn("out.replaced-4711: it is back", run.err)
        self.assertIn("out: exists already", run.err)
        self.assertEqual(self.names(), {"out", "after"})

    def test_files(self):
        self.assertEqual(self.calibrate().code, 0)
        self.write("before", "<robot/>")
        self.assertEqual(self.run_kincal("apply", "out", "robot.urdf", "--out", "after").code, 0)
        for force in (False, True):
            def prepare():
                self.remove("applied")
                if force:
                    shutil.copy(self.path("before"), self.path("applied"))
            for more in ({}, {"NO_RENAMEAT2": "1"}):
                with self.subTest(force=force, more=more):
                    self.kill_everywhere(["apply", "out", "robot.urdf", "--out", "applied"] + ["--force"] * force, prepare, "applied",
                                         self.contents("before") if force else None, self.contents("after"), **more)

    def test_batch(self):
        """Of a set in a batch too, whichever of the processes is killed."""
        os.mkdir(self.path("fleet"))
        os.mkdir(self.path("fleet", "one"))
        for name in ("robot.urdf", "rig.yaml", "samples.jsonl"):
            shutil.copy(self.path(name), self.path("fleet", "one"))
        def result(out):
            contents = self.contents(os.path.join(out, "one"))
            contents.pop("batch.json")  # has seconds in it
            return contents
        args = ["batch", "fleet", "--no-report", "--quiet"]
        self.assertEqual(self.killed([*args, "--out", "before"], 0).returncode, 0)
        args += ["--step", "eyes", "--out"]
        self.assertEqual(self.killed([*args, "after"], 0).returncode, 0)
        old, new = result("before"), result("after")
        for environment in ({}, {"NO_RENAMEAT2": "1"}):
            seen = set()
            for at in range(1, 200):
                with self.subTest(at=at, environment=environment):
                    self.remove("out")
                    shutil.copytree(self.path("before"), self.path("out"))
                    code = self.killed([*args, "out"], at, **environment).returncode
                    if not environment or os.path.exists(self.path("out", "one")):
                        now = result("out")
                        self.assertIn(now, (old, new))
                        seen.add("old" if now == old else "new")
                    run = self.killed([*args, "out"], 0)
                    self.assertEqual(run.returncode, 0, run.stderr)
                    self.assertEqual(result("out"), new)
                    self.assertEqual(sorted(os.listdir(self.path("out"))), [".batch", "one", "summary.csv", "summary.json"])
                    self.assertEqual(os.listdir(self.path("out", ".batch")), ["lock"])
                if code == 0:
                    break
            self.assertEqual((code, seen), (0, {"old", "new"}))

    def test_what_is_not_a_leftover(self):
        """A run that still writes, and what holds anything else, is left alone."""
        os.mkdir(self.path("out.writing-12"))
        self.write("out.writing-12/notes.txt", "mine")
        os.mkdir(self.path("out.writing-old"))
        run = self.calibrate()
        self.assertEqual((run.code, run.err.count("warning")), (0, 0), run.err)
        self.assertEqual(self.names(), {"out", "out.writing-12", "out.writing-old"})
        self.remove("out")
        os.mkdir(self.path("out.writing-13"))
        lock = os.open(self.path("out.writing-13"), os.O_RDONLY)
        fcntl.flock(lock, fcntl.LOCK_EX)
        self.assertEqual(self.calibrate().code, 0)
        self.assertIn("out.writing-13", self.names())
        os.close(lock)
        self.assertIn("out.writing-13: left by a run that was killed: removed", self.calibrate("--force").err)
        self.assertEqual(self.names(), {"out", "out.writing-12", "out.writing-old"})


class Output(Case):
    def test_two_at_once(self):
        """Two runs into one new folder: one wins, the other says so, and nothing is left beside."""
        for _ in range(6):
            runs = [self.start("calibrate", "rig.yaml", "samples.jsonl", "--out", "out", *step) for step in ((), ("--step", "eyes"))]
            said = [p.communicate()[1].decode() for p in runs]
            codes = [p.returncode for p in runs]
            self.assertEqual(sorted(codes), [0, 1], said)
            self.assertIn("out: exists already", said[codes.index(1)])
            self.assertEqual(len(json.loads(self.read("out", "result.json"))["steps"]), 2 if codes[0] == 0 else 1)
            self.assertEqual(self.names(), {"out"})
            shutil.rmtree(self.path("out"))

    def test_two_at_once_that_replace(self):
        """With --force the later one wins; it is whole, and nothing is left beside."""
        self.assertEqual(self.calibrate().code, 0)
        for _ in range(6):
            runs = [self.start("calibrate", "rig.yaml", "samples.jsonl", "--out", "out", "--force", *step) for step in ((), ("--step", "eyes"))]
            said = [p.communicate()[1].decode() for p in runs]
            self.assertEqual([p.returncode for p in runs], [0, 0], said)
            self.assertEqual(sorted(os.listdir(self.path("out"))), FILES)
            steps = len(json.loads(self.read("out", "result.json"))["steps"])
            self.assertEqual(len(self.read("out", "rig.yaml").split("step:")) - 1, 2)
            self.assertIn(steps, (1, 2))
            self.assertEqual(self.names(), {"out"})

    def test_symbolic_links(self):
        """What a link leads to is replaced, the link stays; a link to nothing is refused."""
        self.assertEqual(self.calibrate(out="real").code, 0)
        os.symlink("real", self.path("link"))
        self.assertEqual(self.calibrate(out="link").code, 1)
        run = self.calibrate("--force", "--step", "eyes", out="link/")
        self.assertEqual(run.code, 0, run.err)
        self.assertEqual(os.readlink(self.path("link")), "real")
        self.assertEqual(len(json.loads(self.read("real", "result.json"))["steps"]), 1)
        self.assertEqual(self.calibrate("--force", out="link").code, 0)
        self.write("real.urdf", "old")
        os.symlink("real.urdf", self.path("link.urdf"))
        self.assertEqual(self.run_kincal("apply", "real", "robot.urdf", "--out", "link.urdf", "--force").code, 0)
        self.assertEqual(os.readlink(self.path("link.urdf")), "real.urdf")
        self.assertIn("<robot", self.read("real.urdf"))
        os.symlink("nowhere", self.path("broken"))
        for force in ((), ("--force",)):
            for args in (("calibrate", "rig.yaml", "samples.jsonl"), ("apply", "real", "robot.urdf"), ("init", "robot.urdf", "--sensor", "point:base_link", "--target", "points:0,0,0@tool"),
                         ("simulate", "rig.yaml", "--samples", "3", "--seed", "1"), ("local", "real", "samples.jsonl", "--near", "arm_000")):
                run = self.run_kincal(*args, "--out", "broken", *force)
                self.assertEqual(run.code, 1)
                self.assertIn("broken: is a symbolic link to nothing", run.err)
        self.assertEqual(self.names(), {"real", "link", "real.urdf", "link.urdf", "broken"})

    def test_what_cannot_be_read(self):
        """A file that the user may not read exists all the same."""
        self.assertEqual(self.calibrate().code, 0)
        os.mkdir(self.path("public"))
        os.chmod(self.path("public"), 0o777)
        os.chmod(self.root, 0o755)
        os.chmod(self.dir, 0o755)
        self.write("public/x.urdf", "precious")
        os.chmod(self.path("public", "x.urdf"), 0)
        user = {"user": 65534, "group": 65534, "extra_groups": []} if os.getuid() == 0 else {}
        for args in (("apply", "out", "robot.urdf"), ("init", "robot.urdf", "--sensor", "point:base_link", "--target", "points:0,0,0@tool")):
            run = self.run_kincal(*args, "--out", "public/x.urdf", **user)
            self.assertEqual(run.code, 1)
            self.assertIn("public/x.urdf: exists already", run.err)
        os.chmod(self.path("public", "x.urdf"), 0o600)
        self.assertEqual(self.read("public", "x.urdf"), "precious")

    def test_what_is_no_file(self):
        """Pipes and devices are refused, at once, with and without --force."""
        self.assertEqual(self.calibrate().code, 0)
        os.mkfifo(self.path("pipe"))
        for out in ("pipe", "/dev/null", "out"):
            for args in (("apply", "out", "robot.urdf"), ("init", "robot.urdf", "--sensor", "point:base_link", "--target", "points:0,0,0@tool"),
                         ("local", "out", "samples.jsonl", "--near", "arm_000")):
                for force in ((), ("--force",)):
                    run = self.run_kincal(*args, "--out", out, *force)
                    self.assertEqual(run.code, 1)
                    self.assertIn(out + ": is there and is not a file", run.err)
        for out in ("pipe", "/dev/null"):
            self.assertEqual(self.calibrate("--force", out=out).code, 1)
        self.assertTrue(stat.S_ISFIFO(os.lstat(self.path("pipe")).st_mode))
        self.assertTrue(stat.S_ISCHR(os.lstat("/dev/null").st_mode))

    def test_a_folder_that_cannot_be_written(self):
        """Said before anything is calculated."""
        os.chmod(self.root, 0o755)
        os.chmod(self.dir, 0o755)
        os.mkdir(self.path("locked"), 0o555)
        user = {"user": 65534, "group": 65534, "extra_groups": []} if os.getuid() == 0 else {}
        self.write("samples.jsonl", "{")
        run = self.calibrate(out="locked/out", **user)
        self.assertEqual(run.code, 1)
        self.assertIn("locked: Permission denied", run.err)

    def test_a_name_that_somebody_else_has(self):
        """A temporary name that is there already, as a trap or from a run that was killed, is neither followed nor replaced."""
        self.write("victim", "precious")
        script = 'ln -s victim "out.urdf.writing-$$"; exec "$0" init robot.urdf --sensor point:base_link --target points:0,0,0@tool --out out.urdf'
        run = subprocess.run(["sh", "-c", script, KINCAL], cwd=self.dir, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertEqual(self.read("victim"), "precious")
        self.assertIn("robot: robot.urdf", self.read("out.urdf"))


class Signals(Case):
    def commands(self):
        """Every command, reading what never comes from a pipe."""
        os.mkfifo(self.path("pipe"))
        return {"calibrate": ("calibrate", "rig.yaml", "pipe", "--out", "new"), "plan": ("calibrate", "rig.yaml", "pipe", "--dry-run"),
                "check": ("check", "rig.yaml", "pipe"), "evaluate": ("evaluate", "rig.yaml", "pipe"), "diff": ("diff", "out", "out", "--samples", "pipe"),
                "apply": ("apply", "out", "pipe", "--out", "new"), "init": ("init", "pipe", "--sensor", "point:base_link", "--target", "points:0,0,0@tool", "--out", "new"),
                "local": ("local", "out", "pipe", "--near", "arm_000", "--out", "new"), "batch": ("batch", "pipe", "--out", "new"),
                "simulate": ("simulate", "rig.yaml", "--samples", "3", "--seed", "1", "--out", "new", "--postures", "pipe")}

    def ends(self, p, signals, message=b"kincal: interrupted, nothing written\n"):
        self.wait_for_handler(p, signals)
        start = time.time()
        p.send_signal(signals)
        out, err = p.communicate(timeout=20)
        self.assertEqual((p.returncode, out, err), (130, b"", message))
        self.assertLess(time.time() - start, 3)  # at once; the machine may be busy

    @staticmethod
    def wait_for_handler(p, number):
        """Until the program runs and catches the signal: on a busy machine that may take a while."""
        while p.poll() is None:
            with open("/proc/%d/status" % p.pid) as f:
                caught = [int(line.split()[1], 16) for line in f if line.startswith("SigCgt")]
            if caught and caught[0] >> (number - 1) & 1:
                return
            time.sleep(0.01)

    def test_reading_a_pipe(self):
        self.assertEqual(self.calibrate().code, 0)
        for name, args in self.commands().items():
            for number in (signal.SIGINT, signal.SIGTERM):
                with self.subTest(command=name, signal=number):
                    p = self.start(*args)
                    time.sleep(0.15)
                    self.assertIsNone(p.poll())
                    self.ends(p, number)
                    self.assertEqual(self.names(), {"out", "pipe"})

    def test_at_work(self):
        """In the middle of a long run of whatever kind, also where the shell has SIGINT ignored."""
        self.write("many.jsonl", "".join(cli_test.lines(cli_test.make_samples(count=300, boards=100)).replace('"id": "', '"id": "%d_' % i) for i in range(30)))
        stopped = 0
        for args in (("simulate", "rig.yaml", "--samples", "1000000", "--seed", "1", "--out", "new"), ("evaluate", "rig.yaml", "many.jsonl"),
                     ("calibrate", "rig.yaml", "many.jsonl", "--out", "new"), ("calibrate", "rig.yaml", "many.jsonl", "--dry-run"), ("check", "rig.yaml", "many.jsonl"),
                     ("local", "rig.yaml", "many.jsonl", "--near", "1_arm_000")):
            for wait in (0.1, 0.4):
                with self.subTest(args=args, wait=wait):
                    p = self.start(*args, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN))
                    time.sleep(wait)
                    self.wait_for_handler(p, signal.SIGINT)
                    p.send_signal(signal.SIGINT)
                    _, err = p.communicate(timeout=20)
                    if p.returncode == 130:
                        stopped += 1
                        # Of `evaluate` the warnings before the tables may just have been printed.
                        self.assertTrue(err.endswith(b"kincal: interrupted, nothing written\n"), err)
                        self.assertEqual(self.names(), {"many.jsonl"})
                    else:  # it was just done
                        self.assertEqual(p.returncode, 0, err)
                        shutil.rmtree(self.path("new"), ignore_errors=True)
        self.assertGreaterEqual(stopped, 6)

    def test_when_all_is_written(self):
        """A result that has its name stays, and the first signal does not call it unwritten; a second one ends the program."""
        read_end, write_end = os.pipe()
        os.set_blocking(write_end, False)
        try:
            while True:
                os.write(write_end, b"x" * 4096)
        except BlockingIOError:
            os.set_blocking(write_end, True)
        p = self.start("calibrate", "rig.yaml", "samples.jsonl", "--out", "out", stdout=write_end)
        os.close(write_end)
        while not os.path.exists(self.path("out")):
            time.sleep(0.01)
        time.sleep(1)
        p.send_signal(signal.SIGINT)
        time.sleep(0.2)
        self.assertIsNone(p.poll())
        p.send_signal(signal.SIGINT)
        err = p.communicate(timeout=5)[1]
        os.close(read_end)
        self.assertEqual(p.returncode, 130)
        self.assertNotIn(b"nothing written", err)
        self.assertEqual(sorted(os.listdir(self.path("out"))), FILES)
        self.assertEqual(self.names(), {"out"})


class Streams(Case):
    def test_closed(self):
        """What is printed gets into no file; that it is not printed is an error."""
        os.mkdir(self.path("fleet"))
        os.mkdir(self.path("fleet", "one"))
        for name in ("robot.urdf", "rig.yaml", "samples.jsonl"):
            shutil.copy(self.path(name), self.path("fleet", "one"))
        for closed in (">&-", "<&- >&-", "<&- >&- 2>&-"):
            for args in ("batch fleet --out new --json", "calibrate rig.yaml samples.jsonl --out new", "evaluate rig.yaml samples.jsonl", "--help", "check --help", "--version"):
                with self.subTest(closed=closed, args=args):
                    run = subprocess.run(["sh", "-c", '"$0" %s %s' % (args, closed), KINCAL], cwd=self.dir, stderr=subprocess.PIPE)
                    self.assertEqual(run.returncode, 1)
                    if "2>" not in closed:
                        self.assertEqual(run.stderr.splitlines()[-1], b"kincal: error: standard output cannot be written")
                    if args.startswith("batch"):
                        self.assertEqual(os.path.getsize(self.path("new", ".batch", "lock")), 0)
                        self.assertTrue(json.loads(self.read("new", "summary.json")))
                    elif args.startswith("calibrate"):
                        self.assertEqual(sorted(os.listdir(self.path("new"))), FILES)
                        self.assertTrue(json.loads(self.read("new", "result.json")))
                        self.assertTrue(self.read("new", "robot.urdf").startswith("<?xml"))
                    shutil.rmtree(self.path("new"), ignore_errors=True)

    def test_full(self):
        self.assertEqual(self.calibrate().code, 0)
        for args in ("--help", "--version", "calibrate --help", "evaluate rig.yaml samples.jsonl", "diff out out", "check rig.yaml samples.jsonl",
                     "init robot.urdf --sensor point:base_link --target points:0,0,0@tool", "calibrate rig.yaml samples.jsonl --dry-run"):
            with self.subTest(args=args), open("/dev/full", "w") as full:
                p = self.start(*args.split(), stdout=full)
                err = p.communicate()[1]
                self.assertEqual((err.splitlines()[-1], p.returncode), (b"kincal: error: standard output cannot be written", 1))


class Names(Case):
    """Bytes that are no UTF-8: in a path they cost no result, in a name they are refused before the calibration."""

    def run_bytes(self, *args):
        p = subprocess.run([KINCAL, *args], cwd=self.dir, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        return p.returncode, p.stdout, p.stderr

    def test_paths(self):
        folder = os.path.join(os.fsencode(self.dir), b"caf\xe9")
        os.mkdir(folder)
        for name in ("rig.yaml", "robot.urdf", "samples.jsonl"):
            shutil.copy(self.path(name), os.path.join(folder, name.encode()))
        rig, samples = b"caf\xe9/rig.yaml", b"caf\xe9/samples.jsonl"
        for out in (b"out", b"caf\xe9/out"):
            code, printed, err = self.run_bytes("calibrate", rig, samples, "--out", out, "--json")
            self.assertEqual(code, 0, err)
            result = cli_test.strict_json(printed.decode())
            self.assertIn("caf\ufffd/rig.yaml", result["input"]["command"])
            with open(os.path.join(os.fsencode(self.dir), out, b"result.json"), "rb") as f:
                self.assertEqual(f.read(), printed)
            for args in (("diff", out, out, "--json"), ("local", out, samples, "--near", "arm_000", "--within", "3", "--json"), ("evaluate", rig, samples, "--json"),
                         ("check", rig, samples, "--json"), ("local", out, samples, "--near", "arm_000", "--within", "3", "--out", b"caf\xe9/local.yaml", "--force"),
                         ("apply", out, b"caf\xe9/robot.urdf", "--out", b"caf\xe9/applied.urdf", "--force"),
                         ("simulate", rig, "--samples", "3", "--seed", "1", "--out", b"caf\xe9/simulated", "--force")):
                with self.subTest(args=args):
                    code, printed, err = self.run_bytes(*args)
                    self.assertEqual(code, 0, err)
                    if args[-1] == "--json":
                        cli_test.strict_json(printed.decode())

    def test_names(self):
        def spoil(name, old, new):
            text = self.bytes(name)
            self.assertIn(old, text)
            with open(self.path(name), "wb") as f:
                f.write(text.replace(old, new))
            return text
        for name, old, place in (("robot.urdf", b'"turn"', b"robot.urdf:"), ("robot.urdf", b'"turret"', b"robot.urdf:"), ("rig.yaml", b"tracker", b"rig.yaml:"),
                                 ("rig.yaml", b"plate", b"rig.yaml:")):
            with self.subTest(name=name, old=old):
                text = spoil(name, old, old[:-2] + b"\xe9" + old[-2:])
                code, _, err = self.run_bytes("calibrate", "rig.yaml", "samples.jsonl", "--out", "out")
                self.assertEqual((code, err.startswith(b"kincal: error: " + place), b"not UTF-8" in err), (1, True, True), err)
                self.assertEqual(self.names(), set())
                with open(self.path(name), "wb") as f:
                    f.write(text)
        spoil("robot.urdf", b"<!-- a small", b"<!-- caf\xe9: a small")
        spoil("rig.yaml", b"format:", b"# caf\xe9\nformat:")
        code, _, err = self.run_bytes("calibrate", "rig.yaml", "samples.jsonl", "--out", "out")
        self.assertEqual(code, 0, err)
        self.assertIn(b"caf\xe9", self.bytes("out", "robot.urdf"))


class Progress(Case):
    """One line on a terminal that is gone at the end; nothing elsewhere and with --quiet."""

    def on_terminal(self, *args):
        main, terminal = pty.openpty()
        p = self.start(*args, stderr=terminal)
        os.close(terminal)
        out = b""
        reader = threading.Thread(target=p.communicate)   # standard output
        reader.start()
        while True:
            try:
                part = os.read(main, 65536)
            except OSError:
                break
            if not part:
                break
            out += part
        os.close(main)
        reader.join()
        self.assertEqual(p.returncode, 0)
        return out.decode()

    def test_all(self):
        text = "".join(cli_test.lines(cli_test.make_samples(count=80, boards=10)).replace('"id": "', '"id": "%d_' % i) for i in range(10))
        self.write("many.jsonl", text)
        automatic = cli_test.RIG[:cli_test.RIG.index("estimate:")]
        self.write("automatic.yaml", automatic)
        trials = ("--cross-validate", "2", "--restarts", "2", "--estimate-noise", "--reject")
        for args, words in ((("calibrate", "rig.yaml", "many.jsonl", *trials), ("reading many.jsonl", "all: iteration ", "uncertainties", "cross-validation 50 %", "restarts 50 %", "noise, round ",
                                                                               "looking for outliers", "writing")),
                            (("calibrate", "automatic.yaml", "many.jsonl"), ("starting values", "widths, round 1", "selecting parameters by evidence")),
                            (("evaluate", "rig.yaml", "many.jsonl"), ("reading", "evaluating")), (("check", "rig.yaml", "many.jsonl"), ("reading",)),
                            (("local", "rig.yaml", "many.jsonl", "--near", "1_arm_000"), ("reading", "calibrating locally")),
                            (("simulate", "rig.yaml", "--samples", "2000", "--seed", "1"), ("simulating",))):
            with self.subTest(args=args):
                command = args[0]
                if command in ("calibrate", "simulate"):
                    args += ("--out", "out", "--force")
                if command != "simulate":
                    self.assertEqual([x for x in self.run_kincal(*args).err.splitlines() if not x.startswith("kincal: ")], [])
                said = self.on_terminal(*args)
                for word in words:
                    self.assertIn(word, said)
                lines = said.split("\r\n")
                for line in lines[:-1]:          # warnings stand in lines of their own
                    self.assertRegex(line, r"(^|\x1b\[K)kincal: warning: ")
                self.assertRegex(lines[-1], r"(^|\x1b\[K)$")
                self.assertIn("\r\x1b[K", said)
                for shown in said.split("\r"):
                    if "warning" not in shown:
                        self.assertLess(len(shown), 90)
                if command in ("calibrate", "check"):
                    self.assertNotIn("\x1b", self.on_terminal(*args, "--quiet"))

    def test_interrupted(self):
        """The line is gone before the last word."""
        main, terminal = pty.openpty()
        p = self.start("simulate", "rig.yaml", "--samples", "1000000", "--seed", "1", "--out", "new", stderr=terminal)
        os.close(terminal)
        time.sleep(0.5)
        p.send_signal(signal.SIGTERM)
        p.communicate()
        said = b""
        try:
            while more := os.read(main, 65536):  # one read need not give all
                said += more
        except OSError:  # Linux's end of a terminal that nobody has open any more
            pass
        self.assertRegex(said.decode(), r"\r\x1b\[Kkincal: interrupted, nothing written\r\n$")
        os.close(main)
        self.assertEqual(p.returncode, 130)


class Hardened(unittest.TestCase):
    """The program is built with what makes mistakes in memory harmless."""

    def setUp(self):
        if not shutil.which("readelf") or not sys.platform.startswith("linux"):
            self.skipTest("no readelf")
        if cli_test.sanitized():
            self.skipTest("sanitizers look themselves")

    def readelf(self, *args):
        return subprocess.run(["readelf", "-W", *args, KINCAL], stdout=subprocess.PIPE, check=True, env=dict(os.environ, LC_ALL="C")).stdout.decode()

    def test_all(self):
        self.assertRegex(self.readelf("-h"), r"Type: +DYN")                      # anywhere in memory
        segments, dynamic, symbols = self.readelf("-l"), self.readelf("-d"), self.readelf("--dyn-syms")
        self.assertRegex(segments, r"GNU_RELRO")                                 # tables of addresses are read-only ...
        self.assertRegex(dynamic, r"BIND_NOW|FLAGS_1.*\bNOW\b")                  # ... and complete from the start
        self.assertRegex(segments, r"GNU_STACK +\S+ +\S+ +\S+ +\S+ +\S+ +RW ")  # no code on the stack
        self.assertIn("__stack_chk_fail", symbols)
        self.assertRegex(symbols, r"__\w+_chk@")                                 # -D_FORTIFY_SOURCE


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    KINCAL = os.path.abspath(sys.argv[2])
    cli_test.SOURCE_DIR, cli_test.KINCAL = os.path.abspath(sys.argv[1]), KINCAL
    unittest.main(argv=[sys.argv[0]] + sys.argv[3:])
