"""What happened in a run, tick by tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class History:
    """One row per tick: the state in which it began, and what the controller answered.

    Attributes
    ----------
    time:
        (n,) when the tick began [s].
    phase:
        (n,) name of the phase; empty in a run without phases.
    support:
        (n,) what is held, with commas between: feet by name, such as ``left,right``, or frames.
    q:
        (n, nq) configuration then.
    v:
        (n, nv) velocity commanded, and applied until the next tick.
    com:
        (n, 3) centre of mass [m].
    inertia:
        (n, 6) centroidal inertia xx xy xz yy yz zz [kg m^2], world axes.
    task_inertia:
        (n, 6) the same in the axes of each inertia task, by task.
    errors:
        (n, k) error of each task, actual minus target, by task; NaN while the task is off.
    slip, turn:
        (n,) how far each contact is from its anchor [m], [rad], by frame; NaN while it is not held.
        The anchor is where the frame was when it was last put down.
    margin:
        (n,) smallest distance to a joint position limit [rad or m].
    balance:
        (n,) how far the CoM's projection is inside the polygon of the soles that stand [m],
        negative outside; NaN if no feet stand, or something else is held too.
    kkt:
        (n,) largest KKT residual; NaN where the QP was not solved.
    tick_time, tick_cpu_time:
        (n,) seconds from measurement to command, by the clock and of this thread's CPU.
    status:
        (n,) status of each QP.
    """

    time: Array
    phase: NDArray[np.str_]
    support: NDArray[np.str_]
    q: Array
    v: Array
    com: Array
    inertia: Array
    task_inertia: Mapping[str, Array]
    errors: Mapping[str, Array]
    slip: Mapping[str, Array]
    turn: Mapping[str, Array]
    margin: Array
    balance: Array
    kkt: Array
    tick_time: Array
    tick_cpu_time: Array
    status: NDArray[np.str_]

    def __len__(self) -> int:
        return int(self.time.size)

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return every array under a flat name; those by task or frame as ``errors/com``."""
        flat: dict[str, NDArray[np.generic]] = {}
        for part in fields(self):
            value = getattr(self, part.name)
            if isinstance(value, Mapping):
                flat |= {f"{part.name}/{name}": array for name, array in value.items()}
            else:
                flat[part.name] = value
        return flat
