"""What tasks and constraints of one's own return is looked at in every tick, on every path."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix

import wbc
from wbc.constraints import Bounds, Constraint, Limits, Margin, support
from wbc.constraints.rows import Distances
from wbc.controllers import KinematicController, TorqueController
from wbc.errors import InvalidInputError
from wbc.laws import Residual, Rows
from wbc.robot import Robot
from wbc.tasks import ForceTask, PositionTask, PostureTask, Task
from wbc.tasks.force_task import Affine

# NumPy says so of np.matrix, which some still use.
pytestmark = pytest.mark.filterwarnings("ignore:the matrix subclass:PendingDeprecationWarning")

LATER = 3  # ticks in which all is well
LEVELS = {"velocity": KinematicController, "torque": TorqueController}


class Mine(Task):
    """The CoM's, until something else is put in its place."""

    def __init__(self, robot: Robot, name: str = "mine") -> None:
        super().__init__(robot, name, ("x", "y", "z"))
        self.__dict__["change"] = lambda residual: residual

    def residual(self, snapshot):
        error = np.array(snapshot.com) - [0.0, 0.0, 0.28]
        return self.change(Residual(error, np.array(snapshot.com_jacobian), np.zeros(3)))

    def drift(self, snapshot):
        return np.array(snapshot.com_drift)


class Still(Mine):
    """The same, met already: it may be a contact."""

    def residual(self, snapshot):
        return self.change(Residual(np.zeros(3), np.array(snapshot.com_jacobian), np.zeros(3)))


class Drifting(Mine):
    """The same, whose drift changes."""

    def residual(self, snapshot):
        return Residual(np.zeros(3), np.array(snapshot.com_jacobian), np.zeros(3))

    def drift(self, snapshot):
        return self.change(super().drift(snapshot))


def place(name: str, value):
    def change(residual: Residual) -> Residual:
        return residual._replace(**{name: value(getattr(residual, name))})

    return change


def with_(array: np.ndarray, where, value: float) -> np.ndarray:
    array = array.copy()
    array[where] = value
    return array


WRONG = {
    "jacobian": {
        "complex": lambda J: J + 0j,
        "objects": lambda J: J.astype(object),
        "words": lambda J: J.astype(str),
        "truth values": lambda J: J > 0.0,
        "matrix": np.matrix,
        "masked": lambda J: np.ma.array(J, mask=J > 0.0),
        "sparse": csr_matrix,
        "columns missing": lambda J: J[:, :-20],
        "column too many": lambda J: np.hstack((J, J[:, :1])),
        "row missing": lambda J: J[:2],
        "transposed": lambda J: J.T,
        "NaN": lambda J: with_(J, (0, 7), np.nan),
        "infinite": lambda J: with_(J, (1, 9), np.inf),
        "huge": lambda J: 1e200 * J,
        "None": lambda J: None,
    },
    "error": {
        "NaN": lambda e: with_(e, 0, np.nan),
        "infinite": lambda e: with_(e, 1, -np.inf),
        "huge": lambda e: with_(e, 2, 1e149),
        "complex": lambda e: e + 1j,
        "a column": lambda e: e[:, None],
        "a number": lambda e: e[0],
        "masked": lambda e: np.ma.array(e, mask=[True, False, False]),
    },
    "bias": {
        "NaN": lambda b: with_(b, 2, np.nan),
        "row missing": lambda b: b[:2],
        "complex": lambda b: b + 0j,
    },
    "curvature": {"NaN": lambda _: np.full((3, 3), np.nan), "words": lambda _: "flat"},
    "curvature_bound": {
        "NaN": lambda _: np.nan,
        "negative": lambda _: -1.0,
        "wrong size": lambda _: np.ones(3),
    },
}
CASES = [(field, how) for field, ways in WRONG.items() for how in ways]
PLAIN = {
    "integers": lambda J: np.rint(3.0 * J).astype(int),
    "single precision": lambda J: J.astype("f4"),
    "Fortran's order": np.asfortranarray,
    "strided": lambda J: np.repeat(J, 2, 1)[:, ::2],
    "other bytes": lambda J: J.astype(">f8"),
    "lists": lambda J: J.tolist(),
}


