"""The centroidal composite-rigid-body inertia: entries, trace or principal moments."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from wbc.errors import InvalidInputError
from wbc.problem.mistakes import Misplaced
from wbc.problem.section import (
    Distinct,
    Forms,
    ListOf,
    Name,
    NonEmpty,
    NonNegative,
    Number,
    Point,
    Section,
    Three,
    Weight,
    Words,
    default_of,
)
from wbc.problem.targets import Followed, FromMotion, FromPlan, Start
from wbc.problem.task_spec import ErrorTaskSpec
from wbc.robot import Snapshot
from wbc.robot.names import COM, WORLD
from wbc.run.ramps import VECTORS, TargetedTask, fixed_goal
from wbc.spatial import DIAGONAL, vech
from wbc.tasks import InertiaTask, PrincipalInertiaTask
from wbc.tasks.inertia import ALL, DIAGONAL_COMPONENTS, TRACE, vech_target
from wbc.validate import Array

COMPONENTS = {"all": ALL, "diagonal": DIAGONAL_COMPONENTS, "trace": TRACE}
PRINCIPAL = "principal"

Components = Annotated[
    Annotated[str, Words((*COMPONENTS, PRINCIPAL))]
    | Annotated[NonEmpty[Annotated[str, Words(ALL)]], Distinct],
    Forms(f"{', '.join((*COMPONENTS, PRINCIPAL))}, or a list of {' '.join(ALL)}"),
]


About = Annotated[Name | Point, Forms("com, world, a frame, or a point [x, y, z] of the world [m]")]


class Scale(Section):
    """An inertia given by factors on the one at the start."""

    scale: Annotated[
        NonNegative | Three[NonNegative],
        Forms("one factor, or three for the diagonal entries (or the principal moments)"),
    ]
    """One factor for every component, or three for xx, yy, zz (or the principal moments)."""


InertiaTarget = Annotated[
    Number
    | Annotated[ListOf[Number], Field(min_length=3, max_length=6)]
    | Three[Point]
    | Scale
    | FromPlan
    | FromMotion
    | Start,
    Forms(
        "numbers in kg m^2 (three diagonal entries or principal moments, six entries xx xy xz yy"
        " yz zz, a 3x3 matrix, or one number for the trace), {scale: factor}, {plan: file},"
        " {motion: file}, or start"
    ),
]


class InertiaSpec(ErrorTaskSpec):
    """The robot's composite-rigid-body inertia: size and shape of the whole robot."""

    of_plan: ClassVar[tuple[str, ...]] = ("inertia", "inertia_rate", "inertia_acceleration")

    type: Literal["inertia"]
    components: Components = "all"
    """Entries of the matrix: all six, the diagonal, the trace, the principal moments, or a list of
    entries."""
    frame: Name = default_of(InertiaTask, "frame")
    """Axes of the components: world, base (where only the joints matter) or any robot frame."""
    about: About = default_of(InertiaTask, "about")
    """Reference point: com, world (its origin), a frame (its origin, moving with the robot), or a
    point [x, y, z] fixed in the world [m]."""
    target: InertiaTarget
    """Target inertia [kg m^2], {scale: ...} of the initial one, {plan: ...} to follow a plan, or
    {motion: ...} a reference motion."""
    weight: Weight = 1.0
    """Weight of the task, one number or one per row [1/(kg m^2/s)]."""
    per_mass: bool = default_of(InertiaTask, "per_mass")
    """Whether to divide the error by the robot's mass, so that weights are comparable between
    robots."""
    second_order: bool = default_of(InertiaTask, "second_order")
    """Whether to use the curvature of the inertia, with which unreachable targets converge much
    faster (about 0.2 ms more per tick). Not for principal moments."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        if self.components == PRINCIPAL:
            return self._principal(name, start)
        given = self.components
        rows = COMPONENTS[given] if isinstance(given, str) else tuple(given)

        def current(now: Snapshot) -> Array:
            return vech(now.inertia_in(self.frame, self.about))

        if self.frame != "world":
            start.robot.frame_id(self.frame)
        if isinstance(self.about, str) and self.about not in (COM, WORLD):
            start.robot.frame_id(self.about)
        goal = self._goal(rows, current(start))
        settings = {**self.settings(rows), "components": rows}
        task = InertiaTask(start.robot, goal, name=name, **settings)
        return TargetedTask(task, fixed_goal(goal), current, VECTORS, task.set_target, self.ramp)

    def _goal(self, rows: tuple[str, ...], start: Array) -> Array:
        """Return the target inertia (6,) [kg m^2] in the axes of ``start`` (6,)."""
        if isinstance(self.target, Followed) and self.frame != "world":
            raise Misplaced("a plan has the inertia in world axes; leave this out", "frame")
        if isinstance(self.target, Followed) and self.about != COM:
            raise Misplaced("a plan has the inertia about the CoM; leave this out", "about")
        if isinstance(self.target, str | Followed):
            return start
        if isinstance(self.target, Scale):
            if isinstance(self.target.scale, float | int):
                return self.target.scale * start
            if not set(rows) <= {*DIAGONAL_COMPONENTS, *TRACE}:
                raise Misplaced(
                    "three factors fit the diagonal only (components: diagonal); give one factor",
                    "target",
                    "scale",
                )
            scaled = start.copy()
            scaled[DIAGONAL] *= self.target.scale
            return scaled
        try:
            entries = vech_target("inertia", np.array(self.target), rows)
        except InvalidInputError as error:
            raise Misplaced(str(error).removeprefix("inertia: "), "target") from None
        _check_moments(entries[DIAGONAL])
        return entries

    def _principal(self, name: str, start: Snapshot) -> TargetedTask:
        if "frame" in self.model_fields_set:
            raise Misplaced(
                "principal moments are the same in every frame; leave this out", "frame"
            )
        if "about" in self.model_fields_set:
            raise Misplaced("principal moments are those about the CoM; leave this out", "about")
        if self.second_order:
            raise Misplaced("there is no second order for principal moments", "second_order")
        if not isinstance(self.weight, float | int):
            raise Misplaced("principal moments take one weight, not a list", "weight")

        def current(now: Snapshot) -> Array:
            return np.asarray(np.linalg.eigvalsh(now.inertia), float)

        goal = self._principal_goal(current(start))
        settings = self.settings()
        for key in ("components", "frame", "about", "second_order"):
            del settings[key]
        task = PrincipalInertiaTask(start.robot, goal, name=name, **settings)
        return TargetedTask(task, fixed_goal(goal), current, VECTORS, task.set_target, self.ramp)

    def _principal_goal(self, start: Array) -> Array:
        """Return the target principal moments (3,) [kg m^2], smallest first."""
        if isinstance(self.target, Followed):
            raise Misplaced("of a plan give entries of the matrix, such as diagonal", "components")
        if isinstance(self.target, str):
            return start
        if isinstance(self.target, Scale):
            return np.sort(start * np.array(self.target.scale))
        if np.shape(self.target) != (3,):
            raise Misplaced("expected the three principal moments, or {scale: ...}", "target")
        wanted = np.sort(np.array(self.target, dtype=float))
        _check_moments(wanted)
        return wanted


def _check_moments(moments: Array) -> None:
    if (moments < 0.0).any():
        raise Misplaced("a moment of inertia is not negative", "target")
