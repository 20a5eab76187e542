"""Without MuJoCo the room can be imported, and a plant says what to install."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from wbc.robot import Robot
from wbc.simulation import Plant, SimulationError
from wbc.simulation.engine import check_state

CODE = """
import sys
sys.modules["mujoco"] = None
import wbc.simulation
robot = wbc.Robot.load("hoap2_like")
try:
    wbc.simulation.Plant(robot)
except wbc.WbcError as error:
    print(type(error).__name__, error)
"""


@pytest.mark.slow
def test_without_mujoco() -> None:
    command, here = [sys.executable, "-c", CODE], Path(__file__).parents[2]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=here)
    assert done.stdout.startswith("MissingPackageError simulation needs mujoco")
    assert "pip install 'wbc[sim]'" in done.stdout


@pytest.mark.parametrize(
    ("kind", "words", "joint"),
    [
        ("mjWARN_BADQPOS", "position of 'knee'", "knee"),
        ("mjWARN_BADQACC", "acceleration of 'base'", "base"),
        ("mjWARN_CONTACTFULL", "too many contacts", None),
        ("mjWARN_INERTIA", "mjWARN_INERTIA", None),
    ],
)
def test_warnings_are_errors(kind: str, words: str, joint: str | None) -> None:
    index = int(getattr(mujoco.mjtWarning, kind))
    numbers, infos = np.zeros(8, dtype=int), np.zeros(8, dtype=int)
    numbers[index], infos[index] = 2, 1
    warning = SimpleNamespace(number=numbers, lastinfo=infos)
    data = SimpleNamespace(time=0.25, qpos=np.zeros(2), qvel=np.zeros(2), warning=warning)
    with pytest.raises(SimulationError, match=words) as caught:
        check_state(mujoco, data, ("base", "knee"), ("base", "base"))
    assert (caught.value.time, caught.value.joint) == (0.25, joint)
    numbers[:] = 0
    check_state(mujoco, data, (), ())


def test_a_blow_up_leaves_no_log_file_and_prints_nothing(tmp_path, monkeypatch, capfd) -> None:
    monkeypatch.chdir(tmp_path)
    before = mujoco.get_mju_user_warning()
    plant = Plant(Robot.load("hoap2_like"), saturate=False)
    with pytest.raises(SimulationError):
        for _ in range(9):
            plant.step(np.full(plant.robot.nv - 6, 1e13))
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")
    assert mujoco.get_mju_user_warning() == before
