"""Solver benchmarks on recorded sequences of QPs, and their comparison with earlier ones."""

from wbc.bench.compare import SpeedChange, compare
from wbc.bench.measure import Measured, measure
from wbc.bench.sequence import QpSequence, load_sequence, save_sequence
from wbc.bench.solvers import CANDIDATES, candidate_names
from wbc.bench.suite import STANDARD, record, record_problem
from wbc.bench.summary import load_summary, summarise

__all__ = [
    "CANDIDATES",
    "STANDARD",
    "Measured",
    "QpSequence",
    "SpeedChange",
    "candidate_names",
    "compare",
    "load_sequence",
    "load_summary",
    "measure",
    "record",
    "record_problem",
    "save_sequence",
    "summarise",
]  # fmt: skip
