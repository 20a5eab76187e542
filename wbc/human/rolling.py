"""Where a human's body is by its steps, in which the CoP rolls over the sole.

A millimetre by which skin moves the whole body at the rate of steps is 10 to 20 mm of the CoP that
the motion asks for. Of the CoP itself more is known than that: seen from the shank it moves on an
arc, as if the human rolled on a wheel, at any speed (Hansen, Childress and Knox 2004, Clin.
Biomech. 19, 407-414), and the load goes over from foot to foot smoothly. Least squares weigh both.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from wbc.human.contacts import Bools
from wbc.human.residual_noise import CENTRE
from wbc.motion.dropouts import runs
from wbc.motion.filtering import low_passed
from wbc.motion.series import RmpSeries
from wbc.robot.series import FRAMES_PER_CALL, state_series
from wbc.validate import Array

# Parts of the stature: how far a foot's CoP is in front of the ankle under an upright shank, how
# much farther for each rad by which that leans forward, and at most, at the ball; outwards it goes
# by a part of its way, up to a part of the stature. As plates had them in steps of nine walks
# (docs/howto/humans.md says which); in others it was 20 mm off.
UPRIGHT, ARC, BALL, ASIDE, OUTWARD = 0.006, 0.28, 0.085, 0.3, 0.016
COP = 0.02  # m: one standard deviation of that
# m/s^2: of the CoM's acceleration by the markers, and where none of them is on the trunk.
SWAY, SWAY_OF_LEGS = 0.25, 0.5
FORWARD = 0.5  # m/s: the CoM's speed in the foot's direction, from which on feet roll
PRESSED = 0.3  # of the weight: with less on the ground the CoP means little
END = 0.5  # periods of the cutoff at both ends, which are guesses
AGAIN = 4  # times that what the low-pass takes of the moves is added to them
FAR = 0.15  # m rms, half a sole: what asks for such a CoP is no human that only its feet carry


def moved_by_steps(
    series: RmpSeries, down: Bools, stature: float, sway: float = SWAY
) -> tuple[Array, tuple[str, ...]]:
    """Return by how much the body is beside where markers have it, and notes.

    Parameters
    ----------
    series:
        Of the motion that markers tell, n frames.
    down:
        Which feet are down (n, 2), left and right.
    stature:
        [m].
    sway:
        One standard deviation of the CoM's acceleration by the markers [m/s^2].

    Returns
    -------
    tuple
        (n, 2) along x and y [m], of the motion before its low-pass, 0 without steps forward; notes.
    """
    time, push = series.time, series.ground_force[:, 2]
    load, known = _loads(down)
    spots, ahead = _rolled(series, stature)
    speed = (load * (ahead @ series.com_velocity[:, :2, None])[..., 0]).sum(axis=1)
    least = PRESSED * series.robot.weight
    stepping = known & (speed > FORWARD) & (push > least)
    if series.cutoff is not None:
        edge = END / series.cutoff
        stepping &= (time > time[0] + edge) & (time < time[-1] - edge)
    still = np.zeros((len(time), 2))
    if not stepping.any():
        return still, ()
    spot = (load[..., None] * spots).sum(axis=1)
    spot = np.column_stack([np.interp(time, time[known], one) for one in spot[known].T])
    # As smooth as the motion's: the low-pass is of forces and moments.
    step = float(time[1] - time[0])
    lift = np.maximum(low_passed(push[:, None], 1.0 / step, series.cutoff), least)
    spot = low_passed(spot * push[:, None], 1.0 / step, series.cutoff) / lift
    off = np.where(stepping[:, None], spot - series.cop[:, :2], 0.0)
    rms = float(np.sqrt((off[stepping] ** 2).sum(axis=1).mean()))
    if rms > FAR:
        what = f"the motion asks for a CoP {1e3 * rms:.0f} mm beside where feet roll over"
        return still, (f"{what}: something else carries, or it weighs otherwise",)
    height = series.com[:, 2] - series.ground_height
    lag = height * series.robot.mass / np.maximum(push, least)
    found = _weighed(off, stepping, lag, step, sway)
    size = 1e3 * np.sqrt((found[stepping] ** 2).sum(axis=1).mean())
    return _before_low_pass(found, 1.0 / step, series.cutoff), (
        f"moved by {size:.1f} mm rms to where the CoP rolls over the soles in steps",
    )


def _before_low_pass(wanted: Array, rate: float, cutoff: float | None) -> Array:
    """Return what a low-pass [Hz] turns into ``wanted`` (n, k), nearly; van Cittert (1931)."""
    found = wanted
    for _ in range(AGAIN):
        found = found + wanted - low_passed(found, rate, cutoff)
    return found


def _loads(down: Bools) -> tuple[Array, Bools]:
    """Return each foot's part of the load (n, 2), and where it is known (n,).

    On both feet where that is a step's: from the one that stood before to the one that stands
    after, by a cubic (medians of 21 walks are within 0.06 of it).
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


def _rolled(series: RmpSeries, stature: float) -> tuple[Array, Array]:
    """Return the CoP (n, 2, 2) [m] of each foot if it stands alone, and where the foot points."""
    spots, ahead = np.empty((2, len(series), 2, 2))
    robot = series.robot
    for k, (side, foot) in enumerate(robot.feet.items()):
        shank, ankle, sole = f"{side}_shank", f"{side}_foot", foot.frame
        sign = 1.0 if side == "left" else -1.0
        for first in range(0, len(series), FRAMES_PER_CALL):
            part = slice(first, first + FRAMES_PER_CALL)
            states = state_series(robot, series.q[part], frames=(shank, ankle, sole))
            at, (x, y, z) = states.position(ankle), states.rotation(sole).transpose(2, 0, 1)
            below = at - z * ((at - states.position(sole)) * z).sum(axis=1)[:, None]
            level = x[:, :2] / np.maximum(np.linalg.norm(x[:, :2], axis=1), 1e-3)[:, None]
            leg = states.position(shank) - at
            lean = np.arctan2((leg[:, :2] * level).sum(axis=1), leg[:, 2])
            front = stature * np.clip(UPRIGHT + ARC * lean, 0.0, BALL)
            out = sign * np.minimum(ASIDE * front, stature * OUTWARD)
            spots[part, k] = (below + front[:, None] * x + out[:, None] * y)[:, :2]
            ahead[part, k] = level
    return spots, ahead


def _weighed(off: Array, stepping: Bools, reach: Array, step: float, sway: float = SWAY) -> Array:
    """Return the moves (n, 2) by which the CoP moves by ``off`` where feet step, as far as likely.

    Parameters
    ----------
    reach:
        (n,) [s^2]: by how much the CoP lags behind the CoM for its acceleration.
    step:
        Between frames [s].
    """
    count = len(off)
    inner = sparse.diags_array(
        [1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count - 2, count), dtype=float
    ).tocsr()
    push = sparse.vstack((inner[:1], inner, inner[-1:])) / step**2
    moves = sparse.eye_array(count) - sparse.diags_array(reach) @ push
    heavy = moves.T @ sparse.diags_array(stepping / COP**2)
    whole = heavy @ moves + push.T @ push / sway**2 + sparse.eye_array(count) / CENTRE**2
    return np.asarray(spsolve(whole.tocsc(), heavy @ off))
