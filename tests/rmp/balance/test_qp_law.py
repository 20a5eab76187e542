"""The momentum law on a flat foot: each command against the equations of motion, then pushes."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.push_recovery import largest_impulses, recover, standing, survives
from wbc.errors import InvalidInputError
from wbc.placement import from_quaternion
from wbc.polygon import inset, polygon_margin
from wbc.qp import QP, ProxQP, Solution, make_backend
from wbc.rmp.balance.capture import braking_debt, projected
from wbc.rmp.balance.foot import acceleration_range
from wbc.rmp.balance.law import LawBounds
from wbc.rmp.balance.momentum_qp import MomentumQp
from wbc.rmp.balance.push_limits import PushLimits, Wheel, compass, push_limits
from wbc.rmp.balance.record import Ending
from wbc.rmp.balance.simulate import Blow, simulate
from wbc.rmp.ground import centre_of_pressure
from wbc.rmp.solid import SolidRmp, quaternion_rate, rotation_vector
from wbc.validate import Array

DT = 2e-3
# A G1 with both soles side by side; a larger robot, its CoM off the middle, three unlike radii.
BODIES = {
    "g1": (35.0, 0.7, (0.1, 0.1, 0.1), (0.3, 0.3, 0.3), 50.0, 0.6),
    "talos": (90.0, 0.9, (0.12, 0.08, 0.15), (0.3, 0.25, 0.4), 120.0, 0.5),
}


@cache
def body(name: str) -> tuple[MomentumQp, PushLimits]:
    mass, height, (front, back, side), radii, torque, angle = BODIES[name]
    sole = np.array(((-back, -side), (front, -side), (front, side), (-back, side)))
    bounds = LawBounds(
        polygon=sole,
        friction=0.8,
        leg_force=(0.0, 30.0 * mass),
        leg_length=(0.6 * height, 1.15 * height),
        wheel_torque=torque,
        wheel_angle=angle,
        radius=(0.05, 0.6),
    )
    # A cold solver, so that no run depends on the run before it.
    cold, com = make_backend("proxqp_cold"), (0.0, 0.0, height)
    law = MomentumQp(SolidRmp(mass), bounds, com, radii, dt=DT, backend=cold)
    r = np.square(radii)
    wheel = Wheel(mass / 3.0 * (r.sum() - r)[:2], torque, angle)
    # The bound of what the law uses of the sole.
    used = inset(sole, bounds.cop_margin)
    return law, push_limits(compass(16), used, wheel, mass=mass, height=height)


def disturbed(law: MomentumQp, seed: int) -> tuple[Array, Array]:
    """A state some way from rest, in which a foot can still do something."""
    rng = np.random.default_rng(seed)
    q, v = standing(law)
    q[:2] += rng.uniform(-0.02, 0.02, 2)
    q[2:4] += rng.uniform(-0.08, 0.08, 2)
    q[4] *= rng.uniform(0.95, 1.05)
    q[5:9] = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3)).as_quat()
    q[9:] += rng.uniform(-0.03, 0.03, 3)
    v[2:] = rng.uniform(-0.3, 0.3, 9)
    return q, v


# ------------------------------------------------------------------ one command


@pytest.mark.parametrize("seed", range(12))
def test_command_brings_about_the_accelerations_of_the_qp_and_keeps_every_bound(seed: int) -> None:
    law, _ = body("talos")
    q, v = disturbed(law, seed)
    command = law.command(q, v, 0.0)
    model, bounds = law.model, law.bounds
    a = model.forward_dynamics(q, v, command.force)
    push = model.ground_reaction(q, v, a)
    qp = law.program(q, v)
    x = ProxQP().solve(qp).x
    # The unknowns are in parts of g and of the torque's limit; two solves differ by 1e-8 of that.
    np.testing.assert_allclose(push / model.mass - (0, 0, 9.81), 9.81 * x[:3], atol=1e-5)
    np.testing.assert_allclose(command.force[3:6], bounds.wheel_torque * x[3:6], atol=1e-3)
    np.testing.assert_allclose(a[8:], 9.81 * x[6:9], atol=1e-5)
    c, _ = model.com(q, v)
    cop = centre_of_pressure(c, push, model.momentum_rate(q, command.force))
    assert polygon_margin(bounds.polygon, cop[:2]) > 0.0
    assert np.hypot(push[0], push[1]) < bounds.friction * push[2]
    assert 0.0 <= command.force[2] <= bounds.leg_force[1]
    assert np.abs(command.force[3:6]).max() <= bounds.wheel_torque * (1 + 1e-8)
    assert command.ok


def test_a_pendulum_at_rest_is_left_at_rest() -> None:
    law, _ = body("g1")
    q, v = standing(law)
    command = law.command(q, v, 0.0)
    # Accuracy of the QP, 1e-8 of forces up to 343 N and torques up to 50 N m.
    np.testing.assert_allclose(command.force, law.model.holding_force(q), atol=1e-4)
    assert command.phase == "stand"
    assert command.ok


def test_out_of_reach_the_command_is_not_ok_and_says_why() -> None:
    law, _ = body("g1")
    q, v = standing(law)
    # 45 degrees of lean put the CoM 0.49 m out; foot and wheel reach 0.1 m and 0.15 m.
    q[2] -= np.pi / 4
    command = law.command(q, v, 0.0)
    assert not command.ok
    assert "only a step helps" in command.note
    # And it is no memory: the next tick is as good as ever.
    assert law.command(*standing(law), 0.0).ok


def test_limits_that_give_way_are_told() -> None:
    law, _ = body("g1")
    q, v = standing(law)
    # The leg flies out at 3 m/s, 5 cm before its end: stopping takes more than free fall.
    q[4] = 0.755
    v[4] = 3.0
    command = law.command(q, v, 0.0)
    assert not command.ok
    assert "slack leg" in command.note


class Silent:
    """A solver that never finds anything."""

    name = "silent"

    def solve(self, qp: QP, workspace: object = None) -> Solution:
        return ProxQP(max_iterations=1).solve(
            QP.build(np.eye(1), [0.0], A=[[0.0]], b=[1.0])  # no point meets 0 x = 1
        )


def test_fallback_holds_the_cop_within_the_foot_near_rest() -> None:
    law, _ = body("g1")
    deaf = MomentumQp(law.model, law.bounds, law.com, law.radii, dt=DT, backend=Silent())
    q, v = disturbed(law, 3)
    command = deaf.command(q, 0 * v, 0.0)
    a = law.model.forward_dynamics(q, 0 * v, command.force)
    push = law.model.ground_reaction(q, 0 * v, a)
    c, _ = law.model.com(q, v)
    # CMP under the CoM: at rest no horizontal force at all.
    np.testing.assert_allclose(push[:2], 0.0, atol=1e-9)
    assert polygon_margin(law.bounds.polygon, c[:2]) > 0.0
    assert not command.ok


# ------------------------------------------------------------------ pushes


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(BODIES))
def test_nine_tenths_of_the_bound_with_a_wheel_are_survived_all_around(name: str) -> None:
    law, limits = body(name)
    # Of the larger robot one side: the other is its mirror image.
    ways = range(0, 16, 3) if name == "g1" else range(0, 9, 2)
    for direction, bound in ((limits.directions[k], limits.wheel[k]) for k in ways):
        found = recover(law, 0.9 * bound * direction)
        assert found.survived, f"{name} {direction}: {found.simulation.note} {found.broken}"
        assert found.simulation.ok.all()
        assert found.simulation.cop_violation <= 1e-6
        margins = found.simulation.margins()
        assert margins["wheel_angle"] > 0.0
        assert margins["friction"] > 0.0


@pytest.mark.slow
def test_there_are_no_holes_below_the_bound() -> None:
    law, limits = body("g1")
    for k in (0, 3):
        for share in np.linspace(0.1, 0.98, 5):
            found = recover(law, share * limits.wheel[k] * limits.directions[k])
            assert found.survived, f"{share} of the bound toward {limits.directions[k]}"


@pytest.mark.slow
@pytest.mark.parametrize("mass", [33.0, 37.0])
def test_another_mass_than_believed_makes_no_difference_but_in_height(mass: float) -> None:
    law, limits = body("g1")
    q, v = standing(law)
    # Where foot and wheel take over from each other, both once held a capture point at the edge
    # for good; 0.75 is such a push.
    for share in (0.75, 0.9):
        impulse = share * limits.wheel[0] * mass / 35.0
        run = simulate(
            law,
            q,
            v,
            4.0,
            dt=DT,
            plant=SolidRmp(mass),
            bounds=law.bounds,
            pushes=[Blow(0.0, (impulse, 0.0, 0.0))],
        )
        assert run.ending is Ending.COMPLETE
        assert run.cop_violation == 0.0
        # Weight that is not known of sags by (M - 35) g / (M 64 / s^2), 8 mm.
        np.testing.assert_allclose(run.com()[0][-1], (0.0, 0.0, 0.7), atol=0.01)


@pytest.mark.slow
def test_bisection_finds_the_bound_along_the_axes_whichever_way() -> None:
    """Single runs beyond the bound are luck: mirror images once gave 17.06 and 17.99 N s."""
    law, limits = body("g1")
    bound = float(limits.wheel[0])
    ways = [(1.0, 0.0), (0.0, -1.0)]
    found = largest_impulses(law, ways, [(0.97 * bound, 1.09 * bound)] * 2, resolution=0.3)
    np.testing.assert_allclose(found, found[0], rtol=1e-12)
    assert 0.99 * bound < found[0] < 1.05 * bound


@pytest.mark.slow
def test_toward_corners_both_motors_work() -> None:
    """More than one motor could ever catch, with a limit for the torque about the push's axis."""
    law, limits = body("g1")
    one_motor = limits.ankle[2] + limits.wheel[0] - limits.ankle[0]
    assert 1.06 * one_motor < limits.wheel[2]
    swift = MomentumQp(law.model, law.bounds, law.com, law.radii, dt=1e-3, backend=law.backend)
    assert survives(swift, 1.04 * one_motor * limits.directions[2])