def controller_of(robot: Robot, level: str, task: Task, as_contact: bool = False, **options):
    here = robot.snapshot(robot.posture("standing"))
    posture, held = PostureTask(robot, here.q, weight=0.1), support(here, "double")
    tasks = [posture] if as_contact else [posture, task]
    contacts = [held[0], task] if as_contact else held
    given = {"contacts": contacts, "limits": Limits(robot), **options}
    return LEVELS[level](robot, tasks, **given), here


def given_up(level: str, task: Task, change, part=None, **options) -> str:
    """What the error says once a part, by default the task, returns something else."""
    controller, here = controller_of(task.robot, level, task, **options)
    for _ in range(LATER):
        assert controller.step(here).ok
    (task if part is None else part).__dict__["change"] = change
    with pytest.raises(InvalidInputError) as caught:
        controller.step(here)
    return str(caught.value)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize(("field", "how"), CASES)
def test_odd_return_of_a_later_tick_is_refused_by_name(hoap2, level: str, field, how) -> None:
    said = given_up(level, Mine(hoap2), place(field, WRONG[field][how]))
    assert said.startswith("task 'mine': residual()") and field in said


@pytest.mark.parametrize("bound", [-1.0, np.ones(3), "little"])
def test_odd_bound_on_curvature_is_refused_where_it_is_asked_for(hoap2, bound) -> None:
    """The velocity level asks tasks with gains for it."""
    said = given_up("velocity", Mine(hoap2), place("curvature_bound", lambda _: lambda: bound))
    assert said.startswith("task 'mine': residual(), curvature_bound")


@pytest.mark.parametrize("how", ["complex", "columns missing", "NaN", "masked"])
@pytest.mark.parametrize(
    "options", [{}, {"solver": "daqp"}, {"slack": {"mine": 10.0}}], ids=["proxqp", "daqp", "soft"]
)
def test_odd_return_of_a_contact_is_refused_by_name(hoap2, how: str, options) -> None:
    change = place("jacobian", WRONG["jacobian"][how])
    said = given_up("velocity", Still(hoap2), change, as_contact=True, **options)
    assert said.startswith("task 'mine': residual()") and "jacobian" in said


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("what", [None, "com", (np.zeros(3),) * 3, [1.0, 2.0]])
def test_return_that_is_no_residual_is_refused_by_name(hoap2, level: str, what) -> None:
    said = given_up(level, Mine(hoap2), lambda _: what)
    assert "task 'mine': residual() must return Residual" in said


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("how", PLAIN)
def test_plain_numbers_of_other_kinds_are_converted(hoap2, level: str, how: str) -> None:
    """Oracle: the same numbers as a float array."""
    commands = []
    for change in (PLAIN[how], lambda J: np.array(np.asarray(PLAIN[how](J)), dtype=float)):
        task = Mine(hoap2)
        controller, here = controller_of(hoap2, level, task)
        task.__dict__["change"] = place("jacobian", change)
        commands.append(controller.step(here).velocity)
    np.testing.assert_array_equal(*commands)


@pytest.mark.parametrize("how", ["complex", "NaN", "a number", "masked", "infinite"])
def test_odd_drift_is_refused_by_name(hoap2, how: str) -> None:
    said = given_up("torque", Drifting(hoap2), WRONG["error"][how])
    assert said.startswith("task 'mine': drift()")


def test_odd_deviation_is_refused_by_name(hoap2) -> None:
    class Degrees(Mine):
        def deviation(self, snapshot, residual):
            return residual.error[:2]

    controller, here = controller_of(hoap2, "velocity", Degrees(hoap2))
    with pytest.raises(InvalidInputError, match=r"task 'mine': deviation.*shape"):
        controller.step(here)


class Push(ForceTask):
    def __init__(self, robot: Robot) -> None:
        super().__init__(robot, "push", ("fx", "fy", "fz"), weight=0.01)
        self.__dict__["change"] = lambda affine: affine

    def expression(self, dynamics):
        wrench = dynamics.wrench("left_sole")[:3].copy()
        return self.change(Affine(wrench, np.zeros(3)))


