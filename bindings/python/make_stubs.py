"""Makes the stubs (.pyi) of the module from what its functions say of their arguments: python3 make_stubs.py PACKAGE_FOLDER FILE

It fails where a type is no type of Python: then the module names a class of C++ that it does not export."""
import importlib.util
import glob
import re
import sys

folder, out = sys.argv[1:]
spec = importlib.util.spec_from_file_location("_kincal", glob.glob(folder + "/_kincal*.so")[0])
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)


def signature(text):
    """The first line of a function's text, in the words of type checkers."""
    line = text.split("\n")[0]
    if re.search(r"\w+::", line):
        sys.exit("no type of Python: " + line)
    line = re.sub(r"numpy\.ndarray\[numpy\.(\w+)\]", r"numpy.typing.NDArray[numpy.\1]", line).replace("_kincal.", "")
    for name in ("Dict", "List", "Tuple", "Optional"):
        line = re.sub(r"\b%s\[" % name, "typing.%s[" % name, line)
    line = re.sub(r"(: |-> )(dict|list|tuple)\b(?!\[)", lambda m: m[1] + {"dict": "typing.Dict[typing.Any, typing.Any]", "list": "typing.List[typing.Any]",
                                                                       "tuple": "typing.Tuple[typing.Any, ...]"}[m[2]], line)
    return re.sub(r"\((?:self|arg0): (?:Rig|Samples|Monitor)\b", "(self", line.replace("object", "typing.Any"))


lines = ["# Made by make_stubs.py.", "import typing", "import numpy", "import numpy.typing", "", "__version__: str", ""]
functions = []
for name, value in sorted(vars(module).items()):
    if isinstance(value, type):
        lines.append("class %s:" % name)
        for member, entry in sorted(vars(value).items()):
            if isinstance(entry, property):
                kind = signature(entry.fget.__doc__).split("-> ")[1]
                lines += ["    @property", "    def %s(self) -> %s: ..." % (member, kind)]
            elif member != "__new__" and callable(entry) and (entry.__doc__ or "").startswith(member + "("):
                lines.append("    def %s: ..." % signature(entry.__doc__))
    elif callable(value):
        functions.append("def %s: ..." % signature(value.__doc__))
with open(out, "w", encoding="utf-8") as file:
    file.write("\n".join(lines + [""] + functions) + "\n")
