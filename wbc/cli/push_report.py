"""The report that ``wbc push`` prints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.table import Table
from rich.text import Text

from wbc.cli.console import plain_console
from wbc.cli.printing import facts, heads, print_written
from wbc.problem.pushed_problem import PushSettings
from wbc.simulation import PushMap
from wbc.simulation.push_map import compare_maps


def print_maps(maps: Sequence[PushMap], settings: PushSettings, written: Iterable[Path]) -> None:
    """Print the survived impulses by direction, beside the theoretical bounds, with notes."""
    console = plain_console()
    first = maps[0]
    many = len(maps) > 1
    for one in maps:
        state = "pushed" if one.complete else "pushed in part"
        head = Text(state, style="bold green" if one.complete else "bold yellow")
        text = (
            f": {one.name}, {one.robot}, {len(one.outcomes)} pushes of {settings.duration:g} s"
            f" on {settings.body}; {_limits_text(one)}"
        )
        console.print(head.append(text, style="not bold default"))
    console.print(_table(maps))
    table = facts()
    if many:
        table.add_row("compared", Text(_compare_text(first, maps[1])))
    for one in maps:
        for name, text in _fact_rows(one, f"{one.name}: " if many else ""):
            table.add_row(name, Text(text))
    console.print(table)
    print_written(written)


def _compare_text(one: PushMap, other: PushMap) -> str:
    least, mean, times = compare_maps(one, other)
    unknown = int(np.isnan(times).sum())
    if unknown == len(times):
        return f"in no direction both survived a push of the grid: {one.name}, {other.name}"
    excluded = f" (without {unknown} directions, in which one of them survived none)"
    return (
        f"{one.name} survives {least:.2f} times what {other.name} does at least, {mean:.2f} times"
        f" on average{excluded if unknown else ''}"
    )


def _limits_text(one: PushMap) -> str:
    tried, count = int(one.tried.sum()), len(one.tried)
    if not tried:
        return "nothing is known yet of what it survives"
    more = "at least " if one.open_ended.any() else ""
    part = "" if tried == count else f", in the {tried} of {count} directions that were tried"
    return f"survives {more}{one.least:.2f} (least) and {one.mean:.2f} (mean) M omega d{part}"


def _table(maps: Sequence[PushMap]) -> Table:
    first, many = maps[0], len(maps) > 1
    names = [f"survived, {one.name}" if many else "survived" for one in maps]
    table = heads(
        "direction [deg]",
        "M omega d [N s]",
        *names,
        "[N s]",
        "ankles, in theory",
        "reaction mass",
        "fails by",
    )
    bounds = first.bounds
    for k, angle in enumerate(np.degrees(first.grid.angles).tolist()):
        unit = float(bounds.ankle[k])
        failure = first.first_failure(k)
        table.add_row(
            f"{angle:.4g}",
            f"{unit:.2f}",
            *(_limit(one, k) for one in maps),
            f"{first.limits[k] * unit:.2f}" if first.tried[k] else "",
            f"{bounds.pulse[k] / unit:.2f}",
            "" if bounds.wheel is None else f"{bounds.wheel[k] / unit:.2f}",
            Text("" if failure is None else _short(failure.reason)),
        )
    return table


def _limit(one: PushMap, k: int) -> Text:
    """Return the limit of a direction, marked if the grid ends there or it is not monotone."""
    if not one.tried[k]:
        return Text("untried", style="dim")
    limit, open_ended = one.limits[k], one.open_ended[k]
    if limit == 0.0:
        tried = one.first_failure(k)
        return Text("" if tried is None else f"< {tried.ratio:.4g}", style="red")
    odd = "*" if one.beyond(k) else ""
    return Text(f"{'>= ' if open_ended else ''}{limit:.4g}{odd}")


def _short(reason: str) -> str:
    """Return why a robot fell, without the time."""
    _, _, why = reason.partition(": ")
    return (why or reason).split(", more than")[0]


def _fact_rows(one: PushMap, who: str) -> Iterator[tuple[str, str]]:
    odd = [
        f"{np.degrees(one.grid.angles[k]):.4g} deg at {', '.join(f'{r:.4g}' for r in ratios)}"
        for k in range(one.grid.directions)
        if (ratios := one.beyond(k))
    ]
    if odd:
        yield (
            "not monotone",
            f"{who}* survived beyond a smaller push that was not: {'; '.join(odd)}",
        )
    lasted = [outcome for outcome in one.outcomes if outcome.survived]
    if lasted:
        yield (
            "survivors",
            f"{who}trunk tilted by at most {max(o.tilt for o in lasted):.2f} rad, feet ended at"
            f" most {1e3 * max(o.slip for o in lasted):.1f} mm from where they began, something"
            f" gave way in at most {100 * max(o.relaxed for o in lasted):.2g} % of the ticks",
        )
    bounds = one.bounds
    if bounds.wheel is None:
        yield "reaction mass", f"{who}no estimate: {bounds.why_no_wheel}"
    else:
        mass = bounds.reaction_mass
        x, y = mass["inertia"]
        yield (
            "reaction mass",
            f"{who}{x:.3g}, {y:.3g} kg m^2 with {mass['torque']:.3g} N m that"
            f" turns by {mass['angle']:.3g} rad; an estimate, not a bound of the robot",
        )