@pytest.mark.slow
def test_a_margin_of_the_cop_is_kept_and_costs_what_theory_says() -> None:
    law, limits = body("g1")
    bounds = replace(law.bounds, cop_margin=0.01)
    careful = MomentumQp(law.model, bounds, law.com, law.radii, dt=DT, backend=law.backend)
    lost = 35.0 * limits.omega * (0.01 - law.bounds.cop_margin)
    run = recover(careful, (0.98 * (limits.wheel[0] - lost), 0.0))
    assert run.survived
    # What it wanders while a command is held is a tenth of a millimetre along an axis.
    assert 0.0098 < run.simulation.margins()["cop"] < 0.0101
    assert not recover(careful, (1.03 * (limits.wheel[0] - lost), 0.0)).survived
    with pytest.raises(InvalidInputError, match=r"cop_margin, 0\.05 m, and is 0\.02 m inside"):
        edge = (0.08, 0.0, 0.7)
        MomentumQp(law.model, replace(law.bounds, cop_margin=0.05), edge, law.radii, dt=DT)


def test_a_push_within_the_foot_leaves_the_wheel_alone() -> None:
    law, limits = body("g1")
    run = recover(law, 0.9 * limits.ankle[0] * limits.directions[0]).simulation
    # 50 N m are there to be used; 0.1 N m moves the CMP by 0.3 mm.
    assert np.abs(run.force[:, 3:6]).max() < 0.1
    assert set(run.phase) == {"stand"}


