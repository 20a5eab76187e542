"""The approach law on a line, where everything is known; rows that always leave rest allowed."""

import numpy as np
import pytest

from wbc.constraints import PositionBox
from wbc.constraints.limits import Limits
from wbc.constraints.margin import SKIN, BrakingParameters, Margin
from wbc.constraints.rows import Bounds, Distances, relax_for_contacts, stack, take
from wbc.errors import InvalidInputError
from wbc.laws import Rows
from wbc.native import lib
from wbc.robot import Robot, Snapshot

DT = 0.005


class Wall(Margin):
    """Keeps the base's x below a wall: a gap whose slope is known by heart."""

    def __init__(self, robot: Robot, place: float, braking=None, limits=None, speed=0.0) -> None:
        super().__init__(robot, "wall", braking, limits)
        self.place, self.speed = place, speed

    def distances(self, snapshot: Snapshot, keys=None) -> Distances:
        matrix = np.zeros((1, self.robot.nv))
        matrix[0, :3] = -snapshot.rotation("base")[0]
        room = np.array([self.place - snapshot.q[0] - SKIN])
        return Distances(np.zeros(1, dtype=np.int64), room, matrix, np.array([-self.speed]))

    def labels(self, distances: Distances) -> tuple[str, ...]:
        return ("wall",)

    def curvature_bound(self, distances: Distances, step: np.ndarray) -> np.ndarray:
        return np.zeros(1)


@pytest.fixture
def robot(robot_named) -> Robot:
    return robot_named("hoap2_like")


def at(robot: Robot, x: float) -> Snapshot:
    q = robot.postures["neutral"].copy()
    q[0] = x
    return robot.snapshot(q)


def greediest(rows: Bounds) -> float:
    """Largest velocity along x that the row allows (the base's axes are the world's)."""
    return -float(rows.lower[0])


