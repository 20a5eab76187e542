"""A few seconds of benchmarks/soak.py, and whether the soak sees what it should and can go on.

``WBC_FUZZ=N`` runs N ticks. CPU time is no test here: machines that run tests are busy.
"""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.soak import Episode, Record, corrupted, is_valid, soak, tick_violations
from wbc.controllers import KinematicController
from wbc.qp.solution import Status
from wbc.tasks import ComTask

TICKS = int(os.environ.get("WBC_FUZZ", "120"))
pytest.importorskip("clarabel")
pytest.importorskip("piqp")
pytest.importorskip("osqp")


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two robots and short episodes: others take seconds to load."""
    if "WBC_FUZZ" not in os.environ:
        monkeypatch.setattr("benchmarks.soak.ROBOTS", ("hoap2_like", "g1"))
        monkeypatch.setattr("benchmarks.soak.LENGTH", 15)


def broken(record: Record) -> list[str]:
    return [example["text"] for example in record.examples if "slow" not in example["kind"]]


@pytest.mark.slow
def test_no_rule_is_broken() -> None:
    record = Record(seed=3)
    soak(record, TICKS)
    assert record.ticks == TICKS
    assert not broken(record)
    assert sum(record.faults.values()) > 0.02 * TICKS


@pytest.mark.slow
def test_a_run_goes_on_where_it_was_killed(tmp_path: Path) -> None:
    whole, path = Record(seed=5), tmp_path / "soak.json"
    for number in range(2):
        Episode(whole, 5, number).run(15)
    first = Record(seed=5)
    Episode(first, 5, 0).run(15)
    first.write(path)
    again = Record.read(path, 5)
    Episode(again, 5, again.episodes).run(15)
    assert (again.ticks, again.statuses, again.faults) == (
        whole.ticks, whole.statuses, whole.faults
    )  # fmt: skip
    assert json.loads(path.read_text())["episodes"] == 1


@pytest.mark.slow
def test_an_episode_is_determined_by_its_number_whatever_ran_before() -> None:
    numbers = (k for k in range(100) if Episode(Record(seed=5), 5, k).ball is not None)
    number, places = next(numbers), []
    for _ in range(2):
        episode = Episode(Record(seed=5), 5, number)
        episode.run(15)
        places.append(episode.q)
        episode.ball.move(np.eye(3), episode.robot.snapshot(episode.q).com)
    np.testing.assert_array_equal(*places)


def test_it_sees_commands_outside_limits_and_not_finite(hoap2) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"))
    tick = KinematicController(hoap2, [ComTask(hoap2, here.com)]).step(here)
    box = np.full(hoap2.nv, -1.0), np.full(hoap2.nv, 1.0)
    assert tick_violations(tick, box) == []
    for value, kind in ((1.0 + 2e-6, "outside limits"), (np.nan, "not finite")):
        v = np.zeros(hoap2.nv)
        v[3] = value
        assert [found for found, _ in tick_violations(replace(tick, velocity=v), box)] == [kind]
    wrong = replace(tick, status=Status.INFEASIBLE)
    assert [found for found, _ in tick_violations(wrong, box)] == ["feasible after all"]


def test_growth_is_seen_and_noise_is_not() -> None:
    ticks = np.arange(0.0, 100_000.0, 250.0)
    noise = np.random.default_rng(0).normal(size=ticks.size)
    for slope, fails in ((0.0, False), (5.0, False), (60.0, True)):
        record = Record(seed=1)
        memory = 250.0 + slope * 1e-6 * ticks + 0.2 * noise + 40.0 * np.exp(-ticks / 500.0)
        memory += 9.0 * (ticks > 50_000.0)  # something was loaded late
        record.memory.append(np.column_stack((ticks, memory)).tolist())
        growth = record.growth()
        assert growth is not None
        assert growth[0] == pytest.approx(slope, abs=12.0)
        assert record.failed() is fails


def test_faults_that_must_be_refused_are_told_from_large_numbers() -> None:
    rng = np.random.default_rng(0)
    assert is_valid(np.array([1e12, 1.0]))
    assert is_valid(np.array(1e12))
    for value in (np.array([np.nan]), np.ones(2) + 0j, [1j], "x", 10**400, None, object()):
        assert not is_valid(value)
    kinds = {type(corrupted(np.ones(3), rng)).__name__ for _ in range(200)}
    assert {"ndarray", "list", "str", "int", "dict", "object"} <= kinds
