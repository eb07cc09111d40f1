"""Exceptions, with the program's messages."""
from __future__ import annotations

import re
from typing import Optional

# "rig.yaml:12: sensors.camera.sigma: ...", "samples.jsonl:3: ..."; "rig.yaml: ..."; "free[0]: ...", "require 'a<1': ...", "samples[2].joints.a: ..."
_PLACE = re.compile(r"(?P<file>.+?):(?P<line>\d+)(?::\d+)?: (?:(?P<name>[^\s:]+): )?")
_FILE = re.compile(r"(?P<file>[^:]*[./][^:\[]*): ")
_NAME = re.compile(r"(?P<name>[a-z_]+(?:(?:\[\d+\])*\.\S+)?)(?:\[\d+\])?(?: '.*?')?: ")


class InputError(ValueError):
    """Something is wrong in what was given. `file` and `line` say where, as far as they are known: of samples given as dicts the
    file is called `samples`, and the sample k stands in line k + 1. `name` is the field ("views[0].pixels") or the option ("free")."""

    def __init__(self, message: str) -> None:
        super().__init__(message)
        place = _PLACE.match(message)
        name = place or _NAME.match(message)
        file = place or (None if name else _FILE.match(message))
        self.file: Optional[str] = file["file"] if file else None
        self.line: Optional[int] = int(place["line"]) if place else None
        self.name: Optional[str] = name["name"] if name else None


class StartError(RuntimeError):
    """No calibration can start: the first state cannot be evaluated. The message has what may be wrong."""
