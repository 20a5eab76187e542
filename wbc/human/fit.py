"""Postures of a human fitted to markers, in all frames at once, by damped Gauss-Newton.

Weighted least squares: markers by how much skin moves there, joints by how far they usually are
from neutral, which decides only what no marker tells. Far residuals count linearly (Huber).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wbc.human.body import HINGES, SEGMENT_NAMES, SEGMENTS
from wbc.human.kinematics import (
    DOFS,
    HINGE_SEGMENTS,
    Placed,
    Poses,
    joined_poses,
    place,
    point_jacobian,
    rotations,
)
from wbc.human.landmarks import Landmark
from wbc.validate import Array

# Where searches begin: from straight knees and elbows they could bend either way.
BENT = np.array([0.5 * hinge.name.endswith(("knee_flexion", "elbow_flexion")) for hinge in HINGES])
SPREADS = np.array([hinge.spread for hinge in HINGES])  # rad
HUBER = 3.0  # standard deviations beyond which a residual counts linearly
STEPS = 40
SETTLED = 1e-6  # relative decrease of the cost below which a frame is done
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-9, 1e6
FRAMES_AT_ONCE = 250
LUMBAR = [k for k, hinge in enumerate(HINGES) if hinge.name.startswith("lumbar")]
SWINGS = 0.35  # rad: of a pelvis, over which the trunk stays upright
STUCK = (2.0, 20.0)  # times the cost of the frame beside it, and more: another minimum


@dataclass(frozen=True, eq=False)
class MarkerSet:
    """Markers on a human: where each one is, and how sure that is.

    A marker is at ``origin(anchor) + R(segment) place`` in the world.
    """

    names: tuple[str, ...]  # labels of the recording (m)
    landmarks: tuple[Landmark, ...]  # (m)
    place: Array  # (m, 3) [m]

    @property
    def segments(self) -> NDArray[np.intp]:
        """The segments they move with (m,)."""
        return np.array([SEGMENT_NAMES.index(one.segment) for one in self.landmarks])

    @property
    def anchors(self) -> NDArray[np.intp]:
        """The segments at whose origins their places are counted from (m,)."""
        return np.array([SEGMENT_NAMES.index(one.anchor) for one in self.landmarks])

    @property
    def noise(self) -> Array:
        """Standard deviations (m,) [m]."""
        return np.array([one.noise for one in self.landmarks])

    def at(self, placed: Placed) -> Array:
        """Return where they are in n frames (n, m, 3) [m]."""
        turned = (placed.rotation[:, self.segments] @ self.place[None, :, :, None])[..., 0]
        return np.asarray(placed.origin[:, self.anchors] + turned)


def weights(residual: Array, noise: Array) -> tuple[Array, Array]:
    """Return weights (n, m) of squares and the cost (n,) of residuals (n, m, 3); NaN weighs 0."""
    size = np.linalg.norm(residual, axis=2) / noise
    known = np.isfinite(size)
    size = np.where(known, size, 0.0)
    far = size > HUBER
    factor = np.where(far, HUBER / np.maximum(size, HUBER), 1.0)
    cost = np.where(far, HUBER * (2.0 * size - HUBER), size**2)
    return np.where(known, factor / noise**2, 0.0), cost.sum(axis=1)


def residuals(poses: Poses, observed: Array, markers: MarkerSet, dimensions: Array) -> Array:
    """Return where markers are in the fit, less where they were seen (n, m, 3) [m]."""
    return np.asarray(markers.at(place(poses, dimensions)) - observed)


def fit_poses(
    start: Poses, observed: Array, markers: MarkerSet, dimensions: Array, steps: int = STEPS
) -> tuple[Poses, Array]:
    """Return the postures (n) that fit markers (n, m, 3) [m], and their costs (n,).

    Parameters
    ----------
    start:
        Where the search begins.
    observed:
        Marker positions in world axes, z up; NaN where one is not seen.
    """
    parts, costs = list[Poses](), list[Array]()
    for first in range(0, len(start), FRAMES_AT_ONCE):
        frames = slice(first, first + FRAMES_AT_ONCE)
        found, cost = _fit(start[frames], observed[frames], markers, dimensions, steps)
        parts.append(found)
        costs.append(cost)
    return joined_poses(parts), np.concatenate(costs)


def _fit(
    poses: Poses, observed: Array, markers: MarkerSet, dimensions: Array, steps: int
) -> tuple[Poses, Array]:
    poses = poses.copy()
    cost = _cost(poses, observed, markers, dimensions)
    damping = np.full(len(poses), FIRST_DAMPING)
    active: NDArray[np.intp] = np.arange(len(poses))
    for _ in range(steps):
        if not len(active):
            break
        now = poses[active]
        H, g = normal_equations(now, observed[active], markers, dimensions)
        diagonal = np.arange(DOFS)
        H[:, diagonal, diagonal] *= 1.0 + damping[active, None]
        step = -np.linalg.solve(H, g[..., None])[..., 0]
        tried = now.moved(step)
        new = _cost(tried, observed[active], markers, dimensions)
        better = new <= cost[active]
        taken, kept = active[better], active[~better]
        gain = cost[taken] - new[better]
        poses.put(taken, tried, better)
        done = taken[gain <= SETTLED * cost[taken] + 1e-12]
        cost[taken] = new[better]
        damping[taken] = np.maximum(0.1 * damping[taken], LEAST_DAMPING)
        damping[kept] *= 10.0
        stuck = kept[damping[kept] > MOST_DAMPING]
        active = np.setdiff1d(active, np.concatenate((done, stuck)))
    return poses, cost


def unstuck(
    poses: Poses, cost: Array, observed: Array, markers: MarkerSet, dimensions: Array
) -> Poses:
    """Return postures (n) in which frames far worse than those beside them go on from those.

    A search that begins elsewhere may end in another minimum, in which a knee is bent backwards.
    """
    poses = poses.copy()
    factor, more = STUCK
    for step, frames in ((1, range(1, len(cost))), (-1, range(len(cost) - 2, -1, -1))):
        for k in frames:
            if cost[k] > factor * cost[k - step] + more:
                one = slice(k - step, k - step + 1)
                found, new = fit_poses(poses[one], observed[k : k + 1], markers, dimensions)
                if new[0] < cost[k]:
                    poses.put(k, found, 0)
                    cost[k] = new[0]
    return poses


def normal_equations(
    poses: Poses, observed: Array, markers: MarkerSet, dimensions: Array
) -> tuple[Array, Array]:
    """Return Gauss-Newton's matrices (n, 40, 40) and gradients (n, 40) of half the cost."""
    *_, H, g = linearised(poses, observed, markers, dimensions)
    # A pelvis that no marker tells of stays where it is, and the matrix regular.
    base = np.arange(6)
    H[:, base, base] += 1e-9
    return H, g


