"""Problems in YAML files: from text to a run and its result. The only place that knows YAML."""

from wbc.problem.ending import RunStatus
from wbc.problem.history import History
from wbc.problem.json_schema import json_schema
from wbc.problem.overrides import parse_override
from wbc.problem.problem import Problem, load_problem
from wbc.problem.result import Result
from wbc.problem.run import Progress

__all__ = [
    "History",
    "Problem",
    "Progress",
    "Result",
    "RunStatus",
    "json_schema",
    "load_problem",
    "parse_override",
]
