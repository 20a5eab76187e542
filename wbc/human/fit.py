"""Postures of a human fitted to markers, in all frames at once, by damped Gauss-Newton.

Weighted least squares: markers by the noise of the skin there; joints by their usual deviation from
neutral, a prior that decides only what no marker tells. Large residuals count linearly (Huber).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from wbc.human.body import HINGES, SEGMENT_NAMES, SEGMENTS
from wbc.human.kinematics import (
    DOFS,
    HINGE_SEGMENTS,
    Poses,
    SegmentFrames,
    forward_kinematics,
    point_jacobian,
    rotations,
)
from wbc.human.landmarks import Landmark
from wbc.rotations import same_sign
from wbc.validate import Array, Bools

# Initial angles: straight knees and elbows could bend either way.
INITIAL_ANGLES = np.array(
    [0.5 * hinge.name.endswith(("knee_flexion", "elbow_flexion")) for hinge in HINGES]
)
SPREADS = np.array([hinge.spread for hinge in HINGES])  # rad
HUBER = 3.0  # standard deviations beyond which a residual counts linearly
MAX_ITERATIONS = 40
CONVERGED_DECREASE = 1e-6  # of the cost of a frame, relative
INITIAL_DAMPING, MIN_DAMPING, MAX_DAMPING = 1e-2, 1e-9, 1e6
FRAMES_PER_BATCH = 250
LUMBAR = [k for k, hinge in enumerate(HINGES) if hinge.name.startswith("lumbar")]
PELVIS_TILT = 0.35  # rad: up to which the trunk stays upright over the pelvis
# A frame whose cost is above factor times its neighbour's plus offset is in another local minimum.
LOCAL_MINIMUM_FACTOR, LOCAL_MINIMUM_OFFSET = 2.0, 20.0
UNTOLD = 5.0  # times the deviation with all markers: a coordinate is then not told by those seen


@dataclass(frozen=True, eq=False)
class MarkerSet:
    """Markers on a human of given dimensions: their places, and how certain these are.

    A marker is at ``origin(anchor) + R(segment) place`` in the world.
    """

    names: tuple[str, ...]  # labels of the recording (m)
    landmarks: tuple[Landmark, ...]  # (m)
    place: Array  # (m, 3) [m]
    dimensions: Array  # of the human (12,) [m]

    @property
    def segments(self) -> NDArray[np.intp]:
        """Indices of the segments that they move with (m,)."""
        return np.array([SEGMENT_NAMES.index(one.segment) for one in self.landmarks])

    @property
    def anchors(self) -> NDArray[np.intp]:
        """Indices of the segments from whose origins their places are measured (m,)."""
        return np.array([SEGMENT_NAMES.index(one.anchor) for one in self.landmarks])

    @property
    def noise(self) -> Array:
        """Standard deviations (m,) [m]."""
        return np.array([one.noise for one in self.landmarks])

    def frames(self, poses: Poses) -> SegmentFrames:
        """Return the poses of the human's segments in n postures."""
        return forward_kinematics(poses, self.dimensions)

    def positions(self, frames: SegmentFrames) -> Array:
        """Return their positions (n, m, 3) [m] in n frames."""
        rotated = (frames.rotation[:, self.segments] @ self.place[None, :, :, None])[..., 0]
        return np.asarray(frames.origin[:, self.anchors] + rotated)


def weights(residual: Array, noise: Array) -> tuple[Array, Array]:
    """Return Huber's weights (n, m) and costs (n,) of residuals (n, m, 3) [m]; NaN weighs 0."""
    size = np.linalg.norm(residual, axis=2) / noise
    known = np.isfinite(size)
    size = np.where(known, size, 0.0)
    far = size > HUBER
    factor = np.where(far, HUBER / np.maximum(size, HUBER), 1.0)
    cost = np.where(far, HUBER * (2.0 * size - HUBER), size**2)
    return np.where(known, factor / noise**2, 0.0), cost.sum(axis=1)


