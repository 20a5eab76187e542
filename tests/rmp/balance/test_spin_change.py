"""Masses drawn in and out: momentum, energy and spin against what point masses must do."""

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.rmp.balance.law import LawBounds, Pendulum
from wbc.rmp.balance.record import Ending, Simulation
from wbc.rmp.balance.simulate import simulate
from wbc.rmp.balance.spin_change import SpinChange, reachable_spins
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array

M = 20.0
PLANAR, SOLID = PlanarRmp(M), SolidRmp(M)
SQUARE = ((-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1))
FOOT = {PLANAR: LawBounds(polygon=(-0.1, 0.1), radius=(0.05, 0.6))}
FOOT[SOLID] = LawBounds(polygon=SQUARE, radius=(0.05, 0.6))
Q_PLANAR, V_PLANAR = np.array((0, np.pi / 2, 0.9, 0, 0.4)), np.array((0, 0, 0, 3.0, 0))
HALF = np.sqrt(0.5)
Q_SOLID = np.array((0, 0, np.pi / 2, 0, 0.9, HALF, 0, 0, HALF, 0.35, 0.3, 0.2))


def spinning(axis: int, spin: float) -> Array:
    v = np.zeros(11)
    v[5 + axis] = spin
    return v


def places(model: Pendulum, q: Array) -> Array:
    """Return the places of all masses relative to the CoM, in their own axes (k, 2 or 3)."""
    if isinstance(model, PlanarRmp):
        return np.array(((q[4], 0.0), (-q[4], 0.0)))
    return np.vstack([sign * q[9 + k] * np.eye(3)[k] for k in range(3) for sign in (1, -1)])


def inertia(model: Pendulum, q: Array, axis: int) -> float:
    """Return the sum of m r^2 about the spin's axis, mass by mass."""
    points = places(model, q)
    arms = points if isinstance(model, PlanarRmp) else np.delete(points, axis, axis=1)
    return float(M / len(points) * np.sum(arms**2))


def kinetic_energy(model: Pendulum, q: Array, v: Array) -> float:
    """Return that of the masses about the CoM, mass by mass, plus that of the leg's motion."""
    points = places(model, q)
    slide = np.zeros(len(model.Q))
    count = 1 if isinstance(model, PlanarRmp) else 3
    slide[-count:] = v[-count:]
    moved = places(model, slide)
    if count == 1:
        spin = v[1] + v[3]
        moved = moved + spin * np.column_stack((-points[:, 1], points[:, 0]))
    else:
        moved = moved + np.cross(v[5:8], points)
    rate = model.com(q, v)[1]
    return float(M / len(points) * np.sum(moved**2) / 2 + M * rate @ rate / 2)


def spin_of(run: Simulation, law: SpinChange) -> Array:
    planar = isinstance(law.model, PlanarRmp)
    return run.v[:, 1] + run.v[:, 3] if planar else run.v[:, 5 + law.axis]


CASES = [
    (PLANAR, Q_PLANAR, V_PLANAR, 9.0),
    (PLANAR, Q_PLANAR, V_PLANAR, 1.5),
    (PLANAR, Q_PLANAR, -V_PLANAR, -4.0),
    (SOLID, Q_SOLID, spinning(0, -3.0), -6.0),
    (SOLID, Q_SOLID, spinning(1, 3.0), 2.0),
    (SOLID, Q_SOLID, spinning(2, 3.0), 6.0),
    # One pair comes to its end: 3 / 0.9 times the inertia takes the first to 0.6 m.
    (SOLID, Q_SOLID, spinning(2, 3.0), 0.9),
]


