"""Ticks in files: asked for again they give the same bits, and a file runs nobody else's code."""

import copy
import json
import os
import pickle
import zlib
from pathlib import Path

import numpy as np
import pytest

import wbc
from wbc.controllers.saved_tick import SavedTick
from wbc.controllers.tick import TICK_FILE
from wbc.errors import ControllerFailure, InvalidInputError
from wbc.qp import installed_solvers
from wbc.robot import Robot
from wbc.safe_pickle import read_pickled, write_pickled


def wild(robot: Robot, level: str, rng: np.random.Generator, **options: object) -> wbc.Controller:
    """A controller whose tasks ask for much."""
    start = robot.snapshot(robot.posture("standing"))
    tasks: list[wbc.Task] = [
        wbc.ComTask(robot, start.com + rng.normal(size=3), weight=10.0),
        wbc.PostureTask(robot, start.q, weight=0.1),
    ]
    kind = wbc.TorqueController if level == "torque" else wbc.KinematicController
    return kind(
        robot,
        tasks,
        contacts=wbc.support(start, "double"),
        limits=wbc.Limits(robot),
        constraints=[wbc.SelfCollision(robot)],
        **options,
    )


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("name", "level", "ticks"),
    [
        ("hoap2_like", "torque", 8),
        pytest.param("hoap2_like", "velocity", 40, marks=SLOW),
        pytest.param("g1", "torque", 16, marks=SLOW),
        pytest.param("g1", "velocity", 16, marks=SLOW),
    ],
)
def test_failed_and_relaxed_ticks_are_answered_to_the_last_bit(
    robot_named, rng, tmp_path: Path, name: str, level: str, ticks: int
) -> None:
    """After wild states, so that everything that a controller keeps has been used."""
    robot = robot_named(name)
    controller = wild(robot, level, rng)
    q, given_up, path = robot.posture("standing"), 0, tmp_path / "tick.wbc"
    for k in range(ticks):
        rough = 1.0 if k % 4 == 3 else 0.02
        tick = controller.step(robot.snapshot(q, rough * 5.0 * rng.normal(size=robot.nv)))
        away = np.concatenate((np.zeros(6), rng.normal(size=robot.nv - 6)))
        q = robot.integrate(robot.posture("standing"), rough * 0.3 * away, 1.0)
        if tick.policy is None:
            continue
        given_up += 1
        tick.save(path)
        again = SavedTick.load(path).replay()
        assert again.same, again.differences
        assert again.tick.velocity.tobytes() == tick.velocity.tobytes()
        assert again.tick.report() == tick.report()
    assert given_up >= 2


@pytest.mark.parametrize("solver", installed_solvers())
def test_ticks_of_every_solver_are_read_again(hoap2, rng, tmp_path: Path, solver: str) -> None:
    controller, path = wild(hoap2, "velocity", rng, solver=solver), tmp_path / "tick.wbc"
    controller.step(hoap2.snapshot(hoap2.posture("standing"))).save(path)
    assert SavedTick.load(path).replay().same


def test_warm_start_of_a_level_above_is_told(hoap2, rng, tmp_path: Path) -> None:
    """The saved answer is changed: whether bits differ is up to ProxQP."""
    controller, path = wild(hoap2, "velocity", rng), tmp_path / "tick.wbc"
    below = wbc.OrientationTask(hoap2, "base", np.eye(3), priority=1)
    for tasks in (controller.tasks, [*controller.tasks, below]):
        controller.change(tasks=tasks)
        controller.step(hoap2.snapshot(hoap2.posture("standing"))).save(path)
        saved = SavedTick.load(path)
        saved.answer["velocity"] = 0.9 * saved.answer["velocity"]
        saved.answer["solver"] = "cholesky"
        told = saved.replay().differences
        assert any("warm start" in one for one in told) == (below in tasks), told


def test_a_contradiction_is_answered_again_with_its_names(hoap2, tmp_path: Path) -> None:
    start = hoap2.snapshot(hoap2.posture("standing"))
    here = start.position("left_sole")
    contacts = [
        wbc.PositionTask(hoap2, "left_sole", here + (0, 0, 0.1), name="up", gain=0.5),
        wbc.PositionTask(hoap2, "left_sole", here - (0, 0, 0.1), name="down", gain=0.5),
    ]
    tasks = [wbc.ComTask(hoap2, start.com)]
    controller = wbc.KinematicController(hoap2, tasks, contacts=contacts, on_failure="raise")
    with pytest.raises(ControllerFailure) as caught:
        controller.step(start)
    path = tmp_path / "tick.wbc"
    caught.value.tick.save(path)
    again = SavedTick.load(path).replay()
    assert again.same
    assert "up" in again.tick.report() and "down" in again.tick.report()


