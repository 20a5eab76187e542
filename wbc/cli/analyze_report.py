"""Output of ``wbc analyze``: a table of a motion's pendulum, and a verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.text import Text

from wbc.cli.console import plain_console
from wbc.cli.printing import heads, print_line
from wbc.motion import RmpSeries
from wbc.motion.dropouts import Dropout
from wbc.motion.uncertainty import BAND
from wbc.validate import Array, Bools

if TYPE_CHECKING:
    from wbc.human import HumanMotion

SHOWN_DROPOUTS = 10
NEAR_END = "within a period of the low-pass of an end, where it extrapolates the motion"


def print_analysis(series: RmpSeries, human: HumanMotion | None) -> None:
    """Print dropouts, noise, the table and the verdict."""
    console = plain_console()
    seconds = float(series.time[-1] - series.time[0])
    rate = (len(series) - 1) / seconds
    head = Text(Path(series.source).name, style="bold")
    head.append(
        f": {series.robot.name}, {series.robot.mass:.2f} kg, {len(series)} frames,"
        f" {seconds:.2f} s at {rate:.4g} Hz",
        style="not bold default",
    )
    console.print(head)
    print_dropouts(series.dropouts)
    for name, excess in series.past_limits.items():
        print_line("limits", f"{name} is up to {excess:.3g} past its limits [rad or m]", "yellow")
    print_line("noise", noise_line(series))
    inner = ~_extrapolated(series)
    if series.cutoff is not None and not inner.all():
        ends = f"{1.0 / series.cutoff:.2g} s at either are extrapolated by the low-pass"
        print_line("ends", f"{ends}, and not in the table")
    table = heads("", "least", "mean", "largest", "95 % band")
    for name, scale, values, deviation in _rows(series):
        known = scale * values[inner & np.isfinite(values)]
        if known.size:
            numbers = [f"{number:.4g}" for number in (known.min(), known.mean(), known.max())]
            half = np.empty(0) if deviation is None else scale * BAND * deviation
            half = half[np.isfinite(half)]
            table.add_row(Text(name), *numbers, f"± {np.median(half):.2g}" if half.any() else "")
    console.print(table)
    console.print()
    console.print(verdict(series, human))


def noise_line(series: RmpSeries) -> str:
    """Return a line about the recording's noise and its low-pass."""
    low_pass = "no low-pass" if series.cutoff is None else f"low-pass at {series.cutoff:.3g} Hz"
    if series.uncertainty is None:
        return f"not estimated; {low_pass}"
    noise = series.uncertainty.noise
    kinds = noise.typical(series.robot).items()
    parts = [f"{1e3 * size:.2g} m{unit} of {name}" for name, (size, unit) in kinds]
    line = f"{', '.join(parts) or 'none'} (standard deviation, median); {low_pass}"
    if noise.coloured:
        line += (
            "; larger near the cutoff than far above it: smoothed before, or not white, and the"
            " bands may be too narrow"
        )
    return line


def _rows(series: RmpSeries) -> Iterator[tuple[str, float, Array, Array | None]]:
    """Yield name with unit, factor to that unit, values (n,) and deviations of the table's rows."""
    deviations = {} if series.uncertainty is None else series.uncertainty.arrays()

    def column(name: str, k: int) -> Array | None:
        return deviations[name][:, k] if name in deviations else None

    for k, axis in enumerate("xyz"):
        yield f"CoM {axis} [mm]", 1e3, series.com[:, k], column("com", k)
    for k, axis in enumerate("xy"):
        yield f"CoP {axis} [mm]", 1e3, series.cop[:, k], column("cop", k)
    yield "CMP to CoP [mm]", 1e3, np.linalg.norm(series.cmp - series.cop, axis=1), None
    if series.cop_margin is not None:
        within = deviations.get("cop_margin")
        yield "CoP inside the support by [mm]", 1e3, series.cop_margin, within
    push = None if series.measured else column("momentum_rate", 2)
    yield "push of the ground [N]", 1.0, series.ground_force[:, 2], push
    if series.measured:
        residual = np.linalg.norm(series.force_residual, axis=1)
        yield "measured force to M (c'' - g) [N]", 1.0, residual, None
    yield "leg length [mm]", 1e3, series.leg_length, deviations.get("leg_length")
    for k in range(3):
        yield f"radius r{k + 1} [mm]", 1e3, series.radii[:, k], column("radii", k)
    momentum, axes = series.average_angular_velocity, series.axes_angular_velocity
    yield "turning by momentum, I^-1 k [rad/s]", 1.0, np.linalg.norm(momentum, axis=1), None
    yield "turning of the axes [rad/s]", 1.0, np.linalg.norm(axes, axis=1), None


