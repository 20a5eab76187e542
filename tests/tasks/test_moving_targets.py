"""Rate and drift of every task along a motion of the robot and of the target, by differences.

The oracle is the error alone, e(t) = residual(q(t)).error with the target put where it is at t: it
knows of no derivative. The robot moves as q(t) = q + v t + a t^2 / 2 on its manifold, so that v and
a are its velocity and acceleration at t = 0; so do rotations of targets. Second differences with
h = 1e-4 carry rounding of 1e-16 / h^2 = 1e-8 and h^2 = 1e-8 times the fourth derivative, some
thousands in places: 2e-5 relative.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.tasks.frames import some_frame
from wbc.robot import Robot, Snapshot
from wbc.rotations import exp_rotation
from wbc.tasks import (
    AxisTask,
    ComTask,
    DampingTask,
    DistanceTask,
    InertiaTask,
    MomentumTask,
    OrientationTask,
    PoseTask,
    PositionTask,
    PostureTask,
    PrincipalInertiaTask,
    RelativePoseTask,
    Task,
)

H = 1e-4


class Moving(NamedTuple):
    """A task, its target at time t as arguments of ``set_target``, and how that moves at t = 0."""

    task: Task
    target: Callable[[float], tuple[Any, ...]]
    rate: Any
    acceleration: Any


def straight(start: Any, rng: np.random.Generator, size: float = 1.0) -> tuple[Any, ...]:
    """Return x(t) = start + r t + a t^2 / 2, r and a."""
    rate, acceleration = size * rng.normal(size=(2, *np.shape(start)))
    return (lambda t: start + t * rate + 0.5 * t * t * acceleration), rate, acceleration


def turning(start: np.ndarray, rng: np.random.Generator) -> tuple[Any, ...]:
    """Return R(t) = start exp(w t + a t^2 / 2), w and a, both turned into the axes R maps to."""
    w, alpha = rng.normal(size=(2, 3))

    def rotation(t: float) -> np.ndarray:
        return start @ exp_rotation(t * w + 0.5 * t * t * alpha)

    return rotation, start @ w, start @ alpha


def vector(task: Task, start: Any, rng: np.random.Generator, size: float = 1.0) -> Moving:
    path, rate, acceleration = straight(np.asarray(start, float), rng, size)
    return Moving(task, lambda t: (path(t),), rate, acceleration)


def symmetric(task: Task, start: np.ndarray, rng: np.random.Generator) -> Moving:
    parts = rng.normal(size=(2, 3, 3))
    rate, acceleration = parts + parts.transpose(0, 2, 1)
    return Moving(
        task, lambda t: (start + t * rate + 0.5 * t * t * acceleration,), rate, acceleration
    )


def rotating(task: Task, start: np.ndarray, rng: np.random.Generator) -> Moving:
    rotation, w, alpha = turning(start, rng)
    return Moving(task, lambda t: (rotation(t),), w, alpha)


def placed(task: Task, rotation: np.ndarray, rng: np.random.Generator) -> Moving:
    place, rate, acceleration = straight(np.array([0.2, 0.1, -0.3]), rng)
    turned, w, alpha = turning(rotation, rng)
    return Moving(
        task,
        lambda t: (place(t), turned(t)),
        np.concatenate((rate, w)),
        np.concatenate((acceleration, alpha)),
    )


def posture(r: Robot, s: Snapshot, g: np.random.Generator) -> Moving:
    rate, acceleration = g.normal(size=(2, r.nv))

    def configuration(t: float) -> tuple[np.ndarray]:
        step = t * rate + 0.5 * t * t * acceleration
        return (r.integrate(r.postures["neutral"], step, 1.0),)

    task = PostureTask(r, r.postures["neutral"], joints={r.joint_names[0]: 0.0})
    return Moving(task, configuration, rate, acceleration)


def pose(r: Robot, s: Snapshot, f: str, g: np.random.Generator) -> Moving:
    R = near(s.rotation(f))
    return placed(PoseTask(r, f, np.zeros(3), R), R, g)


def relative(
    r: Robot, s: Snapshot, f: str, g: np.random.Generator, components: Any = None
) -> Moving:
    R = near(s.rotation("base").T @ s.rotation(f))
    chosen = {} if components is None else {"components": components}
    return placed(RelativePoseTask(r, f, "base", np.zeros(3), R, **chosen), R, g)


def principal(r: Robot, s: Snapshot, f: str, g: np.random.Generator) -> Moving:
    moments = np.linalg.eigvalsh(s.inertia)
    wanted = moments.mean() + 0.5 * (moments - moments.mean())  # closer together: no limit acts
    task = PrincipalInertiaTask(r, wanted, per_mass=True)
    return vector(task, wanted, g, 0.1 * float(moments.max()))


def near(R: np.ndarray) -> np.ndarray:
    return R @ exp_rotation(np.array([0.4, -0.7, 0.5]))


MAKERS: dict[str, Callable[[Robot, Snapshot, str, np.random.Generator], Moving]] = {
    "com": lambda r, s, f, g: vector(ComTask(r, s.com, axes=("z", "x")), s.com, g),
    "position": lambda r, s, f, g: vector(PositionTask(r, f, [0, 0, 0]), [0.5, -0.2, 0.3], g),
    "orientation": lambda r, s, f, g: rotating(
        OrientationTask(r, f, np.eye(3)), near(s.rotation(f)), g
    ),
    "pose": pose,
    "axis": lambda r, s, f, g: vector(
        AxisTask(r, f, [0, 0, 1], axis=[1, 1, 0]), [0.9, -1.5, 3.0], g
    ),
    "relative pose": relative,
    "relative pose mask": lambda r, s, f, g: relative(r, s, f, g, ("rz", "x")),
    "distance": lambda r, s, f, g: vector(DistanceTask(r, f, "base", 0.3), 0.4, g),
    "posture": lambda r, s, f, g: posture(r, s, g),
    "inertia": lambda r, s, f, g: symmetric(InertiaTask(r, s.inertia), 1.3 * s.inertia, g),
    "inertia of a frame": lambda r, s, f, g: symmetric(
        InertiaTask(r, s.inertia, frame=f, components=("xz", "yy")), s.inertia, g
    ),
    "inertia trace": lambda r, s, f, g: vector(
        InertiaTask(r, 4.0, components=("trace",), per_mass=True), 4.0, g
    ),
    **{
        f"inertia, {name}": lambda r, s, f, g, axes=axes, about=about, given=given: symmetric(
            InertiaTask(
                r, s.inertia, frame=f if axes == "f" else axes, about=f if about == "f" else about,
                **given,
            ),
            0.8 * s.inertia,
            g,
        )
        for name, (axes, about, given) in {
            "base": ("base", "com", {}),
            "frame, per mass": ("f", "com", {"per_mass": True}),
            "diagonal": ("base", "com", {"components": ("xx", "yy", "zz")}),
            "about world": ("world", "world", {}),
            "about a point": ("base", [0.3, -0.8, 0.1], {"per_mass": True}),
            "about base": ("base", "base", {}),
            "about a frame": ("world", "f", {"components": ("xz", "yy", "zz")}),
            "about a frame, in its axes": ("f", "f", {}),
        }.items()
    },
    "inertia trace about a frame": lambda r, s, f, g: vector(
        InertiaTask(r, 4.0, components=("trace",), about=f), 4.0, g
    ),
    "orientation at target": lambda r, s, f, g: rotating(
        OrientationTask(r, f, np.eye(3)), s.rotation(f), g
    ),
    "base relative to a frame": lambda r, s, f, g: placed(
        RelativePoseTask(r, "base", f, np.zeros(3), np.eye(3), components=("z", "x")),
        near(s.rotation(f).T @ s.rotation("base")),
        g,
    ),
    "principal inertia": principal,
}  # fmt: skip


def assert_close(actual: np.ndarray, expected: np.ndarray, relative: float) -> None:
    scale = max(1.0, float(np.abs(expected).max()))
    np.testing.assert_allclose(actual, expected, rtol=0, atol=relative * scale)


@pytest.mark.parametrize("maker", MAKERS.values(), ids=MAKERS)
def test_rate_and_drift_of_a_moving_target(maker, robot, rng, random_snapshot) -> None:
    for _ in range(2):
        here = random_snapshot(robot, rng)
        a = rng.normal(size=robot.nv)
        moving = maker(robot, here, some_frame(robot), rng)
        task = moving.task

        def error(t: float, moving: Moving = moving, here: Snapshot = here, a=a) -> np.ndarray:
            moving.task.set_target(*moving.target(t))
            step = t * here.v + 0.5 * t * t * a
            return moving.task.residual(robot.snapshot(robot.integrate(here.q, step, 1.0))).error

        behind, middle, ahead = error(-H), error(0.0), error(H)
        task.set_target(*moving.target(0.0), moving.rate, moving.acceleration)
        residual = task.residual(here)
        assert_close(residual.rate(here.v), (ahead - behind) / (2 * H), 2e-6)
        second = (ahead - 2.0 * middle + behind) / H**2
        assert_close(residual.jacobian @ a + task.drift(here), second, 2e-5)
        task.set_target(*moving.target(0.0), moving.rate)  # the acceleration is no part of the rate
        assert_close(task.residual(here).rate(here.v), residual.rate(here.v), 1e-12)


def test_momentum_whose_target_moves(robot: Robot, rng, random_snapshot) -> None:
    """Its error's rate is h - h*: first differences of that along the motion are e''."""
    here, a = random_snapshot(robot, rng), rng.normal(size=robot.nv)
    h, force = rng.normal(size=(2, 6))
    task = MomentumTask(robot, components=("kz", "lx", "ly"))

    def rate(t: float) -> np.ndarray:
        task.set_target(h + t * force)
        step = t * here.v + 0.5 * t * t * a
        there = robot.snapshot(robot.integrate(here.q, step, 1.0), here.v + t * a)
        return task.deviation(there, task.residual(there))

    second = (rate(H) - rate(-H)) / (2 * H)
    task.set_target(h, force)
    residual = task.residual(here)
    np.testing.assert_allclose(residual.rate(here.v), rate(0.0), atol=1e-10)
    task.set_target(h, force)
    assert_close(residual.jacobian @ a + task.drift(here), second, 2e-5)


