"""Rigs and samples: the input of a calibration."""
from __future__ import annotations

import importlib
import json
import math
import os
import pathlib
from typing import Any, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple, TypeVar, Union, overload

import numpy
from numpy.typing import NDArray

from . import _kincal
from ._errors import InputError

Floats = NDArray[numpy.float64]
Path = Union[str, "os.PathLike[str]"]


Array = TypeVar("Array", bound="NDArray[Any]")


def readonly(array: Array) -> Array:
    array.flags.writeable = False
    return array


def plain(value: Any, where: str) -> Any:
    """The same without arrays, for JSON. NaN and values that JSON cannot express are errors that name their place."""
    if isinstance(value, Mapping):
        return {str(k): plain(v, "%s.%s" % (where, k)) for k, v in value.items()}
    if isinstance(value, numpy.ndarray):
        if value.dtype.kind == "f" and not numpy.isfinite(value).all():
            place = numpy.argwhere(~numpy.isfinite(value))[0].tolist()
            raise InputError("%s%s: %s is not finite" % (where, "".join("[%d]" % i for i in place), value[tuple(place)]))
        return plain(value.tolist(), where) if value.dtype.kind not in "fiub" else value.tolist()
    if isinstance(value, numpy.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError("%s: %s is not finite" % (where, value))
    if isinstance(value, (list, tuple)):
        return [plain(v, "%s[%d]" % (where, i)) for i, v in enumerate(value)]
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    raise InputError("%s: a %s is no number, text, list, array or mapping" % (where, type(value).__name__))


class Rig:
    """A robot with its sensors and targets: the path of a rig.yaml (or of a result's folder), or a mapping with the same keys. Of a
    mapping `urdf` is the robot's file, or its text; else the file that the key `robot` names. It does not change."""

    def __init__(self, source: Union[Path, Mapping[str, Any]], urdf: Optional[Path] = None) -> None:
        if isinstance(source, Mapping):
            entries = dict(source)
            if urdf is not None:
                entries.setdefault("robot", "robot.urdf")
            given = None if urdf is None else os.fspath(urdf)
            written = given is not None and given.lstrip().startswith("<")
            text = given if given is None or written else _kincal.read_file(given)
            self._rig = _kincal.parse_rig(json.dumps(plain(entries, "rig"), indent=1, ensure_ascii=False), "rig", text,
                                          "robot.urdf" if given is None or written else given)
        else:
            if urdf is not None:
                raise InputError("urdf: a rig that is read from a file names its robot itself")
            path = os.fspath(source)
            self._rig = _kincal.read_rig(os.path.join(path, "rig.yaml") if os.path.isdir(path) else path)
        self._about = self._rig.describe()

    @classmethod
    def from_text(cls, text: str, urdf: Optional[str] = None, path: str = "rig.yaml", urdf_path: str = "robot.urdf") -> Rig:
        """A rig from the text of a rig.yaml, and its robot from that of a URDF; the paths are for messages."""
        self = cls.__new__(cls)
        self._rig = _kincal.parse_rig(text, path, urdf, urdf_path)
        self._about = self._rig.describe()
        return self

    path = property(lambda self: str(self._rig.path), doc="Where it was read from.")
    text = property(lambda self: str(self._rig.text), doc="The text of rig.yaml.")
    urdf = property(lambda self: str(self._rig.urdf), doc="The text of the robot's URDF.")
    robot = property(lambda self: str(self._about["robot"]), doc="The robot's name.")
    base = property(lambda self: str(self._about["base"]), doc="The base link.")
    links = property(lambda self: tuple(self._about["links"]))
    joints = property(lambda self: tuple(self._about["joints"]), doc="Joints that have a reading.")
    sensors = property(lambda self: dict(self._about["sensors"]), doc="The type of each sensor.")
    targets = property(lambda self: dict(self._about["targets"]), doc="The type of each target.")
    frames = property(lambda self: tuple(self._about["frames"]), doc="What forward() knows: links, sensor/NAME, target/NAME.")
    parameters = property(lambda self: tuple(self._about["parameters"]), doc="Everything that can be freed.")
    warnings = property(lambda self: tuple(self._about["warnings"]), doc="What kincal accepted in the URDF although it is unusual.")

    def to_dict(self) -> Any:
        """The contents of rig.yaml."""
        return self._rig.to_dict()

    def forward(self, joints: Mapping[str, Any], frame: str, base: Optional[str] = None) -> Floats:
        """The pose base_T_frame (4 x 4) at readings of the joints (rad, m), with bending and error curves if the rig has them.
        Readings may be arrays of any one shape S: then S x 4 x 4."""
        names, values, shape = table(joints)
        return _kincal.forward(self._rig, names, values, frame, self.base if base is None else base).reshape(shape + (4, 4))

    def __repr__(self) -> str:
        def some(things: Mapping[str, str]) -> str:
            return ", ".join("%s (%s)" % thing for thing in list(things.items())[:8]) + (", ..." if len(things) > 8 else "")
        return "<kincal.Rig %s: robot %s, %d joints with readings\n sensors: %s\n targets: %s>" % (
            self.path, self.robot, len(self.joints), some(self.sensors), some(self.targets))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Rig) and (self.text, self.urdf) == (other.text, other.urdf)

    def __hash__(self) -> int:
        return hash((self.text, self.urdf))

    def __reduce__(self) -> Tuple[Any, ...]:
        urdf = None if self._rig.flange_only else self.urdf
        return Rig.from_text, (self.text, urdf, self.path, str(self._rig.urdf_path))


