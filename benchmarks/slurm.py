#!/usr/bin/env python3
"""What does Slurm cost a batch? Wall time of `kincal batch --slurm` over that of the same command without it, on the one node that the
script starts for itself (tests/program/slurm_cluster.py; it needs root, slurm-wlm and munge).

    benchmarks/slurm.py                                  # 5,000 sets in 50 tasks, once each way
    benchmarks/slurm.py --sets 1000 --tasks 10 --pairs 5 # five times in turns
    benchmarks/slurm.py --no-epilog                      # on a Slurm whose nodes have no Epilog (slurm_cluster.py says what that costs)

The sets are copies of --different simulated robots like examples/arm, 30 samples each. Both ways use all processors: --jobs of the one,
tasks at once of the other. Both must end with the same summary.csv. Told besides: how long a set takes a processor, how long it is from the
command to the first result, how many seconds of a processor a task costs, and what a task that does nothing costs on this Slurm.
"""
import argparse
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
sys.path.insert(0, os.path.join(ROOT, "tests", "program"))
import slurm_cluster  # noqa: E402

ARM = os.path.join(ROOT, "examples", "arm")


def make_fleet(kincal, folder, sets, different):
    """Folders with a rig, its robot and samples: those of the same robot are the same files."""
    for i in range(sets):
        robot = os.path.join(folder, "robot_%05d" % i)
        if i >= different:
            shutil.copytree(os.path.join(folder, "robot_%05d" % (i % different)), robot, copy_function=os.link)
            continue
        subprocess.run([kincal, "simulate", os.path.join(ARM, "rig.yaml"), "--samples", "30", "--seed", str(i + 1), "--truth", os.path.join(ARM, "truth.json"),
                        "--postures", os.path.join(ARM, "postures.jsonl"), "--out", robot, "--quiet"], check=True, stdout=subprocess.DEVNULL)
        for name in ("rig.yaml", "robot.urdf"):
            shutil.copy(os.path.join(ARM, name), robot)


def run(command, cluster, out):
    """Wall time, seconds to the first result, summary.csv."""
    begin = time.monotonic()
    process = subprocess.Popen(command, env=cluster.env, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    first = None
    while process.poll() is None and first is None:
        if os.path.isdir(out) and any(name.startswith("robot_") for name in os.listdir(out)):
            first = time.monotonic() - begin
        time.sleep(0.05)
    error = process.communicate()[1]
    seconds = time.monotonic() - begin
    if process.returncode != 0:
        sys.exit("%s: %s" % (" ".join(command), error.decode()[-2000:]))
    with open(os.path.join(out, "summary.csv")) as file:
        summary = file.read()
    shutil.rmtree(out)
    return seconds, first, summary


def empty_tasks(cluster, count):
    """Seconds a task of an array whose tasks do nothing."""
    begin = time.monotonic()
    cluster.run("sbatch", "--array=0-%d" % (count - 1), "--output=/dev/null", "--wrap", "true")
    while cluster.run("squeue", "-h"):
        time.sleep(0.1)
    return (time.monotonic() - begin) / count


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kincal", default=os.path.join(ROOT, "build", "release", "kincal"))
    parser.add_argument("--sets", type=int, default=5000)
    parser.add_argument("--tasks", type=int, default=50)
    parser.add_argument("--pairs", type=int, default=1)
    parser.add_argument("--different", type=int, default=20)
    parser.add_argument("--no-report", action="store_true", help="without report.html in each result")
    parser.add_argument("--no-epilog", action="store_true", help="nodes run nothing after a task")
    a = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))     # the daemons end with it
    folder = tempfile.mkdtemp(prefix="kincal_slurm_bench_")
    try:
        with slurm_cluster.Cluster(epilog=not a.no_epilog) as cluster:
            os.mkdir(os.path.join(folder, "fleet"))
            make_fleet(a.kincal, os.path.join(folder, "fleet"), a.sets, a.different)
            print("%d sets, %d tasks, %d processors, load %.1f, nodes %s an Epilog" % (a.sets, a.tasks, cluster.cpus, os.getloadavg()[0], "without" if a.no_epilog else "with"))
            print("a task that does nothing: %.2f s" % empty_tasks(cluster, 20), flush=True)
            ratios = []
            for pair in range(a.pairs):
                results = {}
                for way in ("here", "slurm") if pair % 2 == 0 else ("slurm", "here"):
                    out = os.path.join(folder, way)
                    command = [a.kincal, "batch", os.path.join(folder, "fleet"), "--out", out, "--quiet"] + ["--no-report"] * a.no_report
                    command += ["--slurm", "--tasks", str(a.tasks)] if way == "slurm" else ["--jobs", str(cluster.cpus)]
                    results[way] = run(command, cluster, out)
                here, slurm = results["here"], results["slurm"]
                if here[2] != slurm[2]:
                    sys.exit("the summaries differ")
                ratios.append(slurm[0] / here[0])
                print("here %.1f s (%.0f ms a set and processor), Slurm %.1f s (first result after %.1f s), ratio %.3f, %.2f s of a processor a task, load %.1f"
                      % (here[0], 1e3 * here[0] * cluster.cpus / a.sets, slurm[0], slurm[1], ratios[-1], (slurm[0] - here[0]) * cluster.cpus / a.tasks,
                         os.getloadavg()[0]), flush=True)
            print("median ratio %.3f" % statistics.median(ratios))
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
