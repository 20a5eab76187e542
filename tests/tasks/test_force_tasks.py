"""Tasks about forces and torques against statics in closed form and another solver."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

import wbc
from tests.standing import stack, standing
from wbc.errors import InvalidInputError, WbcError
from wbc.robot import Robot, Snapshot
from wbc.tasks import Affine, Dynamics, ForceTask, Task

Load = Callable[[str], Robot]
FEET = ("left_sole", "right_sole")


@pytest.fixture
def here(g1: Robot) -> Snapshot:
    return standing(g1)


def controlled(here: Snapshot, *extra: Task, tasks: Sequence[Task] | None = None, **keys):  # type: ignore[no-untyped-def]
    keys.setdefault("contacts", wbc.support(here, "double"))
    given = stack(here) if tasks is None else tasks
    return wbc.TorqueController(here.robot, [*given, *extra], **keys)


def tick_with(here: Snapshot, *extra: Task, **keys) -> wbc.TorqueTick:  # type: ignore[no-untyped-def]
    tick = controlled(here, *extra, **keys).step(here)
    assert tick.ok and tick.policy is None, tick.report()
    return tick


def still(tick: wbc.TorqueTick) -> bool:
    return float(np.abs(tick.acceleration).max()) < 0.1


@pytest.mark.parametrize("name", ["g1", "talos", "hoap2_like"])
@pytest.mark.parametrize("solver", ["proxqp", "daqp"])
def test_a_load_is_shared_as_asked(name: str, solver: str, robot_named: Load) -> None:
    """The load m g is a constant of the stance; what is asked of it stays within the soles."""
    here = standing(robot_named(name))
    feet = [foot.frame for foot in here.robot.feet.values()]
    share = wbc.LoadShareTask(here.robot, dict(zip(feet, (3.0, 2.0), strict=True)), weight=100.0)
    tick = tick_with(here, share, solver=solver)
    loads = [tick.forces[frame][2] for frame in feet]
    assert loads[0] / sum(loads) == pytest.approx(0.6, abs=1e-3)
    assert sum(loads) == pytest.approx(9.81 * here.robot.mass, rel=1e-3)
    assert still(tick)
    np.testing.assert_allclose(tick.errors["load share"], loads - sum(loads) * np.array([0.6, 0.4]))
    share.set_target([1.0, 1.0])
    loads = [force[2] for force in tick_with(here, share, solver=solver).forces.values()]
    assert loads[0] == pytest.approx(loads[1], rel=1e-3)


def test_a_wanted_wrench_is_met(g1: Robot, here: Snapshot) -> None:
    """Soles pressing apart by 20 N are internal forces: nothing moves for them."""
    press = wbc.ContactForceTask(
        g1, "left_sole", [0, 20.0, 0, 0, 0, 0], components=["fy"], weight=100.0
    )
    tick = tick_with(here, press)
    assert tick.forces["left_sole"][1] == pytest.approx(20.0, abs=0.05)
    assert tick.forces["right_sole"][1] == pytest.approx(-20.0, abs=0.5)
    assert tick.errors["left_sole force"] == pytest.approx(tick.forces["left_sole"][1:2] - 20.0)
    assert press.units == ("N",) and still(tick)


def test_cop_of_one_contact_is_where_it_is_wanted(g1: Robot, here: Snapshot) -> None:
    """Oracle: the wrench's own moment, over its normal force, in the sole's axes."""
    wanted = np.array([0.03, -0.01])
    aim = wbc.CopTask(g1, wanted, frame="left_sole", weight=100.0)
    tick = tick_with(here, aim)
    R, wrench = here.rotation("left_sole"), tick.forces["left_sole"]
    force, about = R.T @ wrench[:3], R.T @ wrench[3:]
    np.testing.assert_allclose([-about[1] / force[2], about[0] / force[2]], wanted, atol=1e-4)
    assert aim.units == ("N m", "N m")


def test_cop_of_all_contacts_moves_the_robot(g1: Robot, here: Snapshot) -> None:
    """A CoP off the CoM's projection accelerates it: zddot = 0 gives m c'' = m g/h (c - p)."""
    wanted = here.com[:2] + [0.02, 0.01]
    aim = wbc.CopTask(g1, wanted, weight=1e3)
    tick = tick_with(here, aim)
    assert tick.cop is not None
    np.testing.assert_allclose(tick.cop[:2], wanted, atol=1e-4)
    aim.set_target(np.append(wanted, tick.cop[2]))  # the same point, in the world
    there = tick_with(here, aim).cop
    np.testing.assert_allclose(there, tick.cop, atol=1e-5)
    assert (tick.acceleration[:2] * [1.0, 1.0] < 0.0).all()


