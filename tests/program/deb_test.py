"""The Debian packages of cpack. Usage: deb_test.py SOURCE_DIR BUILD_DIR GROUP

Packages proves: cpack makes three packages, libkincal0 where the C interface is built, and python3-kincal where the Python package is, which works as unpacked, as the wheel does; no file is in two of them; the programs, a manual page for each program and command, the
completion, headers, libraries and the CMake package are in the right one; each names what it needs (what its programs are linked to, and no
more: kincal no OpenCV); pages have every option of the help and troff reads them without a warning; the completion knows every command and option, and completes.
Root proves: in a Debian of its own (mmdebstrap) apt installs them with what they depend on; the example runs there; tests/consumer is built from
the installed package and works; all is removed again. It takes minutes and the network: only with KINCAL_SLOW=1, as root, where mmdebstrap is;
else it is skipped (77). Does not prove: what lintian says, nor other releases than that of the machine.
"""
import glob
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

import helpers

SOURCE, BUILD, GROUP = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2]), sys.argv[3]
SKIPPED = 77
IMAGES = os.path.exists(os.path.join(BUILD, "kincal-detect"))
C = os.path.exists(os.path.join(BUILD, "libkincal.so"))
PYTHON = os.path.exists(os.path.join(BUILD, "python", "kincal", "_kincal.pyi"))
LIBRARIES = ("kinematics", "solver", "core", "models", "io")


def run(*command, **more):
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **more)
    if done.returncode != 0:
        raise AssertionError("%s\nended with %d\n%s" % (" ".join(command), done.returncode, done.stdout[-4000:]))
    return done.stdout


def make_packages(folder):
    """name -> file"""
    run("cpack", "--config", os.path.join(BUILD, "CPackConfig.cmake"), "-B", folder, "-D", "CPACK_DEBIAN_COMPRESSION_TYPE=gzip")
    files = glob.glob(os.path.join(folder, "*.deb"))
    return {os.path.basename(f).split("_")[0]: f for f in files}


def contents(package):
    return {line.split(None, 5)[5].split(" -> ")[0][1:] for line in run("dpkg-deb", "-c", package).splitlines() if not line.startswith("d")}


def field(package, name):
    return run("dpkg-deb", "-f", package, name).strip()


