"""Problems in YAML files: from text to a run and its result. The only place that knows YAML."""

from wbc.problem.json_schema import json_schema
from wbc.problem.overrides import parse_override
from wbc.problem.problem import Problem, load_problem
from wbc.run.history import History
from wbc.run.result import Result
from wbc.run.simulate import Progress
from wbc.run.stopping import RunStatus

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
