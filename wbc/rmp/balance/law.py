"""What every balance law is: a function of the pendulum's state, with its verdict on itself."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array

Pendulum = PlanarRmp | SolidRmp


@dataclass(frozen=True, eq=False)
class Command:
    """What a law wants now.

    Attributes
    ----------
    force:
        Generalised forces f (nf,) in the pendulum's order, N and N m. ``tau_theta`` and ``tau_phi``
        hold the reaction of the wheel's torque on the leg and what the foot gives.
    cop_acceleration:
        Acceleration of the leg's foot on the ground (1,) or (2,) [m/s^2]; zero if it stays.
    phase:
        The part of the law at work, in one word, such as ``"lean"``, ``"pump"``, ``"catch"``.
    ok:
        False if the law could not keep its own promise; ``note`` says why.
    note:
        One line for the user; empty where there is nothing to say.
    """

    force: Array
    cop_acceleration: Array
    phase: str = "run"
    ok: bool = True
    note: str = field(default="")


class BalanceLaw(Protocol):
    """From the pendulum's state to generalised forces. Laws keep no state of their own."""

    @property
    def model(self) -> Pendulum:
        """The pendulum that the law believes it controls."""

    def command(self, q: Array, v: Array, time: float) -> Command:
        """Return what to do at configuration q (nq,), velocity v (nv,) and time [s]."""


@dataclass(frozen=True, eq=False)
class CentroidalReference:
    """What a command means for a robot with this pendulum: the humanoid controllers track it.

    Attributes
    ----------
    com_acceleration:
        c'' [m/s^2], up last: (3,), planar (2,).
    momentum_rate:
        k_G', the rate of the angular momentum about the CoM [N m]: (3,) world axes, planar (1,).
    inertia_rate:
        Rate of the inertia about the masses' axes [kg m^2/s]: (3,), planar (1,).
    """

    com_acceleration: Array
    momentum_rate: Array
    inertia_rate: Array


def centroidal_reference(
    model: Pendulum, q: Array, v: Array, command: Command
) -> CentroidalReference:
    """Return the CoM acceleration, momentum rate and inertia rate that a command brings about.

    Raises
    ------
    InvalidInputError
        Wrong sizes, not finite, or a configuration that the pendulum cannot have.
    """
    a = model.forward_dynamics(q, v, command.force, command.cop_acceleration)
    push = model.ground_reaction(q, v, a)
    gravity = np.zeros(len(push))
    gravity[-1] = -model.gravity
    return CentroidalReference(
        com_acceleration=push / model.mass + gravity,
        momentum_rate=np.atleast_1d(model.momentum_rate(q, command.force)),
        inertia_rate=np.atleast_1d(model.inertia_rate(q, v)),
    )
