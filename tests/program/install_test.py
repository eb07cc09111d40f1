"""kincal as a package: python3 install_test.py SOURCE_DIR BUILD_DIR [CMAKE]

Installs the build into a temporary prefix, then configures, builds and runs the project in tests/consumer (copied away) against
it with find_package: an embedding of 40 lines and a sensor type of an outside project. Proves that the installed files are
complete, with five public headers and what these need, and kincal.h of C, which pkg-config finds, and name nothing of the source or build tree; each public header compiles by
itself; and (with KINCAL_SLOW, for it takes a minute and a half) that the embedded library gives the same numbers as the installed program,
and that a sensor of one's own recovers a planted truth. It does not prove that the package works on another system.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True
import cli_test


def run(*command, cwd=None, code=0):
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("CMAKE_", "kincal_", "CPATH", "CPLUS", "LIBRARY_PATH"))}
    p = subprocess.run(command, cwd=cwd, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL)
    text = p.stdout.decode(errors="replace")
    if p.returncode != code:
        sys.exit("%s\nended with %d\n%s" % (" ".join(command), p.returncode, text[-4000:]))
    return text


def check(condition, text):
    if not condition:
        sys.exit("FAILED: " + text)


def use_c(prefix, folder):
    """A program in C, as pkg-config says it is built."""
    os.mkdir(folder)
    with open(os.path.join(folder, "main.c"), "w") as f:
        f.write("#include <kincal.h>\n#include <stdio.h>\nint main(void) { return puts(kincal_version()) < 0; }\n")
    (pc,) = [os.path.join(d, f) for d, _, files in os.walk(prefix) for f in files if f == "kincal.pc"]
    flags = run("env", "PKG_CONFIG_PATH=" + os.path.dirname(pc), "pkg-config", "--cflags", "--libs", "kincal").split()
    run("cc", "-std=c99", "-Wall", "-Werror", "main.c", *flags, "-Wl,-rpath," + os.path.dirname(os.path.dirname(pc)), "-o", "main", cwd=folder)
    check(re.match(r"\d+\.\d+\.\d+\n$", run(os.path.join(folder, "main"))), "the program in C says no version")


def main():
    if len(sys.argv) < 3:
        sys.exit("usage: install_test.py SOURCE_DIR BUILD_DIR [CMAKE]")
    source, build = (os.path.realpath(p) for p in sys.argv[1:3])
    cmake = sys.argv[3] if len(sys.argv) > 3 else shutil.which("cmake")
    with open(os.path.join(build, "CMakeCache.txt")) as f:
        cache = f.read()
    sanitizers = " ".join(sorted(set(re.findall(r"-f(?:no-)?sanitize[-=a-z,]+", cache))))   # static libraries made with them need them
    generator = re.search(r"CMAKE_GENERATOR:INTERNAL=(.*)", cache).group(1)

    with tempfile.TemporaryDirectory(prefix="kincal_install_") as work:
        work = os.path.realpath(work)
        prefix, project = os.path.join(work, "prefix"), os.path.join(work, "consumer")
        run(cmake, "--install", build, "--prefix", prefix)

        # what is there
        installed = sorted(os.path.relpath(os.path.join(d, f), prefix) for d, _, files in os.walk(prefix) for f in files)
        headers = [n for n in installed if n.endswith(".h")]
        public = [n for n in headers if not n.startswith("include/kincal/detail/")]
        c = ["include/kincal.h"] if os.path.exists(os.path.join(build, "libkincal.so")) else []
        check(public == c + ["include/kincal/%s.h" % name for name in ("core", "extend", "files", "kincal", "solver")], "public headers: %s" % public)
        if c and not sanitizers:
            use_c(prefix, os.path.join(work, "c"))
        check(os.path.join("bin", "kincal") in installed, "the program is not installed")
        check([f for f in installed if f.endswith("kincalConfig.cmake")], "kincalConfig.cmake is not installed")
        check(not [f for f in installed if f.endswith((".cpp", "_test.h"))], "sources are installed: %s" % installed)
        for name in installed:
            if name.endswith((".cmake", ".h", ".pc")):
                with open(os.path.join(prefix, name), encoding="utf-8") as f:
                    text = f.read()
                for tree in (source, build):
                    check(tree + "/" not in text and tree + '"' not in text, "%s names %s" % (name, tree))
        # what headers include is there, and nothing else
        needed = list(public)
        for name in needed:
            with open(os.path.join(prefix, name), encoding="utf-8") as f:
                for included in re.findall(r'^#include "(.*)"', f.read(), re.M):
                    there = os.path.normpath(os.path.join(os.path.dirname(name), included))
                    check(there in installed, "%s includes %s, which is not installed" % (name, there))
                    needed += [there] if there not in needed else []
        check(sorted(needed) == headers, "no public header needs %s" % sorted(set(headers) - set(needed)))
        if not os.environ.get("KINCAL_SLOW"):
            print("Files and headers only; what uses them is compiled by scripts/test-all (KINCAL_SLOW).")
            return

        # the consumer, away from the source tree
        shutil.copytree(os.path.join(source, "tests", "consumer"), project)
        for name in public:
            with open(os.path.join(project, "header_%s.cpp" % os.path.splitext(os.path.basename(name))[0]), "w") as f:
                f.write("#include <%s>\n" % os.path.relpath(name, "include"))
        run(cmake, "-S", project, "-B", os.path.join(project, "build"), "-G", generator, "-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_PREFIX_PATH=" + prefix, "-DCMAKE_CXX_FLAGS=" + sanitizers,
            "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON", "-DCMAKE_FIND_USE_PACKAGE_REGISTRY=OFF")
        with open(os.path.join(project, "build", "CMakeCache.txt")) as f:
            consumer_cache = f.read()
        found = re.search(r"kincal_DIR:PATH=(.*)", consumer_cache).group(1)
        check(os.path.realpath(found).startswith(prefix), "find_package found %s" % found)
        with open(os.path.join(project, "build", "compile_commands.json")) as f:
            commands = f.read()
        check(source + "/" not in commands and build + "/" not in commands, "the source or build tree is visible to the consumer")
        run(cmake, "--build", os.path.join(project, "build"), "--parallel", "1")
        print(run(os.path.join(project, "build", "own_sensor")), end="")
        print(run(os.path.join(project, "build", "head_calibrator")), end="")

        # the embedding against the installed program
        for name, text in (("robot.urdf", cli_test.URDF), ("rig.yaml", cli_test.RIG), ("samples.jsonl", cli_test.lines(cli_test.make_samples()))):
            with open(os.path.join(work, name), "w") as f:
                f.write(text)
        output = run(os.path.join(project, "build", "embed"), "rig.yaml", "samples.jsonl", cwd=work)
        result = json.loads(run(os.path.join(prefix, "bin", "kincal"), "calibrate", "rig.yaml", "samples.jsonl", "--out", "out", "--json", cwd=work))
        chi2, dof = re.search(r"^chi2 (\S+) dof (\d+)$", output, re.M).groups()
        check(float(chi2) == result["chi2"] and int(dof) == result["dof"], "embedded chi2 %s, the program's %.17g" % (chi2, result["chi2"]))
        components = {"": 0, "x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5}
        lines = re.findall(r"^parameter (\S+) (\S+) (\S+)$", output, re.M)
        check(len(lines) == sum(len(p["value"]) for p in result["parameters"].values()), "parameters: %s" % output)
        for name, value, sigma in lines:
            block, _, component = name.partition(".")
            p, i = result["parameters"][block], components[component]
            check(float(value) == p["value"][i] and float(sigma) == p["sigma"][i], name)
        check("sensor tracker" in output and "cancelled" not in output, output)
        error = run(os.path.join(project, "build", "embed"), "none.yaml", "samples.jsonl", cwd=work, code=1)
        check("none.yaml" in error, error)
        print("installed %d files; embedded chi2 %s" % (len(installed), chi2))


if __name__ == "__main__":
    main()
