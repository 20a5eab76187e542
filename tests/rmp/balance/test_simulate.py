"""Closed loops against integration of the paper's equations, and moments against momenta."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wbc.errors import InvalidInputError, SolverError
from wbc.rmp.balance.law import LawBounds, Pendulum, PendulumCommand
from wbc.rmp.balance.lqr import Lqr
from wbc.rmp.balance.momentum_qp import MomentumQp
from wbc.rmp.balance.push_limits import push_limits
from wbc.rmp.balance.record import Ending, Simulation
from wbc.rmp.balance.simulate import Blow, simulate, velocity_jump
from wbc.rmp.balance.stabiliser import PointStabiliser
from wbc.rmp.balance.swing_up import SwingUp
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array

M, G, ZERO = 20.0, 9.81, np.zeros(3)
PLANAR, SOLID = PlanarRmp(M, G), SolidRmp(M, G)
Q_PLANAR = np.array((0.1, 1.4, 0.9, 0.3, 0.35))
Q_SOLID = np.array((0.1, -0.2, 1.4, 0.1, 0.9, 0.1, -0.3, 0.2, 0.0, 0.35, 0.3, 0.25))
Q_SOLID[8] = np.sqrt(1.0 - np.sum(Q_SOLID[5:8] ** 2))
START = {"planar": (PLANAR, Q_PLANAR), "solid": (SOLID, Q_SOLID)}
both = pytest.mark.parametrize("kind", START)


@dataclass
class Constant:
    """The simplest law: always the same command."""

    model: Pendulum
    force: Array
    ok: bool = True

    def command(self, q: Array, v: Array, time: float) -> PendulumCommand:
        size = len(self.model.V) - len(self.model.F)
        return PendulumCommand(
            self.force, np.zeros(size), "same", self.ok, "" if self.ok else "unhappy"
        )


def moving(kind: str, seed: int = 0) -> tuple[Constant, Array, Array]:
    """Return a law near the holding force, and a start with some speed on a resting foot."""
    rng = np.random.default_rng(seed)
    model, q = START[kind]
    v = 0.5 * rng.normal(size=len(model.V))
    v[: len(v) - len(model.F)] = 0.0
    return Constant(model, model.holding_force(q) + rng.normal(size=len(model.F))), q, v


def all_finite(run: Simulation) -> bool:
    arrays = (run.time, run.q, run.v, run.force, run.cop_acceleration, run.ground_force)
    return all(np.isfinite(each).all() for each in arrays)


def test_what_is_no_pendulum_bounds_law_or_push_is_refused() -> None:
    """They ended in CasADi's or Python's own errors."""
    law, q0, v0 = moving("solid")
    wheel_bounds, hip = LawBounds(wheel_torque=50.0), (0.7, (0.3, 0.3, 0.3))
    foot = LawBounds(polygon=0.1 * np.array(((-1, -1), (1, -1), (1, 1), (-1, 1))), wheel_torque=5.0)
    rest = ((0.0, 0.0, 0.7), (0.3, 0.3, 0.3), 1e-3)
    for refused, said in (
        (
            lambda: MomentumQp(PLANAR, foot, *rest),
            "model: this law needs a SolidRmp, got PlanarRmp",
        ),
        (lambda: MomentumQp(SOLID, None, *rest), "bounds: expected a LawBounds"),
        (lambda: PointStabiliser(None, wheel_bounds, *hip), "model: this law needs a SolidRmp"),
        (lambda: Lqr("solid", wheel_bounds, q0), "needs a PlanarRmp or SolidRmp, got 'solid'"),
        (lambda: SwingUp(SOLID, wheel_bounds, 0.5, 0.1), "model: this law needs a PlanarRmp"),
        (lambda: simulate("lqr", q0, v0, 0.1), "law: expected a balance law"),
        (lambda: simulate(law, q0, v0, 0.1, bounds={"friction": 1.0}), "bounds: expected a LawB"),
        (lambda: simulate(law, q0, v0, 0.1, pushes=Blow(0.0, ZERO)), "pushes: expected a list"),
        (lambda: simulate(law, q0, v0, 0.1, pushes=[(0.0, ZERO)]), "pushes: expected a Blow"),
        (lambda: push_limits([[1, 0]], foot.polygon, None, mass=M, height=1.0), "wheel: expected"),
    ):
        with pytest.raises(InvalidInputError, match=said):
            refused()


@both
def test_a_foot_lifts_at_a_share_of_the_weight_where_it_is(kind: str) -> None:
    """A hundredth of the weight on Earth was six hundredths on the Moon: such feet had lifted."""
    model, q = START[kind]
    moon = type(model)(M, 1.62)
    still, light = np.zeros(len(model.V)), 0.03 * M * 1.62
    force = moon.holding_force(q)
    force[model.LEG - model.COP] -= M * 1.62 - light
    run = simulate(Constant(moon, force), q, still, 0.01, dt=1e-3)
    assert run.ending is Ending.COMPLETE and np.isfinite(run.cop).all()
    force[model.LEG - model.COP] -= 0.05 * M * 1.62
    run = simulate(Constant(moon, force), q, still, 0.01, dt=1e-3)
    assert (
        run.ending is Ending.CONTACT_LOST and "of the weight) the foot counts as lifted" in run.note
    )


def test_planar_motion_is_that_of_the_papers_equations() -> None:
    """Eqs. 20-23 solved for accelerations by hand, integrated by another method."""
    law, q0, v0 = moving("planar")
    tau_theta, f_l, tau, f = law.force

    def rate(_: float, x: Array) -> Array:
        _, th, rl, _, r, _, dth, drl, dal, dr = x
        spin = dth + dal
        turned = (tau - 2 * M * r * dr * spin) / (M * r**2)
        ddth = (tau_theta - tau - 2 * M * rl * drl * dth - M * G * rl * np.cos(th)) / (M * rl**2)
        ddrl = f_l / M + rl * dth**2 - G * np.sin(th)
        ddr = f / M + r * spin**2
        return np.array((*x[5:], 0.0, ddth, ddrl, turned - ddth, ddr))

    run = simulate(law, q0, v0, 0.4, dt=2e-3)
    exact = solve_ivp(rate, (0, 0.4), np.concatenate((q0, v0)), rtol=1e-11, atol=1e-12)
    assert run.ending is Ending.COMPLETE
    assert len(run.time) == 201
    # RK4 at 2 ms with rates of some 3 rad/s: (0.006)^4 over 120 per step, and as much again.
    np.testing.assert_allclose((*run.q[-1], *run.v[-1]), exact.y[:, -1], rtol=0, atol=1e-9)


@both
@pytest.mark.parametrize("seed", range(3))
def test_cop_and_ground_force_are_those_of_the_rates_of_momenta(kind: str, seed: int) -> None:
    """Forces and moments about the origin from central differences of the recorded momenta."""
    law, q0, v0 = moving(kind, seed)
    dt = 1e-3
    run = simulate(law, q0, v0, 0.05, dt=dt)
    c, rate = run.com()
    f_r = M * (rate[2:] - rate[:-2]) / (2 * dt)
    f_r[:, -1] += M * G
    # Second differences of 1 ms motions: third rates of some 100 N/s^2 times dt^2.
    np.testing.assert_allclose(run.ground_force[1:], f_r, rtol=0, atol=1e-2)
    k_G = run.momentum()
    if kind == "planar":  # positive from x to z
        L = k_G[:, 0] + M * (c[:, 0] * rate[:, 1] - c[:, 1] * rate[:, 0])
        moment = (L[2:] - L[:-2]) / (2 * dt) + M * G * c[1:-1, 0]
        cop = moment[:, None] / f_r[:, 1:]
    else:
        L = k_G + M * np.cross(c, rate)
        moment = (L[2:] - L[:-2]) / (2 * dt) - M * np.cross(c[1:-1], (0.0, 0.0, -G))
        cop = np.column_stack((-moment[:, 1], moment[:, 0])) / f_r[:, 2:]
    np.testing.assert_allclose(run.cop[1:], cop, rtol=0, atol=1e-4)
    # Neither foot has extent: what is outside is the distance from the leg's foot.
    out = np.linalg.norm(run.cop - q0[: run.cop.shape[1]], axis=1).max()
    assert run.cop_violation == pytest.approx(out, abs=1e-12)
    assert out > 0.01


@both
def test_a_push_changes_the_coms_velocity_and_nothing_else(kind: str) -> None:
    law, q, v = moving(kind)
    impulse = np.array((3.0, -1.0) if kind == "planar" else (3.0, 2.0, -1.0))
    after = v + velocity_jump(law.model, q, impulse)
    foot = len(v) - len(law.force)
    np.testing.assert_array_equal(after[:foot], 0.0)
    rates = [law.model.com(q, each)[1] for each in (v, after)]
    np.testing.assert_allclose(M * (rates[1] - rates[0]), impulse, rtol=0, atol=1e-12)
    spins = [np.array(law.model.momenta(q, each)[0]) for each in (v, after)]
    np.testing.assert_allclose(spins[0], spins[1], rtol=0, atol=1e-12)
    radii = 1 if kind == "planar" else 3
    np.testing.assert_array_equal(after[-radii:], v[-radii:])
    # In a run: both pushes of one instant add up, and the law sees what they did.
    seen = []

    class RunViewer(Constant):
        def command(self, q: Array, v: Array, time: float) -> PendulumCommand:
            seen.append(v)
            return super().command(q, v, time)

    parts = (Blow(0.0102, 0.5 * impulse), Blow(0.01, 0.5 * impulse))
    run = simulate(RunViewer(law.model, law.force), q, v, 0.02, pushes=parts)
    calm = simulate(law, q, v, 0.02)
    np.testing.assert_array_equal(run.v[:10], calm.v[:10])
    np.testing.assert_array_equal(run.v[:-1], seen)
    change = M * (run.com()[1][10] - calm.com()[1][10])
    np.testing.assert_allclose(change, impulse, rtol=0, atol=1e-10)


@both
def test_every_ending(kind: str) -> None:
    model, q = START[kind]
    hold, still, leg = model.holding_force(q), np.zeros(len(model.V)), model.F.index("f_l")
    point = hold.copy()
    point[:leg] = 0.0  # a point contact lets the leaning leg fall

    def run(force: Array, ending: Ending, words: str, duration: float = 3.0, **more: object) -> int:
        done = simulate(Constant(model, force), q, still, duration, **more)  # type: ignore[arg-type]
        assert (done.ending, words in done.note) == (ending, True), done
        assert all_finite(done)
        assert len(done.phase) == len(done.force) == len(done.cop) == len(done.q) - 1
        assert done.ended_at == done.time[-1]
        return len(done.phase)

    run(hold, Ending.COMPLETE, "", 0.2)
    whole = run(point, Ending.FELL, "above the ground")
    assert 100 < run(point, Ending.FELL, "above the ground", fallen=np.radians(70)) < whole
    run(hold * 1.5, Ending.FELL, "out of [0.5, 1]", bounds=LawBounds(leg_length=(0.5, 1.0)))
    assert run(0.0 * hold, Ending.CONTACT_LOST, "push up") == 0
    run(0.0 * hold, Ending.COMPLETE, "", 0.2, pivot=True)
    assert run(hold * np.nan, Ending.LAW_FAILED, "force: NaN") == 0
    assert run(hold[1:], Ending.LAW_FAILED, "force: expected shape") == 0
    for command in (None, hold):
        law = SimpleNamespace(model=model, command=lambda *_, given=command: given)
        assert "expected a PendulumCommand" in simulate(law, q, still, 0.1).note
    run(1e9 * np.ones_like(hold), Ending.DIVERGED, "not finite any more", pivot=True)
    drawn = hold.copy()
    drawn[-1] -= 30.0
    run(drawn, Ending.DIVERGED, "meet")


def test_a_law_that_raises_ends_the_run() -> None:
    class Giving(Constant):
        def command(self, q: Array, v: Array, time: float) -> PendulumCommand:
            if time > 0.0095:
                raise SolverError("no answer")
            return super().command(q, v, time)

    run = simulate(Giving(PLANAR, PLANAR.holding_force(Q_PLANAR)), Q_PLANAR, np.zeros(5), 1.0)
    assert run.ending is Ending.LAW_FAILED
    assert run.ended_at == pytest.approx(0.01)
    assert "no answer" in run.note


def test_a_complaining_law_is_carried_out() -> None:
    law = Constant(PLANAR, PLANAR.holding_force(Q_PLANAR), ok=False)
    run = simulate(law, Q_PLANAR, np.zeros(5), 0.01)
    assert run.ending is Ending.COMPLETE
    assert run.note == "unhappy"
    assert not run.ok.any()


def test_a_hanging_pendulum_has_no_cop() -> None:
    """In flight, that is without a force, the ground does not push either."""
    q = np.array((0.0, -np.pi / 2, 0.9, 0.0, 0.35))
    law = Constant(PLANAR, np.zeros(4))
    run = simulate(law, q, np.zeros(5), 0.05, pivot=True)
    assert np.isnan(run.cop).all()
    assert all_finite(run)
    assert run.cop_violation == 0.0
    # A free fall, which the pivot does not hinder because nothing holds the leg's length.
    assert run.q[-1, 2] == pytest.approx(0.9 + G * 0.05**2 / 2, abs=1e-12)


def test_margins_are_the_least_distances() -> None:
    """At rest, upright and turned: every number is known."""
    q = np.array((0, 0, np.pi / 2, 0, 0.9, 0, 0, np.sin(0.2), np.cos(0.2), 0.35, 0.3, 0.25))
    bounds = LawBounds(
        polygon=((-0.1, -0.05), (0.2, -0.05), (0.2, 0.05), (-0.1, 0.05)),
        friction=0.7,
        leg_force=(0.0, 2 * M * G),
        leg_length=(0.5, 1.0),
        wheel_torque=4.0,
        wheel_angle=0.3,
        wheel_rate=2.0,
        radius=(0.2, 0.4),
    )
    still = np.zeros(11)
    found = simulate(Constant(SOLID, SOLID.holding_force(q)), q, still, 0.002, bounds=bounds)
    expected = {
        "cop": 0.05,
        "friction": 0.7,
        "leg_force": M * G,
        "leg_length": 0.1,
        "wheel_torque": 4.0,
        "wheel_angle": -0.1,
        "wheel_rate": 2.0,
        "radius": 0.05,
    }
    assert found.margins() == pytest.approx(expected, abs=1e-9)
    flat = simulate(
        Constant(PLANAR, np.array((0.2 * M * G, M * G, 0, 0))),
        (0, np.pi / 2, 1, 0, 0.3),
        np.zeros(5),
        0.001,
        bounds=LawBounds(polygon=(-0.1, 0.15)),
    )
    # tau_theta / f_z beyond the foot, and its horizontal force over the leg's length.
    assert flat.cop[0, 0] == pytest.approx(0.2, abs=1e-12)
    # And it moves on within the step.
    assert flat.cop_violation == pytest.approx(0.05, abs=1e-7)
    assert flat.ground_force[0] == pytest.approx((-0.2 * M * G, M * G), abs=1e-9)


def test_what_is_broken_and_that_a_pivot_bounds_no_ground_force() -> None:
    # At rest and upright, with a foot's torque that takes the CoP 5 cm beyond the polygon.
    law = Constant(PLANAR, np.array((0.2 * M * G, M * G, 0, 0)))
    bounds = LawBounds(polygon=(-0.1, 0.15), friction=0.1, leg_force=(0, 1), radius=(0.4, 0.5))
    start = ((0, np.pi / 2, 1, 0, 0.3), np.zeros(5), 0.001)
    broken = simulate(law, *start, bounds=bounds).broken()
    expected = {"cop": 0.05, "friction": 0.1, "leg_force": M * G - 1, "radius": 0.1}
    # Within the step the leg leans further, 1e-6 rad.
    assert broken == pytest.approx(expected, abs=2e-6)
    bolted = simulate(law, *start, bounds=bounds, pivot=True)
    assert bolted.broken() == pytest.approx({"radius": 0.1}, abs=1e-9)
    assert [bolted.margins()[name] for name in ("cop", "friction", "leg_force")] == [np.inf] * 3


def test_bounds_are_judged_between_ticks_too() -> None:
    """A foot's torque that is right at the tick only: the CoP wanders off while it is held."""
    q, v = (0, np.pi / 2 - 0.1, 1, 0, 0.3), np.array((0, 1.0, 0.5, 0, 0))
    law = Constant(PLANAR, np.array((0.1 * M * G, M * G, 0, 0)))
    coarse = simulate(law, q, v, 0.02, dt=0.02, bounds=LawBounds(polygon=(-0.5, 0.15)))
    fine = simulate(law, q, v, 0.02, dt=1e-4, bounds=LawBounds(polygon=(-0.5, 0.15)))
    assert abs(fine.cop[-1, 0] - fine.cop[0, 0]) > 1e-5
    # Its extremes are at the ends of the step here, so both see the same.
    assert coarse.margins()["cop"] == pytest.approx(fine.margins()["cop"], abs=1e-8)
    assert coarse.margins()["friction"] == pytest.approx(fine.margins()["friction"], abs=1e-8)


