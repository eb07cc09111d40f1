#!/usr/bin/env python3
"""The documents tell the truth: what README.md, docs/*.md and docs/tasks/*.md show is run.

    python3 tests/program/docs_test.py SOURCE_DIR KINCAL_BINARY

Proves: every command in a ```sh block ends with the exit status it states (0, or `# exit N` at the end of the line); blocks of one
document run in order, in one scratch copy of examples/ with the program as build/release/kincal and as `kincal` on the PATH; so do
the indented commands of the examples' README.md, and ```python blocks where the Python package is beside the program (and numpy).
The README's demo is what scripts/demo runs, and every line of it is printed by the program; times and elided lines (`...`) are not compared. Links between documents, and to their headings, lead somewhere; files of the
project that they name exist. Options that the
documents name are options of the program; docs/reference.md has all of them, and is what scripts/reference prints, ids of warnings and
mistakes included. The programs of examples/programs compile against the built libraries and print what adding-a-sensor.md and on-a-robot.md
show; these documents show lines of them. The check of derivatives passes, and the joint model inverts. The README's C++ compiles. No document names
a path of one machine.
Does not prove: that other shown output is today's (but for adding-a-sensor.md and on-a-robot.md), nor that the text is right.
"""
import contextlib
import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile

UNTESTED = ("kincal batch fleet --out results --slurm",  # needs a cluster: slurm_test.py
            "cmake --preset arm64", "cmake --build --preset arm64",  # scripts/cross-arm64
            "scripts/demo", "scripts/test", "git clone", "apt", "apt-get", "sudo apt", "sudo apt-get")

failures = []


def fail(place, what):
    failures.append(f"{place}: {what}")


