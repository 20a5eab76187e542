"""Postures and motions that keep constraints, judged by coal; planes between bodies, likewise."""

from collections.abc import Sequence
from itertools import count

import casadi as ca
import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from wbc.constraints import (
    ComSupport,
    Constraint,
    Limits,
    Obstacles,
    PositionBox,
    SelfCollision,
    support,
)
from wbc.constraints.margin import Margin
from wbc.constraints.rows import Distances, SymbolicRows
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.robot.collision import Body, Capsule, CollisionModel, Obstacle
from wbc.shaping import GlobalShaping, NoPostureError, separation
from wbc.shaping.nlp import build_nlp
from wbc.shaping.planes import ENTRIES, UNKNOWNS, Corners, PlaneRows, Side, Slot, plane_rows
from wbc.shaping.separation import NlpParts, with_planes
from wbc.tasks import ComTask, InertiaTask, PositionTask, PostureTask, Task

ARMS = ("*hand*", "*forearm*")
SKIN = 1e-4  # m: what the search keeps beyond the margin, as the QP does


def small(robot: Robot) -> InertiaTask:
    """A third of the inertia: out of reach, and nearest to it the arms are in the chest."""
    moments = np.diag(robot.snapshot(robot.posture()).inertia_in("world"))
    return InertiaTask(robot, 0.3 * np.diag(moments), per_mass=True, weight=10.0)


def true_distance(robot: Robot, q: np.ndarray, watched: SelfCollision) -> float:
    """Least distance of the description's own shapes, over the pairs that are watched.

    Those that stand within the margin of 1 cm may be nearer by what their own margins are less.
    """
    geometry = robot.collision_model.copy()
    numbers = [k for k, one in enumerate(geometry.geometryObjects) if one.parentJoint > 0]
    bodies = watched.model.bodies  # as many as shapes, then finer ones of the same names
    shape = {body.name: k for body, k in zip(bodies, numbers, strict=False)}
    for pair in watched.model.pairs.tolist():
        a, b = (bodies[k].name.partition("/")[0] for k in pair)
        geometry.addCollisionPair(pin.CollisionPair(shape[a], shape[b]))
    data, placed = robot.model.createData(), geometry.createData()
    pin.computeDistances(robot.model, data, geometry, placed, q)
    found = np.array([result.min_distance for result in placed.distanceResults])
    return float((found + 0.01 - watched.margins).min())


def shaping_of(robot: Robot, tasks: Sequence[Task], *constraints: Constraint) -> GlobalShaping:
    contacts = support(robot.snapshot(robot.posture()), "double")
    return GlobalShaping(robot, tasks, contacts, constraints=constraints)


@pytest.mark.slow
def test_small_without_touching_itself(hoap2) -> None:
    """The best of all postures has its arms in its body; the best of those allowed does not."""
    q, task = hoap2.posture(), small(hoap2)
    watched = SelfCollision(hoap2, margin=0.01)
    free = shaping_of(hoap2, [task]).solve(q, 4, workers=1)
    assert true_distance(hoap2, free.best.q, watched) < -0.01
    shaping = shaping_of(hoap2, [task], watched)
    kept = shaping.solve(q, 4, workers=1)
    assert len(kept.candidates) >= 2
    shared = shaping.solve(q, 4, workers=2)  # answers do not depend on who searched
    assert [c.starts for c in kept.candidates] == [c.starts for c in shared.candidates]
    for one, other in zip(kept.candidates, shared.candidates, strict=True):
        np.testing.assert_array_equal(one.q, other.q)
        assert one.iterations == other.iterations
    for candidate in kept.candidates:
        # The shapes that the search knows hold those of the description: no nearer than these.
        assert true_distance(hoap2, candidate.q, watched) >= 0.01 - 1e-6
        assert candidate.kept.clearance >= 0.0
    assert kept.best.kept.clearance == pytest.approx(SKIN, abs=1e-5)  # it leans on a margin
    assert free.best.cost < kept.best.cost < 0.5 * kept_cost(task, hoap2, q)
    motion = shaping.reach(q, kept, dt=0.01)
    assert motion.arrived, motion.attempts
    assert motion.kept.clearance >= -1e-6
    for row in motion.q[::20]:
        assert true_distance(hoap2, row, watched) >= 0.01 - 1e-6


