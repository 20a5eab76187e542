"""A problem: loaded from a file, checked as a whole, ready to run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

from wbc.errors import InvalidInputError, ProblemFileError, shown
from wbc.gait.hand_supervisor import WithHands
from wbc.kinds import check_path
from wbc.problem.build import build, hand_support
from wbc.problem.components import Parts
from wbc.problem.controller_spec import GlobalSpec, TorqueSpec
from wbc.problem.global_search import global_shaping
from wbc.problem.levels import TORQUE
from wbc.problem.overrides import apply_overrides
from wbc.problem.provenance import provenance, versions
from wbc.problem.source import Source
from wbc.problem.spec import ProblemSpec
from wbc.problem.walk import WalkSpec, commanded_walk, read_problem
from wbc.problem.yaml_reader import read_source
from wbc.run.phase_support import SOLE_FLATNESS, held_feet
from wbc.run.phases import Loads, PhaseExecutor
from wbc.run.result import Result
from wbc.run.simulate import Cancelled, Observe, Progress, Show, simulate
from wbc.run.stopping import Stop
from wbc.run.supervisor import Supervisor
from wbc.simulation import FallLimits, Plant, SimulationResult, run_trial
from wbc.tracking.reference import PlanReference
from wbc.validate import by_name

if TYPE_CHECKING:
    from wbc.problem.pendulum.problem import PendulumProblem

# Largest height of a sole's corner at touchdown in a simulation [m]: measurements are noisy, and
# gravity brings the foot down.
TOUCHDOWN_HEIGHT = 5e-3


@dataclass(frozen=True, eq=False)
class Problem:
    """A whole-body control problem.

    Attributes
    ----------
    source:
        The file's text and data.
    overrides:
        Values that replace the file's, by key path.
    spec:
        The validated description.
    parts:
        Robot, start, tasks, contacts and limits made of it.
    """

    source: Source
    overrides: Mapping[str, Any]
    spec: ProblemSpec
    parts: Parts

    def __repr__(self) -> str:
        told = f"{self.parts.robot.name!r}, {len(self.spec.tasks)} tasks"
        return f"Problem({self.source.name!r}, {told})"

    def __reduce__(self) -> tuple[object, ...]:
        return _unpickled, (self.source, dict(self.overrides))  # parts have functions in them

    def run(
        self,
        progress: Progress | None = None,
        observe: Observe | None = None,
        *,
        cancelled: Cancelled | None = None,
        show: Show | None = None,
    ) -> Result:
        """Run the problem from its start until it is at rest, out of time, or has failed.

        For ``progress``, ``observe``, ``cancelled`` and ``show`` see :func:`wbc.run.simulate`, and
        :func:`wbc.run.global_shaping.shape_globally` for the method ``global``, which starts other
        processes: a script needs the usual ``if __name__ == "__main__"`` guard. A run starts
        afresh, so a second one gives the same result.

        Raises
        ------
        InvalidInputError
            A problem of the torque level.
        NoPostureError
            The method ``global`` found no posture that keeps every constraint.
        """
        spec, parts, controller = self.spec, self.parts, self.spec.controller
        if isinstance(controller, TorqueSpec):
            raise InvalidInputError(
                f"{self.source.name}: controller.level is torque: torques move a robot by physics,"
                f" so this problem is simulated: wbc sim {quote(self.source.name)}, or simulate()"
            )
        stop = Stop(**spec.whole_stop.model_dump())
        start = parts.at_start
        if isinstance(controller, GlobalSpec):
            from wbc.run.global_shaping import shape_globally  # only now: it loads CasADi

            return shape_globally(
                global_shaping(parts, spec, controller),
                parts.start,
                stop,
                **controller.search,
                dt=controller.dt,
                make_controller=lambda tasks: parts.controller(
                    controller, tasks, parts.contacts, start
                ),
                tasks=parts.tasks,
                progress=progress,
                observe=observe,
                provenance=self._provenance_with("casadi"),
                cancelled=cancelled,
                show=show,
            )
        phases, made_with = self.executor(), self._provenance_with()
        return simulate(phases, parts.start, stop, progress, observe, made_with, cancelled, show)

    def simulate(
        self,
        progress: Progress | None = None,
        *,
        cancelled: Cancelled | None = None,
        show: Show | None = None,
    ) -> SimulationResult:
        """Simulate a problem of the torque level from its start to its end, or the robot's fall.

        For ``progress``, ``cancelled`` and ``show`` see :func:`wbc.simulation.run_trial`. It starts
        afresh, so a second one gives the same result, bit for bit but for the times.

        Raises
        ------
        InvalidInputError
            A problem of the velocity level.
        MissingPackageError
            MuJoCo is not installed.
        SimulationError
            The physics blew up.
        """
        spec, parts = self.spec, self.parts
        how = f"commanded velocities are run, not simulated: wbc run {quote(self.source.name)}"
        require_torque(self, how)
        plant = self.plant()
        return run_trial(
            self.supervisor(plant),
            plant,
            Stop(**spec.whole_stop.model_dump()),
            falls=FallLimits(**spec.simulation.falls),
            plan=parts.plan,
            progress=progress,
            provenance=self._provenance_with("mujoco"),
            cancelled=cancelled,
            show=show,
        )

    def plant(self) -> Plant:
        """Return the plant at the start, with the file's pushes scheduled.

        Raises
        ------
        MissingPackageError
            MuJoCo is not installed.
        """
        spec, parts = self.spec, self.parts
        feet = held_feet(parts.contacts)
        hands = () if spec.hands is None else spec.hands.hands
        return spec.simulation.plant(parts.at_start, feet, spec.controller.dt, hands)

    def supervisor(self, plant: Plant) -> Supervisor:
        """Return the supervisor of one simulation of ``plant``, from the start.

        Its feet sense the plant's ground.
        """
        if isinstance(self.spec, WalkSpec):
            forces = partial(getattr, plant, "felt_forces")
            return commanded_walk(self.spec, self.parts, forces)
        return self._with_hands(self.executor(lambda: plant.felt_loads))

    def supervisor_on_robot(self) -> Supervisor:
        """Return the supervisor of one run of a robot without foot sensors.

        Feet are assumed to land as planned.

        Raises
        ------
        InvalidInputError
            A problem of the velocity level.
        """
        require_torque(self, "a robot is commanded torques")
        if isinstance(self.spec, WalkSpec):
            return commanded_walk(self.spec, self.parts, None)
        return self._with_hands(self.executor())

    def _with_hands(self, first: PhaseExecutor) -> Supervisor:
        """Return the supervisor with support by hands, if the problem has any."""
        hands = hand_support(self.spec, self.parts, first.controller)
        return first if hands is None else WithHands(first, hands)

    def executor(self, loads: Loads | None = None) -> PhaseExecutor:
        """Return the executor of the phases for one run.

        ``loads`` gives the feet's loads: see :class:`~wbc.run.phases.PhaseExecutor`.
        """
        spec, parts = self.spec, self.parts
        return PhaseExecutor(
            parts.phases,
            parts.targeted,
            [name for name, task in spec.tasks.items() if task.active],
            partial(parts.controller, spec.controller),
            parts.change,
            parts.at_start,
            parts.surroundings.move_to,
            spec.ground_height,
            TOUCHDOWN_HEIGHT if spec.controller.level == TORQUE else SOLE_FLATNESS,
            loads,
        )

    def _provenance_with(self, *packages: str) -> dict[str, Any]:
        """Return the provenance of a result that depends on some packages, too."""
        made_with = {
            "problem": self.provenance(),
            "versions": versions(*packages),
            "unwatched_pairs": self.parts.surroundings.unwatched_pairs(),
        }
        if not isinstance(self.parts.plan, PlanReference):
            return made_with
        from wbc.rmp.plan import problem_to_data  # only now: it loads CasADi

        return {**made_with, "planned": problem_to_data(self.parts.plan.plan.problem)}

    def provenance(self) -> dict[str, Any]:
        """Return the problem's file, text and overrides: what is needed to run it again."""
        return provenance(self.source, self.overrides)


