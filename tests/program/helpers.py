"""What several tests of the program share: an arm's URDF, and a process that ends with its test."""

import subprocess

# Origin and axis of the joints of an arm with six axes.
ARM = [("0 0 0.3", "0 0 1"), ("0.05 0 0.1", "0 1 0"), ("0.4 0 0", "0 1 0"), ("0.3 0 0.05", "1 0 0"), ("0.1 0 0", "0 1 0"), ("0.08 0 0", "1 0 0")]


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
