"""The commands."""
from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import tempfile
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from . import _kincal
from ._data import Path, Rig, Samples, as_rig, as_samples, here, plain
from ._errors import InputError
from ._result import Check, Evaluation, Result, Verification

RigLike = Union[Rig, Path, Mapping[str, Any]]
SamplesLike = Union[Samples, Path, Iterable[Mapping[str, Any]]]
Names = Union[str, Sequence[str]]


class Progress(NamedTuple):
    """The progress of the work. An exception of a listener ends the work and is passed on."""
    what: str               # the stage, or the step
    share: Optional[float]  # of the stage that is done, None: that cannot be told
    iteration: int          # that ended; 0: a step begins; -1: it is a stage
    chi2: Optional[float]   # after that iteration


Listener = Callable[[Progress], Any]


def _told(progress: Optional[Listener]) -> Any:
    return None if progress is None else lambda *news: progress(Progress(*news))


def _settings(options: Optional[Mapping[str, Any]], keywords: Mapping[str, Any]) -> Dict[str, Any]:
    return {**(options or {}), **{k: v for k, v in keywords.items() if v is not None}}


def calibrate(rig: RigLike, samples: SamplesLike, options: Optional[Mapping[str, Any]] = None, *, noise: Optional[str] = None,
              free: Optional[Names] = None, fix: Optional[Names] = None, step: Optional[str] = None, group: Optional[Names] = None,
              no_group: Optional[Names] = None, holdout: Optional[int] = None, cross_validate: Optional[int] = None,
              restarts: Optional[int] = None, report_frame: Optional[Names] = None, require: Optional[Names] = None,
              reject: Optional[bool] = None, estimate_noise: Optional[bool] = None, no_report: Optional[bool] = None,
              write_reduction: Optional[bool] = None, iterations: Optional[int] = None, threads: Optional[int] = None,
              linear_solver: Optional[str] = None, progress: Optional[Listener] = None) -> Result:
    """Calibrates: as `kincal calibrate`, whose options these are, by keyword or in the mapping `options` (a keyword goes before).
    Raises InputError, and StartError where no calibration can start; any other end is a Result with a `status`."""
    given = _settings(options, {k: v for k, v in locals().items() if k not in ("rig", "samples", "options", "progress")})
    one, told = as_rig(rig), _told(progress)
    logged = as_samples(samples)
    command = "kincal.calibrate(%s)" % ", ".join([repr(one.path), repr(logged.path)] + ["%s=%r" % item for item in given.items()])
    return Result(_kincal.calibrate(one._rig, logged.of(one, told), given, command, told))


def check(rig: RigLike, samples: SamplesLike, *, noise: Optional[str] = None, threads: Optional[int] = None, compare: bool = False,
          progress: Optional[Listener] = None) -> Check:
    """Looks for the usual mistakes in rig and samples: as `kincal check --json`."""
    one, told = as_rig(rig), _told(progress)
    return Check(_kincal.check(one._rig, as_samples(samples).of(one, told), _settings(None, {"noise": noise, "threads": threads}), compare, told))


def evaluate(rig: RigLike, samples: SamplesLike, *, free: Optional[Names] = None, noise: Optional[str] = None,
             progress: Optional[Listener] = None) -> Evaluation:
    """Residuals at the rig's own values, of a result's rig for example: as `kincal evaluate --json`."""
    one, told = as_rig(rig), _told(progress)
    return Evaluation(_kincal.evaluate(one._rig, as_samples(samples).of(one, told), _settings(None, {"noise": noise, "free": free}), told))


class Simulation(NamedTuple):
    """Samples of a simulated robot; its true parameters, as truth.json; warnings about sensors that see nothing."""
    samples: Samples
    truth: Any
    warnings: List[str]


