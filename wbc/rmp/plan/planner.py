"""Search for a plan: IPOPT on the transcribed problem, cold or from an earlier plan."""

from __future__ import annotations

from collections.abc import Sequence
from time import process_time
from typing import Any

import numpy as np

from wbc.errors import InvalidInputError, WbcError
from wbc.kinds import check_kind, whole_number
from wbc.rmp.plan.check import UNITS, Excess, check
from wbc.rmp.plan.layout import scale_of, units_of
from wbc.rmp.plan.nlp import PlanNlp, elastic
from wbc.rmp.plan.plan import Plan, Stats
from wbc.rmp.plan.problem import PlanProblem
from wbc.rmp.plan.transcription import Transcription, first_guess, transcribe
from wbc.validate import Array

ITERATIONS = 100
# Scaled variables and rows are of order one: absolute tolerances suit them all.
_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt.sb": "yes",
    "ipopt.linear_solver": "mumps",
    "ipopt.nlp_scaling_method": "none",
    "ipopt.tol": 1e-8,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.bound_relax_factor": 1e-10,
    # Enters the restoration phase early: plans are found as fast, and infeasibility in a third of
    # the time.
    "ipopt.expect_infeasible_problem": "yes",
}
_WARM: dict[str, Any] = {
    "ipopt.warm_start_init_point": "yes",
    "ipopt.mu_init": 1e-6,
    "ipopt.warm_start_bound_push": 1e-7,
    "ipopt.warm_start_bound_frac": 1e-7,
    "ipopt.warm_start_slack_bound_push": 1e-7,
    "ipopt.warm_start_slack_bound_frac": 1e-7,
    "ipopt.warm_start_mult_bound_push": 1e-7,
}
# Cost of violating a scaled row by one, against costs of order one.
_VIOLATION_COST = 1000.0
_DIAGNOSIS = 120  # iterations
_LARGEST_DEFECT = 1e-3  # attempts with larger defects are not reported as motions, SI
_SHOWN = 5  # violations in an error's message


class PlanError(WbcError):
    """No plan was found; ``status`` is IPOPT's status.

    ``attempt`` is the motion that meets the dynamics and violates limits and goal least (sum of
    squares in the problem's units), and ``violations`` are its excesses, the worst first. If all
    are small, the search failed rather than that limits contradict each other.
    """

    def __init__(self, status: str, violations: Sequence[Excess], attempt: Plan) -> None:
        self.status, self.violations, self.attempt = status, tuple(violations), attempt
        super().__init__(_message(status, self.violations))


def _message(status: str, violations: tuple[Excess, ...]) -> str:
    if not violations:
        return (
            f"no plan found (IPOPT: {status}), though no contradiction either: the limits and the"
            " goal can be met nearly; give more iterations, a plan of a similar problem as warm"
            " start, or an easier schedule"
        )
    lines = [f"no plan found (IPOPT: {status}); the nearest motion:"]
    lines += [f"  {each}" for each in violations[:_SHOWN]]
    if len(violations) > _SHOWN:
        lines.append(f"  and {len(violations) - _SHOWN} more")
    lines.append("loosen one of these, or give the schedule more time or support there")
    return "\n".join(lines)


def solve(
    problem: PlanProblem,
    warm: Plan | None = None,
    *,
    verbose: bool = False,
    iterations: int = ITERATIONS,
) -> Plan:
    """Return a locally optimal plan, from a straight-line guess or from ``warm``.

    ``warm`` is a plan of a problem with the same phases in the same order; numbers may differ. If
    the number of rows is the same too, its multipliers are used as well. ``verbose`` prints the
    size, IPOPT's iterations and its status; IPOPT may take ``iterations``, >= 1.

    Raises
    ------
    PlanError
        No plan exists, or none was found; the error names the limits that conflict.
    InvalidInputError
        Limits that exclude each other, a warm start with other phases, or numbers that IPOPT
        cannot start on.
    """
    check_kind("solve: problem", problem, PlanProblem)
    check_kind("solve: warm", warm, Plan, or_none=True)
    iterations = whole_number("solve: iterations", iterations, least=1)
    began = process_time()
    t = transcribe(problem)
    start, duals = first_guess(t), None
    if warm is not None:
        start, duals = _warm_start(t, warm)
    options = {"ipopt.max_iter": iterations, "ipopt.print_level": 5 if verbose else 0}
    plan, solved = _search(t, t.nlp, start, duals, options, began, warm is not None)
    if verbose:
        s = plan.stats
        print(
            f"plan of {len(plan.phases)} phases: {s.variables} variables, {s.constraints}"
            f" constraints, {s.iterations} iterations, {s.seconds:.2f} s, cost {s.cost:.4g}:"
            f" {s.status}"
        )
    if not solved:
        raise _failure(t, plan.stats.status)
    return plan