def kept_cost(task: InertiaTask, robot: Robot, q: np.ndarray) -> float:
    error = task.weight * task.residual(robot.snapshot(q)).error
    return 0.5 * task.gain * float(error @ error)


@pytest.mark.slow
def test_hulls_take_more_corners_as_they_need_them(hoap2) -> None:
    """Prisms of 32 corners for cylinders: none of the pairs in the program needs them all."""
    watched = SelfCollision(hoap2, margin=0.01, fit="hull")
    best = shaping_of(hoap2, [small(hoap2)], watched).solve(hoap2.posture(), 1, workers=1).best
    assert true_distance(hoap2, best.q, watched) >= 0.01 - 1e-6
    assert best.kept.clearance == pytest.approx(SKIN, abs=0.5 * SKIN)


def obstacles() -> dict[str, Obstacle]:
    """In the way of a hand that is drawn 20 cm forwards, each 10 cm or less before it."""
    turned = Obstacle.box("box", [0.1, 0.2, 0.2])
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    turned.move(turn, [0.2, -0.15, 0.3])
    return {
        "wall": Obstacle.half_space("wall", [-1.0, 0.0, 0.0], -0.12),
        "box": turned,
        "post": Obstacle.capsule("post", [0.16, -0.16, 0.0], [0.16, -0.16, 0.6], 0.02),
        "ball": Obstacle.sphere("ball", [0.18, -0.16, 0.3], 0.06),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(obstacles()))
def test_obstacles_are_kept_clear_of(hoap2, name: str) -> None:
    q, thing = hoap2.posture(), obstacles()[name]
    hand = hoap2.snapshot(q).position("right_hand")
    place = np.array([hand[0] + 0.2, -0.16, 0.3])
    tasks = [PositionTask(hoap2, "right_hand", place), PostureTask(hoap2, q, weight=0.05)]
    around = Obstacles(hoap2, [thing], margin=0.02, links=ARMS)

    def nearest(q: np.ndarray) -> float:
        """By coal, of the description's shapes on the arms."""
        geometry = hoap2.collision_model
        data, placed = hoap2.model.createData(), geometry.createData()
        pin.updateGeometryPlacements(hoap2.model, data, geometry, placed, q)
        names = [hoap2.model.frames[one.parentFrame].name for one in geometry.geometryObjects]
        there = pin.coal.Transform3s(thing.rotation, thing.origin)
        return min(
            pin.coal.distance(
                one.geometry,
                pin.coal.Transform3s(place.rotation, place.translation),
                *coal_obstacle(thing, there),
                pin.coal.DistanceRequest(),
                pin.coal.DistanceResult(),
            )
            for one, place, link in zip(geometry.geometryObjects, placed.oMg, names, strict=True)
            if any(part.strip("*") in link for part in ARMS)
        )

    free = shaping_of(hoap2, tasks).solve(q, 2, workers=1).best
    assert nearest(free.q) < 0.0
    shaping = shaping_of(hoap2, tasks, around)
    outcome = shaping.solve(q, 2, workers=1)
    assert nearest(outcome.best.q) >= 0.02 - 1e-6
    assert outcome.best.kept.clearance == pytest.approx(SKIN, abs=1e-5)
    motion = shaping.reach(q, outcome, dt=0.01)
    assert motion.arrived, motion.attempts
    assert min(nearest(row) for row in motion.q[::20]) >= 0.02 - 1e-6


def coal_obstacle(thing: Obstacle, there: "pin.coal.Transform3s") -> tuple:
    """The shape and place of an obstacle, made from numbers of this file."""
    still = pin.coal.Transform3s.Identity()
    match thing.name:
        case "wall":
            return pin.coal.Halfspace(np.array([-1.0, 0.0, 0.0]), -0.12), still
        case "box":
            return pin.coal.Box(0.1, 0.2, 0.2), there
        case "post":
            middle = pin.coal.Transform3s(np.eye(3), np.array([0.16, -0.16, 0.3]))
            return pin.coal.Capsule(0.02, 0.6), middle
    return pin.coal.Sphere(0.06), pin.coal.Transform3s(np.eye(3), np.array([0.18, -0.16, 0.3]))