class Packages(helpers.Folder):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="kincal_deb_")
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.packages = make_packages(cls.folder)
        cls.contents = {name: contents(file) for name, file in cls.packages.items()}

    def test_what_is_where(self):
        self.assertEqual(sorted(self.packages), ["kincal"] + (["kincal-images"] if IMAGES else []) + ["libkincal-dev"] + (["libkincal0"] if C else []) + (["python3-kincal"] if PYTHON else []))
        names = list(self.contents)
        for i, a in enumerate(names):
            for b in names[:i]:
                self.assertEqual(self.contents[a] & self.contents[b], set())
            self.assertIn("/usr/share/doc/%s/copyright" % a, self.contents[a])
        kincal = self.contents["kincal"]
        self.assertEqual([f for f in kincal if f.startswith("/usr/bin/")], ["/usr/bin/kincal"])
        self.assertIn("/usr/share/bash-completion/completions/kincal", kincal)
        for command in self.commands():
            self.assertIn("/usr/share/man/man1/kincal-%s.1" % command, kincal)
        self.assertIn("/usr/share/man/man1/kincal.1", kincal)
        if IMAGES:
            programs = {f for f in self.contents["kincal-images"] if f.startswith("/usr/bin/")}
            self.assertLessEqual({"/usr/bin/kincal-detect", "/usr/bin/kincal-render"}, programs)
            for program in programs:
                page = "/usr/share/man/man1/%s.1" % os.path.basename(program)
                self.assertTrue(page in kincal or page in self.contents["kincal-images"], page)
        dev = self.contents["libkincal-dev"]
        for name in LIBRARIES:
            self.assertTrue(any(f.endswith("/libkincal_%s.a" % name) for f in dev))
            self.assertTrue(any(f.endswith("/cmake/kincal/kincal_%s_targets.cmake" % name) for f in dev))
        self.assertIn("/usr/include/kincal/kincal.h", dev)
        self.assertTrue(any(f.endswith("/kincalConfigVersion.cmake") for f in dev))
        if C:
            for end in ("/libkincal.so", "/include/kincal.h", "/pkgconfig/kincal.pc", "/cmake/kincal/kincal_c_targets.cmake"):
                self.assertTrue(any(f.endswith(end) for f in dev), end)
            self.assertTrue(any(f.endswith("/libkincal.so.0") for f in self.contents["libkincal0"]))
        for files in self.contents.values():
            self.assertFalse([f for f in files if not f.startswith("/usr/")])

    def test_what_they_need(self):
        version = field(self.packages["kincal"], "Version")
        depends = field(self.packages["kincal"], "Depends")
        for library in ("libc6", "libstdc++6", "liburdfdom", "libyaml-cpp", "libpugixml", "libnettle"):
            self.assertIn(library, depends)
        self.assertNotIn("opencv", depends)
        self.assertIn("kincal-images (= %s)" % version, field(self.packages["kincal"], "Recommends"))
        if IMAGES:
            depends = field(self.packages["kincal-images"], "Depends")
            self.assertIn("libopencv", depends)
            self.assertIn("kincal (= %s)" % version, depends)
        depends = field(self.packages["libkincal-dev"], "Depends")
        for library in ("libeigen3-dev", "libpugixml-dev", "libyaml-cpp-dev", "nlohmann-json3-dev", "liburdfdom-dev", "nettle-dev", "pkg-config"):
            self.assertIn(library, depends)

        if C:
            needed = field(self.packages["libkincal0"], "Depends")
            self.assertIn("libyaml-cpp", needed)
            self.assertNotIn("opencv", needed)
            self.assertIn("libkincal0 (= %s)" % version, depends)
            self.assertIn("ldconfig", run("dpkg-deb", "-I", self.packages["libkincal0"], "postinst"))

    def works(self, folder):
        """The package as it stands in a folder."""
        code = ("import kincal; r = kincal.calibrate('rig.yaml', 'samples.jsonl'); assert r.use == 'good', r; assert kincal.__file__.startswith(%r), kincal.__file__" % folder)
        run(sys.executable, "-B", "-c", code, cwd=os.path.join(SOURCE, "examples", "pr2"), env={**os.environ, "PYTHONPATH": folder})

    def test_python(self):
        if not PYTHON:
            self.skipTest("the Python package is not built")
        package = self.packages["python3-kincal"]
        self.assertLessEqual({"/usr/lib/python3/dist-packages/kincal/" + f for f in ("__init__.py", "_kincal.pyi", "py.typed")}, self.contents["python3-kincal"])
        self.assertFalse([f for f in self.contents["python3-kincal"] if "__pycache__" in f])
        depends = field(package, "Depends")
        for needed in ("python3 (>= 3.", "python3 (<< 3.", "python3-numpy", "libyaml-cpp", "libc6"):
            self.assertIn(needed, depends)
        self.assertNotIn("opencv", depends)
        run("dpkg-deb", "-x", package, self.path("python"))
        self.works(self.path("python", "usr/lib/python3/dist-packages"))
        version = field(package, "Version")
        wheels = [run(sys.executable, "-B", os.path.join(SOURCE, "bindings", "python", "make_wheel.py"), os.path.join(BUILD, "python", "kincal"), version, SOURCE, self.dir).strip() for _ in range(2)]
        self.assertRegex(os.path.basename(wheels[0]), r"^kincal-%s-cp3\d+-cp3\d+-linux_\w+\.whl$" % re.escape(version))
        if subprocess.run([sys.executable, "-m", "pip", "--version"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode != 0:
            self.skipTest("no pip")
        run(sys.executable, "-m", "pip", "install", "--no-index", "--no-deps", "--no-compile", "--target", self.path("wheel"), wheels[0])
        self.works(self.path("wheel"))

    def commands(self):
        text = run(os.path.join(BUILD, "kincal"), "--help").split("Subcommands:")[1].split("\n\n")[0]
        return re.findall(r"^  (\w+)", text, re.M)

    def unpacked(self):
        root = self.path("root")
        if not os.path.exists(root):
            run("dpkg-deb", "-x", self.packages["kincal"], root)
        return root

    def test_manual_pages(self):
        pages = os.path.join(self.unpacked(), "usr/share/man/man1")
        for command in [None] + self.commands():
            page = os.path.join(pages, "kincal%s.1" % ("-" + command if command else ""))
            with open(page, encoding="utf-8") as f:
                text = f.read().replace("\\-", "-")
            for section in ("NAME", "SYNOPSIS", "DESCRIPTION", "OPTIONS"):
                self.assertIn(".SH " + section, text)
            help_text = run(os.path.join(BUILD, "kincal"), *([command] if command else []), "--help")
            for option in re.findall(r"^  (--[a-z-]+)", help_text, re.M):
                self.assertIn(option, text, page)
            if shutil.which("groff"):
                done = subprocess.run(["groff", "-man", "-Tutf8", "-ww", "-z", page], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
                self.assertEqual((done.returncode, done.stdout), (0, ""), page)

    def complete(self, *words):
        script = os.path.join(self.unpacked(), "usr/share/bash-completion/completions/kincal")
        text = 'compopt() { :; }; source "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _kincal; echo "${COMPREPLY[@]}"'
        return run("bash", "-c", text, "bash", script, "kincal", *words).split()

    def test_completion(self):
        commands = self.commands()
        self.assertEqual(self.complete("")[:len(commands)], commands)
        self.assertEqual(self.complete("cali"), ["calibrate"])
        for command in commands:
            help_text = run(os.path.join(BUILD, "kincal"), command, "--help")
            for option in re.findall(r"^  (?:-\w,)?(--[a-z-]+)", help_text, re.M):
                self.assertIn(option, self.complete(command, "--"))
        self.assertEqual(sorted(self.complete("calibrate", "--noise", "")), ["latent", "marginal", "none", "point"])
        self.assertEqual(self.complete("calibrate", "--out", "re"), [])  # files are the shell's
        self.assertEqual(self.complete("calibrate", ""), [])


class Root(unittest.TestCase):
    def test_installed(self):
        if os.environ.get("KINCAL_SLOW") != "1" or os.geteuid() != 0 or not shutil.which("mmdebstrap"):
            self.skipTest("needs KINCAL_SLOW=1, root and mmdebstrap")
        with open("/etc/os-release") as f:
            release = re.search(r"VERSION_CODENAME=(\w+)", f.read()).group(1)
        folder = tempfile.mkdtemp(prefix="kincal_root_")
        self.addCleanup(shutil.rmtree, folder, ignore_errors=True)
        packages = make_packages(os.path.join(folder, "packages"))
        root = os.path.join(folder, "root")
        sources = [s for s in ("/etc/apt/sources.list.d/debian.sources", "/etc/apt/sources.list") if os.path.exists(s)][:1]
        made = subprocess.run(["mmdebstrap", "--variant=minbase", "--include=cmake,g++,make,ca-certificates", release, root, *sources],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if made.returncode != 0:
            self.skipTest("mmdebstrap makes no root here:\n" + made.stdout[-2000:])

        def inside(command):
            return run("chroot", root, "env", "-i", "PATH=/usr/sbin:/usr/bin:/sbin:/bin", "DEBIAN_FRONTEND=noninteractive", "LC_ALL=C.UTF-8", "sh", "-ec", command)

        for file in packages.values():
            shutil.copy(file, os.path.join(root, "tmp"))
        if os.path.exists("/etc/resolv.conf"):
            shutil.copy("/etc/resolv.conf", os.path.join(root, "etc/resolv.conf"))
        for name in ("examples", "tests/consumer"):
            shutil.copytree(os.path.join(SOURCE, name), os.path.join(root, "srv", name))
        inside("apt-get update -q; apt-get install -qy --no-install-recommends /tmp/kincal_*.deb")
        self.assertNotIn("opencv", inside("dpkg -l"))  # kincal stays light
        inside("cd /srv/examples/pr2; kincal calibrate rig.yaml samples.jsonl --out /srv/pr2; test -s /srv/pr2/robot.urdf; kincal completion bash > /dev/null")
        inside("apt-get install -qy --no-install-recommends /tmp/libkincal-dev_*.deb")
        inside("cmake -S /srv/tests/consumer -B /srv/consumer -DCMAKE_BUILD_TYPE=Release; cmake --build /srv/consumer; /srv/consumer/fit_line; /srv/consumer/head_calibrator")
        if "kincal-images" in packages:
            inside("apt-get install -qy --no-install-recommends /tmp/kincal-images_*.deb; cd /srv/examples/arm; "
                   "kincal detect rig.yaml images --joints joints.csv --out /srv/arm.jsonl; kincal calibrate rig.yaml /srv/arm.jsonl --out /srv/arm")
        if "python3-kincal" in packages:
            inside("apt-get install -qy --no-install-recommends /tmp/python3-kincal_*.deb; cd /srv/examples/pr2; "
                   "python3 -c \"import kincal; assert kincal.calibrate('rig.yaml', 'samples.jsonl').use == 'good'\"")
        inside("apt-get purge -qy 'kincal*' '*-kincal' libkincal-dev; test ! -e /usr/bin/kincal; test ! -e /usr/include/kincal")


if __name__ == "__main__":
    del sys.argv[1:]
    result = unittest.main(defaultTest=GROUP, exit=False).result
    for _, reason in result.skipped:
        print("skipped: " + reason)
    sys.exit(1 if not result.wasSuccessful() else SKIPPED if result.skipped else 0)
