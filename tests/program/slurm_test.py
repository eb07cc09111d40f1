"""A fleet on a cluster: python3 slurm_test.py SOURCE_DIR KINCAL [TEST ...]

Starts a Slurm of one node for itself (slurm_cluster.py) and makes a fleet of copies of examples/arm. Proves, of `kincal batch --slurm`:
files, output and exit code are those of the same command without it, byte for byte but for times and the command line, with paths that
the shell would split; after a task that is killed, a job that is cancelled, a task that Slurm starts again, a submitter that is killed
or interrupted, the same command ends with all sets, and no result is written twice; with --detach it returns at once, then tells how
far it is, then ends with the summary; squeue may fail for a while; what Slurm refuses is told in its own words, and a folder that the
node does not see is found out. Ends with 77, skipped, where there is no Slurm to be had. It does not prove anything of several nodes,
nor of network file systems: the one node has the folder on its own disk.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import helpers
import slurm_cluster

SOURCE_DIR = KINCAL = CLUSTER = None
NOT_A_SET = (".batch", "report.html", "summary.csv", "summary.json")
SLOW = ("--cross-validate", "12")     # about a quarter of a second a set


class Case(unittest.TestCase):
    maxDiff = 2000

    @classmethod
    def setUpClass(cls):
        cls.root = tempfile.mkdtemp(prefix="kincal slurm's ")      # what a careless script would split or end a word at
        example = os.path.join(SOURCE_DIR, "examples", "arm")
        cls.original = os.path.join(cls.root, "original")
        for i in range(3):
            subprocess.run([KINCAL, "simulate", os.path.join(example, "rig.yaml"), "--samples", "30", "--seed", str(i + 1), "--truth",
                            os.path.join(example, "truth.json"), "--postures", os.path.join(example, "postures.jsonl"), "--out",
                            os.path.join(cls.root, "simulated"), "--quiet"], check=True, stdout=subprocess.DEVNULL)
            for k in range(i, 12, 3):
                folder = os.path.join(cls.original, "robot %d" % k)
                shutil.copytree(os.path.join(cls.root, "simulated"), folder)
                for name in ("rig.yaml", "robot.urdf"):
                    shutil.copy(os.path.join(example, name), folder)
            shutil.rmtree(os.path.join(cls.root, "simulated"))

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.root, ignore_errors=True)

    def setUp(self):
        self.dir = tempfile.mkdtemp(dir=self.root)
        shutil.copytree(self.original, self.path("my fleet"))
        self.addCleanup(CLUSTER.end_jobs)

    def path(self, *names):
        return os.path.join(self.dir, *names)

    def read(self, *names):
        with open(self.path(*names), encoding="utf-8", newline="") as file:
            return file.read()

    def command(self, *args, out="out"):
        return [KINCAL, "batch", "my fleet", "--out", out, *args]

    def batch(self, *args, out="out", env=None):
        return subprocess.run(self.command(*args, out=out), cwd=self.dir, env=env or CLUSTER.env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, universal_newlines=True, timeout=200)

    def start(self, *args, env=None):
        return helpers.start(self, self.command(*args), env=env or CLUSTER.env, start_new_session=True, universal_newlines=True)

    def close_gates(self, tasks):
        """The samples of the last set of each task are a pipe, at which it waits until they are opened: however slow the machine is, it is not done before."""
        self.gates = [self.path("my fleet", "robot %d" % i, "samples.jsonl") for i in range(10 - tasks, 10)]
        for gate in self.gates:
            os.rename(gate, gate + ".kept")
            os.mkfifo(gate)

    def open_gates(self):
        for gate in self.gates:
            with open(gate + ".kept", "rb") as file:
                samples = file.read()
            os.rename(gate, gate + ".pipe")
            os.rename(gate + ".kept", gate)
            try:
                pipe = os.open(gate + ".pipe", os.O_WRONLY | os.O_NONBLOCK)
            except OSError:      # nobody waits
                continue
            os.set_blocking(pipe, True)
            with os.fdopen(pipe, "wb") as file:
                file.write(samples)

    def names(self, out="out"):
        """Of the result directories there are."""
        return sorted(name for name in os.listdir(self.path(out)) if name not in NOT_A_SET) if os.path.isdir(self.path(out)) else []

    def times(self):
        return {name: os.stat(self.path("out", name, "result.json")).st_mtime_ns for name in self.names()}

    def wait_for(self, what, process=None):
        end = time.time() + 100
        while not what():
            self.assertTrue(process is None or process.poll() is None, "it ended before")
            self.assertLess(time.time(), end, CLUSTER.logs())
            time.sleep(0.02)

    def job(self):
        return self.read("out", ".batch", "slurm", "id")

    def notes(self):
        """What the tasks noted."""
        files = [os.path.join(folder, name) for folder, _, names in os.walk(self.path("out", ".batch", "slurm")) for name in names if name.endswith(".done")]
        return "".join(self.read(path) for path in sorted(files))

    def tasks(self):
        """Process ids of the tasks of this test: children of Slurm's, not of a kincal."""
        def text(pid, name):
            with open("/proc/%s/%s" % (pid, name), "rb") as file:
                return file.read()
        found = []
        for pid in (p for p in os.listdir("/proc") if p.isdigit()):
            try:
                parent = int(text(pid, "stat").rsplit(b")", 1)[1].split()[1])
                if b"KINCAL_SLURM_TASK=" in text(pid, "environ") and os.readlink("/proc/%s/cwd" % pid) == self.dir and b"slurmstepd" in text(parent, "cmdline"):
                    found.append(int(pid))
            except OSError:
                continue
        return found

    def completes(self, before, *args):
        """The same command does the rest; what was there is not written again, nothing is left over, and the summary is that of one machine."""
        self.assertGreater(len(before), 0)
        self.assertLess(len(before), 12)
        run = self.batch(*args)
        self.assertEqual(run.returncode, 0, run.stderr)
        after = self.times()
        self.assertEqual((len(after), {name: after[name] for name in before}), (12, before))
        self.assertEqual(os.listdir(self.path("out", ".batch")), ["lock"])
        return run

    def fake(self, name, script):
        """An environment whose PATH has a program of this name before Slurm's."""
        os.makedirs(self.path("bin"), exist_ok=True)
        with open(self.path("bin", name), "w") as file:
            file.write("#!/bin/sh\n" + script)
        os.chmod(self.path("bin", name), 0o755)
        return dict(CLUSTER.env, PATH=self.path("bin") + ":" + CLUSTER.env["PATH"])