def test_the_com_and_the_base_stay_where_they_must(hoap2) -> None:
    """Drawn out of the polygon and below the box: the best posture is at both edges."""
    q = hoap2.posture()
    here = hoap2.snapshot(q)
    tasks = [
        ComTask(hoap2, here.com + [0.2, 0.0, -0.1]),
        PositionTask(hoap2, "base", here.position("base") - [0.0, 0.0, 0.1]),
        PostureTask(hoap2, q, weight=0.01),
    ]
    floor = float(here.position("base")[2]) - 0.03
    constraints = ComSupport.over(here, margin=0.01), PositionBox.height(hoap2, floor)
    shaping = shaping_of(hoap2, tasks, *constraints)
    outcome = shaping.solve(q, 4, workers=1)
    best = hoap2.snapshot(outcome.best.q)
    front = max(
        here.position(foot.frame)[0] + foot.polygon[:, 0].max() for foot in hoap2.feet.values()
    )
    assert best.com[0] == pytest.approx(front - 0.01 - SKIN, abs=1e-5)
    assert best.position("base")[2] == pytest.approx(floor + SKIN, abs=1e-5)
    motion = shaping.reach(q, outcome, dt=0.01)
    assert motion.arrived, motion.attempts
    for row in motion.q[::10]:
        there = hoap2.snapshot(row)
        assert there.com[0] <= front - 0.01 + 1e-6
        assert there.position("base")[2] >= floor - 1e-6


def test_two_spheres_of_the_callers(hoap2) -> None:
    """Two hands drawn to one place, with bodies that the description does not have."""
    q = hoap2.posture()
    hands = ("left_hand", "right_hand")
    frames = [hoap2.model.frames[hoap2.frame_id(hand)] for hand in hands]
    bodies = [
        Body(hand, hand, frame.parentJoint, Capsule.sphere(frame.placement.translation, radius))
        for hand, frame, radius in zip(hands, frames, (0.02, 0.03), strict=True)
    ]
    place = hoap2.snapshot(q).com + [0.12, 0.0, 0.05]
    tasks = [PositionTask(hoap2, hand, place) for hand in hands]
    tasks.append(PostureTask(hoap2, q, weight=1e-3))
    spheres = SelfCollision(hoap2, margin=0.0, model=CollisionModel(hoap2, bodies, [(0, 1)]))

    def gap(shaping: GlobalShaping) -> float:
        here = hoap2.snapshot(shaping.solve(q, 2, workers=1).best.q)
        return float(np.linalg.norm(here.position(hands[0]) - here.position(hands[1])))

    assert gap(shaping_of(hoap2, tasks)) < 0.04
    assert gap(shaping_of(hoap2, tasks, spheres)) == pytest.approx(0.05 + SKIN, abs=1e-6)


def test_joints_are_seen_from_the_base(hoap2, rng, random_snapshot) -> None:
    """And so is the world, because an obstacle is in it."""
    around = Obstacles(hoap2, [obstacles()["wall"]], links=ARMS)
    shaping = GlobalShaping(hoap2, [small(hoap2)], constraints=[around])
    built = build_nlp(shaping.problem)
    here = random_snapshot(hoap2, rng)
    start = built.start(here.q)
    placed = np.array(built.nlp.separation.placements(start.x, start.p)).reshape(-1, 4, 3)
    data = hoap2.model.createData()
    pin.forwardKinematics(hoap2.model, data, here.q)
    joints = built.nlp.separation.bodies.joints
    assert joints[0] == 0
    for joint, found in zip(joints, placed, strict=True):
        expected = data.oMi[1].actInv(data.oMi[joint])
        np.testing.assert_allclose(found[:3].T, expected.rotation, atol=1e-12)
        np.testing.assert_allclose(found[3], expected.translation, atol=1e-12)


