"""Whether the core may be trusted with a robot: loading tries it against Pinocchio."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from wbc.errors import ModelError
from wbc.robot.inertia import carried_moments, inertia_curvature, inertia_rates
from wbc.robot.kernel import NativePass, NativeTree
from wbc.robot.workspace import Workspace
from wbc.validate import Array

# What the core and Pinocchio may differ by, relative to the largest entry.
AGREEMENT = 1e-10
# Quantities below this are judged as if they were as large: a ball's inertia changes by rounding.
ROUNDED = 1e-4


def checked_tree(name: str, work: Workspace) -> NativeTree:
    """Return the tree of a robot as the core reads it.

    Raises
    ------
    ModelError
        The core reads it otherwise than Pinocchio.
    """
    if not is_depth_first(work.model):
        raise ModelError(
            f"robot {name!r}: its joints do not come branch by branch, each with one entry of v in"
            " that order, as the core reads them; load it from a URDF or MJCF file"
        )
    tree = NativeTree(work.model)
    worst = disagreement(tree, work)
    if not worst <= AGREEMENT:  # NaN is not
        raise ModelError(
            f"robot {name!r}: the compiled core and Pinocchio {pin.__version__} differ by"
            f" {worst:.1e} of a quantity's largest entry, more than {AGREEMENT:g}: commands"
            " would be wrong. Is a mass, an inertia or a length of the file far beyond the others?"
            " If not, install wbc again, which compiles the core, and report this"
        )
    return tree


def is_depth_first(model: pin.Model) -> bool:
    """Whether all that a joint carries follows it, in q and v too: as Pinocchio reads files."""
    carriers = list[int]()
    for j in range(2, model.njoints):
        while carriers and carriers[-1] != model.parents[j]:
            carriers.pop()
        if not carriers and model.parents[j] != 1:
            return False
        carriers.append(j)
    ordered = all(list(part) == sorted(part) for part in (model.idx_qs, model.idx_vs))
    return ordered and all(size == 1 for size in list(model.nvs)[2:])


def disagreement(tree: NativeTree, work: Workspace, states: int = 2, seed: int = 0) -> float:
    """Return the largest difference from Pinocchio at random states, relative to each quantity."""
    model, rng = tree.model, np.random.default_rng(seed)
    last = model.nframes - 1
    worst = 0.0
    for _ in range(states):
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-1.5, 1.5, tree.nv))
        v = rng.standard_normal(tree.nv)
        passed = NativePass(tree)
        first = passed.evaluate(q, v)
        frame = tree.frame(first.array, last)
        passed.keep("", last)
        whole = passed.evaluate(q, v)  # now holds the frame
        motion = first.motion(v)
        moving = np.concatenate((motion.array[: tree.motion], motion.frame_drift(last)))
        state, rates = _state(model, work, q, v), _motion(model, work, q, v)
        reached = passed.reached(q, v, 0.1)
        if reached is None:  # a measured state that the core takes for none
            return np.inf
        for ours, theirs in (
            (reached, (pin.integrate(model, q, 0.1 * v),)),
            (np.concatenate((first.array, frame)), state),
            (whole.array, state),
            (moving, rates),
        ):
            worst = float(np.maximum(worst, _difference(ours, theirs)))  # keeps NaN
    return worst


def _state(model: pin.Model, work: Workspace, q: Array, v: Array) -> tuple[Array, ...]:
    """Return what a state holds, and the last frame, by Pinocchio."""
    data, last = work.kinematics(object(), q, v), model.nframes - 1
    com = np.array(data.oYcrb[0].lever)
    pose = pin.updateFramePlacement(model, data, last)
    return (
        com,
        data.Ig.inertia,
        data.hg.vector,
        data.Ag,
        data.Ag[:3] / pin.computeTotalMass(model),
        inertia_rates(carried_moments(work.composites.read(), data.Ag[:3], data.J, com)),
        data.J,
        *work.placements.copies(),
        pose.translation,
        pose.rotation,
        pin.getFrameJacobian(model, data, last, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED),
    )


def _motion(model: pin.Model, work: Workspace, q: Array, v: Array) -> tuple[Array, ...]:
    """Return what a motion holds, and the last frame's acceleration, by Pinocchio."""
    owner = object()
    data, rates = work.kinematics(owner, q, v), work.rates(owner, q, v)
    com, momenta = np.array(data.oYcrb[0].lever), data.Ag[:3]
    carried = carried_moments(work.composites.read(), momenta, data.J, com)
    mass = pin.computeTotalMass(model)
    curvature = inertia_curvature(work.columns.orders, carried, momenta, data.J, com, mass, v)
    inertia = pin.crba(model, work.scratch, q)
    bias = pin.nonLinearEffects(model, work.scratch, q, v).copy()
    frame, aligned = model.nframes - 1, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    drift = pin.getFrameClassicalAcceleration(model, rates, frame, aligned)
    momentum = rates.dhg.vector
    drifts = momentum[:3] / mass, momentum, inertia_rates(carried) @ v, curvature
    return inertia, bias, *drifts, drift.vector


def _difference(ours: Array, theirs: Sequence[Array]) -> float:
    """Return the largest difference between quantities behind each other and those expected."""
    begin, worst = 0, 0.0
    for wanted in theirs:
        got = ours[begin : begin + np.size(wanted)].reshape(np.shape(wanted))
        begin += np.size(wanted)
        difference = np.abs(got - wanted).max() / max(np.abs(wanted).max(), ROUNDED)
        worst = float(np.maximum(worst, difference))
    return worst