def simulate(rig: RigLike, samples: int, seed: int, *, spread: Optional[Mapping[str, float]] = None,
             truth: Union[Path, Mapping[str, Any], None] = None, postures: Union[Path, Iterable[Mapping[str, Any]], None] = None,
             progress: Optional[Listener] = None) -> Simulation:
    """Samples with known truth and noise: as `kincal simulate`. `spread` are sigmas by name or glob."""
    one = as_rig(rig)
    if spread and truth is not None:
        raise InputError("spread: the truth is given; only one of both can be")
    for name, value, low, high in (("samples", samples, 1, 1_000_000), ("seed", seed, 0, 1 << 62)):
        if not isinstance(value, int) or not low <= value <= high:
            raise InputError("%s: %r is no integer in %d .. %d" % (name, value, low, high))
    files: Dict[str, Tuple[str, str]] = {}
    if isinstance(truth, Mapping):
        files["truth"] = ("truth", json.dumps(plain(truth, "truth"), indent=1, ensure_ascii=False))
    elif truth is not None:
        files["truth"] = (os.fspath(truth), _kincal.read_file(os.fspath(truth)))
    if postures is not None:
        stored = as_samples(postures)
        files["postures"] = (stored.path if stored.path != "samples" else "postures", stored.text)
    text, true, warnings = _kincal.simulate(one._rig, samples, seed, [(k, float(v)) for k, v in (spread or {}).items()], files, _told(progress))
    if not text:
        raise InputError("simulate: no sample is left: no posture has a view that is possible")
    return Simulation(Samples.from_text(text, "simulated"), json.loads(true), list(warnings))


class Plan(NamedTuple):
    """Postures to record, as `simulate` takes them, in an order with short moves; the forecast of their accuracy, as in `kincal plan --json`, and in words."""
    postures: List[Dict[str, Any]]
    forecast: Dict[str, Any]
    text: str

    def __repr__(self) -> str:
        return self.text.rstrip()


def plan(rig: RigLike, samples: Optional[SamplesLike] = None, *, next: int = 20, goal: str = "parameters", candidates: int = 2000, seed: int = 1,
         postures: Union[Path, Iterable[Mapping[str, Any]], None] = None, clearance: Optional[float] = 0.02, progress: Optional[Listener] = None) -> Plan:
    """Chooses the postures that help most: as `kincal plan`. `samples` were recorded already, `postures` are candidates known to be safe, `clearance` (m) is the least distance between links; None: not checked."""
    one = as_rig(rig)
    for name, value, low, high in (("next", next, 1, 1000), ("candidates", candidates, 10, 100_000), ("seed", seed, 0, 1 << 62)):
        if not isinstance(value, int) or not low <= value <= high:
            raise InputError("%s: %r is no integer in %d .. %d" % (name, value, low, high))
    if clearance is not None and not 0 <= clearance <= 1:
        raise InputError("clearance: %r is not in 0 .. 1" % (clearance,))
    file = None
    if postures is not None:
        stored = as_samples(postures)
        file = (stored.path if stored.path != "samples" else "postures", stored.text)
    settings = _kincal.PlanSettings(next, candidates, seed, goal, file, -1.0 if clearance is None else float(clearance))
    told = _told(progress)
    read = None if samples is None else as_samples(samples).of(one, told)
    text, forecast, words = _kincal.plan(one._rig, read, settings, told)
    return Plan([json.loads(line) for line in text.splitlines()], json.loads(forecast), words)


class TestPoses(NamedTuple):
    """Postures to measure, as `simulate` takes them, in the order of the test; cube and poses, as `kincal plan --verify --json`; in words."""
    postures: List[Dict[str, Any]]
    plan: Dict[str, Any]
    text: str

    def __repr__(self) -> str:
        return self.text.rstrip()


