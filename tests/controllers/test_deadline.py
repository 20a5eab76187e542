"""Once the deadline is over nothing is solved again: commands are safe, and say what they lack."""

import numpy as np

from tests.controllers.test_look_ahead import Slow, moving
from wbc.constraints import FrictionCone, Limits, SelfCollision, support
from wbc.controllers import KinematicController, TorqueController
from wbc.controllers.look_ahead import CUTS
from wbc.tasks import ComTask, PostureTask

AT_ONCE = 1e-9  # s


def test_ticks_of_one_attempt_lack_nothing(hoap2) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    tasks = [ComTask(hoap2, here.com + 0.01), PostureTask(hoap2, here.q, priority=1)]
    for kind in (KinematicController, TorqueController):
        parts = {"contacts": support(here, "double"), "constraints": [SelfCollision(hoap2)]}
        free, late = (
            kind(hoap2, tasks, limits=Limits(hoap2), deadline=deadline, **parts).step(here)
            for deadline in (None, AT_ONCE)
        )
        assert late.ok and late.left_out == () and late.report() == "solved"
        np.testing.assert_array_equal(late.velocity, free.velocity)


def test_cuts_that_came_too_late_are_said_and_the_step_is_shorter(hoap2) -> None:
    """All of the step would break the margin; a quarter, which needs no QP, does not."""
    here = hoap2.snapshot(hoap2.posture("standing"))
    ticks = []
    for deadline in (None, 60.0, AT_ONCE):
        constraint = Slow(hoap2, 0.5, useful=True)
        constraint.start = here.q
        control = moving(hoap2, constraint, "left_elbow_pitch", deadline=deadline)
        tick = control.step(here)
        lower, upper = control.limits.box(here, control.dt)
        assert tick.ok and (tick.velocity >= lower).all() and (tick.velocity <= upper).all()
        assert np.abs(tick.velocity).max() <= 0.5 + 1e-6
        ticks.append(tick)
    *free, late = ticks
    assert all(tick.left_out == () and tick.step_scale == 1.0 for tick in free)
    assert late.left_out == (CUTS,) and 0.0 < late.step_scale < 1.0
    assert late.report() == f"solved, but left out: {CUTS}"


def test_torque_ticks_give_way_in_time(hoap2) -> None:
    """What is relaxed once the deadline is over keeps physics and torque bounds all the same."""
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    contacts = support(here, "double", friction=FrictionCone(least=10.0 * hoap2.weight))
    control = TorqueController(
        hoap2, [PostureTask(hoap2, here.q)], contacts=contacts, limits=Limits(hoap2),
        force_ramp=0.0, deadline=AT_ONCE,
    )  # fmt: skip
    tick = control.step(here)
    assert tick.policy == "relax" and np.isfinite(tick.velocity).all()
    assert (np.abs(tick.torque) <= control.torque_bounds).all()
    assert "not everything could be kept" in tick.report()
    assert tick.conflict is not None or tick.left_out
