"""The dimensions of a human and the places of its markers, from the recording itself.

One Gauss-Newton over postures of some frames, dimensions and marker places together (a bundle
adjustment): joints come to lie where the markers of both segments turn about them, as in functional
methods, and where the motion does not tell, where anatomy has them: the hips by Harrington et al.
(2007, J. Biomech. 40, 595-602), the rest by usual proportions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from wbc.errors import InvalidInputError, listed
from wbc.human.body import NAMES, REFERENCE_STATURE, usual_dimensions
from wbc.human.fit import (
    SPREADS,
    MarkerSet,
    first_poses,
    fit_poses,
    linearised,
    residuals,
    unstuck,
    weights,
)
from wbc.human.kinematics import DOFS, Placed, Poses, dimension_jacobian
from wbc.human.landmarks import Landmark
from wbc.validate import Array

KEY_FRAMES = 40
STEPS = 25
SETTLED = 1e-5
# Spreads from the place that a name has: those of 16 public recordings were within 3.4, but for two
# wrist markers whose names were swapped, which were 5.2 and 5.7 off.
FAR_OFF = 5.0
# m, that a fit takes for possible; who is smaller than CHILD is asked for its unit.
STATURES, CHILD = (0.6, 2.8), 1.1
OTHER = 0.08  # of the stature that was said, to which they lean: limbs that tell another one say so
# Parts of the stature between joints that markers are near to, which tell the stature; de Leva.
_LENGTHS = {
    ("knee", "ankle"): 0.249,
    ("hip", "knee"): 0.2425,
    ("elbow", "wrist"): 0.1545,
    ("shoulder", "elbow"): 0.162,
}


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a recording tells of a human's build."""

    dimensions: Array  # (12,) [m]
    markers: MarkerSet
    stature: float  # [m]: given, or by the lengths found
    poses: Poses  # of the key frames
    rms: float  # of the key frames' marker residuals [m]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Prior:
    """What anatomy says, before any motion: means and standard deviations [m]."""

    dimensions: Array
    dimension_spread: Array
    place: Array  # (m, 3)
    place_spread: Array  # (m, 3)


def key_frames(observed: Array, most: int = KEY_FRAMES) -> NDArray[np.intp]:
    """Return frames spread over a recording (n, m, 3), of those that show most of its markers."""
    seen = np.isfinite(observed).all(axis=2).sum(axis=1)
    good = np.flatnonzero(seen >= max(np.quantile(seen, 0.5), 0.5 * seen.max()))
    return good[np.unique(np.linspace(0, len(good) - 1, min(most, len(good))).round().astype(int))]


def calibrate(
    observed: Array, names: tuple[str, ...], landmarks: tuple[Landmark, ...], stature: float | None
) -> Calibration:
    """Return a human's dimensions and markers, of key frames (n, m, 3) [m]; NaN: not seen.

    Parameters
    ----------
    stature:
        [m]; None: by the lengths between joints.

    Raises
    ------
    InvalidInputError
        Lengths of no human.
    """
    guess = stature if stature is not None else _stature(observed, landmarks)
    for _ in range(2 if stature is None else 1):
        prior = _prior(observed, landmarks, guess)
        markers = MarkerSet(names, landmarks, prior.place.copy())
        # Until places are found, a marker tells no more than how far from the usual one it may be.
        noisy = (replace(one, noise=math.hypot(one.noise, one.spread)) for one in landmarks)
        vague = replace(markers, landmarks=tuple(noisy))
        poses = first_poses(observed, markers, prior.dimensions)
        poses, cost = fit_poses(poses, observed, vague, prior.dimensions)
        poses = _retried(poses, cost, observed, vague, prior.dimensions)
        _, cost = fit_poses(poses, observed, vague, prior.dimensions, 0)
        poses = unstuck(poses, cost, observed, vague, prior.dimensions)
        found = _adjusted(poses, observed, markers, prior)
        limbs = [NAMES.index(n) for n in ("upper_arm", "forearm", "thigh", "shank")]
        parts = found.dimensions[limbs] / usual_dimensions(REFERENCE_STATURE)[0][limbs]
        tall = float(np.clip(np.mean(parts) * REFERENCE_STATURE, *STATURES))
        guess = tall if stature is None else stature
    sizes = dict(zip(NAMES, found.dimensions.tolist(), strict=True))
    odd = next((n for n, size in sizes.items() if size <= 0.0 and not n.endswith("_x")), None)
    if odd is not None:
        raise InvalidInputError(
            f"markers: they are {1e3 * found.rms:.0f} mm off any human, whose {odd} would be"
            f" {sizes[odd]:.3g} m: they are not one human's, or their names mean other places"
        )
    small = f"{guess:.2f} m tall by its lengths: a small child, or are they in another unit?"
    told = (small,) if stature is None and guess < CHILD else ()
    if abs(tall - guess) > OTHER * guess:
        told = (f"by its limbs' lengths it is {tall:.2f} m tall, {guess:g} m was said",)
    return replace(found, stature=guess, notes=told + _misplaced(found, prior))


