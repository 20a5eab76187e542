"""Polynomials on an interval, time s = 0..1, as lists of coefficients of powers; and nodes.

Coefficients are columns, symbols or numbers. Bernstein's coefficients of a polynomial enclose it:
a convex bound on each of them holds at every s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import comb

import casadi as ca
import numpy as np

from wbc.validate import Array

Polynomial = list[ca.SX]


def line(first: ca.SX, last: ca.SX) -> Polynomial:
    """Return the polynomial from one value to another."""
    return [first, last - first]


def total(a: Polynomial, b: Polynomial) -> Polynomial:
    """Return a + b."""
    size = max(len(a), len(b))
    zero = ca.SX.zeros(a[0].shape)
    padded = [[*p, *([zero] * (size - len(p)))] for p in (a, b)]
    return [x + y for x, y in zip(*padded, strict=True)]


def scaled(a: Polynomial, factor: ca.SX | float) -> Polynomial:
    """Return factor * a."""
    return [factor * x for x in a]


def product(a: Polynomial, b: Polynomial, times: Callable[[ca.SX, ca.SX], ca.SX]) -> Polynomial:
    """Return a times b, by any bilinear product of their coefficients."""
    out: list[ca.SX | None] = [None] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            term, sofar = times(x, y), out[i + j]
            out[i + j] = term if sofar is None else sofar + term
    return [x for x in out if x is not None]


def integral(a: Polynomial, start: ca.SX, length: ca.SX) -> Polynomial:
    """Return start + length * integral of a from 0 to s."""
    return [start, *(length * x / (k + 1) for k, x in enumerate(a))]


def value(a: Polynomial, s: ca.SX | float) -> ca.SX:
    """Return a(s), by Horner's rule."""
    result = a[-1]
    for x in a[-2::-1]:
        result = x + s * result
    return result


def bernstein(a: Polynomial) -> list[ca.SX]:
    """Return Bernstein's coefficients; the first and the last are the values at the ends."""
    n = len(a) - 1
    out = []
    for k in range(n + 1):
        terms = [comb(k, i) / comb(n, i) * a[i] for i in range(k + 1)]
        out.append(sum(terms[1:], terms[0]))
    return out


def radau_nodes(degree: int) -> list[float]:
    """Return Radau's collocation nodes in (0, 1], the last at 1."""
    return [float(x) for x in ca.collocation_points(degree, "radau")]


def lagrange(nodes: Sequence[float]) -> tuple[Array, Array]:
    """Return (L, D) of Lagrange's basis on nodes: power coefficients, and slopes at the nodes.

    The basis polynomial j is sum_k L[j, k] s^k, and its slope at node i is D[i, j].
    """
    powers = np.vander(np.array(nodes), increasing=True)
    L = np.linalg.inv(powers).T
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = powers[:, :-1] * np.arange(1, len(nodes))
    return L, slopes @ L.T
