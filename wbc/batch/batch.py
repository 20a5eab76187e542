"""A campaign from its first run to its table; what was done before a kill is not done again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

from wbc.batch.cluster import Cluster
from wbc.batch.row import DIED, ERROR, Row, heading, no_result, plain_row, run_row
from wbc.journal import Journal
from wbc.kinds import whole_number
from wbc.problem.campaign import Campaign, Run
from wbc.workers import Death, WorkerDiedError, Workers

MOMENT = 0.2  # s to wait for a row, before looking whether the campaign is to end


class BatchProgress(NamedTuple):
    """How far a campaign is."""

    done: int  # runs, those done before this call included
    total: int
    new: int  # runs done in this call
    row: Row  # the last


def run_batch(
    campaign: Campaign,
    *,
    workers: int = 1,
    cluster: str | None = None,
    journal: Journal | None = None,
    progress: Callable[[BatchProgress], object] | None = None,
    on_death: Callable[[str], object] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> list[Row]:
    """Run what of a campaign is not in the journal, and return all rows by number.

    Parameters
    ----------
    workers:
        Processes here, started fresh (``spawn``): a script needs the usual ``if __name__ ==
        "__main__"`` guard.
    cluster:
        Address of a Dask scheduler whose workers run it instead; they must have the same versions
        of everything, and the problems under the same paths.
    journal:
        Keeps every row as it comes.
    on_death:
        Told in words of each worker that died, and of the run that is tried again.
    cancelled:
        Asked between runs; True ends the campaign with the rows there are.

    Raises
    ------
    InvalidInputError
        Less than one worker.
    WbcError
        The cluster cannot be reached, or is of other versions.
    """
    workers = whole_number("campaign, workers", workers, least=1)
    rows = {row["run"]: row for row in (journal.entries if journal else ())}
    waiting = [run for run in campaign.runs if run.number not in rows]
    if waiting:
        told = partial(_tell_death, campaign.runs, on_death or (lambda text: None))
        here = min(workers, len(waiting))
        pool = Workers(_runner, here, told) if cluster is None else Cluster(cluster, told)
        with pool:
            before = len(rows)
            for row in _new_rows(campaign, waiting, pool, cancelled or (lambda: False)):
                if row["run"] in rows:
                    continue
                if journal is not None:
                    journal.add(row)
                rows[row["run"]] = row
                if progress is not None:
                    done = len(rows)
                    progress(BatchProgress(done, len(campaign.runs), done - before, row))
    return [rows[number] for number in sorted(rows)]


def _runner() -> Callable[..., Row]:
    return run_row


def _new_rows(
    campaign: Campaign, waiting: Sequence[Run], pool: Workers | Cluster, ended: Callable[[], bool]
) -> Iterator[Row]:
    ahead, busy = iter(waiting), dict[int, Run]()
    while not ended():
        for _ in range(pool.room):
            run = next(ahead, None)
            if run is None:
                break
            busy[run.number] = run
            pool.submit(run.number, run, campaign.texts[run.problem])
        if not busy:
            return
        for answer in pool.results(MOMENT):
            run = busy.pop(answer.key)  # type: ignore[call-overload]
            if answer.error is None:
                yield answer.value
            else:
                status = DIED if isinstance(answer.error, WorkerDiedError) else ERROR
                lost = no_result(status, str(answer.error))
                yield plain_row({**heading(run), **lost, "worker": answer.worker})


def _tell_death(runs: Sequence[Run], tell: Callable[[str], object], death: Death) -> None:
    if death.key is None:
        tell(f"{death.worker}; what it had is run elsewhere")
        return
    number = death.key
    what = runs[number].describe()  # type: ignore[call-overload]
    then = "given up" if death.final else "tried again"
    tell(f"{death.worker} amid {what}; {then}")
