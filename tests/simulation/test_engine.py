"""Without MuJoCo the room can be imported, and a plant says what to install."""

import subprocess
import sys
from pathlib import Path

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


def test_without_mujoco() -> None:
    done = subprocess.run(
        [sys.executable, "-c", CODE],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    assert done.stdout.startswith("SimulationError simulation needs MuJoCo")
    assert "pip install 'wbc[sim]'" in done.stdout


def test_importing_the_room_does_not_load_mujoco() -> None:
    code = "import sys, wbc.simulation; sys.exit('mujoco' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[2])
