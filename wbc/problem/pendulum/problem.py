"""A pendulum's problem, fully validated and ready to run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wbc.problem.mistakes import Mistakes, read_section
from wbc.problem.pendulum.plan import Planning
from wbc.problem.pendulum.result import PendulumResult
from wbc.problem.pendulum.simulation import Balance, build_balance
from wbc.problem.pendulum.spec import PendulumSpec
from wbc.problem.provenance import provenance, versions
from wbc.problem.robot_spec import RobotSpec
from wbc.problem.source import Source
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.run.simulate import Cancelled, Progress
from wbc.tracking.pendulum import RobotPendulum, pendulum_of


@dataclass(frozen=True, eq=False)
class PendulumProblem:
    """A reaction mass pendulum under a balance law, or with a motion to plan."""

    source: Source  # the file's text and data
    overrides: Mapping[str, Any]  # values that replace the file's, by key path
    spec: PendulumSpec  # the validated description
    parts: Balance | Planning  # a law with its initial state, or a planning problem

    def __repr__(self) -> str:
        return f"PendulumProblem({self.source.name!r}, {self.spec.model!r}, {self.mass:g} kg)"

    @property
    def mass(self) -> float:
        """Mass of the pendulum [kg]."""
        if isinstance(self.parts, Planning):
            return self.parts.problem.mass
        return float(self.parts.setting.pendulum.mass)

    def run(
        self, progress: Progress | None = None, *, cancelled: Cancelled | None = None
    ) -> PendulumResult:
        """Simulate the law, or solve for the plan.

        ``progress``: called from time to time with steps done, most steps, and a mapping with
        ``time`` [s]. The planner does not call it, as its number of iterations is not known in
        advance.
        ``cancelled``: called before each step; True ends the simulation. The planner does not call
        it.

        Raises PlanError: there is no plan; the error names what is in the way.
        """
        provenance = {"problem": self.provenance(), "versions": versions()}
        if isinstance(self.parts, Planning):
            return self.parts.run(provenance)
        return self.parts.run(provenance, progress, cancelled)

    def provenance(self) -> dict[str, Any]:
        """Return the problem's file, text and overrides, with which it can be run again."""
        return provenance(self.source, self.overrides)


def load_pendulum(source: Source, overrides: Mapping[str, Any], folder: Path) -> PendulumProblem:
    """Return the checked problem of a source; relative paths start from ``folder``.

    Raises ProblemFileError: with every mistake found: file, line, key path, what is wrong and what
    is valid.
    """
    spec = read_section(PendulumSpec, source)
    return PendulumProblem(source, overrides, spec, _build(spec, folder, Mistakes(source)))


def _build(spec: PendulumSpec, folder: Path, mistakes: Mistakes) -> Balance | Planning:
    robot = None if spec.robot is None else _robot(spec, spec.robot, folder, mistakes)
    pendulum = _pendulum(spec, mistakes) if robot is None else robot.pendulum
    if spec.law is not None and spec.plan is None:
        return build_balance(spec, spec.law, pendulum, mistakes)
    if spec.plan is None or spec.law is not None:
        mistakes.fail((), "give law (to simulate) or plan, and only one of them")
    for key in ("start", "bounds", "pushes", "plant", "stop"):
        if key in spec.model_fields_set:
            mistakes.note((key,), "belongs to a law; a plan has its own, under plan:")
    mistakes.raise_any()
    return spec.plan.build(pendulum, mistakes, robot)


def _pendulum(spec: PendulumSpec, mistakes: Mistakes) -> PlanarRmp | SolidRmp:
    kind = PlanarRmp if spec.model == "rmp_planar" else SolidRmp
    if spec.mass is None:
        mistakes.fail((), "'mass' is missing")
    mass = spec.mass
    return mistakes.require((), lambda: kind(mass, spec.gravity))


def _robot(
    spec: PendulumSpec, choice: str | RobotSpec, folder: Path, mistakes: Mistakes
) -> RobotPendulum:
    """Return the pendulum that stands for a plan's humanoid."""
    if spec.model != "rmp_solid" or spec.plan is None:
        mistakes.fail(("robot",), "belongs to a plan of model rmp_solid; leave this out")
    for key in ("mass", "gravity"):
        if key in spec.model_fields_set:
            mistakes.note((key,), "is that of the robot; leave this out")
    given = RobotSpec(model=choice) if isinstance(choice, str) else choice
    robot = mistakes.require(("robot",), lambda: given.load(folder))
    q = mistakes.require(("posture",), lambda: robot.posture(spec.posture))
    return pendulum_of(robot.snapshot(q))