@pytest.mark.slow
@pytest.mark.parametrize(("model", "q", "v", "wanted"), CASES)
@pytest.mark.parametrize("ground", [True, False], ids=["foot", "flight"])
def test_spin_momentum_and_work(model, q, v, wanted, ground) -> None:
    bounds = FOOT[model]
    if not ground:
        model, bounds = type(model)(M, 0.0), LawBounds(radius=bounds.radius)
    law = SpinChange(model, q, v, wanted, 0.6, bounds)
    run = simulate(law, q, v, 1.8, bounds=bounds, pivot=not ground)
    assert run.ending is Ending.COMPLETE
    assert run.ok.all()
    spin = spin_of(run, law)
    assert abs(spin[-1] - wanted) < 1e-6
    assert set(run.phase[:600]) == {"change"}
    assert set(run.phase[600:]) == {"hold"}
    # I w, with I from the places of the masses; k_G in the world's axes besides.
    momentum = [inertia(model, run.q[k], law.axis) * spin[k] for k in range(0, 1801, 100)]
    np.testing.assert_allclose(momentum, momentum[0], rtol=1e-9)
    k_G = run.momentum()
    assert np.abs(k_G - k_G[0]).max() < 1e-9 * np.linalg.norm(k_G[0])
    # Forces are held over a step, so their work is force times way, exactly.
    masses = 1 if isinstance(model, PlanarRmp) else 3
    work = float(np.sum(run.force[:, -masses:] * np.diff(run.q[:, -masses:], axis=0)))
    gained = kinetic_energy(model, run.q[-1], run.v[-1]) - kinetic_energy(model, q, v)
    start = kinetic_energy(model, q, v)
    assert abs(gained) > 0.2 * start
    assert work == pytest.approx(gained, abs=1e-8 * start)
    # And from rest to rest, k_G (w_1 - w_0) / 2.
    assert gained == pytest.approx(momentum[0] * (wanted - spin[0]) / 2, rel=1e-6)
    margins = run.margins()
    assert margins["radius"] > -1e-4
    assert np.abs(run.force[:, -2 * masses : -masses]).max() == 0.0
    if ground:
        assert margins["cop"] > 0.0
        assert np.abs(run.q[-1, : 5 if masses == 3 else 3] - q[: 5 if masses == 3 else 3]).max() < (
            1e-9
        )


def test_the_foot_holds_a_leg_that_is_disturbed() -> None:
    """1 degree off upright is within the foot's reach; 10 degrees is not, and is told."""
    law = SpinChange(PLANAR, Q_PLANAR, V_PLANAR, 6.0, 0.5, FOOT[PLANAR])
    q = Q_PLANAR + np.array((0, 0.017, 0, 0, 0))
    run = simulate(law, q, V_PLANAR, 2.0, bounds=law.bounds)
    assert abs(run.q[-1, 1] - np.pi / 2) < 1e-9
    assert run.margins()["cop"] > 0.0
    assert abs(spin_of(run, law)[-1] - 6.0) < 1e-6
    far = law.command(Q_PLANAR + np.array((0, 0.17, 0, 0, 0)), V_PLANAR, 0.0)
    assert not far.ok
    assert "foot is too short" in far.note


def test_range_of_reach() -> None:
    """k / (M r^2) at both ends of the radius; for the solid, both pairs at one end."""
    low, high = reachable_spins(PLANAR, Q_PLANAR, -V_PLANAR, FOOT[PLANAR])
    assert (low, high) == pytest.approx((-3.0 * (0.4 / 0.05) ** 2, -3.0 * (0.4 / 0.6) ** 2))
    low, high = reachable_spins(SOLID, Q_SOLID, spinning(2, 3.0), FOOT[SOLID])
    squares = 0.35**2 + 0.3**2
    expected = (3.0 * squares / (2 * 0.6**2), 3.0 * squares / (2 * 0.05**2))
    assert (low, high) == pytest.approx(expected)
    for spin in (low * (1 + 1e-9), high * (1 - 1e-9)):
        law = SpinChange(SOLID, Q_SOLID, spinning(2, 3.0), spin, 1.0, FOOT[SOLID])
        end = law.radii[1]
        assert end.min() >= 0.05 - 1e-9
        assert end.max() <= 0.6 + 1e-9
        assert end[2] == 0.2