def test_a_push_near_the_bound_makes_the_wheel_bang_bang_by_itself() -> None:
    law, limits = body("g1")
    run = recover(law, 0.99 * limits.wheel[0] * limits.directions[0]).simulation
    torque, angle = run.force[:, 4], run.q[:-1, 5:9]
    # A torque about +y moves the CMP toward +x. T = sqrt(phi I / tau) to half of the angle.
    switch = np.sqrt(0.6 * 2.1 / 50.0)
    t = run.time[:-1]
    np.testing.assert_allclose(torque[t < 0.85 * switch], 50.0, atol=1e-3)
    # As soon as the wheel can be stopped without harm it pushes no more, and brakes at its limit.
    assert np.all(torque[t > switch] < 10.0)
    assert -50.0 <= torque.min() < -0.9 * 50.0
    turned = Rotation.from_quat(angle).as_rotvec()
    assert 0.59 < turned[:, 1].max() < 0.6
    # Off-axis nothing moves, and the CoP waits at the toe.
    assert np.abs(turned[:, ::2]).max() < 1e-4
    np.testing.assert_allclose(run.cop[t < 0.5, 0], 0.1 - law.bounds.cop_margin, atol=1e-4)
    assert run.phase[0] == "wheel"
    assert "recover" in run.phase
    assert np.abs(turned[-1]).max() < 0.02


