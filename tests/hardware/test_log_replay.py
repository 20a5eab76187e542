"""A log of the loop is run again to the same bits, and opens as a run does."""

from collections import Counter, deque
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from tests.command import wbc_command
from wbc.errors import InvalidInputError
from wbc.hardware.bus import Command, Reading
from wbc.hardware.log_file import HardwareLog, replay_log
from wbc.hardware.operator import Script
from wbc.hardware.real_time import Beat
from wbc.hardware.robot_side import RobotSettings
from wbc.hardware.setup import loop_of, simulated_robot
from wbc.hardware.unitree.profiles import profile_named
from wbc.problem import load_problem

UP, RUN = 4.6, 0.6  # s until it is up, and of running
DT = 0.002
PROBLEM = Path(__file__).parents[2] / "problems" / "walk_g1.yaml"


class Wire:
    """Both ends of a bus, in one process."""

    def __init__(self) -> None:
        self.dropped = Counter[str]()
        self._readings, self._commands = deque[Reading](maxlen=1), deque[Command](maxlen=1)

    def read(self) -> Reading | None:
        return self._readings.pop() if self._readings else None

    def receive(self) -> Command | None:
        return self._commands.pop() if self._commands else None

    def send(self, reading: Reading) -> None:
        self._readings.append(reading)

    def write(self, command: Command) -> None:
        self._commands.append(command)

    def close(self) -> None: ...


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A G1 stands up and begins to walk, on estimated state, in simulated time."""
    problem, profile = load_problem(PROBLEM), profile_named("unitree_g1")
    wire, path = Wire(), tmp_path_factory.mktemp("log") / "hardware.npz"
    side = simulated_robot(problem.parts.robot, profile, wire, RobotSettings())
    loop = loop_of(problem, profile, lambda: wire, Script(10.0), log=path, keep=20.0,
                   forked=False, priority=0)  # fmt: skip
    for k in range(round((UP + RUN) / DT)):
        side.step(k * DT)
        side.step(k * DT)
        loop.cycle(Beat(k * DT, 0.0, 0))
    loop._shut_down()
    return path


def changed(path: Path, to: Path, change: dict[str, object]) -> Path:
    with np.load(path) as file:
        content = {name: file[name] for name in file.files}
    for name, edit in change.items():
        if edit is None:
            del content[name]
        else:
            content[name] = edit(content[name]) if callable(edit) else edit
    np.savez(to, **content)
    return to


@pytest.mark.slow
def test_a_log_is_run_again_to_the_same_bits_and_a_changed_one_is_not(log: Path, tmp_path) -> None:
    again = replay_log(log)
    assert again.same and again.compared > 0.9 * RUN / DT, str(again)
    assert wbc_command("replay", log).exit_code == 0

    def bumped(position: np.ndarray) -> np.ndarray:
        position[-100] = np.nextafter(position[-100], np.inf)
        return position

    other = changed(log, tmp_path / "other.npz", {"position": bumped})
    found = replay_log(other)
    assert not found.same and len(found.differences) <= 2 * 4 * 100
    assert wbc_command("replay", other).exit_code == 3


@pytest.mark.slow
def test_a_log_that_does_not_reach_back_says_how_more_is_kept(log: Path, tmp_path: Path) -> None:
    with np.load(log) as file:
        late = {name: file[name][-200:] for name in file.files if file[name].ndim}
    with pytest.raises(InvalidInputError, match="--keep"):
        replay_log(changed(log, tmp_path / "late.npz", late))
    idle = changed(log, tmp_path / "idle.npz", {"asked": lambda asked: np.nan * asked})
    with pytest.raises(InvalidInputError, match="did not stand up"):
        replay_log(idle)


@pytest.mark.slow
def test_a_log_opens_as_a_run(log: Path, tmp_path: Path) -> None:
    run = HardwareLog.load(log).as_run()
    assert run.history.com[-1, 2] > 0.5
    assert set(run.history.phase) == {"standing up", "running"}
    for command, name in (("report", "log.html"), ("export", "log.mcap")):
        told = wbc_command(command, log, "-o", tmp_path / name)
        assert told.exit_code == 0, told.output
    page = (tmp_path / "log.html").read_text()
    assert "armed by hand" in page and "Normal force" not in page


@pytest.mark.slow
def test_events_have_the_times_of_the_rows(log: Path, tmp_path: Path) -> None:
    """They had the machine's clock, where plots and the slider begin with the log."""
    armed = {"time": lambda time: time + 1e3, "events": np.array(["1002.5 damping: armed by hand"])}
    run = HardwareLog.load(changed(log, tmp_path / "later.npz", armed)).as_run()
    assert run.summary["events"][0] == ("2.5000 s", "damping: armed by hand")
    broken = changed(log, tmp_path / "broken.npz", {"events": np.array(["armed by hand"])})
    with pytest.raises(InvalidInputError, match="'events': expected a time, got 'armed'"):
        HardwareLog.load(broken).as_run()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"made_of": np.array("{}")}, "does not say what ran"),
        ({"q": None}, "'q': expected shape"),
        ({"mode": lambda mode: mode + 100}, "damaged"),
        ({"events": None}, "not a log"),
        ({"time": lambda time: time[::-1]}, "'time': must increase"),
    ],
)
def test_a_damaged_log_is_refused(change, told, log, tmp_path) -> None:
    with pytest.raises(InvalidInputError, match=told):
        HardwareLog.load(changed(log, tmp_path / "damaged.npz", change))
