"""Who includes whom, and how long things are: python3 structure_test.py SOURCE_DIR [--renew]

Proves, by reading the product's sources: every #include goes where the table below allows it; no two files need each other, straight or
in a circle; no file of models/, io/ or apps/ and no function is longer than the table says, and no function takes more parameters than that without
saying why; no two sources of one library have the same name in their anonymous namespaces, which are one where they are compiled as one; no two
headers define types of one name, which would be one to the linker; what is installed is what the public headers (include/kincal) need and nothing
else, and each of them needs only components that come with it.
It tests its own readers first.
Does not prove: that names are used where they should be (a file that includes nothing can still know too much), nor anything about
benchmarks and tests. The reader of functions counts braces: the code of a macro, a lambda by itself and a function that a macro begins
are not seen (a lambda's lines count for the function around it), and a variable at namespace level that is made with parentheses counts
as a function without a body. Names in anonymous namespaces are those of functions (with the types of their parameters, as written), of types
and of constants called kName.

What is wrong today and known stands in structure_known.txt beside this file and is printed as "still to do". A violation that does not
stand there fails, and so does a line there that is no longer true, so that the list can only shrink. --renew writes the list anew.
"""
import os
import re
import sys

# ---------------------------------------------------------------------------------------------- the rules
KINEMATICS, SOLVER = "kinematics", "solver"
FLOORS = [["joints"], ["sensors"], ["rig"], ["notices"], ["estimation"], ["fitting"], ["calibration"], ["monitor"], ["analysis"], ["design", "evidence", "verify"], ["automatic", "doctor", "trials"], ["report"]]
MODELS = [f"models/{room}" for floor in FLOORS for room in floor] + ["models/simulation", "models/bundle_adjustment", "models/fleet", "models/intrinsics"]


def below(room):
    floor = next(i for i, rooms in enumerate(FLOORS) if room in rooms)
    return [f"models/{lower}" for rooms in FLOORS[:floor] for lower in rooms]


# Room: the rooms that its files may include, besides files of the same room. Rooms of models see every lower floor; rooms of one floor
# do not see each other. Nothing includes apps; what is no room here (tests, benchmarks) is not included either.
MAY_INCLUDE = {
    KINEMATICS: [],
    SOLVER: [],
    **{f"models/{room}": [KINEMATICS, SOLVER, *below(room)] for floor in FLOORS for room in floor},
    "models/simulation": [KINEMATICS, SOLVER, "models/sensors", "models/joints", "models/rig", "models/fitting"],
    "models/bundle_adjustment": [KINEMATICS, SOLVER, "models/sensors"],
    "models/fleet": [KINEMATICS, SOLVER, "models/rig"],
    "models/intrinsics": [SOLVER, *(f"models/{room}" for room in ("sensors", "rig", "fitting", "calibration", "analysis", "trials"))],
    "io/document": [KINEMATICS, *MODELS],
    "io/urdf": [KINEMATICS, *MODELS, "io/document"],
    "io/rig": [KINEMATICS, *MODELS, "io/document", "io/urdf"],
    "io/results": [KINEMATICS, *MODELS, "io/document", "io/urdf", "io/rig"],
    "io/report": ["io/document", "io/results"],
    "io/job": [KINEMATICS, *MODELS, "io/document", "io/urdf", "io/rig", "io/results", "io/report"],
    "io/exchange": [KINEMATICS, *MODELS, "io/document", "io/urdf", "io/rig", "io/results"],
    "io/recordings": [KINEMATICS, *MODELS, "io/document", "io/urdf", "io/rig", "io/images"],  # urdf: the robot inside a recording
    "io/images": [KINEMATICS, *MODELS, "io/document", "io/urdf", "io/rig", "io/results", "io/exchange"],
    "apps/tables": [KINEMATICS, *MODELS, "io/*"],
    "apps": [KINEMATICS, *MODELS, "io/*"],                                   # job: what commands have in common
    "apps/batch": [KINEMATICS, *MODELS, "io/*", "apps", "apps/tables"],
    "apps/commands": [KINEMATICS, *MODELS, "io/*", "apps", "apps/tables", "apps/batch"],
    "apps/main.cpp": [KINEMATICS, *MODELS, "io/*", "apps", "apps/commands"],
}
# Everything may tell how far it is.
FOR_ALL = ["solver/progress.h"]
FOLDERS = ["kinematics", "solver", "models", "io", "apps"]
# The rooms of models that are the library core.
CORE = [f"models/{room}" for room in ("joints", "sensors", "rig", "estimation", "fitting", "calibration", "monitor")]
# Public header: the folders, or rooms, whose headers it may need. Users of a component get no others.
PUBLIC = {
    "solver.h": ["solver"],
    "extend.h": ["kinematics", "solver", *CORE],
    "core.h": ["kinematics", "solver", *CORE],
    "kincal.h": ["kinematics", "solver", "models"],
    "files.h": ["kinematics", "solver", "models", "io"],
}
MOST_LINES_OF_FILE = 650      # of models/, io/, apps/
MOST_LINES_OF_FUNCTION = 100  # from its first line to its closing brace
MOST_PARAMETERS = 6           # more only if one of the 3 lines above, in the header or in the source, says "parameters because ..."
REASON = "parameters because"


