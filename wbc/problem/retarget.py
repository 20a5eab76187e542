"""A file for ``wbc retarget``: a recording, a robot, and how one becomes the other's motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from wbc.problem.mistakes import read_section
from wbc.problem.reading import read_source
from wbc.problem.section import Name, Section

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]


class RetargetSpec(Section):
    """What ``wbc retarget`` is given; what is left out is as the command has it."""

    version: Literal[1] = 1
    """Version of this format."""
    motion: Name
    """The recording, relative to this file: .c3d, .trc, .bvh, .csv of bodies, or .npz of SMPL."""
    robot: Name
    """A name, or a URDF or MJCF file, relative to this one if it is there."""
    static: Name | None = None
    """A trial in which the human stands, .trc or .c3d."""
    forces: Name | None = None
    """Force plates, .mot, .sto or .c3d."""
    subject: Name | None = None
    """Whose markers, where there are several humans'."""
    mass: Positive | None = None
    """Of the human [kg]."""
    stature: Positive | None = None
    """Of the human [m]."""
    sex: Literal["male", "female"] | None = None
    """For the table of segments."""
    up: Literal["x", "y", "z"] | None = None
    """The recording's vertical axis."""
    unit: Literal["cm", "m", "inch", "mm", "cmu"] | Positive | None = None
    """Of a BVH file's lengths; or how long one is [m]."""
    ground: float | None = None
    """Height of the human's ground [m]."""
    rate: Positive | None = None
    """Frames per second [Hz]."""
    duration: Literal["froude", "kept"] | Positive | None = None
    """froude: times scale with the square root of lengths; kept: the human's; or a factor."""
    cutoff: Positive | None = None
    """Of the human's low-pass [Hz]."""
    roll: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """Part of the pitch of the human's feet."""
    balance: bool | None = None
    """Move the CoM so that the CoP is where feet stand."""
    friction: Positive | None = None
    """Coefficient, by which the motion is judged."""
    margin: NotNegative | None = None
    """Kept between bodies [m]."""
    links: dict[Name, Name] | None = None
    """Frames of the robot by part of the body."""

    def values(self) -> dict[str, Any]:
        """Return what the file says, by the names of the command's parameters."""
        return self.model_dump(exclude_none=True, exclude={"version"})


def load_retarget(path: str | Path) -> dict[str, Any]:
    """Return what a file says, paths put behind its folder.

    Raises
    ------
    ProblemFileError
        With every mistake that was found: file, line and key path.
    """
    path = Path(path)
    found = read_section(RetargetSpec, read_source(path, "'motion:' and 'robot:'")).values()
    for key in ("motion", "static", "forces"):
        if key in found:
            found[key] = path.parent / found[key]
    beside = path.parent / found["robot"]
    if beside.is_file():
        found["robot"] = str(beside)
    return found