def test_damping_is_about_the_velocity_itself(robot: Robot, rng, random_snapshot) -> None:
    here, a = random_snapshot(robot, rng), rng.normal(size=robot.nv)
    task = DampingTask(robot, joints={robot.joint_names[0]: 0.0})
    residual = task.residual(here)
    kept = np.arange(robot.nv) != 6
    np.testing.assert_array_equal(residual.rate(here.v), here.v[kept])
    np.testing.assert_array_equal(residual.jacobian @ a + task.drift(here), a[kept])
    np.testing.assert_array_equal(task.deviation(here, residual), here.v[kept])
    assert task.units == ("m/s or rad/s",) * (robot.nv - 1)


def test_either_motion_of_a_target_may_be_given_alone(hoap2) -> None:
    """From rest, where the other one stays as it is; and to rest again."""
    task, rate, push = ComTask(hoap2, [0.0, 0.0, 0.3]), np.ones(3), np.full(3, 2.0)
    for given in ((rate, None), (None, None), (None, push), (rate, push), (None, push)):
        task.set_target([0.0, 0.0, 0.4], *given)
        wanted = [np.zeros(3) if one is None else one for one in given]
        np.testing.assert_array_equal(task.target_rate, wanted[0])
        np.testing.assert_array_equal(task.target_acceleration, wanted[1])


