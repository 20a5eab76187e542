"""The file format of ``wbc retarget``: a recording, a robot, and settings."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from wbc.files import beside
from wbc.problem.mistakes import read_section
from wbc.problem.section import Name, NonNegative, Number, Positive, Section
from wbc.problem.yaml_reader import read_source


class RetargetSpec(Section):
    """The inputs of ``wbc retarget``; keys that are left out have the command's defaults."""

    version: Literal[1] = 1
    """Version of this format."""
    motion: Name
    """The recording, relative to this file: .c3d, .trc, .bvh, .csv of bodies, or .npz of SMPL."""
    robot: Name
    """A name, or a URDF or MJCF file, relative to this one if it is there."""
    static: Name | None = None
    """A static trial of the standing human, .trc or .c3d."""
    forces: Name | None = None
    """Force plates, .mot, .sto or .c3d."""
    subject: Name | None = None
    """The subject's name, if the recording has several humans' markers."""
    mass: Positive | None = None
    """Of the human [kg]."""
    stature: Positive | None = None
    """Of the human [m]."""
    sex: Literal["male", "female"] | None = None
    """Selects the table of segment parameters."""
    up: Literal["x", "y", "z"] | None = None
    """The recording's vertical axis."""
    unit: Literal["cm", "m", "inch", "mm", "cmu"] | Positive | None = None
    """Unit of a BVH file's lengths, or its length [m]."""
    ground: Number | None = None
    """Height of the ground in the recording [m]."""
    rate: Positive | None = None
    """Frames per second [Hz]."""
    duration: Literal["froude", "kept"] | Positive | None = None
    """froude: durations scale with the square root of lengths; kept: the human's; or a factor."""
    cutoff: Positive | None = None
    """Cutoff frequency of the low-pass filter on the human's motion [Hz]."""
    roll: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """Share of the human feet's pitch that the robot's feet roll by."""
    balance: bool | None = None
    """Move the CoM so that the CoP stays inside the standing feet."""
    friction: Positive | None = None
    """Friction coefficient for checking the motion."""
    margin: NonNegative | None = None
    """Distance kept between bodies [m]."""
    links: dict[Name, Name] | None = None
    """Frames of the robot by part of the body."""


def load_retarget(path: str | Path) -> dict[str, Any]:
    """Return a file's values by the command's parameters; relative paths are of its folder.

    Raises ProblemFileError: with every mistake that was found: file, line and key path.
    """
    path = Path(path)
    spec = read_section(RetargetSpec, read_source(path, "'motion:' and 'robot:'"))
    found = spec.model_dump(exclude_none=True, exclude={"version"})
    for key in ("motion", "static", "forces"):
        if key in found:
            found[key] = beside(path.parent, found[key])
    robot = beside(path.parent, found["robot"])
    if os.path.isfile(robot):  # Path.is_file raises where a name is too long
        found["robot"] = str(robot)
    return found
