"""Physics: a robot in MuJoCo, made from the same model that controllers use.

The only folder that knows MuJoCo, which is loaded when the first :class:`Plant` is made.
"""

from wbc.simulation.contacts import Contacts
from wbc.simulation.engine import SimulationError
from wbc.simulation.falling import FallLimits, FallWatch, Verdict
from wbc.simulation.loop import SimulationTick, simulate
from wbc.simulation.mismatch import ModelMismatch
from wbc.simulation.plant import Plant
from wbc.simulation.push import Push
from wbc.simulation.recorder import Recorder
from wbc.simulation.sensors import Sensors
from wbc.simulation.terrain import Step, Terrain

__all__ = [
    "Contacts",
    "FallLimits",
    "FallWatch",
    "ModelMismatch",
    "Plant",
    "Push",
    "Recorder",
    "Sensors",
    "SimulationError",
    "SimulationTick",
    "Step",
    "Terrain",
    "Verdict",
    "simulate",
]
