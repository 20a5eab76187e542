"""Campaigns in processes and on a cluster: the same rows, nothing lost, nothing twice."""

import json
import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from distributed import LocalCluster

from wbc.batch import BatchProgress, load_campaign, read_rows, run_batch, write_rows
from wbc.batch.row import ERROR, Row, run_row
from wbc.errors import InvalidInputError, WbcError
from wbc.journal import Journal
from wbc.problem.campaign import Campaign

TIMED = {"wall_seconds", "load_seconds", "worker", "tick_median", "tick_p99"}


def same(rows: list[Row]) -> list[Row]:
    """Return rows without what differs from run to run."""
    return [{name: one for name, one in row.items() if name not in TIMED} for row in rows]


def alone(campaign: Campaign) -> list[Row]:
    """Return the rows as this process computes them, one after the other."""
    return [run_row(run, campaign.texts[run.problem]) for run in campaign.runs]


@pytest.mark.parametrize("workers", [0, -1, 1.5, "two"])
def test_a_campaign_by_no_workers_is_refused(campaign: Path, workers: int) -> None:
    """It had no rows, and said nothing."""
    with pytest.raises(InvalidInputError, match="workers"):
        run_batch(load_campaign(campaign), workers=workers)


@pytest.mark.slow
def test_interrupted_and_killed_in_processes_it_ends_with_every_row_once(
    campaign: Path, tmp_path: Path
) -> None:
    loaded = load_campaign(campaign)
    told: list[BatchProgress] = []
    deaths: list[str] = []
    path = tmp_path / "journal"

    def progress(at: BatchProgress) -> None:
        told.append(at)
        if len(told) == 2:  # as for want of memory; the process is at its next run
            os.kill(int(at.row["worker"].rpartition(":")[2]), signal.SIGKILL)

    with Journal(path, loaded.inputs()) as journal:
        some = run_batch(
            loaded, workers=2, journal=journal, progress=progress, on_death=deaths.append,
            cancelled=lambda: len(told) >= 6,
        )  # fmt: skip
    assert 6 <= len(some) < 12
    assert len(deaths) == 1 and "SIGKILL" in deaths[0] and "tried again" in deaths[0]
    assert "amid run" in deaths[0] and "stand" in deaths[0]
    path.write_bytes(path.read_bytes()[:-30])  # a kill amid writing the last row
    before = len(told)
    with Journal(path, loaded.inputs()) as journal:
        assert len(journal.entries) == len(some) - 1
        rows = run_batch(loaded, workers=1, journal=journal, progress=told.append)
    assert len(told) - before == 12 - (len(some) - 1)
    assert told[-1].done == told[-1].total == 12
    assert same(rows) == same(alone(loaded))
    lines = [json.loads(line) for line in path.read_text().splitlines()[1:]]
    assert sorted(line["run"] for line in lines) == list(range(12))


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        yield cluster


@pytest.mark.slow
def test_on_a_cluster_of_which_a_worker_is_killed_it_ends_with_every_row_once(
    campaign: Path, tmp_path: Path, cluster: LocalCluster
) -> None:
    loaded = load_campaign(campaign)
    told: list[BatchProgress] = []
    deaths: list[str] = []

    def progress(at: BatchProgress) -> None:
        told.append(at)
        if len(told) == 3:
            os.kill(int(at.row["worker"].rpartition(":")[2]), signal.SIGKILL)

    with Journal(tmp_path / "journal", loaded.inputs()) as journal:
        rows = run_batch(
            loaded, cluster=cluster.scheduler_address, journal=journal, progress=progress,
            on_death=deaths.append,
        )  # fmt: skip
    assert deaths and all("worker tcp://" in text and "(gone)" in text for text in deaths)
    assert len(told) == 12 and {row["status"] for row in rows} == {"completed"}
    assert same(rows) == same(alone(loaded))
    assert len((tmp_path / "journal").read_text().splitlines()) == 13


