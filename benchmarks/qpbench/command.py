"""``wbc bench``: QP solvers on recorded sequences, their figures, and how they changed."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc.cli.errors import NOT_REACHED, print_note
from wbc.cli.options import Quiet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from qpbench.compare import SpeedChange
    from qpbench.sequence import QpSequence
    from wbc.cli.outputs import Outputs

BENCH_EXIT_CODES = (
    "Exit codes: 0 measured and, with --compare, nothing slower or worse; 1 bad input; 2 wrong"
    " usage; 3 some solver is slower, or solves less, than in the earlier figures."
)
TEXTS = (".json", ".md", ".html")
SECTION = "solvers"  # of a page that has marks for it
ENDINGS = (*TEXTS, ".png", ".svg", ".pdf")
ACCURACIES = [1e-6]
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def bench(
    problems: Annotated[
        list[Path] | None,
        typer.Argument(help="Problem files whose QPs are recorded, too.", metavar="PROBLEM.yaml"),
    ] = None,
    sequences: Annotated[
        Path | None,
        typer.Option(help="Folder of recorded sequences; recorded into it if it is not there."),
    ] = None,
    solver: Annotated[
        list[str] | None,
        typer.Option(help="Only this one, as in daqp or qpsolvers:osqp; repeatable."),
    ] = None,
    eps: Annotated[
        list[float] | None, typer.Option(help="Accuracy asked for; repeatable. 1e-6 by default.")
    ] = None,
    ticks: Annotated[int, typer.Option(help="QPs recorded of each job.", min=1)] = 200,
    job: Annotated[
        list[str] | None,
        typer.Option(help="Only standard jobs whose name has this, as in 'g1 torque'; repeatable."),
    ] = None,
    repeats: Annotated[int, typer.Option(help="Passes over every sequence.", min=1)] = 5,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            help="Write .json, .md (if it has marks, its section), .html, a picture; repeatable.",
        ),
    ] = None,
    compare: Annotated[
        Path | None, typer.Option(help="Figures of an earlier run (.json): what is slower now?")
    ] = None,
    qpbenchmark: Annotated[
        Path | None, typer.Option(help="Write the sequences as a test set of qpbenchmark.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Measure QP solvers on the QPs of whole-body controllers, in warm-start order.

    Without problem files: standard jobs, from an arm to 62 joints, velocities and torques, smooth
    and hard, up to 200 pairs of bodies.
    """
    places = _checked(output or [])
    from qpbench.solvers import candidate_names, make_candidate
    from qpbench.summary import load_summary

    old = None if compare is None else load_summary(compare)
    solvers = solver or list(candidate_names())
    for name in solvers:  # before the recording, which takes long
        make_candidate(name, (eps or ACCURACIES)[0])
    _one_thread()
    found = _sequences(problems or [], sequences, job or [], ticks, quiet)
    if qpbenchmark is not None:
        _export(qpbenchmark, found, quiet)
    summary = _measure(found, solvers, eps or ACCURACIES, repeats, quiet)
    changes: Sequence[SpeedChange] = ()
    if old is not None:
        changes = _compared(old, summary)
    outputs = _write_all(places, summary, changes)
    if not quiet:
        _print(summary, changes, outputs.written)
    worse = any(one.verdict in ("slower", "fails more") for one in changes)
    code = outputs.exit_code(NOT_REACHED if worse else 0)
    raise typer.Exit(code)


def _checked(output: list[Path]) -> list[Path]:
    from wbc.cli.outputs import check_place
    from wbc.errors import InvalidInputError
    from wbc.extras import require

    for each in output:
        if each.suffix not in ENDINGS:
            raise InvalidInputError(f"--output {each}: expected one of {', '.join(ENDINGS)}")
        if each.suffix not in (".json", ".md"):
            require("matplotlib", f"--output {each}")
        check_place("--output", each)
    return output


def _one_thread() -> None:
    """Warn if linear algebra may use several threads, which makes times meaningless."""
    if not any(os.environ.get(name) == "1" for name in THREADS):
        print_note("set OMP_NUM_THREADS=1 for steady times")


