"""Plans turns without momentum: the closed joint path of least cost with a given net rotation.

The unknowns are the Fourier coefficients of the path. The cost is the mean of the squared joint
rates by the phase; the rotation of a round, a product over even phases, is an equality; joint
ranges are bounds at these phases, and distances between bodies are linearised at the last path.
IPOPT solves a sequence of such problems, in which the rotation grows to the given one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from wbc.constraints import SelfCollision
from wbc.errors import InvalidInputError, WbcError
from wbc.flight.connection import rotation_of, turning_rate
from wbc.flight.rounds import CHECK_PHASES, JointLoop, Rounds, even_phases, harmonics
from wbc.kinds import check_kind, whole_number
from wbc.robot import Robot, Snapshot
from wbc.robot.chains import followers
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_robot
from wbc.robot.tree import refuse_loops
from wbc.rotations import log_rotation
from wbc.validate import Array, finite_array, finite_number, names_of, read_only

# Parts of joints' names that move by default: all but head, hands and ankles, if so called.
LIMBS = ("hip", "knee", "shoulder", "elbow", "waist", "torso", "arm", "leg")
HARMONICS = 2
# Numbers of phases: of rotation and ranges in the NLP, and of distances.
SOLVER_PHASES, DISTANCE_PHASES = 24, 72
START_DEVIATION = 0.3  # rad: of the random first coefficients
ITERATIONS, GROWTH = 16, 4  # in all, and those in which the rotation grows
TRUST, DECAY = 0.4, 0.7  # rad or m of joints' motion per iteration, and its decay
TOLERANCE = 1e-4  # rad, of a round's rotation
COARSE = 0.02  # rad: largest error that is due to the number of phases
ACTIVE_DISTANCE = 0.03  # m above its margin up to which a pair has rows
LINEAR_MARGIN = 5e-4  # m beyond the margin, as rows are linear
HOPELESS = 5e-3  # m: a larger violation late in the iteration is not recovered
IPOPT: dict[str, Any] = {
    "ipopt.hessian_approximation": "limited-memory",
    "ipopt.max_iter": 60,
    "ipopt.tol": 1e-4,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "print_time": False,
    "error_on_fail": False,
}
Rows = list[tuple[Array, Array]]  # matrices of the coefficients, and lower bounds


class NoTurnError(WbcError):
    """No path was found with the given rotation within the robot's limits."""


def plan_turn(
    robot: Robot,
    rotation: ArrayLike,
    *,
    q: ArrayLike | None = None,
    cycles: int = 4,
    period: float = 3.0,
    joints: Sequence[str] | None = None,
    margin: float = 0.02,
    collision: SelfCollision | None = None,
    starts: int = 6,
    seed: int = 0,
) -> Rounds:
    """Return a turn in free flight, without momentum, that begins and ends at one posture.

    Parameters
    ----------
    rotation:
        Rotation vector (3,) [rad] in the base's axes at the start; up to half a turn.
    q:
        Configuration (nq,) at the start; None: standing.
    cycles:
        Number of rounds of the path, each with an equal part of the rotation.
    period:
        Mean duration of a round [s].
    joints:
        Names or patterns of the joints that move; mimic joints and their drivers go together. None:
        those called after hips, knees, shoulders, elbows, waist, torso, arms or legs, else all.
    margin:
        Distance from joint limits [rad or m].
    collision:
        Margins between bodies; None: no such constraint.
    starts:
        Largest number of random first paths; the first that converges is used.
    seed:
        Of the random paths.

    Raises
    ------
    InvalidInputError
        A rotation of zero or beyond half a turn, no cycles or joints, or a robot with closed loops
        or on a fixed base.
    UnknownNameError
        A pattern that matches no joint.
    NoTurnError
        No start converged; more cycles make it easier.
    """
    check_robot("turn, robot", robot)
    refuse_loops("turn", robot)
    if robot.fixed_base:
        raise InvalidInputError(f"turn: the base of {robot.name} is fixed; load it floating")
    check_kind("turn, collision", collision, SelfCollision, "SelfCollision(robot)", or_none=True)
    total = finite_array("turn, rotation", rotation, (3,))
    angle = float(np.linalg.norm(total))
    if not 0.0 < angle <= np.pi:
        raise InvalidInputError(f"turn, rotation: {angle:.4g} rad; above 0 and up to half a turn")
    count = whole_number("turn, cycles", cycles, least=1)
    finite_number("turn, period", period, above=0.0)
    posture = robot.posture("standing") if q is None else robot.check_configuration(q)
    patterns = _limbs(robot) if joints is None else names_of("turn, joints", joints)
    if not patterns:
        raise InvalidInputError("turn, joints: name at least one that moves")
    problem = _Problem.of(robot, posture, patterns, margin, collision)
    random, reason = np.random.default_rng(whole_number("turn, seed", seed)), ""
    for _ in range(whole_number("turn, starts", starts, least=1)):
        first = START_DEVIATION * random.standard_normal((2 * HARMONICS, len(problem.moving)))
        result = problem.solve(total / count, first)
        if isinstance(result, JointLoop):
            return Rounds(robot, posture, read_only(result.coefficients), count, period)
        reason = result
    raise NoTurnError(
        f"{robot.name}: no path turns it by {angle / count:.3g} rad in one of {count} cycles"
        f" ({starts} starts; the last: {reason}); give more cycles, more joints or smaller margins"
    )