def _misplaced(found: Calibration, prior: _Prior) -> tuple[str, ...]:
    """Return a note on markers that are far from where their names have them."""
    off = found.markers.place - prior.place
    names = [
        f"{name} ({1e3 * np.linalg.norm(one):.0f} mm)"
        for name, one, spread in zip(found.markers.names, off, prior.place_spread, strict=True)
        if (np.abs(one) > FAR_OFF * spread).any()
    ]
    if not names:
        return ()
    return (f"markers far from where their names have them: {listed(names, 8)}; swapped?",)


def _retried(
    poses: Poses, cost: Array, observed: Array, markers: MarkerSet, dimensions: Array
) -> Poses:
    """Return postures of which bad ones were fitted again, from the best one's joints."""
    best = int(cost.argmin())
    bad = np.flatnonzero(cost > 3.0 * cost[best] + 10.0)
    if not len(bad):
        return poses
    start = poses[bad]
    start.angles[:] = poses.angles[best]
    again, new = fit_poses(start, observed[bad], markers, dimensions)
    better = new < cost[bad]
    poses.put(bad[better], again, better)
    return poses


def _stature(observed: Array, landmarks: tuple[Landmark, ...]) -> float:
    """Return a stature [m] by distances between markers near to joints; 1.7 without any."""
    where = {one.name: k for k, one in enumerate(landmarks)}
    found = list[float]()
    for (a, b), part in _LENGTHS.items():
        for side in ("left", "right"):
            ends = []
            for joint in (a, b):
                kinds = ("centre", "lateral", "medial", "radial", "ulnar")
                names = [f"{side}_{joint}_{kind}" for kind in kinds] + [f"{side}_{joint}"]
                names += [f"{side}_acromion"] if joint == "shoulder" else []
                ends.append(next((n for n in names if n in where), None))
            if None not in ends:
                one, other = (observed[:, where[str(end)]] for end in ends)
                length = np.linalg.norm(one - other, axis=1)
                if np.isfinite(length).any():
                    found.append(float(np.nanmedian(length)) / part)
    if not found:
        return 1.7
    tall, (least, most) = float(np.median(found)), STATURES
    if not least < tall < most:
        raise InvalidInputError(
            f"markers: by the distances between them the human is {tall:.3g} m tall: the file's"
            " lengths are in another unit than it says, or than was said (unit, of a BVH)"
        )
    return tall


def _prior(observed: Array, landmarks: tuple[Landmark, ...], stature: float) -> _Prior:
    dimensions, spread = usual_dimensions(stature)
    scale = stature / REFERENCE_STATURE
    spots = scale * np.array([one.place for one in landmarks])
    spots_spread = scale * np.array([[one.spread] * 3 for one in landmarks])
    width, depth = _pelvis(observed, landmarks)
    if width is not None:
        k = NAMES.index("hip_y")
        deep = 0.62 * width if depth is None else depth
        # Harrington et al. (2007), regression of adults and children, mm in the paper.
        dimensions[k], spread[k] = 0.33 * width + 0.0073, 0.006
        forward, up = 0.24 * deep + 0.0099, 0.30 * width + 0.0109
        for row, one in zip(spots, landmarks, strict=True):
            side = np.sign(one.place[1])
            if one.name.endswith("asis"):
                row[:] = forward, 0.5 * width * side, up
            elif one.name.endswith("psis"):
                row[0], row[2] = forward - deep, up
            elif one.name == "sacrum" and depth is not None:
                row[0] = forward - deep
    return _Prior(dimensions, spread, spots, spots_spread)


