"""Results of a calibration, an evaluation and a check."""
from __future__ import annotations

import importlib
import json
import os
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

import numpy
from numpy.typing import NDArray

from . import _kincal
from ._data import Floats, Path, Rig, readonly, table
from ._errors import InputError


@dataclass(frozen=True, eq=False)
class Parameter:
    """A parameter that was estimated. Arrays have one entry per component; poses are increments [v | w] from the initial pose."""
    name: str
    components: Tuple[str, ...]
    units: Tuple[str, ...]
    initial: Floats
    value: Floats
    sigma: Floats       # NaN: not determined; 0: held
    covariance: Floats  # components x components, 0 where held
    step: str           # the last that freed it
    pose: Optional[Dict[str, List[float]]] = None  # {xyz, quat} of poses, absolute


class Residuals(NamedTuple):
    """Residuals of one sensor, one row per point (per view if it measures poses): px or m; poses: m and rad."""
    sample: NDArray[numpy.int64]  # place in the samples
    target: NDArray[numpy.int64]  # place in the rig's targets
    point: NDArray[numpy.int64]   # of the target; -1: a pose
    before: Floats                # at the rig's values, NaN: not known
    after: Floats
    whitened: Floats              # after, in sigmas
    unit: str


class Compensated(NamedTuple):
    """Readings that reach planned poses, and the remaining errors."""
    joints: Dict[str, Any]
    position: Any  # m
    rotation: Any  # rad


def _residuals(data: Mapping[str, Any]) -> Mapping[str, Residuals]:
    return MappingProxyType({sensor: Residuals(readonly(r["sample"]), readonly(r["target"]), readonly(r["point"]), readonly(r["before"]), readonly(r["after"]),
                              readonly(r["whitened"]), r["unit"]) for sensor, r in data.items()})


class Found:
    """Texts of files, and data beside them; immutable."""

    def __init__(self, data: Dict[str, Any]) -> None:
        self._data = data

    def __reduce__(self) -> Tuple[Any, ...]:
        return type(self), (self._data,)

    @cached_property
    def _json(self) -> Any:
        return json.loads(self._data["json"])

    def to_dict(self) -> Any:
        """All data, as the program's JSON has them; a copy."""
        return json.loads(self._data["json"])

    def report(self, path: Path, force: bool = False) -> None:
        """Writes report.html, one page for a browser."""
        _kincal.write_file(os.fspath(path), _kincal.report_page(self._data["files"]), force)

    @property
    def warnings(self) -> List[Any]:
        """[{id, what, why, cure, names, ...}]"""
        return list(self.to_dict().get("warnings", []))

    @property
    def findings(self) -> List[Any]:
        """Mistakes in the input that explain the data: [{id, text, where, ...}]; for a calibration only if it ended badly."""
        return list(self.to_dict().get("findings", []))


class Evaluation(Found):
    """Residuals at a rig's own values."""
    chi2 = property(lambda self: self._json["chi2"])
    dof = property(lambda self: self._json["dof"])
    sensors = property(lambda self: self.to_dict()["sensors"], doc="Root mean squares, as `kincal evaluate --json` has them.")

    @cached_property
    def residuals(self) -> Mapping[str, Residuals]:
        return _residuals(self._data["residuals"])

    def __repr__(self) -> str:
        return "<kincal.Evaluation: chi2 %.6g, %d degrees of freedom, sensors %s>" % (self.chi2, self.dof, ", ".join(self.residuals))


class Check(Found):
    """Mistakes found in samples."""
    verdict = property(lambda self: self._json["verdict"])

    def __repr__(self) -> str:
        return "<kincal.Check: %s>" % (", ".join(f["id"] for f in self._json["findings"]) or "nothing found")