# ---------------------------------------------------------------------------------------------- reading
def without_comments(text):
    """The same text with comments, literals and preprocessor lines blanked, line by line and column by column."""
    pattern = re.compile(r'//[^\n]*|/\*.*?\*/|R"(\w*)\(.*?\)\1"|"(?:\\.|[^"\\\n])*"|(?<![0-9a-fA-F])\'(?:\\.|[^\'\\\n])+\''
                         r'|^[ \t]*#(?:[^\n]*\\\n)*[^\n]*', re.DOTALL | re.MULTILINE)

    def blank(match):
        piece = match.group(0)
        quoted = piece[0] in "\"'R"
        return "".join("\n" if c == "\n" else "0" if quoted else " " for c in piece)

    return pattern.sub(blank, text)


def closing(code, at):
    """Where the bracket that opens at `at` closes."""
    pairs, depth = {"(": ")", "{": "}", "[": "]"}, 0
    opening, end = code[at], pairs[code[at]]
    for i in range(at, len(code)):
        depth += (code[i] == opening) - (code[i] == end)
        if depth == 0:
            return i
    return len(code) - 1


def without_template(head):
    """The text without `public:` and `template <...>` before it."""
    head = re.sub(r"\b(public|private|protected)\s*:(?!:)", " ", head).strip()
    if re.match(r"template\s*<", head):
        depth = 0
        for i, c in enumerate(head):
            depth += (c == "<") - (c == ">")
            if c == ">" and depth == 0:
                return without_template(head[i + 1:])
    return head


def signature(head):
    """(name, number of parameters) if the text before a body or a semicolon declares a function, else None."""
    head = re.sub(r"\[\[[^\]]*\]\]|__attribute__\s*\(\(.*?\)\)\s*\)?|alignas\s*\([^)]*\)", " ", head)
    head = without_template(head)
    if re.match(r"(using|typedef|static_assert|friend\s+(class|struct)|return|extern\s+0+)\b", head):
        return None
    found = re.search(r"(operator\s*(?:\(\s*\)|\[\s*\]|[^\s\w(]+|[\w:<>*& ]+?)|~?\w+)\s*\(", head)
    if not found or "=" in head[:found.start()]:
        return None
    begin = found.end() - 1
    inside = head[begin + 1:closing(head, begin)].strip()
    depth, parameters = 0, 1 if inside and inside != "void" else 0
    for i, c in enumerate(inside):
        if c in "([{<":
            depth += 1
        elif c in ")]}" or (c == ">" and inside[i - 1] != "-"):
            depth -= 1
        elif c == "," and depth == 0:
            parameters += 1
    return found.group(1), parameters