def test_slopes_of_the_whole_program_are_differences(hoap2, rng) -> None:
    """With an obstacle, so that the base's place matters too."""
    q = hoap2.posture()
    around = Obstacles(hoap2, [obstacles()["wall"], obstacles()["box"]], links=ARMS)
    shaping = GlobalShaping(hoap2, [small(hoap2)], constraints=[SelfCollision(hoap2), around])
    built = build_nlp(shaping.problem)
    separated, start = built.nlp.separation, built.start(q)
    bodies = separated.bodies
    pairs = [0, 100, len(bodies.pairs) - 1, len(bodies.pairs) - 7]
    everything = Corners(*[frozenset(range(1))] * 2)
    slots = [bodies.slot(pair, everything) for pair in pairs]
    assert sum(slot.normal is not None for slot in slots) == 1  # both kinds of obstacle
    planes = plane_rows(slots, separated.placements.size1_out(0))
    parts = NlpParts.of(built.nlp, separated.placements)
    _, derivatives = with_planes(parts, planes)
    x = start.x + 0.1 * rng.normal(size=start.x.size)
    z = np.concatenate((x, rng.normal(size=UNKNOWNS * len(slots))))
    m = rng.normal(size=built.nlp.g_lower.size + planes.lower.size)
    h = 1e-6

    def lagrangian(z: np.ndarray) -> np.ndarray:
        _, gradient = derivatives["grad_f"](z, start.p)
        _, slope = derivatives["jac_g"](z, start.p)
        return np.array(gradient).ravel() * 2.0 + np.array(ca.DM(slope)).T @ m

    _, gradient = derivatives["grad_f"](z, start.p)
    _, slope = derivatives["jac_g"](z, start.p)
    upper = np.array(ca.DM(derivatives["hess_lag"](z, start.p, 2.0, m)))
    whole = upper + np.triu(upper, 1).T
    for _ in range(5):
        way = rng.normal(size=z.size)
        ends = [derivatives["jac_g"](z + s * h * way, start.p)[0] for s in (1, -1)]
        costs = [derivatives["grad_f"](z + s * h * way, start.p)[0] for s in (1, -1)]
        expected = np.array(ends[0] - ends[1]).ravel() / (2 * h)
        np.testing.assert_allclose(np.array(ca.DM(slope)) @ way, expected, atol=1e-6)
        moved = float(costs[0] - costs[1]) / (2 * h)
        assert float(np.array(gradient).ravel() @ way) == pytest.approx(moved, abs=1e-6)
        turned = (lagrangian(z + h * way) - lagrangian(z - h * way)) / (2 * h)
        np.testing.assert_allclose(whole @ way, turned, atol=1e-5)


def test_a_posture_that_stays_too_near_is_rejected_by_name(hoap2, monkeypatch) -> None:
    monkeypatch.setattr(separation, "ROUNDS", 0)  # as if no round were enough
    outcome = shaping_of(hoap2, [small(hoap2)], SelfCollision(hoap2)).solve(
        hoap2.posture(), 2, workers=1
    )
    with pytest.raises(NoPostureError, match=r" vs .* lacks 0\.\d+ m of 'self-collision'"):
        print(outcome.best)


def test_a_search_that_ran_out_of_time_says_so(hoap2, monkeypatch) -> None:
    """IPOPT's "succeeded" of the rounds before was about another problem, without all pairs."""
    hours = count(step=3600.0)
    monkeypatch.setattr(separation, "perf_counter", lambda: next(hours))
    shaping = shaping_of(hoap2, [small(hoap2)], SelfCollision(hoap2))
    outcome = shaping.solve(hoap2.posture(), 1, seconds=100.0, workers=1)
    (rejected,) = outcome.rejected
    assert rejected.reason.startswith("IPOPT: Maximum_WallTime_Exceeded; ")


def test_what_the_search_cannot_keep_is_refused(hoap2) -> None:
    class Unknown(Constraint):
        name = "mine"

        def rows(self, snapshot, dt):
            raise AssertionError("not asked for")

    mine = Unknown()
    mine.robot = hoap2
    with pytest.raises(InvalidInputError, match="'mine' is a Unknown, which has no margin"):
        shaping_of(hoap2, [small(hoap2)], mine)

    class Silent(PositionBox):
        symbolic_rows = Margin.symbolic_rows

    box = Silent.height(hoap2, 0.1)
    with pytest.raises(InvalidInputError, match="'box of base' is a Silent, of which no rows"):
        shaping_of(hoap2, [small(hoap2)], box)
    other = Robot.load("hoap2_like")
    with pytest.raises(InvalidInputError, match="made for another robot"):
        shaping_of(hoap2, [small(hoap2)], PositionBox.height(other, 0.1))


