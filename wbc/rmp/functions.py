"""CasADi Functions outside CasADi: called every tick with arrays, or written as C."""

from __future__ import annotations

import errno
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import casadi as ca
import numpy as np

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.files import write_text
from wbc.rmp.pendulum import ReactionMassPendulum
from wbc.validate import Array

# The end of CasADi's C files, which shows that they are complete.
FILE_END = '} /* extern "C" */\n#endif\n'


class Evaluator:
    """Calls a Function of columns, with arrays in and arrays out, by their addresses.

    A call through CasADi's own Python types costs twenty times the evaluation. The arrays that the
    Function reads and writes are made once; results are copies.
    """

    def __init__(self, function: ca.Function) -> None:
        self._function = function
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

    def __reduce__(self) -> tuple[type[Self], tuple[ca.Function]]:
        """Copy and pickle the Function: the arrays are at addresses of their own."""
        return type(self), (self._function,)

    def __call__(self, *arguments: Array) -> tuple[Array, ...]:
        """Return the results, (rows,) or (rows, columns); sizes of arguments are not checked."""
        for place, argument in zip(self._inputs, arguments, strict=True):
            place[:] = argument
        self._evaluate()
        return tuple(out[0].copy() if len(out) == 1 else out.T.copy() for out in self._outputs)


def export_c(
    model: ReactionMassPendulum, directory: str | Path, names: Iterable[str] | None = None
) -> Path:
    """Write Functions of a pendulum as one C file and return its path, with a header beside it.

    The file needs nothing but a C compiler. Mass and gravity are written into it as numbers; each
    function is called as CasADi documents: ``int name(const double** arg, double** res, ...)``.
    ``names`` are keys of ``model.functions``; all, unless given.
    """
    directory = Path(directory)
    if not directory.is_dir():
        raise InvalidInputError(f"export_c: {directory} is not a directory")
    name_of_file = f"{type(model).__name__.lower()}.c"
    generator = ca.CodeGenerator(name_of_file, {"with_header": True})
    for name in model.functions if names is None else names:
        if name not in model.functions:
            raise UnknownNameError("function", name, model.functions)
        generator.add(model.functions[name])
    with TemporaryDirectory(prefix="wbc-") as folder:
        # CasADi wants the folder with a separator at its end, and says nothing of a full disk.
        source = Path(generator.generate(f"{folder}/"))
        texts = {
            one.name: one.read_text(encoding="utf-8") if one.exists() else ""
            for one in (source, source.with_suffix(".h"))
        }
        if not all(text.endswith(FILE_END) for text in texts.values()):
            raise OSError(errno.ENOSPC, "could not be written whole; is the disk full?", folder)
    for name, text in texts.items():
        write_text(directory / name, text)
    return directory / source.name