def residuals(poses: Poses, observed: Array, markers: MarkerSet) -> Array:
    """Return fitted less observed marker positions (n, m, 3) [m]."""
    return np.asarray(markers.positions(markers.frames(poses)) - observed)


def fit_poses(
    start: Poses, observed: Array, markers: MarkerSet, iterations: int = MAX_ITERATIONS
) -> tuple[Poses, Array]:
    """Return the postures (n) that fit markers (n, m, 3) [m], and their costs (n,).

    ``start``: initial postures.
    ``observed``: marker positions in world axes, z up; NaN where one is not seen.
    """
    poses, cost = start.copy(), np.empty(len(start))
    for first in range(0, len(start), FRAMES_PER_BATCH):
        frames = slice(first, first + FRAMES_PER_BATCH)
        cost[frames] = _fit(poses[frames], observed[frames], markers, iterations)
    return poses, cost


def _fit(poses: Poses, observed: Array, markers: MarkerSet, iterations: int) -> Array:
    """Fit the postures in place; return their costs (n,)."""
    cost = _cost(poses, observed, markers)
    damping = np.full(len(poses), INITIAL_DAMPING)
    active: NDArray[np.intp] = np.arange(len(poses))
    for _ in range(iterations):
        if not len(active):
            break
        now = poses[active]
        H, g = normal_equations(now, observed[active], markers)
        diagonal = np.arange(DOFS)
        H[:, diagonal, diagonal] *= 1.0 + damping[active, None]
        step = -np.linalg.solve(H, g[..., None])[..., 0]
        tried = now.step(np.asarray(step, float))
        new = _cost(tried, observed[active], markers)
        better = new <= cost[active]
        accepted, rejected = active[better], active[~better]
        decrease = cost[accepted] - new[better]
        poses.put(accepted, tried, better)
        done = accepted[decrease <= CONVERGED_DECREASE * cost[accepted] + 1e-12]
        cost[accepted] = new[better]
        damping[accepted] = np.maximum(0.1 * damping[accepted], MIN_DAMPING)
        damping[rejected] *= 10.0
        stuck = rejected[damping[rejected] > MAX_DAMPING]
        active = np.setdiff1d(active, np.concatenate((done, stuck)))
    return cost


def escape_local_minima(poses: Poses, cost: Array, observed: Array, markers: MarkerSet) -> Poses:
    """Return postures (n) in which frames far worse than a neighbour are refitted from it.

    Another initial posture may lead to another local minimum, with a knee bent backwards.
    """
    poses = poses.copy()
    for step, frames in ((1, range(1, len(cost))), (-1, range(len(cost) - 2, -1, -1))):
        for k in frames:
            if cost[k] > LOCAL_MINIMUM_FACTOR * cost[k - step] + LOCAL_MINIMUM_OFFSET:
                one = slice(k - step, k - step + 1)
                found, new = fit_poses(poses[one], observed[k : k + 1], markers)
                if new[0] < cost[k]:
                    poses.put(k, found, 0)
                    cost[k] = new[0]
    return poses