@pytest.mark.slow
def test_limits_come_before_standing(hoap2) -> None:
    """On the way back to standing, joints stay in the limits asked for."""
    limits = Limits(hoap2, margin=0.05)
    shaping = GlobalShaping(hoap2, [small(hoap2)], (), limits, [SelfCollision(hoap2)])
    best = shaping.solve(hoap2.posture(), 1, workers=1).best
    assert best.kept.limit >= -1e-7
    assert best.kept.clearance >= 0.0


def test_a_constraint_of_the_callers_needs_no_more_than_itself(hoap2) -> None:
    """The left hand in front of the right one, as a box of their difference."""
    q = hoap2.posture()
    hands = ("left_hand", "right_hand")

    class Ahead(PositionBox):
        def distances(self, snapshot, keys=None):
            left, right = (snapshot.position(hand) for hand in hands)
            jacobian = snapshot.jacobian(hands[0])[:1] - snapshot.jacobian(hands[1])[:1]
            return Distances(np.arange(1), (left - right)[:1] - 0.05 - SKIN, jacobian, None)

        def symbolic_rows(self, posture):
            ahead = posture.position(hands[0])[0] - posture.position(hands[1])[0]
            return SymbolicRows(ahead, np.array([0.05 + SKIN]), np.array([np.inf]))

    ahead = Ahead(hoap2, hands[0], [0.0] * 3, [1.0] * 3)
    best = shaping_of(hoap2, [PostureTask(hoap2, q)], ahead).solve(q, 2, workers=1).best
    here = hoap2.snapshot(best.q)
    left, right = (here.position(hand) for hand in hands)
    assert left[0] - right[0] == pytest.approx(0.05 + SKIN, abs=1e-6)


BOX = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (-0.05, 0.05)])
SEGMENT = np.array([[0.0, 0.0, -0.2], [0.0, 0.0, 0.2]])
NORMAL = np.array([0.0, 0.6, 0.8])


def random_placements(rng: np.random.Generator, count: int) -> np.ndarray:
    """R by columns, then p, for each."""
    placed = [
        np.concatenate(
            (Rotation.random(random_state=rng).as_matrix().T.ravel(), rng.normal(size=3))
        )
        for _ in range(count)
    ]
    return np.concatenate(placed)


def coal_shape(points: np.ndarray) -> coal.CollisionGeometry:
    if len(points) == 2:
        return coal.Capsule(1e-9, float(np.linalg.norm(points[1] - points[0])))
    corners, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in points:
        corners.append(corner)
    for a, b, c in ConvexHull(points).simplices.tolist():
        faces.append(coal.Triangle(a, b, c))
    return coal.Convex(corners, faces)


