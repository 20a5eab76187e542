"""Upper bounds of the largest push that a walking pendulum captures, for walk_pushes.py.

A robot walks and is pushed at its trunk as in walk_pushes.py. Here a linear inverted pendulum
replaces it, whose footsteps, landing times and CoP are chosen with the push known beforehand,
within the walker's assumptions: reach and acceleration of the legs, whole soles, least and longest
swing times. Bounds:

pendulum     no angular momentum about the CoM;
momentum     its rate is at most RATE, and it returns to rest: its integral is within TURN of the
             locked inertia;
inertia      likewise, while arms and legs make the inertia up to SPREAD times as large.

    python benchmarks/walk_bounds.py [benchmarks/walk_bounds.json] [--robot g1] [--rate 35 120]

With the DCM xi = c + (c' + kappa)/omega, kappa = (k_y, -k_x)/(M h) (wbc.gait.phases.GaitState), xi'
= omega (xi - p) - kappa + push. For given times the largest impulse is thus a linear program, axis
by axis. Times are searched one after the other on a grid until none improves it: a bound for that
grid, and a local one in the times.
"""

import argparse
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from disturbed import robot_named
from scipy.optimize import linprog
from walk_pushes import LASTING, PHASES, SIDES, SPEED

from wbc.gait import Velocity, Walker
from wbc.gait.dcm import shift_gain
from wbc.gait.footsteps import SIGN, nominal_offset, nominal_step, other
from wbc.gait.reference import CATCH_ACCELERATION, MAX_TIME_RATIO, MIN_TIME_RATIO
from wbc.gait.whole_body import heaviest_link
from wbc.minimum_jerk import minimum_jerk, minimum_jerk_rates
from wbc.native import lib
from wbc.validate import Array

FILE = Path(__file__).with_suffix(".json")
STEPS = 4  # so many are chosen
GRID = 0.02  # s, of times of landing and of the momentum
# Searches begin with so much of the usual time on one foot, and end where they gain less [N s].
BEGIN, LEAST = (1.0, 0.6), 0.05
SOONEST = 0.04  # s, that is left in the air at least
SUPPORT = "left"  # the foot that bears after an even number of steps
RATES = (35.0, 120.0)  # N m: of a G1's waist; of all its joints on one foot
TURN, SPREAD = 0.6, 1.5  # rad; of the inertia
AHEAD = {"back", "front"}


@dataclass(frozen=True)
class Walk:
    """The walker's assumptions along one axis of a straight walk, pushed along that axis."""

    omega: float
    step: tuple[float, float]  # from each foot to the next, from SUPPORT and from the other [m]
    offset: float  # of the DCM from the next foot as that begins to bear [m]
    single: float
    double: float
    reach: tuple[tuple[float, float], tuple[float, float]]  # likewise: least, most [m]
    acceleration: float  # of a foot [m/s^2]
    sole: float  # half of it [m]
    shove: float  # of the DCM by an impulse [m / (N s)]
    lever: float  # kappa by an impulse [m/s / (N s)]
    rate: float  # of kappa [m/s^2]
    turn: float  # integral of kappa, either way [m]
    way: float  # of the push along the axis


def walks(name: str, side: str, rate: float, turn: float) -> Walk:
    """Return the walk of a robot pushed from a side; ``turn`` [rad], of its locked inertia."""
    robot = robot_named(name)
    walker = Walker(robot)
    gait, limits, axis = walker.gait, walker.limits, 0 if side in AHEAD else 1
    velocity = Velocity(SPEED[name], 0.0, 0.0)
    start = robot.snapshot(robot.posture("standing"))
    above = float(start.position(heaviest_link(robot))[2] - start.com[2])
    mass, omega, swing = robot.mass, gait.omega, other(SUPPORT)
    ways = [nominal_step(gait, foot, 0.0, velocity) for foot in (SUPPORT, swing)]
    step = [(way.real, way.imag)[axis] for way in ways]
    offset = nominal_offset(gait, swing, 0.0, velocity)
    far, aside = limits.catch, (gait.least_width, limits.catch_aside)
    beside = [sorted(SIGN[foot] * a for a in aside) for foot in (swing, SUPPORT)]
    reach = [(-far, far)] * 2 if axis == 0 else [(low, high) for low, high in beside]
    half = min(float(half[axis]) for half in walker._planner.soles.values())
    inertia = float(start.inertia[1 - axis, 1 - axis])
    return Walk(
        omega,
        (step[0], step[1]),
        (offset.real, offset.imag)[axis],
        gait.single,
        gait.double,
        (reach[0], reach[1]),
        CATCH_ACCELERATION * limits.swing,
        half,
        (1.0 + above / gait.height) / (mass * omega),
        above / (mass * gait.height),
        rate / (mass * gait.height),
        turn * inertia / (mass * gait.height),
        1.0 if side in ("back", "right") else -1.0,
    )