def test_least_torques_are_those_of_another_solver(g1: Robot, here: Snapshot) -> None:
    """Oracle: SciPy's least squares over forces that hold the robot still, no cones active."""
    from scipy.linalg import null_space

    still_tasks = [wbc.PostureTask(g1, here.q, weight=1e2)]
    hold = [wbc.FrictionCone(5.0), wbc.FrictionCone(5.0)]
    contacts = wbc.support(here, "double")
    for contact, cone in zip(contacts, hold, strict=True):
        contact.friction = cone
    tick = tick_with(
        here,
        wbc.TorqueTask(g1, weight=1.0),
        tasks=still_tasks,
        contacts=contacts,
        force_damping=1e-6,
        solver="daqp",
        torque_limits=None,
    )
    J = np.concatenate([here.jacobian(frame) for frame in FEET])
    base, joints = J[:, :6].T, J[:, 6:].T
    bias = here.mass_matrix @ tick.acceleration + here.bias
    some, free = np.linalg.pinv(base) @ bias[:6], null_space(base)
    z, *_ = np.linalg.lstsq(joints @ free, bias[6:] - joints @ some, rcond=None)
    least = bias[6:] - joints @ (some + free @ z)
    forces = some + free @ z
    assert forces[2] > 0.0 and forces[8] > 0.0
    size = np.abs(least).max()
    np.testing.assert_allclose(tick.torque, least, atol=1e-3 * size)
    plain = tick_with(here, tasks=still_tasks, torque_limits=None).torque
    assert np.abs(plain - least).max() > 0.02 * size


def test_torques_near_a_reference(g1: Robot, here: Snapshot) -> None:
    places = [k for k, name in enumerate(g1.joint_names) if "knee" in name]
    wanted = tick_with(here).torque[places].mean() + 3.0
    knees = wbc.TorqueTask(g1, {"*knee*": wanted}, joints=["*knee*"], weight=1e3)
    tick = tick_with(here, knees)
    assert len(places) == 2
    np.testing.assert_allclose(tick.torque[places], wanted, atol=0.02)
    np.testing.assert_allclose(tick.errors["torque"], tick.torque[places] - wanted, atol=1e-9)
    with pytest.raises(InvalidInputError, match=r"'\*ankle\*' is no joint of the task"):
        knees.set_target({"*ankle*": 1.0})


def test_force_rate_slows_what_forces_do(g1: Robot, here: Snapshot) -> None:
    """A load that is to go to one foot gets there at once without it, and gradually with it."""

    def loads(*extra: Task) -> list[float]:
        share = wbc.LoadShareTask(g1, dict.fromkeys(FEET, 1.0))
        controller = controlled(here, share, *extra)
        controller.step(here)
        share.set_target([3.0, 2.0])
        return [controller.step(here).forces["left_sole"][2] for _ in range(60)]

    weight = 9.81 * g1.mass
    plain, slow = loads(), loads(wbc.ForceRateTask(g1, weight=3.0))
    assert plain[0] == pytest.approx(plain[-1], rel=1e-3)
    assert plain[0] > 0.59 * weight
    assert 0.5 * weight < slow[0] < 0.52 * weight
    assert (np.diff(slow) > -1e-6 * weight).all()
    assert slow[-1] == pytest.approx(plain[-1], rel=0.01)


