"""``wbc batch``: a campaign of runs, in processes or on a cluster, into one table."""

from __future__ import annotations

import os
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc.cli.errors import NOT_REACHED, complain, print_note
from wbc.cli.options import Processes, Quiet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wbc.batch import BatchProgress, Campaign
    from wbc.cli.interrupts import Interrupts
    from wbc.journal import Journal

BATCH_EXIT_CODES = (
    "Exit codes: 0 every run has a result, good or not; 1 bad input, or a file cannot be written;"
    " 2 wrong usage; 3 some runs ended in an error or killed their workers; 130 or 143 ended by"
    " Ctrl-C or SIGTERM. The same"
    " command then goes on where it ended, also after a kill."
)
PARTIAL = ".partial"  # suffix of the journal, until the campaign is done
SHOWN = 5  # runs without result that are named


def batch(
    path: Annotated[Path, typer.Argument(help="A campaign file.", metavar="CAMPAIGN.yaml")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Parquet file; by default the campaign's name with .parquet."
        ),
    ] = None,
    workers: Processes = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            help="Run on the workers of this Dask scheduler instead, as in tcp://10.0.0.1:8786."
        ),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Check every run and say how many there are; run none.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Run problems with many values and seeds, and write a table with a row for each run."""
    from wbc.batch import load_campaign, write_rows
    from wbc.batch.row import DIED, ERROR, made_with
    from wbc.cli.outputs import Outputs
    from wbc.extras import require
    from wbc.journal import Journal

    require("pyarrow", "wbc batch")
    if cluster is not None:
        require("distributed", "--cluster")
    if output is not None:
        _check_output(output)
    campaign = load_campaign(path)  # before its name is taken: a folder's may be empty
    if output is None:
        output = path.with_suffix(".parquet")
        _check_output(output)
    if check:
        typer.echo(f"{path}: valid: {_summary_line(campaign)}")
        return
    made_of = {**campaign.inputs(), "versions": made_with()}
    if _is_done(output, made_of):
        typer.echo(f"{output} has all {len(campaign.runs)} runs already; delete it to begin anew")
        return
    kept, outputs = output.with_name(output.name + PARTIAL), Outputs()
    with Journal(kept, made_of) as journal:
        if journal.entries and not quiet:
            done = f"{len(journal.entries)} of {len(campaign.runs)} runs"
            typer.echo(f"goes on with {done} in {kept}", err=True)
        count = workers or len(os.sched_getaffinity(0))
        rows, interrupts = _run(campaign, journal, count, cluster, quiet)
        if not interrupts():
            outputs.save(output, lambda table: write_rows(table, rows, made_of))
            if not outputs.failures:
                journal.remove()
    if not quiet:
        _print_table(campaign, rows, outputs.written)
    if interrupts():
        complain(f"interrupted; the same command goes on with what is in {kept}")
        raise typer.Exit(interrupts.exit_code)
    lost = any(row["status"] in (ERROR, DIED) for row in rows)
    raise typer.Exit(outputs.exit_code(NOT_REACHED if lost else 0))


def _check_output(output: Path) -> None:
    """Raise if the output cannot be written, before any work is done."""
    from wbc.batch.row import ENDING
    from wbc.cli.outputs import check_place
    from wbc.errors import InvalidInputError

    if output.suffix != ENDING:
        raise InvalidInputError(f"--output {output}: a campaign is written as {ENDING}")
    check_place("--output", output)


def _is_done(output: Path, made_of: dict[str, Any]) -> bool:
    """Return whether the output has this campaign's results; raise if it has another's."""
    import json

    from wbc.batch import read_rows
    from wbc.errors import InvalidInputError
    from wbc.journal import differing_keys

    if not output.exists():
        return False
    _, theirs = read_rows(output)
    ours = json.loads(json.dumps(made_of))
    if theirs != ours:
        other = differing_keys(theirs, ours)
        raise InvalidInputError(
            f"{output}: has the results of another campaign ({other} differs);"
            " delete it, or write to another file with --output"
        )
    return True


def _run(
    campaign: Campaign, journal: Journal, workers: int, cluster: str | None, quiet: bool
) -> tuple[list[dict[str, Any]], Interrupts]:
    """Do the remaining runs, until the end or a signal."""
    from wbc.batch import run_batch
    from wbc.cli.interrupts import noted_interrupts
    from wbc.cli.progress import shown_progress

    began = time.monotonic()
    with shown_progress(quiet) as progress, noted_interrupts() as interrupts:

        def tell(at: BatchProgress) -> None:
            if progress is not None:
                progress(at.done, at.total, {"batch": at, "seconds": time.monotonic() - began})

        rows = run_batch(
            campaign,
            workers=workers,
            cluster=cluster,
            journal=journal,
            progress=tell,
            on_death=print_note,
            cancelled=interrupts,
        )
    return rows, interrupts


def _summary_line(campaign: Campaign) -> str:
    spec = campaign.spec
    seeds = spec.seeds if isinstance(spec.seeds, int) else len(spec.seeds or ())
    counts = {"problem": len(campaign.texts), "case": len(spec.cases or ())}
    parts = [f"{count} {what}{'s' if count > 1 else ''}" for what, count in counts.items() if count]
    parts += [f"{len(values)} of {path}" for path, values in spec.grid.items()]
    parts += [f"{seeds} seed{'s' if seeds > 1 else ''}"] if seeds else []
    return f"{len(campaign.runs)} runs ({' x '.join(parts)})"


def _print_table(
    campaign: Campaign, rows: Sequence[dict[str, Any]], written: Sequence[Path]
) -> None:
    """Print how many runs ended how, by problem and case, and those without result."""
    from wbc.batch.row import DIED, ERROR

    typer.echo(f"{len(rows)} of {_summary_line(campaign)}")
    for name in campaign.texts:
        for case in campaign.spec.cases or (None,):
            ended = Counter(
                row["status"] for row in rows if (row["problem"], row["case"]) == (name, case)
            )
            told = ", ".join(f"{count} {status}" for status, count in ended.most_common())
            typer.echo(f"  {name if case is None else f'{name}, {case}'}: {told or 'none'}")
    lost = [row for row in rows if row["status"] in (ERROR, DIED)]
    for row in lost[:SHOWN]:
        typer.echo(f"  {campaign.runs[row['run']].describe()}: {row['status']}: {row['reason']}")
    if len(lost) > SHOWN:
        typer.echo(f"  and {len(lost) - SHOWN} more without result")
    for path in written:
        typer.echo(f"written  {path}")
