"""Forces and torques by the unknowns x = (v+, f): each task's error at random x, by hand.

Torques by Pinocchio's recursive Newton-Euler, wrenches by adding up what corners bear.
"""

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from wbc.constraints import Contact, FrictionCone, PointContact
from wbc.controllers import TorqueController
from wbc.controllers.contact_forces import Reaction
from wbc.controllers.dynamics import TickDynamics
from wbc.errors import InvalidInputError
from wbc.robot import Robot, Snapshot
from wbc.tasks import (
    ContactForceTask,
    CopTask,
    ForceRateTask,
    LoadShareTask,
    PostureTask,
    Task,
    TorqueTask,
)

DT = 0.004
FRAMES = ("left_sole", "right_sole", "left_hand")


def dynamics_of(here: Snapshot, contacts: Sequence[Task], last=None) -> TickDynamics:
    """Return what forces and torques are by the unknowns of a controller's tick."""
    robot = here.robot
    controller = TorqueController(robot, [PostureTask(robot, here.q)], contacts=contacts, dt=DT)
    a = controller.core.tick(here, solve=False).views
    return TickDynamics(here, controller.contact_forces, lambda: (a.D, a.offset), last)


def surface_point_and_grip(here: Snapshot) -> list[Contact]:
    return [
        Contact.hold(here, "left_sole", friction=FrictionCone()),
        PointContact.hold(here, "right_sole"),
        Contact.hold(here, "left_hand", friction=None),
    ]


class Tick:
    """A robot on a surface, a point and a grip, with a random decision."""

    def __init__(self, robot: Robot, here: Snapshot, rng: np.random.Generator, last=None) -> None:
        self.dynamics = dynamics_of(here, surface_point_and_grip(here), last)
        self.layout = self.dynamics.forces
        self.v = here.v + 0.1 * rng.normal(size=robot.nv)
        self.f = rng.normal(size=self.layout.size)
        self.x = np.concatenate((self.v, self.f))
        found = Reaction(self.layout, here, self.f).wrenches()
        self.wrenches = {name: np.resize(one, 6) for name, one in found.items()}

    def error(self, task) -> np.ndarray:
        matrix, constant = task.expression(self.dynamics)
        rows = task.force_rows(self.dynamics)
        np.testing.assert_allclose(rows.matrix, matrix * DT / task.robot.mass)
        np.testing.assert_allclose(rows.target, -constant * DT / task.robot.mass)
        np.testing.assert_array_equal(rows.weight, task.weight)
        return matrix @ self.x + constant


@pytest.fixture
def here(hoap2: Robot, rng, random_snapshot) -> Snapshot:
    return random_snapshot(hoap2, rng)


@pytest.fixture
def tick(hoap2: Robot, here: Snapshot, rng) -> Tick:
    return Tick(hoap2, here, rng)


def inverse_dynamics(tick: Tick, here: Snapshot) -> np.ndarray:
    """Return the generalized forces beside the contacts', joints' damping included."""
    robot = here.robot
    data = robot.model.createData()
    tau = pin.rnea(robot.model, data, here.q, here.v, (tick.v - here.v) / DT)
    pin.computeJointJacobians(robot.model, data, here.q)
    pin.updateFramePlacements(robot.model, data)
    for frame, wrench in tick.wrenches.items():
        J = pin.getFrameJacobian(
            robot.model, data, robot.model.getFrameId(frame), pin.LOCAL_WORLD_ALIGNED
        )
        tau = tau - J.T @ wrench
    tau[6:] += robot.damping * tick.v[6:]
    return tau


def test_torques_are_inverse_dynamics(tick: Tick, here: Snapshot, hoap2: Robot, rng) -> None:
    tau = inverse_dynamics(tick, here)
    size = np.abs(tau).max()
    dynamics = tick.dynamics
    matrix, offset = dynamics.physics()
    found = dynamics.unit * (matrix @ tick.x + offset)
    np.testing.assert_allclose(found, tau, atol=1e-9 * size)
    np.testing.assert_allclose(dynamics.torques(tick.x), tau[6:], atol=1e-9 * size)
    some = [3, 0, 7]
    one = dynamics.torque(some)
    np.testing.assert_allclose(one.matrix @ tick.x + one.constant, tau[6:][some], atol=1e-9 * size)
    assert (dynamics.size, dynamics.contacts) == (tick.x.size, tick.layout.frames)
    assert dynamics.unit == hoap2.mass / DT
    wanted = rng.normal(size=hoap2.nv - 6)
    np.testing.assert_allclose(
        tick.error(TorqueTask(hoap2, wanted)), tau[6:] - wanted, atol=1e-9 * size
    )
    name, other = hoap2.joint_names[4], hoap2.joint_names[2]
    task = TorqueTask(hoap2, {name: 3.0}, joints=[name, other])
    assert task.rows == (other, name)
    expected = tau[6:][[2, 4]] - [0.0, 3.0]
    np.testing.assert_allclose(tick.error(task), expected, atol=1e-9 * size)
    np.testing.assert_allclose(tick.error(TorqueTask(hoap2, 2.0, joints=[name])),
                               tau[6:][[4]] - 2.0, atol=1e-9 * size)  # fmt: skip


