"""Margins, obstacles, CoM support and boxes in the controller: kept, named, never infeasible."""

from functools import cache
from itertools import pairwise
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from tests.standing import commanded
from wbc.constraints import (
    BrakingParameters,
    ComSupport,
    Limits,
    Obstacles,
    PositionBox,
    SelfCollision,
    support,
)
from wbc.constraints.com_support import COM_BRAKING
from wbc.constraints.margin import SKIN
from wbc.controllers import KinematicController
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.problem import load_problem
from wbc.robot import Robot
from wbc.robot.collision import CollisionModel, Obstacle, robot_bodies
from wbc.robot.series import state_series
from wbc.tasks import ComTask, PositionTask, PostureTask

DT = 0.005
HANDS = ("left_hand", "right_hand")


@cache
def standard(robot: Robot) -> SelfCollision:
    """Margins of 10 mm between all bodies; made once, for they remember nothing."""
    return SelfCollision(robot, margin=0.01)


def spare(margins: SelfCollision, here) -> float:
    """Return by how much the nearest pair is farther apart than it must be [m]."""
    return float((margins.model.nearest(here).distance - margins.margins).min())


def hand_tasks(robot: Robot, here, place, **law) -> list[PositionTask]:
    frames = [name for name in HANDS if name in robot.frame_names]
    assert frames, "the model's hands have other names"
    return [PositionTask(robot, frame, place, gain=0.2, **law) for frame in frames]


def controller(robot, tasks, here, constraints, mode="double", **options) -> KinematicController:
    lowest = max((task.priority for task in tasks), default=0)
    posture = PostureTask(robot, here.q, weight=0.02, gain=0.05, priority=lowest)
    return KinematicController(
        robot,
        [*tasks, posture],
        contacts=support(here, mode),
        limits=Limits(robot),
        constraints=constraints,
        dt=DT,
        **options,
    )


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["proxqp", "daqp"])
def test_hands_pulled_through_the_trunk_stop_at_the_margin(hoap2, here, solver) -> None:
    margins = standard(hoap2)
    tasks = hand_tasks(hoap2, here, here.com)
    control = controller(hoap2, tasks, here, [margins], solver=solver)
    rates, held = [], set()
    for tick, q_now in commanded(control, here.q, 300):
        left = spare(margins, hoap2.snapshot(q_now))
        assert left > 0.0  # the skin takes up what the rows' linearity breaks
        rates.append(tick.velocity[6:])
        held |= set(tick.active)
    assert left < 2e-3
    assert any("hand" in label or "arm" in label for label in held)
    assert all(" vs " in label for label in held)
    # Against the margin nothing trembles: in half a second a joint turns back four times at most.
    late = np.array(rates[-100:])
    turns = (late[1:] * late[:-1] < 0) & (np.minimum(abs(late[1:]), abs(late[:-1])) > 1e-3)
    assert turns.sum(axis=0).max() <= 4


def test_without_the_constraint_they_would_collide(hoap2, here) -> None:
    """The same motion without margins ends inside: the test above tests something."""
    margins = standard(hoap2)
    control = controller(hoap2, hand_tasks(hoap2, here, here.com), here, [])
    *_, (_, end) = commanded(control, here.q, 300)
    assert margins.model.nearest(hoap2.snapshot(end)).distance.min() < 0.0


def filled(memory: np.ndarray) -> np.ndarray:
    """Return memory of numbers full of infinities."""
    if memory.dtype == np.float64:
        memory.fill(np.inf)
    return memory


def test_lower_priorities_keep_margins_too(hoap2, here, monkeypatch) -> None:
    """In memory full of infinities: where the core has no QP it leaves them, and nobody reads them.

    Labels were looked up by what stood there, where more pairs were near than the core has rows.
    """
    empty = np.empty
    monkeypatch.setattr(np, "empty", lambda *given, **named: filled(empty(*given, **named)))
    margins = standard(hoap2)
    com = ComTask(hoap2, here.com, priority=0, gain=0.5)
    control = controller(
        hoap2, [com, *hand_tasks(hoap2, here, here.com, priority=1)], here, [margins]
    )
    held = set()
    for tick, q_now in commanded(control, here.q, 150):
        there = hoap2.snapshot(q_now)
        assert spare(margins, there) > 0.0
        held |= set(tick.active)
    assert held
    np.testing.assert_allclose(there.com, here.com, atol=1e-4)  # what a tick's curvature leaves


