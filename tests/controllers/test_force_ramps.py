"""Contacts that come and go: bounds on their forces, and torques that do not jump."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import wbc
from tests.standing import standing
from wbc.constraints import support
from wbc.controllers.closed_loop import ticks_of
from wbc.controllers.force_ramps import ForceRamps
from wbc.errors import UnknownNameError
from wbc.minimum_jerk import minimum_jerk
from wbc.robot import Robot, Snapshot

DT, RAMP = 0.002, 0.05
TICKS = 25  # of a ramp
# When the CoM is over the left foot, that foot is released, it is down again, held, CoM between.
OVER, RELEASE, UP, DOWN, LAND, BACK, END = 1.0, 1.2, 1.55, 1.95, 2.4, 2.5, 3.1


@pytest.fixture
def here(g1: Robot) -> Snapshot:
    return standing(g1)


def controlled(here: Snapshot, solver: str = "daqp") -> wbc.TorqueController:
    robot = here.robot
    tasks: list[wbc.Task] = [
        wbc.ComTask(robot, here.com, weight=10.0),
        wbc.OrientationTask(robot, "base", here.rotation("base"), weight=3.0),
        wbc.PostureTask(robot, here.q, weight=0.3),
        wbc.PoseTask(
            robot,
            "right_sole",
            here.position("right_sole"),
            here.rotation("right_sole"),
            weight=30.0,
            kp=400.0,
            name="swing",
        ),
        wbc.LoadShareTask(robot, {"left_sole": 1.0, "right_sole": 1.0}),
    ]
    return wbc.TorqueController(
        robot,
        tasks,
        contacts=wbc.support(here, "double"),
        limits=wbc.Limits(robot),
        dt=DT,
        solver=solver,
    )


class Integrated:
    """The model itself: where the tick's own acceleration leads."""

    def __init__(self, here: Snapshot) -> None:
        self.robot, self.q, self.v = here.robot, here.q, here.v

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        return self.q, self.v

    def follow(self, tick: wbc.TorqueTick) -> None:
        self.v = self.v + DT * tick.acceleration
        self.q = self.robot.integrate(self.q, self.v, DT)


class Simulated:
    """The same in MuJoCo."""

    def __init__(self, here: Snapshot) -> None:
        from wbc.simulation import Plant

        self.plant = Plant(here.robot, dt=DT)
        self.plant.reset(here.q)

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        return self.plant.state()

    def follow(self, tick: wbc.TorqueTick) -> None:
        self.plant.step(tick.torque)


def step_in_place(
    here: Snapshot, loop: Integrated | Simulated, ramp: float, end: float = END
) -> list:
    """Shift the CoM, lift the right foot by 3 cm, put it down again, stand on both."""
    robot, controller = here.robot, controlled(here)
    com, swing = controller.tasks[0], controller.tasks[3]
    assert isinstance(com, wbc.ComTask) and isinstance(swing, wbc.PoseTask)
    left = here.position("left_sole")
    below = 0.001 if isinstance(loop, Simulated) else 0.0  # pressed on real ground before it counts
    aside = np.array([left[0] + 0.02 - here.com[0], left[1] - 0.02 - here.com[1], 0.0])
    ticks = []
    for k in range(round(end / DT)):
        t, s = k * DT, robot.snapshot(*loop.state())
        gone = minimum_jerk(np.clip(t / OVER, 0, 1)) - minimum_jerk(
            np.clip((t - BACK) / (END - BACK), 0, 1)
        )
        rise = minimum_jerk(np.clip((t - RELEASE - 0.06) / (UP - RELEASE - 0.06), 0, 1))
        fall = minimum_jerk(np.clip((t - UP) / (DOWN - UP), 0, 1))
        height = 0.03 * (rise - fall) - below * fall
        com.set_target(here.com + gone * aside)
        swing.set_target(here.position("right_sole") + [0, 0, height], here.rotation("right_sole"))
        if k == round(RELEASE / DT):
            controller.set_contacts(controller.contacts[:1], ramp)
        if k == round(LAND / DT):
            new = wbc.Contact.hold(s, "right_sole")
            controller.set_contacts([*controller.contacts, new], ramp)
        tick = controller.step(s)
        assert tick.ok and tick.policy is None, (t, tick.report())
        loop.follow(tick)
        ticks.append(tick)
    return ticks


def jumps(ticks: list, begin: float) -> float:
    """Return the largest change of a torque from tick to tick in a ramp that begins then [N m]."""
    first = round(begin / DT)
    torques = np.array([tick.torque for tick in ticks[first - 1 : first + TICKS + 3]])
    return float(np.abs(np.diff(torques, axis=0)).max())