def without_times(name, text):
    if name in ("result.json", "batch.json", "summary.json"):
        text = re.sub(r'"seconds": [-+0-9.e]+', "", text)
        text = re.sub(r'"(command|date)": "[^"]*"', "", text)
    if name == "report.html":
        text = re.sub(r'"(command|date|seconds)":("[^"]*"|[-+0-9.e]+)|\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ', "", text)
    return text


class Same(Case):
    def test_as_on_one_machine(self):
        samples = self.read("my fleet", "robot 4", "samples.jsonl")
        with open(self.path("my fleet", "robot 4", "samples.jsonl"), "w") as file:
            file.write(samples.replace('"pixels"', '"pixls"', 1))       # an error of this set's
        shutil.copytree(self.path("my fleet", "robot 5"), self.path("my fleet", "it's"))
        os.remove(self.path("my fleet", "robot 6", "rig.yaml"))         # a set that cannot even be tried
        options = ("--fix", "joint/*_roll/offset", "--require", "sensor/camera < 5px", "--write-reduction")
        one = self.batch(*options, out="one")
        many = self.batch(*options, "--slurm", "--tasks", "3", "--partition", "main", "--sbatch", "--comment='two words' --time=10")
        self.assertEqual((one.returncode, many.returncode), (1, 1), many.stderr)
        self.assertEqual(many.stdout, one.stdout.replace("Written to one", "Written to out"))
        errors = [sorted(line for line in run.stderr.splitlines() if line.startswith("kincal: ")) for run in (one, many)]
        self.assertEqual(errors[0], errors[1])
        self.assertRegex(many.stderr, r"Slurm job \d+: 12 sets in 3 tasks; Ctrl-C cancels it\n")
        self.assertIn("12 of 12 sets, 1 failing", many.stderr)
        self.assertEqual(len(self.names()), 11)
        files = [sorted(os.path.relpath(os.path.join(folder, name), self.path(out)) for folder, _, names in os.walk(self.path(out)) for name in names)
                 for out in ("one", "out")]
        self.assertEqual(files[0], files[1])
        self.assertGreater(len(files[0]), 100)
        for path in files[0]:
            name = os.path.basename(path)
            self.assertEqual(without_times(name, self.read("one", path)), without_times(name, self.read("out", path)), path)
        command = json.loads(self.read("out", "robot 1", "result.json"))["input"]["command"]
        self.assertTrue(command.endswith("--sbatch --comment='two words' --time=10"), command)
        # with and without Slurm are one batch
        before = self.times()
        run = self.batch(*options)
        self.assertIn("11 done before", run.stderr)
        self.assertEqual(self.times(), before)


