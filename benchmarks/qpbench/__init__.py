"""Solver benchmarks on recorded sequences of QPs, and their comparison with earlier ones."""