def test_ramps_and_last_forces_are_those_before_the_tick(hoap2, rng, tmp_path: Path) -> None:
    """A foot that is let go is dropped in the very tick that is saved, or is on its way."""
    start = hoap2.snapshot(hoap2.posture("standing"))
    controller = wild(hoap2, "torque", rng, force_ramp=0.01, dt=0.002)
    assert isinstance(controller, wbc.TorqueController)
    controller.step(start)
    path = tmp_path / "tick.wbc"
    for k in range(16):
        if k % 8 == 0:
            controller.set_contacts(wbc.support(start, "double" if k else "left"))
        tick = controller.step(start)
        tick.save(path)
        saved = SavedTick.load(path)
        again = saved.replay()
        assert again.tick.ramps == tick.ramps
        assert tuple(c.name for c in saved.controller.contacts) == tuple(
            c.name for c in controller.contacts
        )
        np.testing.assert_allclose(again.tick.torque, tick.torque, atol=1e-6)  # of warm starts
    assert not tick.ramps


@pytest.mark.slow
def test_a_copied_controller_gives_the_same_bits_where_the_core_solves(g1, rng) -> None:
    controller = wild(g1, "torque", rng, solver="active_set")
    q, v = g1.posture("standing"), np.zeros(g1.nv)
    others = []
    for k in range(30):
        if k == 10:
            others = [copy.deepcopy(controller), pickle.loads(pickle.dumps(controller))]
        tick = controller.step(g1.snapshot(q, v))
        for other in others:
            same = other.step(other.robot.snapshot(q, v))
            assert same.torque.tobytes() == tick.torque.tobytes()
            assert same.velocity.tobytes() == tick.velocity.tobytes()
        v = tick.velocity
        q = g1.integrate(q, v, controller.dt)


def test_what_answered_differently_is_said_by_its_version(hoap2, rng, tmp_path: Path) -> None:
    wild(hoap2, "velocity", rng).step(hoap2.snapshot(hoap2.posture("standing"))).save(
        tmp_path / "t"
    )
    saved = SavedTick.load(tmp_path / "t")
    other = saved._replace(answer={**saved.answer, "policy": "stop"}, versions={"scipy": "1"})
    assert other.replay().differences[-1] == "it was answered by scipy 1, here None"


def test_what_would_be_another_tick_is_not_saved(hoap2, rng, tmp_path: Path) -> None:
    start = hoap2.snapshot(hoap2.posture("standing"))
    controller, path = wild(hoap2, "velocity", rng), tmp_path / "t"
    first = controller.step(start)
    with pytest.raises(InvalidInputError, match="a copied tick has no controller"):
        copy.copy(first).save(path)
    com = controller.tasks[0]
    assert isinstance(com, wbc.ComTask)
    com.set_target(start.com)
    with pytest.raises(InvalidInputError, match="'com' was changed since"):
        first.save(path)
    controller.step(start).save(path)
    with pytest.raises(InvalidInputError, match="1 ticks were taken since"):
        first.save(path)


class Mine(wbc.PostureTask):
    """A task of a user."""


def test_own_code_is_run_only_where_its_file_is_given(hoap2, tmp_path: Path) -> None:
    code, path = tmp_path / "mine.py", tmp_path / "tick.wbc"
    code.write_text("import wbc\nclass Mine(wbc.PostureTask):\n    pass\n")
    Mine.__module__ = "__main__"
    try:
        import __main__

        __main__.Mine = Mine  # type: ignore[attr-defined]
        q = hoap2.posture("standing")
        controller = wbc.KinematicController(hoap2, [Mine(hoap2, q)], contacts=[])
        controller.step(hoap2.snapshot(q)).save(path)
    finally:
        del __main__.Mine  # type: ignore[attr-defined]
        Mine.__module__ = __name__
    with pytest.raises(InvalidInputError, match=r"names __main__\.Mine.*--code FILE\.py"):
        SavedTick.load(path)
    assert SavedTick.load(path, code).replay().same
    for bad, said in (("raise ValueError('no')", "cannot be run"), ("x = 1", "Mine is not in")):
        code.write_text(bad)
        with pytest.raises(InvalidInputError, match=said):
            SavedTick.load(path, code)


