"""kincal calibrates robots: arms, heads, cameras, lasers, trackers, all at once.

    result = kincal.calibrate("rig.yaml", "samples.jsonl")
    print(result)
    result.save("result")

Files of the program come in as paths, or as dicts and numpy arrays with the same keys; see docs/python.md.
"""
from ._data import Rig, Samples
from ._errors import InputError, StartError
from ._kincal import __version__
from ._result import Check, Compensated, Evaluation, Parameter, Residuals, Result, Verification
from ._run import (Monitor, Plan, Progress, Simulation, StaticViews, TestPoses, calibrate, check, detect, evaluate, plan, plan_verification,
                   simulate, verify)

__all__ = ["Check", "Compensated", "Evaluation", "InputError", "Monitor", "Parameter", "Plan", "Progress", "Residuals", "Result", "Rig", "Samples", "Simulation", "StaticViews",
           "StartError", "TestPoses", "Verification", "__version__", "calibrate", "check", "detect", "evaluate", "plan", "plan_verification", "simulate", "verify"]
