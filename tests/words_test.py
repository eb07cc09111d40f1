"""The words that users read: python3 words_test.py SOURCE_DIR

Reads the string literals of apps/, models/ and io/, the texts of the report page, and the `///` comments of the public headers (those that
CMakeLists.txt installs, and include/kincal). Refuses old terms and idioms of the table below, and names the plain words to use instead.

Not proven: that a text is right, clear or short; that one thing has one name everywhere; words that are put together from several literals
when the program runs; Markdown documents, docstrings and other comments; identifiers, keys of files and option names, which never change.
"""

import os
import re
import sys

FORBIDDEN = [  # (regular expression, use instead)
    (r"\bspeaks? (against|for|too)\b|\bnothing speaks\b", "there is (no) evidence for, of"),
    (r"\b(data|rig|rig's|samples?|readings?|results?|postures?|sigmas|steps) (tells?|says?|knows?|speaks?)\b", "determine, state, show, list"),
    (r"\bdo(es)? not (hardly )?(tell|say|know)\b|\bhardly tells?\b|\bcan tell\b|\bcannot tell\b", "does not determine, does not state"),
    (r"\bcannot be told\b|\bnot told\b|\btold by\b|\bis told\b", "not determined, queried"),
    (r"\bas far as\b|\bso much\b", "where, if, to the extent that"),
    (r"\bof which\b|\bof what\b", "a relative clause, or two sentences"),
    (r"\b(was|is|are|were) asked for\b|\basked of\b|\basked once\b", "requested, given, queried"),
    (r"\bof a rig without\b|(?:^|[.:;] )of a rig\b", "if rig.yaml has no"),
    (r"\b(left|leave|leaves|leaving) (it |them |this )?away\b", "omit, left out, delete"),
    (r"[a-z'`)], for (it|they|these|those|this|there|what|where|its|their|no|nothing|nobody|neither)\b", "because"),
    (r"\bwhat (the data|is marked|is seen|is free|is held|is left|was (seen|found|recorded|logged|measured|asked)|stands|the model lacks|there is)\b",
     "a noun: the measurements, the residuals, the missing effect, values marked ..."),
    (r"\bnumbers that\b|\bnumbers of (the joints|joint '|sensor|target|parameter|the (joint|chain|arm|camera|lens))", "parameters, components, values, coefficients"),
    (r"\bstands? (twice|already|elsewhere)\b", "occurs twice, is already, is in another place"),
    (r"\bis nothing that\b|\bno matter of\b", "does not ..."),
    (r"\bknown (worst|badly|no better|worse)\b|\bhow well (it|each|they|that) (is|are) known\b|\bknow little\b", "least certain, uncertainty"),
    (r"\b(take|takes|taken|took) up (a|an|the|another|it|this|that|part)\b", "absorb"),
    (r"\b(go|goes|went) with where\b", "depends on its position"),
    (r"\bmove alike\b|\berr alike\b|\bhang together\b", "correlated"),
    (r"\b(are|is|were|was) taken for\b", "is used as, is regarded as"),
    (r"\btaken out\b|\btakes? (them|it) out\b", "removed"),
    (r"\bfrees? (less|all that)\b|\ball that could be wrong\b|\beverything that could be wrong\b", "estimate fewer parameters, every parameter that may be wrong"),
    (r"\bwere (they|it) [a-z]+ percent\b|\bput anew\b|\bon anew\b", "if they were, again"),
]


def rules():
    return [(re.compile(old, re.IGNORECASE), new) for old, new in FORBIDDEN]


TOKEN = re.compile(r'//[^\n]*|/\*.*?\*/|R"(\w*)\((.*?)\)\1"|\'(?:\\.|[^\\\'\n])\'|"((?:\\.|[^"\\\n])*)"', re.DOTALL)
PAGE_TOKEN = re.compile(r"//[^\n]*|/\*.*?\*/|'((?:\\.|[^'\\\n])*)'|\"((?:\\.|[^\"\\\n])*)\"|`((?:\\.|[^`\\])*)`", re.DOTALL)