def _sequences(
    problems: list[Path], folder: Path | None, jobs: list[str], ticks: int, quiet: bool
) -> list[QpSequence]:
    """Return the sequences to solve: of a folder if it exists, else recorded now."""
    from qpbench.sequence import ENDING, load_sequence, save_sequence
    from qpbench.suite import STANDARD, record
    from wbc.errors import InvalidInputError

    if folder is not None and folder.is_dir():
        files = sorted(folder.glob(f"*{ENDING}"))
        if not files:
            raise InvalidInputError(f"--sequences {folder}: has no file *{ENDING}")
        return [load_sequence(file) for file in files]
    chosen = [one for one in STANDARD if not jobs or any(part in one.name for part in jobs)]
    if jobs and not chosen:
        names = ", ".join(one.name for one in STANDARD)
        raise InvalidInputError(f"--job {jobs[0]}: no job has that in its name ({names})")
    found = _recorded(problems, ticks, quiet)
    for one in chosen if jobs or not problems else []:
        if not quiet:
            typer.echo(f"records {one.name}", err=True)
        found.append(record(one, ticks))
    if folder is not None:
        folder.mkdir(parents=True)
        try:
            for sequence in found:
                save_sequence(folder / f"{sequence.name.replace(' ', '_')}{ENDING}", sequence)
        except BaseException:
            shutil.rmtree(folder)  # some of them would be taken for all by the next command
            raise
    return found


def _recorded(problems: list[Path], ticks: int, quiet: bool) -> list[QpSequence]:
    """Return the QPs of problem files; files without QPs are left out, by name."""
    from qpbench.suite import NothingToRecordError, record_problem

    found = []
    for path in problems:
        if not quiet:
            typer.echo(f"records {path}", err=True)
        try:
            found.append(record_problem(path, ticks))
        except NothingToRecordError as error:
            if len(problems) == 1:
                raise
            print_note(f"{error}; left out")
    return found


def _export(folder: Path, sequences: list[QpSequence], quiet: bool) -> None:
    from qpbench.export import export_qpbenchmark

    files = export_qpbenchmark(folder, sequences)
    if not quiet:
        typer.echo(f"written  {', '.join(map(str, files))}")
        typer.echo(
            f"now try  cd {folder} && qpbenchmark --results-path results.csv {files[1].name} run"
            " --author YOU"
        )


def _measure(
    sequences: list[QpSequence],
    solvers: list[str],
    accuracies: list[float],
    repeats: int,
    quiet: bool,
) -> dict[str, Any]:
    from qpbench.measure import measure
    from qpbench.summary import summarise
    from wbc.cli.progress import shown_progress

    with shown_progress(quiet) as progress:

        def tell(done: int, total: int, name: str) -> None:
            if progress is not None:
                progress(done, total, {"solver": name})

        measured = measure(sequences, solvers, accuracies, repeats, tell)
    return summarise(sequences, measured, shlex.join(["wbc", *sys.argv[1:]]))


def _compared(old: dict[str, Any], new: dict[str, Any]) -> Sequence[SpeedChange]:
    from qpbench.compare import compare

    changes, notes = compare(old, new)
    for note in notes:
        print_note(note)
    return changes


def _write_all(
    places: list[Path], summary: dict[str, Any], changes: Sequence[SpeedChange]
) -> Outputs:
    from wbc.cli.outputs import Outputs

    outputs = Outputs()
    for place in places:
        if place.suffix in TEXTS:
            outputs.save(place, lambda path: _write(path, summary, changes))
        else:
            outputs.draw(place, lambda path: _draw(summary, path), "--output")
    return outputs


def _write(path: Path, summary: dict[str, Any], changes: Sequence[SpeedChange]) -> None:
    from qpbench.page import has_section, with_section
    from qpbench.tables import html_page, markdown
    from wbc.files import write_text
    from wbc.run.saving import json_text

    match path.suffix:
        case ".json":
            text = json_text(summary)
        case ".md":
            text = markdown(summary, changes)
            page = path.read_text(encoding="utf-8") if path.exists() else ""
            if has_section(page, SECTION):
                text = with_section(page, SECTION, text)
        case _:
            with TemporaryDirectory() as folder:
                picture = Path(folder) / "bench.png"
                _draw(summary, picture)
                text = html_page(summary, changes, picture.read_bytes())
    write_text(path, text)


def _draw(summary: dict[str, Any], path: Path) -> None:
    from qpbench.plot import plot_bench

    plot_bench(summary, path)


def _print(summary: dict[str, Any], changes: Sequence[SpeedChange], places: list[Path]) -> None:
    from qpbench.tables import changes_table, tables

    for table in [*tables(summary)[::2], *([changes_table(changes)] if changes else [])]:
        typer.echo(f"\n{table.title}")
        widths = [
            max(len(row[k]) for row in (table.header, *table.rows))
            for k in range(len(table.header))
        ]
        for row in (table.header, *table.rows):
            cells = [row[0].ljust(widths[0])]
            cells += [one.rjust(width) for one, width in zip(row[1:-1], widths[1:-1], strict=True)]
            typer.echo("  ".join([*cells, row[-1]]).rstrip())
    for place in places:
        typer.echo(f"written  {place}")