def functions(text):
    """(name, parameters, first line, last line; the last is 0 for a declaration) of each function, methods included."""
    code = without_comments(text)
    line = lambda at: code.count("\n", 0, at) + 1
    out, begin, i = [], 0, 0
    while i < len(code):
        c = code[i]
        first = begin + len(code[begin:i]) - len(code[begin:i].lstrip())
        if c == "(":
            i = closing(code, i)  # braces of default arguments are no bodies
        elif c == "{":
            head = code[begin:i]
            flat, depth = "", 0
            for h in re.sub(r"operator\s*[^\s\w(]+", "operator", without_template(head)):
                depth += h == "("
                flat += h if depth == 0 else ""
                depth -= h == ")"
            initialiser = "=" in flat
            function = signature(head)
            members = re.search(r"\)\s*(?:noexcept\s*)?:(?!:)", re.sub(r"\([^()]*\)", "()", head)) if function else None
            if members and re.search(r"[\w>]\s*$", head):
                i = closing(code, i)  # a member made with braces; the body comes later
            elif function and not initialiser:
                end = closing(code, i)
                out.append((*function, line(first), line(end)))
                i, begin = end, end + 1
            elif not initialiser and re.search(r"\b(namespace|class|struct|union|extern)\b", flat):
                begin = i + 1
            else:
                i = closing(code, i)  # an enum or a variable's values
        elif c == ";":
            function = signature(code[begin:i])
            if function:
                out.append((*function, line(first), 0))
            begin = i + 1
        elif c == "}":
            begin = i + 1
        i += 1
    return out


def types_of(parameters):
    """The types of a function's parameters, as written, without names and defaults."""
    types, depth, begin = [], 0, 0
    for i, c in enumerate(parameters + ","):
        if c in "([{<":
            depth += 1
        elif c in ")]}" or (c == ">" and parameters[i - 1] != "-"):
            depth -= 1
        elif c == "," and depth == 0:
            one = re.sub(r"\s+", " ", parameters[begin:i].split("=")[0].strip())
            types.append(re.sub(r"(?<=[\w>&*])( |(?<=[&*]))\w+$", "", one))
            begin = i + 1
    return ", ".join(types)


def anonymous_names(text):
    """What a source defines in its anonymous namespaces: functions as name(types), types, and constants called kName; with what a name
    means if it is another word for a type: that may stand twice."""
    code, names = without_comments(text), {}
    for namespace in re.finditer(r"\bnamespace\s*\{", code):
        begin, i, last = namespace.end(), namespace.end(), closing(code, namespace.end() - 1)
        while i < last:
            c = code[i]
            if c in "([":
                i = closing(code, i)
            elif c in "{;":
                head = without_template(code[begin:i])
                kind = re.match(r"(?:class|struct|union|enum(?:\s+class)?)\s+(\w+)", head) or re.match(r"using\s+(\w+)\s*=(.*)", head, re.DOTALL)
                function = None if kind else signature(head)
                constants = re.findall(r"\bk[A-Z]\w*(?=\s*(?:\[[^\]]*\]\s*)*(?:=|$|,))", head)
                if kind and (c == "{" or kind.lastindex == 2):  # not one that is only announced
                    names[kind.group(1)] = kind.group(2).strip() if kind.lastindex == 2 else None
                elif not kind and constants:
                    names.update(dict.fromkeys(constants))
                elif not kind and function and c == "{":
                    at = re.search(r"\b%s\s*\(" % re.escape(function[0]), head) if function[0].isidentifier() else None
                    if at:
                        names[f"{function[0]}({types_of(head[at.end():closing(head, at.end() - 1)])})"] = None
                if c == "{":
                    i = closing(code, i)
                if c == ";" or function:
                    begin = i + 1
            i += 1
    return names