def bridge_untold(
    time: Array, poses: Poses, observed: Array, markers: MarkerSet
) -> tuple[Poses, Bools]:
    """Return postures (n) whose coordinates follow their neighbours in time where no marker tells.

    There the fit has only its prior: a foot without markers would jump to neutral and back, and a
    human out of view to the posture of a key frame. Also which coordinates (n, 40) these are:
    those whose standard deviation grows too much by the markers that are not seen.
    """
    missing: Bools = ~np.asarray(np.isfinite(observed).all(axis=2))
    never = missing.all(axis=0)
    missing &= ~never
    untold = np.zeros((len(poses), DOFS), dtype=bool)
    some = np.flatnonzero(missing.any(axis=1))
    for first in range(0, len(some), FRAMES_PER_BATCH):
        frames = some[first : first + FRAMES_PER_BATCH]
        now = poses[frames]
        fitted = markers.positions(markers.frames(now))
        fitted[:, never] = np.nan
        both = [
            np.diagonal(np.linalg.inv(normal_equations(now, one, markers)[0]), axis1=1, axis2=2)
            for one in (fitted, np.where(missing[frames][..., None], np.nan, fitted))
        ]
        untold[frames] = both[1] > UNTOLD**2 * both[0]
    untold[:, :3] = untold[:, :3].any(axis=1, keepdims=True)  # the pelvis as a whole
    untold[:, 3:6] = untold[:, 3:6].any(axis=1, keepdims=True)
    moved, turned = untold[:, 0], untold[:, 3]
    found = poses.copy()
    quaternions = Rotation.from_matrix(poses.rotation).as_quat()
    quaternions[~turned] = same_sign(quaternions[~turned])
    _interpolate(time, found.position, moved)
    _interpolate(time, quaternions, turned)
    for k in range(len(HINGES)):
        _interpolate(time, found.angles[:, k], untold[:, 6 + k])
    found.rotation[turned] = Rotation.from_quat(quaternions[turned]).as_matrix()
    return found, untold


def _interpolate(time: Array, values: Array, untold: Bools) -> None:
    """Interpolate values (n, ...) in place; at both ends they are those of the nearest frame."""
    told = time[~untold]
    if untold.any() and len(told) > 1:
        curve = PchipInterpolator(told, values[~untold])
        values[untold] = curve(np.clip(time[untold], told[0], told[-1]))


def normal_equations(poses: Poses, observed: Array, markers: MarkerSet) -> tuple[Array, Array]:
    """Return Gauss-Newton's matrices (n, 40, 40) and gradients (n, 40) of half the cost."""
    *_, H, g = linearize(poses, observed, markers)
    # Without markers the pelvis stays where it is, and the matrix is regular.
    base = np.arange(6)
    H[:, base, base] += 1e-9
    return H, g


def linearize(
    poses: Poses, observed: Array, markers: MarkerSet
) -> tuple[SegmentFrames, Array, Array, Array, Array, Array]:
    """Linearize the k = 3 m coordinates of markers.

    Return the segments' poses; weights (n, k, 1); the weighted Jacobian, transposed (n, 40, k);
    residuals (n, k) [m]; matrices (n, 40, 40) and gradients (n, 40) of half the cost.
    """
    frames = markers.frames(poses)
    positions = markers.positions(frames)
    residual = positions - observed
    weight, _ = weights(residual, markers.noise)
    J = point_jacobian(frames, markers.segments, positions).reshape(len(poses), -1, DOFS)
    W = np.repeat(weight, 3, axis=1)[:, :, None]
    JW = np.swapaxes(J * W, 1, 2)
    H = JW @ J
    r = np.nan_to_num(residual).reshape(len(poses), -1)
    g = (JW @ r[..., None])[..., 0]
    hinges = np.arange(6, DOFS)
    H[:, hinges, hinges] += SPREADS**-2
    g[:, 6:] += poses.angles * SPREADS**-2
    return frames, W, JW, r, H, g


def _cost(poses: Poses, observed: Array, markers: MarkerSet) -> Array:
    _, cost = weights(residuals(poses, observed, markers), markers.noise)
    return np.asarray(cost + ((poses.angles / SPREADS) ** 2).sum(axis=1))


def upright_trunk(poses: Poses) -> Poses:
    """Return the same postures with an upright trunk that faces where the pelvis does.

    For recordings without markers on it: in a walk the pelvis tilts by some degrees and the trunk
    stays upright. Beyond ``PELVIS_TILT`` the trunk leans by the excess.
    """
    x, y, z = poses.rotation[:, :, 2].T
    level = np.hypot(x, y)
    angle = np.arctan2(level, z)
    tilt = np.column_stack((-y, x, np.zeros(len(poses)))) / np.maximum(level, 1e-9)[:, None]
    heading = np.swapaxes(rotations(tilt * angle[:, None]), 1, 2) @ poses.rotation
    trunk = rotations(tilt * np.maximum(angle - PELVIS_TILT, 0.0)[:, None]) @ heading
    relative = Rotation.from_matrix(np.swapaxes(poses.rotation, 1, 2) @ trunk)
    found = poses.copy()
    found.angles[:, LUMBAR] = relative.as_euler("YXZ")  # flexion, bending, rotation
    return found


