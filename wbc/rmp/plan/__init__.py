"""Planning of the reaction mass pendulum's motion over a schedule of contacts."""

from wbc.rmp.plan.check import Check, check
from wbc.rmp.plan.plan import Plan, Stats, generalised
from wbc.rmp.plan.planner import PlanError, solve
from wbc.rmp.plan.problem import PlanProblem, Weights
from wbc.rmp.plan.schedule import (
    Corners,
    PathLimits,
    PlanPhase,
    State,
    at_rest,
    hull,
    radii_for,
    rectangle,
)
from wbc.rmp.plan.store import load_plan, plan_arrays, problem_from_data, problem_to_data, save_plan

__all__ = [
    "Check",
    "Corners",
    "PathLimits",
    "Plan",
    "PlanError",
    "PlanPhase",
    "PlanProblem",
    "State",
    "Stats",
    "Weights",
    "at_rest",
    "check",
    "generalised",
    "hull",
    "load_plan",
    "plan_arrays",
    "problem_from_data",
    "problem_to_data",
    "radii_for",
    "rectangle",
    "save_plan",
    "solve",
]
