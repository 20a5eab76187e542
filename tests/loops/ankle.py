"""An ankle of two joints that two motors drive by cranks and rods, as a URDF, and its closed form.

The shank is the base, 0.3 m above the ankle. The foot turns by pitch about y, then roll about x.
Each motor turns a crank about y; a rod on a universal joint at its tip ends in a ball on the foot.
"""

from collections.abc import Iterable
from itertools import product

import numpy as np
import pytest

from tests.urdf import joint, limit, link
from tests.urdf import robot as urdf_of
from wbc.robot import Robot

CRANK, ROD, GRAVITY, UP = 0.04, 0.25, 9.81, 0.3
HEIGHT = 0.23  # of the motors above the ankle
SIDES = {"left": 0.04, "right": -0.04}  # y of the balls [m]
MASS = {"foot": 1.2, "crank": 0.1, "rod": 0.15}
FOOT_COM = np.array([0.03, 0.0, -0.04])


def ball(side: str) -> np.ndarray:
    """In the foot's axes; the rod hangs straight down where all joints are at 0."""
    return np.array([-CRANK, SIDES[side], HEIGHT - ROD])


def pivot(side: str) -> np.ndarray:
    """Of the motor, from the ankle."""
    return np.array([0.0, SIDES[side], HEIGHT])


def crank_angle(pitch: float, roll: float, side: str) -> float:
    """|P - (h + R_y(a) (-c, 0, 0))| = L, with R_y(a) (-c, 0, 0) = c (-cos a, 0, sin a)."""
    d = foot_point(pitch, roll, ball(side)) - pivot(side)
    # d.d + c^2 + 2 c (d_x cos a - d_z sin a) = L^2
    wanted = (ROD**2 - d @ d - CRANK**2) / (2.0 * CRANK)
    return float(np.arccos(wanted / np.hypot(d[0], d[2])) * -1.0 - np.arctan2(d[2], d[0]))


def foot_point(pitch: float, roll: float, p: np.ndarray) -> np.ndarray:
    cp, sp, cr, sr = np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    y, z = cr * p[1] - sr * p[2], sr * p[1] + cr * p[2]
    return np.array([cp * p[0] + sp * z, y, -sp * p[0] + cp * z])


def rotation(pitch: float, roll: float) -> np.ndarray:
    """Of the foot."""
    return np.transpose([foot_point(pitch, roll, axis) for axis in np.eye(3)])


def energy(pitch: float, roll: float) -> float:
    """Of weight [J]: rods carry theirs in the middle, cranks at half their length."""
    total = MASS["foot"] * foot_point(pitch, roll, FOOT_COM)[2]
    for side in SIDES:
        tip = pivot(side)[2] + CRANK * np.sin(crank_angle(pitch, roll, side))
        middle = 0.5 * (tip + foot_point(pitch, roll, ball(side))[2])
        total += MASS["rod"] * middle + MASS["crank"] * 0.5 * (tip + pivot(side)[2])
    return float(GRAVITY * total)


def slopes(f, pitch: float, roll: float) -> np.ndarray:
    """By differences of fourth order over 1e-3 rad: 1e-12 of the values."""
    h = 1e-3
    found = []
    for dp, dr in ((h, 0.0), (0.0, h)):
        at = [f(pitch + k * dp, roll + k * dr) for k in (-2, -1, 1, 2)]
        found.append((at[0] - 8.0 * at[1] + 8.0 * at[2] - at[3]) / (12.0 * h))
    return np.array(found)


def crank_slopes(pitch: float, roll: float) -> np.ndarray:
    """Of the cranks' angles by pitch and roll (2, 2)."""
    return np.array(
        [slopes(lambda p, r, s=side: crank_angle(p, r, s), pitch, roll) for side in SIDES]
    )


def static_torques(pitch: float, roll: float) -> np.ndarray:
    """Of the motors (2,): their virtual work is that of the weights."""
    return np.linalg.solve(crank_slopes(pitch, roll).T, slopes(energy, pitch, roll))


def fixed(name: str, parent: str, at: Iterable[float]) -> str:
    return f'<link name="{name}"/>' + joint(
        f"{name}_joint", parent, name, kind="fixed", at=words(at), limit=""
    )


def words(at: Iterable[float]) -> str:
    return " ".join(map(str, at))


def urdf() -> str:
    ankle, ends = words((0.0, 0.0, -UP)), limit(1.2, 60, 9)
    parts = [
        link("shank", mass=3.0, moment=0.02, at="0 0 -0.1"),
        link("cross", mass=0.0, moment=0.0),
        joint("pitch", "shank", "cross", at=ankle, limit=ends),
        link("foot", mass=MASS["foot"], moment=2e-3, at=words(FOOT_COM)),
        joint("roll", "cross", "foot", axis="1 0 0", limit=ends),
    ]
    for side in SIDES:
        crank, cross, rod = f"{side}_crank", f"{side}_cross", f"{side}_rod"
        motor = words(pivot(side) - (0.0, 0.0, UP))
        parts += [
            link(crank, mass=MASS["crank"], moment=1e-4, at=words((-0.5 * CRANK, 0.0, 0.0))),
            joint(f"{side}_motor", "shank", crank, at=motor, limit=ends),
            link(cross, mass=0.0, moment=0.0),
            joint(f"{rod}_y", crank, cross, at=words((-CRANK, 0.0, 0.0)), limit=ends),
            link(rod, mass=MASS["rod"], moment=8e-4, at=words((0.0, 0.0, -0.5 * ROD))),
            joint(f"{rod}_x", cross, rod, axis="1 0 0", limit=ends),
            fixed(f"{rod}_end", rod, (0.0, 0.0, -ROD)),
            fixed(f"{side}_ball", "foot", ball(side)),
        ]
    return urdf_of("ankle", *parts)


@pytest.fixture(scope="session")
def robot() -> Robot:
    loops = {f"{side} rod": (f"{side}_rod_end", f"{side}_ball") for side in SIDES}
    return Robot.load(urdf(), base="fixed", loops=loops, unactuated=("pitch", "roll", "*_rod_?"))


POSES = list(product((-0.3, 0.1, 0.4), (-0.2, 0.15)))