class Result(Found):
    """A calibration: verdict, parameters with their errors, residuals, the calibrated robot, and all files of the program's result.
    It can be pickled and copied."""

    def __init__(self, data: Dict[str, Any]) -> None:
        super().__init__(data)
        self._data["json"] = data["files"]["result.json"]

    status = property(lambda self: str(self._json["status"]), doc="converged, unobservable, not_converged, unexplained")
    verdict = property(lambda self: self.to_dict()["verdict"], doc="{use, text, why, next, ...}; use: good, doubts, no")
    use = property(lambda self: str(self._json["verdict"]["use"]), doc="Whether to use the result: good, doubts, no.")
    chi2 = property(lambda self: self._json["chi2"])
    dof = property(lambda self: self._json["dof"])
    note = property(lambda self: str(self._data["note"]), doc="What was done to the rig; mostly empty.")
    files = property(lambda self: dict(self._data["files"]), doc="The texts of the result's files, by name.")
    components = property(lambda self: tuple(self._data["components"]), doc="Names, in the order of the covariance.")
    samples = property(lambda self: tuple(self._data["samples"]), doc="Ids of the samples, in the order that residuals count.")
    unmet = property(lambda self: [words for _, met, words in self._data["requirements"] if not met], doc="Tolerances of `require` not met.")

    @property
    def covariance(self) -> Floats:
        """Covariance of the components; rows and columns of components that the data do not determine are NaN."""
        return readonly(self._data["covariance"])

    @cached_property
    def parameters(self) -> Mapping[str, Parameter]:
        """Everything that was estimated, by name."""
        place = {name: i for i, name in enumerate(self._data["components"])}
        out = {}
        for name, p in self._json["parameters"].items():
            components = tuple(self._data["names"][name])
            at = [place.get(component, -1) for component in components]
            block = numpy.zeros((len(at), len(at)))
            known = [k for k, i in enumerate(at) if i >= 0]
            if known:
                block[numpy.ix_(known, known)] = self.covariance[numpy.ix_([at[k] for k in known], [at[k] for k in known])]
            numbers = [readonly(numpy.array(p[key], dtype=float)) for key in ("initial", "value", "sigma")]
            out[name] = Parameter(name, components, tuple(p["unit"]), numbers[0], numbers[1], numbers[2], readonly(block), p["step"], p.get("pose"))
        return MappingProxyType(out)

    def __getitem__(self, name: str) -> Parameter:
        if name not in self.parameters:
            for held in self.to_dict().get("held", []):
                if held["parameter"] == name:
                    raise InputError("'%s' was kept at its nominal value: %s" % (name, held["text"]))
            raise InputError("'%s' was not estimated; estimated are: %s" % (name, ", ".join(self.parameters)))
        return self.parameters[name]

    @cached_property
    def residuals(self) -> Mapping[str, Residuals]:
        """Residuals of every sensor, by name."""
        return _residuals(self._data["residuals"])

    @cached_property
    def rig(self) -> Rig:
        """The calibrated rig, including parameters that a URDF cannot express."""
        files = self._data["files"]
        name = "robot_unbent.urdf" if "robot_unbent.urdf" in files else "robot.urdf"
        return Rig.from_text(files["rig.yaml"], files.get(name), "result/rig.yaml", "result/" + name)

    @property
    def urdf(self) -> str:
        """The text of the calibrated URDF: the best robot that a URDF can express."""
        return str(self._data["files"].get("robot.urdf", ""))

    def propagate(self, jacobian: Any) -> Floats:
        """Covariance J C J' of quantities with the Jacobian J (rows x components, in the order of `components`). Quantities that depend on
        components that the data do not determine are NaN."""
        j = numpy.atleast_2d(numpy.asarray(jacobian, dtype=float))
        if j.ndim != 2 or j.shape[1] != len(self.components):
            raise InputError("jacobian: rows of %d entries are expected, one a component, not an array of shape %s" % (len(self.components), j.shape))
        if not numpy.isfinite(j).all():
            raise InputError("jacobian: a number is not finite")
        known = numpy.isfinite(numpy.diag(self.covariance))
        out: Floats = j[:, known] @ self.covariance[numpy.ix_(known, known)] @ j[:, known].T
        lost = (j[:, ~known] != 0).any(axis=1)
        out[lost, :] = out[:, lost] = numpy.nan
        return out

    def forward(self, joints: Mapping[str, Any], frame: str, base: Optional[str] = None) -> Floats:
        """The pose base_T_frame of the calibrated robot at readings, as Rig.forward()."""
        return self.rig.forward(joints, frame, base)

    def compensate(self, joints: Mapping[str, Any], tip: str, base: Optional[str] = None, position_only: bool = False, temperature: Optional[float] = None) -> Compensated:
        """Readings that move a robot with errors that a URDF cannot express to the pose that `urdf` has at `joints`: as `kincal compensate`.
        `base` is the stationary reference frame of that pose; `temperature` (degrees Celsius) is required if joints depend on it."""
        files = self._data["files"]
        if "rig_rigid.yaml" not in files:
            raise InputError("compensate: there is nothing to compensate: `urdf` has all that was found")
        planned = Rig.from_text(files["rig_rigid.yaml"], files.get("robot.urdf"), "result/rig_rigid.yaml", "result/robot.urdf")
        names, values, shape = table(joints)
        found, left = _kincal.compensate(self.rig._rig, planned._rig, (tip, base or ""), names, values, (position_only, temperature))
        return Compensated({n: found[:, i].reshape(shape) for i, n in enumerate(names)}, left[:, 0].reshape(shape), left[:, 1].reshape(shape))

    def save(self, directory: Path, force: bool = False) -> None:
        """Writes the result's folder, with its page, as `kincal calibrate --out` does: whole or not at all."""
        files = self.files
        files["report.html"] = _kincal.report_page(files)
        _kincal.write_results(os.fspath(directory), files, force)

    def to_dataframe(self) -> Any:
        """All estimated components, one row each (pandas)."""
        rows = [{"parameter": p.name, "component": c, "unit": u, "initial": i, "value": v, "sigma": s, "step": p.step}
                for p in self.parameters.values() for c, u, i, v, s in zip(p.components, p.units, p.initial, p.value, p.sigma)]
        return importlib.import_module("pandas").DataFrame(rows).set_index("component")

    def __repr__(self) -> str:
        new = [name for name, p in self._json["parameters"].items() if not p.get("nominal", True)]
        rows = [(c, u, v - (0 if p.pose else i), s) for p in self.parameters.values() if p.name not in new
                for c, u, i, v, s in zip(p.components, p.units, p.initial, p.value, p.sigma)]
        rows.sort(key=lambda row: -abs(row[2] / row[3]) if row[3] > 0 else 0)
        lines = ["  %-44s %+.5g ± %.2g %s" % (c, d, s, u) for c, u, d, s in rows[:10]]
        lines += ["  new: %-39s xyz %s m, quat %s" % (name, *(" ".join("%.5g" % x for x in pose[key]) for key in ("xyz", "quat")))
                  for name in new for pose in [self[name].pose] if pose]
        head = "<kincal.Result: %s\n chi2 %.6g, %d degrees of freedom; %d components estimated; changes that are largest in sigmas:\n" % (
            self._json["verdict"]["text"], self.chi2, self.dof, len(rows) + 6 * len(new))
        return head + "\n".join(lines) + ">"


class Verification:
    """The verification of a calibrated robot."""

    def __init__(self, certificate: str, text: str, page: str) -> None:
        self._certificate, self.text, self._page = certificate, text, page

    @property
    def answer(self) -> str:
        """pass, fail, not provable; none: no tolerance was given."""
        return str(self.to_dict()["answer"])

    def to_dict(self) -> Any:
        """certificate.json; a copy."""
        return json.loads(self._certificate)

    def save(self, directory: Path, force: bool = False) -> None:
        """Writes certificate.html and certificate.json, as `kincal verify --out` does."""
        _kincal.write_directory(os.fspath(directory), {"certificate.html": self._page, "certificate.json": self._certificate}, force)

    def __repr__(self) -> str:
        return self.text.rstrip()