@pytest.mark.parametrize("how", ["complex", "masked", "sparse", "columns missing", "NaN", "None"])
def test_odd_expression_of_a_force_task_is_refused_by_name(hoap2, how: str) -> None:
    change = WRONG["jacobian"][how]
    said = given_up("torque", Push(hoap2), lambda a: a._replace(matrix=change(a.matrix)))
    assert said.startswith("task 'push': expression(), matrix")


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("kind", [ValueError, KeyError, ZeroDivisionError, RuntimeError])
def test_what_a_task_raises_is_raised_with_its_name(hoap2, level: str, kind) -> None:
    def fail(residual):
        raise kind("mine")

    task = Mine(hoap2)
    controller, here = controller_of(hoap2, level, task)
    controller.step(here)
    task.__dict__["change"] = fail
    with pytest.raises(kind) as caught:
        controller.step(here)
    assert any("residual() of task 'mine', a Mine" in note for note in caught.value.__notes__)


@pytest.mark.parametrize("level", LEVELS)
def test_target_that_is_odd_is_refused_and_the_next_tick_is_as_before(hoap2, level: str) -> None:
    task = PositionTask(hoap2, "left_palm", [0.1, 0.2, 0.3], name="hand")
    controller, here = controller_of(hoap2, level, task)
    controller.step(here)
    before = controller.step(here).velocity
    masked = np.ma.array([0.0, 0.0, 0.0], mask=[True, False, False])
    for odd in (masked, [True, False, True], [1j, 0, 0], ["1", "2", "3"], [np.nan, 0, 0], None):
        with pytest.raises(InvalidInputError, match="task 'hand', target"):
            task.target = odd
    np.testing.assert_allclose(controller.step(here).velocity, before, atol=1e-9)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", ["units", "reported_rows"])
@pytest.mark.parametrize("odd", [None, "rad", lambda self: ("m", "m", "m"), (1, 2, 3)])
def test_words_that_are_none_are_refused_when_the_controller_is_made(
    hoap2, level: str, name: str, odd
) -> None:
    """A method where a property is asked for ended in "'method' object is not iterable"."""
    kind = type("Odd", (Mine,), {name: odd})
    with pytest.raises(InvalidInputError, match=f"task 'mine': {name}, a property: expected"):
        controller_of(hoap2, level, kind(hoap2))


# ---------------------------------------------------------------------------- constraints


class Box(Constraint):
    """The CoM gets no faster than 1 m/s, until something else is put in its place."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.name, self.change = robot, "box", lambda bounds: bounds

    def rows(self, snapshot, dt):
        J = np.array(snapshot.com_jacobian)
        return self.change(Bounds(("x", "y", "z"), J, np.full(3, -1.0), np.full(3, 1.0)))


WRONG_BOUNDS = {
    **{("matrix", how): WRONG["jacobian"][how] for how in WRONG["jacobian"]},
    ("lower", "NaN"): lambda a: with_(a, 0, np.nan),
    ("lower", "above upper"): lambda a: a + 5.0,
    ("upper", "row missing"): lambda a: a[:2],
    ("upper", "complex"): lambda a: a + 0j,
    ("lower", "masked"): lambda a: np.ma.array(a, mask=[True, False, False]),
    ("labels", "number"): lambda _: ("x", "y", 3),
    ("labels", "word"): lambda _: "xyz",
    ("slack", "negative"): lambda _: np.array([1.0, -1.0, 1.0]),
    ("push", "list"): lambda _: [1.0],
    ("push", "columns missing"): lambda _: Rows(np.eye(3), np.ones(3), np.ones(3)),
    ("push", "bias too short"): lambda _: Rows(np.eye(3, 31), *np.ones((2, 3)), bias=np.ones(2)),
}


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize(("field", "how"), WRONG_BOUNDS)
def test_odd_rows_of_a_constraint_are_refused_by_name(hoap2, level: str, field, how) -> None:
    box, change = Box(hoap2), place(field, WRONG_BOUNDS[field, how])
    said = given_up(level, Mine(hoap2), change, part=box, constraints=[box])
    assert said.startswith("constraint 'box'") and field in said


def test_what_a_constraint_raises_is_raised_with_its_name(hoap2) -> None:
    def fail(bounds):
        raise KeyError("mine")

    box = Box(hoap2)
    controller, here = controller_of(hoap2, "velocity", Mine(hoap2), constraints=[box])
    controller.step(here)
    box.change = fail
    with pytest.raises(KeyError) as caught:
        controller.step(here)
    assert any("rows() of constraint 'box', a Box" in note for note in caught.value.__notes__)


class Rope(Margin):
    """The CoM stays below a height, until something else is put in its distances' place."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot, "rope", None)
        self.change, self.curvature = lambda distances: distances, np.zeros(2)

    def distances(self, snapshot, keys=None):
        rise, below = np.array(snapshot.com_jacobian)[2], 0.5 - snapshot.com[2]
        return self.change(
            Distances(np.arange(2), np.array([below, 1.0]), -np.stack((rise, rise)), np.zeros(2))
        )

    def labels(self, distances):
        return ("taut", "far")[: distances.keys.size]

    def curvature_bound(self, distances, step):
        return self.curvature


