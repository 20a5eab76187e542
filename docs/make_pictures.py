"""Make the pictures of README and gallery from the problems that ship: python -m docs.make_pictures

All of them, or those that are named: python -m docs.make_pictures walk_g1 fig6_g1
"""

import json
import sys
from argparse import ArgumentParser
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import Image  # matplotlib brings it

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))  # they import each other by name

from balance_figures import pushes_figure, regions_figure
from exposures import exposures_figure
from footsteps import landing_poses
from push_recovery import largest_impulses
from region_of_attraction import lean_grid, region_of_attraction
from walk_ablation import JOURNAL as ABLATION_FILE
from walk_ablation import bounds_of, means
from walk_pushes import PHASES, SIDES

from docs import subjects
from wbc.gait.phases import sole_poses
from wbc.gait.prescribed_steps import in_world
from wbc.gait.swing import turned
from wbc.minimum_jerk import minimum_jerk
from wbc.motion import analyze, read_motion
from wbc.polygon import inset
from wbc.problem import load_problem
from wbc.qp import make_backend
from wbc.rmp.balance.law import LawBounds
from wbc.rmp.balance.momentum_qp import MomentumQp
from wbc.rmp.balance.push_limits import Wheel, compass, push_limits
from wbc.rmp.balance.stabiliser import PointStabiliser
from wbc.rmp.solid import SolidRmp
from wbc.view import plot_pendulum, plot_robot, plot_run, style
from wbc.view.analysis import analysis_figure
from wbc.view.history import read_history
from wbc.view.options import View
from wbc.view.portrait import Pose
from wbc.view.simulation import simulation_figure
from wbc.view.style import save

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "pictures"
# A G1-like pendulum: mass [kg], height of the CoM [m], half of the soles [m], motors [N m, rad].
MASS, HEIGHT, HALF, TORQUE, ANGLE = 35.0, 0.7, 0.1, 50.0, 0.6
RADII = (0.3, 0.3, 0.3)  # m
# Results of benchmarks/walk_comparison.py, its variants, and directions of pushes [deg].
MEASUREMENTS = ROOT / "benchmarks" / "walk_comparison.jsonl"
VARIANTS = {"free": style.GREY, "regulated": style.ORANGE, "planned": style.BLUE}
# Likewise of benchmarks/walk_ablation.py, and how bounds of a pendulum are drawn over its bars.
ABLATION = {
    "free": style.GREY,
    "regulated": style.ORANGE,
    "soft foot": style.SKY,
    "planned": style.BLUE,
}
BOUNDS = (
    (style.BLACK, "-"),
    *((colour, line) for colour in (style.VERMILION, style.GREEN) for line in ("-", ":")),
)
WAYS = {0: "the front", 90: "the left", 180: "the back", 270: "the right"}
SHOWN = 7  # portraits of a walk on footsteps


def shipped(problem: str) -> Any:
    """Return a problem that ships, by its name."""
    return load_problem(ROOT / "problems" / f"{problem}.yaml")


def place(name: str) -> Path:
    """Return the path of a picture."""
    return FOLDER / f"{name}.png"


