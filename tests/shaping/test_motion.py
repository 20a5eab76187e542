"""From the answer to a motion: judged tick by tick by Pinocchio; mimic joints by their gears."""

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.urdf import geared_arm, limit
from wbc.constraints import ComSupport, Limits, PositionBox, SelfCollision, support
from wbc.controllers import KinematicController
from wbc.controllers.closed_loop import LoopTick
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.shaping import GlobalShaping
from wbc.shaping.motion import AT_REST, worst_violations
from wbc.tasks import ComTask, InertiaTask, PositionTask, PostureTask, Task


def tall(robot: Robot, q: np.ndarray, frame: str) -> InertiaTask:
    moments = np.diag(robot.snapshot(q).inertia_in("base"))
    return InertiaTask(
        robot, np.diag(moments * [1.2, 1.2, 0.5]), frame=frame, per_mass=True, weight=10.0
    )


def test_a_broken_constraint_on_the_way_is_told(hoap2) -> None:
    """A controller that does not know of the polygon: leaving it is noticed."""
    q = hoap2.posture()
    here = hoap2.snapshot(q)
    contacts = support(here, "left")  # the CoM is between the feet, outside this polygon
    task = ComTask(hoap2, [*contacts[0].position[:2], here.com[2]])
    away = GlobalShaping(hoap2, [ComTask(hoap2, here.com)], contacts)
    shaping = GlobalShaping(
        hoap2, [task], contacts, constraints=[ComSupport.over(here, "left", margin=0.0)]
    )
    outcome = shaping.solve(q, 4, workers=1)
    motion = shaping.reach(q, outcome, dt=0.01)
    assert motion.arrived  # from outside to inside is allowed
    assert motion.kept.support < 0.0
    inside = motion.q[-1]
    back = away.solve(inside, 1, workers=1)

    def unaware(tasks: list[Task]) -> KinematicController:
        return KinematicController(hoap2, tasks, contacts=contacts, limits=Limits(hoap2), dt=0.01)

    leaving = shaping.reach(inside, back, attempts=1, dt=0.01, make_controller=unaware)
    assert not leaving.arrived
    assert "com vs support edge" in leaving.attempts[0].reason


def test_every_tick_can_be_watched_and_the_time_limited(hoap2) -> None:
    q = hoap2.posture()
    shaping = GlobalShaping(hoap2, [tall(hoap2, q, "base")])
    outcome = shaping.solve(q, 2, workers=1)
    attempts: list[int] = []
    ticks: list[LoopTick] = []

    def watch(attempt: int, tick: LoopTick) -> None:
        attempts.append(attempt)
        ticks.append(tick)

    motion = shaping.reach(q, outcome, attempts=1, dt=0.01, watch=watch)
    assert motion.at_rest
    assert set(attempts) == {0}
    np.testing.assert_array_equal([tick.snapshot.q for tick in ticks], motion.q[:-1])
    np.testing.assert_array_equal([tick.tick.velocity for tick in ticks], motion.v[:-1])
    np.testing.assert_allclose([tick.time for tick in ticks], motion.time[:-1], atol=1e-12)
    assert all(tick.seconds > 0.0 for tick in ticks)
    # It ends with the tenth tick in a row that is slower than what counts as rest.
    slow = [tick.speed < AT_REST for tick in ticks[-11:]]
    assert slow == [False] + [True] * 10
    short = shaping.reach(q, outcome, attempts=1, dt=0.01, longest=0.5)
    assert (len(short.q), short.at_rest, short.arrived) == (51, False, False)
    assert "still moving when the time was over" in short.attempts[0].reason
    whole = shaping.reach(q, outcome, attempts=1, dt=0.01, longest=6.0, rest_speed=None)
    assert (len(whole.q), whole.at_rest, whole.arrived) == (601, False, True)
    watched: list[LoopTick] = []

    def enough(_: int, tick: LoopTick) -> bool:
        watched.append(tick)
        return len(watched) == 5

    ended = shaping.reach(q, outcome, attempts=2, dt=0.01, watch=enough)
    assert (len(watched), ended.arrived, len(ended.attempts)) == (5, False, 1)
    assert ended.attempts[0].reason == "interrupted"
    for name in ("longest", "rest_speed"):
        with pytest.raises(InvalidInputError, match=f"reach, {name}: must be greater than 0"):
            shaping.reach(q, outcome, **{name: 0.0})


def test_what_the_start_breaks_is_excused_and_nothing_else(hoap2) -> None:
    """0.15 m above its box, the robot may come down from there; its arm may not enter the chest."""
    q = hoap2.posture()
    height = float(hoap2.snapshot(q).position("base")[2])
    box = PositionBox(hoap2, "base", [-np.inf] * 3, [np.inf, np.inf, height - 0.15])
    bodies = SelfCollision(hoap2, margin=0.01)
    shaping = GlobalShaping(hoap2, [tall(hoap2, q, "base")], constraints=[box, bodies])
    touching = q.copy()
    touching[7:] = hoap2.limits.lower
    down = [q.copy() for _ in range(3)]
    for k, height_lost in enumerate((0.0, 0.1, 0.16)):
        down[k][2] -= height_lost
    touching[2] = down[1][2]
    assert float(bodies.distances(hoap2.snapshot(touching)).clearance.min()) > -0.15

    def first_broken(*configurations: np.ndarray) -> str:
        states = [hoap2.snapshot(one) for one in configurations]
        return worst_violations(shaping.problem, states, 0.01)[1]

    assert first_broken(*down) == ""
    assert first_broken(down[1], down[0], down[2]).startswith("at 0.01 s: base z upper lacks 0.15")
    told = first_broken(down[0], touching, down[2])
    assert told.startswith("at 0.01 s: ")
    assert told.endswith("of 'self-collision'")
    assert first_broken(touching, touching, down[2]) == ""
    assert "lacks 0.05 m of" in first_broken(down[0], down[1])  # still outside at the end