def test_a_start_inside_a_margin_is_solved_and_left(hoap2, here) -> None:
    """Hands held 3 cm nearer to the trunk than they may: out they come, at a bounded rate."""
    every = standard(hoap2).model
    names = [body.name for body in every.bodies]
    pairs = [(a, b) for a, b in every.pairs.tolist() if names[a][:5] + names[b][5:9] == "torso_han"]
    hands = CollisionModel(hoap2, every.bodies, pairs)
    start = hands.nearest(here).distance.min()
    law = BrakingParameters(recovery_speed=0.1)
    margins = SelfCollision(hoap2, margin=start + 0.03, model=hands, braking=law)
    control = controller(hoap2, [ComTask(hoap2, here.com)], here, [margins])
    last = start
    for _, q_now in commanded(control, here.q, 200):
        distance = hands.nearest(hoap2.snapshot(q_now)).distance.min()
        assert last - 1e-5 < distance < last + 0.1 * DT + 1e-4
        last = distance
    assert last == pytest.approx(start + 0.03, abs=2e-4)


def test_a_robot_inside_its_margins_everywhere_is_solved_too(hoap2, here) -> None:
    """25 pairs that cannot all be pushed out: nothing is infeasible, and nothing gets worse."""
    every = standard(hoap2).model
    margins = SelfCollision(hoap2, margin=0.03, model=every)
    start = every.nearest(here).distance.min()
    control = controller(hoap2, [ComTask(hoap2, here.com)], here, [margins])
    *_, (tick, end) = commanded(control, here.q, 100)
    assert tick.qp.l.max() <= 0.0
    assert every.nearest(hoap2.snapshot(end)).distance.min() > start - SKIN


def test_a_ball_that_comes_is_evaded_and_nothing_is_infeasible(hoap2, here) -> None:
    hand = here.position("left_hand")
    ball = Obstacle.sphere("ball", hand + [0.25, 0.0, 0.0], 0.03)
    ball.move(np.eye(3), np.zeros(3), velocity=[-0.15, 0.0, 0.0])
    around = Obstacles(hoap2, [ball], margin=0.02, links=["left_hand*", "left_*arm*"])
    control = controller(hoap2, [ComTask(hoap2, here.com)], here, [around])
    least, touched = np.inf, False
    for tick, q in commanded(control, here.q, 300):
        touched |= any("vs ball" in label for label in tick.qp.labels.inequality)
        ball.advance(DT)
        found = around.distances(hoap2.snapshot(q))
        least = min(least, float(found.clearance.min()))
    assert touched
    assert least > -1e-3, "the hand had time and room to get out of the way"
    assert np.linalg.norm(hoap2.snapshot(q).position("left_hand") - hand) > 0.02


def test_a_train_hits_all_the_same_but_the_qp_is_solved(hoap2, here) -> None:
    train = Obstacle.box("train", [0.2, 2.0, 2.0], [0.6, 0.0, 0.5])
    train.move(np.eye(3), np.zeros(3), velocity=[-5.0, 0.0, 0.0])
    around = Obstacles(hoap2, [train])
    control = controller(hoap2, [ComTask(hoap2, here.com)], here, [around])
    least = np.inf
    for tick, q in commanded(control, here.q, 60):
        assert tick.ok, tick.report()
        train.advance(DT)
        least = min(least, float(around.distances(hoap2.snapshot(q)).clearance.min()))
    assert least < 0.0, "it hits"


