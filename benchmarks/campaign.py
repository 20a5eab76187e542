"""Campaigns that are killed, and a run's overhead.

First a campaign of cheap runs in two processes, killed by SIGKILL again and again until it is
complete: it must end with every run exactly once. Then the same on a Dask cluster of two workers,
one of which is killed, and the campaign itself once. Then the rate with one process, two, and so on
up to ``--workers``, from which the time of a large campaign on many workers is extrapolated: on W
workers N runs of t seconds take about N max((t + o) / W, s), where o is a worker's time between
runs, and s this process's time for each row.

    python benchmarks/campaign.py [--runs 1000] [--kills 3] [--workers 2]
    python benchmarks/campaign.py --only scaling --output benchmarks/RESULTS.md
"""

import argparse
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from qpbench.page import put_section
from qpbench.summary import machine
from qpbench.tables import Table

from wbc.batch import BatchProgress, load_campaign, read_rows, run_batch
from wbc.batch.row import Row, run_row
from wbc.journal import Journal

COMMAND = "python benchmarks/campaign.py --only scaling --output benchmarks/RESULTS.md"
LOOK = 0.05  # s between checks of the rows
STAND = """\
robot: hoap2_like
support: double
tasks:
  com: {type: com, target: {offset: [0, 0, -0.01]}, weight: 10.0}
  posture: {type: posture, weight: 0.01}
controller: {solver: active_set}
stop: {duration: 0.02, speed: null}
"""
CAMPAIGN = """\
problems: [stand.yaml]
grid:
  tasks.com.gain: [0.1, 0.2, 0.3, 0.4, 0.5]
seeds: %d
draw:
  tasks.com.target.offset: [[-0.01, -0.01, -0.02], [0.01, 0.01, 0.0]]
"""


def lines(path: Path) -> int:
    return path.read_bytes().count(b"\n") if path.exists() else 0


def wait_for_rows(kept: Path, count: int, running: subprocess.Popen[Any]) -> None:
    """Wait until a file has this many lines, or the campaign that writes it has ended."""
    while lines(kept) < count:
        with suppress(subprocess.TimeoutExpired):
            running.wait(LOOK)
            return


def run_killed(file: Path, runs: int, kills: int, *options: str) -> Path:
    """Run a campaign from the command line with evenly spaced kills; return its table."""
    table = file.with_suffix(".parquet")
    kept = table.with_name(table.name + ".partial")
    command = [sys.executable, "-m", "wbc", "batch", str(file), *options]
    for kill in range(kills):
        until = (kill + 1) * runs // (kills + 1)
        running = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        wait_for_rows(kept, until, running)
        running.send_signal(signal.SIGKILL)
        running.wait()
        print(f"  killed with {lines(kept) - 1} rows", flush=True)
    print(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return table


def check(table: Path, runs: int) -> None:
    rows, _ = read_rows(table)
    numbers = [row["run"] for row in rows]
    solved = sum(row["status"] == "completed" for row in rows)
    print(f"  {len(rows)} rows, {len(set(numbers))} different, {solved} completed\n", flush=True)
    assert numbers == list(range(runs)) and solved == runs


def run_on_cluster(file: Path, runs: int) -> Path:
    """Run a campaign on two workers; kill one, and the campaign, during it."""
    from distributed import LocalCluster

    table = file.with_suffix(".parquet")
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        kept = table.with_name(table.name + ".partial")
        victim = next(iter(cluster.workers.values())).pid
        command = [sys.executable, "-m", "wbc", "batch", str(file), "--cluster", address]
        running = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        wait_for_rows(kept, runs // 4, running)
        os.kill(victim, signal.SIGKILL)
        print(f"  killed a worker (process {victim}) with {lines(kept) - 1} rows", flush=True)
        wait_for_rows(kept, runs // 2, running)
        running.send_signal(signal.SIGKILL)
        told = running.communicate()[1]
        print("  told: " + "; ".join(one for one in told.splitlines() if "worker" in one))
        print(f"  killed the campaign with {lines(kept) - 1} rows", flush=True)
        print(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return table


def scaling(folder: Path, file: Path, most: int) -> str:
    """Return the rate by the number of processes, and this process's time per row."""
    campaign = load_campaign(file)
    text = campaign.texts["stand"]
    cpu = []
    for run in campaign.runs[:50]:
        start = time.thread_time()
        run_row(run, text)
        cpu.append(time.thread_time() - start)
    work = float(np.median(cpu))
    header = ("processes", "runs per s", "inside a run [ms]", "between runs", "own CPU per row")
    cells = list[list[str]]()
    own = between = 0.0
    for workers in range(1, most + 1):
        stamps: list[float] = []
        rows: list[Row] = []

        def note(at: BatchProgress, stamps: list[float] = stamps, rows: list[Row] = rows) -> None:
            stamps.append(time.monotonic())
            rows.append(at.row)

        with Journal(folder / f"scaling-{workers}", campaign.inputs()) as journal:
            spent = time.process_time()
            run_batch(
                campaign,
                workers=workers,
                journal=journal,
                progress=note,
                cancelled=lambda stamps=stamps: len(stamps) >= 200,
            )
            own = (time.process_time() - spent) / len(stamps)
        later = stamps[len(stamps) // 4 :]  # once all processes have loaded
        each = (later[-1] - later[0]) / (len(later) - 1)
        inside = float(np.median([row["wall_seconds"] for row in rows]))
        between = workers * each - inside
        times = [f"{1e3 * one:.3g}" for one in (inside, between, own)]
        cells.append([str(workers), f"{1 / each:.1f}", *times])
    load = "" if not hasattr(os, "getloadavg") else f", load {os.getloadavg()[0]:.0f}"
    lines = [
        Table(f"Campaigns by processes, on {os.cpu_count()} cores{load}", header, cells).markdown(),
        f"Runs of {1e3 * work:.0f} ms of CPU (loading the small humanoid, 4 ticks), by the clock;"
        " own: of the campaign's process.",
    ]
    for count, seconds, crowd in ((100_000, 5.0, 100), (100_000, 5.0, 1000)):
        took = count * max((seconds + between) / crowd, own)
        lines.append(
            f"Extrapolated: {count:,} runs of {seconds:g} s on {crowd} workers take"
            f" {took / 3600:.2g} h; the campaign's own process needs {count * own / 3600:.2g} h."
        )
    return "\n\n".join([*lines, f"{machine()}. Command: `{COMMAND}`."])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000, help="a multiple of 5")
    parser.add_argument("--kills", type=int, default=3)
    parser.add_argument("--workers", type=int, default=2, help="most of the measured scaling")
    parser.add_argument("--only", choices=("processes", "cluster", "scaling"))
    parser.add_argument("--output", type=Path, help="put the scaling here, between its marks")
    options = parser.parse_args()
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "stand.yaml").write_text(STAND)
        for kind in ("processes", "cluster"):
            (folder / f"{kind}.yaml").write_text(CAMPAIGN % (options.runs // 5))
        file = folder / "processes.yaml"
        if options.only in (None, "processes"):
            print("two processes", flush=True)
            check(run_killed(file, options.runs, options.kills, "--workers", "2"), options.runs)
        if options.only in (None, "cluster"):
            print("a cluster of two workers", flush=True)
            check(run_on_cluster(folder / "cluster.yaml", options.runs), options.runs)
        if options.only in (None, "scaling"):
            text = scaling(folder, file, options.workers)
            print(text)
            if options.output:
                put_section(options.output, "campaigns", text)


if __name__ == "__main__":
    main()
