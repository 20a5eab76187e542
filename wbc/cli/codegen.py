"""``wbc codegen``: a pendulum's equations of motion as C."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wbc.cli.errors import errors_in_one_line

if TYPE_CHECKING:
    from wbc.rmp.pendulum import ReactionMassPendulum


class Model(StrEnum):
    """Which pendulum."""

    PLANAR = "planar"
    SOLID = "solid"
    EULER = "euler"


def codegen(
    model: Annotated[
        Model,
        typer.Argument(help="planar, solid (orientation by quaternion) or euler (by angles)."),
    ],
    mass: Annotated[float, typer.Option(help="Mass of the pendulum, in kg.")],
    gravity: Annotated[float, typer.Option(help="Gravity, in m/s^2.")] = 9.81,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder to write into; it must exist.")
    ] = Path("."),
    function: Annotated[
        list[str] | None,
        typer.Option(help="Write this function only, as in mass_matrix; repeatable."),
    ] = None,
    compiler: Annotated[
        str | None,
        typer.Option(help="C compiler, such as cc: compile too, and compare with CasADi."),
    ] = None,
) -> None:
    """Write a pendulum's equations of motion as C, with a header; compile and compare them."""
    with errors_in_one_line():
        from wbc.rmp.functions import compile_c, export_c, largest_difference
        from wbc.rmp.planar import PlanarRmp
        from wbc.rmp.solid import EulerSolidRmp, SolidRmp

        kinds: dict[Model, Callable[[float, float], ReactionMassPendulum]]
        kinds = {Model.PLANAR: PlanarRmp, Model.SOLID: SolidRmp, Model.EULER: EulerSolidRmp}
        pendulum = kinds[model](mass, gravity)
        source = export_c(pendulum, output, function or None)
        typer.echo(f"{source} and {source.with_suffix('.h').name}")
        names = function or list(pendulum.functions)
        for name in names:
            typer.echo(f"  {pendulum.functions[name]}")
        if compiler is not None:
            library = compile_c(source, compiler)
            difference = largest_difference(pendulum, library, names)
            typer.echo(f"{library}: differs from CasADi by {difference:.1e} at most (relative)")