@pytest.mark.parametrize("address", ["nonsense", "tcp://[::", "tcp://host:port", ""])
def test_an_address_that_is_none_is_refused_before_there_is_a_client(
    address: str, campaign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A client that failed of it ended 40 s later, with a traceback."""
    monkeypatch.setattr("distributed.Client", lambda *given, **named: pytest.fail("a client"))
    with pytest.raises(WbcError, match=f"--cluster {re.escape(address)}: no scheduler answers"):
        run_batch(load_campaign(campaign), cluster=address)


def test_no_scheduler(campaign: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wbc.batch.cluster.CONNECT", 0.2)
    with pytest.raises(WbcError, match="no scheduler answers"):
        run_batch(load_campaign(campaign), cluster="tcp://127.0.0.1:9")


@pytest.mark.slow
def test_a_worker_of_another_version_is_refused(campaign, cluster, monkeypatch) -> None:
    cluster.wait_for_workers(1)
    monkeypatch.setattr("wbc.batch.row.versions", lambda *_: {"wbc": "0.0.0"})  # here, not there
    with pytest.raises(WbcError, match=r"has wbc .*, here 0\.0\.0"):
        run_batch(load_campaign(campaign), cluster=cluster.scheduler_address)


def test_a_problem_that_was_changed_meanwhile_is_an_error_in_its_rows(campaign: Path) -> None:
    loaded = load_campaign(campaign)
    problem = campaign.parent / "stand.yaml"
    problem.write_text(problem.read_text() + "# and more\n")
    row = run_row(loaded.runs[3], loaded.texts["stand"])
    assert (row["run"], row["status"], row["solved"]) == (3, ERROR, False)
    assert "changed meanwhile" in row["reason"]


def test_a_row_of_a_simulation_and_of_a_pendulum(tmp_path: Path) -> None:
    root = Path(__file__).parents[2] / "problems"
    (tmp_path / "push.yaml").write_text(
        "robot: hoap2_like\nsupport: double\n"
        "tasks: {posture: {type: posture, weight: 1.0}, com: {type: com, target: start}}\n"
        "controller: {level: torque, solver: active_set}\nsimulation: {duration: 0.05}\n"
    )
    (tmp_path / "shape.yaml").write_text(
        "robot: hoap2_like\nsupport: double\nstop: {duration: 5}\n"
        "tasks: {shape: {type: inertia, target: {scale: 3}}, com: {type: com, target: start}}\n"
    )
    path = tmp_path / "campaign.yaml"
    path.write_text(f"problems: [push.yaml, {root / 'rmp_static_lean.yaml'}, shape.yaml]\n")
    pushed, leant, shaped = alone(load_campaign(path))
    assert "of what is wanted" in shaped["reach"] and pushed["reach"] is None
    assert pushed["status"] == "stood" and pushed["stood"] is True and pushed["solved"] is True
    assert 0.0 < pushed["error.com"] < 1e-2 and pushed["peak_tilt"] < 0.1
    assert pushed["time"] == pytest.approx(0.05) and pushed["ticks"] == 25
    assert leant["status"] == "completed" and "worst_leg" in leant


@pytest.mark.slow
def test_a_table_has_the_types_of_its_rows(tmp_path: Path) -> None:
    rows = [
        {"run": 0, "gain": 1, "mixed": 1, "list": [1.0, 2.0], "solved": True, "text": "a"},
        {"run": 1, "gain": 0.5, "mixed": "two", "list": [0.0], "solved": False, "late": 3},
    ]
    path = tmp_path / "t.parquet"
    write_rows(path, rows, {"campaign": "c"})
    back, made_of = read_rows(path)
    assert made_of == {"campaign": "c"}
    assert back == [
        {"run": 0, "gain": 1.0, "mixed": "1", "list": "[1.0, 2.0]", "solved": True, "text": "a",
         "late": None},
        {"run": 1, "gain": 0.5, "mixed": '"two"', "list": "[0.0]", "solved": False, "text": None,
         "late": 3},
    ]  # fmt: skip
    # A seed of 128 bits ended the campaign in an OverflowError, after its last run.
    write_rows(path, [{"seed": 2**100}, {"seed": 3}], {})
    assert read_rows(path)[0] == [{"seed": str(2**100)}, {"seed": "3"}]
    path.write_bytes(b"PAR1 not really")
    with pytest.raises(InvalidInputError, match="is not a table that wbc batch wrote"):
        read_rows(path)
