"""Constraints of problem files under ``method: global``: the search knows them, the motion too."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.problem.loading import problem_of
from wbc.constraints import SelfCollision
from wbc.errors import ProblemFileError
from wbc.problem import Problem, RunStatus, load_problem
from wbc.problem.global_search import global_shaping

SHIPPED = Path(__file__).parents[2] / "problems" / "global_small_g1.yaml"
TEXT = """robot: hoap2_like
support: double
tasks:
  small: {type: inertia, frame: world, per_mass: true, target: {scale: 0.3}, weight: 10.0,
          gain: 0.3, second_order: true}
  calm: {type: posture, target: start, weight: 1.0e-3, gain: 0.3}
constraints:
  bodies: {type: self_collision, margin: 0.01}
  balance: {type: com_support, margin: 0.01}
  low: {type: box, frame: base, lower: [null, null, 0.25]}
  room:
    type: obstacles
    links: ["*hand*", "*forearm*"]
    things:
      wall: {half_space: [-1, 0, 0], position: [0.1, 0, 0]}
      ball: {sphere: 0.05, position: [0.0, 0.3, 0.3]}
controller:
  method: global
  starts: 3
  workers: 1
  dt: 0.02
  damping: 1.0e-4
stop: {duration: 4.0}
"""


def problem(folder: Path, overrides: dict[str, Any] | None = None, text: str = TEXT) -> Problem:
    return problem_of(folder, text, overrides)


def least_room(one: Problem, q: np.ndarray, margins: dict[str, float]) -> dict[str, float]:
    """Of each kind, by the library's distances, which tests of their own hold to coal's."""
    robot = one.parts.robot
    here = robot.snapshot(q)
    bodies = SelfCollision(robot, margin=margins["bodies"])
    reach = max(
        here.position(frame.name)[0] for frame in robot.model.frames if "hand" in frame.name
    )
    return {
        "bodies": float((bodies.model.nearest(here).distance - bodies.margins).min()),
        "low": float(here.position("base")[2]) - margins["low"],
        "wall": 0.1 - 0.02 - reach,
    }


@pytest.mark.slow
def test_the_search_and_the_motion_keep_what_the_file_says(tmp_path: Path) -> None:
    one = problem(tmp_path)
    told = one.run()
    assert told.shaping is not None and told.shaping.arrived, told.reason
    assert told.shaping.cost_end < 0.5 * told.shaping.cost_start
    margins = {"bodies": 0.01, "low": 0.25}
    for q in (*(posture.q for posture in told.shaping.postures), *told.history.q[::20]):
        assert min(least_room(one, q, margins).values()) >= -1e-6
    end = least_room(one, told.q, margins)
    assert end["bodies"] < 1.5e-4  # it leans on a margin, which the search has known
    loose = problem(tmp_path, {"constraints.low.slack": 1.0})
    shaping = global_shaping(loose.parts, loose.spec, loose.spec.controller)
    lower = shaping.solve(loose.parts.start, 3, workers=1).best
    assert lower.q[2] < 0.25 - 0.01  # the box was in the way
    assert lower.cost < told.shaping.best.cost


def test_what_may_give_way_is_left_to_the_motion(tmp_path: Path) -> None:
    one = problem(tmp_path, {"constraints.low.slack": 10.0})
    shaping = global_shaping(one.parts, one.spec, one.spec.controller)
    assert [constraint.name for constraint in shaping.problem.constraints] == [
        "bodies", "balance", "room",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("sphere: 0.05,", "sphere: 0.05, velocity: [0.1, 0, 0],",
         "p.yaml:16: constraints.room.things.ball.velocity: method global looks for a posture to"
         " rest in, and where this will be then is not known"),
        ("balance: {type: com_support, margin: 0.01}", "balance: {type: com_support, margin: 0.5}",
         "0.5 m leaves nothing of the polygon"),
        ("margin: 0.01}\n  low", "margn: 0.01}\n  low", "constraints.balance.margn: unknown key"),
    ],
)  # fmt: skip
def test_mistakes_are_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert TEXT.count(old) == 1
    with pytest.raises(ProblemFileError) as error:
        problem(tmp_path, text=TEXT.replace(old, new))
    assert words in str(error.value)


@pytest.mark.slow
def test_the_shipped_problem_folds_its_arms_without_touching(tmp_path: Path) -> None:
    """Four starts are enough; without the margins the best posture has its arms in its chest."""
    quick = {"controller.starts": 4, "controller.workers": 1}
    one = load_problem(SHIPPED, quick)
    told = one.run()
    assert told.status is RunStatus.CONVERGED, told.reason
    robot = one.parts.robot
    bodies = SelfCollision(robot, margin=0.01)
    left = bodies.model.nearest(robot.snapshot(told.q)).distance - bodies.margins
    assert left.min() >= -1e-6
    start, end = (robot.snapshot(q).inertia for q in (one.parts.start, told.q))
    assert np.trace(end) < 0.5 * np.trace(start)
    blind = load_problem(SHIPPED, {**quick, "constraints.bodies.slack": 1.0})
    shaping = global_shaping(blind.parts, blind.spec, blind.spec.controller)
    free = shaping.solve(blind.parts.start, 4, workers=1).best
    assert bodies.model.nearest(robot.snapshot(free.q), 1).distance.min() < -0.05