@pytest.mark.parametrize("maker", MAKERS.values(), ids=MAKERS)
def test_a_target_that_is_assigned_is_at_rest(maker, hoap2, rng, random_snapshot) -> None:
    here = random_snapshot(hoap2, rng)
    moving = maker(hoap2, here, some_frame(hoap2), rng)
    task = moving.task
    task.set_target(*moving.target(0.0))
    still, drift = task.residual(here), task.drift(here)
    task.set_target(*moving.target(0.0), moving.rate, moving.acceleration)
    assert np.abs(task.residual(here).bias - still.bias).max() > 1e-3
    assert np.abs(task.drift(here) - drift).max() > 1e-3
    task.target = task.target  # type: ignore[misc]
    np.testing.assert_allclose(task.residual(here).error, still.error, atol=1e-14)
    np.testing.assert_array_equal(task.residual(here).bias, 0.0)
    np.testing.assert_allclose(task.drift(here), drift, atol=1e-12)


def test_the_axes_of_equal_moments_ask_for_no_boundless_acceleration(robot_named, rng) -> None:
    """Wanted moments further apart than the actual ones: N turns no faster than is followed."""
    from wbc.tasks.principal_inertia import eigenvector_spin

    wanted = np.array([0.5, 1.0, 1.5])
    A, B = rng.normal(size=(2, 3, 3))
    for gap in (1e-3, 1e-6, 1e-12, 0.0):
        moments = np.array([1.0, 1.0 + gap, 1.0 + 2.0 * gap])
        spin, spin_rate = eigenvector_spin(moments, A + A.T, B + B.T, wanted)
        assert np.abs(spin).max() < 2.0 * np.abs(A).max() / 0.5
        assert np.abs(spin_rate).max() < 200.0


