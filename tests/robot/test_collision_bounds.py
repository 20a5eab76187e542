"""Which pairs have to brake first, and what a linear prediction leaves out: against all pairs."""

import numpy as np
import pinocchio as pin
import pytest

from tests.conftest import random_state
from tests.robot.by_coal import model_on, of_model
from wbc.constraints import Limits, Obstacles, SelfCollision
from wbc.robot import Robot
from wbc.robot.collision import Body, Capsule, CollisionModel, HalfSpace, Hull, Obstacle, Shape
from wbc.robot.collision.native_pairs import Closing

WALL = HalfSpace.of([1.0, 0.2, 0.1], -0.5)


def way(closing: Closing, speed: np.ndarray) -> np.ndarray:
    """Return the distances that it takes to stop [m]; of slow joints, and large gains, more."""
    speed = np.maximum(speed, 0.0)
    braked = closing.dt + np.maximum(0.5 * speed / closing.deceleration, closing.slowest)
    return speed * np.maximum(braked, closing.dt / closing.gain)


@pytest.mark.parametrize("slowest", [0.0, 0.03])
def test_the_way_is_not_shorter_than_the_margins_law_needs(slowest: float, rng) -> None:
    """Of a sphere that a half-space comes to, at any speed: what is left is the rest."""
    robot, closing = Robot.load("hoap2_like"), Closing(0.002, 5.0, 0.5, slowest)
    here = robot.snapshot(robot.posture())
    ball = Body("ball", "base", 1, Capsule.sphere(np.zeros(3), 0.1))
    model = CollisionModel(robot, [ball, Body("wall", "", 0, WALL)], [(0, 1)])
    for speed in [-1.0, *10.0 ** rng.uniform(-4, 2, 50)]:
        model.place(1, np.eye(3), np.zeros(3), speed * WALL.normal)
        found, (left,) = model.soonest(here, 1, np.zeros(1), closing)
        stop = found.distance[0] - left
        assert stop == pytest.approx(way(closing, speed), rel=1e-9, abs=1e-12)
        # A joint of rate v and acceleration a that closes at |J| v gives |J| a.
        braking = min(5.0, speed / (2.0 * slowest)) if slowest else 5.0
        if speed > 0.0:
            root = np.sqrt(0.002**2 + 2.0 * stop / braking)  # of u dt + u^2 / (2 a) = stop
            assert min(2.0 * stop / (root + 0.002), stop / 0.004) >= speed * (1.0 - 1e-9)


@pytest.mark.parametrize("around", [None, Capsule.of([0.3, 0, 0], [0.3, 0, 1], 0.02), WALL])
def test_those_with_the_least_left_of_all_pairs(hoap2: Robot, around: Shape | None, rng) -> None:
    """Bounds on speeds never underestimate: no pair is left out that brute force finds."""
    bodies = [
        Body(str(joint), "base", joint, Capsule.of(*(0.05 * rng.normal(size=(2, 3))), 0.02))
        for joint in range(1, hoap2.model.njoints)
    ]
    if around is not None:
        bodies.append(Body("around", "", 0, around))
    n = len(bodies)
    model = CollisionModel(hoap2, bodies, [(a, b) for a in range(n) for b in range(a + 1, n)])
    kept, more = 0.01 * rng.random(len(model.pairs)), 0
    for _ in range(25):
        q, v = random_state(hoap2, rng)
        if around is not None:
            model.place(n - 1, np.eye(3), rng.normal(size=3), *(4.0 * rng.normal(size=(2, 3))))
        here = hoap2.snapshot(q, v * 10.0 ** rng.uniform(-2, 1))
        closing = Closing(0.002, 5.0, 0.5, 0.001)
        every = model.measure(here, np.arange(len(model.pairs)))
        speed = -model.rows(here, every) @ here.v - model.rates(every)
        left = every.distance - kept - way(closing, speed)
        for count in (1, 10, 1000):
            found, theirs = model.soonest(here, count, kept, closing)
            fewest = np.sort(left)[: max(count, np.count_nonzero(left < 0.0))]
            np.testing.assert_allclose(np.sort(theirs), fewest, atol=1e-8)
            np.testing.assert_allclose(theirs, left[found.pairs], atol=1e-8)
            assert (np.diff(found.pairs) > 0).all()
            more += len(found.pairs) > count
    assert more > 10


