"""A robot's bodies and pairs, kept in the cache: meshes need not be read to keep them apart.

Reading the meshes of a G1, fitting shapes to them and looking for pairs takes a second. So what
came of it is kept, under a digest of everything that it was made of: the description, every byte of
its meshes, joints, limits, postures and what was asked for. It is kept in the folder that the
environment variable ``WBC_CACHE`` names (``off``: nowhere), by default the platform's for caches;
a folder that cannot be written to is left alone.
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
from wbc.pickled import read_pickled, write_pickled
from wbc.robot.collision.bodies import refuse_missing, robot_bodies
from wbc.robot.collision.fitting import VERSION
from wbc.robot.collision.pairs import Pattern, Selection, select_pairs
from wbc.robot.collision.shapes import Body
from wbc.robot.model import Robot

KIND = "wbc collision shapes 1"
Made = TypeVar("Made")


def fitted_bodies(robot: Robot, fit: str = "capsule") -> tuple[Body, ...]:
    """Return :func:`robot_bodies`, from the cache if they are in; its errors."""
    return _kept(robot, f"bodies {fit}", partial(robot_bodies, robot, fit))


def chosen_pairs(
    robot: Robot,
    fit: str = "capsule",
    *,
    include: Iterable[Pattern] = (),
    exclude: Iterable[Pattern] = (),
    clearance: float = 0.0,
) -> Selection:
    """Return :func:`select_pairs` of :func:`robot_bodies`, from the cache if they are in.

    Raises
    ------
    ModelError, UnknownNameError, InvalidInputError
        As they do.
    """

    def choose() -> Selection:
        bodies = fitted_bodies(robot, fit)
        return select_pairs(robot, bodies, include=include, exclude=exclude, clearance=clearance)

    try:  # one that can be read once only
        include, exclude = [*include], [*exclude]
    except TypeError:
        return choose()  # which says what is wrong
    return _kept(robot, f"pairs {fit} {include} {exclude} {clearance!r}", choose)


def _kept(robot: Robot, asked: str, make: Callable[[], Made]) -> Made:
    """Return what ``make`` does, from the cache if it was made of the same before."""
    refuse_missing(robot)
    folder = cache_folder()
    name = None if folder is None else _digest(robot, asked)
    if folder is None or name is None:
        return make()
    with contextlib.suppress(InvalidInputError, OSError):
        found, _ = read_pickled(folder / name, KIND)
        return found
    logging.getLogger("wbc.doing").info(
        "fitting shapes to the meshes of %s, for all times that come", robot.name
    )
    made = make()
    with contextlib.suppress(InvalidInputError, OSError):  # without a place to write, do not
        folder.mkdir(parents=True, exist_ok=True)
        write_pickled(folder / name, KIND, made)
    return made


def _digest(robot: Robot, asked: str) -> str | None:
    """Return the digest of all that the answer depends on; None where that cannot be read."""
    content = hashlib.sha256(f"{VERSION} {asked} ".encode())
    limits, rules = robot.limits, robot.geometry.rules
    pairs = [sorted(map(sorted, every)) for every in (rules.excluded, rules.watched)]
    content.update(repr((*pairs, sorted(rules.paired_only))).encode())
    for array in (limits.lower, limits.upper, *robot.postures.values()):
        content.update(np.ascontiguousarray(array).tobytes())
    try:
        srdf = b"" if robot.srdf is None else robot.srdf.read_bytes()
        for part in (robot.model.saveToString().encode(), srdf, *robot.geometry.content()):
            content.update(hashlib.sha256(part).digest())
    except OSError:  # who reads the meshes says what is wrong
        return None
    return content.hexdigest()
