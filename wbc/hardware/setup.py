"""Builds a loop, and a simulated robot, from a problem and a profile."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from wbc.errors import InvalidInputError, listed
from wbc.estimation import ImuMount
from wbc.hardware.bus import Bus, RobotBus
from wbc.hardware.loop import PERIOD, HardwareLoop
from wbc.hardware.operator import Operator
from wbc.hardware.postures import CrouchPath, Motions, PostureMotion
from wbc.hardware.ring_log import RingLog
from wbc.hardware.robot_controller import (
    BaseEstimator,
    RobotController,
    SensorEstimator,
    TruthEstimator,
)
from wbc.hardware.robot_side import STEP, RobotSettings, SimulatedRobot
from wbc.hardware.safety import Safety
from wbc.hardware.safety_limits import SafetyLimits
from wbc.hardware.sensor_checks import SensorChecks
from wbc.hardware.udp import COMMAND_PORT, READING_PORT, UdpBus, UdpRobotBus
from wbc.hardware.unitree.profiles import Profile, by_pattern
from wbc.kinds import one_of
from wbc.problem.problem import Problem
from wbc.problem.provenance import versions
from wbc.robot import Robot
from wbc.robot.model import check_robot
from wbc.simulation import Plant
from wbc.validate import Array, finite_number

BUSES = ("unitree", "udp")
ESTIMATORS: dict[str, Callable[[Robot, ImuMount], BaseEstimator]] = {
    "sensors": SensorEstimator,
    "truth": lambda robot, imu: TruthEstimator(robot),
}
GAIN_MARGIN = 1.5  # of the safety layer's bounds by the profile's gains


class Where(NamedTuple):
    """The connection to a robot."""

    bus: str = "unitree"  # ``unitree`` (DDS) or ``udp``
    interface: str = "lo"  # network interface of DDS; with UDP an address, ``lo`` for this machine
    domain: int = 0  # of DDS; with UDP an offset of the ports, for several robots

    @property
    def is_here(self) -> bool:
        """Whether it is on this machine."""
        return self.interface == "lo" or self.interface.startswith("127.")

    @property
    def address(self) -> str:
        """Of UDP."""
        return "127.0.0.1" if self.interface == "lo" else self.interface

    def open(self, profile: Profile, robot: Robot) -> Bus:
        """Return the controller's end.

        Raises
        ------
        UnknownNameError
            No such bus.
        BusError
            It cannot be opened.
        MissingPackageError
            DDS without cyclonedds.
        """
        if self.bus == "udp":
            own, to = READING_PORT + 2 * self.domain, COMMAND_PORT + 2 * self.domain
            return UdpBus(len(robot.joint_names), self.address, port=own, robot_port=to)
        one_of("bus", self.bus, BUSES)
        from wbc.hardware.unitree.dds import UnitreeBus

        return UnitreeBus(profile, robot, self.interface, self.domain)

    def open_robot(self, profile: Profile, robot: Robot) -> RobotBus:
        """Return the robot's end; errors are those of :meth:`open`."""
        if self.bus == "udp":
            own, to = COMMAND_PORT + 2 * self.domain, READING_PORT + 2 * self.domain
            return UdpRobotBus(len(robot.joint_names), self.address, port=own, controller_port=to)
        one_of("bus", self.bus, BUSES)
        from wbc.hardware.unitree.dds import UnitreeRobotBus

        return UnitreeRobotBus(profile, robot, self.interface, self.domain)


def safety_of(robot: Robot, profile: Profile, dt: float) -> Safety:
    """Return the safety layer of a robot."""
    kp, kd = by_pattern(robot, profile.stiffness), by_pattern(robot, profile.holding)
    damping = by_pattern(robot, profile.damping)
    limits = SafetyLimits.of(robot, GAIN_MARGIN * kp, GAIN_MARGIN * kd)
    limits = replace(limits, up=profile.up(robot))
    return Safety(limits, damping, dt)


def motions_of(robot: Robot, profile: Profile, path: CrouchPath) -> Motions:
    """Return the motions up and down."""
    kp, kd = by_pattern(robot, profile.stiffness), by_pattern(robot, profile.holding)
    return Motions(PostureMotion(path, kp, kd, up=True), PostureMotion(path, kp, kd, up=False))


def estimator_of(name: str, robot: Robot, imu: ImuMount) -> BaseEstimator:
    """Return an estimator by its name, for readings of an IMU.

    Raises UnknownNameError: no such estimator.
    """
    return ESTIMATORS[one_of("estimator", name, list(ESTIMATORS))](robot, imu)


