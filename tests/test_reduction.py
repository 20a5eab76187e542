"""The reduction to a reaction mass pendulum against Newton-Euler, definitions and differences."""

import numpy as np
import pinocchio as pin
import pytest

import wbc
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.rmp.axes import track
from wbc.rmp.ground import leg_of
from wbc.robot import Robot, Snapshot

FEET = ("left", "right")


@pytest.fixture(params=("hoap2_like", "g1"))
def humanoid(request: pytest.FixtureRequest, robot_named) -> Robot:
    return robot_named(request.param)


def standing(robot: Robot, v: np.ndarray | None = None) -> Snapshot:
    return robot.snapshot(robot.posture("standing"), v)


def base_wrench(here: Snapshot, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What must push at the base's origin, world axes, by Newton-Euler from link to link."""
    model = here.robot.model
    wrench = pin.rnea(model, model.createData(), here.q, here.v, a)[:6]
    R = here.rotation("base")
    return here.position("base"), np.concatenate((R @ wrench[:3], R @ wrench[3:]))


def gentle(robot: Robot, rng: np.random.Generator, random_snapshot) -> tuple[Snapshot, np.ndarray]:
    """A random state and acceleration in which the ground is pushed."""
    there = random_snapshot(robot, rng)
    return robot.snapshot(there.q, 0.3 * there.v), rng.normal(size=robot.nv)


@pytest.mark.parametrize("height", [0.0, -3.0])
def test_newton_euler_moved_to_the_cop_has_no_horizontal_moment(
    robot: Robot, rng: np.random.Generator, random_snapshot, height: float
) -> None:
    for _ in range(5):
        here, a = gentle(robot, rng, random_snapshot)
        state = wbc.reduce(here, a, ground_height=height)
        p, wrench = base_wrench(here, a)
        assert state.cop is not None and state.cop[2] == height
        moment = wrench[3:] + np.cross(p - state.cop, wrench[:3])
        # Rounding of forces of M g at arms of some metres.
        size = 9.81 * robot.mass * 10.0
        np.testing.assert_allclose(moment[:2], 0.0, rtol=0, atol=1e-12 * size)
        np.testing.assert_allclose(moment[2], state.ground_moment, rtol=0, atol=1e-12 * size)
        np.testing.assert_allclose(state.ground_force, wrench[:3], rtol=0, atol=1e-12 * size)


def test_measured_wrenches_give_what_the_acceleration_gives(robot, rng, random_snapshot) -> None:
    here, a = gentle(robot, rng, random_snapshot)
    expected, found = wbc.reduce(here, a), wbc.reduce(here, wrenches=[base_wrench(here, a)])
    for name in ("ground_force", "momentum_rate", "cop", "cmp", "leg_direction"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(expected, name), rtol=1e-9, atol=1e-10 * robot.mass
        )
    assert found.ground_moment == pytest.approx(expected.ground_moment, abs=1e-9 * robot.mass)
    assert not found.quasi_static and not expected.quasi_static


def test_momentum_rate_is_the_moment_about_the_com(humanoid: Robot, rng) -> None:
    """k'_c = (p - c) x f_r + m_r n and f_r = M (c'' - g), with c'' and k'_c by differences."""
    v, a = 0.3 * rng.normal(size=humanoid.nv), rng.normal(size=humanoid.nv)
    here, h = standing(humanoid, v), 1e-5
    state = wbc.reduce(here, a)
    ahead, behind = (
        humanoid.snapshot(humanoid.integrate(here.q, v + 0.5 * s * a, s), v + s * a)
        for s in (h, -h)
    )
    rate = (ahead.momentum - behind.momentum) / (2.0 * h)
    force = rate[:3] + (0.0, 0.0, 9.81 * humanoid.mass)
    # Central differences lose h^2 and rounding over h: about 1e-9 of forces of M g.
    np.testing.assert_allclose(state.ground_force, force, rtol=0, atol=1e-6)
    moment = np.cross(state.cop - state.com, state.ground_force) + (0, 0, state.ground_moment)
    np.testing.assert_allclose(moment, rate[3:], rtol=0, atol=1e-6)
    np.testing.assert_allclose(state.momentum_rate, rate, rtol=0, atol=1e-6)


def test_standing_still_the_cop_is_below_the_com(humanoid: Robot) -> None:
    here = standing(humanoid)
    for state in (wbc.reduce(here, feet=FEET), wbc.reduce(here, np.zeros(humanoid.nv), feet=FEET)):
        np.testing.assert_allclose(state.cop, [*here.com[:2], 0.0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.cmp, state.cop, rtol=0, atol=1e-12)
        assert state.cop_inside and state.cop_margin > 0.01
        assert state.leg_length == pytest.approx(here.com[2], rel=1e-12)
        np.testing.assert_allclose(state.leg_angles, [np.pi / 2, 0.0], rtol=0, atol=1e-11)
        np.testing.assert_allclose(state.ground_force, [0, 0, 9.81 * humanoid.mass], atol=1e-10)


def test_quasi_static_leaves_out_the_velocity_too(humanoid: Robot, rng) -> None:
    here = standing(humanoid, rng.normal(size=humanoid.nv))
    state = wbc.reduce(here)
    assert state.quasi_static and not state.momentum_rate.any()
    np.testing.assert_allclose(state.cop[:2], here.com[:2], rtol=0, atol=1e-12)
    exact = wbc.reduce(here, np.zeros(humanoid.nv))
    assert not exact.quasi_static and np.linalg.norm(exact.momentum_rate) > 0.01


def test_corner_forces_of_both_soles(humanoid: Robot, rng: np.random.Generator) -> None:
    """The CoP is the mean of the corners weighted by their normal forces, inside their hull."""
    here = standing(humanoid)
    corners = np.concatenate(
        [
            np.column_stack((f.polygon, np.zeros(len(f.polygon)))) @ here.rotation(f.frame).T
            + here.position(f.frame)
            for f in humanoid.feet.values()
        ]
    )
    corners[:, 2] = 0.0
    forces = rng.normal(size=corners.shape)
    forces[:, 2] = rng.uniform(5.0, 50.0, len(corners))
    wrenches = [(p, [*f, 0.0, 0.0, 0.0]) for p, f in zip(corners, forces, strict=True)]
    state = wbc.reduce(here, wrenches=wrenches, feet=FEET)
    weighted = forces[:, 2] @ corners / forces[:, 2].sum()
    np.testing.assert_allclose(state.cop, weighted, rtol=0, atol=1e-12)
    assert state.cop_inside
    # Weight on one corner alone: the CoP is that corner, on the rim if it is a corner of the hull.
    for p in corners:
        alone = wbc.reduce(here, wrenches=[(p, [0, 0, 60.0, 0, 0, 0])], feet=FEET)
        np.testing.assert_allclose(alone.cop, p, rtol=0, atol=1e-12)
        assert alone.cop_margin > -1e-9


def test_cop_outside_is_reported_and_not_clipped(humanoid: Robot) -> None:
    """Both feet, all of the robot accelerated forwards at 5 m/s^2: a point mass's CoP."""
    here = standing(humanoid)
    a = np.zeros(humanoid.nv)
    a[:3] = here.rotation("base").T @ (5.0, 0.0, 0.0)
    state = wbc.reduce(here, a, feet=FEET)
    behind = here.com[0] - here.com[2] * 5.0 / 9.81
    np.testing.assert_allclose(state.cop, [behind, here.com[1], 0.0], rtol=0, atol=1e-10)
    assert state.cop_inside is False
    assert state.cop_margin == pytest.approx(behind - state.support_polygon[:, 0].min(), abs=1e-3)
    assert wbc.reduce(here, a).cop_inside is None
    one = wbc.reduce(here, feet=["left"])
    assert one.cop_inside is False  # the CoM is between the feet
    inner = state.support_polygon[:, 1].min()
    assert inner < one.support_polygon[:, 1].min() < one.support_polygon[:, 1].max()


def test_flight_has_no_cop(humanoid: Robot) -> None:
    here = standing(humanoid)
    a = np.zeros(humanoid.nv)
    a[:3] = here.rotation("base").T @ (0.0, 0.0, -9.81)
    pulled = wbc.reduce(here, 2.0 * a, feet=FEET)
    assert pulled.ground_force[2] == pytest.approx(-9.81 * humanoid.mass)
    falling, airborne = wbc.reduce(here, a, feet=FEET), wbc.reduce(here, wrenches=(), feet=FEET)
    np.testing.assert_allclose(falling.ground_force, 0.0, rtol=0, atol=1e-10)
    for state in (falling, airborne, pulled):
        assert state.flight
        for name in ("cop", "cmp", "cop_margin", "cop_inside", "ground_moment", "leg_length"):
            assert getattr(state, name) is None, name
        assert state.leg_direction is None and state.leg_angles is None
        assert state.radii.min() > 0.0
    np.testing.assert_allclose(airborne.momentum_rate[2], -9.81 * humanoid.mass)
    assert not wbc.reduce(here, feet=FEET).flight


def test_leg_angles_give_the_leg_back(rng: np.random.Generator) -> None:
    for leg in rng.normal(size=(20, 3)):
        n = leg / np.linalg.norm(leg)
        length, direction, (theta, phi) = leg_of(leg + 0.3, np.full(3, 0.3))
        np.testing.assert_allclose((length, *direction), (np.linalg.norm(leg), *n), atol=1e-14)
        back = np.cos(theta) * np.cos(phi), np.sin(phi), np.sin(theta) * np.cos(phi)
        np.testing.assert_allclose(back, n, rtol=0, atol=1e-14)
    tips = np.array([[np.cos(1.2), 0.0, np.sin(1.2)], [0.0, -1.0, 0.0]])
    angles = leg_of(tips, np.zeros((2, 3)))[2]
    np.testing.assert_allclose(angles, [[1.2, 0.0], [np.nan, np.nan]])


def test_six_masses_and_both_ellipsoids_have_the_inertia(robot: Robot, rng, random_snapshot):
    here, _ = gentle(robot, rng, random_snapshot)
    state = wbc.reduce(here, density=985.0)
    arms = (state.axes * state.radii).T
    rebuilt = np.zeros((3, 3))
    for x in (*arms, *-arms):
        rebuilt += robot.mass / 6.0 * (x @ x * np.eye(3) - np.outer(x, x))
    data = robot.model.createData()
    pin.ccrba(robot.model, data, here.q, here.v)
    expected = np.array(data.Ig.inertia)
    size = np.abs(expected).max()
    for found in (rebuilt, state.ellipsoid.inertia(), state.ellipsoid_at_density.inertia()):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * size)
    assert state.ellipsoid.mass == robot.mass == state.mass
    dense = state.ellipsoid_at_density
    assert dense.mass / dense.volume == pytest.approx(985.0)
    assert wbc.reduce(here).ellipsoid_at_density is None
    np.testing.assert_allclose(state.momentum, data.hg.vector, rtol=1e-12, atol=1e-12)


def test_a_locked_robot_that_spins_turns_its_axes_as_its_momentum_says(robot, rng, random_snapshot):
    q = random_snapshot(robot, rng).q
    v = np.zeros(robot.nv)
    v[:6] = rng.normal(size=6)
    state = wbc.reduce(robot.snapshot(q, v))
    spin = robot.snapshot(q).rotation("base") @ v[3:6]
    np.testing.assert_allclose(state.average_angular_velocity, spin, rtol=0, atol=1e-9)
    # Divided by the gaps between moments, 1e-3 at least.
    np.testing.assert_allclose(state.axes_angular_velocity, spin, rtol=0, atol=1e-8)


def test_axes_turn_without_any_angular_momentum(humanoid: Robot, rng: np.random.Generator) -> None:
    """Theory 3: joints move, the base so that h = 0; the axes' rate by differences of eigh."""
    q, joints = humanoid.posture("standing"), rng.normal(size=humanoid.nv - 6)
    v = np.concatenate((-humanoid.snapshot(q).mechanical_connection @ joints, joints))
    here, h = humanoid.snapshot(q, v), 1e-5
    state = wbc.reduce(here)
    np.testing.assert_allclose(state.average_angular_velocity, 0.0, rtol=0, atol=1e-12)
    assert np.linalg.norm(state.axes_angular_velocity) > 0.05
    ends = []
    for s in (h, -h):
        _, vectors = np.linalg.eigh(humanoid.snapshot(humanoid.integrate(q, v, s)).inertia)
        nearest = np.abs(vectors.T @ state.axes).argmax(axis=0)
        axes = vectors[:, nearest]
        ends.append(axes * np.sign((axes * state.axes).sum(axis=0)))
    rate = (ends[0] - ends[1]) / (2.0 * h)
    for k in range(3):
        turned = np.cross(state.axes_angular_velocity, state.axes[:, k])
        np.testing.assert_allclose(turned, rate[:, k], rtol=0, atol=1e-6)


def test_axes_too_close_to_call_are_undefined(g1, rng: np.random.Generator) -> None:
    here = standing(g1, rng.normal(size=35))
    assert wbc.reduce(here).axes_defined.all()
    # Second moments 3.12, 0.45 and 0.06: a gap of 0.2 takes the latter two for one.
    state = wbc.reduce(here, gap=0.2)
    assert state.axes_defined.tolist() == [True, False, False]
    assert state.axes_angular_velocity is None
    again = wbc.reduce(here, gap=0.2, previous=state)
    assert again.axes_defined.tolist() == [True, False, False]
    none = wbc.reduce(here, gap=2.0, previous=state)
    assert not none.axes_defined.any()
    np.testing.assert_array_equal(none.axes, state.axes)


def test_states_in_a_row_keep_their_axes(humanoid: Robot, rng: np.random.Generator) -> None:
    """The robot turns over and kicks; reduce() one by one is track() of all at once."""
    v = 0.1 * rng.normal(size=humanoid.nv)
    v[3:6] = (1.0, 2.0, -1.5)
    q, state, states = humanoid.posture("standing"), None, []
    for _ in range(60):
        state = wbc.reduce(humanoid.snapshot(q, v), previous=state)
        states.append(state)
        q = humanoid.integrate(q, v, 0.05)
    axes = np.array([s.axes for s in states])
    steps = np.trace(np.swapaxes(axes[:-1], 1, 2) @ axes[1:], axis1=1, axis2=2)
    assert np.degrees(np.arccos((steps.min() - 1.0) / 2.0)) < 15.0
    assert np.trace(axes[0].T @ axes[-1]) < 2.0  # it has turned a good deal in all
    found = track([s.inertia for s in states])
    np.testing.assert_allclose(found.axes, axes, rtol=0, atol=1e-10)
    radii = np.sqrt(3.0 * found.second_moments / humanoid.mass)
    np.testing.assert_allclose(radii, [s.radii for s in states], rtol=1e-10)


def test_a_state_is_read_only(humanoid: Robot) -> None:
    state = wbc.reduce(standing(humanoid), feet=FEET, density=1000.0)
    for name in ("com", "cop", "cmp", "axes", "radii", "axes_defined", "support_polygon"):
        assert not getattr(state, name).flags.writeable, name


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"acceleration": np.zeros(3)}, r"acceleration: expected shape"),
        ({"acceleration": np.full(35, np.nan)}, "acceleration: NaN"),
        ({"acceleration": np.zeros(35), "wrenches": []}, "give one of them"),
        ({"wrenches": [(np.zeros(3), np.zeros(5))]}, r"wrenches\[0\], wrench"),
        ({"density": 0.0}, "density"),
        ({"density": np.nan}, "density"),
        ({"gap": -1.0}, "gap"),
        ({"ground_height": np.inf}, "ground_height"),
        ({"feet": ()}, "at least one foot"),
    ],
)
def test_bad_input(g1, options: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        wbc.reduce(standing(g1), **options)  # type: ignore[arg-type]


def test_unknown_feet_and_a_leg_without_length(g1) -> None:
    here = standing(g1)
    for feet in (["left", "rihgt"], "rihgt"):
        with pytest.raises(UnknownNameError, match="did you mean 'right'"):
            wbc.reduce(here, feet=feet)
    with pytest.raises(InvalidInputError, match="is ground_height right"):
        wbc.reduce(here, ground_height=float(here.com[2]))
