"""Makes a wheel of the built package, without network: python3 make_wheel.py PACKAGE_FOLDER VERSION SOURCE_DIR OUT_DIR

It is for the Python and the platform that it was built with, and needs the shared libraries that the module is linked to (urdfdom, yaml-cpp,
pugixml, nettle): it is no manylinux wheel. The same package makes the same bytes."""
import base64
import hashlib
import os
import re
import sys
import sysconfig
import zipfile

folder, version, source, out = sys.argv[1:]
python = "cp%d%d" % sys.version_info[:2]
tag = "%s-%s-%s" % (python, python, re.sub(r"[-.]", "_", sysconfig.get_platform()))
info = "kincal-%s.dist-info" % version
files = {}
for name in sorted(os.listdir(folder)):
    if name.endswith((".py", ".pyi", ".so", "py.typed")):
        with open(os.path.join(folder, name), "rb") as file:
            files["kincal/" + name] = file.read()
with open(os.path.join(source, "LICENSE"), "rb") as file:
    files[info + "/LICENSE"] = file.read()
files[info + "/METADATA"] = ("Metadata-Version: 2.1\nName: kincal\nVersion: %s\nSummary: calibration of robots by bundle adjustment over kinematic chains\n"
                             "License-File: LICENSE\nRequires-Python: >=3.%d,<3.%d\nRequires-Dist: numpy\n" % (version, sys.version_info[1], sys.version_info[1] + 1)).encode()
files[info + "/WHEEL"] = ("Wheel-Version: 1.0\nGenerator: kincal\nRoot-Is-Purelib: false\nTag: %s\n" % tag).encode()
record = ["%s,sha256=%s,%d" % (name, base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode(), len(data)) for name, data in files.items()]
files[info + "/RECORD"] = ("\n".join(record + [info + "/RECORD,,"]) + "\n").encode()
path = os.path.join(out, "kincal-%s-%s.whl" % (version, tag))
with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as wheel:
    for name, data in files.items():
        entry = zipfile.ZipInfo(name, (2020, 1, 1, 0, 0, 0))
        entry.external_attr = 0o644 << 16
        entry.compress_type = zipfile.ZIP_DEFLATED
        wheel.writestr(entry, data)
print(path)