def test_the_callers_controller_is_used(hoap2) -> None:
    q = hoap2.posture()
    shaping = GlobalShaping(hoap2, [tall(hoap2, q, "base")])
    outcome = shaping.solve(q, 2, workers=1)
    made: list[tuple[str, ...]] = []

    def make(tasks: list[Task]) -> KinematicController:
        made.append(tuple(task.name for task in tasks))
        return KinematicController(hoap2, tasks, limits=Limits(hoap2, velocity=0.1), dt=0.01)

    motion = shaping.reach(q, outcome, attempts=1, dt=0.01, make_controller=make)
    assert made == [("guide: posture",), ("inertia",)]
    assert (np.abs(motion.v[:, 6:]) <= 0.1 * hoap2.limits.velocity + 1e-6).all()


@pytest.mark.parametrize(
    ("target", "most"),
    [((0.3, 0.0, 0.5), 2.0), ((-0.5, 0.0, 0.1), 2.0), ((2.0, 0.0, 0.3), 2.0)]
    + [((-0.5, 0.0, 0.1), 0.15)],  # as far as c goes
)
def test_the_best_posture_keeps_the_gears(target: tuple[float, ...], most: float) -> None:
    """Oracle: SciPy over the two joints that are driven, from a grid, through Robot.posture."""
    robot = Robot.load(geared_arm(c=limit(most, 9, 2)))
    q = robot.posture()
    # In weights and gains as the search's cost counts them: gain / 2 of squared errors.
    tasks = [
        PositionTask(robot, "link_d", target, gain=1.0),
        PostureTask(robot, q, weight=0.1, gain=1.0),
    ]
    names, rest = robot.joint_names, robot.limits.joint_positions(q)
    # b so that c = -2 b + 0.1 stays in range, which is the tighter.
    box = [(-2.0, 2.0), ((0.1 - most) / 2, (0.1 + most) / 2)]

    def cost(x: np.ndarray) -> float:
        joints = {"a": x[0], "b": x[1], "c": -2 * x[1] + 0.1, "d": -x[1] + 0.05}
        there = np.array([joints[name] for name in names])
        step = np.concatenate((np.zeros(6), there - rest))
        place = robot.snapshot(robot.integrate(q, step, 1.0)).position("link_d")
        off = place - target
        return 0.5 * float(off @ off) + 0.005 * float((there - rest) @ (there - rest))

    starts = [np.array([a, b]) for a in np.linspace(-2, 2, 5) for b in np.linspace(-0.9, 1, 5)]
    found = [minimize(cost, x, bounds=box, method="L-BFGS-B").fun for x in starts]
    contacts = support(robot.snapshot(q), "floating")  # the base is bolted
    outcome = GlobalShaping(robot, tasks, contacts=contacts).solve(q, starts=16, workers=1)
    best = outcome.best
    assert best.cost == pytest.approx(min(found), rel=1e-6)
    now = dict(zip(names, robot.limits.joint_positions(best.q), strict=True))
    assert now["c"] == pytest.approx(-2 * now["b"] + 0.1, abs=1e-12)
    assert now["d"] == pytest.approx(-now["b"] + 0.05, abs=1e-12)
    joints = robot.limits.joint_positions(best.q)
    assert (np.abs(joints) <= 2.0 + 1e-9).all()
    assert abs(now["c"]) <= most + 1e-9
    assert most == 2.0 or abs(now["c"]) == pytest.approx(most, abs=1e-6)


def test_the_way_there_keeps_them_too() -> None:
    robot = Robot.load(geared_arm())
    q = robot.posture()
    tasks = [PositionTask(robot, "link_d", (0.3, 0.0, 0.5))]
    contacts = support(robot.snapshot(q), "floating")
    shaping = GlobalShaping(robot, tasks, contacts=contacts)
    motion = shaping.reach(q, shaping.solve(q, starts=8, workers=1))
    assert motion.arrived, motion.attempts
    for at in motion.q:
        now = dict(zip(robot.joint_names, robot.limits.joint_positions(at), strict=True))
        assert now["c"] == pytest.approx(-2 * now["b"] + 0.1, abs=1e-6)


def test_gears_that_leave_no_range_are_named() -> None:
    robot = Robot.load(geared_arm(c=limit(5).replace('"-5"', '"4"')))  # for b from -2 to -1.95
    q = robot.postures["neutral"]
    tasks = [PositionTask(robot, "link_d", (0.3, 0.0, 0.5))]
    with pytest.raises(InvalidInputError, match="no position of joint 'b' leaves 'c'"):
        shaping = GlobalShaping(robot, tasks, limits=Limits(robot, margin=0.1))
        shaping.solve(q, starts=2, workers=1)