def test_the_middle_axis_is_called_unstable() -> None:
    """Radii 0.35, 0.3, 0.2: inertia grows from axis 1 to axis 3."""
    expected = {0: True, 1: False, 2: True}
    for axis, stable in expected.items():
        v = spinning(axis, 3.0)
        assert SpinChange(SOLID, Q_SOLID, v, 3.3, 0.5, FOOT[SOLID]).stable is stable
    # Drawn in so far that axis 3 becomes the middle one on the way, and the least at the end.
    crossing = SpinChange(SOLID, Q_SOLID, spinning(2, 3.0), 12.0, 0.5, FOOT[SOLID])
    assert crossing.radii[1][:2].max() < 0.2
    assert not crossing.stable
    assert SpinChange(PLANAR, Q_PLANAR, V_PLANAR, 4.0, 0.5).stable
    # A wobble of 1e-5 rad/s grows about the middle axis only.
    for axis in (1, 2):
        v = spinning(axis, 3.0)
        law = SpinChange(SOLID, Q_SOLID, v, 3.3, 0.5, FOOT[SOLID])
        v[5] = 1e-5
        run = simulate(law, Q_SOLID, v, 3.0, bounds=law.bounds, dt=2e-3)
        wobble = np.linalg.norm(np.delete(run.v[:, 5:8], axis, axis=1), axis=1)
        assert (wobble[-1] > 10 * wobble[0]) is not law.stable


def test_reference_is_smooth_and_ends_at_rest() -> None:
    law = SpinChange(PLANAR, Q_PLANAR, V_PLANAR, 9.0, 0.8)
    h = 1e-5
    for t in (0.0, 0.1, 0.37, 0.8):
        _, pace, push = law.reference(t)
        before, after = law.reference(t - h), law.reference(t + h)
        # At the ends the fifth-order path starts with its third power.
        np.testing.assert_allclose(pace, (after[0] - before[0]) / (2 * h), atol=1e-7)
        np.testing.assert_allclose(push, (after[1] - before[1]) / (2 * h), atol=1e-3)
    np.testing.assert_array_equal(law.reference(0.0)[0], 0.4)
    np.testing.assert_allclose(law.reference(5.0)[0], 0.4 * np.sqrt(3.0 / 9.0), rtol=1e-12)
    assert law.reference(5.0)[1:] == (0.0, 0.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        # 3 (0.4 / 0.6)^2 = 1.33333, 3 (0.4 / 0.05)^2 = 192
        ({"spin": 200.0}, r"out of reach.*\[0.05, 0.6\] m.* 1.33333 to 192 rad/s"),
        ({"spin": -9.0}, "1.33333 to 192"),
        ({"spin": np.nan}, "spin"),
        # Without a limit of the radius the range begins at zero, which is not reached.
        ({"spin": 0.0, "bounds": LawBounds()}, "infinitely far"),
        ({"spin": 5e-324, "bounds": LawBounds()}, "infinitely far"),
        ({"v0": np.zeros(5)}, "do not spin"),
        ({"v0": V_PLANAR + (0, 0, 0, 0, 0.1)}, "must not slide"),
        ({"q0": Q_PLANAR + (0, 0, 0, 0, 0.3)}, "out of bounds"),
        ({"duration": 0.0}, "duration"),
        ({"rate": -1.0}, "rate"),
        ({"v0": np.zeros(4)}, "v0: expected shape"),
        ({"bounds": LawBounds(polygon=SQUARE)}, "polygon"),
        ({"model": SOLID, "q0": Q_SOLID, "v0": spinning(0, 3.0) + spinning(1, 1e-3)}, "tumble"),
    ],
)
def test_nonsense_is_refused(change: dict[str, object], words: str) -> None:
    given: dict[str, object] = {
        "model": PLANAR,
        "q0": Q_PLANAR,
        "v0": V_PLANAR,
        "spin": 9.0,
        "duration": 1.0,
        "bounds": FOOT[PLANAR],
    }
    with pytest.raises(InvalidInputError, match=words):
        SpinChange(**(given | change))  # type: ignore[arg-type]
