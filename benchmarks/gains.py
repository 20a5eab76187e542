"""Different gains within a level act as weights: where competing tasks come to rest.

    python benchmarks/gains.py docs/howto/tuning.md     puts the table into its place on a page

A G1 lowers its CoM and reaches forwards by more than its joints allow, over its soles.
"""

import argparse
from pathlib import Path

import numpy as np
from qpbench.page import put_section

import wbc
from wbc.controllers.closed_loop import closed_loop

# Gain of CoM and hand, of trunk and posture; whether weights are those of errors.
CASES = ((0.02, 0.5, False), (0.02, 0.02, False), (0.5, 0.5, False), (0.02, 0.5, True))
TICKS, DT = 1500, 0.005


def at_rest(
    robot: wbc.Robot, reaching: float, others: float, weighs_error: bool
) -> tuple[float, float, float]:
    """Return the remaining errors of CoM [m], hand [m] and trunk [rad]."""
    q = robot.posture("standing")
    start, how = robot.snapshot(q), {"weighs_error": weighs_error}
    tasks = [
        wbc.ComTask(robot, start.com - [0.0, 0.0, 0.15], weight=10.0, gain=reaching,
                    **how),
        wbc.PositionTask(robot, "right_rubber_hand", (0.35, -0.15, 0.25), name="hand",
                         weight=3.0, gain=reaching, **how),
        wbc.OrientationTask(robot, "torso_link", start.rotation("torso_link"), name="trunk",
                            weight=0.3, gain=others, **how),
        wbc.PostureTask(robot, q, weight=0.01, gain=others, **how),
    ]  # fmt: skip
    controller = wbc.KinematicController(
        robot, tasks, contacts=wbc.support(start, "double"), limits=wbc.Limits(robot),
        constraints=[wbc.ComSupport.over(start, margin=0.01)], dt=DT,
    )  # fmt: skip
    *_, last = closed_loop(controller, q, TICKS)
    errors = last.tick.errors
    com, hand, trunk = (float(np.linalg.norm(errors[k])) for k in ("com", "hand", "trunk"))
    return com, hand, trunk


def main() -> None:
    """Print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("page", type=Path, help="Markdown file with the mark of the section.")
    page = parser.parse_args().page
    robot = wbc.Robot.load("g1")
    lines = [
        "| gain of CoM and hand | of trunk and posture | weighs_error"
        " | CoM off by | hand | trunk |",
        "|---|---|---|---|---|---|",
    ]
    for case in CASES:
        com, hand, trunk = at_rest(robot, *case)
        lines.append(
            f"| {case[0]:g} | {case[1]:g} | {'yes' if case[2] else 'no'} | {1e3 * com:.0f} mm"
            f" | {1e3 * hand:.0f} mm | {trunk:.2f} rad |"
        )
    print(*lines, sep="\n")
    put_section(page, "gains", "\n".join(lines))


if __name__ == "__main__":
    main()
