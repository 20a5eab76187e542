"""The motion of a plan at any time, and against the equations of motion of the pendulums."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.rmp.plan.conftest import HEIGHT, LIMITS
from wbc.errors import InvalidInputError
from wbc.rmp.plan import (
    Plan,
    PlanPhase,
    PlanProblem,
    State,
    Weights,
    at_rest,
    check,
    generalised,
    rectangle,
    solve,
)
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp

STILL = (0.0, 0.0, 0.0)
SQUARE = rectangle(0.0, 0.0, 0.22, 0.3)
Planned = Callable[[str], Plan]


@pytest.mark.parametrize("name", ["push", "push and step", "hop", "walk"])
def test_solid_pendulum_confirms_the_forces(name: str, planned: Planned) -> None:
    plan = planned(name)
    pendulum = plan.problem.pendulum
    m = plan.at(np.linspace(0.0, plan.starts[1] - 1e-6, 25))
    moved = generalised(plan, m)
    for q, v, a, f, i in zip(moved.q, moved.v, moved.a, moved.forces, range(25), strict=True):
        # Forces reach 500 N: a relative 1e-11.
        np.testing.assert_allclose(pendulum.inverse_dynamics(q, v, a), f, atol=1e-8)
        np.testing.assert_allclose(pendulum.ground_reaction(q, v, a), m.force[i], atol=1e-8)
        c, rate = pendulum.com(q, v)
        np.testing.assert_allclose((c, rate), (m.com[i], m.com_velocity[i]), atol=1e-12)
        np.testing.assert_allclose(pendulum.momenta(q, v)[0], m.momentum[i], atol=1e-11)
        np.testing.assert_allclose(pendulum.momentum_rate(q, f), m.momentum_rate[i], atol=1e-10)


def _flat(pendulum: PlanarRmp | SolidRmp) -> PlanProblem:
    radii = (0.2, 0.2, 0.2)
    start = replace(at_rest((0.0, 0.0, HEIGHT), radii), com_velocity=(0.3, 0.0, 0.0))
    return PlanProblem(
        pendulum,
        (PlanPhase("stand", 1.5, SQUARE, 20),),
        start=start,
        goal=at_rest((0.0, 0.0, HEIGHT), radii),
        nominal=State(com=(None, None, HEIGHT), rotation=STILL, radii=radii),
        limits=LIMITS,
        # r_2 has no part in the plane: without cost, r_1 and r_3 are alike in the solid too.
        weights=Weights(),
    )


def test_planar_plan_is_the_solid_one_in_its_plane() -> None:
    solid, planar = solve(_flat(SolidRmp(30.0))), solve(_flat(PlanarRmp(30.0)))
    assert planar.stats.variables < solid.stats.variables
    for name, within in (("com", 1e-9), ("momentum", 1e-7), ("force", 1e-6), ("radii", 1e-6)):
        one, other = getattr(solid.knots, name), getattr(planar.knots, name)
        np.testing.assert_allclose(one, other, atol=within)  # IPOPT's tolerance
    pendulum, moved = planar.problem.pendulum, generalised(planar, planar.knots)
    for q, v, a, f in zip(moved.q, moved.v, moved.a, moved.forces, strict=True):
        np.testing.assert_allclose(pendulum.inverse_dynamics(q, v, a), f, atol=1e-9)
        assert f[0] == 0.0
    assert check(planar, 4).ok


def test_at_meets_the_knots_and_refuses_what_lies_outside(planned: Planned) -> None:
    plan = planned("hop")
    k = plan.knots
    inside = np.flatnonzero(np.append(np.diff(k.phase) == 0, True))  # the later of two at a time
    inside = inside[k.time[inside] < plan.duration]
    m = plan.at(k.time[inside])
    np.testing.assert_allclose(m.com, k.com[inside], atol=1e-8)
    np.testing.assert_allclose(m.force, k.force[inside], atol=1e-6)
    with pytest.raises(InvalidInputError, match="within the plan"):
        plan.at(plan.duration + 0.1)
    with pytest.raises(InvalidInputError, match="in flight"):
        generalised(plan, plan.at(plan.starts[1] + 0.01))