def test_rate_limit_of_the_wheel_is_kept_and_costs_what_theory_says() -> None:
    law, _ = body("g1")
    bounds = LawBounds(
        polygon=law.bounds.polygon, friction=0.8, wheel_torque=50.0, wheel_angle=0.6, wheel_rate=2.0
    )
    slow = MomentumQp(law.model, bounds, law.com, law.radii, dt=DT)
    wheel = Wheel(2.1, 50.0, 0.6, 2.0)
    limits = push_limits([(1.0, 0.0)], law.bounds.polygon, wheel, mass=35.0, height=0.7)
    within = recover(slow, (0.95 * limits.wheel[0], 0.0))
    assert within.survived
    assert within.simulation.margins()["wheel_rate"] >= -1e-6
    assert np.abs(within.simulation.v[:, 6]).max() > 1.9
    assert not recover(slow, (1.05 * limits.wheel[0], 0.0)).survived


def test_without_angle_friction_and_leg_limits_the_program_has_only_what_is_left() -> None:
    law, limits = body("g1")
    bounds = LawBounds(polygon=law.bounds.polygon, wheel_torque=50.0)
    free = MomentumQp(law.model, bounds, law.com, law.radii, dt=DT)
    q, v = standing(free)
    assert len(free.program(q, v).u) == 4 + 2
    assert recover(free, 0.9 * limits.wheel[2] * limits.directions[2]).survived


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bounds": LawBounds(wheel_torque=1.0)}, "PointStabiliser"),
        ({"bounds": LawBounds(polygon=[(-1, -1), (1, -1), (0, 1)])}, "finite wheel_torque"),
        ({"com": (0.2, 0.0, 0.7)}, "0.1 m beyond its edge"),
        ({"com": (0.0, 0.0, 2.0)}, "no length of the leg"),
        ({"radii": (0.3, 0.3, 0.01)}, "radii"),
        ({"dt": 0.0}, "dt"),
    ],
)
def test_unusable_arguments_are_refused(change: dict[str, object], message: str) -> None:
    law, _ = body("g1")
    arguments: dict[str, object] = {"bounds": law.bounds, "com": law.com, "radii": law.radii}
    with pytest.raises(InvalidInputError, match=message):
        MomentumQp(law.model, **arguments | change)  # type: ignore[arg-type]


# ------------------------------------------------------------------ the parts


