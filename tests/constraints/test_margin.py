"""The law of margins on walls across a line: every number of its rows in closed form.

The base moves along x, axes as the world's; wall k is at ``places[k]`` and comes at ``speeds[k]``.
"""

import numpy as np
import pytest

from wbc.constraints import Limits, PositionBox, support
from wbc.constraints.margin import SKIN, USED, BrakingParameters, Margin, _clearance_before
from wbc.constraints.rows import Bounds, Distances, stack
from wbc.controllers import KinematicController
from wbc.errors import InvalidInputError
from wbc.laws import Rows
from wbc.native import lib
from wbc.robot import Robot, Snapshot
from wbc.tasks import PositionTask, PostureTask

DT = 0.005


class Walls(Margin):
    """Keeps the base's x below walls; the distances that were asked for are remembered."""

    def __init__(
        self, robot: Robot, places, speeds=None, bend=0.0, keys=None, braking=None, limits=None
    ) -> None:
        super().__init__(robot, "walls", braking, limits)
        self.places = np.array(places, dtype=float)
        self.speeds = None if speeds is None else np.array(speeds, dtype=float)
        self.keys = np.arange(len(places)) if keys is None else np.array(keys)
        self.bend, self.asked = bend, []

    def distances(self, snapshot: Snapshot, keys=None) -> Distances:
        self.asked.append(None if keys is None else keys.tolist())
        some = np.ones(self.keys.size, dtype=bool) if keys is None else np.isin(self.keys, keys)
        matrix = np.zeros((int(some.sum()), self.robot.nv))
        matrix[:, 0] = -1.0
        rate = None if self.speeds is None else -self.speeds[some]
        clearance = self.places[some] - snapshot.q[0] - SKIN
        return Distances(self.keys[some], clearance, matrix, rate)

    def labels(self, distances: Distances) -> tuple[str, ...]:
        return tuple(f"wall {key}" for key in distances.keys)

    def curvature_bound(self, distances: Distances, step: np.ndarray) -> np.ndarray:
        return np.full(distances.keys.size, self.bend)


def at(robot: Robot, x: float) -> Snapshot:
    q = robot.postures["neutral"].copy()
    q[0] = x
    return robot.snapshot(q)


def along(robot: Robot, speed: float) -> np.ndarray:
    v = np.zeros(robot.nv)
    v[0] = speed
    return v


def cut(walls: Walls, x: float, speed: float) -> Bounds | None:
    """Return the cutting planes where ``speed`` leads from ``x``."""
    robot = walls.robot
    here, v = at(robot, x), along(robot, speed)
    rows = walls.rows(here, DT)
    walls.asked.clear()
    there = robot.snapshot(robot.integrate(here.q, v, DT))
    return walls.cutting_planes(there, v, DT, rows)


def greediest(rows: Bounds) -> float:
    """Largest velocity along x that the row allows (the base's axes are the world's)."""
    return -float(rows.lower[0])


# ------------------------------------------------------------------ rows


def test_what_is_inside_is_pushed_out_and_what_is_not_brakes(hoap2) -> None:
    walls = Walls(hoap2, [1.0 + 3.5e-4, 1.5, 1.2])
    rows = walls.rows(at(hoap2, 1.0 + 7e-4), DT)  # 3.5e-4 in the wall, of which SKIN is not lost
    law = BrakingParameters()
    back = law.recovery / DT * 3.5e-4
    assert rows.push is not None
    np.testing.assert_allclose(rows.push.target, [back], rtol=1e-9)
    np.testing.assert_array_equal(rows.push.matrix, rows.matrix[:1])
    np.testing.assert_array_equal(rows.push.weight, [1.0])
    assert lib.wbc_interior_share * back < lib.wbc_interior_speed
    assert rows.lower[0] == pytest.approx(-lib.wbc_interior_share * back, rel=1e-9)
    for k, place in ((1, 1.5), (2, 1.2)):
        left = place - (1.0 + 7e-4) - SKIN
        u = -rows.lower[k]
        stop = u * DT + u * u / (2.0 * law.deceleration)
        assert stop == pytest.approx(left, rel=1e-9) or u == pytest.approx(law.gain / DT * left)
        assert stop <= left * (1.0 + 1e-9)
    np.testing.assert_array_equal(rows.upper, np.inf)


