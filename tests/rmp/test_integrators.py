"""Steps against motions known in closed form; exported C against the machine of CasADi."""

import copy
import pickle
import shutil
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from benchmarks.rmp_drift import compare_paths, measure_drift
from benchmarks.rmp_steps import Springs, energy_momentum, rollout, runge_kutta
from tests.command import wbc_command
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.rmp import integrators
from wbc.rmp.balance.law import LawBounds
from wbc.rmp.balance.momentum_qp import MomentumQp
from wbc.rmp.functions import export_c
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import EulerSolidRmp, SolidRmp

M, G = 20.0, 9.81
SOLID, ANGLES = SolidRmp(M, G), EulerSolidRmp(M, G)
SPRINGS = Springs(leg=4000.0, leg_rest=1.0, masses=3000.0, masses_rest=np.array((0.3, 0.35, 0.4)))

# A body that turns on a swinging, bouncing leg: both descriptions of one state.
LEG, LEG_RATE = (0.0, 0.0, -np.pi / 2 + 0.3, 0.2, 1.0), (0.0, 0.0, 0.5, 0.4, 0.1)
RADII, RADII_RATE = (0.3, 0.35, 0.4), (0.1, 0.0, -0.1)
TUMBLING = np.array((*LEG, 0, 0, 0, 1, *RADII, *LEG_RATE, 1.0, 4.0, 0.5, *RADII_RATE))


def test_runge_kutta_on_quaternions_keeps_to_the_path_best() -> None:
    """What the invariants do not tell: orders two and four, against DOP853 to 1e-12."""
    found = compare_paths(2.0)
    assert found["runge_kutta"] < 1e-6
    assert 1e-4 < found["energy_momentum"] < 1e-3
    halved = compare_paths(2.0, dt=2.5e-3)
    assert 3.5 < found["energy_momentum"] / halved["energy_momentum"] < 4.5
    assert 12.0 < found["runge_kutta"] / halved["runge_kutta"] < 20.0
    assert found["runge_kutta_angles"] > 100 * found["runge_kutta"]  # the singular orientation


def test_the_group_step_keeps_them_at_any_step_that_can_be_solved() -> None:
    """At 20 ms Runge and Kutta's energy is off by parts in ten thousand and more."""
    step = energy_momentum(SOLID, 0.02, SPRINGS)
    kept = measure_drift(SOLID, step, SPRINGS, TUMBLING, 2000)
    assert max(kept.energy, kept.spin, kept.yaw) < 1e-12
    plain = runge_kutta(SOLID, 0.02, SPRINGS)
    assert measure_drift(SOLID, plain, SPRINGS, TUMBLING, 2000).energy > 1e-4


def flying_apart(t: float, r0: float, w0: float) -> tuple[float, float, float, float]:
    """Return r, r', angle and rate of free masses that start across the radius: straight lines."""
    r = r0 * np.sqrt(1 + (w0 * t) ** 2)
    return r, r0**2 * w0**2 * t / r, np.arctan(w0 * t), w0 / (1 + (w0 * t) ** 2)


def of_the_package(model: SolidRmp, dt: float) -> ca.Function:
    """The package's step, which has no residual."""
    x, u = ca.SX.sym("x", 23), ca.SX.sym("u", 11)
    return ca.Function("step", [x, u], [integrators.runge_kutta(model, dt)(x, u), ca.SX(0)])


def test_no_time_is_no_step() -> None:
    with pytest.raises(InvalidInputError, match="dt: must be greater than 0"):
        integrators.runge_kutta(SOLID, 0.0)


@pytest.mark.parametrize(
    ("make", "order"), [(of_the_package, 4), (runge_kutta, 4), (energy_momentum, 2)]
)
def test_masses_let_go_fly_along_straight_lines(make, order: int) -> None:  # type: ignore[no-untyped-def]
    """Two equal pairs spin about the third axis, the CoM falls: known in closed form."""
    w0, r0, t = 2.0, 0.3, 1.0
    q = np.array((0.3, 0, 1.2, 0.1, 0.9, 0, 0, 0, 1, r0, r0, 0.2))
    start = np.concatenate((q, (0, 0, 0.5, -0.4, 0.3, 0, 0, w0, 0, 0, 0)))
    c, rate = SOLID.com(start[:12], start[12:])
    r, slide, angle, spin = flying_apart(t, r0, w0)
    mass = (r, r, 0.2, 0, 0, spin, slide, slide, 0)
    errors = []
    for count in (80, 160, 320):
        end = rollout(make(SOLID, t / count), start, np.zeros(11), count)[-1]
        com, com_rate = SOLID.com(end[:12], end[12:])
        got = np.concatenate((end[9:12], end[17:], com, com_rate, (2 * np.arctan2(*end[7:9]),)))
        fall = c + rate * t - (0, 0, G * t**2 / 2), rate - (0, 0, G * t)
        errors.append(np.abs(got - np.concatenate((mass, *fall, (angle,)))).max())
    assert errors[-1] < 1e-3
    ratios = np.array(errors[:-1]) / errors[1:]
    # Within a fifth of 2^order: the next order's share at these steps.
    np.testing.assert_allclose(ratios, 2.0**order, rtol=0.2)