def loop_of(
    problem: Problem,
    profile: Profile,
    bus: Callable[[], Bus],
    operator: Operator,
    *,
    estimator: str = "sensors",
    log: str | Path | None = None,
    keep: float | None = None,
    watch: Callable[[RingLog], None] | None = None,
    forked: bool = True,
    priority: int = 40,
    cpus: Sequence[int] = (),
    say: Callable[[str], None] = lambda text: None,
) -> HardwareLoop:
    """Return the loop that runs a problem of the torque level on a robot.

    Parameters
    ----------
    bus:
        Opens it, after the controller's process is forked: its threads must not be.

    Raises
    ------
    InvalidInputError
        A problem of the velocity level, a robot that cannot crouch from the problem's start,
        without effort limits, or with other joints than the profile's.
    """
    robot = problem.parts.robot
    check_start(problem)
    for note in omissions(problem, profile):
        say(note)
    controller = controller_of(problem, profile, estimator)
    path = CrouchPath.of(problem.parts.at_start)
    return HardwareLoop(
        bus,
        controller,
        safety_of(robot, profile, PERIOD),
        SensorChecks(robot),
        motions_of(robot, profile, path),
        operator,
        log=log,
        keep=keep,
        watch=watch,
        made_of={
            "problem": problem.provenance(),
            "profile": profile.name,
            "estimator": estimator,
            "versions": versions(),
        },
        forked=forked,
        priority=priority,
        cpus=cpus,
        say=say,
    )


def omissions(problem: Problem, profile: Profile) -> list[str]:
    """Return what of a robot and its problem is not used on this bus, in words.

    Raises InvalidInputError: a joint of the robot has no motor there.
    """
    robot, notes = problem.parts.robot, list[str]()
    profile.order(robot)
    unused = [joint for joint in profile.motors if joint not in robot.joint_names]
    if unused:
        notes.append(
            f"motors stay off, as {robot.name} has no such joint, or locked: {listed(unused)}"
        )
    if profile.mount(robot).frame != profile.imu:
        notes.append(f"{robot.name} has no frame {profile.imu}: its IMU is taken to be at the base")
    if any(wrench.told for wrench in problem.spec.simulation.wrenches):
        notes.append("simulation.wrenches: the controller is told of none on a robot")
    return notes


def check_start(problem: Problem) -> None:
    """Refuse a problem that does not begin on all feet, on which the robot stands up.

    A robot that is bolted, or has no feet, cannot.
    """
    robot, held = problem.parts.robot, {one.frame for one in problem.parts.contacts}
    if robot.fixed_base or not robot.feet:
        reason = "has a fixed base" if robot.fixed_base else "has no feet"
        raise InvalidInputError(f"hardware: {robot.name} {reason}, and the loop stands a robot up")
    free = [name for name, foot in robot.feet.items() if foot.frame not in held]
    if free:
        raise InvalidInputError(
            f"hardware: the problem begins with {listed(free)} in the air, and {robot.name} stands"
            " up on all its feet; begin with support: double, and lift a foot in a later phase"
        )


def controller_of(problem: Problem, profile: Profile, estimator: str) -> RobotController:
    """Return the controller of readings."""
    robot, start = problem.parts.robot, problem.parts.start
    following, stiffness = (
        by_pattern(robot, one) for one in (profile.following, profile.stiffness)
    )
    known = estimator_of(estimator, robot, profile.mount(robot))
    return RobotController(problem.supervisor_on_robot, known, start, following, stiffness)


def simulated_robot(
    robot: Robot,
    profile: Profile,
    bus: RobotBus,
    settings: RobotSettings,
    start: Array | None = None,
    *,
    lifted: float = 0.0,
) -> SimulatedRobot:
    """Return a simulated robot in its crouch, or at ``start`` (nq,), raised by ``lifted`` [m].

    Raises
    ------
    InvalidInputError
        A robot with a fixed base, that cannot crouch, or with other joints than the profile's.
    """
    check_robot("hardware sim", robot)
    profile.order(robot)
    if robot.fixed_base:
        raise InvalidInputError(f"hardware sim: {robot.name} has a fixed base, and cannot stand up")
    if start is None:
        start = CrouchPath.of(robot.snapshot(robot.postures["standing"])).lowest
    start = robot.check_configuration(start)
    start[2] += finite_number("simulated robot, lifted", lifted, least=0.0)
    plant = Plant(robot, dt=STEP, physics_dt=STEP)
    braking, imu = by_pattern(robot, profile.damping), profile.mount(robot).frame
    return SimulatedRobot(plant, bus, start, braking, settings, imu)
