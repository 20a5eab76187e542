"""A law and a pendulum in closed loop, and whether it fell, lost contact or left its foot."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, WbcError, shown
from wbc.kinds import check_callable, check_kind, switch
from wbc.rmp.balance.foot import ground_loads, require_support
from wbc.rmp.balance.law import BalanceLaw, LawBounds, Pendulum, PendulumCommand
from wbc.rmp.balance.record import Ending, Simulation, ground_push
from wbc.rmp.functions import Evaluator
from wbc.rmp.ground import FLIGHT
from wbc.rmp.integrators import runge_kutta
from wbc.validate import Array, check_fields, finite_number, finite_vector, read_only, set_fields

# Elevation of the leg at which a pendulum counts as fallen unless another is given [rad].
FALLEN = math.radians(10.0)
# Rates and lengths beyond this end a simulation [SI].
LARGEST = 1e8
# Longest record; a solid pendulum's takes 2 GB.
MOST_STEPS = 5_000_000
# Steps from one call of ``progress`` to the next.
STEPS_PER_CALL = 100

Stop = Callable[[float, Array, Array, PendulumCommand], bool]


@dataclass(frozen=True, eq=False)
class Blow:
    """A blow to the CoM: its velocity jumps by impulse / M, the masses' spin does not.

    It acts at the nearest instant at which the law is asked, before it is asked.

    Raises
    ------
    InvalidInputError
        Not finite, a negative time, or neither two nor three parts.
    """

    time: float  # [s]
    impulse: ArrayLike  # [N s], up last: (2,) for a planar pendulum, (3,) for a solid one

    def __post_init__(self) -> None:
        check_fields(self, "push: ", "time", least=0.0)
        size = 2 if np.size(self.impulse) == 2 else 3
        impulse = finite_vector("push: impulse", self.impulse, size)
        set_fields(self, impulse=read_only(impulse))


def velocity_jump(model: Pendulum, q: ArrayLike, impulse: ArrayLike) -> Array:
    """Return what an impulse at the CoM adds to v (nv,); the rate of the foot stays.

    It solves M dv = J_com^T impulse without the rows and columns of the foot, which the ground
    holds by an impulse of its own.

    Raises InvalidInputError: wrong sizes, not finite, or a configuration where forces have no
    inertia to accelerate.
    """
    driven, nv = model.COP, len(model.V)
    # Refuses configurations without a regular mass matrix.
    model.forward_dynamics(q, np.zeros(nv), np.zeros(len(model.F)))
    push = finite_vector("impulse", impulse, driven + 1)
    jacobian = np.column_stack([model.com(q, unit)[1] for unit in np.eye(nv)])
    dv = np.zeros(nv)
    mass = model.mass_matrix(q)[driven:, driven:]
    dv[driven:] = np.linalg.solve(mass, jacobian[:, driven:].T @ push)
    return dv


def simulate(
    law: BalanceLaw,
    q0: ArrayLike,
    v0: ArrayLike,
    duration: float,
    *,
    dt: float = 1e-3,
    plant: Pendulum | None = None,
    bounds: LawBounds | None = None,
    pushes: Iterable[Blow] = (),
    pivot: bool = False,
    fallen: float = FALLEN,
    stop: Stop | None = None,
    progress: Callable[[float], None] | None = None,
) -> Simulation:
    """Return the motion of a pendulum under a law whose command is held over each ``dt``.

    The run ends early, and :attr:`Simulation.ending` says how, if the leg is lower than ``fallen``
    or its length out of bounds (FELL), if the command would need a ground that pulls, or pushes
    with less than a hundredth of the weight (CONTACT_LOST), if the law raises a WbcError or its
    command is no numbers of the right size (LAW_FAILED), or if the state is not finite any more
    (DIVERGED). All other limits are judged, not enforced: see :meth:`Simulation.margins`. A command
    that the law itself calls not ``ok`` is carried out.

    Parameters
    ----------
    q0, v0:
        Start (nq,), (nv,).
    duration, dt:
        [s]; the duration is rounded to whole steps of Runge and Kutta's method.
    plant:
        The pendulum that moves; ``law.model``, unless one with other parameters is given.
    bounds:
        Judged by; none, unless given.
    pivot:
        The foot is bolted to the ground: the ground may pull, and a leg may hang.
    fallen:
        Least elevation of the leg above the ground [rad].
    stop:
        Called with (time, q, v, command) before each step; True ends the run as COMPLETE.
    progress:
        Called with the time reached [s], now and then.

    Raises
    ------
    InvalidInputError
        A start, duration, push or plant that is unusable; the message says which and why.
    """
    if not (hasattr(law, "model") and callable(getattr(law, "command", None))):
        raise InvalidInputError(
            "law: expected a balance law, such as Lqr(...), with a model and"
            f" command(q, v, time), got {shown(law)}"
        )
    check_kind("bounds", bounds, LawBounds, "LawBounds()", or_none=True)
    check_callable("stop", stop, "(time, q, v, command)")
    check_callable("progress", progress, "the time")
    bounds, pivot = bounds or LawBounds(), switch("pivot", pivot)
    steps = whole_steps(duration, dt)
    model, fallen = plant or law.model, finite_number("fallen", fallen)
    if abs(fallen) > 0.5 * math.pi:
        raise InvalidInputError(f"fallen: {fallen:g} rad is beyond the vertical; is it in rad?")
    if type(model) is not type(law.model):
        raise InvalidInputError(
            f"plant: a {type(model).__name__} cannot stand for the law's"
            f" {type(law.model).__name__}; only parameters may differ"
        )
    require_support(model, bounds)
    # Also refuses sizes, NaN and configurations that cannot move.
    model.forward_dynamics(q0, v0, np.zeros(len(model.F)))
    jumps = impulses_by_step(pushes, model, dt, steps)
    start = np.concatenate((np.array(q0, dtype=float), np.array(v0, dtype=float)))
    run = _Run(law, model, float(dt), bounds, pivot, fallen, [start])
    end = None
    for k in range(steps):
        if progress is not None and k % STEPS_PER_CALL == 0:
            progress(k * run.dt)
        if k in jumps:
            run.push(jumps[k])
        end = run.advance(k * run.dt, stop)
        if end is not None:
            break
    if progress is not None:
        progress(len(run.commands) * run.dt)
    return run.recorded(end)


@dataclass(eq=False)
class _Run:
    """A law and a pendulum step by step, and what has happened so far."""

    law: BalanceLaw
    model: Pendulum
    dt: float
    bounds: LawBounds
    pivot: bool
    fallen: float
    states: list[Array]
    inputs: list[Array] = field(default_factory=list)
    commands: list[PendulumCommand] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.nq = len(self.model.Q)
        self._step = Evaluator(_checked_step(self.model, self.dt))

    def push(self, impulse: Array) -> None:
        """Let an impulse change the velocity."""
        x = self.states[-1].copy()
        x[self.nq :] += velocity_jump(self.model, x[: self.nq], impulse)
        self.states[-1] = x

    def advance(self, time: float, stop: Stop | None) -> tuple[Ending, str] | None:
        """Ask the law, take one step and write it down; return how the run ends, if it does."""
        x = self.states[-1]
        q, v = x[: self.nq].copy(), x[self.nq :].copy()
        try:
            command = self.law.command(q, v, time)
        except WbcError as error:
            return Ending.LAW_FAILED, f"at {time:g} s the law refused: {error}"
        try:
            u = self._input(command)
        except InvalidInputError as error:
            return Ending.LAW_FAILED, f"at {time:g} s the law's command is unusable: {error}"
        if stop is not None and stop(time, q, v, command):
            return Ending.COMPLETE, f"stopped at {time:g} s as asked"
        after, push, leg = self._step(x, u)
        if not (np.abs(after).max() < LARGEST and np.isfinite(push).all()):
            return Ending.DIVERGED, f"after {time:g} s the state is not finite any more"
        least = FLIGHT * self.model.mass * self.model.gravity
        if not self.pivot and push[-1] <= least:
            note = f"at {time:g} s the ground would have to push up with {push[-1]:.4g} N"
            note += f"; below {least:.4g} N ({FLIGHT:g} of the weight) the foot counts as lifted"
            return Ending.CONTACT_LOST, note
        self.states.append(after)
        self.inputs.append(u)
        self.commands.append(command)
        return self._ending(time + self.dt, *leg.tolist())

    def recorded(self, end: tuple[Ending, str] | None) -> Simulation:
        """Return the record of a run that ended so, or was carried out to the end."""
        n, driven = len(self.commands), self.model.COP
        ending, note = end or (Ending.COMPLETE, "")
        if not note:
            note = next((each.note for each in self.commands if not each.ok), "")
        states, inputs = np.array(self.states), np.array(self.inputs).reshape(n, len(self.model.V))
        cop, ground_force = ground_push(self.model, states[:n], inputs)
        return Simulation(
            model=self.model,
            bounds=self.bounds,
            pivot=self.pivot,
            time=read_only(self.dt * np.arange(n + 1)),
            q=read_only(states[:, : self.nq]),
            v=read_only(states[:, self.nq :]),
            force=read_only(inputs[:, driven:]),
            cop_acceleration=read_only(inputs[:, :driven]),
            cop=read_only(cop),
            ground_force=read_only(ground_force),
            phase=[each.phase for each in self.commands],
            ok=np.array([each.ok for each in self.commands], dtype=bool),
            ending=ending,
            note=note,
        )

    def _input(self, command: PendulumCommand) -> Array:
        check_kind("command", command, PendulumCommand)
        w = finite_vector("cop_acceleration", command.cop_acceleration, self.model.COP)
        return np.concatenate((w, finite_vector("force", command.force, len(self.model.F))))

    def _ending(self, time: float, leg: float, height: float) -> tuple[Ending, str] | None:
        low, high = self.bounds.leg_length
        if not (max(low, 0.0) <= leg <= high):
            note = f"at {time:g} s the leg is {leg:.4g} m long, out of [{low:g}, {high:g}] m"
            return Ending.FELL, note
        if not self.pivot and height < leg * math.sin(self.fallen):
            lean = math.degrees(math.asin(height / leg))
            return Ending.FELL, f"at {time:g} s the leg is {lean:.3g} degrees above the ground"
        if self.states[-1][self.nq - self.model.RADII : self.nq].min() <= 0.0:
            return Ending.DIVERGED, f"at {time:g} s two masses of a pair meet"
        return None


def _checked_step(model: Pendulum, dt: float) -> ca.Function:
    """Return (x, u) -> (x_next, f_r now, (length of the leg, its height) next)."""
    nq, nv = len(model.Q), len(model.V)
    x, u = ca.SX.sym("x", nq + nv), ca.SX.sym("u", nv)
    _, push, _ = ground_loads(model, x, u)
    after = runge_kutta(model, dt)(x, u)
    com, _ = model.functions["com"](after[:nq], after[nq:])
    outputs = (after, push, ca.vertcat(after[model.LEG], com[-1]))
    return ca.Function("judged_step", [x, u], [ca.densify(each) for each in outputs])


def whole_steps(duration: float, dt: float) -> int:
    """Return how many steps of ``dt`` a simulation of that duration takes."""
    dt = finite_number("dt", dt, above=0.0)
    steps = finite_number("duration", duration, above=0.0) / dt
    if round(min(steps, MOST_STEPS)) < 1:
        raise InvalidInputError(f"duration: {duration:g} s is less than a step of {dt:g} s")
    if steps > MOST_STEPS:
        raise InvalidInputError(
            f"duration: {duration:g} s takes {steps:.3g} steps of {dt:g} s; {MOST_STEPS:g} at most"
        )
    return round(steps)


def impulses_by_step(
    pushes: Iterable[Blow], model: Pendulum, dt: float, steps: int
) -> dict[int, Array]:
    """Return the impulses (2,) or (3,) by the number of the step that they act before."""
    jumps: dict[int, Array] = {}
    if isinstance(pushes, Blow) or not isinstance(pushes, Iterable):
        raise InvalidInputError(f"pushes: expected a list of them, got {shown(pushes)}")
    for push in pushes:
        check_kind("pushes", push, Blow, "Blow(0.2, (1.0, 0.0, 0.0))")
        k = round(push.time / dt)
        if k >= steps:
            raise InvalidInputError(f"the push at {push.time:g} s is not before the end")
        impulse = finite_vector(f"the impulse at {push.time:g} s", push.impulse, model.COP + 1)
        jumps[k] = jumps[k] + impulse if k in jumps else impulse
    return jumps
