"""Physics: a robot in MuJoCo, made from the same model that controllers use.

The only folder that knows MuJoCo, which is loaded when the first :class:`Plant` is made.
"""

from wbc.simulation.engine import SimulationError
from wbc.simulation.plant import Plant
from wbc.simulation.push import Push
from wbc.simulation.terrain import Step, Terrain

__all__ = ["Plant", "Push", "SimulationError", "Step", "Terrain"]