@pytest.mark.parametrize(
    "obstacle",
    [
        Obstacle.sphere("thing", [0.22, 0.12, 0.28], 0.05),
        Obstacle.capsule("thing", [0.22, -0.5, 0.28], [0.22, 0.5, 0.28], 0.03),
        Obstacle.box("thing", [0.1, 0.6, 0.1], [0.26, 0.0, 0.28]),
        Obstacle.half_space("thing", [-1.0, 0.0, 0.0], -0.2),
    ],
    ids=["sphere", "capsule", "box", "half-space"],
)
def test_a_hand_pressed_on_an_obstacle_stops_at_the_margin(hoap2, here, obstacle) -> None:
    around = Obstacles(hoap2, [obstacle], margin=0.02)
    assert around.distances(here).clearance.min() > 0.0
    target = np.array([0.3, 0.12, 0.28])
    control = controller(hoap2, hand_tasks(hoap2, here, target)[:1], here, [around])
    held = False
    for tick, q_now in commanded(control, here.q, 250):
        assert around.distances(hoap2.snapshot(q_now)).clearance.min() > -SKIN
        held |= any("vs thing" in label for label in tick.active)
    assert held


@pytest.mark.parametrize("acceleration", [None, 4.0])
def test_a_standing_robot_is_not_moved_by_what_is_metres_away(hoap2, here, acceleration) -> None:
    """Links near the base are hardly moved by their own joints, but by the legs."""
    limits = Limits(hoap2, acceleration=acceleration)
    ball = Obstacle.sphere("ball", here.com + (4.0, 0.0, 0.0), 0.1)
    around = Obstacles(hoap2, [ball], limits=limits)
    ball.move(np.eye(3), np.zeros(3), (-0.4, 0.0, 0.0))
    rows = around.rows(here, DT)
    assert rows.push is None
    assert rows.lower.max() < -1.0  # m/s


def test_rows_follow_a_moving_obstacle(hoap2, here, rng) -> None:
    """rate is the slope of the distance while the robot stands still."""
    things = [
        Obstacle.sphere("s", [0.3, 0.0, 0.3], 0.05),
        Obstacle.capsule("c", [0.3, 0.3, 0.1], [0.3, 0.4, 0.6], 0.05),
        Obstacle.half_space("h", [1.0, 0.2, 0.1], -0.5),
    ]
    for thing in things:
        thing.move(np.eye(3), np.zeros(3), rng.normal(size=3), rng.normal(size=3))
    around = Obstacles(hoap2, things, pairs=10_000)
    now = around.distances(here)
    h = 1e-4
    for thing in things:
        thing.advance(h)
    later = around.distances(here)
    # GJK stops at 1e-7 m, of two distances; the curvature is below 1 / (5 cm) at 1 m/s.
    np.testing.assert_allclose((later.clearance - now.clearance) / h, now.rate, rtol=0, atol=4e-3)


# ------------------------------------------------------------------------------ CoM and boxes


def test_edges_in_line_are_one_row_wherever_the_robot_stands(hoap2) -> None:
    """Of two soles side by side: four edges, those of the soles' fronts and backs in line."""
    for yaw in np.linspace(-3.0, 3.0, 25):
        q = hoap2.posture("standing")
        q[:3] += [3.0, -2.0, 0.5]
        q[3:7] = [0.0, 0.0, np.sin(0.5 * yaw), np.cos(0.5 * yaw)]
        assert len(ComSupport.over(hoap2.snapshot(q)).corners) == 4


def test_the_com_is_over_all_feet_whatever_they_are_called(here) -> None:
    feet = {name: {"link": f"{name}_sole"} for name in ("left", "right")}
    named = {"front": feet["left"], "hind": feet["right"]}
    robot = Robot.load("hoap2_like", feet=named)
    corners = ComSupport.over(robot.snapshot(here.q)).corners
    np.testing.assert_array_equal(corners, ComSupport.over(here, ("left", "right")).corners)


def test_the_coms_rows_are_slopes(hoap2, here, rng) -> None:
    held = ComSupport.over(here)
    distances, v, h = held.distances(here), rng.normal(size=hoap2.nv), 1e-6
    ahead = held.distances(hoap2.snapshot(hoap2.integrate(here.q, v, h))).clearance
    np.testing.assert_allclose((ahead - distances.clearance) / h, distances.jacobian @ v, atol=1e-5)


