"""Robots that stand, and what tests ask of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import wbc
from wbc.controllers.closed_loop import closed_loop
from wbc.robot import Robot, Snapshot


def standing(robot: Robot) -> Snapshot:
    return robot.snapshot(robot.posture("standing"), np.zeros(robot.nv))


def sole_corners(here: Snapshot) -> np.ndarray:
    """Return the corners (k, 3) of all soles in the world, one foot after the other."""
    flat = [
        here.position(foot.frame) + foot.polygon @ here.rotation(foot.frame)[:, :2].T
        for foot in here.robot.feet.values()
    ]
    return np.concatenate(flat)


def commanded(
    controller: wbc.Controller, q: np.ndarray, ticks: int
) -> Iterator[tuple[wbc.Tick, np.ndarray]]:
    """Yield each tick, which is solved, and where it leads a robot that moves as commanded."""
    for one in closed_loop(controller, q, ticks):
        assert one.tick.ok, one.tick.report()
        yield one.tick, one.q


def stack(here: Snapshot) -> list[wbc.Task]:
    """CoM, trunk and posture with no gains given at all."""
    robot = here.robot
    return [
        wbc.ComTask(robot, here.com),
        wbc.OrientationTask(robot, "base", here.rotation("base")),
        wbc.PostureTask(robot, here.q),
    ]


def torque_controller(here: Snapshot, **options: object) -> wbc.TorqueController:
    """What keeps a robot standing on both feet, 500 times a second."""
    contacts = wbc.support(here, "double")
    return wbc.TorqueController(here.robot, stack(here), contacts=contacts, dt=0.002, **options)  # type: ignore[arg-type]