def test_another_plant_stop_and_progress() -> None:
    law, told = Constant(PLANAR, PLANAR.holding_force(Q_PLANAR)), []
    heavy = simulate(law, Q_PLANAR, np.zeros(5), 0.3, plant=PlanarRmp(25.0), progress=told.append)
    assert heavy.model.mass == 25.0
    # The leg of a mass that is a fourth too heavy comes down at a fifth of its weight.
    fall = 0.2 * G * np.sin(1.4) * 0.1**2 / 2
    assert heavy.q[100, 2] == pytest.approx(0.9 - fall, rel=1e-3)
    assert told[0] == 0.0
    assert told[-1] == heavy.ended_at
    assert len(told) == 4
    stopped = simulate(law, Q_PLANAR, np.zeros(5), 1.0, stop=lambda t, q, v, c: t > 0.0995)
    assert stopped.ending is Ending.COMPLETE
    assert stopped.ended_at == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"duration": -1.0}, "duration"),
        ({"duration": 1e-5}, "less than a step"),
        ({"duration": 1e9}, "takes 1e.12 steps"),
        ({"dt": 0.0}, "dt"),
        ({"q0": (0, 1, -1, 0, 1)}, "r_l"),
        ({"q0": (0, 1, 1, 0, 0)}, "no inertia"),
        ({"v0": np.full(5, np.nan)}, "v: NaN"),
        ({"v0": np.zeros(4)}, "v: expected shape"),
        ({"plant": SOLID}, "cannot stand for"),
        ({"fallen": 10.0}, "fallen: 10 rad .* is it in rad"),
        ({"pivot": "no"}, "pivot: expected True or False"),
        ({"stop": 0.5}, "stop: expected a function"),
        ({"bounds": LawBounds(polygon=((0, 0), (1, 0), (0, 1)))}, "polygon"),
        ({"pushes": [Blow(0.5, (1, 0, 0))]}, "impulse at 0.5"),
        ({"pushes": [Blow(1.0, (1, 0))]}, "not before the end"),
    ],
)
def test_bad_input_is_refused(change: dict[str, object], words: str) -> None:
    given: dict[str, object] = {"q0": Q_PLANAR, "v0": np.zeros(5), "duration": 1.0} | change
    with pytest.raises(InvalidInputError, match=words):
        simulate(Constant(PLANAR, np.zeros(4)), **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("given", [(-1.0, (1, 0)), (0.0, (1,)), (0.0, (np.inf, 0))])
def test_a_bad_push_is_refused(given: tuple[float, tuple[float, ...]]) -> None:
    with pytest.raises(InvalidInputError, match="push"):
        Blow(*given)
