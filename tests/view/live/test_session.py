"""A session: a problem that runs, is steered and begun again, whoever looks at it."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.problem.loading import problem_of
from tests.view.live.conftest import client_of, drag
from wbc.errors import InvalidInputError
from wbc.problem import load_problem
from wbc.problem.controller_spec import GlobalSpec
from wbc.problem.problem import Problem
from wbc.robot import Snapshot
from wbc.run.simulate import simulate
from wbc.run.stopping import Stop
from wbc.view.live.clock import Clock
from wbc.view.live.messages import Play, Restart, SetTarget
from wbc.view.live.session import Session, checked
from wbc.view.live.viewer import Viewer

PROBLEMS = Path(__file__).parents[3] / "problems"
FREE = """
robot: hoap2_like
start: {posture: standing}
support: double
tasks:
  com: {type: com, target: {offset: [0, 0.01, 0]}, ramp: 0.5, weight: 10.0}
  posture: {type: posture, target: start, weight: 0.01}
"""


@pytest.fixture
def problem(tmp_path: Path) -> Problem:
    return checked(problem_of(tmp_path, FREE))


@pytest.fixture
def viewer(problem: Problem) -> Iterator[Viewer]:
    with Viewer(problem.parts.robot, quiet=True, clock=True) as made:
        yield made


Seen = list[Snapshot]


@pytest.fixture
def seen(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> Seen:
    """Return what the viewer is given, tick by tick."""
    found, update = Seen(), viewer.update

    def remember(snapshot, *rest, **more):  # type: ignore[no-untyped-def]
        found.append(snapshot)
        update(snapshot, *rest, **more)

    monkeypatch.setattr(viewer, "update", remember)
    return found


def test_without_a_user_it_is_the_run_itself(problem: Problem, viewer: Viewer, seen: Seen) -> None:
    """The same bits as in a run that nobody looks at."""
    Session(problem, viewer, Clock(0.0)).run(100)
    stop = Stop(duration=0.5, speed=None)
    result = simulate(problem.executor(), problem.parts.start, stop)
    np.testing.assert_array_equal([one.q for one in seen], result.history.q)


@pytest.mark.slow
def test_a_dragged_target_is_followed_and_given_back(problem, viewer, seen) -> None:
    """Over the ramp of the file, which moves the same target in every tick."""
    session = Session(problem, viewer, Clock(0.0))
    session.run(1)
    wanted = seen[0].com + [0.0, -0.015, 0.0]
    with client_of(viewer.url) as client:
        for _ in range(100):  # until the page has drawn the handle
            drag(client, "com", wanted)
            viewer.wait_for_user(0.2)
            if viewer.has_wishes:
                break
        session.run(400)
    np.testing.assert_allclose(seen[-1].com, wanted, atol=1e-3)
    assert not viewer.error


@pytest.mark.slow
def test_pages_come_and_go(problem: Problem, viewer: Viewer, seen: Seen) -> None:
    session = Session(problem, viewer, Clock(0.0))
    for _ in range(2):
        with client_of(viewer.url) as one, client_of(viewer.url) as other:
            session.run(30)
            one.close()
            session.run(30)
            assert other.recv(timeout=20.0)
        session.run(30)
    assert session.ticks == 180
    assert not viewer.error


@pytest.mark.slow
def test_pause_and_restart(problem: Problem, viewer: Viewer, seen: Seen) -> None:
    session = Session(problem, viewer, Clock(0.0))
    viewer._requests.append(Restart())  # comes after the first tick
    session.run(5)
    again = simulate(problem.executor(), problem.parts.start, Stop(duration=0.02, speed=None))
    np.testing.assert_array_equal([one.q for one in seen[1:]], again.history.q)
    viewer._requests.append(Play(False))
    viewer._requests.append(Play(True))
    session.run(5)
    assert session.ticks == 10


@pytest.mark.slow
def test_it_ends_with_the_page(problem: Problem, viewer: Viewer) -> None:
    session = Session(problem, viewer, Clock(0.0))
    session.run(1)
    viewer._page._process.kill()
    session.run()  # without end, but for that
    assert "ended" in viewer.error


@pytest.mark.slow
def test_a_refused_target_is_said(problem: Problem, viewer: Viewer) -> None:
    session = Session(problem, viewer, Clock(0.0))
    viewer._wishes.append(SetTarget("com", (np.full(3, np.nan),)))
    session.run(2)
    assert "task 'com', target" in viewer.steering.refusal


def test_problems_without_a_controller_to_steer(problem: Problem) -> None:
    with pytest.raises(InvalidInputError, match="wbc run --plot"):
        checked(load_problem(PROBLEMS / "rmp_swing_up.yaml"))
    searching = problem.spec.model_copy(update={"controller": GlobalSpec.model_construct()})
    with pytest.raises(InvalidInputError, match="wbc run --view"):
        checked(replace(problem, spec=searching))
