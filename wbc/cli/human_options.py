"""Options of a human's recording for ``wbc analyze`` and ``wbc retarget``."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from wbc.human import HumanMotion

# Kept in step with wbc.human, which is not imported only to print the help.
SEX = "male"

Static = Annotated[
    Path | None, typer.Option(help="Human: a trial in which it stands, .trc or .c3d.")
]
Forces = Annotated[
    Path | None, typer.Option(help="Human: force plates, .mot, .sto or .c3d; they weigh it.")
]
Subject = Annotated[
    str | None,
    typer.Option(help="Human: subject of the markers, as in Anna:LASI, if there are several."),
]
Mass = Annotated[
    float | None, typer.Option(help="Human: in kg; by default as the plates weigh it.")
]
Stature = Annotated[
    float | None, typer.Option(help="Human: in m; by default by the calibrated lengths.")
]
Sex = Annotated[str, typer.Option(help="Human: male or female, for the segments' table.")]
Up = Annotated[
    str | None, typer.Option(help="Human: the file's vertical axis, x, y or z; -z: z down.")
]
Unit = Annotated[
    str | None,
    typer.Option(help="Human: of a BVH file's lengths, cm, m, inch, mm, cmu, or a length in m."),
]


@dataclass(frozen=True)
class HumanOptions:
    """Options of a human's recording, as they were given."""

    static: Path | None
    forces: Path | None
    subject: str | None
    mass: float | None
    stature: float | None
    sex: str
    up: str | None
    unit: str | float | None

    @property
    def given(self) -> list[str]:
        """Names of the given options, except the sex, which has a default."""
        names = [each.name for each in fields(self) if each.name != "sex"]
        return [f"--{name}" for name in names if getattr(self, name) is not None]

    def motion(self, path: Path, ground: float | None, **how: Any) -> HumanMotion:
        """Return the motion of a recording; ``how``: more keywords of ``human_motion``."""
        from wbc.human import human_motion, read_markers

        recording = read_markers(path, forces=self.forces, unit=self.unit, stature=self.stature)
        return human_motion(
            recording,
            static=None if self.static is None else read_markers(self.static, standing=True),
            subject=self.subject,
            mass=self.mass,
            stature=self.stature,
            sex=self.sex,
            up=self.up,
            ground_height=ground,
            **how,
        )
