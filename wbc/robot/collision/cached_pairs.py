"""A cache of robots' fitted bodies and selected pairs.

Reading the meshes of a G1, fitting shapes to them and selecting pairs takes a second. So the
results are cached under a digest of all inputs: the description, every byte of its meshes, joints,
limits, postures and arguments. The folder is that of the environment variable ``WBC_CACHE``
(``off``: no cache), by default the platform's for caches; nothing is written if it is not writable.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeVar

import numpy as np

from wbc.errors import InvalidInputError
from wbc.files import cache_folder
from wbc.robot.collision.bodies import refuse_missing, robot_bodies
from wbc.robot.collision.fitting import VERSION
from wbc.robot.collision.pairs import Pattern, Selection, select_pairs
from wbc.robot.collision.shapes import Body
from wbc.robot.model import Robot
from wbc.safe_pickle import read_pickled, write_pickled

KIND = "wbc collision shapes 1"
Fitted = TypeVar("Fitted")


def fitted_bodies(robot: Robot, fit: str = "capsule") -> tuple[Body, ...]:
    """Return :func:`robot_bodies`, from the cache if possible; raises the same errors."""
    return _from_cache(robot, f"bodies {fit}", partial(robot_bodies, robot, fit))


def chosen_pairs(
    robot: Robot,
    fit: str = "capsule",
    *,
    include: Iterable[Pattern] = (),
    exclude: Iterable[Pattern] = (),
    clearance: float = 0.0,
) -> Selection:
    """Return :func:`select_pairs` of :func:`robot_bodies`, from the cache if possible.

    Raises
    ------
    ModelError, UnknownNameError, InvalidInputError
        As they do.
    """

    def choose() -> Selection:
        bodies = fitted_bodies(robot, fit)
        return select_pairs(robot, bodies, include=include, exclude=exclude, clearance=clearance)

    try:  # iterators can be read only once
        include, exclude = [*include], [*exclude]
    except TypeError:
        return choose()  # raises the error
    return _from_cache(robot, f"pairs {fit} {include} {exclude} {clearance!r}", choose)


def _from_cache(robot: Robot, request: str, make: Callable[[], Fitted]) -> Fitted:
    """Return the result of ``make``, from the cache if it was computed from the same inputs."""
    refuse_missing(robot)
    folder = cache_folder()
    if folder is None or (name := _digest(robot, request)) is None:
        return make()
    with contextlib.suppress(InvalidInputError, OSError):
        found, _ = read_pickled(folder / name, KIND)
        return found
    logging.getLogger("wbc.doing").info(
        "fitting shapes to the meshes of %s, for all times that come", robot.name
    )
    made = make()
    with contextlib.suppress(InvalidInputError, OSError):  # the cache is optional
        folder.mkdir(parents=True, exist_ok=True)
        write_pickled(folder / name, KIND, made)
    return made


def _digest(robot: Robot, request: str) -> str | None:
    """Return the digest of all inputs; None if a mesh file cannot be read."""
    content = hashlib.sha256(f"{VERSION} {request} ".encode())
    limits, rules = robot.limits, robot.geometry.rules
    pairs = [sorted(map(sorted, every)) for every in (rules.excluded, rules.watched)]
    content.update(repr((*pairs, sorted(rules.paired_only))).encode())
    for array in (limits.lower, limits.upper, *robot.postures.values()):
        content.update(np.ascontiguousarray(array).tobytes())
    try:
        srdf = b"" if robot.srdf is None else robot.srdf.read_bytes()
        for part in (robot.model.saveToString().encode(), srdf, *robot.geometry.content()):
            content.update(hashlib.sha256(part).digest())
    except OSError:  # reading the meshes will raise the error
        return None
    return content.hexdigest()
