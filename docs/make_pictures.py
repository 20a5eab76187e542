"""Make the pictures of the README from the problems that ship: python docs/make_pictures.py"""

from pathlib import Path

from wbc.problem import load_problem
from wbc.view import plot_robot, plot_run

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


def main() -> None:
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name in ("astronaut_expand", "shape_standing_g1"):
        result = load_problem(ROOT / "problems" / f"{name}.yaml").run()
        title = f"{name}: {result.status.value}"
        plot_run(result.robot, result.history, PICTURES / f"{name}.png", title=title)
    for name, members in (("fig6_g1", FIG6), ("fig7_hoap2", FIG7)):
        problems = {k: load_problem(ROOT / "problems" / f"{p}.yaml") for k, p in members.items()}
        results = {k: problem.run() for k, problem in problems.items()}
        first = next(iter(problems.values())).parts
        poses = {"start": first.start} | {k: result.q for k, result in results.items()}
        plot_robot(first.robot, poses, PICTURES / f"{name}.png")


if __name__ == "__main__":
    main()
