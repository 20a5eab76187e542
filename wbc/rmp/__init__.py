"""The reaction mass pendulum itself; nothing here knows a robot."""

from wbc.rmp.ellipsoid import (
    Ellipsoid,
    equimomental,
    equimomental_at_density,
    reaction_mass_radii,
    second_moment,
)

__all__ = [
    "Ellipsoid",
    "equimomental",
    "equimomental_at_density",
    "reaction_mass_radii",
    "second_moment",
]
