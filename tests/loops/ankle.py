"""An ankle of two joints that two motors drive by cranks and rods, as a URDF, and its closed form.

The shank is the base, 0.3 m above the ankle. The foot turns by pitch about y, then roll about x.
Each motor turns a crank about y; a rod on a universal joint at its tip ends in a ball on the foot.
"""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

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


def _link(name: str, mass: float, com: np.ndarray, size: float = 1e-4) -> str:
    x, y, z = com
    moments = " ".join(f'i{axis}{axis}="{size}"' for axis in "xyz")
    return (
        f'<link name="{name}"><inertial><origin xyz="{x} {y} {z}"/><mass value="{mass}"/>'
        f'<inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def _joint(name: str, parent: str, child: str, at: np.ndarray, axis: str) -> str:
    x, y, z = at
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x} {y} {z}"/><axis xyz="{axis}"/>'
        '<limit lower="-1.2" upper="1.2" velocity="9" effort="60"/></joint>'
    )


def _fixed(name: str, parent: str, at: np.ndarray) -> str:
    x, y, z = at
    return (
        f'<link name="{name}"/><joint name="{name}_joint" type="fixed"><parent link="{parent}"/>'
        f'<child link="{name}"/><origin xyz="{x} {y} {z}"/></joint>'
    )


def urdf(folder: Path) -> Path:
    ankle = np.array([0.0, 0.0, -UP])
    parts = [
        _link("shank", 3.0, np.array([0.0, 0.0, -0.1]), 0.02),
        _link("cross", 0.0, np.zeros(3), 0.0),
        _joint("pitch", "shank", "cross", ankle, "0 1 0"),
        _link("foot", MASS["foot"], FOOT_COM, 2e-3),
        _joint("roll", "cross", "foot", np.zeros(3), "1 0 0"),
    ]
    for side in SIDES:
        tip = np.array([-CRANK, 0.0, 0.0])
        parts += [
            _link(f"{side}_crank", MASS["crank"], 0.5 * tip),
            _joint(f"{side}_motor", "shank", f"{side}_crank", ankle + pivot(side), "0 1 0"),
            _link(f"{side}_cross", 0.0, np.zeros(3), 0.0),
            _joint(f"{side}_rod_y", f"{side}_crank", f"{side}_cross", tip, "0 1 0"),
            _link(f"{side}_rod", MASS["rod"], np.array([0.0, 0.0, -0.5 * ROD]), 8e-4),
            _joint(f"{side}_rod_x", f"{side}_cross", f"{side}_rod", np.zeros(3), "1 0 0"),
            _fixed(f"{side}_rod_end", f"{side}_rod", np.array([0.0, 0.0, -ROD])),
            _fixed(f"{side}_ball", "foot", ball(side)),
        ]
    path = folder / "ankle.urdf"
    path.write_text(f'<robot name="ankle">{"".join(parts)}</robot>')
    return path


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    loops = {f"{side} rod": (f"{side}_rod_end", f"{side}_ball") for side in SIDES}
    path, unactuated = urdf(tmp_path), ("pitch", "roll", "*_rod_?")
    return Robot.load(path, base="fixed", loops=loops, unactuated=unactuated)


POSES = list(product((-0.3, 0.1, 0.4), (-0.2, 0.15)))
