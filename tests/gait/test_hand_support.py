"""A hand reaches for a wall when a push carries the capture point beyond the soles."""

import copy
import dataclasses
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.conftest import load
from wbc.constraints import Limits, PointContact, support
from wbc.controllers import KinematicController, TorqueController
from wbc.errors import InvalidInputError, ProblemFileError, UnknownNameError
from wbc.gait import Arm, Hand, HandSupport, LeanSettings, Wall, WithHands
from wbc.gait.hand_states import HandsFree, Leaning, Reaching, Withdrawing
from wbc.gait.swing import SPEED_UP, SwingMotion
from wbc.problem import load_problem
from wbc.problem.problem import Problem
from wbc.robot import Robot, Snapshot
from wbc.simulation import FallLimits, Plant, Terrain, simulate
from wbc.tasks import ComTask, PostureTask

PROBLEM = Path(__file__).parents[2] / "problems" / "wall_g1.yaml"
LEFT = Hand("left_rubber_hand")
RAIL_AWAY = Wall((0.0, 0.5, 1.0), (0.0, 1.0, 0.0), (1.0, 0.05))


@pytest.fixture(scope="module")
def start(g1: Robot) -> Snapshot:
    return g1.snapshot(g1.postures["standing"])


def wall_at(distance: float) -> Wall:
    return Wall((0.0, distance, 0.9), (0.0, -2.0, 0.0))  # type: ignore[arg-type]


def controller(start: Snapshot) -> TorqueController:
    robot = start.robot
    tasks = [ComTask(robot, start.com, weight=10.0), PostureTask(robot, start.q, weight=0.1)]
    return TorqueController(robot, tasks, contacts=support(start, "double"))


def shoulder_roll(start: Snapshot) -> np.ndarray:
    way = np.zeros(start.robot.nq)
    way[7 + start.robot.limits.names.index("left_shoulder_roll_joint")] = 1.0
    return way


def velocities(start: Snapshot) -> KinematicController:
    return KinematicController(start.robot, [PostureTask(start.robot, start.q)], contacts=())


def hand_support(
    start: Snapshot, led: Any = None, hands: Any = (LEFT,), walls: Any = None, settings: Any = None
) -> HandSupport:
    walls = [wall_at(0.5)] if walls is None else walls
    return HandSupport(led or controller(start), start, hands, walls, settings)


def against_a_wall(start: Snapshot, frame: str, **other: Any) -> PointContact:
    return PointContact.hold(start, frame, normal=(0, -1, 0), **other)


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, -1, 0), (1, 2, -0.5), (0, 0, -1)])
def test_a_point_contact_bears_what_its_cone_has(start, normal) -> None:
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
def test_walls_that_cannot_be_leant_on_are_refused(start, distance, said) -> None:
    with pytest.raises(InvalidInputError, match=said):
        hand_support(start, walls=[wall_at(distance)])


@pytest.mark.parametrize("height", [-2.0, 5.0])
def test_how_far_a_robot_leans_does_not_hang_on_where_the_ground_is(start, height) -> None:
    """In a pit every wall was out of reach, and on a roof none."""
    q = start.q.copy()
    q[2] += height
    there = start.robot.snapshot(q)
    near, far = (
        Wall((0.0, distance, 0.9 + height), (0.0, -1.0, 0.0))  # type: ignore[arg-type]
        for distance in (0.5, 2.0)
    )
    HandSupport(controller(there), there, [LEFT], [near])
    with pytest.raises(InvalidInputError, match="is out of reach of left_rub"):
        HandSupport(controller(there), there, [LEFT], [far])


