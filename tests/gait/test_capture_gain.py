"""Where a standing robot's pivot is asked to be: in its soles, and beyond them at their edges."""

from pathlib import Path

import numpy as np
import pytest

from wbc.codegen import CodegenError
from wbc.codegen.recording import check_kind
from wbc.constraints import Contact, PointContact, support
from wbc.constraints.com_support import support_polygon
from wbc.controllers import KinematicController, TorqueController
from wbc.errors import InvalidInputError, ProblemFileError
from wbc.gait import CaptureGain
from wbc.polygon import polygon_margin
from wbc.problem import load_problem
from wbc.problem.problem import Problem
from wbc.problem.pushed_problem import PushedProblem, PushSettings
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, PostureTask

PROBLEM = Path(__file__).parents[2] / "problems" / "push_g1.yaml"
ONE_GAIN = {"tasks.com.law": {"type": "capture_point", "gain": 12}}


@pytest.fixture(scope="module")
def start(g1: Robot) -> Snapshot:
    return g1.snapshot(g1.postures["standing"])


def gain_of(start: Snapshot, feet: str = "double", **options: float) -> CaptureGain:
    robot = start.robot
    com = ComTask(robot, start.com, axes=["x", "y"], weight=30.0)
    tasks = [com, PostureTask(robot, start.q, weight=0.1)]
    controller = TorqueController(robot, tasks, contacts=support(start, feet))
    return CaptureGain(controller, com, **options)


def moving(start: Snapshot, capture_point: np.ndarray) -> Snapshot:
    """The robot as it stands, its base as fast as puts the capture point there."""
    # Frames of soles lie in them, level at the start.
    height = start.com[2] - start.position(start.robot.feet["left"].frame)[2]
    v = np.zeros(start.robot.nv)
    v[:2] = (capture_point - start.com[:2]) * np.sqrt(start.robot.gravity / height)
    return start.robot.snapshot(start.q, v)


def pivot(gain: CaptureGain, at: np.ndarray) -> np.ndarray:
    return at + gain.value * (at - np.asarray(gain.task.target)[:2])


def soles(start: Snapshot) -> np.ndarray:
    return np.asarray(support_polygon(start, ["left", "right"]))


def test_the_pivot_stays_in_the_soles_while_the_capture_point_is_well_inside(start) -> None:
    polygon, rng, seen = soles(start), np.random.default_rng(0), 0
    for _ in range(200):
        at = start.com[:2] + rng.uniform(-0.1, 0.1, 2)
        gain = gain_of(start)
        gain.prepare(moving(start, at))  # the first tick: how fast it moves is not known yet
        if polygon_margin(polygon, at) > 0.055:
            seen += 1
            assert 0.0 < gain.value <= 3.0 + 1e-12
            assert polygon_margin(polygon, pivot(gain, at)) > 0.0
        elif polygon_margin(polygon, at) < 0.015:
            seen += 1
            assert gain.value == 20.0
    assert seen > 100


def test_a_small_error_gets_the_gain_and_the_law_is_that_of_the_capture_point(start) -> None:
    gain = gain_of(start, gain=2.0, spin=9.0)
    gain.prepare(moving(start, start.com[:2] + (0.001, -0.001)))
    law = gain.task.acceleration_law
    assert gain.value == 2.0
    omega = law.velocity_gain / 3.0
    assert law.kp == pytest.approx(2.0 * omega**2, rel=1e-12)
    assert omega == pytest.approx(np.sqrt(start.robot.gravity / start.com[2]), rel=0.1)


def test_a_capture_point_on_its_way_out_gets_more_than_one_at_rest(start: Snapshot) -> None:
    at, rate = start.com[:2] + (0.0, 0.06), np.array((0.0, 0.8))  # m/s, as in a push
    values = []
    for way in (0.0, 1.0, -1.0):
        gain = gain_of(start)
        for k in range(-20, 1):
            gain.prepare(moving(start, at + way * rate * k * gain.controller.dt))
        values.append(gain.value)
    assert values[0] < 3.1 and values[1] > 10.0 and values[2] == pytest.approx(values[0])


def test_one_foot_has_the_edges_of_one_foot(start: Snapshot) -> None:
    robot = start.robot
    foot = start.position(robot.feet["left"].frame)[:2]
    gain = gain_of(start, feet="left")
    gain.task.set_target((*foot, 0.0))
    gain.prepare(moving(start, foot))
    assert gain.value == 3.0  # small soles: near means less
    gain.prepare(moving(start, foot - (0.0, 0.06)))
    assert gain.value == 20.0
    gain.controller.set_contacts(support(start, "double"))
    gain.prepare(moving(start, foot - (0.0, 0.06)))
    assert gain.value < 20.0


