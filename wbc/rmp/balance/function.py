"""A CasADi Function that is called every tick."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from wbc.validate import Array


class Evaluator:
    """Calls a Function of columns, with arrays in and arrays out, by their addresses.

    A call through CasADi's own Python types costs twenty times the evaluation. The arrays that the
    Function reads and writes are made once; results are copies.
    """

    def __init__(self, function: ca.Function) -> None:
        # CasADi's type stubs know less of buffers than CasADi does.
        buffer: Any = function.buffer()
        self._memory, self._evaluate = buffer
        self._inputs = [np.zeros(function.size1_in(k)) for k in range(function.n_in())]
        # CasADi stores matrices by columns.
        self._outputs = [
            np.zeros((function.size2_out(k), function.size1_out(k)))
            for k in range(function.n_out())
        ]
        for k, column in enumerate(self._inputs):
            self._memory.set_arg(k, memoryview(column.data))
        for k, matrix in enumerate(self._outputs):
            self._memory.set_res(k, memoryview(matrix.data))

    def __call__(self, *arguments: Array) -> tuple[Array, ...]:
        """Return the results (rows, columns) for columns of numbers; sizes are not checked."""
        for place, argument in zip(self._inputs, arguments, strict=True):
            place[:] = argument
        self._evaluate()
        return tuple(result.T.copy() for result in self._outputs)