def require_torque(problem: Problem, why: str) -> None:
    """Raise InvalidInputError, which says why, for a problem of the velocity level."""
    if problem.spec.controller.level != TORQUE:
        raise InvalidInputError(
            f"{problem.source.name}: controller.level is velocity: {why}; for torques write"
            " controller: {level: torque}"
        )


def load_problem(
    path: str | Path, overrides: Mapping[str, Any] | None = None
) -> Problem | PendulumProblem:
    """Read and check a problem file; no wrong name or number is found later.

    A file with the key ``model`` (``rmp_planar`` or ``rmp_solid``) is a pendulum's problem, one
    with ``gait`` a walk.

    Parameters
    ----------
    path:
        The file; ``-`` is stdin.
    overrides:
        Values by key path, such as ``{"tasks.com.gain": 0.3}``, that replace the file's. They are
        checked like the file.

    Raises
    ------
    ProblemFileError
        With every mistake found: file, line, key path, what is wrong and what is valid.
    InvalidInputError
        No path, or no mapping of overrides.
    """
    if not isinstance(path, str | Path):
        raise InvalidInputError(f"load_problem: expected the path of a file, got {shown(path)}")
    check_path("load_problem", path)
    overrides = dict(by_name("load_problem, overrides", {} if overrides is None else overrides))
    source = read_source(Path(path))
    refuse_other_files(source)
    return problem_of(source, overrides)


