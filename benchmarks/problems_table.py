"""What becomes of every problem in problems/: a line of JSON each, compared by a later code.

    python benchmarks/problems_table.py FILE [--problems problems/fig6a_g1.yaml ...] [--seconds 20]
    python benchmarks/problems_table.py FILE --compare [--tolerance 1e-6]

The summaries that `wbc run` and `wbc sim` write are kept whole, but for times; a problem that takes
longer (CPU time) is named as left out. `--compare` runs what the file has a result of and prints a
line for each: exit code, status and ticks, and the figure that differs most, relative where above
1. Exit code 1: of some problem an exit code, word or whole number is another, a figure has come or
gone, or a number differs by more than the tolerance. Closed loops amplify what solvers leave: where
contacts come and go, a number that differs is to be looked at, not yet a fault.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1]
SIMULATED = "so this problem is simulated"  # what `wbc run` says of a problem of torques
SECONDS, LONGER = 20, 4  # of CPU time; more where the file has a result
# Figures that machines and versions decide, by a part of their names.
UNCOMPARED = ("time", "seconds", "versions", "created", "provenance", "cpu", "_us", "_ms", "path")


def run(problem: str, seconds: int) -> dict[str, Any]:
    """Run a problem, or simulate one of torques; return what is kept of it."""
    found = called("run", problem, seconds)
    return called("sim", problem, seconds) if SIMULATED in found.get("error", "") else found


def called(command: str, problem: str, seconds: int) -> dict[str, Any]:
    """Return what is kept of a problem that a command of the command line ran, by itself."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "result.json"
        words = [command, problem, "--quiet", "--output", str(output)]
        done = subprocess.run(
            [sys.executable, "-m", "wbc", *words],
            cwd=FOLDER,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            preexec_fn=partial(resource.setrlimit, resource.RLIMIT_CPU, (seconds, seconds + 1)),
            capture_output=True,
            text=True,
            check=False,
        )
        found: dict[str, Any] = {"problem": problem, "exit": done.returncode}
        if done.returncode < 0:
            return {**found, "left_out": f"more than {seconds} s of CPU time"}
        if output.exists():
            found["summary"] = dict(figures(json.loads(output.read_text(encoding="utf-8"))))
        else:
            found["error"] = done.stderr.strip()
        return found


def figures(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the leaves of a summary by their names, such as ``tasks.com.norm``."""
    if any(part in name.rpartition(".")[2].lower() for part in UNCOMPARED):
        return
    if isinstance(value, Mapping):
        parts = value.items()
    elif isinstance(value, Sequence) and not isinstance(value, str):
        parts = enumerate(value)
    else:
        yield name, value
        return
    for key, part in parts:
        yield from figures(part, f"{name}.{key}" if name else str(key))


def difference(before: Any, now: Any) -> float:
    """Return how far two figures are apart, relative above 1; infinity if words or counts."""
    if before == now:
        return 0.0
    numbers = all(isinstance(one, int | float) for one in (before, now))
    if not numbers or (isinstance(before, int) and isinstance(now, int)):
        return float("inf")
    return abs(before - now) / max(1.0, abs(before))


def compare(before: Mapping[str, Any], now: Mapping[str, Any]) -> tuple[float, str]:
    """Return the largest difference of two results, and of what it is."""
    if before["exit"] != now["exit"]:
        return float("inf"), f"exit code {before['exit']} -> {now['exit']}"
    old, new = before.get("summary", {}), now.get("summary", {})
    worst, what = 0.0, "-"
    for name in sorted(old.keys() | new.keys()):
        missing = name not in old or name not in new
        apart = float("inf") if missing else difference(old[name], new[name])
        if apart > worst:
            worst, what = apart, f"{name}: {old.get(name, 'none')} -> {new.get(name, 'none')}"
    return worst, what


def write(path: Path, problems: Sequence[str], seconds: int) -> None:
    """Run all problems; a file of an earlier, unfinished run is gone on with."""
    known = {one["problem"] for one in read(path)} if path.exists() else set()
    with path.open("a", encoding="utf-8") as file:
        for problem in problems:
            if problem in known:
                continue
            one = run(problem, seconds)
            print(json.dumps(one), file=file, flush=True)
            print(f"{problem:40s}{said(one)}", flush=True)


def read(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a file."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def said(one: Mapping[str, Any]) -> str:
    """Return a result in a few words."""
    summary = one.get("summary", {})
    words = one.get("left_out") or one.get("error") or summary.get("status", "")
    return f"exit {one['exit']:3d}  {words}  {summary.get('ticks', '')}"


def main() -> None:
    """Write a file, or compare with it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    every = sorted(str(one.relative_to(FOLDER)) for one in (FOLDER / "problems").glob("*.yaml"))
    parser.add_argument("--problems", nargs="+", default=every)
    parser.add_argument("--seconds", type=int, default=SECONDS)
    parser.add_argument("--compare", action="store_true")
    parser.add_argument("--tolerance", type=float, default=1e-6)
    options = parser.parse_args()
    if not options.compare:
        write(options.file, options.problems, options.seconds)
        return
    failed = False
    for before in read(options.file):
        if "left_out" in before or before["problem"] not in options.problems:
            continue
        now = run(before["problem"], LONGER * options.seconds)
        worst, what = compare(before, now)
        failed = failed or not worst <= options.tolerance
        print(f"{before['problem']:40s}{said(now):40s}{worst:9.1e}  {what}", flush=True)
    sys.exit(int(failed))


if __name__ == "__main__":
    main()
