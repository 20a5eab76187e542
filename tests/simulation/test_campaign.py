"""Campaigns of pushes: which are tried, in how many processes, and what a kill leaves."""

import json
import math
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from wbc.errors import InvalidInputError
from wbc.run.saving import save_result
from wbc.simulation import PushGrid, PushOutcome, run_campaign
from wbc.simulation.campaign import CampaignLog, Trial
from wbc.simulation.push_map import saved_outcomes
from wbc.workers import WorkerDiedError

RATIOS = (0.8, 1.0, 1.2, 1.4, 1.6)


@dataclass(frozen=True)
class Ellipse:
    """Pushes are survived inside an ellipse, but for some, and beyond it for others.

    From ``dies_at`` on the process ends, from ``stays_at`` on a push never does.
    """

    but: Sequence[tuple[float, float]] = ()
    dies_at: float = math.inf
    stays_at: float = math.inf

    def limit(self, angle: float) -> float:
        return 1.5 / math.hypot(math.cos(angle), 1.4 * math.sin(angle))

    def __call__(self) -> Trial:
        return self.tried

    def tried(self, angle: float, ratio: float) -> PushOutcome:
        if ratio >= self.dies_at:
            os._exit(1)
        if ratio >= self.stays_at:
            threading.Event().wait()
        odd = any(math.isclose(angle, a) and math.isclose(ratio, r) for a, r in self.but)
        survived = (ratio <= self.limit(angle)) != odd
        return PushOutcome(angle, ratio, 3.0 * ratio, survived, "so it is", 1.0, 0.1, 0.0, 0.0)


def refused() -> Trial:
    raise InvalidInputError("this cannot be pushed")


def keys(outcomes: Sequence[PushOutcome]) -> list[tuple[float, float]]:
    return [one.key for one in outcomes]


def test_a_direction_ends_after_failures_in_a_row() -> None:
    trial = Ellipse()
    outcomes = run_campaign(PushGrid(8, RATIOS, failures=2), trial)
    for angle in PushGrid(8).angles:
        mine = [one for one in outcomes if math.isclose(one.angle, angle)]
        survived = [ratio for ratio in RATIOS if ratio <= trial.limit(angle)]
        assert [one.ratio for one in mine if one.survived] == survived
        left = len(RATIOS) - len(survived)
        assert len(mine) == len(survived) + min(left, 2)


def test_with_no_limit_on_failures_the_whole_grid_is_tried() -> None:
    grid = PushGrid(4, RATIOS, failures=0)
    assert len(run_campaign(grid, Ellipse())) == grid.size == 20


def test_gentle_pushes_come_first_and_are_recorded_as_they_come() -> None:
    recorded, told = list[PushOutcome](), list[tuple[int, int]]()
    heard = {"record": recorded.append, "progress": lambda *one: told.append(one[:2])}
    outcomes = run_campaign(PushGrid(4, RATIOS), Ellipse(), **heard)
    assert [one.ratio for one in recorded] == sorted(one.ratio for one in recorded)
    assert sorted(keys(recorded)) == keys(outcomes)
    assert [done for done, _ in told] == [k + 1 for k in range(len(outcomes))]
    totals = [total for _, total in told]  # at most: less where a direction ends by its failures
    assert totals == sorted(totals, reverse=True)
    assert (totals[0], totals[-1]) == (20, len(outcomes))


def test_what_is_known_is_not_tried_again_and_what_is_not_of_the_grid_is_left_out() -> None:
    whole = run_campaign(PushGrid(8, RATIOS), Ellipse())
    known = [one for one in whole if one.ratio < 1.1]
    tried: list[PushOutcome] = []
    coarse = run_campaign(PushGrid(4, RATIOS), Ellipse(), known=known, record=tried.append)
    assert not set(keys(known)) & set(keys(tried))
    assert coarse == [one for one in whole if one.key in {*keys(coarse)}]
    assert len({one.angle for one in coarse}) == 4
    nothing: list[PushOutcome] = []
    again = run_campaign(PushGrid(8, RATIOS), refused, known=whole, record=nothing.append)
    assert again == whole and not nothing  # nor is anything loaded


@pytest.mark.slow
def test_the_outcomes_do_not_depend_on_the_processes() -> None:
    grid, trial = PushGrid(5, RATIOS, failures=1), Ellipse(but=((0.0, 1.0),))
    assert run_campaign(grid, trial, workers=2) == run_campaign(grid, trial)


@pytest.mark.slow
def test_what_a_process_cannot_load_or_survive_is_told() -> None:
    with pytest.raises(InvalidInputError, match="this cannot be pushed"):
        run_campaign(PushGrid(2, RATIOS), refused, workers=2)
    recorded: list[PushOutcome] = []
    with pytest.raises(WorkerDiedError, match="3 times it was tried"):
        run_campaign(PushGrid(2, RATIOS), Ellipse(dies_at=1.1), workers=2, record=recorded.append)
    assert {one.ratio for one in recorded} <= {0.8, 1.0} and recorded


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_it_ends_when_asked_with_what_there_is(workers: int) -> None:
    recorded = list[PushOutcome]()
    ends = {"record": recorded.append, "cancelled": lambda: len(recorded) >= 3}
    outcomes = run_campaign(PushGrid(4, RATIOS), Ellipse(), workers=workers, **ends)
    assert 3 <= len(outcomes) == len(recorded) < 20


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"directions": 0}, "directions"),
        ({"directions": 2.5}, "whole number"),
        ({"failures": -1}, "failures"),
        ({"ratios": []}, "ratios"),
        ({"ratios": [1.0, 0.9]}, "must rise"),
        ({"ratios": [0.0, 0.9]}, "above 0"),
        ({"ratios": [1.0, float("nan")]}, "ratios"),
    ],
)
def test_a_grid_that_is_none_is_refused(options: dict[str, object], text: str) -> None:
    with pytest.raises(InvalidInputError, match=text):
        PushGrid(**options)  # type: ignore[arg-type]