def plan_verification(rig: RigLike, *, sensor: Optional[str] = None, cycles: int = 30, approaches: bool = False, region: Optional[Sequence[float]] = None,
                      candidates: int = 2000, seed: int = 1, clearance: Optional[float] = 0.02, progress: Optional[Listener] = None) -> TestPoses:
    """The test poses of ISO 9283 for `verify`: as `kincal plan --verify`. `region`: x, y, z of two corners (m, base frame) that the cube lies between."""
    one = as_rig(rig)
    for name, value, low, high in (("cycles", cycles, 1, 1000), ("candidates", candidates, 10, 100_000), ("seed", seed, 0, 1 << 62)):
        if not isinstance(value, int) or not low <= value <= high:
            raise InputError("%s: %r is no integer in %d .. %d" % (name, value, low, high))
    if clearance is not None and not 0 <= clearance <= 1:
        raise InputError("clearance: %r is not in 0 .. 1" % (clearance,))
    corners = [float(x) for x in region] if region is not None else []
    if len(corners) not in (0, 6):
        raise InputError("region: 6 numbers are expected, x, y, z of two corners, not %d" % len(corners))
    settings = _kincal.TestPoseSettings(sensor or "", cycles, approaches, corners, (candidates, seed), -1.0 if clearance is None else float(clearance))
    text, found, words = _kincal.plan_verification(one._rig, settings, _told(progress))
    return TestPoses([json.loads(line) for line in text.splitlines()], json.loads(found), words)


def verify(result: Union[Result, Path], samples: SamplesLike, *, tolerance: Optional[str] = None, standard: Optional[str] = None, sensor: Optional[str] = None,
           refit_base: bool = False, instrument: Optional[str] = None, environment: Optional[str] = None, serial: Optional[str] = None,
           measured: Optional[str] = None, progress: Optional[Listener] = None) -> Verification:
    """Verifies a calibrated robot with samples that its calibration did not use: as `kincal verify`. `result` is a Result, or the path of its folder."""
    if isinstance(result, Result):
        with tempfile.TemporaryDirectory(prefix="kincal_") as folder:
            result.save(os.path.join(folder, "result"))
            return verify(os.path.join(folder, "result"), samples, tolerance=tolerance, standard=standard, sensor=sensor, refit_base=refit_base,
                          instrument=instrument, environment=environment, serial=serial, measured=measured, progress=progress)
    stored = as_samples(samples)
    given = {"tolerance": tolerance, "standard": standard, "sensor": sensor, "instrument": instrument, "environment": environment, "serial": serial, "measured": measured}
    words = {**_settings(None, given), "command": "kincal.verify()"}
    text, printed, page = _kincal.verify(os.fspath(result), (stored.text, stored.path), words, refit_base, _told(progress))
    return Verification(text, printed, page)


class Monitor:
    """Watches samples of a calibrated robot, one at a time: how well each fits, and which parts have moved; as `kincal monitor`. `result` is a
    Result, or the path of its folder; `false_alarms`: mean number of samples between two false alarms."""

    def __init__(self, result: Union[Result, Path], *, false_alarms: float = 10000) -> None:
        if not false_alarms >= 10:
            raise InputError("false_alarms: %r is below 10" % (false_alarms,))
        if isinstance(result, Result):
            with tempfile.TemporaryDirectory(prefix="kincal_") as folder:
                result.save(os.path.join(folder, "result"))
                self._monitor = _kincal.Monitor(os.path.join(folder, "result"), false_alarms)
        else:
            self._monitor = _kincal.Monitor(os.fspath(result), false_alarms)

    def add(self, sample: Mapping[str, Any]) -> Dict[str, Any]:
        """The answer to a sample (docs/on-a-robot.md has the keys). A sample that is wrong is an InputError and changes nothing."""
        one: Dict[str, Any] = json.loads(self._monitor.show(as_samples([sample]).text, "samples")[0])
        return one

    @property
    def moved(self) -> List[List[Dict[str, Any]]]:
        """The reported changes, in order: for each the groups that explain it, the likeliest first."""
        found: List[List[Dict[str, Any]]] = json.loads(self._monitor.found())
        return found

    @property
    def noise(self) -> Dict[str, float]:
        """Factors of the noise over the calibration's, by sensor and joint."""
        factors: Dict[str, float] = json.loads(self._monitor.noise())
        return factors

    def recalibrated(self, samples: SamplesLike, groups: Sequence[str] = ()) -> Dict[str, Any]:
        """Calibrates again from these samples, with the last calibration as prior; `groups` (default: those named as moved) may have moved: {"samples": how many count, "values":
        {name: {"change", "sigma", "unit", "determined"}}}. The monitor stays as it is."""
        stored = as_samples(samples)
        done: Dict[str, Any] = json.loads(self._monitor.recalibrated(stored.text, stored.path, list(groups)))
        return done

    def save(self) -> bytes:
        """The state as bytes: `load` of a monitor of the same result and `false_alarms` goes on from there."""
        state: bytes = self._monitor.save()
        return state

    def load(self, state: bytes) -> None:
        """Continues from saved bytes. Bytes that are damaged or of another calibration are an InputError and change nothing."""
        self._monitor.load(state)

    def __repr__(self) -> str:
        summary: str = self._monitor.summary()
        return summary.rstrip()


