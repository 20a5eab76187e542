"""Correction of a human's horizontal position by the roll-over shape of its feet.

A millimetre by which skin moves the whole body at the rate of steps is 10 to 20 mm of the CoP that
the motion requires. The CoP is known more precisely: seen from the shank it moves on an arc, as if
the human rolled on a wheel, at any speed (Hansen, Childress and Knox 2004, Clin. Biomech. 19,
407-414), and the load shifts smoothly from foot to foot. Least squares weigh both.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from wbc.human.residual_noise import CENTRE_DEVIATION
from wbc.motion.dropouts import runs
from wbc.motion.filtering import low_pass
from wbc.motion.series import RmpSeries
from wbc.robot.series import FRAMES_PER_CALL, state_series
from wbc.validate import Array, Bools

# The CoP of a foot in front of the ankle, by the stature: with an upright shank, more per rad of
# forward lean, and at most, at the ball. Outwards it moves by a part of that, at most by the last
# part of the stature. From force plates in steps of nine walks (docs/howto/humans.md says which);
# in others it was 20 mm off.
UPRIGHT_COP, COP_PER_LEAN, MAX_COP, OUTWARD_PART, MAX_OUTWARD = 0.006, 0.28, 0.085, 0.3, 0.016
COP_DEVIATION = 0.02  # m, standard deviation of that
# m/s^2, standard deviation of the CoM's acceleration by markers with and without ones on the trunk.
SWAY, SWAY_WITHOUT_TRUNK = 0.25, 0.5
MIN_SPEED = 0.5  # m/s, of the CoM in the foot's direction for feet to roll
MIN_LOAD = 0.3  # of the weight: with less the CoP is ill-defined
DROPPED_PERIODS = 0.5  # of the cutoff at both ends, where filters extrapolate
INVERSE_ITERATIONS = 4  # of van Cittert's inverse of the low-pass
MAX_ERROR = 0.15  # m rms, half a sole: beyond, something else than the feet carries the human


def roll_over_correction(
    series: RmpSeries, down: Bools, stature: float, sway: float = SWAY
) -> tuple[Array, tuple[str, ...]]:
    """Return the displacement of the body from its position by the markers, and notes.

    Parameters
    ----------
    series:
        Of the motion by the markers, n frames.
    down:
        Which feet are down (n, 2), left and right.
    stature:
        [m].
    sway:
        Standard deviation of the CoM's acceleration by the markers [m/s^2].

    Returns
    -------
    tuple
        (n, 2) along x and y [m], for the motion before its low-pass, 0 without forward steps; and
        notes.
    """
    time, push = series.time, series.ground_force[:, 2]
    load, known = _load_shares(down)
    foot_cop, heading = _roll_over_cop(series, stature)
    speed = (load * (heading @ series.com_velocity[:, :2, None])[..., 0]).sum(axis=1)
    min_load = MIN_LOAD * series.robot.weight
    stepping = known & (speed > MIN_SPEED) & (push > min_load)
    if series.cutoff is not None:
        edge = DROPPED_PERIODS / series.cutoff
        stepping &= (time > time[0] + edge) & (time < time[-1] - edge)
    none = np.zeros((len(time), 2))
    if not stepping.any():
        return none, ()
    cop = (load[..., None] * foot_cop).sum(axis=1)
    cop = np.column_stack([np.interp(time, time[known], one) for one in cop[known].T])
    # As smooth as the motion's CoP, whose forces and moments are low-passed.
    dt = float(time[1] - time[0])
    vertical = np.maximum(low_pass(push[:, None], 1.0 / dt, series.cutoff), min_load)
    cop = low_pass(cop * push[:, None], 1.0 / dt, series.cutoff) / vertical
    error = np.where(stepping[:, None], cop - series.cop[:, :2], 0.0)
    rms = float(np.sqrt((error[stepping] ** 2).sum(axis=1).mean()))
    if rms > MAX_ERROR:
        what = f"the motion requires a CoP {1e3 * rms:.0f} mm from the roll-over of its feet"
        return none, (f"{what}: something else carries the human, or its mass is another",)
    height = series.com[:, 2] - series.ground_height
    time_constant_sq = height * series.robot.mass / np.maximum(push, min_load)
    found = _least_squares(error, stepping, time_constant_sq, dt, sway)
    size = 1e3 * np.sqrt((found[stepping] ** 2).sum(axis=1).mean())
    return _invert_low_pass(found, 1.0 / dt, series.cutoff), (
        f"moved by {size:.1f} mm rms so that the CoP rolls over the soles in steps",
    )


def _invert_low_pass(wanted: Array, rate: float, cutoff: float | None) -> Array:
    """Return a signal that a low-pass [Hz] turns into ``wanted`` (n, k); van Cittert (1931)."""
    found = wanted
    for _ in range(INVERSE_ITERATIONS):
        found = found + wanted - low_pass(found, rate, cutoff)
    return found


def _load_shares(down: Bools) -> tuple[Array, Bools]:
    """Return each foot's part of the load (n, 2), and where it is known (n,).

    In the double support of a step it shifts from the foot before to the foot after it by a cubic
    (medians of 21 walks are within 0.06 of it).
    """
    load = down.astype(float)
    both, known = np.asarray(down.all(axis=1)), np.asarray(down.any(axis=1))
    for first, end in runs(both):
        known[first:end] = False
        if first == 0 or end == len(both) or (down[first - 1] == down[end]).any():
            continue
        x = np.arange(1, end - first + 1) / (end - first + 1)
        new = int(down[end].argmax())
        load[first:end, new] = x * x * (3.0 - 2.0 * x)
        load[first:end, 1 - new] = 1.0 - load[first:end, new]
        known[first:end] = True
    return load, known


def _roll_over_cop(series: RmpSeries, stature: float) -> tuple[Array, Array]:
    """Return the CoP (n, 2, 2) [m] under each foot alone, and the foot's direction (n, 2, 2)."""
    cop, heading = np.empty((2, len(series), 2, 2))
    robot = series.robot
    for k, (side, foot) in enumerate(robot.feet.items()):
        shank, ankle, sole = f"{side}_shank", f"{side}_foot", foot.frame
        sign = 1.0 if side == "left" else -1.0
        for first in range(0, len(series), FRAMES_PER_CALL):
            part = slice(first, first + FRAMES_PER_CALL)
            states = state_series(robot, series.q[part], frames=(shank, ankle, sole))
            origin, (x, y, z) = states.position(ankle), states.rotation(sole).transpose(2, 0, 1)
            below = origin - z * ((origin - states.position(sole)) * z).sum(axis=1)[:, None]
            direction = x[:, :2] / np.maximum(np.linalg.norm(x[:, :2], axis=1), 1e-3)[:, None]
            leg = states.position(shank) - origin
            lean = np.arctan2((leg[:, :2] * direction).sum(axis=1), leg[:, 2])
            front = stature * np.clip(UPRIGHT_COP + COP_PER_LEAN * lean, 0.0, MAX_COP)
            out = sign * np.minimum(OUTWARD_PART * front, stature * MAX_OUTWARD)
            cop[part, k] = (below + front[:, None] * x + out[:, None] * y)[:, :2]
            heading[part, k] = direction
    return cop, heading


def _least_squares(
    error: Array, stepping: Bools, time_constant_sq: Array, dt: float, sway: float = SWAY
) -> Array:
    """Return the most likely displacement (n, 2) of the CoM that removes the CoP's error in steps.

    ``error``: wanted displacement of the CoP (n, 2) [m]; ``time_constant_sq``: (n,) [s^2]: distance
    from CoM to CoP by the CoM's acceleration.
    """
    count = len(error)
    inner = sparse.diags_array(
        [1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count - 2, count), dtype=float
    ).tocsr()
    D = sparse.vstack((inner[:1], inner, inner[-1:])) / dt**2
    cop = sparse.eye_array(count) - sparse.diags_array(time_constant_sq) @ D
    weighted = cop.T @ sparse.diags_array(stepping / COP_DEVIATION**2)
    H = weighted @ cop + D.T @ D / sway**2 + sparse.eye_array(count) / CENTRE_DEVIATION**2
    return np.asarray(spsolve(H.tocsc(), weighted @ error))
