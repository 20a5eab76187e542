"""From sensors to motors: the control loop on a robot, its safety layer, buses, simulated robots.

    bus -> reading -> sensor checks -> estimate, controller -> safety layer -> command -> bus

See the page *On a robot*; :mod:`wbc.hardware.safety` is the file to read first.
"""

from wbc.hardware.bus import BaseTruth, Bus, BusError, Command, Reading, RobotBus
from wbc.hardware.loop import HardwareLoop
from wbc.hardware.loop_result import LoopResult
from wbc.hardware.operator import Keyboard, LoopStatus, Operator, Script, Wish
from wbc.hardware.postures import CrouchPath, Motions, PostureMotion
from wbc.hardware.robot_controller import RobotController, SensorEstimator, TruthEstimator
from wbc.hardware.robot_side import RobotReport, RobotSettings, SimulatedRobot
from wbc.hardware.safety import RULES, TRANSITIONS, Fault, Mode, Safety
from wbc.hardware.safety_limits import SafetyLimits
from wbc.hardware.sensor_checks import SensorChecks
from wbc.hardware.setup import Where, loop_of, simulated_robot
from wbc.hardware.udp import UdpBus, UdpRobotBus

__all__ = [
    "RULES",
    "TRANSITIONS",
    "BaseTruth",
    "Bus",
    "BusError",
    "Command",
    "CrouchPath",
    "Fault",
    "HardwareLoop",
    "Keyboard",
    "LoopResult",
    "LoopStatus",
    "Mode",
    "Motions",
    "Operator",
    "PostureMotion",
    "Reading",
    "RobotBus",
    "RobotController",
    "RobotReport",
    "RobotSettings",
    "Safety",
    "SafetyLimits",
    "Script",
    "SensorChecks",
    "SensorEstimator",
    "SimulatedRobot",
    "TruthEstimator",
    "UdpBus",
    "UdpRobotBus",
    "Where",
    "Wish",
    "loop_of",
    "simulated_robot",
]