def test_wrenches_shares_and_changes(tick: Tick, here: Snapshot, hoap2: Robot, rng) -> None:
    target = rng.normal(size=6)
    for frame in FRAMES:
        task = ContactForceTask(hoap2, frame, target)
        np.testing.assert_allclose(tick.error(task), tick.wrenches[frame] - target, atol=1e-9)
    some = ContactForceTask(hoap2, "left_hand", target, components=("mz", "fx"))
    np.testing.assert_allclose(tick.error(some), (tick.wrenches["left_hand"] - target)[[5, 0]])
    assert some.units == ("N m", "N")
    away = ContactForceTask(hoap2, "right_hand", target)
    np.testing.assert_allclose(tick.error(away), -target, err_msg="a frame that is no contact")
    shares = {"left_sole": 1.0, "right_hand": 5.0, "right_sole": 3.0}
    vertical = [tick.wrenches[frame][2] for frame in ("left_sole", "right_sole")]
    found = tick.error(LoadShareTask(hoap2, shares))
    whole = sum(vertical)
    expected = [vertical[0] - 0.25 * whole, 0.0, vertical[1] - 0.75 * whole]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    lone = LoadShareTask(hoap2, {"right_hand": 1.0})
    np.testing.assert_array_equal(tick.error(lone), [0.0])
    # Changes: none in a first tick; of a contact that is new from nothing.
    frames = [*FRAMES, "right_hand"]
    task = ForceRateTask(hoap2, frames)
    np.testing.assert_array_equal(tick.error(task), np.zeros(24))
    last = {"left_sole": rng.normal(size=6), "right_hand": rng.normal(size=6)}
    later = Tick(hoap2, here, rng, SimpleNamespace(wrenches=lambda: last))
    none = np.zeros(6)
    parts = [later.wrenches[frame] - last.get(frame, none) for frame in FRAMES]
    np.testing.assert_allclose(later.error(task), np.concatenate((*parts, none)), atol=1e-9)
    assert ForceRateTask(hoap2).frames == ("left_sole", "right_sole")
    for one in (task, lone):  # their rows are those of the frames
        with pytest.raises(InvalidInputError, match="frames cannot be assigned; make another"):
            one.frames = ("left_sole",)
    assert task.units == ("N", "N", "N", "N m", "N m", "N m") * 4


@pytest.mark.parametrize("levels", [1, 2])
def test_error_of_a_cop_is_the_moment_about_the_wanted_point(hoap2: Robot, rng, levels) -> None:
    """Of all contacts about a point in the world or at their mean height; of one in its plane."""
    here = hoap2.snapshot(hoap2.posture("standing"), 0.01 * rng.normal(size=hoap2.nv))
    held = surface_point_and_grip(here)
    point, own = rng.normal(size=3), [0.1, -0.2]
    cops = [
        CopTask(hoap2, point, name="at", weight=1e-3),
        CopTask(hoap2, point[:2], name="flat", weight=0.1, priority=levels - 1),
        CopTask(hoap2, own, frame="left_hand"),
        CopTask(hoap2, own, frame="right_hand"),  # no contact
    ]
    tasks = [PostureTask(hoap2, here.q), *cops]
    tick = TorqueController(hoap2, tasks, contacts=held, dt=DT).step(here)
    assert tick.ok, tick.report()

    def moment_about(point: np.ndarray) -> np.ndarray:
        return sum(
            wrench[3:] + np.cross(here.position(frame) - point, wrench[:3])
            for frame, wrench in tick.forces.items()
        )

    mean = np.mean([here.position(frame)[2] for frame in FRAMES])
    R, wrench = here.rotation("left_hand"), tick.forces["left_hand"]
    expected = {
        "at": moment_about(point),
        "flat": moment_about(np.r_[point[:2], mean]),
        "left_hand cop": R.T @ (wrench[3:] + np.cross(-R @ [*own, 0.0], wrench[:3])),
        "right_hand cop": np.zeros(3),
    }
    for name, moment in expected.items():
        np.testing.assert_allclose(tick.errors[name], moment[:2], atol=1e-9, err_msg=name)
    # And what is wanted is had, where nothing else is.
    near = CopTask(hoap2, here.com[:2] + 0.01, name="near", weight=1e3)
    light = PostureTask(hoap2, here.q, weight=1e-3)
    alone = TorqueController(hoap2, [light, near], contacts=held, dt=DT).step(here)
    assert np.abs(alone.errors["near"]).max() < 1e-3
