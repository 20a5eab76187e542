"""Physics: a robot in MuJoCo, made from the same model that controllers use.

The only folder that knows MuJoCo, which is loaded when the first :class:`Plant` is made.
"""

from wbc.simulation.campaign import PushGrid, PushOutcome, run_campaign
from wbc.simulation.contacts import Contacts
from wbc.simulation.engine import SimulationError
from wbc.simulation.falling import FallLimits, FallWatch, Verdict
from wbc.simulation.loop import SimulationTick, simulate
from wbc.simulation.mismatch import ModelMismatch
from wbc.simulation.plant import Plant
from wbc.simulation.push import AppliedWrench, Push
from wbc.simulation.push_bounds import capture_impulse
from wbc.simulation.push_map import PushMap
from wbc.simulation.recorder import Recorder
from wbc.simulation.result import SimulationResult, SimulationStatus
from wbc.simulation.sensed_plant import SensedPlant
from wbc.simulation.sensors import Sensors
from wbc.simulation.sensors_devices import (
    Devices,
    Encoders,
    FootSwitches,
    Imu,
    MessageBus,
    MotorTorques,
)
from wbc.simulation.terrain import Step, Terrain
from wbc.simulation.trial import run_trial

__all__ = [
    "AppliedWrench",
    "Contacts",
    "Devices",
    "Encoders",
    "FallLimits",
    "FallWatch",
    "FootSwitches",
    "Imu",
    "MessageBus",
    "ModelMismatch",
    "MotorTorques",
    "Plant",
    "Push",
    "PushGrid",
    "PushMap",
    "PushOutcome",
    "Recorder",
    "SensedPlant",
    "Sensors",
    "SimulationError",
    "SimulationResult",
    "SimulationStatus",
    "SimulationTick",
    "Step",
    "Terrain",
    "Verdict",
    "capture_impulse",
    "run_campaign",
    "run_trial",
    "simulate",
]