@pytest.mark.parametrize("gain", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("braking", [0.5, 5.0, 50.0])
def test_the_greediest_approach_brakes_as_declared_and_never_turns(robot, gain, braking) -> None:
    wall = Wall(robot, 1.0, BrakingParameters(deceleration=braking, gain=gain))
    x, last, history = 0.0, None, []
    for _ in range(3000):
        speed = greediest(wall.rows(at(robot, x), DT))
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


@pytest.mark.parametrize("room", [0.0, 1e-12, 1e-3, 0.5, 1e5])
@pytest.mark.parametrize("braking", [0.1, 10.0])
def test_speed_towards_a_margin_leaves_just_enough_room(robot, room: float, braking: float) -> None:
    """From u: one tick at u, then braking evenly, ends exactly at the room's end."""
    wall = Wall(robot, 0.0, BrakingParameters(deceleration=braking, gain=1.0))
    u = -wall.rows(at(robot, -SKIN - room), DT).lower[0]
    # The clearance is a difference of numbers about SKIN: 1e-19 of it is rounding.
    assert u * DT + u * u / (2 * braking) == pytest.approx(room, rel=1e-12, abs=1e-18)


@pytest.mark.parametrize("x", [0.0, 0.9999, 1.0, 1.00005, 1.01, 5.0])
@pytest.mark.parametrize("speed", [0.0, 0.3, -0.3, 100.0])
def test_rest_is_always_allowed(robot, x: float, speed: float) -> None:
    rows = Wall(robot, 1.0, speed=speed).rows(at(robot, x), DT)
    assert (rows.lower <= 0.0).all()
    assert (rows.upper >= 0.0).all()


def test_inside_it_is_pushed_out_at_a_bounded_rate(robot) -> None:
    law = BrakingParameters(recovery=0.2, recovery_speed=0.05)
    wall = Wall(robot, 1.0, law)
    deep, shallow = (wall.rows(at(robot, x), DT).push for x in (1.1, 1.0 + 1e-4))
    assert deep is not None and shallow is not None
    np.testing.assert_allclose(deep.target, [0.05])
    np.testing.assert_allclose(shallow.target, [0.2 / DT * 1e-4], rtol=1e-9)
    assert wall.rows(at(robot, 1.0 - 0.5 * SKIN), DT).push is None  # in its skin only
    # Following the push: out of the margin, monotonically, and no farther.
    x = 1.02
    for _ in range(400):
        rows = wall.rows(at(robot, x), DT)
        if rows.push is None:
            break
        assert rows.push.target[0] > 0.0
        x -= DT * rows.push.target[0]
        if x < 1.0 + 1e-12:
            break
    assert x == pytest.approx(1.0, abs=1e-6)


def test_a_wall_that_comes_nearer_slows_the_approach_and_then_pushes(robot) -> None:
    still, coming = Wall(robot, 1.0), Wall(robot, 1.0, speed=0.1)
    far = [greediest(wall.rows(at(robot, 0.5), DT)) for wall in (still, coming)]
    assert far[0] - far[1] == pytest.approx(0.1)
    near = coming.rows(at(robot, 1.0 - SKIN - 1e-5), DT)
    assert -lib.wbc_interior <= near.lower[0] <= 0.0
    assert near.push is not None
    allowed = 0.5 / DT * 1e-5  # by the gain
    np.testing.assert_allclose(near.push.target, [0.1 - allowed], rtol=1e-6)
    leaving = Wall(robot, 1.0, speed=-0.1).rows(at(robot, 1.0 - SKIN), DT)
    assert greediest(leaving) == pytest.approx(0.1)


def test_braking_counts_on_half_of_what_the_joints_give(robot, rng) -> None:
    """A gap that depends on two joints: a = sum |row| a_max / 2, if that is less than declared."""
    limits = Limits(robot, acceleration=2.0)

    class Sum(Wall):
        def distances(self, snapshot, keys=None):
            matrix = np.zeros((1, self.robot.nv))
            matrix[0, 6:8] = 0.3, -0.1
            return Distances(np.zeros(1, dtype=np.int64), np.array([0.5]), matrix, np.zeros(1))

    here = at(robot, 0.0)
    able = 0.5 * 2.0 * 0.4
    slow = greediest(Sum(robot, 1.0, limits=limits).rows(here, DT))
    assert slow * DT + slow**2 / (2 * able) == pytest.approx(0.5)
    declared = greediest(
        Sum(robot, 1.0, BrakingParameters(deceleration=0.1), limits).rows(here, DT)
    )
    assert declared * DT + declared**2 / (2 * 0.1) == pytest.approx(0.5)


def test_where_a_command_leads_is_looked_at(robot) -> None:
    """A step past the wall is cut back to it; a step that ends before it is not looked at."""
    wall = Wall(robot, 1.0)
    here = at(robot, 0.9)
    rows = wall.rows(here, DT)
    v = np.zeros(robot.nv)
    v[0] = 30.0
    there = robot.snapshot(robot.integrate(here.q, v, DT))
    assert wall.may_violate(rows, v, DT)
    cut = wall.cutting_planes(there, v, DT, rows)
    assert cut is not None
    assert cut.labels == ("wall",)
    assert greediest(cut) * DT == pytest.approx(0.1 - SKIN, rel=1e-9)
    assert wall.still_violated(there, v, DT, rows, cut)
    assert not wall.still_violated(here, 0.0 * v, DT, rows, cut)
    v[0] = 1.0
    assert not wall.may_violate(rows, v, DT)
    there = robot.snapshot(robot.integrate(here.q, v, DT))
    assert wall.cutting_planes(there, v, DT, rows) is None


def test_a_base_that_slides_and_turns_bends_its_way(robot) -> None:
    """Five centimetres along while turning by 5 mrad end an eighth of a millimetre lower."""
    box = PositionBox.height(robot, 0.0)
    here = at(robot, 0.0)
    before = box.distances(here)
    step = np.zeros(robot.nv)
    step[0], step[4] = 0.05, 0.005  # nose down: ahead is below
    after = box.distances(robot.snapshot(robot.integrate(here.q, step, 1.0)))
    lost = before.clearance + before.jacobian @ step - after.clearance
    assert lost[0] == pytest.approx(1.25e-4, rel=1e-3)
    assert (lost <= box.curvature_bound(before, step)).all()


def test_from_inside_a_cut_asks_only_not_to_go_deeper(robot) -> None:
    wall = Wall(robot, 1.0)
    here = at(robot, 1.05)
    rows = wall.rows(here, DT)
    v = np.zeros(robot.nv)
    assert wall.cutting_planes(here, v, DT, rows) is None
    v[0] = 0.1
    there = robot.snapshot(robot.integrate(here.q, v, DT))
    cut = wall.cutting_planes(there, v, DT, rows)
    assert cut is not None
    assert 0.0 <= greediest(cut) <= lib.wbc_interior


def test_rows_of_several_constraints_are_joined(robot) -> None:
    here = at(robot, 1.05)
    parts = [Wall(robot, place).rows(here, DT) for place in (1.0, 2.0, 1.01)]
    whole = stack(parts)
    assert whole.labels == ("wall",) * 3
    np.testing.assert_array_equal(whole.lower, [part.lower[0] for part in parts])
    assert isinstance(whole.push, Rows)
    assert whole.push.matrix.shape == (2, robot.nv)
    assert stack(parts[:1]) is parts[0]


def test_rows_give_way_to_contacts(robot, rng) -> None:
    """Whatever contacts ask for, a velocity exists that does it and meets every row."""
    here = at(robot, 1.05)
    rows = Wall(robot, 1.0).rows(here, DT)
    for repeated in (False, True):
        A, b = rng.normal(size=(6, robot.nv)), 1e-3 * rng.normal(size=6)
        A[0], b[0] = -rows.matrix[0], 2e-3  # a contact that moves into the wall
        contacts = [Rows(A, b, np.ones(6))] * (2 if repeated else 1)
        loose = relax_for_contacts(rows, contacts)
        v = np.linalg.lstsq(A, b, rcond=None)[0]
        assert (loose.matrix @ v >= loose.lower).all()
        assert (rows.matrix @ v < rows.lower).any()
        # As much as is asked for, and a tenth of it; not more.
        assert (loose.lower > -2e-3 - 0.1 * np.abs(b).max() - 2e-4).all()
    assert relax_for_contacts(rows, []) is rows


def test_names_are_picked_in_order() -> None:
    names = ("a", "b", "c")
    for which in ([], [1], [0, 2]):
        expected = tuple(names[k] for k in which)
        assert take(names, np.array(which, dtype=np.int64)) == expected


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"deceleration": 0.0}, "deceleration"),
        ({"gain": 1.5}, "gain"),
        ({"recovery_speed": np.inf}, "recovery_speed"),
    ],
)
def test_bad_laws(values, words: str) -> None:
    with pytest.raises(InvalidInputError, match=words):
        BrakingParameters(**values)


def test_limits_of_another_robot(robot, robot_named) -> None:
    with pytest.raises(InvalidInputError, match="another robot"):
        Wall(robot, 1.0, limits=Limits(robot_named("talos")))