def documents(source):
    found = [os.path.join(source, name) for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
    for folder in (os.path.join(source, "docs"), os.path.join(source, "docs", "tasks")):
        found += [os.path.join(folder, name) for name in sorted(os.listdir(folder)) if name.endswith(".md")]
    return found


def indented(path):
    """Indented lines that call the program, as one block of commands each (continued ones joined)."""
    lines, first = [], 0
    with open(path, encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            text = line.rstrip("\n")
            if lines or re.match(r"^ {4,}build/release/kincal ", text):
                first = first if lines else number
                lines.append(text.strip())
                if not text.endswith("\\"):
                    yield "sh", first, lines
                    lines = []


def blocks(path):
    """(info string, first line number, lines) of every fenced block."""
    out, start, info, lines = [], None, "", []
    with open(path, encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            fence = re.match(r"^```(.*)$", line.rstrip("\n"))
            if fence and start is None:
                start, info, lines = number + 1, fence.group(1).strip(), []
            elif fence:
                out.append((info, start, lines))
                start = None
            elif start is not None:
                lines.append(line.rstrip("\n"))
    if start is not None:
        fail(f"{path}:{start - 1}", "a fence is never closed")
    return out


def prose(path):
    """Lines outside of fenced blocks, with their numbers."""
    inside = False
    with open(path, encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            if line.startswith("```"):
                inside = not inside
            elif not inside:
                yield number, line.rstrip("\n")


# ---------------------------------------------------------------- commands
def commands(first, lines):
    """(line number, command, expected status); a backslash at the end joins lines."""
    pending, start = "", first
    for number, line in enumerate(lines, first):
        if not pending:
            start = number
        if line.endswith("\\"):
            pending += line[:-1]
            continue
        text, pending = pending + line, ""
        expected = re.search(r"#\s*exit\s+(\d+)\s*$", text)
        command = re.sub(r"\s+#\s.*$", "", " " + text).strip()
        if command and not command.startswith("#"):
            yield start, command, int(expected.group(1)) if expected else 0


@contextlib.contextmanager
def scratch_copy(source, binary):
    """A folder with examples/ and build/release/kincal, and the environment of commands in it."""
    with tempfile.TemporaryDirectory(prefix="kincal-docs-") as scratch:
        shutil.copytree(os.path.join(source, "examples"), os.path.join(scratch, "examples"))
        release = os.path.join(scratch, "build", "release")
        os.makedirs(release)
        os.symlink(os.path.abspath(binary), os.path.join(release, "kincal"))
        yield scratch, dict(os.environ, LC_ALL="C.UTF-8", PATH=release + os.pathsep + os.environ.get("PATH", ""))


def python_package(binary):
    """The folder of the Python package beside the program; None where it or numpy is missing."""
    folder = os.path.join(os.path.dirname(os.path.abspath(binary)), "python")
    return folder if os.path.isdir(os.path.join(folder, "kincal")) and importlib.util.find_spec("numpy") else None


def run(place, command, name, expected, scratch, environment):
    """Runs one command of a document and expects its exit status; `name` stands in the failure."""
    try:
        done = subprocess.run(command, cwd=scratch, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=600)
    except subprocess.TimeoutExpired:
        fail(place, f"does not end: {name}")
        return
    if done.returncode != expected:
        output = done.stdout.decode(errors="replace").strip().splitlines()
        fail(place, f"exit {done.returncode}, not {expected}: {name}\n    " + "\n    ".join(output[-5:]))


def run_document(path, source, binary):
    with scratch_copy(source, binary) as (scratch, environment):
        count = 0
        for info, first, lines in blocks(path) + list(indented(path)):
            words = info.split()
            if not words or words[0] not in ("sh", "python"):
                if words and words[0] in ("bash", "shell", "console"):
                    fail(f"{path}:{first - 1}", f"a block of commands is called ```sh, not ```{words[0]}")
                continue
            if words[1:] not in ([], ["no-test"]):
                fail(f"{path}:{first - 1}", f"unknown mark '{info}'")
                continue
            if words[0] == "python":
                package = python_package(binary)
                if package and not words[1:]:
                    count += 1
                    run(f"{path}:{first}", [sys.executable, "-c", "\n".join(lines)], "the Python", 0, scratch, dict(environment, PYTHONPATH=package))
                continue
            for number, command, expected in commands(first, lines):
                if words[1:] == ["no-test"]:
                    if re.search(r"[;&|`$]", command) or not any(command == u or command.startswith(u + " ") for u in UNTESTED):
                        fail(f"{path}:{number}", f"not among what may go untested ({', '.join(UNTESTED)}): {command}")
                    continue
                count += 1
                run(f"{path}:{number}", ["sh", "-c", command], command, expected, scratch, environment)
        return count


# ---------------------------------------------------------------- the demo of the README
def without_times(text):
    return re.sub(r"\b\d+(\.\d+)? ?(s|ms|min)\b", "TIME", text)


def is_printed(shown, printed):
    """Shown lines are the printed ones, in their order; a line `...` stands for any lines, ` ...` at the end of a line for its rest."""
    pattern = ""
    for line in shown:
        rest = r"[^\n]*" if line.endswith(" ...") else ""
        pattern += r"(?:[^\n]*\n)*?" if line.strip() == "..." else re.escape(without_times(line[:-3] if rest else line.rstrip())) + rest + r"\n"
    return re.fullmatch(pattern, "".join(without_times(line.rstrip()) + "\n" for line in printed)) is not None


def check_demo(source, binary):
    """The block between the marks of the README: `$ COMMAND`, then the output of the program."""
    path = os.path.join(source, "README.md")
    with open(path, encoding="utf-8") as file:
        found = re.search(r"<!-- demo output -->\n```\w*\n(.*?)```\n<!-- end of demo output -->", file.read(), re.S)
    if not found:
        fail(path, "the marks `demo output` and `end of demo output` with a block between them are expected")
        return 0
    runs = []
    for line in found.group(1).splitlines():
        if line.startswith("$ "):
            runs.append((line[2:], []))
        elif runs:
            runs[-1][1].append(line)
        elif line.strip():
            fail(path, f"the demo begins with a command, not with: {line}")
    with open(os.path.join(source, "scripts", "demo"), encoding="utf-8") as file:
        script = file.read()
    example = re.search(r"^example=(\S+)", script, re.M).group(1)
    scripted = [line.replace("$example", example) for line in re.findall(r"^show (.*)", script, re.M)]
    if scripted != [command for command, _ in runs]:
        fail(path, "the demo shows other commands than scripts/demo runs: " + "; ".join(scripted))
    with scratch_copy(source, binary) as (scratch, environment):
        for command, shown in runs:
            done = subprocess.run(["sh", "-c", command], cwd=scratch, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, timeout=600)
            printed = done.stdout.decode(errors="replace").rstrip().splitlines()
            while shown and not shown[-1].strip():
                shown.pop()
            if done.returncode or not is_printed(shown, printed):
                first = next((line for line in shown if line.strip() != "..." and not any(is_printed([line], [p]) for p in printed)), "the order of lines")
                fail(path, f"the demo: {command} ends with {done.returncode} and prints other lines ({first}):\n    " + "\n    ".join(printed))
    return len(runs)


# ---------------------------------------------------------------- links
def anchors(path):
    """GitHub's anchors of a document's headings."""
    found = set()
    for _, line in prose(path):
        heading = re.match(r"^#+\s+(.*)$", line)
        if heading:
            text = re.sub(r"[`*]", "", heading.group(1)).strip().lower()
            text = re.sub(r"[^\w\- ]", "", text).replace(" ", "-")
            anchor, n = text, 0
            while anchor in found:
                n += 1
                anchor = f"{text}-{n}"
            found.add(anchor)
    return found


def check_links(path, source):
    count = 0
    for number, line in prose(path):
        for target in re.findall(r"\]\(([^)\s]+)\)", line):
            if re.match(r"^[a-z]+:", target):
                continue
            count += 1
            name, _, anchor = target.partition("#")
            full = os.path.normpath(os.path.join(os.path.dirname(path), name)) if name else path
            if not os.path.exists(full):
                fail(f"{path}:{number}", f"link to {target}: there is no such file")
            elif not full.startswith(os.path.normpath(source) + os.sep):
                fail(f"{path}:{number}", f"link to {target} leaves the project")
            elif anchor and full.endswith(".md") and anchor not in anchors(full):
                fail(f"{path}:{number}", f"link to {target}: there is no such heading; there are {', '.join(sorted(anchors(full)))}")
    return count


def check_text(path):
    with open(path, encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            if re.search(r"(^|[\s`(\"'])/(work|home|root|tmp|Users)/", line):
                fail(f"{path}:{number}", "a path of one machine")


def check_paths(path, source):
    """Files and folders of the project that a document names between backquotes exist; {a,b} stands for several."""
    for number, line in prose(path):
        for name in re.findall(r"`((?:include|kinematics|solver|models|io|apps|tests|scripts|docs)/[\w/.,{}-]*)`", line):
            choice = re.search(r"\{([^}]*)\}", name)
            for one in [name.replace(choice.group(0), c.strip()) for c in choice.group(1).split(",")] if choice else [name]:
                if not os.path.exists(os.path.join(source, one)):
                    fail(f"{path}:{number}", f"there is no {one}")


# ---------------------------------------------------------------- tables against the program
def check_options(source, binary):
    """Every --option in the documents is one that the program has, and every one it has stands in docs/reference.md."""
    text = subprocess.run([binary, "--help"], stdout=subprocess.PIPE, check=True).stdout.decode()
    for name in re.findall(r"^  ([a-z]+)  ", text.split("Subcommands:")[1], re.M):
        text += subprocess.run([binary, name, "--help"], stdout=subprocess.PIPE, check=True).stdout.decode()
    known = set(re.findall(r"--[a-z][a-z-]+", text))
    others = {"--preset", "--build", "--install", "--prefix", "--component", "--all", "--shots", "--missing", "--cflags", "--libs", "--renew"}  # CMake's, scripts/lint's, the page's test, pkg-config's, a test's
    reference = os.path.join(source, "docs", "reference.md")
    listed = set()
    for path in documents(source):
        with open(path, encoding="utf-8") as file:
            for number, line in enumerate(file, 1):
                for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+", line):
                    if path == reference:
                        listed.add(option)
                    if option not in known | others:
                        fail(f"{path}:{number}", f"the program has no option {option}")
    for option in sorted(known - listed):
        fail(reference, f"the option {option} is missing")


def check_reference(source, binary):
    """docs/reference.md is what scripts/reference prints of this program."""
    path = os.path.join(source, "docs", "reference.md")
    done = subprocess.run([sys.executable, os.path.join(source, "scripts", "reference"), binary], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    with open(path, encoding="utf-8") as file:
        page = file.read()
    if done.returncode:
        fail(path, f"scripts/reference ends with {done.returncode}: {done.stdout}")
    elif done.stdout != page:
        lines = zip(done.stdout.splitlines() + [""], page.splitlines() + [""])
        number, now = next(((n, a) for n, (a, b) in enumerate(lines, 1) if a != b), (0, ""))
        fail(f"{path}:{number}", f"scripts/reference prints another page today (scripts/reference PROGRAM > docs/reference.md); there: {now}")


# ---------------------------------------------------------------- the sensor of adding-a-sensor.md
def cache(build):
    values = {}
    with open(os.path.join(build, "CMakeCache.txt"), encoding="utf-8") as file:
        for line in file:
            entry = re.match(r"^([^#/:][^:]*):[A-Z]+=(.*)$", line.rstrip("\n"))
            if entry:
                values[entry.group(1)] = entry.group(2)
    return values


def compiler(values):
    """The build's compiler with its flags, without optimisation, and where Eigen is."""
    kind = values.get("CMAKE_BUILD_TYPE", "").upper()
    flags = shlex.split(values.get("CMAKE_CXX_FLAGS", "")) + shlex.split(values.get(f"CMAKE_CXX_FLAGS_{kind}", ""))
    flags = [f for f in flags if not re.match(r"^-O\d$", f)] + ["-std=c++17", "-O0"]
    eigen = os.path.normpath(os.path.join(values.get("Eigen3_DIR", "/usr/share/eigen3/cmake"), "..", "..", "..", "include", "eigen3"))
    return [values.get("CMAKE_CXX_COMPILER", "c++"), *flags, "-isystem", eigen]


def program(source, name, document, shown):
    """The lines of a program of examples/programs; the document shows some of them, in their order."""
    with open(os.path.join(source, "examples", "programs", name), encoding="utf-8") as file:
        lines = file.read().splitlines()
    rest = iter([line.strip() for line in lines])
    for line in shown:
        if line.strip() and line.strip() not in rest:
            fail(document, f"not in {name}, or in another order: {line}")
            break
    return lines


def check_snippet(source, binary):
    """What the README shows of the library compiles; what it leaves to the reader are the parameters here."""
    build = os.path.dirname(os.path.abspath(binary))
    headers = os.path.join(build, "include")
    if not os.path.exists(os.path.join(headers, "kincal", "kincal.h")):
        return "the README's C++ was not compiled (no headers beside the program)"
    path = os.path.join(source, "README.md")
    code = [lines for info, _, lines in blocks(path) if info == "cpp"]
    if len(code) != 1:
        fail(path, "one block of C++ is expected")
        return ""
    includes = [line for line in code[0] if line.startswith("#include")]
    rest = [line for line in code[0] if not line.startswith("#include")]
    parameters = ("kincal::Rig rig, std::vector<kincal::Sample> samples, kincal::CalibrationOptions options, kincal::Sample newer_sample, "
                  "kincal::StudyOptions study_options")
    text = "\n".join([*includes, f"void shown({parameters}) {{", *rest, "}"]) + "\n"
    command = [*compiler(cache(build)), "-I", headers, "-fsyntax-only", "-x", "c++", "-"]
    done = subprocess.run(command, input=text.encode(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=900)
    if done.returncode:
        fail(path, "the C++ does not compile:\n" + done.stdout.decode(errors="replace")[:3000])
    return "the README's C++ was compiled"


def check_sensor(source, binary):
    build = os.path.dirname(os.path.abspath(binary))
    libraries = [os.path.join(build, f"libkincal_{name}.a") for name in ("models", "core", "solver", "kinematics")]
    if not all(map(os.path.exists, libraries)):
        return "the sensor was not compiled (no libraries beside the program)"
    values = cache(build)
    path = os.path.join(source, "docs", "adding-a-sensor.md")
    found = blocks(path)
    code = [lines for info, _, lines in found if info == "cpp"]
    plain = [lines for info, _, lines in found if info == ""]
    if len(code) != 4 or len(plain) != 1:
        fail(path, "four blocks of C++ (sensor, program, check, joint model) and one of output are expected")
        return ""
    links = ["-lpthread", "-ldl"]
    code[0] = program(source, "bearing.h", path, code[0])
    code[1] = program(source, "direction_finder.cpp", path, code[1])
    code[2] = program(source, "check_bearing.cpp", path, code[2])
    with tempfile.TemporaryDirectory(prefix="kincal-docs-") as scratch:
        joint = ['#include "quadratic.h"', "int main() {", "  const double own[] = {0.1, 1.02, 0.05};",
                 "  const QuadraticJoint joint;",
                 "  return joint.extra_parameters().size() == 1 && std::abs(joint.position(joint.reading(0.7, own), own) - 0.7) < 1e-12 ? 0 : 1;", "}"]
        for name, lines in zip(("bearing.h", "main.cpp", "check.cpp", "quadratic.h", "joint.cpp"), code + [joint]):
            with open(os.path.join(scratch, name), "w", encoding="utf-8") as file:
                file.write("\n".join(lines) + "\n")
        for name in ("main", "check", "joint"):
            command = [*compiler(values), "-I", os.path.join(build, "include"), f"{name}.cpp", *libraries, *links, "-o", name]
            done = subprocess.run(command, cwd=scratch, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=900)
            if done.returncode:
                fail(path, f"{name}.cpp does not compile:\n" + done.stdout.decode(errors="replace")[:3000])
                continue
            done = subprocess.run([os.path.join(scratch, name)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=600)
            output = done.stdout.decode(errors="replace").rstrip("\n")
            if done.returncode:
                fail(path, f"{name} ends with {done.returncode}: {output}")
            elif name == "main" and output != "\n".join(plain[0]):
                fail(path, "main prints another output than the document shows:\n" + output)
    return "the sensor was compiled"


def check_on_board(source, binary):
    """The program on_board.cpp, with the library core alone, prints what on-a-robot.md shows; core.h needs neither exceptions nor run-time types."""
    build = os.path.dirname(os.path.abspath(binary))
    libraries = [os.path.join(build, f"libkincal_{name}.a") for name in ("core", "solver", "kinematics")]
    if not all(map(os.path.exists, libraries)):
        return "the program on board was not compiled (no libraries beside the program)"
    path = os.path.join(source, "docs", "on-a-robot.md")
    found = blocks(path)
    code, plain = ([lines for info, _, lines in found if info == kind] for kind in ("cpp", ""))
    if len(code) != 1 or len(plain) != 1:
        fail(path, "one block of C++ and one of output are expected")
        return ""
    with tempfile.TemporaryDirectory(prefix="kincal-docs-") as scratch:
        for name, lines in (("main.cpp", program(source, "on_board.cpp", path, code[0])), ("plain.cpp", ["#include <kincal/core.h>", "#include <kincal/extend.h>"])):
            with open(os.path.join(scratch, name), "w", encoding="utf-8") as file:
                file.write("\n".join(lines) + "\n")
        command = [*compiler(cache(build)), "-I", os.path.join(build, "include")]
        for more in (["-fno-exceptions", "-fno-rtti", "-fsyntax-only", "plain.cpp"], ["-O2", "main.cpp", *libraries, "-lpthread", "-ldl", "-o", "main"], None):
            done = subprocess.run(command + more if more else [os.path.join(scratch, "main")], cwd=scratch, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=900)
            output = done.stdout.decode(errors="replace").rstrip("\n")
            if done.returncode:
                fail(path, f"{' '.join(more or ['main'])} ends with {done.returncode}:\n" + output[:3000])
                return ""
        if output != "\n".join(plain[0]):
            fail(path, "the program prints another output than the document shows:\n" + output)
    return "the program on board was compiled"


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    source, binary = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    count = links = 0
    for path in documents(source):
        count += run_document(path, source, binary)
        links += check_links(path, source)
        check_text(path)
        check_paths(path, source)
    for name in ("arm", "pr2", "static_view"):
        example = os.path.join(source, "examples", name, "README.md")
        count += run_document(example, source, binary)
        links += check_links(example, source)
    count += check_demo(source, binary)
    check_options(source, binary)
    check_reference(source, binary)
    compiled = f"{check_snippet(source, binary)}, {check_sensor(source, binary)}, {check_on_board(source, binary)}"
    for line in failures:
        print(line)
    print(f"{count} commands, {links} links, {compiled}; {len(failures)} failures")
    sys.exit(1 if failures or count == 0 else 0)


if __name__ == "__main__":
    main()