def _pelvis(observed: Array, landmarks: tuple[Landmark, ...]) -> tuple[float | None, float | None]:
    """Return width (between ASIS) and depth (to PSIS or sacrum) of the pelvis [m], or None."""
    where = {one.name: k for k, one in enumerate(landmarks)}

    def median(a: Array, b: Array) -> float | None:
        length = np.linalg.norm(a - b, axis=1)
        return float(np.nanmedian(length)) if np.isfinite(length).any() else None

    if not {"left_asis", "right_asis"} <= where.keys():
        return None, None
    left, right = observed[:, where["left_asis"]], observed[:, where["right_asis"]]
    width, depth = median(left, right), None
    if {"left_psis", "right_psis"} <= where.keys():
        behind = 0.5 * (observed[:, where["left_psis"]] + observed[:, where["right_psis"]])
        depth = median(0.5 * (left + right), behind)
    elif "sacrum" in where:
        depth = median(0.5 * (left + right), observed[:, where["sacrum"]])
    return width, depth


def _adjusted(poses: Poses, observed: Array, markers: MarkerSet, prior: _Prior) -> Calibration:
    """Return the joint optimum of postures, dimensions and places, by its Schur complement."""
    dimensions = prior.dimensions.copy()
    cost, damping = _whole_cost(poses, observed, markers, dimensions, prior), 1e-3
    for _ in range(STEPS):
        step, moves = _step(poses, observed, markers, dimensions, prior, damping)
        tried = poses.moved(moves)
        size = dimensions + step[: len(NAMES)]
        set_ = replace(markers, place=markers.place + step[len(NAMES) :].reshape(-1, 3))
        new = _whole_cost(tried, observed, set_, size, prior)
        if new > cost:
            damping *= 10.0
            if damping > 1e6:
                break
            continue
        gain, cost = cost - new, new
        poses, dimensions, markers = tried, size, set_
        damping = max(0.1 * damping, 1e-9)
        if gain < SETTLED * cost:
            break
    rest = residuals(poses, observed, markers, dimensions)
    rms = float(np.sqrt(np.nanmean((rest**2).sum(axis=2))))
    return Calibration(dimensions, markers, 0.0, poses, rms)


def _step(
    poses: Poses,
    observed: Array,
    markers: MarkerSet,
    dimensions: Array,
    prior: _Prior,
    damping: float,
) -> tuple[Array, Array]:
    """Return the steps of the body (12 + 3 m) and of the postures (n, 40)."""
    placed, W, JW, r, H, g = linearised(poses, observed, markers, dimensions)
    A = _body_jacobian(placed, markers)
    H[:, np.arange(DOFS), np.arange(DOFS)] *= 1.0 + damping
    cross = JW @ A  # (n, 40, b)
    AW = (A * W).reshape(-1, A.shape[2])
    B = AW.T @ A.reshape(-1, A.shape[2])
    b = AW.T @ r.ravel()
    spread = np.concatenate((prior.dimension_spread, prior.place_spread.ravel()))
    off = np.concatenate((dimensions - prior.dimensions, (markers.place - prior.place).ravel()))
    B[np.diag_indices_from(B)] = np.diagonal(B) * (1.0 + damping) + spread**-2
    b += off * spread**-2
    solved = np.linalg.solve(H, np.concatenate((cross, g[..., None]), axis=2))
    S = B - np.einsum("nij,nik->jk", cross, solved[..., :-1], optimize=True)
    s = b - np.einsum("nij,ni->j", cross, solved[..., -1])
    step = -cho_solve(cho_factor(S), s)
    return step, -(solved[..., -1] + solved[..., :-1] @ step)


def _body_jacobian(placed: Placed, markers: MarkerSet) -> Array:
    """Return derivatives (n, 3 m, 12 + 3 m) of all markers by dimensions and places."""
    by = dimension_jacobian(placed, markers.anchors)
    count, many = by.shape[:2]
    A = np.zeros((count, many, 3, len(NAMES) + 3 * many))
    A[..., : len(NAMES)] = by
    for k, segment in enumerate(markers.segments):
        first = len(NAMES) + 3 * k
        A[:, k, :, first : first + 3] = placed.rotation[:, segment]
    return A.reshape(count, 3 * many, -1)


def _whole_cost(
    poses: Poses, observed: Array, markers: MarkerSet, dimensions: Array, prior: _Prior
) -> float:
    _, cost = weights(residuals(poses, observed, markers, dimensions), markers.noise)
    whole = cost.sum() + ((poses.angles / SPREADS) ** 2).sum()
    whole += (((dimensions - prior.dimensions) / prior.dimension_spread) ** 2).sum()
    whole += (((markers.place - prior.place) / prior.place_spread) ** 2).sum()
    return float(whole)