def problem_of(source: Source, overrides: Mapping[str, Any]) -> Problem | PendulumProblem:
    """Return the problem of a file that was read; see :func:`load_problem`.

    Raises ProblemFileError: with every mistake found.
    """
    source = apply_overrides(source, overrides)
    if isinstance(source.data, dict) and "model" in source.data:
        # Only now: a robot's problem need not wait for CasADi to load.
        from wbc.problem.pendulum.problem import load_pendulum

        return load_pendulum(source, overrides, Path(source.name).parent)
    return _unpickled(source, overrides)


def refuse_other_files(source: Source) -> None:
    """Raise if the file is a result that wbc wrote, or for another command, not a problem."""
    for key, what, command in (
        ("problems", "a campaign of problems", "batch"),
        ("motion", "a human's motion for a robot", "retarget"),
    ):
        if key in source.data and "tasks" not in source.data:
            raise ProblemFileError(
                f"{source.name}: is {what}, not a problem: wbc {command} {quote(source.name)}"
            )
    kind = source.data.get("format", source.data.get("kind"))
    if not isinstance(kind, str) or ("status" not in source.data and "maps" not in source.data):
        return
    if "maps" in source.data:
        raise ProblemFileError(
            f"{source.name}: is what wbc push wrote ({kind}), not a problem; its numbers are in it,"
            " and its picture is drawn by: wbc push PROBLEM.yaml --plot FILE.png"
        )
    made_of, motion = source.data.get("problem"), Path(source.name).with_suffix(".npz")
    problem = made_of.get("file") if isinstance(made_of, dict) else None
    run = "sim" if "simulation" in source.data else "run"
    raise ProblemFileError(
        f"{source.name}: is the summary of a result, not a problem, and holds no motion; write"
        f" that, too, and name its file: wbc {run} {quote(str(problem or 'PROBLEM.yaml'))} -o"
        f" {quote(str(motion))}"
    )


def _unpickled(source: Source, overrides: Mapping[str, Any]) -> Problem:
    """Return the problem of a source whose overrides are applied already."""
    spec = read_problem(source)
    return Problem(source, overrides, spec, build(spec, source, Path(source.name).parent))


def load_same_text(
    path: Path, overrides: Mapping[str, Any], text: str
) -> Problem | PendulumProblem:
    """Load a problem in a worker process, if its file still has the same ``text``.

    Raises ProblemFileError: as :func:`load_problem` does; InvalidInputError: the file has changed.
    """
    problem = load_problem(path, overrides)
    if problem.source.text != text:
        raise InvalidInputError(f"{path}: was changed meanwhile; begin anew")
    return problem