def unwrap_joints(poses: Poses) -> Poses:
    """Return the same postures with joint angles that are continuous over frames.

    Angles of three hinges in a row have two branches, (a, b, c) and (a + pi, t - b, c + pi) with
    t = pi, or 0 where the last axis is the first, and are defined up to full turns. Frames fitted
    independently pick any of them, and a low-pass across a jump would swing the limb. The branch is
    that of the frame whose joints are nearest to neutral.
    """
    angles = poses.angles.copy()
    principal = _unwrap_to(angles, 0.0)
    best = int(np.square(principal / SPREADS).sum(axis=1).argmin())
    angles[best] = principal[best]
    for step, end in ((1, len(angles)), (-1, -1)):
        for k in range(best + step, end, step):
            last = angles[k - step]
            now = _unwrap_to(angles[k], last)
            for first, t in BRANCHES:
                other, triple = now.copy(), slice(first, first + 3)
                other[triple] = now[triple] * (1.0, -1.0, 1.0) + (np.pi, t, np.pi)
                other = _unwrap_to(other, last)
                if np.abs(other - last).sum() < np.abs(now - last).sum():
                    now = other
            angles[k] = now
    return Poses(poses.position, poses.rotation, angles)


def _unwrap_to(angles: Array, to: Array | float) -> Array:
    """Return the angles, changed by full turns, nearest to ``to`` [rad]."""
    return np.asarray(angles - 2.0 * np.pi * np.round((angles - to) / (2.0 * np.pi)))


def _branches() -> tuple[tuple[int, float], ...]:
    """Return the first of each three hinges about one point, and t of their branches [rad]."""
    found = list[tuple[int, float]]()
    for k in range(len(HINGES) - 2):
        a, b, c = (np.array(hinge.axis) for hinge in HINGES[k : k + 3])
        before, middle, last = HINGE_SEGMENTS[k : k + 3]
        own = SEGMENTS[last]
        # The first may also be that of the parent, if its axis lies along the limb.
        along = own.parent == before and own.origin[:2] == (None, None) and abs(a[2]) == 1.0
        if middle == last and (before == last or along) and max(abs(a @ b), abs(b @ c)) < 1e-9:
            found.append((k, 0.0 if abs(a @ c) > 0.5 else np.pi))
    return tuple(found)


BRANCHES = _branches()


def initial_poses(observed: Array, markers: MarkerSet) -> Poses:
    """Return postures (n) aligned with the markers of pelvis and trunk, by Kabsch (1976).

    Joints have ``INITIAL_ANGLES``; a frame without three of these markers has the pose of the one
    before.
    """
    count = len(observed)
    neutral = Poses(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, len(HINGES))))
    model = markers.positions(markers.frames(neutral))[0]
    core = [k for k, one in enumerate(markers.landmarks) if one.segment in ("pelvis", "trunk")]
    position, rotation = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    R, p = np.eye(3), np.zeros(3)
    for k in range(count):
        seen = [j for j in core if np.isfinite(observed[k, j]).all()]
        if len(seen) >= 3:
            target, source = observed[k, seen], model[seen]
            centred = target - target.mean(axis=0)
            U, _, Vt = np.linalg.svd((source - source.mean(axis=0)).T @ centred)
            sign = np.sign(np.linalg.det(Vt.T @ U.T))
            R = Vt.T @ np.diag((1.0, 1.0, sign)) @ U.T
            p = target.mean(axis=0) - R @ source.mean(axis=0)
        position[k], rotation[k] = p, R
    return Poses(position, rotation, np.tile(INITIAL_ANGLES, (count, 1)))