WRONG_DISTANCES = {
    **{("jacobian", how): WRONG["jacobian"][how] for how in WRONG["jacobian"]},
    ("jacobian", "row missing"): lambda a: a[:1],
    ("keys", "descending"): lambda a: a[::-1],
    ("keys", "words"): lambda a: a.astype(str),
    ("keys", "one too few"): lambda a: a[:1],
    ("keys", "a number"): lambda a: 1,
    ("clearance", "NaN"): lambda a: with_(a, 0, np.nan),
    ("clearance", "minus infinity"): lambda a: with_(a, 0, -np.inf),
    ("clearance", "masked"): lambda a: np.ma.array(a, mask=[True, False]),
    ("rate", "a number"): lambda a: 0.0,
    ("rate", "infinite"): lambda a: with_(a, 0, np.inf),
}


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize(("field", "how"), WRONG_DISTANCES)
def test_odd_distances_of_a_margin_are_refused_by_name(hoap2, level: str, field, how) -> None:
    rope, change = Rope(hoap2), place(field, WRONG_DISTANCES[field, how])
    said = given_up(level, Mine(hoap2), change, part=rope, constraints=[rope])
    assert said.startswith("constraint 'rope': distances()")
    assert field in said or how == "one too few"


@pytest.mark.parametrize("odd", [np.array([np.nan, 0.0]), np.full(2, -1.0), np.zeros(3), None])
def test_odd_curvature_bounds_of_a_margin_are_refused(hoap2, odd) -> None:
    """NaN left look-ahead out in silence."""
    rope = Rope(hoap2)
    controller, here = controller_of(hoap2, "velocity", Mine(hoap2), constraints=[rope])
    controller.step(here)
    rope.curvature = odd
    with pytest.raises(InvalidInputError, match=r"'rope': curvature_bound\(\)"):
        controller.step(here)


def test_nothing_near_may_be_an_infinite_clearance(hoap2) -> None:
    rope = Rope(hoap2)
    controller, here = controller_of(hoap2, "velocity", Mine(hoap2), constraints=[rope])
    rope.change = lambda distances: distances._replace(clearance=np.full(2, np.inf))
    with np.errstate(all="raise"):
        assert controller.step(here).ok


def test_errors_are_deviations_in_a_tick_without_a_solution_too(hoap2) -> None:
    class Mine(wbc.MomentumTask):
        def residual(self, snapshot):
            return super().residual(snapshot)

    here = hoap2.snapshot(hoap2.posture("standing"), np.full(hoap2.nv, 0.1))
    place, level = here.position("left_sole"), here.rotation("left_sole")
    contacts = [
        wbc.Contact(hoap2, "left_sole", place, level),
        wbc.PointContact(hoap2, "left_foot", place + 1.0, level),
    ]
    controller = wbc.KinematicController(hoap2, [Mine(hoap2)], contacts=contacts)
    tick = controller.step(here)
    assert not tick.ok
    np.testing.assert_allclose(tick.errors["momentum"], here.momentum, rtol=1e-9)
