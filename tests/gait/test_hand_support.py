"""A hand reaches for a wall when a push carries the capture point beyond the soles."""

from pathlib import Path

import numpy as np
import pytest

from tests.conftest import load
from wbc.constraints import PointContact, support
from wbc.controllers import TorqueController
from wbc.errors import InvalidInputError, ProblemFileError, UnknownNameError
from wbc.gait import Arm, Hand, HandSupport, Wall, WithHands
from wbc.gait.leaning import Leaning, Reaching, Watching
from wbc.problem import load_problem
from wbc.problem.problem import Problem
from wbc.robot import Snapshot
from wbc.simulation import FallLimits, Plant, Terrain, simulate
from wbc.tasks import ComTask, PostureTask

PROBLEM = Path(__file__).parents[2] / "problems" / "wall_g1.yaml"
LEFT = Hand("left_rubber_hand")


@pytest.fixture(scope="module")
def start() -> Snapshot:
    robot = load("g1")
    return robot.snapshot(robot.postures["standing"])


def wall_at(distance: float) -> Wall:
    return Wall((0.0, distance, 0.9), (0.0, -2.0, 0.0))  # type: ignore[arg-type]


def controller(start: Snapshot) -> TorqueController:
    robot = start.robot
    tasks = [ComTask(robot, start.com, weight=10.0), PostureTask(robot, start.q, weight=0.1)]
    return TorqueController(robot, tasks, contacts=support(start, "double"))


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, -1, 0), (1, 2, -0.5), (0, 0, -1)])
def test_a_point_contact_bears_what_its_cone_has(
    start: Snapshot, normal: tuple[float, ...]
) -> None:
    contact = PointContact.hold(start, LEFT.frame, normal=normal)
    held = TorqueController(start.robot, [PostureTask(start.robot, start.q)], contacts=[contact])
    rows = held.contact_forces.bounds()
    n = np.array(normal) / np.linalg.norm(normal)
    across = np.linalg.svd(n[None])[2][1:]

    def borne(force: np.ndarray) -> bool:
        values = rows.matrix @ force
        inside = (values <= rows.upper + 1e-9).all() and (values >= rows.lower - 1e-9).all()
        return bool(inside and (force >= held.contact_forces.lower - 1e-9).all())

    for angle in np.linspace(0.0, 2.0 * np.pi, 9):
        way = np.array((np.cos(angle), np.sin(angle))) @ across
        assert borne(n + 0.42 * way)  # the pyramid with four sides is inside of the cone of 0.6
        assert not borne(n + 0.61 * way)
        assert not borne(-0.01 * n)
    with pytest.raises(InvalidInputError, match="cannot be assigned"):
        contact.normal = n


def test_an_arm_is_what_its_model_says(start: Snapshot) -> None:
    arm = Arm.of(start.robot, LEFT.frame)
    names = [str(start.robot.model.names[joint]) for joint in arm.forearm]
    assert names[0] == "left_elbow_joint"
    assert len(names) == 4
    assert arm.trunk == "torso_link"
    rng = np.random.default_rng(0)
    q = start.q.copy()
    low, high = start.robot.limits.lower, start.robot.limits.upper
    for _ in range(200):  # no posture takes the hand farther
        q[7:] = rng.uniform(low, high)
        s = start.robot.snapshot(q)
        far = np.linalg.norm(s.position(LEFT.frame) - s.position(arm.shoulder))
        assert far < arm.length / 0.98 + 1e-12
    with pytest.raises(InvalidInputError, match="is 0 mm from left_shoulder_pitch"):
        Arm.of(load("hoap2_like"), "left_upper_arm")
    with pytest.raises(InvalidInputError, match="0 joints of g1 move it without the trunk"):
        Arm.of(start.robot, "torso_link")


@pytest.mark.parametrize(
    ("distance", "said"),
    [(0.2, "or behind it; its normal points at the robot"), (2.0, "is out of reach of left_rub")],
)
def test_walls_that_cannot_be_leant_on_are_refused(
    start: Snapshot, distance: float, said: str
) -> None:
    with pytest.raises(InvalidInputError, match=said):
        HandSupport(controller(start), start, [LEFT], [wall_at(distance)])


def test_what_is_no_wall_or_hand_is_refused(start: Snapshot) -> None:
    with pytest.raises(InvalidInputError, match="is not horizontal"):
        Wall(np.zeros(3), (0.0, 0.0, 1.0))  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="size: must be positive"):
        Wall(np.zeros(3), (0.0, 1.0, 0.0), (1.0, 0.0))  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="there are none"):
        HandSupport(controller(start), start, [LEFT], [])
    with pytest.raises(UnknownNameError, match="did you mean 'left_rubber_hand'"):
        HandSupport(controller(start), start, [Hand("left_ruber_hand")], [wall_at(0.5)])


def test_nothing_happens_while_the_soles_suffice(start: Snapshot) -> None:
    plain, watched = controller(start), controller(start)
    hands = HandSupport(watched, start, [LEFT], [wall_at(0.5)])
    hands.prepare(start)
    assert isinstance(hands.state, Watching)
    assert hands.beyond(start, hands.walls[0]) == pytest.approx(-0.15, abs=0.02)
    np.testing.assert_allclose(watched.step(start).torque, plain.step(start).torque, atol=1e-6)


def test_a_file_says_where_hands_are_wrong() -> None:
    values = {"simulation.terrain.walls": [], "hands.settings": {"bgin": 0.1}}
    with pytest.raises(ProblemFileError, match="begin"):
        load_problem(PROBLEM, values)
    with pytest.raises(ProblemFileError, match="there are no walls to lean on"):
        load_problem(PROBLEM, {"simulation.terrain.walls": []})


def test_a_wall_bears_a_hand_in_the_physics(start: Snapshot) -> None:
    wall = wall_at(float(start.position(LEFT.frame)[1]) + LEFT.radius - 1e-4)
    terrain = Terrain(walls=(wall,))
    plant = Plant(start.robot, terrain=terrain, hands=[LEFT])
    plant.reset(start.q)
    plant.step(np.zeros(start.robot.nv - 6))
    force = plant.contacts.force_at(LEFT.frame)
    assert force[1] < -1.0
    assert plant.touching() == ()
    assert Plant(start.robot, terrain=terrain).touching() == ()  # there is no ball without hands
    again = Terrain.from_data(terrain.to_data())
    np.testing.assert_array_equal(again.walls[0].point, wall.point)


@pytest.mark.slow
def test_a_g1_by_a_wall_survives_what_it_does_not_without_its_hand() -> None:
    short = {"simulation.duration": 2.5}
    problem = load_problem(PROBLEM, short)
    assert isinstance(problem, Problem)
    plant = problem.plant()
    led = problem.supervisor(plant)
    assert isinstance(led, WithHands)
    leant, falls, seen = 0.0, FallLimits(trunk="torso_link"), set[type]()
    for now in simulate(led.controller, plant, 2.5, update=led.update, falls=falls):
        assert now.verdict.stood, now.verdict.reason
        pressed = -float(plant.contacts.force_at(LEFT.frame)[1])
        assert pressed >= -1e-9
        leant += pressed * plant.dt
        seen.add(type(led.hands.state))
    assert leant > 10.0  # N s of the 39 that pushed it
    assert isinstance(led.hands.state, Watching)  # and it was released
    assert np.linalg.norm(plant.snapshot().com_velocity) < 0.05
    assert {Reaching, Leaning} < seen
    without = load_problem(PROBLEM, short | {"hands": None})
    assert isinstance(without, Problem)
    assert not without.simulate().verdict.stood