MISTAKES: dict[str, tuple[Callable[[Snapshot], object], str]] = {
    "a level face": (lambda s: Wall(np.zeros(3), (0, 0, 1)), "is not horizontal"),
    "no normal": (lambda s: Wall(np.zeros(3), (0, 0, 0)), "normal: needs some length"),
    "no width": (lambda s: Wall(np.zeros(3), (0, 1, 0), (1, 0)), "size: must be positive"),
    "ice": (lambda s: Wall(np.zeros(3), (0, 1, 0), friction=0.0), "friction: must be greater than"),
    "no walls": (lambda s: hand_support(s, walls=[]), "there are none"),
    "a hand's name": (lambda s: hand_support(s, hands=[LEFT.frame]), "support, hands: expected a "
                      r"list of Hand objects, such as \[Hand\(.*in the list is 'l"),
    "one hand": (lambda s: hand_support(s, hands=LEFT), "hands: expected a list of Hand objects"),
    "a hand twice": (lambda s: hand_support(s, hands=[LEFT, Hand(LEFT.frame, 0.02)]),
                     "support, hands: 'left_rubber_hand' is named twice"),
    "settings by name": (lambda s: hand_support(s, settings={"begin": 0.01}),
                         r"settings: expected a LeanSettings, .* got \{'begin'"),
    "velocities": (lambda s: hand_support(s, velocities(s)),
                   "expected a TorqueController.*got KinematicController"),
    "no controller": (lambda s: HandSupport(None, s, [LEFT], [wall_at(0.5)]),
                      "expected a TorqueController.*got None"),
    "a posture": (lambda s: hand_support(s).prepare(s.q), r"expected a snapshot of g1.*got array"),
    "a sole": (lambda s: hand_support(s, hands=[Hand("left_sole")]),
               "hand 'left_sole': is on the leg of g1's foot 'left'"),
    "a sole in the physics": (lambda s: Plant(s.robot, hands=[Hand("left_sole")]),
                              "hand 'left_sole': is on the leg"),
    "a name in the physics": (lambda s: Plant(s.robot, hands=[LEFT.frame]),
                              "plant, hands: expected a list of Hand objects"),
    "a hand twice in the physics": (lambda s: Plant(s.robot, hands=[LEFT, LEFT]),
                                    "plant, hands: 'left_rubber_hand' is named twice"),
    "one wall": (lambda s: Terrain(walls=wall_at(0.5)), "terrain, walls: expected a list of Wall"),
    "a wall's values": (lambda s: Terrain(walls=[{"point": (0, 1, 1)}]), "terrain, walls: expected "
                        "a list of Wall objects.*in the list is {'point'"),
    "a normal without a cone": (lambda s: against_a_wall(s, LEFT.frame, friction=None),
                                "normal: without friction.*has no effect"),
    "a normal of the base": (lambda s: against_a_wall(s, "base"),
                             "'base', normal: what holds the base also pulls"),
    "a normal that loses its cone": (
        lambda s: setattr(against_a_wall(s, LEFT.frame), "friction", None),
        "normal: without friction.*has no effect"),
    "a wall that looks away": (lambda s: hand_support(s, walls=[RAIL_AWAY]), "the CoM is 0.50 m "
                               "behind wall 0 at the start; its normal points at the robot"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_first_mistakes_are_told(start: Snapshot, mistake: str) -> None:
    make, said = MISTAKES[mistake]
    with pytest.raises(InvalidInputError, match=said):
        make(start)


def test_an_arm_is_as_quick_as_the_torques_and_speeds_that_it_may_use(start: Snapshot) -> None:
    tasks = [ComTask(start.robot, start.com), PostureTask(start.robot, start.q)]
    parts = {"contacts": support(start, "double"), "torque_limits": 0.25}
    parts["limits"] = Limits(start.robot, velocity=0.5)
    (arm,) = hand_support(start, TorqueController(start.robot, tasks, **parts)).arms.values()
    whole = Arm.of(start.robot, LEFT.frame)
    assert arm.acceleration == pytest.approx(0.25 * whole.acceleration)
    assert arm.speed == pytest.approx(0.5 * whole.speed)


def test_an_arm_without_motors_is_refused(start: Snapshot) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'left_rubber_hand'"):
        HandSupport(controller(start), start, [Hand("left_ruber_hand")], [wall_at(0.5)])
    limits = start.robot.limits
    weak = dataclasses.replace(limits, effort=np.zeros_like(limits.effort))
    robot = copy.copy(start.robot)
    object.__setattr__(robot, "limits", weak)
    with pytest.raises(InvalidInputError, match=r"left_shoulder.* need motors"):
        Arm.of(robot, LEFT.frame)


def test_a_wall_ends_where_its_face_does(start: Snapshot) -> None:
    rail = Wall((0.0, 0.5, 1.0), (0.0, -1.0, 0.0), (1.0, 0.05))  # type: ignore[arg-type]
    assert rail.gap(np.array((0.4, 0.4, 1.0)), 0.03) == pytest.approx(0.07)
    assert rail.gap(np.array((0.4, 0.6, 1.02)), 0.03) == pytest.approx(-0.13)
    assert rail.gap(np.array((0.4, 0.484, 0.963)), 0.03) == pytest.approx(0.02 - 0.03)  # its edge
    assert rail.gap(np.array((0.4, 0.51, 0.955)), 0.03) == np.inf  # under it, not on it
    assert rail.gap(np.array((0.4, 0.47, 1.3)), 0.03) == np.inf
    assert rail.gap(np.array((0.54, 0.47, 1.0)), 0.03) == np.inf
    away = np.array((0.2, 0.2, 1.3))
    np.testing.assert_allclose(rail.touched(away, 0.02), (0.2, 0.48, 1.005), atol=1e-12)
    # A hand beside a narrow wall, behind its plane, is neither in its way nor on it.
    x, y, _ = start.position(LEFT.frame)
    narrow = Wall((x + 0.4, y - 0.01, 0.9), (0.0, -1.0, 0.0), (0.5, 1.0))
    held = controller(start)
    hands = HandSupport(held, start, [LEFT], [narrow])
    there = SwingMotion.rest(start.position(LEFT.frame))
    hands.state = Reaching(LEFT, narrow, there, 0.2)
    hands.prepare(start)
    assert isinstance(hands.state, Reaching)
    assert len(held.contacts) == 2


def test_a_hand_begins_where_it_is_and_late_goes_on_evenly(start, caplog) -> None:
    held = controller(start)
    settings = LeanSettings(begin=0.3, end=0.4)
    hands = HandSupport(held, start, [LEFT], [wall_at(0.5)], settings)
    assert "without a push, too" in caplog.text
    moved = start.robot.snapshot(start.q + 0.2 * shoulder_roll(start))
    hands.prepare(moved)
    reach = next(task for task in held.tasks if task.name == f"{LEFT.frame} reach")
    assert isinstance(hands.state, Reaching)
    np.testing.assert_array_equal(reach.target, moved.position(LEFT.frame))
    rates = list[np.ndarray]()
    while isinstance(hands.state, Reaching):  # a hand that never moves comes late, and misses
        if hands.state.left <= held.dt:
            rates.append(hands.state.motion.rate)
        hands.prepare(moved)
    late = np.diff(rates, axis=0) / held.dt
    assert np.linalg.norm(late, axis=1).max() < SPEED_UP + 1e-9
    np.testing.assert_allclose(rates[-1], (0.0, settings.late, 0.0), atol=1e-12)
    assert "missed the wall" in hands.notes[-1]


def test_lost_frames_do_not_delay_a_hand(start: Snapshot) -> None:
    """At a dropout of 0.4 it arrived at a wall 0.1 s later than planned."""
    left = []
    for ticks in (range(11), (0, 3, 10)):
        held = controller(start)
        hands = hand_support(start, held, settings=LeanSettings(begin=0.3, end=0.4))
        first: Any = SimpleNamespace(update=lambda tick, now, held=held: held)
        supervisor = WithHands(first, hands)
        for tick in ticks:
            supervisor.update(tick, start)
        assert isinstance(hands.state, Reaching)
        left.append(hands.state.left)
    assert left[1] == pytest.approx(left[0], abs=1e-12)


def test_a_released_hand_is_let_go_though_another_one_touches_meanwhile(start: Snapshot) -> None:
    held, right = controller(start), Hand("right_rubber_hand")
    away = float(start.position(LEFT.frame)[1]) + LEFT.radius + 2e-3
    walls = [Wall((0.0, y, 0.9), (0.0, -y, 0.0)) for y in (away, -away)]
    settings = LeanSettings(begin=0.0, end=1e-3, touch=1e-3, ramp=0.05)
    hands = HandSupport(held, start, [LEFT, right], walls, settings)
    hands.settings = dataclasses.replace(settings, touch=3e-3)
    there = {hand: SwingMotion.rest(start.position(hand.frame)) for hand in (LEFT, right)}
    hands.state = Reaching(LEFT, walls[0], there[LEFT], 0.1)
    hands.prepare(start)
    assert isinstance(hands.state, Leaning)
    for _ in range(30):
        held.step(start)
    hands.state = hands.state._replace(time=1.0)
    moved = start.robot.snapshot(start.q - 0.01 * shoulder_roll(start))
    hands.prepare(moved)
    assert isinstance(hands.state, Withdrawing)
    reach = next(task for task in held.tasks if task.name == f"{LEFT.frame} reach")
    np.testing.assert_array_equal(reach.target, moved.position(LEFT.frame))
    held.step(start)
    assert LEFT.frame in [one.name for one in held.contacts]  # its force goes
    hands.state = Reaching(right, walls[1], there[right], 0.1)
    hands.prepare(start)
    assert isinstance(hands.state, Leaning)
    for _ in range(40):
        held.step(start)
    assert {one.name for one in held.contacts} == {"left_sole", "right_sole", right.frame}


def test_another_hand_takes_over_and_the_first_one_rests(start: Snapshot) -> None:
    held, right = controller(start), Hand("right_rubber_hand")
    wall = wall_at(0.5)
    hands = HandSupport(held, start, [LEFT, right], [wall], LeanSettings(begin=0.3, end=0.4))
    hands.arms[right] = dataclasses.replace(hands.arms[right], trunk="pelvis")
    there = SwingMotion.rest(start.position(right.frame))
    by_name = {task.name: task for task in held.tasks}
    off = f"{right.frame} reach", "pelvis by a wall"
    hands._trunk["pelvis"] = by_name["torso_link by a wall"].__class__(
        start.robot, "pelvis", start.rotation("pelvis"), weight=10.0, name=off[1]
    )
    by_name[off[1]] = hands._trunk["pelvis"]
    by_name[off[0]].weight = 10.0
    hands.state = Withdrawing(right, wall, there, start.position(right.frame), 0.2)
    hands.prepare(start)
    assert isinstance(hands.state, Reaching)
    assert hands.state.hand is LEFT
    assert not any(by_name[name].weight.any() for name in off)
    assert by_name["torso_link by a wall"].weight.all()


def test_nothing_happens_while_the_soles_suffice(start: Snapshot) -> None:
    plain, watched = controller(start), controller(start)
    hands = HandSupport(watched, start, [LEFT], [wall_at(0.5)])
    hands.prepare(start)
    assert isinstance(hands.state, HandsFree)
    assert hands.beyond(start, hands.walls[0]) == pytest.approx(-0.15, abs=0.02)
    np.testing.assert_allclose(watched.step(start).torque, plain.step(start).torque, atol=1e-6)


def test_a_file_says_where_hands_are_wrong() -> None:
    values = {"simulation.terrain.walls": [], "hands.settings": {"bgin": 0.1}}
    with pytest.raises(ProblemFileError, match="begin"):
        load_problem(PROBLEM, values)
    with pytest.raises(ProblemFileError, match="there are no walls to lean on"):
        load_problem(PROBLEM, {"simulation.terrain.walls": []})
    hand = LEFT.frame
    with pytest.raises(ProblemFileError, match=r"hands.frames: 'left_rubber_hand' is named twice"):
        load_problem(PROBLEM, {"hands.frames": [hand, hand]})
    with pytest.raises(ProblemFileError, match="hands: hand 'left_sole': is on the leg of g1's"):
        load_problem(PROBLEM, {"hands.frames": ["left_sole"]})


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
@pytest.mark.parametrize("face", [{"point": [0, 0.5, 0.9], "size": [1.6, 1.8]},
                                  {"point": [0, 0.5, 1.0], "size": [1.6, 0.1]}])  # fmt: skip
def test_a_g1_by_a_wall_survives_what_it_does_not_without_its_hand(face: dict[str, Any]) -> None:
    """It leant on a rail from below, as its hand came from there: it slid off, and the G1 fell."""
    wall = {**face, "normal": [0, -1, 0], "friction": 0.8}
    short: dict[str, Any] = {"simulation.duration": 2.5, "simulation.terrain.walls": [wall]}
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
    assert isinstance(led.hands.state, HandsFree)  # and it was released
    assert np.linalg.norm(plant.snapshot().com_velocity) < 0.05
    assert {Reaching, Leaning} < seen
    without = load_problem(PROBLEM, short | {"hands": None})
    assert isinstance(without, Problem)
    assert not without.simulate().verdict.stood