@pytest.mark.parametrize("kind", (PlanarRmp, SolidRmp, EulerSolidRmp))
def test_a_copied_or_pickled_pendulum_is_the_same(kind: type[PlanarRmp]) -> None:
    model = kind(20.0, 1.62)
    q = np.linspace(0.3, 1.2, len(model.Q))
    for other in (copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        assert repr(other) == repr(model)
        found, expected = (one.functions["mass_matrix"](q).full() for one in (other, model))
        np.testing.assert_array_equal(found, expected)


def test_a_copied_or_pickled_law_commands_the_same() -> None:
    """Laws of processes: a flat foot's ended in a TypeError of a SwigPyObject."""
    model = SolidRmp(35.0)
    q, v = np.array((0.0, 0.0, 1.55, 0.01, 0.7, 0.0, 0.0, 0.0, 1.0, 0.2, 0.2, 0.2)), np.zeros(11)
    sole = ((-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1))
    bounds = LawBounds(polygon=sole, wheel_torque=50.0, wheel_angle=0.6)
    law = MomentumQp(model, bounds, (0.0, 0.0, 0.7), (0.2, 0.2, 0.2), 2e-3)
    expected = law.command(q, v, 0.0).force
    for other in (copy.deepcopy(law), pickle.loads(pickle.dumps(law))):
        np.testing.assert_array_equal(other.command(q, v, 0.0).force, expected)


@pytest.mark.slow
@pytest.mark.parametrize("kind", (PlanarRmp, SolidRmp, EulerSolidRmp))
def test_exported_functions_agree_compiled(kind: type[PlanarRmp], tmp_path: Path) -> None:
    """Without contraction to fused operations, they are those of CasADi's own machine."""
    model = kind(20.0)
    source = export_c(model, tmp_path)
    text = source.read_text()
    assert all(f"int {name}(const casadi_real** arg" in text for name in model.functions)
    assert source.with_suffix(".h").exists()
    if (compiler := shutil.which("cc")) is None:
        pytest.skip("no C compiler")
    library = source.with_suffix(".so")
    flags = ["-O2", "-ffp-contract=off", "-fPIC", "-shared"]
    subprocess.run([compiler, *flags, source, "-o", library, "-lm"], check=True)
    rng = np.random.default_rng(0)
    for name, function in model.functions.items():
        # Between these no pendulum is singular.
        given = [rng.uniform(0.3, 1.2, function.size1_in(k)) for k in range(function.n_in())]
        compiled = ca.external(name, str(library)).call(given)
        for mine, theirs in zip(function.call(given), compiled, strict=True):
            expected = mine.full()
            np.testing.assert_allclose(theirs.full(), expected, atol=1e-12 * abs(expected).max())


def test_an_export_may_have_some_functions_only(tmp_path: Path) -> None:
    text = export_c(PlanarRmp(20.0), tmp_path, ["energies"]).read_text()
    assert "int energies(const" in text
    assert "int bias(const" not in text


def test_exports_of_no_function_or_folder_are_refused(tmp_path: Path) -> None:
    model = PlanarRmp(20.0)
    with pytest.raises(UnknownNameError, match="did you mean 'energies'"):
        export_c(model, tmp_path, ["energy"])
    with pytest.raises(InvalidInputError, match="is not a directory"):
        export_c(model, tmp_path / "missing")


def test_the_command_line_exports_a_pendulum(tmp_path: Path) -> None:
    folder = tmp_path / "made for it"
    arguments = ["codegen", "planar", "--mass", "20", "-o", str(folder), "--function", "bias"]
    done = wbc_command(*arguments)
    assert done.exit_code == 0, done.output
    assert "int bias(const" in (folder / "planarrmp.c").read_text()
    wrong = wbc_command("codegen", "planar", "--mass", "-1", "-o", tmp_path)
    assert wrong.exit_code == 1
    assert "mass: must be greater than 0" in wrong.output
