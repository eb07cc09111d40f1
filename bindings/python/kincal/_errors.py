"""Exceptions, with the program's messages."""
from __future__ import annotations

from typing import Optional

from . import _kincal


class InputError(ValueError):
    """An input is wrong. `file` and `line` name the place if it is known: for samples given as dicts the
    file is called `samples`, and the sample k stands in line k + 1. `name` is the field ("views[0].pixels") or the option ("free")."""

    def __init__(self, message: str) -> None:
        super().__init__(message)
        file, line, name = _kincal.place(message)
        self.file: Optional[str] = file or None
        self.line: Optional[int] = line or None
        self.name: Optional[str] = name or None


class StartError(RuntimeError):
    """No calibration can start: the first state cannot be evaluated. The message names possible causes."""