@dataclass(frozen=True)
class Start:
    """The walk as the push begins, relative to the foot that bears load, or begins to."""

    dcm: float
    double: float  # of the double support that is left [s]
    elapsed: float  # on one foot [s]
    foot: float  # in the air, or behind [m]
    rate: float  # [m/s]

    @classmethod
    def of(cls, walk: Walk, phase: float) -> "Start":
        """Return it after this part of a step, which begins with the double support."""
        w, time = walk.omega, phase * (walk.single + walk.double)
        behind = -walk.step[1]  # where the VRP comes from
        elapsed = max(time - walk.double, 0.0)
        leaving = math.exp(-w * walk.double) * (
            shift_gain(w, walk.double) * walk.step[0] + walk.offset
        )
        dcm = math.exp(-w * (walk.single - elapsed)) * leaving
        left = max(walk.double - time, 0.0)
        if left:
            lead = -behind / (walk.double * w)
            vrp = behind * left / walk.double
            dcm = vrp + lead + math.exp(-w * left) * (dcm - lead)
        s = elapsed / walk.single
        way = walk.step[0] - behind
        rate = way * minimum_jerk_rates(s)[0] / walk.single
        return cls(dcm, left, elapsed, behind + way * minimum_jerk(s), rate)


def captured(walk: Walk, start: Start, times: Sequence[float]) -> float:
    """Return the largest impulse captured with these single-support times [N s]; -inf if none.

    Unknown are the impulse, the places of the next feet, what the pressure is off its line in each
    support (a mean, weighted as the DCM weighs it), and kappa at the nodes of the grid.
    """
    w, n = walk.omega, len(times)
    nodes = math.ceil((sum(times) + n * walk.double + start.double) / GRID) if walk.rate else 0
    count = 1 + n + (2 * n + 1) + nodes
    feet, soles, kappas = 1, 1 + n, 1 + n + 2 * n + 1
    row, constant = np.zeros(count), start.dcm

    def foot(k: int) -> Array:
        """Return the row of a foot: 0 is the one that bears now, at the origin."""
        one = np.zeros(count)
        if k > 0:
            one[feet + k - 1] = 1.0
        return one

    def held(since: float, until: float) -> float:
        return math.exp(-w * since) - math.exp(-w * until)

    def moved(since: float, until: float) -> float:
        """Return the discounted mean of a displacement at constant rate in this interval."""
        d = until - since
        return math.exp(-w * since) * (1.0 - math.exp(-w * d) * (1.0 + w * d)) / (w * d)

    now, upper, most, sole = 0.0, list[Array](), list[float](), soles
    if start.double:
        # The rest of the way from the foot behind to the origin.
        behind = start.foot * start.double / walk.double
        constant -= behind * (held(0.0, start.double) - moved(0.0, start.double))
        row[sole] += held(0.0, start.double)
        now, sole = start.double, sole + 1
    else:
        sole += 1
    for k, time in enumerate(times):
        end = now + time
        row += held(now, end) * foot(k)
        row[sole] += held(now, end)
        swung = end + walk.double
        shift = moved(end, swung)
        row += (held(end, swung) - shift) * foot(k) + shift * foot(k + 1)
        row[sole + 1] += held(end, swung)
        sole, now = sole + 2, swung
        low, high = walk.reach[k % 2]
        way = foot(k + 1) - foot(k)
        upper += [way, -way]
        most += [high, -low]
        # At rest in time: from where it is and as fast as it is, or from where it stood.
        T, far = time, lib.wbc_rest_range * walk.acceleration * time**2
        if k == 0:
            from_, reached = np.zeros(count), start.foot + 0.5 * T * start.rate
        else:
            from_, reached = foot(k - 1) if k > 1 else np.zeros(count), 0.0
        upper += [foot(k + 1) - from_, from_ - foot(k + 1)]
        most += [far + reached, far - reached]
    # xi at the end, discounted, is within the last foot.
    shoved = walk.way * walk.shove * held(0.0, LASTING) / (w * LASTING)
    last = math.exp(-w * now)
    gap = -row - last * foot(n)
    gap[0] += shoved
    edges = np.arange(nodes + 1) * GRID
    bound: list[tuple[float | None, float | None]] = [(0.0, None)] + [(None, None)] * n
    bound += [(-walk.sole, walk.sole)] * (2 * n + 1) + [(None, None)] * nodes
    if nodes:
        gap[kappas:] -= (np.exp(-w * edges[:-1]) - np.exp(-w * edges[1:])) / w
        # Its rate, of which the push gives its lever, and its integral.
        change = np.zeros((nodes + 1, count))
        change[:nodes, kappas:] += np.eye(nodes)
        change[1:, kappas:] -= np.eye(nodes)
        pushed = np.clip((LASTING - edges) / GRID, 0.0, 1.0) * GRID / LASTING
        change[:, 0] = -walk.way * walk.lever * pushed
        total = np.zeros((nodes, count))
        total[:, kappas:] = GRID * np.tri(nodes)
        upper += [*change, *-change, *total, *-total]
        most += [GRID * walk.rate] * (2 * (nodes + 1)) + [walk.turn] * (2 * nodes)
    upper += [gap, -gap]
    room = last * walk.sole
    most += [room - constant, room + constant]
    cost = np.zeros(count)
    cost[0] = -1.0
    found = linprog(cost, np.array(upper), np.array(most), bounds=bound, method="highs")
    return -float(found.fun) if found.status == 0 else -math.inf


