"""When there is no plan: which limits are in the way."""

from __future__ import annotations

from collections.abc import Sequence

from wbc.errors import WbcError
from wbc.rmp.plan.check import Excess
from wbc.rmp.plan.plan import Plan

SHOWN = 5


class PlanError(WbcError):
    """No plan was found.

    Attributes
    ----------
    status:
        IPOPT's verdict.
    violations:
        What is exceeded in the motion that was found to come nearest to a plan, the worst first: it
        obeys the equations of motion and breaks limits and goal as little as it can, the sum of
        squares in sizes of the problem. Small ones everywhere tell of a search that failed, rather
        than of a contradiction. Empty if nothing is exceeded at all.
    attempt:
        That motion.
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
    lines += [f"  {each}" for each in violations[:SHOWN]]
    if len(violations) > SHOWN:
        lines.append(f"  and {len(violations) - SHOWN} more")
    lines.append("loosen one of these, or give the schedule more time or support there")
    return "\n".join(lines)
