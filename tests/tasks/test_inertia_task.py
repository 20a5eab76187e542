"""What the inertia tasks mean: norms, masks, frames, normalisation, curvature, equal moments."""

import numpy as np
import pinocchio as pin
import pytest

from tests.standing import commanded
from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.robot import Robot
from wbc.spatial import vech_inverse
from wbc.tasks import InertiaTask, PrincipalInertiaTask
from wbc.tasks.principal_inertia import turning_ratios

H = 1e-5


def test_the_error_is_the_frobenius_norm(robot: Robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    target = here.inertia + np.diag([0.3, 0.2, 0.1]) + 0.05 * (np.ones((3, 3)) - np.eye(3))
    error = InertiaTask(robot, target).residual(here).error
    expected = np.linalg.norm(here.inertia - target, "fro")
    assert np.linalg.norm(error) == pytest.approx(expected, rel=1e-12)
    scaled = InertiaTask(robot, target, per_mass=True).residual(here).error
    np.testing.assert_allclose(scaled * robot.mass, error, rtol=1e-12)


def test_targets_in_every_accepted_form(robot: Robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    diagonal = ("xx", "yy", "zz")
    forms = [np.diag([1.0, 2, 3]), [1.0, 0, 0, 2, 0, 3], [1.0, 2, 3]]
    errors = [InertiaTask(robot, t, components=diagonal).residual(here).error for t in forms]
    np.testing.assert_array_equal(errors[0], errors[1])
    np.testing.assert_array_equal(errors[0], errors[2])
    trace = InertiaTask(robot, 6.0, components=("trace",)).residual(here).error
    assert trace[0] == pytest.approx(errors[0].sum(), rel=1e-9)
    assert trace[0] == pytest.approx(np.trace(here.inertia) - 6.0, rel=1e-9)
    InertiaTask(robot, np.zeros((3, 3)))  # as small as it can be


def test_principal_error_does_not_depend_on_orientation(robot: Robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    moments = np.linalg.eigvalsh(here.inertia)
    task = PrincipalInertiaTask(robot, moments + [0.1, 0.2, 0.3])
    error = task.residual(here).error
    assert np.linalg.norm(error) == pytest.approx(np.linalg.norm([0.1, 0.2, 0.3]), rel=1e-9)
    spin = np.zeros(robot.nv)
    spin[3:6] = [0.4, -1.0, 0.3]
    turned = robot.snapshot(robot.integrate(here.q, spin, 1.0))
    np.testing.assert_allclose(task.residual(turned).error, error, atol=1e-10 * moments.max())
    np.testing.assert_allclose(task.deviation(here, task.residual(here)), [-0.1, -0.2, -0.3])


def test_ratios_are_bounded_at_equal_moments() -> None:
    equal = np.array([1.0, 1.0, 2.0])
    # The wanted ones differ where the actual ones are equal: limited to 1, not infinite.
    ratios = turning_ratios(equal, np.array([0.5, 1.5, 2.0]))
    assert ratios[0, 1] == 1.0
    # Of a robot whose moments are a millionth of these they are the same.
    small = turning_ratios(1e-6 * equal, 1e-6 * np.array([0.5, 1.5, 2.0]))
    np.testing.assert_allclose(small, ratios, rtol=1e-9)
    # Equal wanted moments: the whole block is driven, off-diagonal entry included.
    assert (turning_ratios(equal, np.ones(3)) == 0.0).all()


def test_principal_moments_converge_to_equal_ones(hoap2) -> None:
    """The hard case for separate eigenvalues: two targets meet."""
    start = hoap2.posture("standing", {"left_shoulder_roll": 1.0, "right_shoulder_roll": -1.0})
    moments = np.linalg.eigvalsh(hoap2.snapshot(start).inertia)
    wanted = np.array([moments[0], moments[1:].mean(), moments[1:].mean()])
    task = PrincipalInertiaTask(hoap2, wanted, gain=0.3)
    controller = KinematicController(hoap2, [task], limits=Limits(hoap2), damping=1e-6)
    *_, (_, q) = commanded(controller, start, 800)
    reached = np.linalg.eigvalsh(hoap2.snapshot(q).inertia)
    np.testing.assert_allclose(reached, wanted, rtol=1e-6)


POINTS = ("com", "world", "frame", (0.4, -0.3, 0.8))


def point_of(robot: Robot, about):
    """A frame that many joints move, where any is meant."""
    return robot.frame_names[-1] if about == "frame" else about


@pytest.mark.parametrize("about", POINTS, ids=str)
@pytest.mark.parametrize("frame", ["base", "world"])
def test_curvature_is_the_hessian_gauss_newton_leaves_out(
    frame, about, robot: Robot, rng, random_snapshot
):
    """Oracle: differences of the cost's gradient by the joints, the base at rest."""
    here = random_snapshot(robot, rng)
    about = point_of(robot, about)
    target = here.inertia_in("world", about) + np.diag([0.5, -0.02, 0.3])
    task = InertiaTask(robot, target, frame=frame, about=about, weight=2.0, second_order=True)
    residual = task.residual(here)

    def gradient(step: np.ndarray) -> np.ndarray:
        r = task.residual(robot.snapshot(robot.integrate(here.q, step, 1.0)))
        return (4.0 * r.jacobian.T @ r.error)[6:]

    columns = [(gradient(H * e) - gradient(-H * e)) / (2 * H) for e in np.eye(robot.nv)[6:]]
    hessian = np.stack(columns, axis=1)
    gauss_newton = 4.0 * (residual.jacobian.T @ residual.jacobian)[6:, 6:]
    expected = hessian - gauss_newton
    # Second differences of a product of sums: 1e-6 of the largest entry.
    scale = max(1.0, np.abs(hessian).max())
    np.testing.assert_allclose(residual.curvature[6:, 6:], expected, atol=1e-6 * scale)


def test_frames_see_the_same_tensor(robot: Robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    for frame in ("base", robot.frame_names[-1]):
        R = here.rotation(frame)
        in_frame = InertiaTask(robot, np.eye(3), frame=frame).residual(here).error
        in_world = InertiaTask(robot, np.eye(3)).residual(here).error
        assert np.linalg.norm(in_frame) == pytest.approx(np.linalg.norm(in_world), rel=1e-9)
        np.testing.assert_allclose(R @ here.inertia_in(frame) @ R.T, here.inertia, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hoap2_like", "g1_27"])
@pytest.mark.parametrize("factors", [(3, 3, 3), (0.05, 0.05, 3), (3, 3, 0.05), (1.1, 1.1, 1.1)])
def test_targets_out_of_reach_do_not_make_it_chatter(name, factors, robot_named) -> None:
    """Plain settings: the command dies away, and its sign does not alternate."""
    robot = robot_named(name)
    q = robot.posture("standing")
    start = np.diag(robot.snapshot(q).inertia_in("base"))
    target = np.array(factors) * (start if factors[0] == factors[2] else start.max())
    task = InertiaTask(robot, target, components=("xx", "yy", "zz"), frame="base")
    controller = KinematicController(robot, [task], limits=Limits(robot))
    late = np.array([tick.velocity for tick, _ in commanded(controller, q, 1500)][-40:])
    assert np.abs(late).max() < 0.05  # wrists; without the damping up to 5 rad/s, for ever
    loud = np.abs(late).max(axis=0) > 1e-3
    alternating = (late[1:] * late[:-1] < 0).mean(axis=0)
    assert (alternating[loud] < 0.2).all()


@pytest.mark.parametrize(
    ("frame", "about"),
    [("base", "com"), ("world", "com"), ("base", "frame"), ("world", "frame"), ("world", "world")],
)
def test_the_damping_is_above_half_of_the_curvature_left_out(
    frame, about, robot: Robot, rng, random_snapshot
) -> None:
    """Oracle: second differences of <G, I>, of both orders where turns do not commute."""
    here = random_snapshot(robot, rng)
    about = point_of(robot, about)
    target = here.inertia_in("world", about) + np.diag([0.5, -0.02, 0.3])
    task = InertiaTask(robot, target, frame=frame, about=about, weight=2.0)
    residual = task.residual(here)
    G = 4.0 * (here.inertia_in(frame, about) - task_target(task))

    def value(step: np.ndarray) -> float:
        there = robot.snapshot(robot.integrate(here.q, step, 1.0))
        return float(np.sum(G * there.inertia_in(frame, about)))

    first = 0 if frame == "world" else 6  # the base moves no inertia in its own axes
    steps = 1e-4 * np.eye(robot.nv)[first:]
    count = len(steps)
    hessian = np.zeros((count, count))
    for i in range(count):
        for j in range(i + 1):
            a, b = steps[i], steps[j]
            second = value(a + b) - value(a - b) - value(b - a) + value(-a - b)
            hessian[i, j] = hessian[j, i] = second / (4.0 * 1e-4**2)
    expected = np.abs(hessian).sum(axis=0)
    found = residual.curvature_bound()
    assert isinstance(found, np.ndarray)
    # Second differences at 1e-4: rounding of 1e-16 / 1e-8 by the size, for each entry of a row.
    np.testing.assert_allclose(found[first:], expected, atol=1e-4 * expected.max())
    assert (found[:first] == 0.0).all()
    # The same rounding, where the base moves straight and nothing is curved.
    left = np.linalg.eigvalsh(np.diag(0.5 * task.gain * found[first:]) - 0.25 * hessian).min()
    assert left > -1e-7 * expected.max()


def task_target(task: InertiaTask) -> np.ndarray:
    return np.array(task.target)[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["floating", "double"])
@pytest.mark.parametrize("name", ["hoap2_like", "g1"])
@pytest.mark.parametrize("factors", [(3.0, 3.0, 3.0), (3.0, 3.0, 0.05), (0.3, 0.3, 0.3)])
def test_targets_out_of_reach_are_arrived_at_in_a_second(mode, name, factors, robot_named) -> None:
    """Within 1 % of what the error ends at; damped by one number it took up to half a minute."""
    robot = robot_named(name)
    q = robot.posture("standing")
    here = robot.snapshot(q)
    moments = np.diag(here.inertia_in("base"))
    base = moments if factors[0] == factors[2] else moments.max()
    frame = "base" if mode == "floating" else "world"
    task = InertiaTask(robot, np.diag(np.array(factors) * base), frame=frame)
    controller = KinematicController(
        robot, [task], contacts=support(here, mode), limits=Limits(robot), solver="daqp"
    )
    ticks = commanded(controller, q, 1000)
    norms = [float(np.linalg.norm(tick.errors["inertia"])) for tick, _ in ticks]
    assert min(norms) < 0.95 * norms[0]
    assert norms[200] < 1.01 * min(norms)


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("entry", [(0, 1), (0, 2), (1, 2)])
def test_a_target_is_symmetric_to_rounding_whatever_its_size(hoap2, size, entry) -> None:
    """Entries may differ by 1e-9 of the largest, which may stand anywhere."""
    for largest in ((0, 0), (1, 1), (2, 2), entry):
        target = size * np.diag([0.1, 0.2, 0.3])
        target[largest] = target[largest[::-1]] = -size if largest == entry else size
        for off, taken in ((0.9e-9, True), (1.1e-9, False)):
            given = target.copy()
            given[entry if off < 1e-9 else entry[::-1]] += off * size  # above, then below
            if taken:
                InertiaTask(hoap2, given)
                continue
            with pytest.raises(InvalidInputError, match="symmetric"):
                InertiaTask(hoap2, given)


def test_the_bound_on_curvature_in_axes_of_a_frame(robot: Robot, rng, random_snapshot) -> None:
    """Row sums of the Hessian in the base's axes, and |slope| tr(I) for the turn."""
    here = random_snapshot(robot, rng)
    target = vech_inverse(np.arange(1.0, 7.0))
    frame = robot.frame_names[2]
    weight = rng.uniform(0.5, 2.0, 6)
    task = InertiaTask(robot, target, frame=frame, weight=weight)
    residual = task.residual(here)
    slope = task.selection.T @ (weight**2 * residual.error)
    S = here.rotation(frame).T @ here.rotation("base")
    G = S.T @ vech_inverse(slope * [1, 0.5, 0.5, 1, 0.5, 1]) @ S
    rows = np.abs(here.base_inertia_hessian(G)).sum(axis=0)
    expected = rows + np.linalg.norm(slope) * np.trace(here.inertia)
    np.testing.assert_allclose(residual.curvature_bound(), expected, rtol=1e-9)


def test_about_a_point_a_robot_pulls_its_mass_in_and_a_foot_stands(hoap2) -> None:
    """A hoap2_like on one foot makes the inertia about that sole's origin what was asked."""
    q = hoap2.posture("standing")
    here = hoap2.snapshot(q)
    wanted = 0.93 * np.trace(here.inertia_in("world", "left_sole"))
    task = InertiaTask(hoap2, wanted, components=("trace",), about="left_sole", gain=0.1)
    controller = KinematicController(
        hoap2, [task], contacts=support(here, "left"), limits=Limits(hoap2), damping=1e-6
    )
    *_, (_, q) = commanded(controller, q, 300)
    # Oracle: sums over the links, of Pinocchio's placements.
    data = hoap2.model.createData()
    pin.forwardKinematics(hoap2.model, data, q)
    arms = [
        place.act(Y.lever) - here.position("left_sole")
        for place, Y in zip(data.oMi, hoap2.model.inertias, strict=True)
    ]
    reached = sum(
        np.trace(Y.inertia) + 2.0 * Y.mass * float(arm @ arm)
        for Y, arm in zip(hoap2.model.inertias, arms, strict=True)
    )
    # The sole is held to 1e-9 m or so.
    assert reached == pytest.approx(wanted, rel=1e-5)


def test_bad_points_are_named(hoap2) -> None:
    with pytest.raises(UnknownNameError, match="left_sloe"):
        InertiaTask(hoap2, np.eye(3), about="left_sloe")
    for about in ([0, 0], [0, 0, np.nan], None, 3.0):
        with pytest.raises(InvalidInputError, match="'inertia', about"):
            InertiaTask(hoap2, np.eye(3), about=about)
    assert InertiaTask(hoap2, np.eye(3), about=np.array([1, 2, 3])).about == (1.0, 2.0, 3.0)