class StaticViews:
    """Watches cameras that should stand still and see things that do not move, without a calibration; as `kincal monitor --static`. The first `learning` samples of a camera define the reference positions."""

    def __init__(self, *, false_alarms: float = 10000, learning: int = 10) -> None:
        if not false_alarms >= 10:
            raise InputError("false_alarms: %r is below 10" % (false_alarms,))
        if not learning >= 3:
            raise InputError("learning: %r is below 3" % (learning,))
        self._views = _kincal.StaticViews(false_alarms, learning)

    def add(self, sample: Mapping[str, Any]) -> Dict[str, Any]:
        """The answer to a sample {"views": [{"sensor": name, "ids": [...], "pixels": n x 2}]}: for each sensor {"learning", "chi2", "dof", "probability", "left_out", "largest", "moved"}."""
        one: Dict[str, Any] = json.loads(self._views.show(json.dumps(plain(sample, "sample"), ensure_ascii=False), "sample"))
        return one

    def __repr__(self) -> str:
        summary: str = self._views.summary()
        return summary.rstrip()


def detect(rig: RigLike, images: Path, *, joints: Optional[Path] = None, sigma: bool = False,
           options: Sequence[str] = ()) -> Samples:
    """Finds the rig's boards in images (a folder, a pattern, a file; or a samples.jsonl whose views have an `image`): runs the program kincal-detect (of the package kincal-images), which needs
    OpenCV. `options` are more of its switches."""
    program = here("kincal-detect") or shutil.which("kincal-detect")
    if program is None:
        raise FileNotFoundError("kincal-detect is neither beside this package nor on PATH; Debian has it in the package kincal-images")
    one = as_rig(rig)
    with tempfile.TemporaryDirectory(prefix="kincal_") as folder:
        out, path = os.path.join(folder, "samples.jsonl"), one.path
        if not os.path.isfile(path) or _kincal.read_file(path) != one.text:
            entries, path = one.to_dict(), os.path.join(folder, "rig.yaml")
            if isinstance(entries["robot"], str):
                entries["robot"] = "robot.urdf"
                _kincal.write_file(os.path.join(folder, "robot.urdf"), one.urdf, True)
            _kincal.write_file(path, json.dumps(entries, indent=1, ensure_ascii=False), True)
        command = [program, path, os.fspath(images), "--out", out, *options]
        command += (["--joints", os.fspath(joints)] if joints is not None else []) + (["--sigma"] if sigma else [])
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)
        if done.returncode != 0:
            errors = [line.split("error: ", 1)[1] for line in done.stderr.splitlines() if "error: " in line]
            raise InputError("\n".join(errors) or done.stderr.strip())

        def from_here(image: "re.Match[str]") -> str:  # else they are relative to the folder that is gone
            return '"image":' + json.dumps(os.path.relpath(os.path.join(os.path.realpath(folder), json.loads(image[1]))), ensure_ascii=False)

        return Samples.from_text(re.sub(r'"image":("(?:[^"\\]|\\.)*")', from_here, _kincal.read_file(out)), "detected")
