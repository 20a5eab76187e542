"""The check of the core against Pinocchio when a robot is loaded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from wbc.errors import ModelError
from wbc.robot.kernel import NativePass, NativeTree
from wbc.spatial import vech
from wbc.validate import Array

# Largest difference between the core and Pinocchio, relative to the largest entry.
AGREEMENT = 1e-10
# Largest difference of the inertia's derivatives from finite differences, relative to the inertia.
RATES_WITHIN = 1e-6
STEP = 1e-3  # s between these
# Central differences of sixth order (Fornberg 1988): weights 1, 2 and 3 steps away.
_FIRST = np.array([3 / 4, -3 / 20, 1 / 60]) / STEP
_SECOND = np.array([3 / 2, -3 / 20, 1 / 90]) / STEP**2
# Smaller quantities are compared relative to this: a ball's inertia changes by rounding only, a
# point's is 0.
LEAST_SCALE = 1e-4


def checked_tree(name: str, model: pin.Model) -> NativeTree:
    """Return the tree of a robot as the core reads it."""
    if not is_depth_first(model):
        raise ModelError(
            f"robot {name!r}: its joints do not come branch by branch, each with one entry of v in"
            " that order, as the core reads them; load it from a URDF or MJCF file"
        )
    tree = NativeTree(model)
    worst, rates = disagreement(tree), disagreement_of_rates(tree)
    if not (worst <= AGREEMENT and rates <= RATES_WITHIN):  # NaN is not
        raise ModelError(
            f"robot {name!r}: the compiled core and Pinocchio {pin.__version__} differ by"
            f" {worst:.1e} of a quantity's largest entry (at most {AGREEMENT:g}), in the inertia's"
            f" derivatives by {rates:.1e} ({RATES_WITHIN:g}): commands would be wrong. Is a mass,"
            " an inertia or a length of the file far beyond the others? If not, install wbc again,"
            " which compiles the core, and report this"
        )
    return tree


def is_depth_first(model: pin.Model) -> bool:
    """Return whether joints are numbered depth first, in q and v too: as Pinocchio reads files."""
    carriers = list[int]()
    for j in range(2, model.njoints):
        while carriers and carriers[-1] != model.parents[j]:
            carriers.pop()
        if not carriers and model.parents[j] != 1:
            return False
        carriers.append(j)
    ordered = all(list(part) == sorted(part) for part in (model.idx_qs, model.idx_vs))
    return ordered and all(size == 1 for size in list(model.nvs)[2:])


def disagreement(tree: NativeTree) -> float:
    """Return the largest difference from Pinocchio at random states, relative to each quantity."""
    model, data, last = tree.model, tree.model.createData(), tree.model.nframes - 1
    worst = 0.0
    for q, v in _states(tree):
        passed = NativePass(tree)
        first = passed.evaluate(q.tobytes() + v.tobytes())
        frame = tree.frame(first.array, last)
        (whole,) = passed.evaluate_all(q[None], v[None], [last])
        motion = first.motion(v)
        drifts = motion.drift("com_drift"), motion.drift("momentum_drift"), motion.frame_drift(last)
        moving = np.concatenate((motion.array[: tree.parts["com_drift"].start], *drifts))
        state, rates = _state(model, data, q, v), _motion(model, data, q, v)
        integrated = passed.integrated(q, v, 0.1)
        if integrated is None:  # a measured state that the core takes for none
            return np.inf
        ours = np.delete(first.array, np.r_[tree.parts["inertia_jacobian"]])
        kept = np.delete(whole, np.r_[tree.parts["inertia_jacobian"]])
        for found, theirs in (
            (integrated, (pin.integrate(model, q, 0.1 * v),)),
            (np.concatenate((ours, frame)), state),
            (kept, state),
            (moving, rates),
        ):
            worst = float(np.maximum(worst, _difference(found, theirs)))  # keeps NaN
    return worst


def disagreement_of_rates(tree: NativeTree) -> float:
    """Return how far both derivatives of the inertia are from differences of Pinocchio's.

    Along random velocities, which no wrong column of a Jacobian escapes; relative to the inertia.
    The base stays at the origin: elsewhere Pinocchio's inertia has fewer digits.
    """
    model, data, at_rest = tree.model, tree.model.createData(), np.zeros(tree.nv)

    def inertia(q: Array) -> Array:
        pin.ccrba(model, data, q, at_rest)
        return vech(data.Ig.inertia)

    worst = 0.0
    for q, v in _states(tree):
        q[:3], v[:3] = 0.0, 0.0
        state = NativePass(tree).evaluate(q.tobytes() + v.tobytes())
        motion, here = state.motion(v), inertia(q)
        ahead, behind = (
            np.array([inertia(pin.integrate(model, q, k * STEP * v)) for k in side])
            for side in ((1, 2, 3), (-1, -2, -3))
        )
        first, second = _FIRST @ (ahead - behind), _SECOND @ (ahead + behind - 2.0 * here)
        for ours, theirs in (
            (state.part("inertia_jacobian", 6, -1) @ v, first),
            (motion.drift("inertia_rate"), first),
            (motion.drift("inertia_curvature"), second),
        ):
            size = max(np.abs(here).max(), np.abs(theirs).max(), LEAST_SCALE)
            worst = float(np.maximum(worst, np.abs(ours - theirs).max() / size))  # keeps NaN
    return worst


def _states(tree: NativeTree) -> Iterator[tuple[Array, Array]]:
    """Yield two random states (q, v), always the same."""
    model, rng = tree.model, np.random.default_rng(0)
    for _ in range(2):
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-1.5, 1.5, tree.nv))
        yield q, rng.standard_normal(tree.nv)


def _state(model: pin.Model, data: pin.Data, q: Array, v: Array) -> tuple[Array, ...]:
    """Return what a state holds but the inertia's Jacobian, and the last frame, by Pinocchio."""
    last = model.nframes - 1
    pin.ccrba(model, data, q, v)
    pose = pin.updateFramePlacement(model, data, last)
    return (
        np.array(data.oYcrb[0].lever),
        data.Ig.inertia,
        data.hg.vector,
        data.Ag,
        data.Ag[:3] / pin.computeTotalMass(model),
        data.J,
        np.array([one.rotation for one in data.oMi]),
        np.array([one.translation for one in data.oMi]),
        pose.translation,
        pose.rotation,
        pin.getFrameJacobian(model, data, last, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED),
    )


def _motion(model: pin.Model, data: pin.Data, q: Array, v: Array) -> tuple[Array, ...]:
    """Return mass matrix, bias and drifts of CoM, momentum and the last frame, by Pinocchio."""
    inertia, bias = pin.crba(model, data, q).copy(), pin.nonLinearEffects(model, data, q, v).copy()
    pin.computeCentroidalMomentumTimeVariation(model, data, q, v, np.zeros(model.nv))
    frame, aligned = model.nframes - 1, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    drift = pin.getFrameClassicalAcceleration(model, data, frame, aligned).vector
    momentum = data.dhg.vector
    return inertia, bias, momentum[:3] / pin.computeTotalMass(model), momentum, drift


def _difference(ours: Array, theirs: Sequence[Array]) -> float:
    """Return the largest difference between quantities behind each other and those expected."""
    begin, worst = 0, 0.0
    for wanted in theirs:
        got = ours[begin : begin + np.size(wanted)].reshape(np.shape(wanted))
        begin += np.size(wanted)
        difference = np.abs(got - wanted).max() / max(np.abs(wanted).max(), LEAST_SCALE)
        worst = float(np.maximum(worst, difference))
    return worst
