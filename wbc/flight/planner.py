"""Plans turns without momentum: the least closed path of joints that leaves a rotation behind.

Unknown are the Fourier coefficients of the path. Its cost is the mean of the squared joint rates by
the phase; the rotation that a round leaves behind, the product of those between even phases, is an
equality; joint ranges are kept at these phases, and bodies apart by distances that are linearised
where the last path was. IPOPT solves, round by round, while the rotation grows to what is asked.
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
from wbc.flight.rounds import JointLoop, Rounds, even_phases, harmonics
from wbc.robot import Robot, Snapshot
from wbc.robot.limits import BASE_NV
from wbc.robot.tree import refuse_loops
from wbc.rotations import log_rotation
from wbc.validate import Array, finite_array, finite_number, read_only

JOINTS = ("*hip*", "*knee*", "*shoulder*", "*elbow*", "*waist*")
HARMONICS = 2
# At which a path is judged while it is sought: its rotation and ranges, its distances; in the end.
PHASES, DISTANCES, CHECKED = 24, 72, 400
SPREAD = 0.3  # rad: coefficients of the first paths
ROUNDS, GROWING = 16, 4  # of linearised distances; of these the first, in which the rotation grows
NEAR, CALMING = 0.4, 0.7  # rad or m: from round to round joints move by no more, and ever less
ACCURATE = 1e-4  # rad: what the rotation of a round may be off by
CLOSE = 0.02  # rad: what is more is no matter of few phases
WATCHED = 0.03  # m: pairs nearer than their margins and this get rows
ROOM = 5e-4  # m: what rows keep beyond the margin, as they are linear
HOPELESS = 5e-3  # m: what is still so near when joints hardly move any more stays so
IPOPT: dict[str, Any] = {
    "ipopt.hessian_approximation": "limited-memory",
    "ipopt.max_iter": 60,
    "ipopt.tol": 1e-4,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "print_time": False,
    "error_on_fail": False,
}
Rows = list[tuple[Array, Array]]  # matrices on the coefficients, and lower bounds


class NoTurnError(WbcError):
    """No path was found that turns the robot as far as was asked and keeps its limits."""


def plan_turn(
    robot: Robot,
    rotation: ArrayLike,
    *,
    q: ArrayLike | None = None,
    cycles: int = 4,
    period: float = 3.0,
    joints: Sequence[str] = JOINTS,
    margin: float = 0.02,
    collision: SelfCollision | None = None,
    starts: int = 6,
    seed: int = 0,
) -> Rounds:
    """Return a turn in free flight, without momentum, that begins and ends in one posture.

    Parameters
    ----------
    rotation:
        Rotation vector (3,) [rad] in the base's axes at the start; up to half a turn.
    q:
        Configuration (nq,) at the start; None: standing.
    cycles:
        Rounds of the same path, each of which turns by a part of the rotation.
    period:
        Mean time for a round [s].
    joints:
        Names or patterns of those that move.
    margin:
        Kept from joint limits [rad or m].
    collision:
        Margins between bodies that are kept; None: not looked at.
    starts:
        Random paths to begin from, at most; the first that leads to a turn is taken.
    seed:
        Of the random paths.

    Raises
    ------
    InvalidInputError
        A rotation of nothing or beyond half a turn, no cycles, or a robot with closed loops.
    UnknownNameError
        A pattern that matches no joint.
    NoTurnError
        No start led to a turn; more cycles make it easier.
    """
    refuse_loops("turn", robot)
    whole = finite_array("turn, rotation", rotation, (3,))
    angle = float(np.linalg.norm(whole))
    if not 0.0 < angle <= np.pi:
        raise InvalidInputError(f"turn, rotation: {angle:.4g} rad; above 0 and up to half a turn")
    count = int(finite_number("turn, cycles", cycles, least=1.0))
    finite_number("turn, period", period, above=0.0)
    posture = robot.posture("standing") if q is None else robot.check_configuration(q)
    problem = _Problem.of(robot, posture, joints, margin, collision)
    random, told = np.random.default_rng(seed), ""
    for _ in range(int(finite_number("turn, starts", starts, least=1))):
        first = SPREAD * random.standard_normal((2 * HARMONICS, len(problem.moving)))
        found = problem.solve(whole / count, first)
        if isinstance(found, JointLoop):
            return Rounds(robot, posture, read_only(found.coefficients), count, period)
        told = found
    raise NoTurnError(
        f"{robot.name}: no path turns it by {angle / count:.3g} rad in one of {count} cycles"
        f" ({starts} starts; the last: {told}); give more cycles, more joints or smaller margins"
    )


@dataclass(frozen=True, eq=False)
class _Problem:
    """A path to be found."""

    robot: Robot
    posture: Array
    moving: NDArray[np.int64]  # indices of the joints that move, among all (nv-6)
    # lower and upper: what these may do, from where they are at the start.
    lower: Array
    upper: Array
    collision: SelfCollision | None
    rate: ca.Function  # the robot's mechanical connection
    # end and slopes: from the coefficients, joint by joint, to the quaternion's vector part (3,)
    # after a round, and to its Jacobian.
    end: ca.Function
    slopes: ca.Function

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
        moving = np.array(sorted(chosen))
        start = robot.limits.joint_positions(posture)
        room = finite_number("turn, margin", margin, least=0.0)
        lower, upper = robot.limits.lower + room - start, robot.limits.upper - room - start
        # It may begin nearer to a limit than the margin.
        lower, upper = np.minimum(lower, 0.0)[moving], np.maximum(upper, 0.0)[moving]
        rate = turning_rate(robot)
        end, slopes = _end_of_round(rate, start, moving)
        return cls(robot, posture, moving, lower, upper, collision, rate, end, slopes)

    def solve(self, rotation: Array, first: Array) -> JointLoop | str:
        """Return a path whose round turns the robot by a rotation vector (3,), or what it lacks.

        Joints stay near to the last path, where distances are linearised; what the rotation is off
        by at closer phases is asked for in addition.
        """
        coefficients, beyond, why = first, np.zeros(3), ""
        rows: Rows = []
        for number in range(ROUNDS):
            part = min(1.0, (number + 1) / GROWING)
            room = NEAR * CALMING ** max(0, number - GROWING) if number else np.inf
            coefficients = self._least(part * rotation + beyond, coefficients, rows, room)
            loop = self.loop(coefficients)
            off = part * rotation - log_rotation(rotation_of(self.rate, loop, CHECKED))
            size = float(np.linalg.norm(off))
            rows, near, pair = self._distance_rows(loop)
            why = f"{size:.2g} rad off, {pair} too near by {1e3 * max(0.0, -near):.2g} mm"
            if part == 1.0 and size < ACCURATE and near >= 0.0 and self._in_range(loop):
                return loop
            if number > ROUNDS // 2 and (near < -HOPELESS or size > CLOSE):
                return why
            if size < CLOSE:
                beyond = beyond + off
        return why

    def loop(self, coefficients: Array) -> JointLoop:
        """Return the path of all joints."""
        spread = np.zeros((len(coefficients), self.robot.nv - BASE_NV))
        spread[:, self.moving] = coefficients
        return JointLoop(self.robot.limits.joint_positions(self.posture), spread)

    def _in_range(self, loop: JointLoop) -> bool:
        """Return whether all joints are inside their limits, if not the margin, all round."""
        limits, joints = self.robot.limits, loop.at(even_phases(CHECKED))
        return bool((joints >= limits.lower).all() and (joints <= limits.upper).all())

    def _snapshots(self, loop: JointLoop) -> list[Snapshot]:
        steps = np.zeros((DISTANCES, self.robot.nv))
        steps[:, BASE_NV:] = loop.at(even_phases(DISTANCES)) - loop.start
        integrate, snapshot = self.robot.integrate, self.robot.snapshot
        return [snapshot(integrate(self.posture, step, 1.0)) for step in steps]

    def _distance_rows(self, loop: JointLoop) -> tuple[Rows, float, str]:
        """Return rows of the pairs that are near; the least clearance [m], and between what."""
        rows, least, pair = list[tuple[Array, Array]](), np.inf, "nothing"
        if self.collision is None:
            return rows, least, pair
        basis = harmonics(even_phases(DISTANCES), HARMONICS)
        moved = loop.at(even_phases(DISTANCES))[:, self.moving] - loop.start[self.moving]
        for k, snapshot in enumerate(self._snapshots(loop)):
            found = self.collision.distances(snapshot)
            nearest = int(found.clearance.argmin())
            if found.clearance[nearest] < least:
                least = float(found.clearance[nearest])
                pair = self.collision.labels(found)[nearest]
            near = found.clearance < WATCHED
            J = found.jacobian[near][:, BASE_NV + self.moving]
            # Joints move by basis @ coefficients: clearance + J (that - moved) >= ROOM.
            matrix = (J[:, :, None] * basis[k]).reshape(len(J), -1)
            rows.append((matrix, ROOM - found.clearance[near] + J @ moved[k]))
        return rows, least, pair

    def _least(self, rotation: Array, last: Array, rows: Rows, room: float) -> Array:
        """Return the coefficients of the least path, with joints within ``room`` of the last."""
        count, phases = len(self.moving), even_phases(PHASES)
        # Unknown: the coefficients joint by joint, x = C.T.ravel().
        path = np.kron(np.eye(count), harmonics(phases, HARMONICS))
        rates = harmonics(phases, HARMONICS, 1)
        hessian = ca.DM(np.kron(np.eye(count), rates.T @ rates / PHASES))
        here = path @ last.T.ravel()
        least = np.maximum(np.repeat(self.lower, PHASES), here - room)
        most = np.minimum(np.repeat(self.upper, PHASES), here + room)
        linear = np.vstack([path, *(matrix for matrix, _ in rows)])
        lower = np.concatenate([least, *(bound for _, bound in rows)])
        upper = np.concatenate((most, np.full(len(linear) - len(most), np.inf)))
        x, p = ca.MX.sym("x", last.size), ca.MX.sym("p", 0)
        A, slope = ca.DM(linear), ca.mtimes(hessian, x)
        g, f = ca.vertcat(self.end(x), ca.mtimes(A, x)), 0.5 * ca.dot(x, slope)
        # CasADi's own derivative of so many rows takes a pass for each unknown.
        given: dict[str, Any] = {
            "jac_g": ca.Function("jac_g", [x, p], [g, ca.vertcat(self.slopes(x), A)]),
            "grad_f": ca.Function("grad_f", [x, p], [f, slope]),
        }
        nlp: dict[str, Any] = {"x": x, "p": p, "f": f, "g": g}
        solver = ca.nlpsol("turn", "ipopt", nlp, IPOPT | given)
        angle = max(float(np.linalg.norm(rotation)), 1e-12)
        wanted = np.sin(0.5 * angle) / angle * rotation
        found = solver(
            x0=last.T.ravel(),
            lbg=np.concatenate((wanted, lower)),
            ubg=np.concatenate((wanted, upper)),
        )
        return np.array(found["x"]).reshape(count, -1).T


def _end_of_round(
    rate: ca.Function, start: Array, moving: NDArray[np.int64]
) -> tuple[ca.Function, ca.Function]:
    """Return the functions of the coefficients to (3,) of the quaternion, and to its Jacobian."""
    phases, step = even_phases(PHASES), 2.0 * np.pi / PHASES
    chosen = np.zeros((len(moving), len(start)))
    chosen[np.arange(len(moving)), moving] = 1.0
    x = ca.MX.sym("x", 2 * HARMONICS * len(moving))
    C = ca.reshape(x, 2 * HARMONICS, len(moving))
    moved, rates = (
        ca.mtimes([ca.DM(harmonics(phases, HARMONICS, k)), C, ca.DM(chosen)]).T for k in (0, 1)
    )
    turned = step * rate.map(PHASES)(moved + ca.DM(start), rates)
    p, w = ca.SX.sym("p", 4), ca.SX.sym("w", 3)
    half = 0.5 * ca.sqrt(ca.sumsqr(w) + 1e-20)
    a, b, c = p[:3], 0.5 * w * ca.sin(half) / half, ca.cos(half)
    product = ca.vertcat(p[3] * b + c * a + ca.cross(a, b), p[3] * c - ca.dot(a, b))
    advance = ca.Function("advance", [p, w], [product]).mapaccum(PHASES)
    end = advance(ca.DM([0.0, 0.0, 0.0, 1.0]), turned)[:3, -1]
    return ca.Function("end", [x], [end]), ca.Function("slopes", [x], [ca.jacobian(end, x)])
