"""The folder that ``wbc codegen PROBLEM.yaml`` writes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from wbc.codegen.core_parts import CodegenError
from wbc.codegen.hardware_data import HardwareParts, data_header, data_source
from wbc.codegen.hardware_recording import hardware_recording_text
from wbc.codegen.recording import TickRecording, check_kind, record
from wbc.codegen.texts import plan_header, plan_source, recording_text
from wbc.files import write_text
from wbc.hardware.setup import omissions
from wbc.hardware.unitree.profiles import Profile
from wbc.native.sources import FLAGS
from wbc.native.sources import SOURCE as CORE
from wbc.problem import Problem, load_problem
from wbc.qp.active_set import NAME

SOURCE = Path(__file__).parent / "source"
HARDWARE = SOURCE / "hardware"
SOLVER = "controller.solver"


class Export(NamedTuple):
    """What was written."""

    folder: Path
    recording: TickRecording
    solver: str | None  # the problem's own, if that is not the core's, which the C has
    left_out: tuple[str, ...] = ()  # of the robot on its bus, in words


def export_problem(
    path: Path,
    folder: Path,
    overrides: Mapping[str, Any] | None = None,
    ticks: int = 200,
    robot: Profile | None = None,
) -> Export:
    """Write the controller of a problem file as C, with an example that ticks against Python.

    Parameters
    ----------
    folder:
        Is made if need be; files of an earlier export are replaced.
    overrides:
        Values by key path that replace the file's.
    ticks:
        Recorded of the problem's run, at most: it may end before.
    robot:
        The problem's robot on its bus: estimator and safety layer are written, too, into
        ``hardware``.

    Raises
    ------
    CodegenError
        The problem is made of something that the native core does not know, named.
    ProblemFileError
        The file is wrong.
    InvalidInputError
        The problem's robot is not the one on the bus, or ``wbc hardware run`` would refuse it.
    OSError
        A file cannot be written.
    """
    overrides = overrides or {}
    problem = _load(path, overrides)
    earlier = folder / "hardware"
    if robot is None and (earlier / "data.c").exists():  # it agrees with its own recording still
        raise CodegenError(
            f"{earlier}: of an earlier export, for another controller; give the robot on the bus"
            " (--robot), or delete it"
        )
    solver = str(problem.spec.controller.model_dump()["solver"])
    if solver != NAME:
        problem = _load(path, {**overrides, SOLVER: NAME})
    recording = record(problem, ticks)
    untold = () if robot is None else tuple(omissions(problem, robot))
    name = recording.controller.robot.name
    title = f"{problem.source.name} for {name}; made by wbc codegen, do not edit."
    texts = {
        "plan.h": plan_header(recording, title),
        "plan.c": plan_source(recording, title),
        "recording.txt": recording_text(recording),
    }
    texts |= _written(SOURCE, "")
    if robot is not None:
        parts = HardwareParts.of(problem, robot)
        texts |= _written(HARDWARE, "hardware/") | {
            "hardware/data.h": data_header(parts, title),
            "hardware/data.c": data_source(parts, title),
            "hardware/recording.txt": hardware_recording_text(parts),
        }
    texts |= {f"core/{file.name}": _text(file) for file in sorted(CORE.iterdir())}
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_text(folder / name, text)
    return Export(folder, recording, None if solver == NAME else solver, untold)


def _written(source: Path, into: str) -> dict[str, str]:
    """Return the files of a folder that are written as they are, by where they go."""
    files = sorted(file for file in source.iterdir() if file.is_file())
    flags = " ".join(FLAGS)
    return {into + file.name: _text(file).replace("@FLAGS@", flags) for file in files}


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8")


def _load(path: Path, overrides: Mapping[str, Any]) -> Problem:
    problem = load_problem(path, overrides)
    if not isinstance(problem, Problem):
        raise CodegenError(f"{path}: a pendulum's problem; try wbc codegen planar or solid")
    check_kind(problem)
    return problem