def test_force_rate_is_nothing_in_the_first_tick(here: Snapshot) -> None:
    rate = wbc.ForceRateTask(here.robot, weight=100.0)
    with_rate, without = tick_with(here, rate, solver="daqp"), tick_with(here, solver="daqp")
    np.testing.assert_allclose(with_rate.torque, without.torque, atol=1e-6)


def test_priorities_are_strict(g1: Robot, here: Snapshot) -> None:
    """A share that motion above does not care about is met; a torque below changes neither."""
    motion = stack(here)
    share = wbc.LoadShareTask(g1, dict(zip(FEET, (0.6, 0.4), strict=True)), weight=10.0, priority=1)
    lazy = wbc.TorqueTask(g1, weight=10.0, priority=2)
    upper = tick_with(here, tasks=motion)
    tick = tick_with(here, share, lazy, tasks=motion)
    np.testing.assert_allclose(tick.velocity, upper.velocity, atol=1e-6)
    loads = [tick.forces[frame][2] for frame in FEET]
    assert loads[0] / sum(loads) == pytest.approx(0.6, abs=1e-3)
    only_below = tick_with(here, share, tasks=motion)
    assert np.linalg.norm(tick.torque) < np.linalg.norm(only_below.torque)


def test_the_kinematic_controller_refuses_them_by_name(g1: Robot, here: Snapshot) -> None:
    aim = wbc.CopTask(g1, [0.0, 0.0], name="pressure")
    with pytest.raises(InvalidInputError, match=r"'pressure'.*TorqueController"):
        wbc.KinematicController(g1, [*stack(here), aim], contacts=())
    with pytest.raises(InvalidInputError, match=r"'pressure'.*forces"):
        wbc.KinematicController(g1, stack(here), contacts=[aim])
    with pytest.raises(InvalidInputError, match=r"'pressure'.*forces"):
        aim.residual(here)


@pytest.mark.parametrize(("rows", "numbers"), [(6, 6), (6, 2), (2, 6), (2, 1), (2, 2)])
def test_an_expression_of_another_shape_is_refused(g1, here, rows, numbers) -> None:
    """Either of its parts is enough, and so is a third one."""

    class Wrong(ForceTask):
        def expression(self, dynamics: Dynamics) -> Affine:
            parts = dynamics.wrench("left_sole")[:rows], np.zeros(numbers)
            return (*parts, 0.0) if (rows, numbers) == (2, 2) else Affine(*parts)

    said = r"'mine': expression\(\), (matrix|constant): expected shape \(2,"
    if (rows, numbers) == (2, 2):
        said = r"'mine', which has 2 rows: expression\(\) must return matrix"
    with pytest.raises(InvalidInputError, match=said):
        controlled(here, Wrong(g1, "mine", ["fx", "fy"])).step(here)


def test_which_points_a_cop_may_be_given_depends_on_its_frame(g1) -> None:
    with pytest.raises(InvalidInputError, match=r"a point \(2,\), in the frame's plane"):
        wbc.CopTask(g1, [0.0, 0.0, 0.0], frame="left_sole")
    with pytest.raises(InvalidInputError, match=r"a point \(2,\) or \(3,\), got"):
        wbc.CopTask(g1, [0.0])
    everywhere = wbc.CopTask(g1, [0.0, 0.0, 0.1])
    assert everywhere.target.tolist() == [0.0, 0.0, 0.1]
    with pytest.raises(InvalidInputError, match="frame cannot be assigned; make another task"):
        everywhere.frame = "left_sole"


def test_a_frame_that_is_assigned_is_one_of_the_robot(g1: Robot, here: Snapshot) -> None:
    press = wbc.ContactForceTask(g1, "left_sole", [0, 0, 50.0, 0, 0, 0], components=["fz"])
    for wrong in ("left_soul", None):
        with pytest.raises(WbcError, match="unknown frame"):
            press.frame = wrong
    press.frame = "right_sole"
    tick = controlled(here, press, contacts=wbc.support(here, "left")).step(here)
    assert tick.errors[press.name] == pytest.approx([-50.0])