def test_no_distances_make_no_rows(hoap2) -> None:
    rows = Walls(hoap2, [], []).rows(at(hoap2, 0.0), DT)
    assert rows.labels == ()
    assert rows.lower.shape == (0,)
    assert rows.push is None
    far = Walls(hoap2, [], [])
    far.has_more = lambda distances: True  # all of them may be anywhere: they are measured again
    assert far.may_violate(rows, along(hoap2, 1.0), DT) and cut(far, 0.0, 1.0) is None
    assert far.asked == [None]


@pytest.mark.parametrize("gain", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("braking", [0.5, 5.0, 50.0])
def test_the_greediest_approach_brakes_as_declared_and_never_turns(hoap2, gain, braking) -> None:
    wall = Walls(hoap2, [1.0], braking=BrakingParameters(deceleration=braking, gain=gain))
    x, last, history = 0.0, None, []
    for _ in range(3000):
        speed = greediest(wall.rows(at(hoap2, x), DT))
        assert speed >= 0.0
        if last is not None:
            # Braking by the law's own deceleration; the last millimetres go by `gain`, which at
            # worst brakes by gain / dt times the speed there, 2 braking dt / gain: twice as hard.
            assert last - speed <= 2.0 * braking * DT + 1e-12
        x, last = x + DT * speed, speed
        history.append(x)
    assert (np.diff(history) >= 0.0).all()
    assert x <= 1.0 - SKIN + 1e-12
    assert x == pytest.approx(1.0 - SKIN, abs=1e-3)


@pytest.mark.parametrize("x", [0.0, 0.9999, 1.0, 1.00005, 1.01, 5.0])
@pytest.mark.parametrize("speed", [0.0, 0.3, -0.3, 100.0])
def test_rest_is_always_allowed(hoap2, x: float, speed: float) -> None:
    rows = Walls(hoap2, [1.0], [speed]).rows(at(hoap2, x), DT)
    assert (rows.lower <= 0.0).all()
    assert (rows.upper >= 0.0).all()


def test_inside_it_is_pushed_out_at_a_bounded_rate(hoap2) -> None:
    law = BrakingParameters(recovery=0.2, recovery_speed=0.05)
    wall = Walls(hoap2, [1.0], braking=law)
    deep, shallow = (wall.rows(at(hoap2, x), DT).push for x in (1.1, 1.0 + 1e-4))
    assert deep is not None and shallow is not None
    np.testing.assert_allclose(deep.target, [0.05])
    np.testing.assert_allclose(shallow.target, [0.2 / DT * 1e-4], rtol=1e-9)
    assert wall.rows(at(hoap2, 1.0 - 0.5 * SKIN), DT).push is None  # in its skin only


def test_a_wall_that_comes_nearer_slows_the_approach_and_then_pushes(hoap2) -> None:
    still, coming = Walls(hoap2, [1.0]), Walls(hoap2, [1.0], [0.1])
    far = [greediest(wall.rows(at(hoap2, 0.5), DT)) for wall in (still, coming)]
    assert far[0] - far[1] == pytest.approx(0.1)
    near = coming.rows(at(hoap2, 1.0 - SKIN - 1e-5), DT)
    assert -lib.wbc_interior_speed <= near.lower[0] <= 0.0
    assert near.push is not None
    allowed = 0.5 / DT * 1e-5  # by the gain
    np.testing.assert_allclose(near.push.target, [0.1 - allowed], rtol=1e-6)
    leaving = Walls(hoap2, [1.0], [-0.1]).rows(at(hoap2, 1.0 - SKIN), DT)
    assert greediest(leaving) == pytest.approx(0.1)


def test_braking_counts_on_half_of_what_the_joints_give(hoap2, rng) -> None:
    """A gap that depends on two joints: a = sum |row| a_max / 2, if that is less than declared."""
    limits = Limits(hoap2, acceleration=2.0)

    class Sum(Walls):
        def distances(self, snapshot, keys=None):
            matrix = np.zeros((1, self.robot.nv))
            matrix[0, 6:8] = 0.3, -0.1
            return Distances(np.zeros(1, dtype=np.int64), np.array([0.5]), matrix, np.zeros(1))

    here = at(hoap2, 0.0)
    able = 0.5 * 2.0 * 0.4
    slow = greediest(Sum(hoap2, [1.0], limits=limits).rows(here, DT))
    assert slow * DT + slow**2 / (2 * able) == pytest.approx(0.5)
    declared = greediest(
        Sum(hoap2, [1.0], braking=BrakingParameters(deceleration=0.1), limits=limits).rows(here, DT)
    )
    assert declared * DT + declared**2 / (2 * 0.1) == pytest.approx(0.5)


def test_rows_of_several_constraints_are_joined(hoap2) -> None:
    here = at(hoap2, 1.05)
    parts = [Walls(hoap2, [place]).rows(here, DT) for place in (1.0, 2.0, 1.01)]
    whole = stack(parts)
    assert whole.labels == ("wall 0",) * 3
    np.testing.assert_array_equal(whole.lower, [part.lower[0] for part in parts])
    assert isinstance(whole.push, Rows)
    assert whole.push.matrix.shape == (2, hoap2.nv)
    assert stack(parts[:1]) is parts[0]


# ------------------------------------------------------------------ where a command leads


def test_a_cut_ends_where_the_wall_will_be(hoap2) -> None:
    """At x = 0.9 with 20 m/s; the first wall comes at 2 m/s and the second is far away."""
    walls = Walls(hoap2, [1.0, 5.0], [2.0, 0.0], keys=[3, 7])
    found = cut(walls, 0.9, 20.0)
    assert found is not None
    assert found.labels == ("wall 3",)
    assert found.matrix.shape == (1, hoap2.nv)
    np.testing.assert_array_equal(found.matrix, -along(hoap2, 1.0)[None])
    np.testing.assert_array_equal(found.upper, [np.inf])
    allowed = -float(found.lower[0])
    assert 0.9 + DT * allowed == pytest.approx(1.0 - 2.0 * DT - SKIN, rel=1e-12)


def test_a_cut_never_asks_to_go_back(hoap2) -> None:
    """The wall comes at 40 m/s: rest is allowed, what more is needed is not a bound."""
    found = cut(Walls(hoap2, [1.0], [40.0]), 0.95, 1.0)
    assert found is not None
    np.testing.assert_array_equal(found.lower, [0.0])


@pytest.mark.parametrize(
    ("wall_speed", "own", "violates"),
    [
        (0.5, 0.0, False),  # it comes, the robot rests: not the robot's doing
        (0.5, 0.1, True),  # it goes to meet it
        (-0.5, 0.25, False),  # it recedes faster than the robot follows
        (-0.5, 0.75, True),  # the robot follows faster
        (0.0, 1e-5, False),  # rounding
    ],
)
def test_from_inside_only_what_the_robot_adds_counts(hoap2, wall_speed, own, violates) -> None:
    found = cut(Walls(hoap2, [1.0], [wall_speed]), 1.001, own)
    assert (found is not None) == violates
    if found is not None:  # no deeper than at the start
        end = 1.0 - DT * wall_speed - SKIN - (1.001 + DT * -float(found.lower[0]))
        assert end == pytest.approx(min(1.0 - SKIN - 1.001, end), abs=1e-12)


def test_half_the_skin_may_be_used(hoap2) -> None:
    walls = Walls(hoap2, [1.0])
    here = at(hoap2, 0.9)
    rows = walls.rows(here, DT)
    for end, may in ((0.0, False), (-0.9 * USED, False), (-1.1 * USED, True)):
        v = along(hoap2, (0.1 - SKIN - end) / DT)
        assert walls.may_violate(rows, v, DT) == may
        assert (cut(walls, 0.9, float(v[0])) is not None) == may


@pytest.mark.parametrize(("bend", "may"), [(0.0, False), (2e-4, True)])
def test_what_bends_may_end_lower(hoap2, bend: float, may: bool) -> None:
    walls = Walls(hoap2, [1.0], bend=bend)
    rows = walls.rows(at(hoap2, 0.9), DT)
    v = along(hoap2, (0.1 - SKIN - 1e-4) / DT)  # a linear prediction ends at 1e-4
    assert walls.may_violate(rows, v, DT) == may


@pytest.mark.parametrize(("speed", "may"), [(-1.0, False), (1.0, True)])
def test_a_prediction_counts_the_walls_own_way(hoap2, speed: float, may: bool) -> None:
    walls = Walls(hoap2, [1.0], [speed])
    rows = walls.rows(at(hoap2, 0.9), DT)
    assert walls.may_violate(rows, along(hoap2, (0.1 - SKIN) / DT), DT) == may


def test_rows_without_distances_violate_nothing(hoap2) -> None:
    walls, empty = Walls(hoap2, [1.0]), np.zeros(0)
    plain = Bounds((), np.zeros((0, hoap2.nv)), empty, empty)
    assert walls.may_violate(plain, along(hoap2, 1e3), DT) is False


def test_only_what_may_be_violated_is_measured_again(hoap2) -> None:
    walls = Walls(hoap2, [1.0, 1.05, 9.0], keys=[2, 4, 6])
    cut(walls, 0.9, 24.0)  # ends at 1.02
    assert walls.asked == [[2]]
    cut(walls, 0.9, 29.0)  # ends at 1.045, inside the skin's other half: not violated
    assert walls.asked == [[2]]
    cut(walls, 0.9, 40.0)
    assert walls.asked == [[2, 4]]
    # So far that pairs which were not among those measured may have come near: all of them.
    cut(walls, 0.9, 1700.0)
    assert walls.asked == [None]
    empty = np.zeros(0)
    plain = Bounds((), np.zeros((0, hoap2.nv)), empty, empty)
    walls.asked.clear()
    walls.cutting_planes(at(hoap2, 2.0), along(hoap2, 1.0), DT, plain)
    assert walls.asked == [None]


def test_distances_are_matched_by_their_keys() -> None:
    def some(keys: list[int], rate: bool) -> Distances:
        numbers = np.array(keys, dtype=np.int64)
        own = 0.1 * numbers if rate else None
        return Distances(numbers, 10.0 + numbers, np.zeros((len(keys), 8)), own)

    after = some([1, 5, 7, 9, 11], True)
    clearance, rate = _clearance_before(some([2, 5, 9], True), after)
    np.testing.assert_array_equal(clearance, [np.inf, 15.0, np.inf, 19.0, np.inf])
    np.testing.assert_allclose(rate, [0.0, 0.5, 0.0, 0.9, 0.0])
    clearance, rate = _clearance_before(some([2, 5, 9], False), after)
    np.testing.assert_array_equal(clearance, [np.inf, 15.0, np.inf, 19.0, np.inf])
    np.testing.assert_array_equal(rate, 0.0)
    for before in (None, some([], True)):
        clearance, rate = _clearance_before(before, after)
        np.testing.assert_array_equal(clearance, np.inf)
        np.testing.assert_array_equal(rate, 0.0)
        assert clearance.dtype == float


def test_a_base_that_slides_and_turns_bends_its_way(hoap2) -> None:
    """Five centimetres along while turning by 5 mrad end an eighth of a millimetre lower."""
    box = PositionBox.height(hoap2, 0.0)
    here = at(hoap2, 0.0)
    before = box.distances(here)
    step = np.zeros(hoap2.nv)
    step[0], step[4] = 0.05, 0.005  # nose down: ahead is below
    after = box.distances(hoap2.snapshot(hoap2.integrate(here.q, step, 1.0)))
    lost = before.clearance + before.jacobian @ step - after.clearance
    assert lost[0] == pytest.approx(1.25e-4, rel=1e-3)
    assert (lost <= box.curvature_bound(before, step)).all()


# ------------------------------------------------------------------ words


def test_words(hoap2) -> None:
    walls = Walls(hoap2, [1.0])
    assert repr(walls) == "Walls('walls')"
    with pytest.raises(InvalidInputError, match=r"'walls' is a Walls.*no rows in terms of the po"):
        walls.symbolic_rows(None)
    with pytest.raises(InvalidInputError, match=r"^walls: expected a robot as"):
        Walls("robot", [1.0])


def test_joints_without_limits_of_acceleration_brake_all_the_same(hoap2) -> None:
    """An infinite acceleration of joints must leave the declared deceleration, not a NaN."""
    walls = Walls(hoap2, [1.0])
    free = Limits(hoap2, velocity=None)
    assert np.isinf(free.acceleration).all()
    bounded = Walls(hoap2, [1.0])
    Margin.__init__(bounded, hoap2, "walls", None, free)
    here = at(hoap2, 0.9)
    np.testing.assert_array_equal(bounded.rows(here, DT).lower, walls.rows(here, DT).lower)


def test_limits_of_another_robot(hoap2, robot_named) -> None:
    with pytest.raises(InvalidInputError, match="another robot"):
        Walls(hoap2, [1.0], limits=Limits(robot_named("talos")))


class Refilled(Walls):
    """The same, in arrays that are filled anew each time, as in a loop in C."""

    def distances(self, snapshot: Snapshot, keys=None) -> Distances:
        found = super().distances(snapshot, keys)
        if not hasattr(self, "kept"):
            self.kept = found
        self.kept.clearance[:], self.kept.jacobian[:] = found.clearance, found.jacobian
        return self.kept


def test_distances_in_arrays_that_are_filled_anew_are_those_of_their_snapshot(hoap2: Robot) -> None:
    """Those at the end of a step were compared with themselves: nothing was ever violated."""
    here, v = at(hoap2, 0.0), np.zeros(hoap2.nv)
    v[0] = 40.0  # through the wall within a tick
    there = hoap2.snapshot(hoap2.integrate(here.q, v, DT))
    cuts = []
    for kind in (Walls, Refilled):
        walls = kind(hoap2, [0.1])
        cuts.append(walls.cutting_planes(there, v, DT, walls.rows(here, DT)))
    assert cuts[0] is not None and cuts[1] is not None
    np.testing.assert_array_equal(cuts[0].lower, cuts[1].lower)


def test_a_margin_is_recovered_against_a_task_that_pulls_inwards(hoap2) -> None:
    q = hoap2.posture("standing")
    here = hoap2.snapshot(q)
    hand, free = here.position("left_hand_link"), np.full(3, np.inf)
    box = PositionBox(hoap2, "left_hand_link", -free, [hand[0] - 0.02, np.inf, np.inf])
    reach = PositionTask(hoap2, "left_hand_link", hand + (0.3, 0.0, 0.0))
    controller = KinematicController(
        hoap2, [reach, PostureTask(hoap2, q, weight=0.01)], contacts=support(here, "double"),
        constraints=[box], limits=Limits(hoap2), dt=DT,
    )  # fmt: skip
    v = None
    for _ in range(200):
        v = controller.step(hoap2.snapshot(q, v)).velocity
        q = hoap2.integrate(q, v, DT)
    assert hoap2.snapshot(q).position("left_hand_link")[0] < hand[0] - 0.02 + 1e-4


BAR = """<mujoco><compiler angle="radian"/><worldbody><body name="bar">
<joint name="hinge" axis="0 1 0" range="-3 0"/>
<geom type="capsule" size="0.01" fromto="0 0 0 0.5 0 0" mass="1"/><site name="tip" pos="0.5 0 0"/>
</body></worldbody><actuator><motor joint="hinge"/></actuator></mujoco>"""


@pytest.mark.parametrize(("slow", "outside"), [(0.02, 0.0), (None, 1e-3)])
def test_a_slow_recovery_does_not_hold_a_faster_one_back(tmp_path, slow, outside: float) -> None:
    """A slower box, or a joint that is a millimetre outside: the tip came with 0.06 or 0.04 m/s."""
    (tmp_path / "bar.xml").write_text(BAR)
    robot, free = Robot.load(tmp_path / "bar.xml"), np.full(3, np.inf)
    turned = np.r_[np.zeros(6), outside]
    here = robot.snapshot(robot.integrate(robot.posture("neutral"), turned, 1.0))
    above = [*-free[:2], here.position("tip")[2] + 0.05]
    boxes = [PositionBox(robot, "tip", above, free)]
    if slow is not None:
        law = BrakingParameters(recovery_speed=slow)
        boxes.append(PositionBox(robot, "tip", above, free, braking=law))
        boxes[1].name = "slow"
    tasks, limits = [PostureTask(robot, here.q, weight=0.01)], Limits(robot)
    controller = KinematicController(
        robot, tasks, contacts=(), limits=limits, constraints=boxes, dt=DT
    )
    up = here.jacobian("tip")[2] @ controller.step(here).velocity
    assert up == pytest.approx(0.1, rel=0.01)