def _limbs(robot: Robot) -> tuple[str, ...]:
    """Return the names of the joints that move by default."""
    names = robot.joint_names
    found = tuple(name for name in names if any(limb in name.lower() for limb in LIMBS))
    return found or tuple(names)


@dataclass(frozen=True, eq=False)
class _Problem:
    """The optimisation problem of a path."""

    robot: Robot
    posture: Array
    moving: NDArray[np.int64]  # indices of the joints that move by themselves, among all (nv-6)
    ratios: Array  # (k, nv-6): how all joints go with these, followers by their gears' ratios
    # Bounds of these, relative to the start, which leave their followers in range. The start may be
    # nearer to a limit than the margin: the path then leaves it without speed, see _solve_nlp.
    lower: Array
    upper: Array
    collision: SelfCollision | None
    rate: ca.Function  # the robot's mechanical connection
    # From the coefficients, joint by joint, to the quaternion's vector part (3,) after a round, and
    # to its Jacobian.
    end: ca.Function
    jacobian: ca.Function

    @classmethod
    def of(
        cls,
        robot: Robot,
        posture: Array,
        joints: Sequence[str],
        margin: float,
        collision: SelfCollision | None,
    ) -> _Problem:
        chosen = {k - BASE_NV for pattern in joints for k in robot.joint_indices(pattern)}
        gears = [*followers(robot)]
        drivers = {follower: driver for follower, driver, _ in gears}
        moving = np.array(sorted({drivers.get(k, k) for k in chosen}))
        ratios = (np.arange(robot.nv - BASE_NV) == moving[:, None]).astype(float)
        for follower, driver, gear in gears:
            ratios[moving == driver, follower] = gear.ratio
        start = robot.limits.joint_positions(posture)
        margin = finite_number("turn, margin", margin, least=0.0)
        limits = robot.limits
        lower, upper = _closed(limits.lower + margin - start, limits.upper - margin - start)
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.sort((lower / ratios, upper / ratios), axis=0)
        goes = ratios != 0.0
        lower, upper = _closed(
            np.where(goes, ends[0], -np.inf).max(axis=1),
            np.where(goes, ends[1], np.inf).min(axis=1),
        )
        rate = turning_rate(robot)
        end, jacobian = _end_rotation(rate, start, ratios)
        return cls(robot, posture, moving, ratios, lower, upper, collision, rate, end, jacobian)

    def solve(self, rotation: Array, first: Array) -> JointLoop | str:
        """Return a path whose round has a rotation vector (3,), or in words why there is none.

        A trust region limits the change of the path, as distances are linearised; the error of the
        rotation at more phases is added to the target.
        """
        coefficients, offset, reason = first, np.zeros(3), ""
        rows: Rows = []
        for number in range(ITERATIONS):
            part = min(1.0, (number + 1) / GROWTH)
            radius = TRUST * DECAY ** max(0, number - GROWTH) if number else np.inf
            coefficients = self._solve_nlp(part * rotation + offset, coefficients, rows, radius)
            loop = self.loop(coefficients)
            error = part * rotation - log_rotation(rotation_of(self.rate, loop, CHECK_PHASES))
            norm = float(np.linalg.norm(error))
            rows, gap, pair = self._distance_rows(loop)
            outside = self._out_of_range(loop)
            reason = f"{norm:.2g} rad off, {pair} too near by {1e3 * max(0.0, -gap):.2g} mm"
            reason += f", out of range: {', '.join(outside)}" if outside else ""
            if part == 1.0 and norm < TOLERANCE and gap >= 0.0 and not outside:
                return loop
            if number > ITERATIONS // 2 and (gap < -HOPELESS or norm > COARSE):
                return reason
            if norm < COARSE:
                offset = offset + error
        return reason

    def loop(self, coefficients: Array) -> JointLoop:
        """Return the path of all joints."""
        start = self.robot.limits.joint_positions(self.posture)
        return JointLoop(start, coefficients @ self.ratios)

    def _out_of_range(self, loop: JointLoop) -> list[str]:
        """Return the joints that leave their limits, margins aside, at some phase."""
        limits, joints = self.robot.limits, loop.at(even_phases(CHECK_PHASES))
        beyond = ((joints < limits.lower) | (joints > limits.upper)).any(axis=0)
        return [self.robot.joint_names[k] for k in np.flatnonzero(beyond)]

    def _snapshots(self, loop: JointLoop) -> list[Snapshot]:
        steps = np.zeros((DISTANCE_PHASES, self.robot.nv))
        steps[:, BASE_NV:] = loop.at(even_phases(DISTANCE_PHASES)) - loop.start
        integrate, snapshot = self.robot.integrate, self.robot.snapshot
        return [snapshot(integrate(self.posture, step, 1.0)) for step in steps]

    def _distance_rows(self, loop: JointLoop) -> tuple[Rows, float, str]:
        """Return the rows of near pairs, the smallest clearance [m], and its pair."""
        rows, smallest, pair = Rows(), np.inf, "nothing"
        if self.collision is None or not len(self.collision.model.pairs):
            return rows, smallest, pair
        basis = harmonics(even_phases(DISTANCE_PHASES), HARMONICS)
        moved = loop.at(even_phases(DISTANCE_PHASES))[:, self.moving] - loop.start[self.moving]
        for k, snapshot in enumerate(self._snapshots(loop)):
            found = self.collision.distances(snapshot)
            nearest = int(found.clearance.argmin())
            if found.clearance[nearest] < smallest:
                smallest = float(found.clearance[nearest])
                pair = self.collision.labels(found)[nearest]
            active = found.clearance < ACTIVE_DISTANCE
            J = found.jacobian[active][:, BASE_NV:] @ self.ratios.T
            # With joints at basis @ coefficients: clearance + J (that - moved) >= LINEAR_MARGIN.
            matrix = (J[:, :, None] * basis[k]).reshape(len(J), -1)
            rows.append((matrix, LINEAR_MARGIN - found.clearance[active] + J @ moved[k]))
        return rows, smallest, pair

    def _solve_nlp(self, rotation: Array, last: Array, rows: Rows, radius: float) -> Array:
        """Return the optimal coefficients, with joints within ``radius`` of the last path.

        Joints that start nearer to a limit than the margin begin and end without speed, or they
        would pass it between two phases, and have the whole margin after half a round.
        """
        count, phases = len(self.moving), even_phases(SOLVER_PHASES)
        # Unknown: the coefficients joint by joint, x = C.T.ravel().
        path = np.kron(np.eye(count), harmonics(phases, HARMONICS))
        rates = harmonics(phases, HARMONICS, 1)
        hessian = ca.DM(np.kron(np.eye(count), rates.T @ rates / SOLVER_PHASES))
        part = 0.5 * (1.0 - np.cos(phases))
        lowest, highest = (
            np.where((sign * each >= 0.0)[:, None], np.outer(each, part), each[:, None]).ravel()
            for sign, each in ((1.0, self.lower), (-1.0, self.upper))
        )
        tight = np.eye(count)[(self.lower >= 0.0) | (self.upper <= 0.0)]
        slopes = np.kron(tight, harmonics(np.zeros(1), HARMONICS, 1))
        current = path @ last.T.ravel()
        # The last path may be out of range by more than the trust region.
        least = np.minimum(np.maximum(lowest, current - radius), highest)
        most = np.maximum(np.minimum(highest, current + radius), lowest)
        linear = np.vstack([path, slopes, *(matrix for matrix, _ in rows)])
        still, bounds = np.zeros(len(slopes)), [bound for _, bound in rows]
        lower = np.concatenate([least, still, *bounds])
        upper = np.concatenate([most, still, *(np.full(len(bound), np.inf) for bound in bounds)])
        x, p = ca.MX.sym("x", last.size), ca.MX.sym("p", 0)
        A, gradient = ca.DM(linear), ca.mtimes(hessian, x)
        g, f = ca.vertcat(self.end(x), ca.mtimes(A, x)), 0.5 * ca.dot(x, gradient)
        # CasADi's own derivative of these many rows takes a pass for each unknown.
        derivatives: dict[str, Any] = {
            "jac_g": ca.Function("jac_g", [x, p], [g, ca.vertcat(self.jacobian(x), A)]),
            "grad_f": ca.Function("grad_f", [x, p], [f, gradient]),
        }
        nlp: dict[str, Any] = {"x": x, "p": p, "f": f, "g": g}
        solver = ca.nlpsol("turn", "ipopt", nlp, IPOPT | derivatives)
        angle = max(float(np.linalg.norm(rotation)), 1e-12)
        target = np.sin(0.5 * angle) / angle * rotation
        solution = solver(
            x0=last.T.ravel(),
            lbg=np.concatenate((target, lower)),
            ubg=np.concatenate((target, upper)),
        )
        return np.array(solution["x"]).reshape(count, -1).T