def verdict(series: RmpSeries, human: HumanMotion | None = None) -> Text:
    """Return a line about CoP, flight and axes, without claims that noise could explain."""
    count, line = len(series), Text()
    unknown = int(series.cop_unknown.sum())
    margin, noise = series.cop_margin, series.uncertainty
    checked = margin is not None and bool(np.isfinite(margin).any())
    if margin is None:
        line.append("CoP not checked: no feet. ")
    elif unknown and not checked:
        line.append(
            "CoP not checked: no sole ever touches the ground; check --ground, and the unit"
            " of the base and the order of its quaternion. ",
            style="yellow",
        )
    elif series.infeasible.any():
        line.append(*_outside(series, margin, human is not None))
    elif series.cop_outside.any() and noise is not None and noise.cop_margin is not None:
        line.append(*_perhaps_outside(series, margin, noise.cop_margin))
    else:
        line.append("CoP inside the support polygon wherever there is one. ", style="green")
        unsure = int((np.isfinite(margin) & ~series.surely_inside).sum())
        if unsure:
            line.append(f"In {unsure} of {count} frames it may be outside within the noise. ")
    if unknown and checked:
        line.append(f"In {unknown} of {count} frames no sole touches the ground")
        line.append(f"{_standing_higher(series, human)}. " if human is not None else ". ")
    if series.flight.any():
        line.append(f"The ground does not push in {series.flight.sum()} of {count} frames")
        if not (series.flight & ~_extrapolated(series)).any():
            line.append(f", only {NEAR_END}")
        unsure = int((series.flight & ~series.surely_flying).sum())
        line.append(f", in {unsure} of them perhaps by noise. " if unsure else ". ")
    undefined = int((~series.axes_defined.all(axis=1)).sum())
    if undefined:
        line.append(f"Principal axes undefined in {undefined} frames.")
    return line


def _standing_higher(series: RmpSeries, human: HumanMotion) -> str:
    """Return in how many of the frames without a CoP a foot stands all the same."""
    from wbc.human.contacts import nearest_rows

    down = human.down[nearest_rows(human.motion.time, series.time)].any(axis=1)
    higher = int((series.cop_unknown & down).sum())
    where = "by its speed, above the ground: it rolls, or the recording drifts (see --ground)"
    return f"; in {higher} of them a foot stands {where}" if higher else ""


def _outside(series: RmpSeries, margin: Array, human: bool) -> tuple[str, str]:
    """Return text and colour for a CoP that is certainly outside."""
    sure = series.infeasible
    first, farthest = series.time[sure][0], -margin[sure].min()
    elsewhere = sure & ~_extrapolated(series)
    # A measured motion is feasible: of a recorded simulation 4.2 mm, without filter 0.02 mm.
    why = "the motion is infeasible there"
    if human:
        why = "it was done, so the fit, the sole's shape or, near the ends, the filter is off"
    if series.measured:
        why = "it was measured, so the forces, the soles' shape or the ground's height are off"
        if series.cutoff is not None:
            why = "it was measured, so check with --cutoff none how much is due to the filter"
    judged = not human and not series.measured
    if judged and not elsewhere.any():
        why = f"only {NEAR_END}; check with --cutoff none"
    noise = None if series.uncertainty is None else series.uncertainty.cop_margin
    beyond = noise is not None and not series.measured and bool(np.nanmax(noise) > 0.0)
    text = (
        f"CoP outside the support polygon in {sure.sum()} of {len(series)} frames, by"
        f" {1e3 * farthest:.3g} mm at most{', beyond the noise' if beyond else ''}, first"
        f" at {first:.12g} s: {why}. "
    )
    if judged and elsewhere.any() and -margin[elsewhere].min() < farthest:
        text += f"That is {NEAR_END}; elsewhere {1e3 * -margin[elsewhere].min():.3g} mm at most. "
    perhaps = int((series.cop_outside & ~sure).sum())
    if perhaps:
        text += f"In {perhaps} more it is outside within the noise. "
    return text, "red" if judged and elsewhere.any() else "yellow"


def _extrapolated(series: RmpSeries) -> Bools:
    """Return where the low-pass extrapolates (n,): within a period of its cutoff of an end.

    Nowhere if that is everywhere.
    """
    period = 0.0 if series.cutoff is None else 1.0 / series.cutoff
    near = np.minimum(series.time - series.time[0], series.time[-1] - series.time) < period
    return np.asarray(near & ~near.all())


def _perhaps_outside(series: RmpSeries, margin: Array, noise: Array) -> tuple[str, str]:
    """Return text and colour for a CoP that may be outside by noise alone."""
    outside = series.cop_outside
    farthest = -margin[outside].min()
    band = BAND * float(np.median(noise[outside]))
    text = (
        f"CoP outside the support polygon in {outside.sum()} of {len(series)} frames, by"
        f" {1e3 * farthest:.3g} mm at most: not distinguishable from the recording's noise (95 %"
        f" band there ± {1e3 * band:.2g} mm), so feasibility is undecided; a lower --cutoff,"
        " or residual, narrows the band. "
    )
    return text, "yellow"


def print_dropouts(dropouts: Sequence[Dropout]) -> None:
    """Print a recording's dropouts: those of the same rows in one line, ten lines at most."""
    joined = dict[tuple[str, float, float, bool], Dropout]()
    for one in dropouts:
        key = one.kind, one.start, one.end, one.filled
        before = joined[key].columns if key in joined else ()
        joined[key] = replace(one, columns=(*before, *one.columns))
    lines = [*map(str, joined.values())]
    for line in lines[:SHOWN_DROPOUTS]:
        print_line("dropout", line, "yellow")
    if len(lines) > SHOWN_DROPOUTS:
        plain_console().print(f"and {len(lines) - SHOWN_DROPOUTS} more dropouts")