def check_reader():
    body = "\n".join("  work(i);" for _ in range(120))
    text = ("namespace a {\nnamespace {\nconst std::map<int, int> kMap = {{1, 2}, {3, 4}};\nenum class E { a, b };\n}\n"
            "template <class T, int N = 3>\nstruct S : Base {\n  S(int a, double b = f(1, 2)) : a_{a}, b_(b) { go(); }\n"
            "  void many(int a, int b, int c, int d, int e, int f, std::map<int, int> g = {}) const;\n"
            "  bool operator==(const S& other) const { return \"}{\"[0] == '{'; }\n  int a_ = 0;\n  double b_{1'000};\n};\n"
            "// a comment with { braces\nstd::string long_one(int a,\n                     int b) {\n  const auto f = [&](int i) { return i; };\n"
            + body + "\n}\nvoid after(void) {}\n}\n")
    found = {name: (parameters, last - first + 1 if last else 0) for name, parameters, first, last in functions(text)}
    expected = {"S": (2, 1), "many": (7, 0), "operator==": (1, 1), "long_one": (2, 124), "after": (0, 1)}
    if found != expected:
        sys.exit(f"the reader of functions is wrong: {found}\nexpected: {expected}")
    text = ("namespace a {\nnamespace {\nconstexpr int kMost = 3, kFew = 1;\nconst char kText[] = \"{\";\nconst std::map<int, int> kMap = {{1, 2}};\n"
            "struct Later;\nstruct S {\n  int kInside() { return 1; }\n} s;\nenum class E { kA };\nusing Names = std::vector<int>;\n"
            "template <class T>\nint work(const std::vector<T>& all, int* n = nullptr, bool = f(1, 2)) { return 0; }\nvoid only_declared(int);\n"
            "std::string work(double x) {\n  return \"a\";\n}\n}  // namespace\nint outside() { return 1; }\n}\n")
    found, expected = set(anonymous_names(text)), {"kMost", "kFew", "kText", "kMap", "S", "E", "Names", "work(const std::vector<T>&, int*, bool)", "work(double)"}
    if found != expected:
        sys.exit(f"the reader of anonymous namespaces is wrong: {sorted(found)}\nexpected: {sorted(expected)}")


# ---------------------------------------------------------------------------------------------- judging
def room_of(path):
    if path == "apps/main.cpp":
        return path
    parts = os.path.dirname(path).split("/")
    return "/".join(parts[:2]) if parts[0] in ("models", "io", "apps") else parts[0]


def allowed(path, target):
    room, other = room_of(path), room_of(target)
    if room == other or (target in FOR_ALL and room != KINEMATICS):
        return True
    rooms = MAY_INCLUDE.get(room, [])
    return other in rooms or other.split("/")[0] + "/*" in rooms


def circles(edges):
    """The edges between units that reach each other (Tarjan's components)."""
    index, low, on, stack, component = {}, {}, set(), [], {}

    def visit(v):
        index[v] = low[v] = len(index)
        stack.append(v)
        on.add(v)
        for w in sorted(edges.get(v, ())):
            if w not in index:
                visit(w)
                low[v] = min(low[v], low[w])
            elif w in on:
                low[v] = min(low[v], index[w])
        if low[v] == index[v]:
            while True:
                w = stack.pop()
                on.remove(w)
                component[w] = v
                if w == v:
                    break

    for v in sorted(edges):
        if v not in index:
            visit(v)
    return sorted((a, b) for a in edges for b in edges[a] if component[a] == component[b])


def includes(path, text):
    """The files that a source includes; a public header sees the folders below detail/."""
    names = re.findall(r'^\s*#\s*include\s+"([^"]+)"', text, re.MULTILINE)
    return [name[len("detail/"):] if name.startswith("detail/") else os.path.normpath(os.path.join(os.path.dirname(path), name)) for name in names]


def public_headers(source, files):
    """Violations of what is installed: CMakeLists.txt (HEADERS) against what the public headers need."""
    with open(os.path.join(source, "CMakeLists.txt"), encoding="utf-8") as f:
        installed = set(re.findall(r"(?<=\s)(?:%s)/\S+\.h(?=\s)" % "|".join(FOLDERS), f.read()))
    if len(installed) < 50:
        sys.exit(f"CMakeLists.txt: only {len(installed)} headers found that are installed")
    found, needed = [], {}
    for name in sorted(os.listdir(os.path.join(source, "include", "kincal"))):
        path = f"include/kincal/{name}"
        if name not in PUBLIC:
            found.append(f"{path}: is no public header of the table")
            continue
        with open(os.path.join(source, path), encoding="utf-8") as f:
            todo = includes(path, f.read())
        for header in todo:
            if header.startswith("include/kincal/"):  # of another public header, which is looked at by itself
                continue
            if header.split("/")[0] not in PUBLIC[name] and room_of(header) not in PUBLIC[name]:
                found.append(f"{path}: needs {header}")
            if header not in needed:
                needed[header] = path
            todo += [other for other in includes(header, files.get(header, "")) if other not in todo]
    found += [f"{by}: needs {header}, which is not installed (CMakeLists.txt, HEADERS)" for header, by in needed.items() if header not in installed]
    found += [f"{header}: is installed and no public header needs it (CMakeLists.txt, HEADERS)" for header in installed - set(needed)]
    return found