def _closed(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Return bounds, both zero where they leave nothing between them."""
    open_ = lower <= upper
    return np.where(open_, lower, 0.0), np.where(open_, upper, 0.0)


def _end_rotation(
    rate: ca.Function, start: Array, selection: Array
) -> tuple[ca.Function, ca.Function]:
    """Return the functions from coefficients to the quaternion's vector part, and its Jacobian."""
    phases, step = even_phases(SOLVER_PHASES), 2.0 * np.pi / SOLVER_PHASES
    x = ca.MX.sym("x", 2 * HARMONICS * len(selection))
    C = ca.reshape(x, 2 * HARMONICS, len(selection))
    moved, rates = (
        ca.mtimes([ca.DM(harmonics(phases, HARMONICS, k)), C, ca.DM(selection)]).T for k in (0, 1)
    )
    rotations = step * rate.map(SOLVER_PHASES)(moved + ca.DM(start), rates)
    p, w = ca.SX.sym("p", 4), ca.SX.sym("w", 3)
    half = 0.5 * ca.sqrt(ca.sumsqr(w) + 1e-20)
    a, b, c = p[:3], 0.5 * w * ca.sin(half) / half, ca.cos(half)
    product = ca.vertcat(p[3] * b + c * a + ca.cross(a, b), p[3] * c - ca.dot(a, b))
    advance = ca.Function("advance", [p, w], [product]).mapaccum(SOLVER_PHASES)
    end = advance(ca.DM([0.0, 0.0, 0.0, 1.0]), rotations)[:3, -1]
    return ca.Function("end", [x], [end]), ca.Function("slopes", [x], [ca.jacobian(end, x)])