def linearised(
    poses: Poses, observed: Array, markers: MarkerSet, dimensions: Array
) -> tuple[Placed, Array, Array, Array, Array, Array]:
    """Return what Gauss-Newton's method takes, of the k = 3 m coordinates of markers.

    Where segments are; weights (n, k, 1); the weighted Jacobian, transposed (n, 40, k); residuals
    (n, k) [m]; matrices (n, 40, 40) and gradients (n, 40) of half the cost.
    """
    placed = place(poses, dimensions)
    at = markers.at(placed)
    residual = at - observed
    weight, _ = weights(residual, markers.noise)
    J = point_jacobian(placed, markers.segments, at).reshape(len(poses), -1, DOFS)
    W = np.repeat(weight, 3, axis=1)[:, :, None]
    JW = np.swapaxes(J * W, 1, 2)
    H = JW @ J
    r = np.nan_to_num(residual).reshape(len(poses), -1)
    g = (JW @ r[..., None])[..., 0]
    hinges = np.arange(6, DOFS)
    H[:, hinges, hinges] += SPREADS**-2
    g[:, 6:] += poses.angles * SPREADS**-2
    return placed, W, JW, r, H, g


def _cost(poses: Poses, observed: Array, markers: MarkerSet, dimensions: Array) -> Array:
    _, cost = weights(residuals(poses, observed, markers, dimensions), markers.noise)
    return np.asarray(cost + ((poses.angles / SPREADS) ** 2).sum(axis=1))