def test_a_polygon_must_have_area_and_room(hoap2) -> None:
    square = np.array([[0, 0], [0, 1], [1, 1], [1, 0]], dtype=float)
    held = ComSupport(hoap2, square, margin=0.1)
    assert held.braking == BrakingParameters(COM_BRAKING)
    gentle = BrakingParameters(0.5)
    assert ComSupport(hoap2, square, braking=gentle).braking is gentle
    held.set_polygon(2 * square)
    np.testing.assert_allclose(held.corners.max(axis=0), [2, 2])
    with pytest.raises(InvalidInputError, match="shape"):
        ComSupport(hoap2, [[0, 0, 0]])


def test_a_workspace_for_a_hand(hoap2, here, rng) -> None:
    place = here.position("left_hand")
    box = PositionBox(hoap2, "left_hand", place - 0.02, place + [0.02, 0.02, np.inf])
    distances, v, h = box.distances(here), rng.normal(size=hoap2.nv), 1e-6
    assert box.labels(distances) == (
        "left_hand x lower", "left_hand y lower", "left_hand z lower",
        "left_hand x upper", "left_hand y upper",
    )  # fmt: skip
    np.testing.assert_allclose(distances.clearance, 0.02 - SKIN, atol=1e-12)
    ahead = box.distances(hoap2.snapshot(hoap2.integrate(here.q, v, h))).clearance
    np.testing.assert_allclose((ahead - distances.clearance) / h, distances.jacobian @ v, atol=1e-5)
    with pytest.raises(UnknownNameError, match="left_hand"):
        PositionBox(hoap2, "left_hnd", place, place + 1.0)


# ------------------------------------------------------------------------------ refusals


def test_what_makes_no_sense_is_refused(hoap2, here, robot_named) -> None:
    other = robot_named("talos")
    margins = standard(hoap2)
    with pytest.raises(InvalidInputError, match="another robot"):
        KinematicController(
            other, [PostureTask(other, other.posture("standing"))], constraints=[margins]
        )
    with pytest.raises(InvalidInputError, match="another robot"):
        SelfCollision(other, model=margins.model)
    with pytest.raises(InvalidInputError, match="none given"):
        Obstacles(hoap2, [])
    with pytest.raises(InvalidInputError, match="'b' is named twice"):
        Obstacles(hoap2, [Obstacle.sphere("b", [x, 9, 9], 1) for x in (5, 9)])
    with pytest.raises(UnknownNameError, match="left_hand"):
        Obstacles(hoap2, [Obstacle.sphere("b", [9, 9, 9], 1)], links=["left_hnd"])
    posture = PostureTask(hoap2, here.q)
    with pytest.raises(InvalidInputError, match="inequality row"):
        KinematicController(hoap2, [posture], constraints=[margins], solver="pseudo_inverse").step(
            hoap2.snapshot(hoap2.posture("standing"))
        )


def test_all_constraints_at_once(hoap2, here, rng) -> None:
    """Random targets, every constraint: all QPs solved, nothing broken."""
    margins = standard(hoap2)
    held = ComSupport.over(here, margin=0.005)
    box = PositionBox.height(hoap2, here.q[2] - 0.05)
    wall = Obstacles(hoap2, [Obstacle.half_space("wall", [-1, 0, 0], -0.25)])
    tasks = hand_tasks(hoap2, here, here.com)
    control = controller(hoap2, tasks, here, [margins, held, box, wall], mode="left")
    for k, (_, q_now) in enumerate(commanded(control, here.q, 200)):
        if k % 40 == 0:
            for task in tasks:
                task.set_target(here.com + rng.normal(scale=0.2, size=3))
        there = hoap2.snapshot(q_now)
        for constraint in (margins, held, box, wall):
            assert constraint.distances(there).clearance.min() > -SKIN, constraint


# ------------------------------------------------------------------------------ by raw meshes


