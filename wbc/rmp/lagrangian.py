"""From the energies of a mechanism to its equations of motion, as CasADi Functions.

For velocities v that are the rates of coordinates, with p = dT/dv, Lagrange's equations are

    M(q) a + b(q, v) = f,    M = dp/dv,    b = (dp/dq) q' - dT/dq + dV/dq

Three velocities may be body rates w of a rotation that the energies do not depend on. Their rows
are Euler's: b gains w x dT/dw (Boltzmann and Hamel's form of the same principle).

The first coordinates of a reaction mass pendulum are those of its CoP. Moving the CoP while the CoM
stays takes no kinetic energy, so M is singular: the acceleration of the CoP cannot follow from
forces, but is an input. Its rows of M a + b are the horizontal ground reaction (paper, Table 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True, eq=False)
class Mechanism:
    """What the equations of motion of a pendulum follow from; every entry is symbolic.

    Attributes
    ----------
    q, v:
        Symbols of configuration (nq,) and velocity (nv,).
    rate:
        dq/dt (nq,), in terms of q and v.
    coordinates, places:
        The entries of q that the energies may depend on, and the entries of v that are their rates.
    spin:
        The entries of v that are body rates; none, or three.
    driven:
        How many of the first velocities belong to the CoP.
    com:
        Position of the CoM, and
    kinetic, potential, momenta:
        T, V [J] and (k_G, k_P) [kg m^2/s].
    """

    q: ca.SX
    v: ca.SX
    rate: ca.SX
    coordinates: tuple[int, ...]
    places: tuple[int, ...]
    spin: tuple[int, ...]
    driven: int
    com: ca.SX
    kinetic: ca.SX
    potential: ca.SX
    momenta: tuple[ca.SX, ca.SX]


def equations_of_motion(mechanism: Mechanism) -> tuple[ca.SX, ca.SX]:
    """Return the mass matrix M (nv, nv) and the bias b (nv,), so that M a + b = f."""
    v, T, V = mechanism.v, mechanism.kinetic, mechanism.potential
    x = _pick(mechanism.q, mechanism.coordinates)
    p = ca.gradient(T, v)
    bias = ca.jtimes(p, x, _pick(v, mechanism.places))
    pull = ca.gradient(V - T, x)
    for row, place in enumerate(mechanism.places):
        bias[place] += pull[row]
    if mechanism.spin:
        turned = ca.cross(_pick(v, mechanism.spin), _pick(p, mechanism.spin))
        for row, place in enumerate(mechanism.spin):
            bias[place] += turned[row]
    # The one triangle for both: symmetric to the last bit.
    return ca.triu2symm(ca.triu(ca.jacobian(p, v))), bias


def functions(mechanism: Mechanism, mass: float, gravity: float) -> dict[str, ca.Function]:
    """Return the Functions of a pendulum by name; arguments and results are columns.

    =====================  =================================  ============================
    name                   arguments                          results
    =====================  =================================  ============================
    ``mass_matrix``        q                                  M (nv, nv)
    ``bias``               q, v                               b (nv,)
    ``inverse_dynamics``   q, v, a                            f (nv - driven,)
    ``forward_dynamics``   q, v, f, cop_acceleration          a (nv,)
    ``ground_reaction``    q, v, a                            M_total (c'' - g)
    ``energies``           q, v                               T, V
    ``momenta``            q, v                               k_G, k_P
    ``com``                q, v                               c, c'
    ``state_rate``         x = (q, v), u = (cop_acc., f)      (q', a)
    ``acceleration_rates`` q, v, u                            da/dq (nv, nv), da/du
    =====================  =================================  ============================

    The columns of ``da/dq`` are in the order of v; those of a rotation are zero, because torques
    are given in the axes that turn with it.
    """
    q, v, driven = mechanism.q, mechanism.v, mechanism.driven
    nv = v.numel()
    a, f, w = ca.SX.sym("a", nv), ca.SX.sym("f", nv - driven), ca.SX.sym("w", driven)
    M, b = equations_of_motion(mechanism)
    u = ca.vertcat(w, f)
    forward = _forward(M, b, f, w)
    velocity, reaction = _centre_of_mass(mechanism, a, mass, gravity)
    x = _pick(q, mechanism.coordinates)
    spread = ca.DM.zeros(len(mechanism.places), nv)
    for row, place in enumerate(mechanism.places):
        spread[row, place] = 1.0
    A = ca.jacobian(forward, x) @ spread
    listed = (
        ("mass_matrix", [q], [M], ["q"], ["M"]),
        ("bias", [q, v], [b], ["q", "v"], ["b"]),
        ("inverse_dynamics", [q, v, a], [(M @ a + b)[driven:]], ["q", "v", "a"], ["f"]),
        ("forward_dynamics", [q, v, f, w], [forward], ["q", "v", "f", "cop_acceleration"], ["a"]),
        ("ground_reaction", [q, v, a], [reaction], ["q", "v", "a"], ["f_r"]),
        ("energies", [q, v], [mechanism.kinetic, mechanism.potential], ["q", "v"], ["T", "V"]),
        ("momenta", [q, v], list(mechanism.momenta), ["q", "v"], ["k_G", "k_P"]),
        ("com", [q, v], [mechanism.com, velocity], ["q", "v"], ["c", "c_rate"]),
        (
            "state_rate",
            [ca.vertcat(q, v), u],
            [ca.vertcat(mechanism.rate, forward)],
            ["x", "u"],
            ["x_rate"],
        ),
        (
            "acceleration_rates",
            [q, v, u],
            [A, ca.jacobian(forward, u)],
            ["q", "v", "u"],
            ["a_q", "a_u"],
        ),
    )
    return {
        name: ca.Function(name, arguments, [ca.densify(each) for each in results], ins, outs)
        for name, arguments, results, ins, outs in listed
    }


def com_velocity(com: ca.SX, q: ca.SX, v: ca.SX) -> ca.SX:
    """Return dc/dt for velocities ``v`` that are the rates of ``q``."""
    return ca.jtimes(com, q, v)


def _forward(M: ca.SX, b: ca.SX, f: ca.SX, w: ca.SX) -> ca.SX:
    """Solve all rows but those of the CoP, whose acceleration is w."""
    driven = w.numel()
    rest = f - b[driven:] - M[driven:, :driven] @ w
    # Square-root free and sparse: the blocks of leg, rotation and radii do not couple.
    D, LT, order = ca.ldl(M[driven:, driven:])
    return ca.vertcat(w, ca.ldl_solve(rest, D, LT, order))


def _centre_of_mass(
    mechanism: Mechanism, a: ca.SX, mass: float, gravity: float
) -> tuple[ca.SX, ca.SX]:
    """Return c' and the ground reaction M (c'' - g); the last axis points up."""
    x = _pick(mechanism.q, mechanism.coordinates)
    v, rates = mechanism.v, _pick(mechanism.v, mechanism.places)
    velocity = com_velocity(mechanism.com, x, rates)
    reaction = mass * (ca.jtimes(velocity, x, rates) + ca.jtimes(velocity, v, a))
    reaction[-1] += mass * gravity
    return velocity, reaction


def _pick(x: ca.SX, places: tuple[int, ...]) -> ca.SX:
    return ca.vertcat(*(x[place] for place in places))
