"""The rounds of one motion's least squares, from the first configurations to the nearest ones."""

from __future__ import annotations

import numpy as np

from wbc.retargeting.by_tick import Progress, between, first_configuration, tick_pass
from wbc.retargeting.smoothing import Round, WholeMotion
from wbc.retargeting.targets import balanced
from wbc.validate import Array

# Of the whole motion: a round that leaves WORSE times as much that is not kept, if that is much
# [m or rad], or tasks farther off, led astray; it is damped MORE, up to MOST.
WORSE, ASTRAY, MORE, MOST = 2.0, 0.02, 4.0, 100.0
# A round that gains no more of the sum of squares than this part is the last one, and one that
# leaves so little by frame.
SETTLED, ENOUGH = 0.05, 0.4
TRAPPED = 0.2  # rad or m: feet so far off after the first pass are behind something
LEAST_ROUNDS = 2
# What is nearly right is damped less from round to round, for light tasks such as arms to come to
# their targets, and more after so many if joints are too fast.
PATIENT, BOLDER, BOLDEST, CALMER, CALMEST = 6, 0.7, 1.0, 1.5, 15.0
NEARLY = 1.02  # of speeds and accelerations: what is so little beyond is not slowed down


def solved(
    motion: WholeMotion, axes: Array, rounds: int, balance: bool, progress: Progress | None,
    begun: Array | None,
) -> Round:  # fmt: skip
    """Return the round whose configurations (n, nq) are as near to the targets as they come.

    What is hard is kept but for what tasks pull at it. ``begun``: those of the same motion in other
    time (m, nq), from which to go on.
    """
    tasks, collision = motion.tasks, motion.collision
    robot = tasks.robot
    constraints = [] if collision is None else [collision]
    if begun is None:
        start = first_configuration(tasks, constraints)
        q = tick_pass(tasks, start, constraints, progress)
    else:
        q = between(robot, begun, np.linspace(0.0, len(begun) - 1.0, len(tasks.targets.time)))
    states = motion.states(q)
    tasks.shape_like(states.inertia, axes)
    best = motion.looked_at(q, states)
    if begun is None and best.violation > TRAPPED:  # legs that do not get past each other
        freely = motion.looked_at(tick_pass(tasks, start, (), progress))
        best = min(best, freely, key=lambda one: one.violation)
    for number in range(1, rounds + 1):
        q = motion.stepped(best)
        states = motion.states(q)
        if balance:
            k = states.part("momentum", 6)[:, 3:]
            tasks.targets = balanced(tasks.targets, robot, k, states.com)
        before, now = best, motion.looked_at(q, states)
        near, hurried = now.violation < ASTRAY, now.haste > NEARLY
        dearer = near and before.violation < ASTRAY and now.cost > before.cost
        if before.haste > NEARLY and now.haste < before.haste:
            dearer = False  # what joints are too slow or too weak for costs something
        if dearer or now.violation > max(WORSE * before.violation, ASTRAY):
            motion.damping *= MORE
            if motion.damping > MOST:
                break
            continue
        best = now
        if not near:
            continue
        steady = before.violation < ASTRAY and now.cost > (1.0 - SETTLED) * before.cost
        if hurried and number >= PATIENT and now.haste > (1.0 - SETTLED) * before.haste:
            hurried = not steady  # it gets no slower
        if number >= LEAST_ROUNDS and not hurried and (steady or now.cost < ENOUGH):
            break
        if number < PATIENT or now.haste <= NEARLY:
            motion.damping = max(BOLDER * motion.damping, BOLDEST)
        else:  # joints that are too fast move to and fro
            motion.damping = min(CALMER * motion.damping, CALMEST)
    return best