@pytest.mark.slow
@pytest.mark.parametrize("loop", [Integrated, Simulated])
def test_a_foot_is_lifted_and_put_down_without_jumps(loop: type, here: Snapshot) -> None:
    """The normal force changes by m g / TICKS a tick, 13 N, at no lever above 0.4 m.

    That is the distance from a hip to the edge of the other sole, with which a leg's own torque
    bears the load that it takes from the other. Without a ramp the jump is several times that.
    On MuJoCo's ground, which gives way and knocks, a landing is a matter of the ground too.
    """
    if loop is Simulated:
        pytest.importorskip("mujoco")
    weight = 9.81 * here.robot.mass
    bound = 0.4 * weight / TICKS
    ticks = step_in_place(here, loop(here), RAMP)
    assert jumps(ticks, RELEASE) < bound
    lifted = ticks[round(UP / DT)]
    assert set(lifted.forces) == {"left_sole"} and not lifted.ramps
    loads = [tick.forces.get("right_sole", np.zeros(6))[2] for tick in ticks]
    first = round(RELEASE / DT)
    assert (np.diff(loads[first : first + TICKS]) < 0.0).all()
    assert loads[first + TICKS - 2] < 0.1 * loads[first - 1] and loads[first + TICKS] == 0.0
    for tick, load in zip(ticks, loads, strict=True):
        # The world's z; a sole that is tilted by a milliradian has a little more along it.
        assert load <= tick.ramps.get("right_sole", np.inf) + 1e-3 * weight
    assert ticks[-1].forces["right_sole"][2] > 0.3 * weight
    running = np.flatnonzero([bool(tick.ramps) for tick in ticks]) * DT
    assert len(running) == 2 * (TICKS - 1)
    np.testing.assert_allclose(running[[0, -1]], [RELEASE, LAND + RAMP - 2 * DT], atol=1e-9)
    sudden = step_in_place(here, loop(here), 0.0, LAND + 2 * RAMP)
    assert jumps(sudden, RELEASE) > 3.0 * jumps(ticks, RELEASE)
    assert jumps(sudden, LAND) > 3.0 * bound
    assert not any(tick.ramps for tick in sudden)
    if loop is Integrated:
        assert jumps(ticks, LAND) < bound
    else:
        assert jumps(ticks, LAND) < 0.6 * jumps(sudden, LAND)


@pytest.mark.parametrize("solver", ["proxqp", "daqp"])
def test_a_contact_that_comes_back_goes_on_from_where_it_is(solver: str, here: Snapshot) -> None:
    controller = controlled(here, solver)
    both = controller.contacts
    half = controller.step(here).forces["right_sole"][2]
    controller.set_contacts(both[:1], RAMP)
    for _ in range(5):
        tick = controller.step(here)
    assert tick.ramps["right_sole"] == pytest.approx(half * (1 - 5 / TICKS), rel=1e-6)
    controller.set_contacts(both[:1], RAMP)  # again: nothing new
    assert controller.step(here).ramps["right_sole"] == pytest.approx(half * (1 - 6 / TICKS))
    controller.set_contacts(both, RAMP)
    back = controller.step(here).ramps["right_sole"]
    assert half * (1 - 6 / TICKS) < back < half
    for _ in range(TICKS):
        tick = controller.step(here)
    assert not tick.ramps and set(tick.forces) == {"left_sole", "right_sole"}


def test_a_contact_that_leaves_is_gone_whatever_else_is_changed_meanwhile(here: Snapshot) -> None:
    controller = controlled(here)
    left, right = controller.contacts
    controller.step(here)
    controller.set_contacts([left], RAMP)
    before = controller.step(here).ramps["right_sole"]
    controller.change(tasks=controller.tasks[:3], slack={"left_sole": 1e4})
    assert controller.contacts == (left, right)  # still: its forces have not gone
    assert 0.0 < controller.step(here).ramps["right_sole"] < before
    for _ in range(TICKS):
        tick = controller.step(here)
    assert controller.contacts == (left,) and not tick.ramps


def test_nothing_ramps_before_the_first_tick_or_at_once(here: Snapshot) -> None:
    controller = controlled(here)
    left, right = controller.contacts
    controller.set_contacts([left])
    assert controller.contacts == (left,)
    controller.set_contacts([left, right])
    assert not controller.step(here).ramps
    controller.set_contacts([left], ramp=0.0)
    tick = controller.step(here)
    assert set(tick.forces) == {"left_sole"} and not tick.ramps
    again = wbc.Contact.hold(here, "left_sole")  # the same contact, anchored anew
    controller.set_contacts([again])
    assert not controller.step(here).ramps and controller.contacts == (again,)