def test_soles_that_are_held_elsewhere_have_their_edges_there(start: Snapshot) -> None:
    gain = gain_of(start)
    for contact in gain.controller.contacts:
        contact.position = contact.position + (1.0, 0.0, 0.0)  # type: ignore[attr-defined]
    gain.prepare(moving(start, start.com[:2]))
    assert gain.value == 20.0


def test_without_soles_the_law_is_the_plain_one(start: Snapshot) -> None:
    gain = gain_of(start)
    hand = PointContact.hold(start, "left_rubber_hand", normal=(0.0, -1.0, 0.0))
    for contacts in ([], [hand]):
        gain.controller.set_contacts(contacts)
        gain.prepare(moving(start, start.com[:2] + (0.5, 0.5)))
        assert gain.value == 3.0
        assert np.isfinite(gain.task.acceleration_law.kp)


def test_a_palm_on_a_wall_widens_no_support(start: Snapshot) -> None:
    """Between the soles and the wall half a metre ahead there is nothing to stand on."""
    ahead = np.array(((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    corners, place = [[0.1, 0.0], [-0.1, 0.1], [-0.1, -0.1]], start.com + (0.5, 0.0, 0.3)
    palm = Contact(start.robot, "right_rubber_hand", place, ahead, corners=corners)
    gain = gain_of(start)
    gain.controller.set_contacts([*gain.controller.contacts, palm])
    gain.prepare(moving(start, start.com[:2] + (0.2, 0.0)))
    assert gain.value == 20.0


def test_an_axis_that_is_not_driven_says_nothing(start: Snapshot) -> None:
    robot = start.robot
    com = ComTask(robot, start.com + (0.0, 1.0, 0.0), axes=["x"])
    gain = CaptureGain(TorqueController(robot, [com], contacts=support(start, "double")), com)
    gain.prepare(moving(start, start.com[:2] + (0.001, 0.0)))
    assert gain.value == 3.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gain": 0.0}, "capture gain, gain"),
        ({"gain": np.nan}, "capture gain, gain"),
        ({"gain": 4.0, "spin": 3.0}, "capture gain, spin"),
        ({"spin": np.inf}, "capture gain, spin"),
    ],
)
def test_gains_out_of_range_are_named(start, options, message) -> None:
    with pytest.raises(InvalidInputError, match=message):
        gain_of(start, **options)


def test_what_is_no_balance_is_refused(start: Snapshot) -> None:
    robot = start.robot
    com = ComTask(robot, start.com, axes=["x", "y"])
    with pytest.raises(InvalidInputError, match="TorqueController"):
        CaptureGain(KinematicController(robot, [com], contacts=()), com)
    with pytest.raises(InvalidInputError, match="snapshot"):
        gain_of(start).prepare(start.q)  # type: ignore[arg-type]
    controller = TorqueController(robot, [com], contacts=support(start, "double"))
    with pytest.raises(InvalidInputError, match="axes x and y"):
        CaptureGain(controller, ComTask(robot, start.com))


def test_a_file_with_spin_below_gain_is_refused() -> None:
    with pytest.raises(ProblemFileError, match=r"tasks\.com\.law\.spin: is below gain, 3"):
        load_problem(PROBLEM, {"tasks.com.law": {"type": "capture_point", "gain": 3, "spin": 2}})


def test_exported_code_has_no_second_gain() -> None:
    problem = load_problem(PROBLEM)
    assert isinstance(problem, Problem)
    with pytest.raises(CodegenError, match=r"tasks\.com\.law\.spin: the gain is chosen in Python"):
        check_kind(problem)


def test_a_second_run_is_as_the_first() -> None:
    problem = load_problem(PROBLEM, {"simulation.duration": 0.5})
    assert isinstance(problem, Problem)
    first, second = (problem.simulate().arrays for _ in range(2))
    assert all((first[name] == second[name]).all() for name in ("torque", "com"))


@pytest.mark.slow
def test_pushes_that_one_gain_does_not_stop_are_stopped_by_two() -> None:
    stood = []
    for more in (ONE_GAIN, {}):
        problem = load_problem(PROBLEM, more)
        assert isinstance(problem, Problem)
        pushed = PushedProblem(problem, PushSettings(at=0.1))
        stood.append(
            [pushed(np.deg2rad(a), r).survived for a, r in ((56.25, 1.34), (168.75, 1.74))]
        )
    assert stood == [[False, False], [True, True]]