def smaller(name: str, width: int | None = None, shades: bool = False) -> None:
    """Keep 256 colours, the rare ones of thin lines among them, and ``width`` pixels across.

    Rounds of k-means bring the colours to what they stand for: without, pale floors are tinted.
    With ``shades`` a wide floor keeps its own, in a file twice as large.
    """
    choice = Image.Quantize.MEDIANCUT if shades else Image.Quantize.MAXCOVERAGE
    image = Image.open(place(name)).convert("RGB")
    if width is not None:
        image = image.resize((width, image.height * width // image.width), Image.Resampling.LANCZOS)
    image.quantize(256, choice, kmeans=1).save(place(name), optimize=True)


def run_picture(name: str, view: View | None = None) -> None:
    """Draw a run as `wbc run` does."""
    result = shipped(name).run()
    title = f"{name}: {result.status.value}"
    plot_run(result.robot, result.history, place(name), title=title, view=view or View())
    smaller(name)


def ends_picture(name: str, members: Mapping[str, str]) -> None:
    """Draw the start of some problems of one robot, and the end of each."""
    problems = {k: shipped(problem) for k, problem in members.items()}
    robot = next(iter(problems.values())).parts.robot
    runs = {k: read_history(robot, problem.run().history) for k, problem in problems.items()}
    poses = {"start": next(iter(runs.values())).pose(0)}
    poses |= {k: run.pose(-1) for k, run in runs.items()}
    plot_robot(robot, poses, place(name))
    smaller(name)


def simulation_picture(name: str, width: int = 1400) -> None:
    """Draw a simulation as `wbc sim` does."""
    result = shipped(name).simulate()
    title = f"{name}: {result.reason}"
    figure = simulation_figure(result.robot, result.arrays, title, result.terrain)
    style.save(figure, place(name))
    smaller(name, width=width)


def strip_picture(
    name: str, moments: Mapping[str, float], view: View, grounded: bool = True
) -> None:
    """Draw a simulation at some moments [s], side by side."""
    result = shipped(name).simulate()
    rows = np.searchsorted(result.arrays["time"], list(moments.values()))
    poses = {
        f"{called}: {at:.2f} s": Pose(q, grounded, grounded, terrain=result.terrain)
        for (called, at), q in zip(moments.items(), result.arrays["q"][rows], strict=True)
    }
    plot_robot(result.robot, poses, place(name), view=view)
    smaller(name, width=1800)


def exposures_picture(name: str, moments: Mapping[str, float], view: str) -> None:
    """Draw a simulation at some moments [s] in one picture, on its ground."""
    result = shipped(name).simulate()
    rows = np.searchsorted(result.arrays["time"], list(moments.values()))
    poses, way = dict(zip(moments, result.arrays["q"][rows], strict=True)), result.arrays["com"]
    look = View.of(view, "robot,ground,soles,com")
    figure = exposures_figure(
        result.robot, poses, path_of_com=way, terrain=result.terrain, view=look
    )
    style.save(figure, place(name))
    smaller(name, width=1400, shades=True)


def footsteps_picture(name: str) -> None:
    """Draw a walk on footsteps at some moments, and its landing places from above."""
    problem = shipped(name)
    result, start = problem.simulate(), problem.parts.robot.snapshot(problem.parts.start)
    given = [one.footstep for one in problem.spec.gait.footsteps]
    steps = in_world(given, sole_poses(start))
    rows = np.linspace(0, len(result.arrays["time"]) - 1, SHOWN).astype(int)
    poses = {f"{result.arrays['time'][k]:.1f} s": result.arrays["q"][k] for k in rows}
    plot_robot(result.robot, poses, place(name), view=View.of("40,12"))
    figure = style.sheet(12.0, 4.4, plots=4.4)
    axes = figure.subplots()
    style.plain(axes, "Soles from above (dashed: the footsteps given)", "x [m]", "y [m]")
    axes.set_aspect("equal")
    for step, pose in zip(steps, landing_poses(result, len(steps)), strict=True):
        colour = style.BLUE if step.foot == "left" else style.VERMILION
        asked = step.pose(0.0)  # seen from above
        for at, look in ((pose, {"alpha": 0.25}), (asked, {"fill": False, "linestyle": "--"})):
            sole = result.robot.feet[step.foot].polygon @ turned(at[2])[:2, :2].T + at[:2]
            axes.fill(*sole.T, color=colour, **look)
    axes.plot(*result.arrays["com"][:, :2].T, color=style.BLACK, linewidth=1.0, label="CoM")
    axes.legend(fontsize=style.SMALL, frameon=False, loc="upper left")
    above = Image.open(place(name)).convert("RGB")
    save(figure, place(name))
    below = Image.open(place(name)).convert("RGB")
    below = below.resize((above.width, below.height * above.width // below.width))
    both = Image.new("RGB", (above.width, above.height + below.height), "white")
    both.paste(above, (0, 0))
    both.paste(below, (0, above.height))
    both.save(place(name))
    smaller(name, width=1400)


def comparison_picture(name: str) -> None:
    """Draw the measurements of benchmarks/walk_comparison.py."""
    rows = [json.loads(line) for line in MEASUREMENTS.read_text().splitlines()[1:]]
    walks = [row for row in rows if row["group"] == "walk"]
    pushes = [row for row in rows if row["group"] == "push"]
    angles = sorted({row["push"][0] for row in pushes})
    figure = style.sheet(12.0, 3.3, plots=3.3)
    plots = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.5))
    style.plain(plots[0], "Standing foot turns in a step", "friction 0.4, 0.8 m/s", "degrees")
    style.plain(plots[1], "Torque, by the motor's bound", "friction 0.4, 0.8 m/s", "%")
    style.plain(plots[2], "Impulse survived at 0.5 m/s", "pushed towards", "N s")
    for k, (variant, colour) in enumerate(VARIANTS.items()):
        own = [row for row in walks if row["variant"] == variant]
        for axes, (usual, worst), unit, shown in (
            (plots[0], ("mean_turned", "turned"), 1.0, "%.1f"),
            (plots[1], ("torque_rms", "torque"), 100.0, "%.0f"),
        ):
            mean = float(np.mean([row[usual] for row in own]))  # of the seeds
            heights = [unit * mean, unit * max(row[worst] for row in own)]
            bars = axes.bar(
                np.arange(2) + 0.27 * (k - 1), heights, 0.25, color=colour, label=variant
            )
            axes.bar_label(bars, fmt=shown, fontsize=style.SMALL)
        most = [_survived(pushes, variant, angle) for angle in angles]
        bars = plots[2].bar(np.arange(len(angles)) + 0.27 * (k - 1), most, 0.25, color=colour)
        plots[2].bar_label(bars, fmt="%.3g", fontsize=style.SMALL)
    for axes in plots:
        axes.margins(y=0.12)  # room for numbers on the highest bars
    plots[0].set_xticks([0, 1], ["mean", "most"])
    plots[1].set_xticks([0, 1], ["rms", "most"])
    plots[2].set_xticks(range(len(angles)), [WAYS[int(angle)] for angle in angles])
    plots[0].legend(title="momentum, inertia", fontsize=style.SMALL, title_fontsize=style.SMALL)
    save(figure, place(name))
    smaller(name, width=1400)


def _survived(rows: Sequence[Mapping[str, Any]], variant: str, angle: float) -> float:
    """Return the largest impulse survived [N s], the mean of the seeds."""
    most: dict[int, float] = {}
    for row in rows:
        if row["variant"] == variant and row["push"][0] == angle:
            survived = row["push"][1] if row["stood"] else 0.0
            most[row["seed"]] = max(most.get(row["seed"], 0.0), survived)
    return float(np.mean(list(most.values())))


def ablation_picture(name: str) -> None:
    """Draw the measurements of benchmarks/walk_ablation.py, and the bounds of walk_bounds.py."""
    rows = [json.loads(line) for line in ABLATION_FILE.read_text().splitlines()[1:]]
    survived, bounds = means(rows), bounds_of("g1")
    sides, phases = list(SIDES), sorted({row["phase"] for row in rows})
    figure = style.sheet(12.0, 3.3, plots=3.3)
    plots = np.atleast_1d(figure.subplots(1, len(phases), sharey=True))
    for axes, phase in zip(plots, phases, strict=True):
        what = "as a step begins" if phase == 0 else f"{phase}/{PHASES} of the step done"
        style.plain(axes, f"Pushed {what}", "pushed from", "N s survived")
        at = np.arange(len(sides))
        shown = {variant: ABLATION[variant] for variant in ABLATION if variant in survived}
        width = 0.8 / len(shown)
        for k, (variant, colour) in enumerate(shown.items()):
            most = [survived[variant].get((side, phase), 0.0) for side in sides]
            left = at + width * (k + 0.5 - 0.5 * len(shown))
            bars = axes.bar(left, most, 0.95 * width, color=colour, label=variant)
            how = {"fmt": "%.0f", "color": "white", "label_type": "center"}
            axes.bar_label(bars, fontsize=style.SMALL, **how)
        for (colour, dots), (bound, largest) in zip(BOUNDS, bounds.items(), strict=False):
            for k, side in enumerate(sides):
                label = f"bound: {bound}" if k == 0 else None
                line = [k - 0.45, k + 0.45], [largest[side, phase]] * 2
                axes.plot(*line, dots, color=colour, linewidth=1.2, label=label)
        axes.set_xticks(at, sides)
        axes.margins(y=0.12)
    plots[-1].legend(fontsize=style.SMALL, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    save(figure, place(name))
    smaller(name, width=1400)


def shiko_picture(name: str) -> None:
    """Draw the shiko as `wbc analyze` does."""
    result = shipped("shiko_hoap2").run()
    draw_analysis(name, "shiko_hoap2", result, subjects.SHIKO, f", {result.robot.mass:.1f} kg")


def measured_picture(name: str) -> None:
    """Draw the shiko of a simulation as `wbc analyze` does, with the measured CoP."""
    draw_analysis(
        name,
        name,
        shipped(name).simulate(),
        subjects.MEASURED,
        "; forces as the soles measured them",
    )


def draw_analysis(
    name: str, problem: str, result: Any, snapshots: Sequence[float], remark: str
) -> None:
    """Draw the file of a result as `wbc analyze` does, with a remark in the title."""
    with TemporaryDirectory() as folder:
        recording = Path(folder) / f"{problem}.npz"
        result.save(recording)
        series = analyze(read_motion(recording, result.robot))
    title = f"{recording.name}: {series.robot.name}{remark}"
    style.save(analysis_figure(series, title=title, snapshots=snapshots), place(name))
    smaller(name)


def turn_picture(name: str) -> None:
    """Draw a turn without momentum: the first round, half of the rounds, and all of them."""
    problem = shipped(name)
    history = problem.run().history
    run = read_history(problem.parts.robot, history)
    path = next(one for one in problem.parts.targeted if one.task.name == "path")
    count, duration = path.course.cycles, path.course.duration
    parts = {"start": 0.0, "a quarter of a round": 0.25, "half": 0.5, "three quarters": 0.75}
    parts |= {"one round": 1.0, f"{count // 2} rounds": count // 2, f"{count} rounds": count}
    ramp = np.array([minimum_jerk(t / duration) for t in history.time])
    rows = {called: int(np.searchsorted(ramp, part / count)) for called, part in parts.items()}
    poses = {called: run.pose(min(row, len(ramp) - 1)) for called, row in rows.items()}
    plot_robot(problem.parts.robot, poses, place(name))
    smaller(name, width=1800)


def pendulum_picture(name: str) -> None:
    """Draw a pendulum's problem as `wbc run` does."""
    result = shipped(name).run()
    plot_pendulum(result.history, place(name), title=f"{name}: {result.status.value}")
    smaller(name)


def pushes_picture(name: str) -> None:
    """Draw pushes all around that a pendulum absorbs, by theory and by simulation."""
    square = HALF * np.array(((-1, -1), (1, -1), (1, 1), (-1, 1)))
    bounds = LawBounds(polygon=square, friction=0.8, wheel_torque=TORQUE, wheel_angle=ANGLE)
    cold = make_backend("proxqp_cold")  # no run depends on the run before it
    law = MomentumQp(SolidRmp(MASS), bounds, (0.0, 0.0, HEIGHT), RADII, dt=1e-3, backend=cold)
    inertia = MASS * 2 / 3 * RADII[0] ** 2
    wheel = Wheel(inertia, TORQUE, ANGLE)
    sole = inset(square, bounds.cop_margin)
    theory = push_limits(compass(16), sole, wheel, mass=MASS, height=HEIGHT)
    bracket = np.column_stack((0.5 * theory.wheel, 1.5 * theory.wheel))
    impulses = {
        "ankle only (theory)": theory.ankle,
        "with reaction mass (theory)": theory.wheel,
        "MomentumQp, simulated": largest_impulses(law, theory.directions, bracket),
    }
    save(pushes_figure(theory.directions, impulses), place(name))


def region_picture(name: str) -> None:
    """Draw the region of attraction of a pendulum's stabiliser."""
    leans = np.radians(np.linspace(-16.0, 16.0, 33))
    rest = np.array((0.0, 0.0, np.pi / 2, 0.0, HEIGHT, 0.0, 0.0, 0.0, 1.0, *RADII))
    stabiliser = PointStabiliser(SolidRmp(MASS), LawBounds(wheel_torque=TORQUE), HEIGHT, RADII)
    region = region_of_attraction(stabiliser, rest, lean_grid(rest, leans, leans))
    settling = region.settling.reshape(len(leans), len(leans))
    times = {"Leaning, and back to rest by PointStabiliser": settling}
    save(regions_figure(leans, leans, times), place(name))


PICTURES: Mapping[str, Callable[[str], None]] = {
    "astronaut_expand": run_picture,
    "shape_standing_g1": run_picture,
    # From the side, where the wall does not cover the hands.
    "safe_reach_g1": partial(run_picture, view=View.of("60,25", "no-ellipsoid,no-masses")),
    "global_tall_hoap2": run_picture,
    "global_small_g1": run_picture,
    "fig6_g1": partial(ends_picture, members=subjects.FIG6),
    "fig7_hoap2": partial(ends_picture, members=subjects.FIG7),
    "shiko_hoap2_rmp": shiko_picture,
    "push_g1": simulation_picture,
    "track_squat_g1": simulation_picture,
    "lean_beyond_g1": simulation_picture,
    "drop_g1": simulation_picture,
    "hop_g1": partial(strip_picture, moments=subjects.HOP, view=View.of("60,10")),
    "walk_comparison_g1": comparison_picture,
    "walk_ablation_g1": ablation_picture,
    "footsteps_g1": footsteps_picture,
    "walk_push_g1": partial(strip_picture, moments=subjects.PUSHED, view=View.of("20,10")),
    "wall_g1": partial(strip_picture, moments=subjects.WALL, view=View.of("-22,10")),
    "somersault_hoap2": partial(
        strip_picture, moments=subjects.SOMERSAULT, view=View.of("70,10"), grounded=False
    ),
    "shiko_torque_hoap2": measured_picture,
    "shiko_torque_g1": partial(strip_picture, moments=subjects.SHIKO_G1, view=View.of("10,10")),
    "turn_x_hoap2": turn_picture,
    "turn_y_hoap2": turn_picture,
    "turn_z_hoap2": turn_picture,
    "walk_g1": partial(simulation_picture, width=1240),
    "walk_boards_g1": partial(exposures_picture, moments=subjects.BOARDS, view="-72,13"),
    "stairs_g1": partial(exposures_picture, moments=subjects.STAIRS, view="-75,10"),
    "stones_g1": partial(exposures_picture, moments=subjects.STONES, view="-60,18"),
    "walk_slope_g1": partial(exposures_picture, moments=subjects.SLOPE, view="-80,7"),
    "walk_back_g1": partial(exposures_picture, moments=subjects.BACK, view="27,22"),
    "rmp_push_qp": pendulum_picture,
    "rmp_swing_up": pendulum_picture,
    "plan_hop_turn": pendulum_picture,
    "plan_walk": pendulum_picture,
    "rmp_pushes": pushes_picture,
    "rmp_region": region_picture,
}


def main() -> None:
    parser = ArgumentParser(
        prog="python -m docs.make_pictures",
        description="Make pictures of README and gallery from the problems that ship.",
        epilog=f"pictures: {', '.join(PICTURES)}",
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="pictures; none: all of them")
    names = parser.parse_args().names
    unknown = [name for name in names if name not in PICTURES]
    if unknown:
        parser.error(f"no picture {', '.join(unknown)}; there are: {', '.join(PICTURES)}")
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in dict.fromkeys(names or PICTURES):
        PICTURES[name](name)


if __name__ == "__main__":
    main()