class Ends(Case):
    def wait_at_gates(self, tasks, p=None):
        """Until the tasks that have a processor have done all but their last sets, whose gates are closed."""
        self.wait_for(lambda: len(self.names()) == min(tasks, CLUSTER.cpus) * (12 // tasks - 1), p)

    def start_to_gates(self, tasks, *args):
        self.close_gates(tasks)
        p = self.start("--slurm", "--tasks", str(tasks), *args)
        self.wait_at_gates(tasks, p)
        return p

    def test_killed_task(self):
        """kill -9 of one task: its share is left, which ends with 1 and no summary; the same command does the rest."""
        p = self.start_to_gates(2)
        os.kill(self.tasks()[0], signal.SIGKILL)
        self.wait_for(lambda: len(self.tasks()) == 1, p)
        self.open_gates()
        out, err = p.communicate(timeout=100)
        self.assertEqual((p.returncode, out), (1, ""), err)
        self.assertRegex(err, r"kincal: error: Slurm job \d+ ended with 11 of 12 sets done: task [01]: FAILED; the same command goes on\n$")
        self.assertFalse(os.path.exists(self.path("out", "summary.csv")))
        run = self.completes(self.times(), "--slurm", "--tasks", "2")
        self.assertRegex(run.stderr, r"Slurm job \d+ ended with 11 of 12 sets done: ")
        alone = self.batch(out="alone")
        self.assertEqual((alone.returncode, self.read("alone", "summary.csv")), (0, self.read("out", "summary.csv")))

    def test_cancelled_job(self):
        p = self.start_to_gates(4)
        CLUSTER.run("scancel", self.job())
        out, err = p.communicate(timeout=100)
        self.assertEqual((p.returncode, out), (1, ""), err)
        self.assertRegex(err, r"task [0-3, ]+: CANCELLED.*; the same command goes on\n$")
        self.assertNotIn("Terminated", err)      # no set failed by that
        self.open_gates()
        self.completes(self.times(), "--slurm", "--tasks", "4")

    def test_requeued_task(self):
        """As after a node that was lost: the task starts again and goes on where it was; the submitter just waits."""
        p = self.start_to_gates(1)
        CLUSTER.run("scontrol", "requeue", self.job() + "_0")
        self.wait_for(lambda: not self.tasks(), p)
        before = self.times()
        self.open_gates()
        # Slurm lets such a task wait for two minutes, unless it is told not to; a node takes none back within a second
        self.wait_for(lambda: "BeginTime" in CLUSTER.run("squeue", "-h", "-j", self.job(), "-o", "%r"), p)
        time.sleep(2)
        CLUSTER.run("scontrol", "update", "JobId=" + self.job(), "StartTime=now")
        self.wait_for(lambda: self.notes().count("start ") == 2, p)
        out, err = p.communicate(timeout=100)
        self.assertEqual(p.returncode, 0, err)
        after = self.times()
        self.assertEqual(len(before), 11)
        self.assertEqual((len(after), {name: after[name] for name in before}), (12, before))

    def test_interrupted(self):
        """Ctrl-C cancels the job; what is finished stays."""
        p = self.start_to_gates(3)
        os.killpg(p.pid, signal.SIGINT)
        out, err = p.communicate(timeout=60)
        self.assertEqual((p.returncode, out), (130, ""), err)
        self.assertRegex(err, r"kincal: interrupted; \d+ of 12 sets done, the same command goes on\n$")
        self.open_gates()
        self.completes(self.times(), "--slurm", "--tasks", "3")

    def test_killed_submitter(self):
        """The job goes on, and the same command waits for it: there is no second one. Until then the folder is the job's."""
        p = self.start_to_gates(2, "--quiet", "--fix", "joint/*_roll/offset")
        p.kill()
        p.communicate()
        job = self.job()
        options = ("--fix", "joint/*_roll/offset")
        for args, words in ((options, "Slurm job %s is writing here: `scancel %s` ends it, --slurm waits for it" % (job, job)),
                            (("--slurm",), "Slurm job %s is writing here, with other options (" % job)):
            run = self.batch(*args)
            self.assertEqual((run.returncode, run.stdout), (1, ""), run.stderr)
            self.assertIn(words, run.stderr)
        p = self.start("--slurm", *options)
        self.open_gates()
        out, err = p.communicate(timeout=100)
        self.assertEqual(p.returncode, 0, err)
        self.assertNotIn("in 1 task", err)
        self.assertEqual(int(CLUSTER.run("sbatch", "--parsable", "--wrap", "true")), int(job) + 2)     # the array's two, and this
        self.assertEqual(len(self.names()), 12)

    def test_unknown_job(self):
        """A submitter that is killed before it could note the job's number: the next one submits another, and the tasks of the first give up."""
        self.close_gates(2)
        self.assertEqual(self.batch("--slurm", "--tasks", "2", "--detach").returncode, 0)
        self.wait_at_gates(2)
        os.remove(self.path("out", ".batch", "slurm", "id"))
        p = self.start("--slurm", "--tasks", "2", env=self.fake("srun", "exit 1\n"))     # there is no time to lose
        self.wait_for(lambda: os.path.exists(self.path("out", ".batch", "slurm", "id")), p)
        self.open_gates()
        out, err = p.communicate(timeout=100)
        self.assertEqual(p.returncode, 0, err)
        self.assertIn(" sets in 2 tasks", err)
        self.assertEqual(len(self.names()), 12)
        self.assertEqual(os.listdir(self.path("out", ".batch")), ["lock"])
        states = dict(line.split() for line in CLUSTER.run("squeue", "-h", "--array", "--states=all", "-o", "%A %T").splitlines())
        self.assertEqual([states[job] for job in sorted(states, key=int)][-4:], ["FAILED"] * 2 + ["COMPLETED"] * 2)

    def test_two_at_once(self):
        p = self.start_to_gates(1, "--quiet")
        second = self.batch("--slurm")
        self.assertEqual(second.returncode, 1)
        self.assertIn("another batch is writing here", second.stderr)
        self.open_gates()
        out, err = p.communicate(timeout=100)
        self.assertEqual((p.returncode, out, err), (0, "", ""))


class Detached(Case):
    def test_detach(self):
        begin = time.time()
        run = self.batch("--slurm", "--tasks", "2", "--detach", *SLOW)
        self.assertEqual((run.returncode, run.stdout), (0, ""), run.stderr)
        self.assertRegex(run.stderr, r"Slurm job \d+: 12 sets in 2 tasks; the same command shows how far it is\n$")
        seen = set()
        while not os.path.exists(self.path("out", "summary.csv")):
            self.assertLess(time.time() - begin, 100)
            run = self.batch("--slurm", "--tasks", "2", "--detach", *SLOW)
            self.assertEqual(run.returncode, 0, run.stderr)
            match = re.search(r"Slurm job \d+: (\d+) of 12 sets done; \d tasks? runs?, \d wait", run.stderr)
            if match:
                seen.add(int(match.group(1)))
                self.assertEqual(run.stdout, "")
            time.sleep(0.5)
        self.assertGreater(len(seen), 1)
        self.assertIn("12 sets, 12 converged", run.stdout)
        self.assertEqual(len(self.names()), 12)

    def test_input_that_changed(self):
        """What was changed since the job calibrated it is not taken for done."""
        self.assertEqual(self.batch("--slurm", "--detach").returncode, 0)
        self.wait_for(lambda: self.notes().count(" result ") == 12)
        before = self.times()
        with open(self.path("my fleet", "robot 7", "samples.jsonl"), "a") as file:
            file.write("\n")
        run = self.batch("--slurm")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertRegex(run.stderr, r"1 again: robot 7 \(samples changed\)\n.*11 of 12 sets done\nSlurm job \d+: 1 set in 1 task; ")
        after = self.times()
        self.assertEqual([name for name in after if after[name] != before[name]], ["robot 7"])


class Slurm(Case):
    def refused(self, run, *words):
        self.assertEqual((run.returncode, run.stdout), (1, ""), run.stderr)
        self.assertEqual(run.stderr.count("kincal: error: "), 1, run.stderr)
        for word in words:
            self.assertIn(word, run.stderr)
        self.assertFalse(os.path.exists(self.path("out", ".batch", "slurm")))
        self.assertEqual(self.names(), [])

    def test_wrong_use(self):
        self.refused(self.batch("--slurm", env=dict(CLUSTER.env, PATH=self.dir)), "sbatch is not in PATH")
        self.refused(self.batch("--slurm", "--partition", "nope"), "no job was submitted", "invalid partition specified: nope")
        self.refused(self.batch("--slurm", "--sbatch", "--no-such-option"), "no job was submitted", "no-such-option")
        self.refused(self.batch("--slurm", "--sbatch", "--comment='a"), "--sbatch: a quote is never closed")
        for option in (("--partition", "main"), ("--tasks", "2"), ("--sbatch", "--time=1"), ("--detach",)):
            self.refused(self.batch(*option), option[0], "--slurm")
        self.refused(self.batch("--slurm", "--tasks", "0"), "--tasks")

    def test_squeue_fails(self):
        """For a while: the results are what counts."""
        env = self.fake("squeue", "n=$(cat '%s' 2>/dev/null || echo 0); echo $((n + 1)) > '%s'\n[ $n -ge 2 ] || { echo 'squeue: Unable to contact slurm controller' >&2; exit 1; }\n"
                        "exec env PATH='%s' squeue \"$@\"\n" % (("count",) * 2 + (CLUSTER.env["PATH"],)))
        run = self.batch("--slurm", env=env)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertGreater(int(self.read("count")), 0)

    def test_not_shared(self):
        """A folder that only the submitter sees, by a file system that it alone has mounted there."""
        alone = ["unshare", "--mount", "sh", "-c", 'mount -t tmpfs none "$0" && cd / && cd "$OLDPWD" && exec "$@"', self.path("out")]
        os.mkdir(self.path("out"))
        if subprocess.run(alone + ["true"], cwd=self.dir, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode != 0:
            self.skipTest("no file system can be mounted for one process")

        def batch(env):
            return subprocess.run(alone + self.command("--slurm", "--tasks", "2"), cwd=self.dir, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                  stderr=subprocess.PIPE, universal_newlines=True, timeout=100)
        self.refused(batch(CLUSTER.env), "a node does not see " + self.path("out"), "must be shared")
        # where no node has time for that question, the tasks find it out
        run = batch(self.fake("srun", "exit 1\n"))
        self.assertEqual((run.returncode, run.stdout), (1, ""), run.stderr)
        self.assertRegex(run.stderr, r"ended with 0 of 12 sets done: task 0, 1: FAILED \(on localhost, where .*/out/.batch/slurm cannot be written: the folder must be shared")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    SOURCE_DIR, KINCAL = (os.path.abspath(p) for p in sys.argv[1:3])
    try:
        with slurm_cluster.Cluster() as CLUSTER:
            unittest.main(argv=[sys.argv[0]] + sys.argv[3:])
    except slurm_cluster.Unavailable as error:
        print("skipped: %s" % error)
        sys.exit(77)