def joined(pieces):
    """(line, text) of strings that stand one behind the other with nothing between."""
    out = []
    for line, text, follows in pieces:
        if out and follows:
            out[-1][1] += text
        else:
            out.append([line, text])
    return [(line, re.sub(r"\s+", " ", text.replace("\\n", " ").replace('\\"', '"'))) for line, text in out]


def literals(code, token=TOKEN):
    """The string literals of a source; lines of #include are none."""
    pieces, end = [], None
    for match in token.finditer(code):
        text = next((g for g in (match.groups()[1:] if token is TOKEN else match.groups()) if g is not None), None)
        begin = code.rfind("\n", 0, match.start()) + 1
        if text is None or code[begin:match.start()].lstrip().startswith("#include"):
            continue
        pieces.append((code.count("\n", 0, match.start()) + 1, text, end is not None and not code[end:match.start()].strip()))
        end = match.end()
    return joined(pieces)


def comments(code):
    """The `///` comments of a header, each block as one text."""
    pieces, last = [], None
    for number, line in enumerate(code.split("\n"), 1):
        match = re.search(r"///<?\s?(.*)$", line)
        if match:
            pieces.append((number, match.group(1) + " ", last == number - 1))
            last = number
    return joined(pieces)


def installed(source):
    with open(os.path.join(source, "CMakeLists.txt"), encoding="utf-8") as f:
        text = f.read()
    public = os.path.join(source, "include", "kincal")
    return sorted(set(re.findall(r"(?<=\s)(?:kinematics|solver|models|io)/\S+\.h(?=\s)", text)) | {"include/kincal/" + name for name in os.listdir(public)})


def sources(source, folders, endings):
    for folder in folders:
        for directory, _, names in os.walk(os.path.join(source, folder)):
            for name in names:
                if name.endswith(endings):
                    yield os.path.relpath(os.path.join(directory, name), source)


def check_reader():
    """Each rule finds something, and the reader finds what stands in literals and comments alone."""
    code = '#include "of which"\n// of which\nf("the data "\n  "tell", \'"\', R"(as far as)");  /* so much */\nint a;  ///< of which\n/// one\n/// two\n'
    if literals(code) != [(3, "the data tell"), (4, "as far as")] or comments(code) != [(5, "of which one two ")]:
        sys.exit(f"the reader is wrong: {literals(code)} {comments(code)}")
    bad = [text for text in ("14 numbers that the data do not tell", "kept, for it is exact", "Of a rig without steps", "left away: found") if not any(r.search(text) for r, _ in rules())]
    good = [text for text in ("parameters kept at their nominal values", "2 numbers are expected", "wait for it", "data of the fit") if any(r.search(text) for r, _ in rules())]
    if bad or good:
        sys.exit(f"the table is wrong: not refused {bad}, refused {good}")


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    source = os.path.abspath(sys.argv[1])
    check_reader()
    texts = 0
    found = []

    def look(path, pieces):
        nonlocal texts
        for line, text in pieces:
            texts += 1
            for rule, instead in rules_:
                for match in rule.finditer(text):
                    found.append(f"{path}:{line}: '{text[max(0, match.start() - 20):match.end() + 20].strip()}': {match.group(0)!r} (use: {instead})")

    rules_ = rules()

    def read(path):
        with open(os.path.join(source, path), encoding="utf-8") as f:
            return f.read()

    for path in sorted(sources(source, ("apps", "models", "io"), (".h", ".cpp"))):
        look(path, literals(read(path)))
    for path in sorted(sources(source, ("io/report/page/src",), (".ts",))):
        look(path, literals(read(path), PAGE_TOKEN))
    for path in installed(source):
        look(path, comments(read(path)))
    if texts < 5000:
        sys.exit(f"{source}: only {texts} texts found")
    print("\n".join(found) if found else f"{texts} texts, none with a word of the table")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
