"""A simulation in one figure: the robot over time, CoM and CoP, contact forces, torques, tilt."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wbc.errors import InvalidInputError
from wbc.motion.dropouts import runs
from wbc.robot import Robot
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.validate import Array, finite_array
from wbc.view import portrait, style
from wbc.view.series import Series, plot_curves

WIDTH = 12.0  # inches
PANEL_SHAPE = (0.9, 1.7)  # height to width of a portrait, at least and at most
TOP, BELOW_PANEL, PLOT = 0.85, 0.35, 2.1  # inches
PORTRAITS = 5  # portraits
AFTER_PUSH = (0.0, 0.1, 0.3, 1.0)  # parts of the time after a push at which the robot is drawn
TORQUE_CURVES = 4  # whose torque is drawn: those that use most of it
PUSHED = "#FBE9DF"  # behind plots while something pushes
LEAST_SPAN, UPRIGHT = 2.0, 0.05  # mm, rad: axes are as long at least, or noise would fill them
PLANNED = ("plan_com", "plan_cop", "plan_momentum", "angular_momentum")  # if it follows a plan
APPLIED = "wrenches/"  # what the names of their arrays begin with
REQUIRED = ("time", "q", "com", "cop", "planned_cop", "torque", "push", "relaxed", "tilt")


def simulation_figure(
    robot: Robot, arrays: Mapping[str, Any], title: str = "", terrain: Terrain = LEVEL
) -> Figure:
    """Return a figure of a simulation.

    Above the robot at a few instants. Below, with pushes shaded: CoM and CoP, measured and
    commanded, along x and y; normal force of each foot, measured and commanded; torques by their
    bounds, with the ticks in which something gave way marked; tilt of the trunk and how far the CoP
    is inside the soles. If the robot follows a plan, the plan's CoM beside the robot's, how far CoM
    and CoP are from it, and the angular momentum of both.

    ``arrays``: as ``wbc sim`` writes them, or :attr:`wbc.simulation.SimulationResult.arrays` has
    them.
    ``terrain``: what the robot stood on, as :attr:`wbc.simulation.SimulationResult.terrain` has it.

    Raises InvalidInputError: arrays that do not fit together; ModelError: the robot's meshes cannot
    be read.
    """
    run = _read(robot, arrays)
    time, moments = run["time"], _instants(run)
    acting = [_wrenches_at(run, k) for k in moments]
    names = {
        f"t = {time[k]:.2f} s": portrait.Pose(run["q"][k], terrain=terrain, wrenches=one)
        for k, one in zip(moments, acting, strict=True)
    }
    portraits = portrait.portraits_of(robot, names)
    draws = _plots(robot, run)
    rows = len(draws) // 2  # the plots come in pairs
    figure = portrait.sheet_with_portraits(
        portraits, WIDTH / PORTRAITS, PANEL_SHAPE, columns=len(portraits), title=title,
        width=WIDTH, above=(TOP, 0.0), below=(BELOW_PANEL, 0.0), plots=rows * PLOT,
    )  # fmt: skip
    grid = figure.add_gridspec(rows, 2)
    for k, draw in enumerate(draws):
        draw(figure.add_subplot(grid[k // 2, k % 2]))
    return figure


def simulation_plots(robot: Robot, arrays: Mapping[str, Any]) -> list[Callable[[Axes], None]]:
    """Return what draws the plots of :func:`simulation_figure`, each on axes of its own."""
    return _plots(robot, _read(robot, arrays))


def _plots(robot: Robot, run: Mapping[str, Array]) -> list[Callable[[Axes], None]]:
    draws: list[Callable[[Axes], None]] = [
        lambda axes: _plot_com(axes, run, 0, "x: forwards"),
        lambda axes: _plot_com(axes, run, 1, "y: to the left"),
        lambda axes: _plot_torques(axes, robot, run),
        lambda axes: _plot_tilt(axes, run),
    ]
    if np.isfinite(run["cop"]).any():  # forces on the soles are known: not on a real robot
        draws.insert(2, lambda axes: _plot_forces(axes, robot, run))
        draws.append(lambda axes: _plot_margin(axes, run))
    if "plan_com" in run:
        draws += [lambda axes: _plot_from_plan(axes, run), lambda axes: _plot_momentum(axes, run)]
    return [partial(_with_pushes, draw, run) for draw in draws]


def _with_pushes(draw: Callable[[Axes], None], run: Mapping[str, Array], axes: Axes) -> None:
    draw(axes)
    time = run["time"]
    for first, last in _pushes(run):
        axes.axvspan(time[max(first - 1, 0)], time[last], color=PUSHED, linewidth=0.0, zorder=0)


def _read(robot: Robot, arrays: Mapping[str, Any]) -> dict[str, Array]:
    """Return the arrays that are drawn, all of the same length."""
    missing = [name for name in REQUIRED if name not in arrays]
    if missing:
        raise InvalidInputError(
            f"simulation: no array {', '.join(missing)}; give what wbc sim writes as .npz"
        )
    count = np.size(arrays["time"])
    run = {"time": finite_array("simulation, time", arrays["time"], (count,))}
    run["q"] = finite_array("simulation, q", arrays["q"], (count, robot.nq))
    soles = [foot.frame for foot in robot.feet.values()]
    names = [*REQUIRED[2:], "cop_margin", *(f"forces/{sole}" for sole in soles)]
    names += [f"planned_forces/{sole}" for sole in soles]
    names += [name for name in PLANNED if name in arrays]
    names += [name for name in arrays if name.startswith(APPLIED)]
    for name in names:
        unknown = np.full((count, 6) if "/" in name else count, np.nan)
        found = np.asarray(arrays.get(name, unknown), float)
        if len(found) != count:
            raise InvalidInputError(f"simulation, {name}: expected {count} rows, got {len(found)}")
        run[name] = found
    return run


def _pushes(run: Mapping[str, Array]) -> list[tuple[int, int]]:
    """Return the first and last row of each time in which something pushed."""
    return [(begin, end - 1) for begin, end in runs((run["push"] != 0.0).any(axis=1))]


def _instants(run: Mapping[str, Array]) -> list[int]:
    """Return the rows in which the robot is drawn: dense after the first push."""
    last, pushes = len(run["time"]) - 1, _pushes(run)
    if not pushes:
        rows = np.linspace(0, last, min(PORTRAITS, last + 1))
    else:
        rows = pushes[0][1] + np.array(AFTER_PUSH) * (last - pushes[0][1])
    return sorted({0, *np.round(rows).astype(int).tolist()})


def _wrenches_at(run: Mapping[str, Array], row: int) -> dict[str, Array]:
    """Return the wrenches (6,) that act in a row, by frame."""
    return {
        name.removeprefix(APPLIED): values[row]
        for name, values in run.items()
        if name.startswith(APPLIED)
    }


def _plot_com(axes: Axes, run: Mapping[str, Array], axis: int, name: str) -> None:
    style.plain(axes, f"CoM and CoP, {name}", "time [s]", "from the CoM's start [mm]")
    start = run["com"][0, axis]
    parts = (
        Series("CoP", style.BLUE, "-", run["cop"]),
        Series("CoP commanded", style.ORANGE, ":", run["planned_cop"]),
        Series("CoM", style.BLACK, "-", run["com"]),
        *([Series("CoM planned", style.GREEN, "--", run["plan_com"])] if "plan_com" in run else []),
    )
    curves = [
        Series(one.label, one.colour, one.dashes, 1e3 * (one.values[:, axis] - start))
        for one in parts
    ]
    _set_least_span(axes, run, curves)
    plot_curves(axes, run["time"], curves)


def _plot_from_plan(axes: Axes, run: Mapping[str, Array]) -> None:
    style.plain(axes, "How far CoM and CoP are from the plan", "time [s]", "mm")
    curves = []
    for label, colour, name in (("CoP", style.BLUE, "cop"), ("CoM", style.BLACK, "com")):
        apart = run[name] - run[f"plan_{name}"]
        columns = slice(0, 2 if name == "cop" else 3)
        curves.append(Series(label, colour, "-", 1e3 * np.linalg.norm(apart[:, columns], axis=1)))
    _include(axes, run, 0.0, LEAST_SPAN)
    plot_curves(axes, run["time"], curves)
    axes.set_ylim(bottom=0.0)


def _plot_momentum(axes: Axes, run: Mapping[str, Array]) -> None:
    style.plain(axes, "Angular momentum (dashed: planned)", "time [s]", "kg m$^2$/s")
    curves = []
    for k, axis in enumerate("xyz"):
        colour = style.SERIES[k]
        curves.append(Series("", colour, "--", run["plan_momentum"][:, k]))
        curves.append(Series(axis, colour, "-", run["angular_momentum"][:, k]))
    _plot(axes, run["time"], curves)


def _plot_forces(axes: Axes, robot: Robot, run: Mapping[str, Array]) -> None:
    style.plain(axes, "Normal force of each foot (dashed: commanded)", "time [s]", "N")
    curves = []
    for k, (foot, sole) in enumerate(robot.feet.items()):
        colour = style.SERIES[k % len(style.SERIES)]
        for part, dashes in (("planned_forces", "--"), ("forces", "-")):
            values = run[f"{part}/{sole.frame}"][:, 2].copy()
            values[0] = np.nan  # nothing had been measured or commanded yet
            label = foot if dashes == "-" else ""
            curves.append(Series(label, colour, dashes, values))
    _plot(axes, run["time"], curves)


def _plot_torques(axes: Axes, robot: Robot, run: Mapping[str, Array]) -> None:
    style.plain(axes, "Torques that come nearest to their bounds", "time [s]", "% of the bound")
    with np.errstate(divide="ignore", invalid="ignore"):
        used = 100.0 * np.abs(run["torque"]) / robot.limits.effort
    used[:, ~np.isfinite(robot.limits.effort)] = 0.0
    most = np.argsort(-used.max(axis=0))[:TORQUE_CURVES]
    curves = [
        Series(robot.joint_names[j], style.SERIES[k], "-", used[:, j]) for k, j in enumerate(most)
    ]
    axes.axhline(100.0, color=style.VERMILION, linewidth=0.8)  # it stretches the axis: before names
    plot_curves(axes, run["time"], curves)
    axes.set_ylim(0.0, max(105.0, axes.get_ylim()[1]))
    gave_way = run["time"][run["relaxed"] > 0.0]
    if len(gave_way):
        axes.plot(gave_way, np.zeros(len(gave_way)), "|", color=style.VERMILION, markersize=8,
                  clip_on=False)  # fmt: skip
        axes.text(0.01, 0.03, "something gave way", color=style.VERMILION, fontsize=style.SMALL,
                  transform=axes.transAxes)  # fmt: skip


def _plot_tilt(axes: Axes, run: Mapping[str, Array]) -> None:
    style.plain(axes, "Tilt of the trunk", "time [s]", "rad")
    _include(axes, run, 0.0, UPRIGHT)
    plot_curves(axes, run["time"], [Series("tilt", style.PURPLE, "-", run["tilt"])])
    axes.set_ylim(bottom=0.0)


def _plot_margin(axes: Axes, run: Mapping[str, Array]) -> None:
    style.plain(axes, "CoP inside the soles that bear load", "time [s]", "mm")
    curves = [Series("CoP", style.BLUE, "-", 1e3 * run["cop_margin"])]
    _set_least_span(axes, run, curves)
    axes.axhline(0.0, color=style.VERMILION, linewidth=0.8)  # it stretches the axis: before names
    plot_curves(axes, run["time"], curves)


def _plot(axes: Axes, time: Array, curves: Sequence[Series]) -> None:
    """Draw curves, those without a name behind the others."""
    for one in curves:
        if not one.label:
            axes.plot(time, one.values, color=one.colour, linestyle=one.dashes, linewidth=1.0)
    plot_curves(axes, time, [one for one in curves if one.label])


def _set_least_span(axes: Axes, run: Mapping[str, Array], curves: Sequence[Series]) -> None:
    """Let the axis of the next curves [mm] span at least :data:`LEAST_SPAN`."""
    values = np.concatenate([one.values for one in curves])
    seen = values[np.isfinite(values)]
    if seen.size:
        middle = 0.5 * float(seen.min() + seen.max())
        _include(axes, run, middle - 0.5 * LEAST_SPAN, middle + 0.5 * LEAST_SPAN)


def _include(axes: Axes, run: Mapping[str, Array], low: float, high: float) -> None:
    """Make the next plot's axis include two values."""
    start = float(run["time"][0])
    axes.update_datalim([(start, low), (start, high)])