def table(joints: Mapping[str, Any]) -> Tuple[List[str], Floats, Tuple[int, ...]]:
    """Names of joints, their readings (one row per posture), and the shape of the postures."""
    try:
        columns = numpy.broadcast_arrays(*[numpy.asarray(v, dtype=float) for v in joints.values()])
    except (TypeError, ValueError) as error:
        raise InputError("joints: numbers or arrays of one shape are expected (%s)" % error) from None
    shape = columns[0].shape if columns else ()
    values = numpy.stack([c.ravel() for c in columns], axis=1) if columns else numpy.zeros((1, 0))
    return [str(name) for name in joints], values, shape


class Samples(Sequence[Any]):
    """Recorded samples, one posture of the robot each: the path of a samples.jsonl, or mappings with the same keys, lists or numpy
    arrays in them. With `rig` they are checked at once, else when they are used. They do not change; arrays out are read-only."""

    def __init__(self, source: Union[Path, Iterable[Mapping[str, Any]]], rig: Optional[Rig] = None) -> None:
        if isinstance(source, (str, os.PathLike)):
            self.path, self.text = os.fspath(source), _kincal.read_file(os.fspath(source))
        else:
            self.path = "samples"
            self.text = "".join(json.dumps(plain(one, "samples[%d]" % i), ensure_ascii=False) + "\n" for i, one in enumerate(source))
        self._parsed: Optional[Tuple[Rig, _kincal.Samples]] = None
        self._lines: Optional[List[str]] = None
        if rig is not None:
            self.of(rig)

    @classmethod
    def from_text(cls, text: str, path: str = "samples.jsonl") -> Samples:
        """Samples from the text of a samples.jsonl; the path is for messages."""
        self = cls(())
        self.path, self.text = path, text
        return self

    def of(self, rig: Rig, progress: Any = None) -> _kincal.Samples:
        """The samples as kincal has them, checked against a rig."""
        if self._parsed is None or self._parsed[0] is not rig:
            self._parsed = (rig, _kincal.parse_samples(rig._rig, self.text, self.path, progress))
        return self._parsed[1]

    def _all(self) -> List[str]:
        if self._lines is None:
            self._lines = [line for line in self.text.split("\n") if line.strip()]
        return self._lines

    def __len__(self) -> int:
        return len(self._all())

    @overload
    def __getitem__(self, index: int) -> Any: ...
    @overload
    def __getitem__(self, index: slice) -> Samples: ...

    def __getitem__(self, index: Union[int, slice]) -> Any:
        if isinstance(index, slice):
            return Samples.from_text("".join(line + "\n" for line in self._all()[index]), self.path)
        return _arrays(json.loads(self._all()[index]))

    def __iter__(self) -> Iterator[Any]:
        return (self[i] for i in range(len(self)))

    def to_dataframe(self) -> Any:
        """The readings, one row per sample (pandas)."""
        return importlib.import_module("pandas").DataFrame([s.get("joints", {}) for s in self], index=[s.get("id", i) for i, s in enumerate(self)])

    def save(self, path: Path, force: bool = False) -> None:
        """Writes samples.jsonl, whole or not at all."""
        _kincal.write_file(os.fspath(path), self.text, force)

    def __repr__(self) -> str:
        return "<kincal.Samples %s: %d samples>" % (self.path, len(self))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Samples) and self.text == other.text

    def __hash__(self) -> int:
        return hash(self.text)

    def __reduce__(self) -> Tuple[Any, ...]:
        return Samples.from_text, (self.text, self.path)


def _arrays(value: Any) -> Any:
    """Lists of numbers, and of such lists, as read-only arrays."""
    if isinstance(value, dict):
        return {k: _arrays(v) for k, v in value.items()}
    if isinstance(value, list) and value:
        try:
            array = numpy.array(value)
        except ValueError:
            array = numpy.array(None)
        if array.dtype.kind in "fi":
            return readonly(array)
        return [_arrays(v) for v in value]
    return value


def as_rig(rig: Union[Rig, Path, Mapping[str, Any]]) -> Rig:
    return rig if isinstance(rig, Rig) else Rig(rig)


def as_samples(samples: Union[Samples, Path, Iterable[Mapping[str, Any]]]) -> Samples:
    return samples if isinstance(samples, Samples) else Samples(samples)


def here(name: str) -> Optional[str]:
    """A program beside the package, as in a build."""
    path = pathlib.Path(__file__).resolve().parents[2] / name
    return str(path) if os.access(path, os.X_OK) and path.is_file() else None
