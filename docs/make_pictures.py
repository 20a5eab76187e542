"""Make the pictures of the README from the problems that ship: python -m docs.make_pictures"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image  # matplotlib brings it

from benchmarks.push_recovery import largest_impulses
from benchmarks.region_of_attraction import lean_grid, region_of_attraction
from wbc.minimum_jerk import minimum_jerk
from wbc.motion import analyse, read_motion
from wbc.polygon import inset
from wbc.problem import load_problem
from wbc.qp import make_backend
from wbc.rmp.balance.law import Bounds
from wbc.rmp.balance.momentum_qp import MomentumQp
from wbc.rmp.balance.push_limits import Wheel, compass, push_limits
from wbc.rmp.balance.stabiliser import PointStabiliser
from wbc.rmp.solid import SolidRmp
from wbc.view import plot_pendulum, plot_robot, plot_run
from wbc.view.analysis import plot_analysis
from wbc.view.balance import pushes_figure, regions_figure
from wbc.view.history import read_history
from wbc.view.options import View
from wbc.view.simulation import plot_simulation
from wbc.view.style import save

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "docs" / "pictures"
FIG6 = {
    "a: all large": "fig6a_g1",
    "b: vertical large": "fig6b_g1",
    "c: the others large": "fig6c_g1",
}
FIG7 = {
    "backward": "fig7_backward_hoap2",
    "forward": "fig7_forward_hoap2",
    "downward": "fig7_downward_hoap2",
}


# From the side, where the wall does not cover the hands.
VIEWS = {"safe_reach_g1": View.of("60,25", "no-ellipsoid,no-masses")}
PENDULUMS = ("rmp_push_qp", "rmp_swing_up", "plan_hop_turn", "plan_walk")
# A G1-like pendulum: mass [kg], height of the CoM [m], half of the soles [m], motors [N m, rad].
MASS, HEIGHT, HALF, TORQUE, ANGLE = 35.0, 0.7, 0.1, 50.0, 0.6
RADII = (0.3, 0.3, 0.3)  # m
# Shiko [s]: standing, squat, over the right foot, left leg half way, at its top, stomp, other leg.
SHIKO = (0.0, 2.0, 4.0, 5.0, 6.0, 6.7, 12.2)
MEASURED = (0.0, 2.0, 4.0, 5.0, 6.0, 6.84, 12.3)


def analysis_picture() -> None:
    """Draw the shiko as `wbc analyze` does."""
    with TemporaryDirectory() as folder:
        result = load_problem(ROOT / "problems" / "shiko_hoap2.yaml").run()
        recording = Path(folder) / "shiko_hoap2.npz"
        result.save(recording)
        series = analyse(read_motion(recording, result.robot))
    picture = PICTURES / "shiko_hoap2_rmp.png"
    title = f"{recording.name}: {series.robot.name}, {series.robot.mass:.1f} kg"
    plot_analysis(series, picture, title=title, snapshots=SHIKO)
    smaller(picture)


def simulation_picture(name: str, width: int = 1400) -> None:
    """Draw a simulation as `wbc sim` does."""
    result = load_problem(ROOT / "problems" / f"{name}.yaml").simulate()
    picture = PICTURES / f"{name}.png"
    plot_simulation(result.robot, result.arrays, picture, title=f"{name}: {result.reason}")
    smaller(picture, width=width)


def measured_picture() -> None:
    """Draw the shiko of a simulation as `wbc analyze` does, with the CoP as measured."""
    with TemporaryDirectory() as folder:
        result = load_problem(ROOT / "problems" / "shiko_torque_hoap2.yaml").simulate()
        recording = Path(folder) / "shiko_torque_hoap2.npz"
        result.save(recording)
        series = analyse(read_motion(recording, result.robot))
    picture = PICTURES / "shiko_torque_hoap2.png"
    title = f"{recording.name}: {series.robot.name}; forces as the soles measured them"
    plot_analysis(series, picture, title=title, snapshots=MEASURED)
    smaller(picture)


def turn_pictures() -> None:
    """Draw turns without momentum: the first round, half of the rounds, and all of them."""
    for axis in "xyz":
        problem = load_problem(ROOT / "problems" / f"turn_{axis}_hoap2.yaml")
        history = problem.run().history
        run = read_history(problem.parts.robot, history)
        path = next(one for one in problem.parts.targeted if one.task.name == "path")
        count, duration = path.course.cycles, path.course.duration
        parts = {"start": 0.0, "a quarter of a round": 0.25, "half": 0.5, "three quarters": 0.75}
        parts |= {"one round": 1.0, f"{count // 2} rounds": count // 2, f"{count} rounds": count}
        ramp = np.array([minimum_jerk(t / duration) for t in history.time])
        rows = {name: int(np.searchsorted(ramp, part / count)) for name, part in parts.items()}
        poses = {name: run.pose(min(row, len(ramp) - 1)) for name, row in rows.items()}
        picture = PICTURES / f"turn_{axis}_hoap2.png"
        plot_robot(problem.parts.robot, poses, picture)
        smaller(picture, width=1800)


def smaller(picture: Path, width: int | None = None) -> None:
    """Keep 256 colours, the rare ones of thin lines among them, and ``width`` pixels across."""
    image = Image.open(picture).convert("RGB")
    if width is not None:
        image = image.resize((width, image.height * width // image.width), Image.Resampling.LANCZOS)
    image.quantize(256, Image.Quantize.MAXCOVERAGE).save(picture, optimize=True)


def pendulum_pictures() -> None:
    """Draw the pendulum's problems, pushes all around and the stabiliser's region of attraction."""
    for name in PENDULUMS:
        result = load_problem(ROOT / "problems" / f"{name}.yaml").run()
        title = f"{name}: {result.status.value}"
        plot_pendulum(result.history, PICTURES / f"{name}.png", title=title)
        smaller(PICTURES / f"{name}.png")
    model = SolidRmp(MASS)
    square = HALF * np.array(((-1, -1), (1, -1), (1, 1), (-1, 1)))
    bounds = Bounds(polygon=square, friction=0.8, wheel_torque=TORQUE, wheel_angle=ANGLE)
    cold = make_backend("proxqp_cold")  # no run depends on the run before it
    law = MomentumQp(model, bounds, (0.0, 0.0, HEIGHT), RADII, dt=1e-3, backend=cold)
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
    save(pushes_figure(theory.directions, impulses), PICTURES / "rmp_pushes.png")
    leans = np.radians(np.linspace(-16.0, 16.0, 33))
    rest = np.array((0.0, 0.0, np.pi / 2, 0.0, HEIGHT, 0.0, 0.0, 0.0, 1.0, *RADII))
    stabiliser = PointStabiliser(model, Bounds(wheel_torque=TORQUE), HEIGHT, RADII)
    region = region_of_attraction(stabiliser, rest, lean_grid(rest, leans, leans))
    times = {
        "Leaning, and back to rest by PointStabiliser": region.settling.reshape(
            len(leans), len(leans)
        )
    }
    save(regions_figure(leans, leans, times), PICTURES / "rmp_region.png")


def main() -> None:
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name in (
        "astronaut_expand",
        "shape_standing_g1",
        "safe_reach_g1",
        "global_tall_hoap2",
        "global_small_g1",
    ):
        result = load_problem(ROOT / "problems" / f"{name}.yaml").run()
        title = f"{name}: {result.status.value}"
        view = VIEWS.get(name, View())
        plot_run(result.robot, result.history, PICTURES / f"{name}.png", title=title, view=view)
        smaller(PICTURES / f"{name}.png")
    for name, members in (("fig6_g1", FIG6), ("fig7_hoap2", FIG7)):
        problems = {k: load_problem(ROOT / "problems" / f"{p}.yaml") for k, p in members.items()}
        robot = next(iter(problems.values())).parts.robot
        runs = {k: read_history(robot, problem.run().history) for k, problem in problems.items()}
        poses = {"start": next(iter(runs.values())).pose(0)}
        poses |= {k: run.pose(-1) for k, run in runs.items()}
        plot_robot(robot, poses, PICTURES / f"{name}.png")
        smaller(PICTURES / f"{name}.png")
    analysis_picture()
    for name in ("push_g1", "track_squat_g1", "lean_beyond_g1", "drop_g1"):
        simulation_picture(name)
    measured_picture()
    turn_pictures()
    simulation_picture("walk_g1", width=1240)
    pendulum_pictures()


if __name__ == "__main__":
    main()