# ---------------------------------------------------------------------- the log

OUTCOME = PushOutcome(0.5, 1.1, 12.3456789012345678, True, "stood", 4.0, 0.1, 1e-3, 0.0)
MADE_OF = {"text": "robot: g1", "ratios": (1.0, 2.0)}


def test_half_a_line_is_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "log"
    with CampaignLog(path, MADE_OF) as log:
        log.record("one", OUTCOME)
        log.record("one", OUTCOME._replace(ratio=2.0))
    path.write_bytes(path.read_bytes()[:-20])
    with CampaignLog(path, MADE_OF) as log:
        assert log.known == {"one": [OUTCOME]}
        log.record("one", OUTCOME._replace(ratio=3.0))
    with CampaignLog(path, MADE_OF) as log:
        assert [one.ratio for one in log.known["one"]] == [1.1, 3.0]
    path.write_bytes(path.read_bytes()[:10])  # killed within the head
    with CampaignLog(path, MADE_OF) as log:
        assert not log.known
    assert len(path.read_text().splitlines()) == 1


def test_the_log_of_another_campaign_is_refused_by_what_differs(tmp_path: Path) -> None:
    path = tmp_path / "log"
    CampaignLog(path, MADE_OF).__exit__(None, None, None)
    before = path.read_text()
    with pytest.raises(InvalidInputError, match=r"another campaign \(text differs\)"):
        CampaignLog(path, {**MADE_OF, "text": "robot: talos"})
    path.write_text("not\njson\n")
    with pytest.raises(InvalidInputError, match="not what a campaign left"):
        CampaignLog(path, MADE_OF)
    path.write_text(before + json.dumps({"problem": "one", "angle": 1.0}) + "\n")
    with pytest.raises(InvalidInputError, match="not what a campaign left"):
        CampaignLog(path, MADE_OF)


@pytest.mark.parametrize("ending", ["json", "NPZ"])
def test_outcomes_of_an_output_are_read_and_none_of_a_damaged_one(tmp_path, ending: str) -> None:
    """Else a push of the angle None was compared with those of the grid: a traceback."""
    path, blown_up = tmp_path / f"r.{ending}", OUTCOME._replace(ratio=2.0, tilt=math.inf)
    told = {"maps": [{"problem": "one", "outcomes": [OUTCOME._asdict(), blown_up._asdict()]}]}
    save_result(path, told | MADE_OF, dict, list)
    first, other = saved_outcomes(path, MADE_OF)["one"]
    assert first == OUTCOME and other.ratio == 2.0 and math.isnan(other.tilt)
    told["maps"][0]["outcomes"][0]["angle"] = "ahead"
    save_result(path, told | MADE_OF, dict, list)
    assert not saved_outcomes(path, MADE_OF)
    none = {"maps": [{"problem": "one", "outcomes": [None]}]}
    for damaged in (200_000 * "[", json.dumps(MADE_OF | none)):
        path.with_suffix(".json").write_text(damaged)
        assert not saved_outcomes(path.with_suffix(".json"), MADE_OF)


CAMPAIGN = """
import multiprocessing, sys
from pathlib import Path
from tests.simulation.test_campaign import Ellipse, RATIOS
from wbc.simulation import PushGrid, run_campaign
from wbc.simulation.campaign import CampaignLog

def record(one):
    kept.record("one", one)
    print(len(multiprocessing.active_children()), flush=True)

if __name__ == "__main__":
    with CampaignLog(Path(sys.argv[1]), {}) as kept:
        run_campaign(PushGrid(6, RATIOS), Ellipse(stays_at=1.2), workers=2, record=record)
"""


@pytest.mark.slow
def test_after_a_kill_it_goes_on_and_no_process_is_left(tmp_path: Path) -> None:
    """SIGKILL in the midst: the processes end by themselves, and what was done is not redone."""
    log, script = tmp_path / "log", tmp_path / "campaign.py"
    script.write_text(CAMPAIGN)
    command = [sys.executable, str(script), str(log)]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), *sys.path])}
    running = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=env)
    assert running.stdout is not None
    assert [running.stdout.readline() for _ in range(12)][-1] == "2\n"  # six directions, 0.8 and 1
    running.send_signal(signal.SIGKILL)
    running.communicate(timeout=120.0)  # its end is that of everyone who could write into it
    tried: list[PushOutcome] = []
    grid = PushGrid(6, RATIOS)
    with CampaignLog(log, {}) as kept:
        known = kept.known["one"]
        whole = run_campaign(grid, Ellipse(), known=known, record=tried.append)
    assert len(known) == 12 < len(whole)
    assert len(tried) == len(whole) - len(known)
    assert whole == run_campaign(grid, Ellipse())