class Evil:
    def __reduce__(self) -> tuple[object, ...]:
        return os.system, ("touch /tmp/wbc_was_here",)


class Sly:
    """Asks getattr for what lies behind a class of the package."""

    def __reduce__(self) -> tuple[object, ...]:
        return getattr, (Robot, "load")


def test_paths_that_another_python_wrote_are_read(tmp_path: Path) -> None:
    """Python 3.13 says that they are of ``pathlib._local``."""
    write_pickled(tmp_path / "x.wbc", "a path", {"file": Path("a") / "b"})
    head, _, packed = (tmp_path / "x.wbc").read_bytes().partition(b"\n")
    data, old, new = zlib.decompress(packed), b"\x8c\x07pathlib", b"\x8c\x0epathlib._local"
    elsewhere = data if new in data else data.replace(old, new)
    assert new in elsewhere
    at = elsewhere.index(b"\x95") + 1  # how long the frame is
    length = int.from_bytes(elsewhere[at : at + 8], "little") + len(elsewhere) - len(data)
    elsewhere = elsewhere[:at] + length.to_bytes(8, "little") + elsewhere[at + 8 :]
    (tmp_path / "x.wbc").write_bytes(head + b"\n" + zlib.compress(elsewhere))
    found, _ = read_pickled(tmp_path / "x.wbc", "a path")
    assert found == {"file": Path("a/b")}


@pytest.mark.parametrize("thing", [Evil(), Sly(), os.path.join, wbc.files.write_text])
def test_a_file_of_a_stranger_runs_nothing(tmp_path: Path, thing: object) -> None:
    path = tmp_path / "tick.wbc"
    head = json.dumps({"format": TICK_FILE, "versions": {"wbc": "0"}}).encode()
    path.write_bytes(head + b"\n" + zlib.compress(pickle.dumps(thing)))
    with pytest.raises(InvalidInputError, match=r"not wbc's|never writes"):
        SavedTick.load(path)
    assert not Path("/tmp/wbc_was_here").exists()


def test_damaged_files_are_refused_by_name(hoap2, rng, tmp_path: Path) -> None:
    path = tmp_path / "tick.wbc"
    wild(hoap2, "velocity", rng).step(hoap2.snapshot(hoap2.posture("standing"))).save(path)
    whole = path.read_bytes()
    for k in range(60):
        data = bytearray(whole)
        if k % 2:
            data[rng.integers(whole.index(b"\n") + 1, len(data))] ^= 1 << int(rng.integers(8))
        else:
            del data[rng.integers(len(data)) :]
        path.write_bytes(data)
        if _content(data) == _content(whole):
            continue  # a run of zeros that is copied from elsewhere is the same run
        with pytest.raises(InvalidInputError, match=r"tick\.wbc: "):
            SavedTick.load(path)


def _content(data: bytes | bytearray) -> bytes | None:
    try:
        return zlib.decompress(data.partition(b"\n")[2])
    except zlib.error:
        return None


def test_what_is_no_path_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="file to write: expected a path, got None"):
        write_pickled(None, "wbc tick 1", 0)  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="file to read: expected a path, got 3"):
        SavedTick.load(3)  # type: ignore[arg-type]


def test_other_files_are_told_from_ticks(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    path.write_text('{"format": "wbc result 1", "versions": {}}\n')
    with pytest.raises(InvalidInputError, match=r"expected a 'wbc tick 1', it is a 'wbc result 1'"):
        SavedTick.load(path)
    path.write_text("no")
    with pytest.raises(InvalidInputError, match="it is no file that this package wrote so"):
        SavedTick.load(path)


def test_what_is_of_torque_ticks_is_said(hoap2) -> None:
    q = hoap2.posture("standing")
    controller = wbc.KinematicController(hoap2, [wbc.PostureTask(hoap2, q)], contacts=[])
    with pytest.raises(AttributeError, match="of a TorqueController's ticks"):
        _ = controller.step(hoap2.snapshot(q)).torque  # type: ignore[attr-defined]
    with pytest.raises(InvalidInputError, match="position and quaternion come before the joints"):
        hoap2.snapshot(q[7:])