def coal_distance(shapes: list[np.ndarray], T: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Distance, direction from the second to the first, and the point half-way."""
    places = [coal.Transform3s(one[:9].reshape(3, 3).T, one[9:]) for one in T.reshape(-1, ENTRIES)]
    found = coal.DistanceResult()
    request = coal.DistanceRequest()
    request.gjk_tolerance = 1e-9
    distance = coal.distance(
        coal_shape(shapes[0]), places[0], coal_shape(shapes[1]), places[1], request, found
    )
    a, b = np.array(found.getNearestPoint1()), np.array(found.getNearestPoint2())
    return distance, (a - b) / np.linalg.norm(a - b), 0.5 * (a + b)


@pytest.mark.parametrize("shapes", [[SEGMENT, SEGMENT], [SEGMENT, BOX], [BOX, BOX]])
def test_rows_can_be_kept_just_as_far_as_bodies_are_apart(rng, shapes) -> None:
    """Half-way between coal's nearest points lies a plane that keeps them; no other keeps more."""
    for _ in range(20):
        T = random_placements(rng, 2)
        distance, n, middle = coal_distance(shapes, T)
        if distance < 1e-3:  # inside each other: no direction to compare with
            continue
        half = 0.5 * distance
        slot = Slot(Side(0, shapes[0], half), Side(1, shapes[1], half), None)
        rows = plane_rows([slot], 2 * ENTRIES)
        value = np.array(rows.value(T, np.append(n, n @ middle))).ravel()
        assert (value >= rows.lower - 1e-6).all()
        assert (value <= rows.upper + 1e-12).all()
        corners = [
            points @ place[:9].reshape(3, 3) + place[9:]
            for points, place in zip(shapes, T.reshape(-1, ENTRIES), strict=True)
        ]
        for spread in (0.0, 0.01, 0.1, 1.0, 10.0):
            other = n + spread * rng.normal(size=3)
            other /= np.linalg.norm(other)
            kept = (corners[0] @ other).min() - (corners[1] @ other).max()
            assert kept <= distance + 1e-6


def test_a_half_space_keeps_its_own_normal(rng) -> None:
    """Of a body's corners above the surface, which turns with its frame."""
    T = random_placements(rng, 2)
    point = rng.normal(size=3)
    slot = Slot(Side(0, BOX, 0.1), Side(1, point[None], 0.2), NORMAL)
    rows = plane_rows([slot], 2 * ENTRIES)
    R, p = T[ENTRIES : ENTRIES + 9].reshape(3, 3).T, T[ENTRIES + 9 :]
    n, surface = R @ NORMAL, R @ point + p
    d = n @ surface + 0.3
    value = np.array(rows.value(T, np.append(n, d))).ravel()
    corners = BOX @ T[:9].reshape(3, 3) + T[9:ENTRIES]
    np.testing.assert_allclose(value[:8], corners @ n - d, atol=1e-12)
    assert value[8] == pytest.approx(0.3)
    np.testing.assert_allclose(value[9:], 0.0, atol=1e-12)
    np.testing.assert_array_equal(rows.lower, [0.1] * 8 + [0.2] + [0.0] * 3)
    np.testing.assert_array_equal(rows.upper[9:], 0.0)
    other = np.array(rows.value(T, np.append([1.0, 0, 0], d))).ravel()
    np.testing.assert_allclose(other[9:], np.array([1.0, 0, 0]) - n, atol=1e-12)


def three_slots(rng: np.random.Generator) -> PlaneRows:
    slots = [
        Slot(Side(0, SEGMENT, 0.1), Side(2, BOX, 0.2), None),
        Slot(Side(1, rng.normal(size=(1, 3)), 0.1), Side(0, rng.normal(size=(1, 3)), 0.0), NORMAL),
        Slot(Side(2, BOX, 0.1), Side(0, SEGMENT, 0.1), None),  # the same joints once more
    ]
    return plane_rows(slots, 3 * ENTRIES)


def test_slopes_are_differences(rng) -> None:
    rows, h = three_slots(rng), 1e-6
    T, y = random_placements(rng, 3), rng.normal(size=3 * UNKNOWNS)
    by_t, by_y = (np.array(ca.DM(one)) for one in rows.jacobian(T, y))

    def value(T: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.array(rows.value(T, y)).ravel()

    for k, step in enumerate(h * np.eye(T.size)):
        expected = (value(T + step, y) - value(T - step, y)) / (2 * h)
        np.testing.assert_allclose(by_t[:, k], expected, atol=1e-8)
    for k, step in enumerate(h * np.eye(y.size)):
        expected = (value(T, y + step) - value(T, y - step)) / (2 * h)
        np.testing.assert_allclose(by_y[:, k], expected, atol=1e-8)


def test_curvature_is_the_slope_of_the_slopes(rng) -> None:
    rows, h = three_slots(rng), 1e-6
    T, y = random_placements(rng, 3), rng.normal(size=3 * UNKNOWNS)
    m = rng.normal(size=rows.lower.size)
    force, cross, own = (np.array(ca.DM(one)) for one in rows.hessian(T, y, m))

    def pulls(T: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        by_t, by_y = (np.array(ca.DM(one)) for one in rows.jacobian(T, y))
        return by_t.T @ m, by_y.T @ m

    np.testing.assert_allclose(force.ravel(), pulls(T, y)[0], atol=1e-12)
    np.testing.assert_array_equal(own, np.triu(own))
    whole = own + np.triu(own, 1).T
    for k, step in enumerate(h * np.eye(y.size)):
        after, before = pulls(T, y + step), pulls(T, y - step)
        np.testing.assert_allclose(cross[:, k], (after[0] - before[0]) / (2 * h), atol=1e-8)
        np.testing.assert_allclose(whole[:, k], (after[1] - before[1]) / (2 * h), atol=1e-8)