def initial_times(walk: Walk, start: Start) -> list[list[float]]:
    """Return the initial single-support times of a search [s]."""
    found = []
    for time in (share * walk.single for share in BEGIN):
        found.append([max(time - start.elapsed, SOONEST)] + [time] * (STEPS - 1))
    return found


def largest(
    walk: Walk, start: Start, begins: Sequence[Sequence[float]]
) -> tuple[float, list[float]]:
    """Return the largest impulse captured [N s], and its single-support times [s].

    They are searched one by one on a grid, from each of those in ``begins`` on.
    """
    return max(improve(walk, start, times) for times in begins)


def improve(walk: Walk, start: Start, times: Sequence[float]) -> tuple[float, list[float]]:
    """Return :func:`largest` from one initial guess."""
    best, before, kept = captured(walk, start, times), -math.inf, list(times)
    while best > before + LEAST:
        before = best
        for k in range(STEPS):
            for time in candidate_times(
                walk, start.elapsed if k == 0 else 0.0, MAX_TIME_RATIO * walk.single
            ):
                tried = [*kept[:k], time, *kept[k + 1 :]]
                got = captured(walk, start, tried)
                if got > best:
                    best, kept = got, tried
    return best, kept


def candidate_times(walk: Walk, elapsed: float, most: float) -> Iterator[float]:
    """Yield candidates of the remaining single-support time [s]."""
    time = max(MIN_TIME_RATIO * walk.single - elapsed, SOONEST)
    while time <= most - elapsed:
        yield time
        time += GRID


def kinds(rates: Sequence[float]) -> dict[str, tuple[float, float]]:
    """Return the rate of momentum [N m] and the turn [rad] of each bound, by name."""
    found = {"pendulum": (0.0, 0.0)}
    for rate in rates:
        found[f"momentum, {rate:g} N m"] = (rate, TURN)
        found[f"inertia, {rate:g} N m"] = (rate, SPREAD * TURN)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", type=Path, nargs="?", default=FILE)
    parser.add_argument("--robot", default="g1", choices=list(SPEED))
    parser.add_argument("--rate", type=float, nargs="+", default=list(RATES), help="N m")
    given = parser.parse_args()
    rows = []
    times: dict[tuple[str, int], list[list[float]]] = {}  # of the pendulum, where others begin
    for kind, (rate, turn) in kinds(given.rate).items():
        for side in SIDES:
            walk = walks(given.robot, side, rate, turn)
            for phase in range(PHASES):
                start = Start.of(walk, phase / PHASES)
                begins = times.get((side, phase), initial_times(walk, start))
                impulse, best = largest(walk, start, begins)
                times.setdefault((side, phase), [best])
                row = {"bound": kind, "side": side, "phase": phase, "impulse": round(impulse, 1)}
                rows.append(row | {"times": [round(time, 3) for time in best]})
                print(json.dumps(rows[-1]), flush=True)
    made_of = {"robot": given.robot, "turn": TURN, "spread": SPREAD, "steps": STEPS, "grid": GRID}
    given.file.write_text(json.dumps({**made_of, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
