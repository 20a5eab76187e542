"""The band against the dense matrix of the same rows."""

import numpy as np

from wbc.retargeting.normal_equations import SPAN, NormalEquations


def test_a_band_is_the_dense_least_squares(rng: np.random.Generator) -> None:
    count, nv, rows = 7, 4, 3
    normal, dense, errors = NormalEquations(count, nv), [], []

    def row(frames: dict[int, np.ndarray], off: float) -> None:
        one = np.zeros((count, nv))
        for k, part in frames.items():
            one[k] += part
        dense.append(one.ravel())
        errors.append(off)

    A, e = rng.normal(size=(count, rows, nv)), rng.normal(size=(count, rows))
    normal.add(A, errors=e)
    B, f = rng.normal(size=(count - 1, rows, nv)), rng.normal(size=(count - 1, rows))
    normal.add(-B, B, errors=f)
    after = rng.normal(size=(count - 1, rows, nv))
    normal.add(-B, after, errors=2.0 * f)
    g = rng.normal(size=(count - 2, rows))
    normal.add(B[:-1], -B[:-1] - B[1:], B[1:], errors=g)
    coefficients = (-1.0, 3.0, -3.0, 1.0)
    square, gradient = rng.uniform(1, 2, nv - 1), rng.normal(size=nv - 1)
    normal.add_differences(coefficients, square, np.tile(gradient, (count - SPAN, 1)), 1)
    for k in range(count):
        for r in range(rows):
            row({k: A[k, r]}, e[k, r])
            if k < count - 1:
                row({k: -B[k, r], k + 1: B[k, r]}, f[k, r])
                row({k: -B[k, r], k + 1: after[k, r]}, 2.0 * f[k, r])
            if k < count - 2:
                row({k: B[k, r], k + 1: -B[k, r] - B[k + 1, r], k + 2: B[k + 1, r]}, g[k, r])
        for c in range(1, nv) if k < count - SPAN else ():
            w = np.sqrt(square[c - 1])
            unit = np.eye(nv)[c]
            row({k + m: w * way * unit for m, way in enumerate(coefficients)}, gradient[c - 1] / w)
    more, pull = rng.uniform(size=(count, nv)), rng.normal(size=(count, nv))
    found = normal.solve(more, pull)
    M = np.array(dense)
    H = M.T @ M + np.diag(more.ravel())
    wanted = np.linalg.solve(H, -(M.T @ np.array(errors) + pull.ravel()))
    np.testing.assert_allclose(found.ravel(), wanted, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(normal.solve(more, pull), found)  # it may be asked again
