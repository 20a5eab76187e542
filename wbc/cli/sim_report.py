"""The report that ``wbc sim`` prints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from rich.table import Table
from rich.text import Text

from wbc.cli.console import plain_console
from wbc.cli.printing import (
    SHOWN,
    facts,
    failed_ticks,
    head,
    heads,
    print_line,
    print_unbalanced,
    print_written,
    tasks_table,
)
from wbc.errors import listed
from wbc.robot.series import revolute_joints
from wbc.simulation import SimulationResult
from wbc.simulation.push import AppliedWrench, Push
from wbc.tracking.deviation import PlanTracking
from wbc.tracking.reference import PlanReference

# A planned quantity has no peak if it changes by less than this part of its tracking error.
ROUNDING = 1e-3


def print_unbalanced_motion(reference: object) -> None:
    """Print where a motion cannot be balanced, before it is simulated; nothing for a plan."""
    if isinstance(reference, PlanReference) or reference is None:
        return
    from wbc.retargeting.reference import MotionReference

    if isinstance(reference, MotionReference):
        print_unbalanced(reference.unbalanced)
        if reference.lean is not None:
            shift = f"{1e3 * reference.led:.0f} mm"
            print_line("lean", f"the CoM is shifted by at most {shift} to keep the CoP inside")


def print_simulation(result: SimulationResult, written: Iterable[Path]) -> None:
    """Print whether the robot stood, the tasks' errors, and the effort."""
    console = plain_console()
    ticks = len(result.run.history)
    console.print(head(result.status, f"{result.reason} ({ticks} ticks)"))
    console.print(tasks_table(result.run))
    if result.tracking is not None:
        console.print(_tracking(result.tracking))
        before = [one for one in result.tracking.unbalanced if one.start <= result.duration]
        if before:
            console.print("what the motion asked for until then that cannot be:")
            print_unbalanced(before, SHOWN)
    table = facts()
    for push in result.pushes:
        table.add_row("push", Text(_push(push, result)))
    for wrench in result.wrenches:
        table.add_row("wrench", Text(_wrench(wrench)))
    table.add_row("gave way", Text(_gave_way(result)))
    if held := result.run.held_back:
        longest = [f"{name} for {one.ticks * result.run.dt:.2f} s" for name, one in held.items()]
        table.add_row("held back", Text(f"by {listed(longest, SHOWN)}"))
    table.add_row("CoP", _cop(result))
    table.add_row("trunk", f"tilted by at most {result.peak_tilt:.2f} rad")
    table.add_row("torque", Text(_torque(result)))
    slip = result.run.slip
    if slip is not None:
        table.add_row("slip", f"at most {1e3 * slip.value:.2g} mm ({slip.where}, tick {slip.tick})")
    for text in result.run.not_kept:
        table.add_row("not kept", Text(text, style="red"))
    if result.lost:
        table.add_row("sensors", f"{result.lost} of {ticks} frames lost")
    if result.run.failures:
        table.add_row("QP", Text(failed_ticks(result.run), style="red"))
    for note in result.notes:
        table.add_row("note", Text(note))
    wall = result.run.tick_times()["wall"]
    table.add_row(
        "tick time", f"median {1e3 * wall['median']:.2f} ms, p99 {1e3 * wall['p99']:.2f} ms"
    )
    console.print(table)
    print_written(written)


def _wrench(one: AppliedWrench) -> str:
    force, moment = (", ".join(f"{value:g}" for value in part) for part in np.split(one.wrench, 2))
    lasts = f"{one.start:g} s on" if one.end == math.inf else f"{one.start:g} to {one.end:g} s"
    known = "told" if one.told else "not told"
    return f"[{force}] N, [{moment}] N m on {one.frame} from {lasts}, {known} to the controller"


def _tracking(found: PlanTracking) -> Table:
    table = heads(f"followed the {found.followed}", "rms", "worst", "at [s]", "rms of its peak")
    for name, one, factor, unit in (
        ("CoM", found.com, 1e3, "mm"),
        ("CoP", found.cop, 1e3, "mm"),
        ("angular momentum", found.momentum, 1.0, "kg m^2/s"),
        ("inertia", found.inertia, 1.0, "kg m^2"),
        ("joints", found.joints, 1.0, "rad"),
    ):
        if one is None:
            continue
        sizes = (f"{factor * size:.3g} {unit}" for size in (one.rms, one.worst))
        none = one.peak <= ROUNDING * one.rms
        relative = "it has none" if none else _percent(one.rms / one.peak)
        table.add_row(Text(name), *sizes, f"{one.at:.3f}", relative)
    if not found.whole:
        text = f"to {found.until:g} s only; it ends at {found.ends:g} s"
        table.add_row(Text("judged", style="red"), Text(text, style="red"), "", "", "")
    return table


def _push(push: Push, result: SimulationResult) -> str:
    size = float(np.linalg.norm(push.impulse))
    force = float(np.linalg.norm(push.force))
    late = "" if push.start < result.duration else ", after the end"
    return (
        f"{size:.3g} N s on {push.body} from {push.start:g} s for {push.duration:g} s,"
        f" {force:.3g} N at most{late}"
    )


def _gave_way(result: SimulationResult) -> str:
    if not result.relaxed:
        return "nothing, in any tick"
    return f"something in {_percent(result.relaxed)} of the ticks: {_listed(result.gave_way)}"


def _listed(shares: Mapping[str, float]) -> str:
    told = [f"{name} {_percent(share)}" for name, share in shares.items()]
    return listed(told, SHOWN) or "nothing noticeable"


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def _cop(result: SimulationResult) -> str:
    least = 1e3 * result.least_cop_margin
    if not np.isfinite(least):
        return "none: no sole bore load"
    where = (
        f"at most {-least:.1f} mm outside"
        if least <= -0.05
        else f"at least {abs(least):.1f} mm inside"
    )
    if np.isnan(result.cop_error):
        return f"{where} the soles, on which the controller wanted no force"
    return (
        f"{where} the soles, {1e3 * result.cop_error:.1f} mm (rms) from"
        " where the controller wanted it"
    )


def _torque(result: SimulationResult) -> str:
    if not result.torque_change:
        return "no joint has a bound"
    joint, change = next(iter(result.torque_change.items()))
    turns = revolute_joints(result.robot)[result.robot.joint_names.index(joint)]
    use = f"changes by {change:.3g} {'N m' if turns else 'N'} a tick (rms, {joint})"
    if not result.torque_use:
        return f"{use}; no joint has a bound"
    name, most = next(iter(result.torque_use.items()))
    use = f"at most {_percent(most)} of the bound ({name}); {use}"
    if not result.saturated:
        return use
    return f"{use}; at the bound for {_listed(result.saturated)} of the time"
