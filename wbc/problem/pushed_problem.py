"""Push trials of a problem of the torque level: see ``wbc push``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wbc.errors import ControllerFailure, InvalidInputError
from wbc.problem.problem import Problem, load_problem, load_same_text, require_torque
from wbc.problem.provenance import digests_of_files, versions
from wbc.run.phase_support import held_feet
from wbc.run.saving import plain
from wbc.simulation import FallLimits, PushOutcome, SimulationError, capture_impulse, simulate
from wbc.simulation.push_bounds import PushBounds, push_bounds
from wbc.validate import Array, check_fields, finite_number


@dataclass(frozen=True)
class PushSettings:
    """The push, and when the robot counts as at rest again."""

    # The pushed body; the force acts at the CoM's initial position, moving with the body.
    body: str = "base"
    duration: float = 0.1  # of the push, whose force is constant [s]
    at: float = 0.1  # when it begins [s]
    rest: float = 0.05  # speed of the CoM in the end, below which the robot is at rest [m/s]

    def __post_init__(self) -> None:
        check_fields(self, "push, ", "duration", "rest", above=0.0)
        check_fields(self, "push, ", "at", least=0.0)


class PushedProblem:
    """Tries pushes on a problem; the pushes of its own are left out.

    Raises InvalidInputError: a problem that is not of the torque level, does not begin on feet, or
    ends before the push; UnknownNameError: no such body.
    """

    def __init__(self, problem: Problem, settings: PushSettings) -> None:
        spec, parts = problem.spec, problem.parts
        name = problem.source.name
        require_torque(problem, "pushes need torques")
        self.problem, self.settings = problem, settings
        self.robot = parts.robot
        self.start = parts.at_start
        self.feet = held_feet(parts.contacts)
        if not self.feet:
            raise InvalidInputError(
                f"{name}: the robot stands on no feet at the start, so there is no M omega d to"
                " push by; give support: double, left or right"
            )
        self.robot.frame_id(settings.body)
        self.duration = spec.whole_stop.duration
        if settings.at + settings.duration >= self.duration:
            raise InvalidInputError(
                f"{name}: ends at {self.duration:g} s, before the push is over; give"
                " simulation.duration more"
            )
        self.falls = FallLimits(**spec.simulation.falls)
        self._plant = problem.plant()
        self.own_pushes = len(spec.simulation.pushes)

    def unit(self, angle: float) -> float:
        """Return M omega d in a direction [N s]."""
        return capture_impulse(self.start, self.feet, (np.cos(angle), np.sin(angle)))

    def bounds(self, angles: Array) -> PushBounds:
        """Return the theoretical bounds of pushes in directions (n,) [rad]."""
        settings = self.settings
        return push_bounds(self.start, self.feet, angles, settings.duration, self.falls.tilt)

    def __call__(self, angle: float, ratio: float) -> PushOutcome:
        """Simulate a push in a direction [rad], with an impulse of ``ratio`` M omega d."""
        plant, settings = self._plant, self.settings
        angle = finite_number("push, angle", angle)
        impulse = finite_number("push, ratio", ratio, least=0.0) * self.unit(angle)
        self.problem.spec.simulation.set_initial_state(plant, self.start)
        along = np.array((np.cos(angle), np.sin(angle), 0.0))
        force = impulse / settings.duration * along
        if impulse > 0.0:
            plant.push(settings.body, force, "com", start=settings.at, duration=settings.duration)
        phases = self.problem.supervisor(plant)
        loop = simulate(
            phases.controller, plant, self.duration, update=phases.update, falls=self.falls
        )
        ticks = relaxed = 0
        tilt, ending = 0.0, ""
        try:
            for now in loop:
                ticks += 1
                relaxed += bool(now.tick.policy)
                tilt = max(tilt, now.verdict.tilt)
                if not now.verdict.stood:
                    ending = now.verdict.reason
        except (SimulationError, ControllerFailure) as error:
            ending = str(error)
        final = plant.snapshot()
        speed = float(np.linalg.norm(final.com_velocity))
        if not ending and phases.complaint:
            ending = phases.complaint
        if not ending and speed > settings.rest:
            ending = f"not at rest in the end: the CoM moves at {speed:.2g} m/s"
        return PushOutcome(
            angle=angle,
            ratio=float(ratio),
            impulse=impulse,
            survived=not ending,
            reason=ending or f"stood for {plant.time:.3f} s",
            time=plant.time,
            tilt=tilt,
            slip=self._slip(final.position),
            relaxed=relaxed / max(ticks, 1),
        )

    def _slip(self, position: Any) -> float:
        frames = [self.robot.foot(foot).frame for foot in self.feet]
        return max(float(np.linalg.norm(position(f) - self.start.position(f))) for f in frames)


@dataclass(frozen=True)
class LoadPushed:
    """Loads a :class:`PushedProblem` in any process; can be pickled."""

    path: Path  # of the problem's file
    overrides: Mapping[str, Any]  # values that replace the file's, by key path
    settings: PushSettings
    text: str
    files: Mapping[str, str]  # digests of the files that it names

    @classmethod
    def of(cls, path: Path, overrides: Mapping[str, Any], settings: PushSettings) -> LoadPushed:
        """Return the loader of a file in its present state.

        Raises InvalidInputError: stdin, which other processes cannot read; OSError: the file cannot
        be read.
        """
        if str(path) == "-":
            raise InvalidInputError("wbc push reads a problem in several processes: name a file")
        found = load_problem(path, overrides)
        source = found.source
        files = digests_of_files((source.data, overrides), path.parent)
        return cls(path.resolve(), dict(overrides), settings, source.text, files)

    def __call__(self) -> PushedProblem:
        """Return the problem, ready to be pushed.

        Raises WbcError: it cannot be pushed, or the file has changed.
        """
        problem = load_same_text(self.path, self.overrides, self.text)
        if not isinstance(problem, Problem):
            raise InvalidInputError(f"{self.path}: a pendulum's problem; pushes are for robots")
        return PushedProblem(problem, self.settings)

    def inputs(self) -> dict[str, Any]:
        """Return all inputs that outcomes depend on, as plain data."""
        inputs = {"text": self.text, "overrides": plain(self.overrides)}
        return {**inputs, "files": dict(self.files)} if self.files else inputs


def conditions(settings: PushSettings) -> dict[str, Any]:
    """Return the inputs that outcomes depend on besides problems, as plain data."""
    return {"push": asdict(settings), "versions": versions("mujoco")}
