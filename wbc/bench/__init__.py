"""Solver benchmarks on recorded sequences of QPs."""

from wbc.bench.measure import Measured, measure
from wbc.bench.sequence import QpSequence, load_sequence, load_sequences, save_sequence
from wbc.bench.solvers import CANDIDATES, candidate_names
from wbc.bench.suite import STANDARD, record, record_problem
from wbc.bench.summary import summarise

__all__ = [
    "CANDIDATES", "STANDARD", "Measured", "QpSequence", "candidate_names", "load_sequence",
    "load_sequences", "measure", "record", "record_problem", "save_sequence",
    "summarise",
]  # fmt: skip
