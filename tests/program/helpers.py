"""What several tests of the program share: a folder of a test's own, an arm's URDF, a process that ends with its test, and what only scripts/test-all runs."""

import os
import shutil
import subprocess
import tempfile
import unittest

SLOW = bool(os.environ.get("KINCAL_SLOW"))   # set by scripts/test-all

# Origin and axis of the joints of an arm with six axes.
ARM = [("0 0 0.3", "0 0 1"), ("0.05 0 0.1", "0 1 0"), ("0.4 0 0", "0 1 0"), ("0.3 0 0.05", "1 0 0"), ("0.1 0 0", "0 1 0"), ("0.08 0 0", "1 0 0")]


def slow(reason):
    """A test for scripts/test-all alone; the reason is what proves its path in scripts/test."""
    return unittest.skipUnless(SLOW, "scripts/test-all sets KINCAL_SLOW; " + reason)


def some(values, count):
    """All of the values in scripts/test-all, else the first ones: seeds and the like, of which each takes the same path."""
    return list(values) if SLOW else list(values)[:count]


class Folder(unittest.TestCase):
    """A test with a folder of its own, `dir`."""

    def setUp(self):
        self.dir = tempfile.mkdtemp(prefix="kincal_test_")
        self.addCleanup(shutil.rmtree, self.dir, ignore_errors=True)

    def path(self, *names):
        return os.path.join(self.dir, *names)

    def write(self, name, text):
        """Writes a text (or bytes) and returns the file's path."""
        os.makedirs(os.path.dirname(self.path(name)), exist_ok=True)
        with open(self.path(name), "wb") as file:
            file.write(text if isinstance(text, bytes) else text.encode("utf-8"))
        return self.path(name)

    def read(self, *names):
        with open(self.path(*names), encoding="utf-8") as file:
            return file.read()


def revolute(joints, parent, limit):
    """URDF lines of a row of joints and their links; joints: (joint, link, xyz, axis)."""
    lines = []
    for name, link, xyz, axis in joints:
        lines.append('<joint name="%s" type="revolute"><parent link="%s"/><child link="%s"/><origin xyz="%s"/><axis xyz="%s"/>'
                     '<limit lower="%g" upper="%g" effort="1" velocity="1"/></joint><link name="%s"/>' % (name, parent, link, xyz, axis, -limit, limit, link))
        parent = link
    return lines


def start(case, command, **more):
    """A process that is killed at the end of the test, if it still runs."""
    more = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "cwd": case.dir, **more}
    p = subprocess.Popen(command, **more)

    def end():
        if p.poll() is None:
            p.kill()
            p.communicate()
    case.addCleanup(end)
    return p
