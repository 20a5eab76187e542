"""Calibration of a human's dimensions and marker places, from the recording itself.

A bundle adjustment: Gauss-Newton over postures of key frames, dimensions and marker places
together. Joint centres are found functionally, where the markers of both segments rotate about
them; where the motion does not tell, they follow an anatomical prior: the hips by Harrington et al.
(2007, J. Biomech. 40, 595-602), the rest by usual proportions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from wbc.errors import InvalidInputError, listed
from wbc.human.body import NAMES, REFERENCE_STATURE, usual_dimensions
from wbc.human.fit import (
    SPREADS,
    MarkerSet,
    escape_local_minima,
    fit_poses,
    initial_poses,
    linearize,
    residuals,
    weights,
)
from wbc.human.kinematics import DOFS, Poses, SegmentFrames, dimension_jacobian
from wbc.human.landmarks import Landmark
from wbc.validate import Array

KEY_FRAMES = 40
MAX_ITERATIONS = 25
CONVERGED_DECREASE = 1e-5  # of the cost, relative
# Standard deviations of a marker from its prior place: in 16 public recordings at most 3.4, but for
# two wrist markers with swapped names, at 5.2 and 5.7.
MISPLACED = 5.0
STATURES = (0.6, 2.8)  # m, of possible fits
SMALL_CHILD = 1.1  # m: below it a note asks for the unit
STATURE_TOLERANCE = 0.08  # of the given stature; more difference of the limbs' is noted
# Distances between joints by the stature; de Leva.
_LENGTHS = {
    ("knee", "ankle"): 0.249,
    ("hip", "knee"): 0.2425,
    ("elbow", "wrist"): 0.1545,
    ("shoulder", "elbow"): 0.162,
}


@dataclass(frozen=True, eq=False)
class Calibration:
    """Dimensions and marker places of a human, from a recording."""

    markers: MarkerSet
    stature: float  # [m]: given, or by the calibrated lengths
    poses: Poses  # of the key frames
    rms: float  # of the key frames' marker residuals [m]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Prior:
    """The anatomical prior: means and standard deviations [m]."""

    dimensions: Array
    dimension_spread: Array
    place: Array  # (m, 3)
    place_spread: Array  # (m, 3)


def key_frames(observed: Array, count: int = KEY_FRAMES) -> NDArray[np.intp]:
    """Return indices of frames spread over a recording (n, m, 3), with most of its markers seen."""
    seen = np.isfinite(observed).all(axis=2).sum(axis=1)
    good = np.flatnonzero(seen >= max(np.quantile(seen, 0.5), 0.5 * seen.max()))
    return good[np.unique(np.linspace(0, len(good) - 1, min(count, len(good))).round().astype(int))]


def calibrate(
    observed: Array, names: tuple[str, ...], landmarks: tuple[Landmark, ...], stature: float | None
) -> Calibration:
    """Return a human's dimensions and marker places, from key frames (n, m, 3) [m]; NaN: not seen.

    ``stature``: [m]; None: by the lengths between joints.
    """
    guess = stature if stature is not None else _estimate_stature(observed, landmarks)
    for _ in range(2 if stature is None else 1):
        prior = _prior(observed, landmarks, guess)
        markers = MarkerSet(names, landmarks, prior.place.copy(), prior.dimensions)
        # With uncalibrated places a marker is no more certain than its place.
        noisy = (replace(one, noise=math.hypot(one.noise, one.spread)) for one in landmarks)
        uncalibrated = replace(markers, landmarks=tuple(noisy))
        poses = initial_poses(observed, markers)
        poses, cost = fit_poses(poses, observed, uncalibrated)
        poses = _refit_from_best(poses, cost, observed, uncalibrated)
        _, cost = fit_poses(poses, observed, uncalibrated, 0)
        poses = escape_local_minima(poses, cost, observed, uncalibrated)
        found = _bundle_adjustment(poses, observed, markers, prior)
        limbs = [NAMES.index(n) for n in ("upper_arm", "forearm", "thigh", "shank")]
        ratios = found.markers.dimensions[limbs] / usual_dimensions(REFERENCE_STATURE)[0][limbs]
        by_limbs = float(np.clip(np.mean(ratios) * REFERENCE_STATURE, *STATURES))
        guess = by_limbs if stature is None else stature
    sizes = dict(zip(NAMES, found.markers.dimensions.tolist(), strict=True))
    bad = next((n for n, size in sizes.items() if size <= 0.0 and not n.endswith("_x")), None)
    if bad is not None:
        raise InvalidInputError(
            f"markers: they are {1e3 * found.rms:.0f} mm off any human, whose {bad} would be"
            f" {sizes[bad]:.3g} m: they are not one human's, or their names mean other places"
        )
    small = f"{guess:.2f} m tall by its lengths: a small child, or are they in another unit?"
    notes = (small,) if stature is None and guess < SMALL_CHILD else ()
    if abs(by_limbs - guess) > STATURE_TOLERANCE * guess:
        notes = (f"by its limbs' lengths it is {by_limbs:.2f} m tall, {guess:g} m was given",)
    return replace(found, stature=guess, notes=notes + _misplaced_note(found, prior))


def _misplaced_note(found: Calibration, prior: _Prior) -> tuple[str, ...]:
    """Return a note on markers far from the places of their names."""
    offsets = found.markers.place - prior.place
    names = [
        f"{name} ({1e3 * np.linalg.norm(one):.0f} mm)"
        for name, one, spread in zip(found.markers.names, offsets, prior.place_spread, strict=True)
        if (np.abs(one) > MISPLACED * spread).any()
    ]
    what = f"markers far from the places of their names: {listed(names, 8)}; swapped?"
    return (what,) if names else ()


def _refit_from_best(poses: Poses, cost: Array, observed: Array, markers: MarkerSet) -> Poses:
    """Return postures in which bad ones are refitted from the joint angles of the best one."""
    best = int(cost.argmin())
    bad = np.flatnonzero(cost > 3.0 * cost[best] + 10.0)
    if not len(bad):
        return poses
    start = poses[bad]
    start.angles[:] = poses.angles[best]
    again, new = fit_poses(start, observed[bad], markers)
    better = new < cost[bad]
    poses.put(bad[better], again, better)
    return poses


def _estimate_stature(observed: Array, landmarks: tuple[Landmark, ...]) -> float:
    """Estimate the stature [m] by distances between markers near joints; 1.7 without any."""
    at = {one.name: observed[:, k] for k, one in enumerate(landmarks)}
    found = list[float]()
    for (joints, part), side in product(_LENGTHS.items(), ("left", "right")):
        ends = list[Array]()
        for joint in joints:
            kinds = ("centre", "lateral", "medial", "radial", "ulnar")
            names = [f"{side}_{joint}_{kind}" for kind in kinds] + [f"{side}_{joint}"]
            names += [f"{side}_acromion"] if joint == "shoulder" else []
            ends += [at[name] for name in names if name in at][:1]
        if len(ends) == len(joints):
            length = np.linalg.norm(ends[0] - ends[1], axis=1)
            if np.isfinite(length).any():
                found.append(float(np.nanmedian(length)) / part)
    if not found:
        return 1.7
    stature, (least, most) = float(np.median(found)), STATURES
    if not least < stature < most:
        raise InvalidInputError(
            f"markers: by the distances between them the human is {stature:.3g} m tall: the"
            " lengths are in another unit than the file or (unit, of a BVH) you say"
        )
    return stature


def _prior(observed: Array, landmarks: tuple[Landmark, ...], stature: float) -> _Prior:
    dimensions, spread = usual_dimensions(stature)
    scale = stature / REFERENCE_STATURE
    places = scale * np.array([one.place for one in landmarks])
    place_spread = scale * np.array([[one.spread] * 3 for one in landmarks])
    width, depth = _pelvis_size(observed, landmarks)
    if width is not None:
        k = NAMES.index("hip_y")
        usual_depth = 0.62 * width if depth is None else depth
        # Harrington et al. (2007), regression of adults and children, mm in the paper.
        dimensions[k], spread[k] = 0.33 * width + 0.0073, 0.006
        forward, up = 0.24 * usual_depth + 0.0099, 0.30 * width + 0.0109
        for row, one in zip(places, landmarks, strict=True):
            side = np.sign(one.place[1])
            if one.name.endswith("asis"):
                row[:] = forward, 0.5 * width * side, up
            elif one.name.endswith("psis"):
                row[0], row[2] = forward - usual_depth, up
            elif one.name == "sacrum" and depth is not None:
                row[0] = forward - usual_depth
    return _Prior(dimensions, spread, places, place_spread)


def _pelvis_size(
    observed: Array, landmarks: tuple[Landmark, ...]
) -> tuple[float | None, float | None]:
    """Return width (between ASIS) and depth (to PSIS or sacrum) of the pelvis [m] or None."""
    at = {one.name: observed[:, k] for k, one in enumerate(landmarks)}

    def median(a: Array, b: Array) -> float | None:
        length = np.linalg.norm(a - b, axis=1)
        return float(np.nanmedian(length)) if np.isfinite(length).any() else None

    if not {"left_asis", "right_asis"} <= at.keys():
        return None, None
    left, right, behind = at["left_asis"], at["right_asis"], at.get("sacrum")
    if {"left_psis", "right_psis"} <= at.keys():
        behind = 0.5 * (at["left_psis"] + at["right_psis"])
    depth = None if behind is None else median(0.5 * (left + right), behind)
    return median(left, right), depth


def _bundle_adjustment(
    poses: Poses, observed: Array, markers: MarkerSet, prior: _Prior
) -> Calibration:
    """Optimise postures, dimensions and places together, by the Schur complement."""
    cost, damping = _total_cost(poses, observed, markers, prior), 1e-3
    for _ in range(MAX_ITERATIONS):
        step, pose_steps = _step(poses, observed, markers, prior, damping)
        tried = poses.step(pose_steps)
        sizes, place = np.split(step, [len(NAMES)])
        stepped = replace(
            markers,
            dimensions=markers.dimensions + sizes,
            place=markers.place + place.reshape(-1, 3),
        )
        new = _total_cost(tried, observed, stepped, prior)
        if new > cost:
            damping *= 10.0
            if damping > 1e6:
                break
            continue
        decrease, cost = cost - new, new
        poses, markers = tried, stepped
        damping = max(0.1 * damping, 1e-9)
        if decrease < CONVERGED_DECREASE * cost:
            break
    residual = residuals(poses, observed, markers)
    rms = float(np.sqrt(np.nanmean((residual**2).sum(axis=2))))
    return Calibration(markers, 0.0, poses, rms)


def _step(
    poses: Poses, observed: Array, markers: MarkerSet, prior: _Prior, damping: float
) -> tuple[Array, Array]:
    """Return the steps of the body (12 + 3 m) and of the postures (n, 40)."""
    frames, W, JW, r, H, g = linearize(poses, observed, markers)
    A = _body_jacobian(frames, markers)
    H[:, np.arange(DOFS), np.arange(DOFS)] *= 1.0 + damping
    cross = JW @ A  # (n, 40, b)
    AW = (A * W).reshape(-1, A.shape[2])
    B = AW.T @ A.reshape(-1, A.shape[2])
    b = AW.T @ r.ravel()
    spread = np.concatenate((prior.dimension_spread, prior.place_spread.ravel()))
    deviation = np.concatenate(
        (markers.dimensions - prior.dimensions, (markers.place - prior.place).ravel())
    )
    B[np.diag_indices_from(B)] = np.diagonal(B) * (1.0 + damping) + spread**-2
    b += deviation * spread**-2
    solved = np.linalg.solve(H, np.concatenate((cross, g[..., None]), axis=2))
    S = B - np.einsum("nij,nik->jk", cross, solved[..., :-1], optimize=True)
    s = b - np.einsum("nij,ni->j", cross, solved[..., -1])
    step = -cho_solve(cho_factor(S), s)
    return step, -(solved[..., -1] + solved[..., :-1] @ step)


def _body_jacobian(frames: SegmentFrames, markers: MarkerSet) -> Array:
    """Return the Jacobian (n, 3 m, 12 + 3 m) of all markers by dimensions and places."""
    by_dimensions = dimension_jacobian(frames, markers.anchors)
    count, many = by_dimensions.shape[:2]
    A = np.zeros((count, many, 3, len(NAMES) + 3 * many))
    A[..., : len(NAMES)] = by_dimensions
    for k, segment in enumerate(markers.segments):
        first = len(NAMES) + 3 * k
        A[:, k, :, first : first + 3] = frames.rotation[:, segment]
    return A.reshape(count, 3 * many, -1)


def _total_cost(poses: Poses, observed: Array, markers: MarkerSet, prior: _Prior) -> float:
    _, cost = weights(residuals(poses, observed, markers), markers.noise)
    total = cost.sum() + ((poses.angles / SPREADS) ** 2).sum()
    total += (((markers.dimensions - prior.dimensions) / prior.dimension_spread) ** 2).sum()
    total += (((markers.place - prior.place) / prior.place_spread) ** 2).sum()
    return float(total)