def test_accelerations_that_joints_have_make_the_way_longer(hoap2: Robot) -> None:
    """Of what braking counts on there is half: pairs get rows from farther away."""
    limits, v = Limits(hoap2), np.zeros(hoap2.nv)
    v[6:] = 1.0
    here = hoap2.snapshot(hoap2.posture("standing"), v)
    counts = []
    for known in (None, limits):
        margins = SelfCollision(hoap2, pairs=1, limits=known)
        if known is not None:
            margins.braked_rows(here, 0.002)
            limits.acceleration = np.full(hoap2.nv - 6, 0.4)  # counts from now on
        rows = margins.braked_rows(here, 0.002)
        distances = margins.distances(here, np.arange(len(margins.margins)))
        speed = -distances.jacobian @ v
        late = speed > -margins._approach(distances, 0.002)
        assert set(np.flatnonzero(late)) <= set(rows.distances.keys.tolist())
        counts.append(len(rows.labels))
    assert counts[1] > counts[0]


def test_an_obstacle_that_comes_fast_has_its_row_before_nearer_ones_at_rest(hoap2: Robot) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"))
    hand = here.position("left_hand")
    near = [Obstacle.sphere(f"near {k}", hand + [0.0, 0.1 + 0.1 * k, 0.0], 0.03) for k in range(3)]
    comes = Obstacle.sphere("comes", hand + [0.6, 0.0, 0.0], 0.03)
    comes.move(np.eye(3), np.zeros(3), velocity=[-3.0, 0.0, 0.0])
    around = Obstacles(hoap2, [*near, comes], pairs=1)
    assert all("comes" in label for label in around.braked_rows(here, 0.002).labels)
    comes.move(np.eye(3), np.zeros(3))
    (label,) = around.braked_rows(here, 0.002).labels
    assert label.endswith("near 0")


def lost_and_bound(model: CollisionModel, here, step) -> tuple[np.ndarray, np.ndarray]:
    """What the linear prediction of each pair leaves out at the place reached, and its bound."""
    found = model.nearest(here)
    there = of_model(model, here.robot.integrate(here.q, step, 1.0))
    lost = found.distance + model.rows(here, found) @ step - there
    return lost, model.curvature_bound(found.pairs, step)


@pytest.mark.parametrize("name", ["hoap2_like", "mixed_joints"])
@pytest.mark.parametrize("size", [1e-3, 1e-2, 1e-1])
def test_no_distance_ends_below_the_bound(name, size, robot_named, random_snapshot, rng) -> None:
    robot = robot_named(name)
    model = model_on(robot, rng)
    for _ in range(6):
        here = random_snapshot(robot, rng)
        lost, bound = lost_and_bound(model, here, size * rng.normal(size=robot.nv))
        # Both iterations stop at 1e-7 m, EPA ten times later.
        assert (lost <= bound + 5e-6).all()


def test_plates_face_to_face_may_lose_what_their_edges_do(hoap2) -> None:
    """Two parallel plates: the edge comes nearer by its lever times the angle, to first order."""
    here = hoap2.snapshot(hoap2.posture("standing"))
    R, p = here.joint_placements
    joint = 7
    plates = [(0, np.zeros(3)), (joint, np.array([0.0, 0.0, 0.05]))]
    bodies = []
    for k, offset in plates:
        # Both plates lie flat around the joint's origin, one 4 cm above the other.
        box = Hull.box([0.2, 0.2, 0.01], offset).vertices + p[joint]
        bodies.append(Body(f"plate{k}", f"plate{k}", k, Hull((box - p[k]) @ R[k])))
    model = CollisionModel(hoap2, bodies, [(1, 0)])
    assert model.nearest(here).distance[0] == pytest.approx(0.04, abs=1e-6)
    most = []
    for angle in (0.01, -0.01):  # of the base, and the upper plate, about an axis in their plane
        (lost,), (bound,) = lost_and_bound(model, here, angle * np.eye(hoap2.nv)[3])
        # No more than from edge to edge, and at least what was lost.
        assert lost <= bound <= 0.01 * 0.2 * np.sqrt(2.0) + 1e-4
        most.append(lost)
    # Of two parallel faces any points are nearest: those found miss one edge or the other.
    assert max(most) > 0.1 * 0.01 * 0.2


