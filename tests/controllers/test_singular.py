"""Singular tasks: singular values and damped rates against numpy's SVD, joint speeds, no jumps."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import null_space

from wbc.constraints import Limits, support
from wbc.controllers import KinematicController, Tick
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, MomentumTask, PoseTask, PositionTask, PostureTask, Task

Load = Callable[[str], Robot]
# Pitch joints of the legs (hip, knee, ankle), an elbow and its hand, and where the arm is straight.
KNEES = {
    "g1_27": ("*_hip_pitch_joint", "*_knee_joint", "*_ankle_pitch_joint"),
    "talos": ("leg_*_3_joint", "leg_*_4_joint", "leg_*_5_joint"),
}
ARMS = {
    "g1_27": ("left_elbow_joint", "left_wrist_yaw_link", (0.6, 1.5)),
    "talos": ("arm_left_4_joint", "arm_left_7_link", (-0.8, -0.05)),
}


def bent(robot: Robot, name: str, knee: float) -> Snapshot:
    """Both legs bent by ``knee``, soles flat."""
    hips, knees, ankles = KNEES[name]
    q = robot.posture("neutral", {hips: -knee / 2, knees: knee, ankles: -knee / 2})
    return robot.snapshot(q, np.zeros(robot.nv))


def up(robot: Robot, here: Snapshot, **law: float) -> list[Task]:
    """The CoM is to rise at 1 m/s from where it is.

    An error would bring the damping by curvature that tasks of points have anyway.
    """
    task = ComTask(robot, here.com, weight=10.0, **law)
    task.set_target(here.com, [0.0, 0.0, 1.0])
    return [task]


def held(here: Snapshot, *sides: str) -> np.ndarray:
    return np.concatenate([here.jacobian(f"{side}_sole") for side in sides or ("left", "right")])


@pytest.mark.parametrize("mode", ["left", "double"])
@pytest.mark.parametrize("name", KNEES)
def test_singular_values_are_those_of_the_motions_that_contacts_leave(
    name: str, mode: str, robot_named: Load, rng
) -> None:
    robot = robot_named(name)
    weights = np.exp(rng.normal(size=robot.nv))
    here = bent(robot, name, 0.1)
    sides = ("left", "right") if mode == "double" else (mode,)
    for metric in (np.ones(robot.nv), weights):
        controller = KinematicController(
            robot,
            [
                *up(robot, here, singular_threshold=0.05),
                MomentumTask(robot, singular_threshold=1.0),
            ],
            contacts=support(here, mode),
            joint_weights=metric,
        )
        found = controller.step(here).singular
        root = np.sqrt(metric)
        free = null_space(held(here, *sides) / root)
        for task, J in (("com", here.com_jacobian), ("momentum", here.centroidal_map)):
            motions = free @ np.linalg.pinv(J / root @ free) / root[:, None]  # one for each rate
            values = 1.0 / np.linalg.svd(motions, compute_uv=False)[::-1]
            # Squares are taken on the way: 1e-16 of the largest, relative to the least.
            assert found[task].least == pytest.approx(values[-1], rel=1e-9)
            assert found[task].condition == pytest.approx(values[0] / values[-1], rel=1e-9)
            least = 0.05 if task == "com" else 1.0
            assert found[task].rank == np.count_nonzero(values >= least)


WEIGHTINGS = ({"*": 10.0, "base": 10.0}, {"*": 0.01, "base": 0.01}, {"base": 100.0}, {"*": 1e3})


@pytest.mark.parametrize("weights", WEIGHTINGS, ids=str)
@pytest.mark.parametrize("name", KNEES)
def test_joint_weights_do_not_move_the_threshold(name, weights, robot_named) -> None:
    """Thresholds are in rad/s whatever the joints weigh, as long as the motion is much the same."""
    robot, least = robot_named(name), 0.08

    def fastest(knee: float) -> tuple[float, float]:
        here = bent(robot, name, knee)
        controller = KinematicController(
            robot,
            up(robot, here, singular_threshold=least),
            contacts=support(here, "double"),
            joint_weights=weights,
            damping=1e-9,
        )
        tick = controller.step(here)
        return speed(tick), float((here.com_jacobian @ tick.velocity)[2])

    assert fastest(1.4)[1] == pytest.approx(1.0, abs=1e-3), "far away nothing is withheld"
    for knee in (0.6, 0.3, 0.1, 0.03, 0.01, 0.001):
        assert fastest(knee)[0] < 1.0 / least


@pytest.mark.parametrize("knee", [0.5, 0.1, 0.01, 0.0])
@pytest.mark.parametrize("name", KNEES)
def test_a_task_gets_the_rates_of_damped_least_squares(name, knee, robot_named) -> None:
    """Oracle: sum of v s / max(s, threshold)^2 u' wanted over the singular values s.

    But for the QP's own damping, here so large that the solver's accuracy does not matter.
    """
    robot, threshold, damping = robot_named(name), 0.05, 1e-4
    here = bent(robot, name, knee)
    tick = KinematicController(
        robot,
        up(robot, here, singular_threshold=threshold),
        contacts=support(here, "double"),
        damping=damping,
    ).step(here)
    free = null_space(held(here))
    U, s, Vt = np.linalg.svd(here.com_jacobian @ free, full_matrices=False)
    wanted = np.array([0.0, 0.0, 1.0])
    kept = 1.0 / (1.0 + damping / (10.0 * s) ** 2)  # 10 is the task's weight
    expected = free @ Vt.T @ (kept * s / np.maximum(s, threshold) ** 2 * (U.T @ wanted))
    # The solver's accuracy of 1e-9 in the slope, over the damping.
    np.testing.assert_allclose(tick.velocity, expected, atol=1e-5)
    lost = tick.singular["com"].rate_reduction
    if s[-1] >= threshold:
        assert lost is None
    else:
        np.testing.assert_allclose(
            lost, wanted - U @ (np.minimum(1.0, s / threshold) ** 2 * (U.T @ wanted)), atol=1e-9
        )


def speed(tick: Tick) -> float:
    assert tick.ok, tick.report()
    return float(np.abs(tick.velocity[6:]).max())


def reaching(robot: Robot, name: str, angle: float, least: float) -> tuple[Snapshot, list[Task]]:
    """The trunk stays where it is, and the hand is to go on, at 1 m/s away from the elbow."""
    elbow, hand, _ = ARMS[name]
    here = robot.snapshot(robot.posture("standing", {elbow: angle}), np.zeros(robot.nv))
    away = here.position(hand) - here.position(elbow)
    reach = PositionTask(
        robot, hand, (0.0, 0.0, 0.0), name="hand", priority=1, weight=3.0, singular_threshold=least
    )
    reach.set_target(here.position(hand), away / np.linalg.norm(away))
    return here, [
        PoseTask(robot, "base", here.position("base"), here.rotation("base")),
        PostureTask(robot, here.q, joints={"*": 0.0, **dict.fromkeys(trunk(robot), 1.0)}),
        reach,
    ]


def trunk(robot: Robot) -> list[str]:
    return [name for name in robot.joint_names if name.startswith(("waist", "torso"))]


@pytest.mark.parametrize("name", ARMS)
def test_a_straight_arm_below_a_trunk_that_stays(name: str, robot_named: Load) -> None:
    """Singular because of the level above; oracle: SVD in what contacts and that level leave."""
    robot, threshold = robot_named(name), 0.1
    _, hand, (first, last) = ARMS[name]
    speeds = {0.0: [], threshold: []}
    for angle in np.linspace(first, last, 30):
        for least, fastest in speeds.items():
            here, tasks = reaching(robot, name, angle, least)
            tick = KinematicController(robot, tasks, contacts=support(here, "double")).step(here)
            fastest.append(speed(tick))
        base = here.jacobian("base")
        joints = np.eye(robot.nv)[[6 + robot.joint_names.index(joint) for joint in trunk(robot)]]
        free = null_space(np.concatenate((held(here), base, joints)))
        values = np.linalg.svd(here.jacobian(hand)[:3] @ free, compute_uv=False)
        assert tick.singular["hand"].least == pytest.approx(values[-1], rel=1e-6, abs=1e-8)
    assert max(speeds[0.0]) > 40.0
    assert max(speeds[threshold]) < 1.0 / threshold


@pytest.mark.slow
@pytest.mark.parametrize("name", KNEES)
def test_nothing_jumps_on_the_way_into_a_singularity(name: str, robot_named: Load) -> None:
    """Across the threshold and to straight knees: halving the steps halves what the command does.

    Three tasks that share the threshold's matrix unevenly, so that their singular values mix.
    """
    robot = robot_named(name)

    def commands(count: int) -> np.ndarray:
        out = []
        for knee in np.linspace(0.8, 0.0, count):
            here = bent(robot, name, knee)
            tasks = [
                *up(robot, here, singular_threshold=0.08),
                PoseTask(
                    robot,
                    "base",
                    here.position("base") + [0, 0, 0.005],
                    here.rotation("base"),
                    weight=3.0,
                    singular_threshold=0.03,
                ),
                PostureTask(robot, here.q, weight=0.1),
            ]
            controller = KinematicController(robot, tasks, contacts=support(here, "double"))
            tick = controller.step(here)
            assert tick.ok
            out.append(tick.velocity)
        return np.array(out)

    coarse, fine = commands(81), commands(321)
    steps = [np.abs(np.diff(v, axis=0)).max() for v in (coarse, fine)]
    # A jump would be the same in both; a quarter of the step, with some curvature to spare.
    assert steps[1] < 0.4 * steps[0]


@pytest.mark.parametrize("name", KNEES)
def test_away_from_singularities_nothing_changes(name: str, robot_named: Load) -> None:
    robot = robot_named(name)
    here = bent(robot, name, 0.9)
    ticks = []
    for least in (0.0, 0.02):
        hand = ARMS[name][1]
        tasks = [
            *up(robot, here, singular_threshold=least),
            PositionTask(robot, hand, here.position(hand) + 0.01, singular_threshold=least),
            PostureTask(robot, here.q, weight=0.01),
        ]
        controller = KinematicController(
            robot, tasks, contacts=support(here, "double"), limits=Limits(robot)
        )
        ticks.append(controller.step(here))
    without, with_threshold = ticks
    assert without.singular == {}
    assert [one.rate_reduction for one in with_threshold.singular.values()] == [None, None]
    np.testing.assert_allclose(with_threshold.velocity, without.velocity, atol=1e-9, rtol=0)


@pytest.mark.parametrize("name", KNEES)
def test_contacts_that_may_give_way_count_as_held(name: str, robot_named: Load) -> None:
    robot = robot_named(name)
    here = bent(robot, name, 0.02)
    contacts = support(here, "double")
    slack = {contact.frame: 1e5 for contact in contacts}
    hard, soft = (
        KinematicController(
            robot, up(robot, here, singular_threshold=0.08), contacts=contacts, slack=slack
        ).step(here)
        for slack in ({}, slack)
    )
    assert soft.singular["com"].least == pytest.approx(hard.singular["com"].least, rel=1e-9)
    np.testing.assert_allclose(
        soft.singular["com"].rate_reduction, hard.singular["com"].rate_reduction
    )
    assert speed(soft) < 1.0 / 0.08


def test_the_pseudo_inverse_holds_back_too(g1_27: Robot) -> None:
    here = bent(g1_27, "g1_27", 0.02)
    without, with_threshold = (
        KinematicController(
            g1_27, up(g1_27, here, singular_threshold=least), contacts=support(here, "double"),
            damping=1e-6, solver="pseudo_inverse",
        ).step(here)
        for least in (0.0, 0.08)
    )  # fmt: skip
    assert speed(without) > 25.0
    assert speed(with_threshold) < 1.0 / 0.08


def test_the_motion_is_not_damped(g1_27: Robot) -> None:
    """A direction in which the task can do nothing is as free for others as without a threshold."""
    here = bent(g1_27, "g1_27", 0.0)
    costs = [
        KinematicController(
            g1_27, up(g1_27, here, singular_threshold=least), contacts=support(here, "double")
        )
        .step(here)
        .qp.P
        for least in (0.0, 0.08)
    ]
    np.testing.assert_allclose(*costs, rtol=0.0, atol=1e-12)  # of two paths


@pytest.mark.parametrize("name", KNEES)
def test_a_com_led_above_its_reach_comes_to_rest(name: str, robot_named: Load) -> None:
    """Closed loop, 10 cm up at 0.2 m/s: the knees straighten, and nothing races or swings."""
    robot = robot_named(name)
    start = bent(robot, name, 0.6)

    def fastest(least: float) -> tuple[float, float]:
        q, speeds = start.q, []
        com = ComTask(robot, start.com, weight=10.0, gain=0.1, singular_threshold=least)
        controller = KinematicController(robot, [com], contacts=support(start, "double"))
        for k in range(600):
            height = min(0.1, 0.2 * k * controller.dt)
            com.set_target(start.com + [0, 0, height], [0, 0, 0.2 if height < 0.1 else 0.0])
            tick = controller.step(robot.snapshot(q))
            speeds.append(speed(tick))
            q = robot.integrate(q, tick.velocity, controller.dt)
        return max(speeds), max(speeds[-100:])

    assert fastest(0.0)[0] > 6.0
    most, at_last = fastest(0.08)
    assert most < 1.5
    assert at_last < 0.5


def test_rows_without_weight_and_faint_tasks(g1_27: Robot) -> None:
    """Weights of 0 are left out; a phase's faintest weight beside a heavy one gives numbers."""
    here = bent(g1_27, "g1_27", 0.02)
    wanted = here.com + [0.01, 0, 0.01]
    sideways = ComTask(g1_27, wanted, weight=[10.0, 10.0, 0.0], singular_threshold=0.08)
    base = PoseTask(
        g1_27, "base", here.position("base"), here.rotation("base"), singular_threshold=0.08
    )
    controller = KinematicController(g1_27, [sideways, base], contacts=support(here, "double"))
    base.weight = 0.0
    tick = controller.step(here)
    assert tick.singular.keys() == {"com"}
    assert tick.singular["com"].rank == 2
    assert tick.singular["com"].rate_reduction is None
    sideways.set_target(here.com, [1, 0, 1])
    sideways.weight = [0.0, 10.0, 10.0]
    tick = KinematicController(g1_27, [sideways], contacts=support(here, "double")).step(here)
    assert tick.singular["com"].rate_reduction[0] == 0.0
    assert tick.singular["com"].rate_reduction[2] > 0.9
    for faint in (1e-3, 1e-6, 1e-9):
        base.weight, sideways.weight = faint, 10.0
        tick = KinematicController(g1_27, [sideways, base], contacts=support(here, "double")).step(
            here
        )
        assert speed(tick) < np.sqrt(2.0) / 0.08
        assert tick.singular["com"].rate_reduction @ [0, 0, 1] == pytest.approx(1.0, abs=0.1)