def violations(source):
    files = {}
    for folder in FOLDERS:
        for directory, _, names in os.walk(os.path.join(source, folder)):
            for name in names:
                if name.endswith((".h", ".cpp")):
                    with open(os.path.join(directory, name), encoding="utf-8") as f:
                        files[os.path.relpath(os.path.join(directory, name), source)] = f.read()
    if len(files) < 100:
        sys.exit(f"{source}: only {len(files)} sources found")
    found, edges = [], {}
    for path, text in sorted(files.items()):
        if room_of(path) not in MAY_INCLUDE:
            found.append(f"{path}: {room_of(path)}/ is no room of the table")
        for target in includes(path, text):
            if not allowed(path, target):
                found.append(f"{path}: includes {target}")
            unit, other = os.path.splitext(path)[0], os.path.splitext(target)[0]
            if unit != other:
                edges.setdefault(unit, set()).add(other)
                edges.setdefault(other, set())
        lines = text.count("\n")
        if path.startswith(("models/", "io/", "apps/")) and lines > MOST_LINES_OF_FILE:
            found.append(f"{path}: more than {MOST_LINES_OF_FILE} lines")
    found += [f"{a}: in a circle by including {b}" for a, b in circles(edges)]
    owners = {}
    for path, text in sorted(files.items()):
        if path.endswith(".cpp"):
            for name, meaning in sorted(anonymous_names(text).items()):
                owners.setdefault((path.split("/")[0], name), {})[path] = meaning
    for (_, name), meanings in owners.items():
        paths, another_word = list(meanings), None not in meanings.values() and len(set(meanings.values())) == 1
        if len(paths) > 1 and not another_word:
            found.append(f"{paths[-1]}: {name} in an anonymous namespace is also in {paths[0]}: a unity build has it twice")
    found += public_headers(source, files)
    types = {}
    for path, text in sorted(files.items()):
        if path.endswith(".h"):
            for name in re.findall(r"^(?:class|struct|union|enum(?: class)?) (?:alignas\([^)]*\) )?(\w+)[^;{]*\{", without_comments(text), re.MULTILINE):
                types.setdefault(name, []).append(path)
    found += [f"{paths[-1]}: type {name} is also in {paths[0]}: the linker takes them for one" for name, paths in types.items() if len(paths) > 1]
    many, excused = set(), set()
    for path, text in sorted(files.items()):
        lines = text.split("\n")
        for name, parameters, first, last in functions(text):
            if last - first + 1 > MOST_LINES_OF_FUNCTION:
                found.append(f"{path}: {name}() has more than {MOST_LINES_OF_FUNCTION} lines")
            if parameters > MOST_PARAMETERS:
                key = (os.path.splitext(path)[0], name, parameters)
                many.add(key)
                if any(REASON in above for above in lines[max(0, first - 4):first - 1]):
                    excused.add(key)
    found += [f"{unit}: {name}() takes {parameters} parameters" for unit, name, parameters in sorted(many - excused)]
    return sorted(set(found))


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    check_reader()
    found = violations(os.path.abspath(sys.argv[1]))
    list_path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "structure_known.txt")
    if "--renew" in sys.argv[2:]:
        with open(list_path, "w", encoding="utf-8") as f:
            f.write("".join(v + "\n" for v in found))
    known = []
    if os.path.exists(list_path):
        with open(list_path, encoding="utf-8") as f:
            known = f.read().splitlines()
    new, gone = [v for v in found if v not in known], [v for v in known if v not in found]
    print(f"still to do: {len(known) - len(gone)}")
    for v in known:
        if v not in gone:
            print("  " + v)
    for v in new:
        print(f"NEW: {v}")
    for v in gone:
        print(f"DONE, take it out of {os.path.basename(list_path)}: {v}")
    sys.exit(1 if new or gone else 0)


if __name__ == "__main__":
    main()
