"""Problems pushed: outcomes depend on nothing but the push, and pendulums are not pushed."""

import math
import pickle
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import load as load_robot
from tests.texts import STAND
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.problem.pushed_problem import LoadPushed, PushedProblem, PushSettings
from wbc.simulation import capture_impulse

PUSHED = (
    STAND + "simulation: {duration: 1.0, pushes: [{impulse_ratio: 5.0, angle: 0.0, at: 0.0}]}\n"
)


def loader(folder: Path, text: str = PUSHED, **settings: object) -> LoadPushed:
    path = folder / "stand.yaml"
    path.write_text(text)
    return LoadPushed.of(path, {}, PushSettings(**settings))  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_small_push_is_survived_a_large_one_is_not_and_order_does_not_matter(tmp_path) -> None:
    load = loader(tmp_path)
    one = load()
    angle = 0.25 * math.pi
    small, large = one(angle, 0.5), one(angle, 3.0)
    assert small.survived and small.reason == "stood for 1.000 s"
    assert small.impulse == pytest.approx(
        0.5 * capture_impulse(one.start, one.feet, (1.0, 1.0)), rel=1e-12
    )
    assert 0.0 < small.tilt < 0.5 and 0.0 <= small.slip < 2e-3
    assert not large.survived and "fell" in large.reason and large.time < 1.0
    assert one(angle, 0.5) == small  # bit for bit, after a fall
    assert pickle.loads(pickle.dumps(load))()(angle, 0.5) == small
    assert one.own_pushes == 1  # and was left out: it is five times M omega d


def test_who_still_moves_in_the_end_has_not_survived(tmp_path: Path) -> None:
    moving = loader(tmp_path, rest=1e-5)()(0.0, 0.5)
    assert not moving.survived and "not at rest" in moving.reason


@pytest.mark.slow
@pytest.mark.parametrize(
    "acts",
    ["wrenches: [{frame: torso, force: [60, 0, 0], told: false}]", "start: {velocity: [2, 0, 0]}"],
)
def test_wrenches_and_the_start_of_the_file_are_there_when_it_is_pushed(tmp_path, acts) -> None:
    quiet = "simulation: {duration: 1.0}\n"
    assert loader(tmp_path, STAND + quiet)()(0.0, 0.0).survived
    acted_on = loader(tmp_path, STAND + quiet.replace("1.0", f"1.0, {acts}"))()
    assert "fell" in acted_on(0.0, 0.0).reason and "fell" in acted_on(0.0, 0.0).reason


def test_bounds_are_those_of_the_stance(tmp_path: Path) -> None:
    one = loader(tmp_path)()
    bounds = one.bounds(np.array((0.0, 1.0)))
    np.testing.assert_allclose(bounds.ankle, [one.unit(0.0), one.unit(1.0)], rtol=1e-9)


def test_what_cannot_be_pushed_says_why(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="level: torque"):
        loader(tmp_path, "robot: hoap2_like\nsupport: double\ntasks: {p: {type: posture}}\n")()
    with pytest.raises(InvalidInputError, match="no feet"):
        loader(tmp_path, STAND.replace("support: double", "support: floating"))()
    with pytest.raises(InvalidInputError, match="before the push is over"):
        loader(tmp_path, at=0.95)()
    with pytest.raises(UnknownNameError, match="chest"):
        loader(tmp_path, body="chest")()
    with pytest.raises(InvalidInputError, match="duration"):
        PushSettings(duration=0.0)
    with pytest.raises(InvalidInputError, match="name a file"):
        LoadPushed.of(Path("-"), {}, PushSettings())


def test_a_file_that_changes_meanwhile_is_noticed(tmp_path: Path) -> None:
    load = loader(tmp_path)
    assert isinstance(load(), PushedProblem)
    loader(tmp_path, PUSHED + "# mine\n")
    with pytest.raises(InvalidInputError, match="was changed meanwhile"):
        load()


def test_inputs_change_with_the_robots_file(tmp_path: Path) -> None:
    """The same command went on with pushes of the robot as it was before."""
    robot = tmp_path / "own.urdf"
    robot.write_text(Path(str(load_robot("hoap2_like").path)).read_text())
    text = PUSHED.replace("model: hoap2_like", "model: own.urdf")
    before = loader(tmp_path, text).inputs()
    robot.write_text(robot.read_text().replace('lower="-', 'lower="-0'))
    after = loader(tmp_path, text).inputs()
    assert after.pop("files") != before.pop("files") and after == before