def test_grips_come_at_once_and_least_forces_wait(g1: Robot, here: Snapshot) -> None:
    controller = controlled(here)
    left, right = controller.contacts
    controller.set_contacts([left], ramp=0.0)
    controller.step(here)
    hand = next(name for name in g1.frame_names if "wrist_yaw" in name)
    right.friction = wbc.FrictionCone(least=50.0)
    controller.set_contacts([left, right, wbc.Contact.hold(here, hand, friction=None)])
    tick = controller.step(here)
    assert set(tick.ramps) == {"right_sole"} and tick.policy is None, tick.report()
    assert hand in tick.forces
    cap = tick.ramps["right_sole"]
    assert tick.forces["right_sole"][2] == pytest.approx(cap, abs=1e-3) and cap < 50.0


def test_a_contact_with_slack_is_not_left_out_alone(hoap2: Robot) -> None:
    """Else the name would be missed when its force has gone, in the middle of a step."""
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    controller = wbc.TorqueController(
        hoap2,
        [wbc.PostureTask(hoap2, here.q)],
        contacts=wbc.support(here, "double"),
        slack={"left_sole": 1e3},
        solver="daqp",
    )
    controller.step(here)
    with pytest.raises(UnknownNameError, match="left_sole"):
        controller.set_contacts(wbc.support(here, "right"))
    controller.change(contacts=wbc.support(here, "right"), slack={})
    for k in range(TICKS + 2):
        tick = controller.step(here)
        going = "left_sole" in tick.forces
        assert going == ("left_sole" in tick.ramps) == (k + 1 < TICKS)
        hard = {name.split()[0] for name in tick.qp.labels.equality}
        assert "right_sole" in hard and "left_sole" not in hard, "it leaves as soft as it was"
    for _ in range(30):  # beyond the ramp of 50 ms
        tick = controller.step(here)
    assert set(tick.forces) == {"right_sole"}


def test_a_grip_in_place_of_a_contact_that_comes_has_no_ramp(hoap2: Robot) -> None:
    """It has no normal force to bound; the tick said that it had."""
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    both = left, right = wbc.support(here, "double")
    controller = wbc.TorqueController(hoap2, [wbc.ComTask(hoap2, here.com)], contacts=[left])
    controller.step(here)
    controller.set_contacts(both)
    assert controller.step(here).ramps.keys() == {right.name}
    controller.set_contacts([left, wbc.Contact.hold(here, right.name, friction=None)])
    assert not controller.step(here).ramps


@pytest.mark.parametrize("ticks", [1, 2, 4])
def test_bounds_by_hand_tick_by_tick(ticks: int, hoap2: Robot) -> None:
    """From 0 up to the weight, and from what was borne down to 0, in equal steps; then none."""
    here = hoap2.snapshot(hoap2.posture("standing"))
    left, right = support(here, "double")
    ramps = ForceRamps(100.0)
    assert ramps.change([left], [right], {"left_sole": 60.0}, ticks) == (right, left)
    for done in range(ticks):
        expected = {"left_sole": 60.0 * (1 - done / ticks), "right_sole": 100.0 * done / ticks}
        assert ramps.most == pytest.approx(expected)
        gone = ramps.advance()
        assert gone == ({"left_sole"} if done == ticks - 1 else set())
    assert ramps.most == {} and ramps.advance() == frozenset()
    # At once, and what bears nothing (or what rounding leaves of that): neither goes slowly.
    assert ramps.change([left], [right], {"left_sole": 60.0}, 0) == (right,)
    assert ramps.most == {}
    for nothing in (0.0, 1e-9):
        assert ramps.change([left], [right], {"left_sole": nothing}, ticks) == (right,)
    assert set(ramps.most) == {"right_sole"}


@pytest.mark.parametrize(("duration", "dt", "ticks"), [
    (0.05, 0.01, 5), (0.05, 0.005, 10), (0.051, 0.01, 6), (0.0, 0.01, 0), (0.3, 0.1, 3),
    (0.0501, 0.002, 26),
])  # fmt: skip
def test_a_ramp_lasts_as_long_as_it_is_told(duration: float, dt: float, ticks: int) -> None:
    assert ticks_of(duration, dt) == ticks


def test_the_ramps_of_a_copy_are_its_own(here: Snapshot) -> None:
    """It takes the same robot's snapshots, and what it does is not felt by the original."""
    one = controlled(here, "active_set")
    one.step(here)
    one.set_contacts(wbc.support(here, "left"))
    other = copy.copy(one)
    ramps = [other.step(here).ramps for _ in range(5)]
    assert [one.step(here).ramps for _ in range(5)] == ramps
    assert other.tasks == one.tasks