def test_rotation_vector_is_that_of_scipy_and_smooth_at_rest() -> None:
    quaternion, rate = ca.SX.sym("q", 4), ca.SX.sym("w", 3)
    vector = rotation_vector(quaternion)
    moved = ca.jtimes(vector, quaternion, quaternion_rate(quaternion, rate))
    function = ca.Function("f", [quaternion, rate], [vector, moved, from_quaternion(quaternion)])
    rng = np.random.default_rng(5)
    for size in (0.0, 1e-9, 1e-4, 3e-4, 7e-4, 0.1, 2.0, 3.1):
        axis = rng.normal(size=3)
        turn = Rotation.from_rotvec(size * axis / np.linalg.norm(axis))
        w = rng.normal(size=3)
        for sign in (1.0, -1.0):
            found, speed, matrix = (x.full() for x in function(sign * turn.as_quat(), w))
            np.testing.assert_allclose(found.ravel(), turn.as_rotvec(), atol=1e-12)
            np.testing.assert_allclose(matrix, turn.as_matrix(), atol=1e-12)
            h = 1e-6
            ends = [(turn * Rotation.from_rotvec(s * h * w)).as_rotvec() for s in (1, -1)]
            # Central differences: h^2 and rounding 1e-16 / h.
            np.testing.assert_allclose(speed.ravel(), (ends[0] - ends[1]) / (2 * h), atol=1e-8)


def test_braking_never_passes_a_limit_and_uses_all_of_the_way() -> None:
    position, rate = ca.SX.sym("p"), ca.SX.sym("r")
    strength, dt = (3.0, 5.0), 0.01
    ends = acceleration_range(position, rate, (-0.4, 0.7), strength, dt)
    allowed = ca.Function("allowed", [position, rate], list(ends))
    p = r = 0.0
    path = []
    # Full speed up, and later full speed down; the motor gives 4.
    for k in range(1000):
        least, greatest = (float(end) for end in allowed(p, r))
        a = min(4.0, greatest) if k < 500 else max(-4.0, least)
        assert least <= greatest
        p, r = p + r * dt + a * dt**2 / 2, r + a * dt
        path.append((p, r, a))
    places = np.array(path)[:, 0]
    assert places.max() == pytest.approx(0.7, abs=1e-9)
    assert places.min() == pytest.approx(-0.4, abs=1e-9)
    # Speeding up at 4 and braking at 5: the top speed of a triangle 0.7 high.
    top = np.sqrt(2 * 0.7 / (1 / 4.0 + 1 / 5.0))
    assert np.array(path)[:, 1].max() == pytest.approx(top, rel=0.02)


def test_nearest_point_of_a_polygon() -> None:
    corners = np.array(((-0.1, -0.2), (0.3, -0.1), (0.2, 0.2), (-0.2, 0.1)))
    point = ca.SX.sym("p", 2)
    function = ca.Function("nearest", [point], [projected(corners, point)])
    rng = np.random.default_rng(8)
    for p in rng.uniform(-0.5, 0.5, (200, 2)):
        found = function(p).full().ravel()
        margin = float(polygon_margin(corners, p))
        # As far away as the margin says, and itself in the polygon.
        assert np.linalg.norm(found - p) == pytest.approx(max(0.0, -margin), abs=1e-12)
        assert float(polygon_margin(corners, found)) > -1e-12


def test_debt_is_what_a_wheel_takes_back_while_it_stops() -> None:
    k, omega, torque, weight = np.array((3.0, -4.0, 9.0)), 3.7, 50.0, 343.0
    # Weighted mean of the CMP by quadrature, each axis braking for |k| / torque.
    symbol = ca.SX.sym("k", 3)
    debt = ca.Function("debt", [symbol], [braking_debt(symbol, torque, weight, ca.SX(omega))])
    found = debt(k).full().ravel()
    for value, momentum in zip(found, (k[1], -k[0]), strict=True):
        s = np.linspace(0.0, abs(momentum) / torque, 20001)
        mean = np.trapezoid(omega * np.exp(-omega * s), s) * torque / weight
        assert value == pytest.approx(np.sign(momentum) * mean, rel=1e-6)