@pytest.mark.parametrize("tilt", [0.002, 0.005, 0.008])
def test_a_strip_that_leans_loses_what_turning_past_parallel_takes(tilt, hoap2) -> None:
    """Turned by more than it leans, its other end comes down: length times the difference."""
    here = hoap2.snapshot(hoap2.posture("standing"))
    R, p = here.joint_placements
    strip, floor = Hull.box([0.01, 0.2, 0.01]).vertices, Hull.box([1.0, 1.0, 0.01]).vertices
    axis = R[1][:, 0]  # the base's own
    leaning = strip @ pin.exp3(-tilt * axis).T
    leaning += p[1] - [0.0, 0.0, leaning[:, 2].min()]
    below = floor + p[1] - [0.0, 0.0, 0.005 + 0.01]  # its face is 1 cm lower
    bodies = [
        Body("strip", "strip", 1, Hull((leaning - p[1]) @ R[1])),
        Body("floor", "floor", 0, Hull(below)),
    ]
    model = CollisionModel(hoap2, bodies, [(0, 1)])
    assert model.nearest(here).distance[0] == pytest.approx(0.01, abs=1e-6)
    angle = 0.01
    (lost,), (bound,) = lost_and_bound(model, here, angle * np.eye(hoap2.nv)[3])
    assert lost == pytest.approx(0.2 * (angle - tilt), rel=0.1)
    assert lost <= bound <= 1.05 * angle * 0.2  # of turning by all of it


def test_random_plates_lose_what_the_bound_says_and_no_less(hoap2, rng) -> None:
    """Rounded plates, parallel or nearly, turned and slid any way: a loss of first order."""
    here = hoap2.snapshot(hoap2.posture("standing"))
    R, p = here.joint_placements
    supports = [set(above) for above in hoap2.model.supports]
    used, beyond = [], 0
    for _ in range(150):
        one, other = (int(k) for k in rng.choice(np.arange(1, hoap2.model.njoints), 2, False))
        thick, gap, size = 0.01, rng.choice([1e-3, 1e-2, 5e-2]), rng.choice([1e-3, 1e-2])
        radius, tilt = rng.choice([0.0, 0.02]), rng.choice([0.0, size])
        turn, middle = pin.exp3(rng.normal(size=3)), 0.5 * (p[one] + p[other])
        bodies = []
        for k, height in ((one, thick + gap + 2.0 * radius), (other, 0.0)):
            spin = pin.exp3(np.array([0.0, 0.0, rng.normal()]))
            spin = pin.exp3(np.array([*(tilt * rng.normal(size=2)), 0.0])) @ spin
            place = np.array([*rng.uniform(-0.02, 0.02, 2), height])
            box = Hull.box([*rng.uniform(0.05, 0.3, 2), thick]).vertices @ spin.T + place
            world = box @ turn.T + middle
            bodies.append(Body(f"plate{k}", f"plate{k}", k, Hull((world - p[k]) @ R[k], radius)))
        model = CollisionModel(hoap2, bodies, [(0, 1)])
        step = size * rng.normal(size=hoap2.nv)
        (lost,), (bound,) = lost_and_bound(model, here, step)
        assert lost <= bound + 5e-6
        used.append(lost / bound)
        between = supports[one] ^ supports[other]
        angle = sum(abs(step[hoap2.model.idx_vs[k]]) for k in between)
        beyond += lost > 0.5 * angle * angle + 5e-6
    # 77 of 150 lose what is not of second order, and up to 0.44 of the bound is used.
    assert beyond > 60
    assert max(used) > 0.4


@pytest.mark.parametrize("shape", ["ball", "box"])
def test_a_base_that_slides_and_turns_is_counted(shape, hoap2, rng) -> None:
    """Sliding far while turning little bends the way by half of both, whatever the levers."""
    here = hoap2.snapshot(hoap2.posture("standing"))
    R, p = here.joint_placements
    solid_one = Capsule.sphere(np.zeros(3), 0.05) if shape == "ball" else Hull.box([0.1, 0.1, 0.1])
    worst = -np.inf
    for _ in range(40):
        away, slide = np.linalg.qr(rng.normal(size=(3, 3)))[0].T[:2]
        wall = HalfSpace.of(away, float(away @ p[1]) - 0.2)
        bodies = [Body("base", "base", 1, solid_one), Body("wall", "wall", 0, wall)]
        model = CollisionModel(hoap2, bodies, [(0, 1)])
        found = model.nearest(here)
        step = np.zeros(hoap2.nv)
        # About the axis that turns the way into the wall.
        step[:3], step[3:6] = R[1].T @ (0.05 * slide), R[1].T @ (0.005 * np.cross(away, slide))
        there = hoap2.snapshot(hoap2.integrate(here.q, step, 1.0))
        lost = (found.distance + model.rows(here, found) @ step - model.nearest(there).distance)[0]
        worst = max(worst, lost)
        assert lost <= model.curvature_bound(found.pairs, step)[0] + 1e-6
    assert worst > 1e-4  # half of 5 cm times 5 mrad is 0.125 mm
