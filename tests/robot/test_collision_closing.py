"""Which pairs have to brake first: against all pairs, measured and differentiated."""

import numpy as np
import pytest

from tests.conftest import random_state
from wbc.constraints import Limits, Obstacles, SelfCollision
from wbc.robot import Robot
from wbc.robot.collision import Body, Capsule, CollisionModel, HalfSpace, Obstacle, Shape
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
