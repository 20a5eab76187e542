"""Runs: the closed loop, phases, and results."""

from wbc.controllers.closed_loop import LoopTick, closed_loop
from wbc.run.history import History
from wbc.run.phases import Change, Phase, PhaseExecutor
from wbc.run.ramps import TargetedTask
from wbc.run.result import Result
from wbc.run.simulate import Progress, simulate
from wbc.run.stopping import RunStatus, Stop

__all__ = [
    "Change",
    "History",
    "LoopTick",
    "Phase",
    "PhaseExecutor",
    "Progress",
    "Result",
    "RunStatus",
    "Stop",
    "TargetedTask",
    "closed_loop",
    "simulate",
]