def raw_distance(robot: Robot, q, first: str, second: str) -> float:
    """Return the distance between the meshes of two links, by coal alone; 0 where they meet."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    placed: dict[str, list] = {first: [], second: []}
    for shape in robot.collision_model.geometryObjects:
        link = robot.model.frames[shape.parentFrame].name
        if link in placed:
            pose = data.oMi[shape.parentJoint] * shape.placement
            transform = coal.Transform3s(pose.rotation, pose.translation)
            placed[link].append((shape.geometry, transform))
    found = [
        coal.distance(*one, *two, coal.DistanceRequest(), coal.DistanceResult())
        for one in placed[first]
        for two in placed[second]
    ]
    return max(min(found), 0.0)


@pytest.mark.slow
def test_talos_feet_do_not_pass_through_each_other(robot_named) -> None:
    """Right foot held, left pulled over it: their capsules meet when standing, the feet do not."""
    robot = robot_named("talos")
    margins = SelfCollision(robot, margin=0.01)
    q = robot.posture("standing")
    here = robot.snapshot(q)
    foot = robot.feet["left"].frame
    over = here.position(foot) - [0.0, 0.2, 0.0]
    pull = PositionTask(robot, foot, over, gain=0.1)
    links = "leg_left_6_link", "leg_right_6_link"
    control = controller(robot, [pull], here, [margins], mode="right")
    near = [raw_distance(robot, q, *links)]
    for _, q_now in commanded(control, q, 200):
        near.append(raw_distance(robot, q_now, *links))
    assert near[0] > 0.03
    assert 0.01 <= min(near) < 0.025  # the hulls that stand for the feet stick out by 4 mm each
    free = controller(robot, [pull], here, [], mode="right")
    *_, (_, end) = commanded(free, q, 200)
    assert raw_distance(robot, end, *links) == 0.0  # without margins they do


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hoap2_like", "g1_27", "talos"])
def test_no_pair_is_left_unwatched_silently(name, robot_named) -> None:
    """Every pair is watched, or named with its reason, which the raw shapes confirm."""
    robot = robot_named(name)
    margins = SelfCollision(robot, margin=0.01)
    bodies = robot_bodies(robot)
    watched = {frozenset(label.split(" vs ")) for label in margins.model.labels}
    watched = {frozenset(body.partition("/")[0] for body in pair) for pair in watched}
    named = {frozenset(label.split(" vs ")): why for label, why in margins.excluded.items()}
    pairs = {frozenset((a.name, b.name)) for a in bodies for b in bodies if a.joint != b.joint}
    assert pairs == watched | set(named)
    assert not watched & set(named)
    plain = "adjacent", "disabled in the SRDF"
    judged = {pair: why for pair, why in named.items() if why not in plain}
    assert len(judged) <= 12
    for pair, why in judged.items():
        links = [body.partition("#")[0] for body in pair]
        apart = raw_distance(robot, robot.posture("standing"), *links)
        if "in contact" in why:
            assert apart < 1e-3
        else:
            assert "too near to tell" in why or why == "almost always touching"
            assert apart < 0.02
    standing = margins.model.nearest(robot.snapshot(robot.posture("standing"))).distance
    assert (standing >= margins.margins - 1e-6).all()
    assert (margins.margins <= 0.01).all() and (margins.margins > 2e-4).all()
    assert set(margins.finer).isdisjoint(margins.excluded)


def test_a_pair_has_room_where_the_robot_stands(hoap2: Robot) -> None:
    """A ball for a disc 5 mm thick stood 0.09 mm outside the margin, and each bow was inside."""
    margins = SelfCollision(hoap2, margin=0.005)
    assert "torso#3 vs left_hip_yaw_link" in margins.finer
    standing = margins.model.nearest(hoap2.snapshot(hoap2.posture("standing"))).distance
    full = margins.margins == 0.005
    assert (standing[full] > 0.0055).all()


def test_pairs_without_rows_are_watched_where_the_command_leads(hoap2, here, rng) -> None:
    """One row a tick for all pairs: another one may be farther away now and nearer next."""
    margins = SelfCollision(hoap2, margin=0.01, pairs=1)
    tasks = [
        PositionTask(hoap2, frame, here.position(frame), gain=0.5)
        for frame in ("left_palm", "right_palm", "left_sole", "right_sole")
    ]
    control = controller(hoap2, tasks, here, [margins], mode="floating")
    for k, (_, q_now) in enumerate(commanded(control, here.q, 100)):
        if k % 25 == 0:
            for task in tasks:
                task.set_target(here.com + rng.normal(scale=0.1, size=3))
        every = margins.model.nearest(hoap2.snapshot(q_now))
        assert (every.distance - margins.margins).min() > -SKIN


def test_rows_go_to_the_pairs_of_least_clearance(hoap2, here) -> None:
    """Not to the nearest: pairs that stand near each other by design keep less."""
    margins = SelfCollision(hoap2, margin=0.05, pairs=5)
    assert (margins.margins < 0.05).any()
    every = margins.model.nearest(here)
    clearance = every.distance - margins.margins
    chosen = margins.distances(here)
    assert set(chosen.keys) == set(every.pairs[np.argsort(clearance)[:5]])
    np.testing.assert_allclose(
        chosen.clearance, clearance[np.searchsorted(every.pairs, chosen.keys)] - SKIN, atol=1e-12
    )
    assert set(chosen.keys) != set(every.pairs[np.argsort(every.distance)[:5]])


@pytest.mark.parametrize("name", ["g1", "hoap2_like"])
def test_near_pairs_of_many_states_are_those_of_each(name: str, robot_named, rng) -> None:
    robot, limit = robot_named(name), 0.05
    margins = SelfCollision(robot, margin=0.02)
    start, q = robot.posture("standing"), []
    for _ in range(5):
        away = np.concatenate((rng.normal(size=6), 0.3 * rng.normal(size=robot.nv - 6)))
        q.append(robot.integrate(start, away, 1.0))
    where, pairs, clearance, J = margins.near(q, state_series(robot, np.array(q)), limit)
    assert pairs.size and (np.diff(where) >= 0).all()
    for k, one in enumerate(q):
        every = margins.distances(robot.snapshot(one), np.arange(len(margins.model.pairs)))
        near = every.clearance < limit
        own, order = where == k, np.argsort(pairs[where == k])
        np.testing.assert_array_equal(pairs[own][order], np.sort(every.keys[near]))
        placed = np.argsort(every.keys[near])
        for found, wanted in ((clearance, every.clearance), (J, every.jacobian)):
            np.testing.assert_allclose(found[own][order], wanted[near][placed], atol=1e-9)


def test_robot_whose_feet_alone_have_shapes_is_told_what_is_not_kept_apart(
    caplog, tmp_path: Path
) -> None:
    """Files for fast simulation have shapes on the feet only: an empty margin kept nothing."""
    links = ["trunk", "thigh", "calf", "foot"]
    turns = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    mass = f'<inertial><mass value="1"/>{turns}</inertial>'
    ball = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'
    parts = [f'<link name="{name}">{mass}{ball * (name == "foot")}</link>' for name in links]
    for one, other in pairwise(links):
        parts.append(
            f'<joint name="{other}_joint" type="revolute">'
            f'<parent link="{one}"/><child link="{other}"/>'
            '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="9" velocity="9"/></joint>'
        )
    text = f'<robot name="leg">{"".join(parts)}</robot>'
    robot = Robot.load(text, base="fixed")
    unseen = {"what 2 of 3 joints move (thigh_joint, calf_joint)": "no collision shapes"}
    assert SelfCollision(robot).unseen == unseen
    assert "is not kept apart: no collision shapes" in caplog.text
    path = tmp_path / "leg.urdf"
    path.write_text(text, encoding="utf-8")
    file = tmp_path / "leg.yaml"
    file.write_text(
        f"robot: {{model: {path}, base: fixed}}\nsupport: floating\n"
        "tasks: {posture: {type: posture}}\nconstraints: {bodies: {type: self_collision}}\n"
    )
    assert load_problem(file, {"stop.duration": 0.01}).run().provenance["unwatched_pairs"] == {
        "bodies": unseen
    }