def upright_trunk(poses: Poses) -> Poses:
    """Return the same postures with the trunk upright, turned as the pelvis is.

    Where no marker tells of it: a pelvis swings by some degrees in a walk, over which trunks stay
    upright. Where it tilts by more than ``SWINGS``, the trunk leans as far beyond that.
    """
    x, y, z = poses.rotation[:, :, 2].T
    level = np.hypot(x, y)
    angle = np.arctan2(level, z)
    tilt = np.column_stack((-y, x, np.zeros(len(poses)))) / np.maximum(level, 1e-9)[:, None]
    heading = np.swapaxes(rotations(tilt * angle[:, None]), 1, 2) @ poses.rotation
    trunk = rotations(tilt * np.maximum(angle - SWINGS, 0.0)[:, None]) @ heading
    between = Rotation.from_matrix(np.swapaxes(poses.rotation, 1, 2) @ trunk)
    found = poses.copy()
    found.angles[:, LUMBAR] = between.as_euler("YXZ")  # flexion, bending, rotation
    return found


def continuous(poses: Poses) -> Poses:
    """Return the same postures with joints that go on from each frame to the next.

    Angles of three hinges in a row have two branches, (a, b, c) and (a + pi, t - b, c + pi) with
    t = pi, or 0 where the last axis is the first, and turns besides. What frames that were fitted
    by themselves have of them is chance, and a low-pass across a leap throws the limb about. The
    frame whose joints are nearest to their usual range decides.
    """
    angles = poses.angles.copy()
    usual = _nearest(angles, 0.0)
    best = int(np.square(usual / SPREADS).sum(axis=1).argmin())
    angles[best] = usual[best]
    for step, end in ((1, len(angles)), (-1, -1)):
        for k in range(best + step, end, step):
            last = angles[k - step]
            now = _nearest(angles[k], last)
            for first, fold in FOLDS:
                other, triple = now.copy(), slice(first, first + 3)
                other[triple] = now[triple] * (1.0, -1.0, 1.0) + (np.pi, fold, np.pi)
                other = _nearest(other, last)
                if np.abs(other - last).sum() < np.abs(now - last).sum():
                    now = other
            angles[k] = now
    return Poses(poses.position, poses.rotation, angles)


def _nearest(angles: Array, to: Array | float) -> Array:
    """Return angles that differ by whole turns, those nearest to ``to`` [rad]."""
    return np.asarray(angles - 2.0 * np.pi * np.round((angles - to) / (2.0 * np.pi)))


def _folds() -> tuple[tuple[int, float], ...]:
    """Return which hinges begin three in a row about one point, and t of their branches [rad]."""
    found = list[tuple[int, float]]()
    for k in range(len(HINGES) - 2):
        a, b, c = (np.array(hinge.axis) for hinge in HINGES[k : k + 3])
        before, middle, last = HINGE_SEGMENTS[k : k + 3]
        own = SEGMENTS[last]
        # Or the first along a limb, about which what it carries may turn as well.
        along = own.parent == before and own.origin[:2] == (None, None) and abs(a[2]) == 1.0
        if middle == last and (before == last or along) and max(abs(a @ b), abs(b @ c)) < 1e-9:
            found.append((k, 0.0 if abs(a @ c) > 0.5 else np.pi))
    return tuple(found)


FOLDS = _folds()


def first_poses(observed: Array, markers: MarkerSet, dimensions: Array) -> Poses:
    """Return postures (n) put where the markers of pelvis and trunk are, by Kabsch (1976).

    Upright, knees and elbows somewhat bent.

    The rotation is the one that brings the neutral posture's markers nearest; without three of
    them in a frame, as in the frame before.
    """
    count = len(observed)
    neutral = Poses(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, len(HINGES))))
    model = markers.at(place(neutral, dimensions))[0]
    core = [k for k, one in enumerate(markers.landmarks) if one.segment in ("pelvis", "trunk")]
    position, rotation = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    R, p = np.eye(3), np.zeros(3)
    for k in range(count):
        seen = [j for j in core if np.isfinite(observed[k, j]).all()]
        if len(seen) >= 3:
            there, here = observed[k, seen], model[seen]
            U, _, Vt = np.linalg.svd((here - here.mean(axis=0)).T @ (there - there.mean(axis=0)))
            sign = np.sign(np.linalg.det(Vt.T @ U.T))
            R = Vt.T @ np.diag((1.0, 1.0, sign)) @ U.T
            p = there.mean(axis=0) - R @ here.mean(axis=0)
        position[k], rotation[k] = p, R
    return Poses(position, rotation, np.tile(BENT, (count, 1)))
