"""The compiled core as an object, or the reason why there is none."""

from __future__ import annotations

import ctypes
import logging
import os
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from wbc.errors import UnknownNameError
from wbc.native.build import NativeCoreError, built
from wbc.native.fingerprint import fingerprint

VARIABLE = "WBC_NATIVE"
SHIPPED = Path(__file__).parent  # where a wheel has the core
MODES = ("auto", "off", "require")
VERSION = 10  # WBC_CORE_VERSION of source/core.h
# Functions by the number of their arguments: addresses and integers, which are as long. An address
# of what is only read may be given as bytes: array.tobytes() takes a tenth of address(array).
_FUNCTIONS = {
    "wbc_state": 8,
    "wbc_frames": 6,
    "wbc_check": 4,
    "wbc_move": 5,
    "wbc_motion": 5,
    "wbc_drifts": 7,
    "wbc_layout": 3,
    "wbc_cost": 6,
    "wbc_pose": 4,
    "wbc_solve": 2,
    "wbc_descend": 3,
    "wbc_finish": 3,
    "wbc_problem": 4,
    "wbc_tick": 4,
    "wbc_reduced": 2,
    "wbc_answer": 5,
    "wbc_sizes": 4,
    "wbc_solve_qp": 5,
    "wbc_nearest": 7,
    "wbc_measure": 6,
    "wbc_pair_rows": 8,
}


class Core:
    """The functions of the compiled library; addresses are given as integers.

    They run with the interpreter's lock held: they take microseconds, and what they write to is
    kept by a thread for itself.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            library = ctypes.PyDLL(str(path))
            version = int(library.wbc_core_version())
            library.wbc_core_source.restype = ctypes.c_char_p
            source = library.wbc_core_source().decode()
            for name, count in _FUNCTIONS.items():
                function = getattr(library, name)
                function.argtypes = [ctypes.c_void_p] * count
                function.restype = ctypes.c_int
            library.wbc_answer.argtypes = [
                *[ctypes.c_void_p] * 3,
                ctypes.c_double,
                ctypes.c_int64,
            ]
            library.wbc_move.argtypes = [*[ctypes.c_void_p] * 3, ctypes.c_double, ctypes.c_void_p]
        except (OSError, AttributeError) as error:
            raise NativeCoreError(f"{path} cannot be loaded: {error}") from error
        if version != VERSION:
            raise NativeCoreError(f"{path} is of version {version}, not {VERSION}")
        if source != fingerprint():
            raise NativeCoreError(f"{path} was made of other sources than those that are here")
        self.wbc_state: Any = library.wbc_state
        self.wbc_frames: Any = library.wbc_frames
        self.wbc_check: Any = library.wbc_check
        self.wbc_move: Any = library.wbc_move
        self.wbc_motion: Any = library.wbc_motion
        self.wbc_drifts: Any = library.wbc_drifts
        self.wbc_layout: Any = library.wbc_layout
        self.wbc_cost: Any = library.wbc_cost
        self.wbc_pose: Any = library.wbc_pose
        self.wbc_solve: Any = library.wbc_solve
        self.wbc_descend: Any = library.wbc_descend
        self.wbc_finish: Any = library.wbc_finish
        self.wbc_problem: Any = library.wbc_problem
        self.wbc_tick: Any = library.wbc_tick
        self.wbc_reduced: Any = library.wbc_reduced
        self.wbc_answer: Any = library.wbc_answer
        self.wbc_solve_qp: Any = library.wbc_solve_qp
        self.wbc_sizes: Any = library.wbc_sizes
        self.wbc_nearest: Any = library.wbc_nearest
        self.wbc_measure: Any = library.wbc_measure
        self.wbc_pair_rows: Any = library.wbc_pair_rows


class Status(NamedTuple):
    """Which path runs, and why."""

    core: Core | None
    reason: str


def mode() -> str:
    """Return what ``WBC_NATIVE`` asks for: ``auto``, ``off`` or ``require``.

    Raises
    ------
    UnknownNameError
        Anything else.
    """
    given = os.environ.get(VARIABLE, "").strip().lower() or MODES[0]
    if given not in MODES:
        raise UnknownNameError(f"value of {VARIABLE}", given, MODES)
    return given


def core() -> Core | None:
    """Return the core, compiled and loaded when first asked for; None where it cannot be had.

    Raises
    ------
    NativeCoreError
        It cannot be had, and ``WBC_NATIVE=require``.
    """
    wanted = mode()
    if wanted == "off":
        return None
    found = _loaded()
    if found.core is None and wanted == "require":
        raise NativeCoreError(f"{VARIABLE}=require, but {found.reason}")
    return found.core


def status() -> Status:
    """Return the core, or why it is not used; unlike :func:`core` this raises nothing of its own.

    Raises
    ------
    UnknownNameError
        See :func:`mode`.
    """
    return Status(None, f"{VARIABLE}=off") if mode() == "off" else _loaded()


@cache
def _loaded() -> Status:
    for shipped in sorted(SHIPPED.glob("_core*.so")):
        try:
            return Status(Core(shipped), f"loaded from {shipped}")
        except NativeCoreError as error:
            logging.getLogger(__name__).info("%s", error)
    try:
        path = built()
        try:
            found = Core(path)
        except NativeCoreError:
            found = Core(built(anew=True))
    except NativeCoreError as error:
        logging.getLogger(__name__).info("the native core is not used: %s", error)
        return Status(None, str(error))
    return Status(found, f"loaded from {found.path}")