def _search(
    t: Transcription,
    nlp: PlanNlp,
    start: Array,
    duals: tuple[Array, Array] | None,
    options: dict[str, Any],
    began: float,
    warm: bool = False,
) -> tuple[Plan, bool]:
    """Run IPOPT, and return whether it succeeded.

    Variables beyond the transcription's are free, and zero at first.
    """
    count = t.layout.count
    spare = nlp.w.numel() - count
    solver = nlp.solver(_OPTIONS | options | ({} if duals is None else _WARM))
    given: dict[str, Any] = {
        "x0": np.concatenate((start, np.zeros(spare))),
        "lbx": np.concatenate((t.lower, np.full(spare, -np.inf))),
        "ubx": np.concatenate((t.upper, np.full(spare, np.inf))),
        "lbg": t.row_lower,
        "ubg": t.row_upper,
    }
    if duals is not None:
        given |= {"lam_x0": duals[0], "lam_g0": duals[1]}
    try:
        found, end = solver(**given), solver.stats()
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise InvalidInputError(f"plan: IPOPT cannot start on these numbers: {reason}") from error
    stats = Stats(
        variables=count,
        constraints=len(t.labels),
        iterations=int(end["iter_count"]),
        seconds=process_time() - began,
        cost=float(found["f"]),
        status=str(end["return_status"]),
        warm=warm,
    )
    w, at_bounds, at_rows = (found[name].full().ravel() for name in ("x", "lam_x", "lam_g"))
    return Plan(t.problem, w[:count], (at_bounds[:count], at_rows), stats), end["success"]


def _failure(t: Transcription, status: str) -> PlanError:
    """Return the error, after a search for the least infeasible motion."""
    options = {"ipopt.max_iter": _DIAGNOSIS, "ipopt.print_level": 0}
    softened = elastic(t.nlp, t.soft, _VIOLATION_COST)
    nearest, _ = _search(t, softened, first_guess(t), None, options, process_time())
    seen = check(nearest)
    # If even this search did not converge, its result may violate the dynamics.
    unmet = [
        Excess("whole plan", f"equation of motion of {name}", nearest.duration, defect, UNITS[name])
        for name, defect in seen.defects.items()
        if defect > _LARGEST_DEFECT
    ]
    units = units_of(t.problem)
    # Newtons and metres are compared in the problem's units, not as bare numbers.
    size = {
        "N": units["force"],
        "N m": 0.1 * units["force"] * units["com"],
        "m": units["com"],
        "m/s": units["com_velocity"],
        "m/s^2": t.problem.gravity,
        "kg m^2/s": units["momentum"],
        "s": units["time"],
    }
    violations = sorted(seen.violations, key=lambda each: -each.amount / size.get(each.unit, 1.0))
    return PlanError(status, (*violations, *unmet), nearest)


def _warm_start(t: Transcription, warm: Plan) -> tuple[Array, tuple[Array, Array] | None]:
    """Return variables, and multipliers if the programmes have the same shape."""
    same = [
        (a.flies, a.intervals) == (b.flies, b.intervals)
        for a, b in zip(t.problem.schedule, warm.problem.schedule, strict=False)
    ]
    fits = len(t.problem.schedule) == len(warm.problem.schedule) and all(same)
    if not fits or len(warm.solution) != t.layout.count:
        raise InvalidInputError(
            "solve: a warm start needs a plan with as many phases, flights where these are"
            " flights, as many intervals in each, the same degree and kind of pendulum"
        )
    # Clipped to the new problem's bounds, which may fix durations and start.
    start = np.clip(warm.solution * scale_of(warm.problem, t.layout) / t.scale, t.lower, t.upper)
    duals = warm.duals
    return start, duals if len(duals[1]) == len(t.labels) else None