def test_the_axes_of_moments_that_are_equal_to_rounding_do_not_turn(rng) -> None:
    """Of the largest moment 1e-9 and less are none: between those two axes nothing is asked."""
    from wbc.tasks.principal_inertia import eigenvector_spin

    A, B = rng.normal(size=(2, 3, 3))
    for apart, still in ((0.9e-9, True), (1.1e-9, False)):
        moments = np.array([1e-3, 1.0 - apart, 1.0])
        for turn in eigenvector_spin(moments, A + A.T, B + B.T, moments):
            assert (turn[1, 2] == 0.0) == still and (np.diag(turn) == 0.0).all()
            assert turn[0, 1] != 0.0


@pytest.mark.parametrize("unit", [1e-7, 1e7])
def test_how_axes_turn_does_not_depend_on_the_unit_of_inertia(rng, unit: float) -> None:
    from wbc.tasks.principal_inertia import eigenvector_spin

    A, B = rng.normal(size=(2, 3, 3))
    moments, wanted = np.array([1.0, 1.0 + 1e-5, 1.5]), np.array([1.0, 1.0 + 2e-6, 1.2])
    quantities = moments, A + A.T, B + B.T, wanted
    plain, scaled = eigenvector_spin(*quantities), eigenvector_spin(*(unit * x for x in quantities))
    assert np.abs(plain[0]).max() > 1e4  # the near ones count as different
    for one, other in zip(plain, scaled, strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-8)


def test_ill_formed_motions_are_refused_and_change_nothing(hoap2) -> None:
    from wbc.errors import InvalidInputError

    pose = PoseTask(hoap2, "left_palm", [0, 0, 0], np.eye(3))
    pose.set_target([0, 0, 0], np.eye(3), np.ones(6), np.ones(6))
    for arguments, told in (
        (([1, 1, 1], np.eye(3), [0, 0, 1]), "target rate"),
        (([1, 1, 1], np.eye(3), np.ones(6), [np.nan] * 6), "target acceleration"),
    ):
        with pytest.raises(InvalidInputError, match=f"left_palm pose.*{told}"):
            pose.set_target(*arguments)
    np.testing.assert_array_equal(pose.position, 0.0)
    np.testing.assert_array_equal(pose.target_rate, 1.0)
    with pytest.raises(InvalidInputError, match=r"target: .*\(4, 4\)"):
        pose.target = np.eye(3)
    with pytest.raises(InvalidInputError, match="0 0 0 1"):
        pose.target = np.ones((4, 4))
