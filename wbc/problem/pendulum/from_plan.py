"""From a pendulum's plan to its history in space."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.problem.pendulum.history import PendulumHistory, Support
from wbc.rmp.ground import centroidal_moment_pivot
from wbc.rmp.plan import Plan
from wbc.validate import Array

# Moments between two knots, so that curves look like curves.
FINER = 4


def plan_history(plan: Plan) -> PendulumHistory:
    """Return a plan's motion in space, at four moments an interval.

    The leg's foot is the CoP. A planar pendulum is the slice y = 0 of a solid one, and has three
    pairs of masses here too.
    """
    motion = plan.refined(FINER)
    n = len(motion.time)
    stands = ~np.isnan(motion.cop[:, 0])
    cop, cmp = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    cop[stands] = 0.0
    cop[stands, :2] = motion.cop[stands]
    pushed = stands & (motion.force[:, 2] > 0.0)
    cmp[pushed] = centroidal_moment_pivot(motion.com[pushed], motion.force[pushed])
    return PendulumHistory(
        flat=False,
        time=motion.time,
        phase=tuple(plan.phases[k] for k in motion.phase),
        com=motion.com,
        com_velocity=motion.com_velocity,
        foot=cop,
        cop=cop,
        cmp=cmp,
        radii=motion.radii,
        axes=Rotation.from_quat(motion.orientation).as_matrix(),
        momentum=motion.momentum,
        supports=_supports(plan),
    )


def _supports(plan: Plan) -> tuple[Support, ...]:
    spans = zip(plan.starts[:-1].tolist(), plan.starts[1:].tolist(), strict=True)
    return tuple(
        Support(start, end, _corners(phase.support))
        for phase, (start, end) in zip(plan.problem.schedule, spans, strict=True)
        if phase.support is not None
    )


def _corners(support: tuple[tuple[float, float], ...]) -> Array:
    return np.array(support)
