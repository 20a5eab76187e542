"""Compare two revisions: results of all problems, and the time of a tick.

1. Each revision's command line runs every ``problems/*.yaml`` of its own; all entries that both
   results have are compared: final state, errors, histories, plans, verdicts. A difference of
   numbers counts above 1e-6 of one plus their size; the older revision then runs ``--repeat`` times
   more and is compared with itself, since identical processes differ in rounding and some problems
   amplify it.
2. Ticks of the same jobs, by processes of each revision in turns on one core: CPU time of snapshot
   and step. Each round has new processes, hence the range of the ratio. "Apart": difference of the
   final configurations, rounding if both did the same work.

    python benchmarks/compare.py --base REV [--problems 'plan_*'] [--only results|times]
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # of this process and of those that it starts

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

HERE, TOLERANCE = Path(__file__).resolve().parents[1], 1e-6
WARM_UP, TURN = 200, 25  # ticks: not timed by tick.py, and of one process before the other's turn
# Entries that were renamed: name before -> name after, each with all below it.
RENAMED: dict[str, str] = {}
# Times, effort, versions, prose, and where an extreme is: rounding decides between equals.
NO_RESULTS = (
    *("tick_time", "tick_cpu_time", "summary.tick_time", "summary.shaping.effort", "meta.stats"),
    *("summary.versions", "summary.problem", "summary.reason", "summary.qp.failures"),
    *("summary.joint_limits.joint", "summary.joint_limits.tick", "summary.slip.frame"),
    *("summary.slip.tick", "summary.balance.phase", "summary.balance.tick"),
)


@dataclass
class Outcome:
    """A revision's result of a problem: exit code, entries by dotted name, error message."""

    code: int
    entries: dict[str, np.ndarray]
    message: str

    @property
    def verdict(self) -> str:
        return f"{self.entries.get('summary.status', [self.message])[0]} ({self.code})"


def run_problem(tree: Path, name: str) -> Outcome:
    """Run a problem of ``tree`` with the code of ``tree``."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "result.npz"
        command = [sys.executable, "-m", "wbc", "run", str(tree / "problems" / f"{name}.yaml")]
        command += ["--quiet", "--output", str(output)]
        paths = {**os.environ, "PYTHONPATH": str(tree)}
        done = subprocess.run(command, check=False, env=paths, cwd=folder, capture_output=True)
        entries = read_entries(output) if output.exists() else {}
    return Outcome(done.returncode, entries, done.stderr.decode().strip()[-200:])


def read_entries(path: Path) -> dict[str, np.ndarray]:
    """Return arrays and summary of a result by dotted names, without incomparable entries."""
    with np.load(path) as file:
        found = [leaves(name, file[name]) for name in file.files]
    entries = {name: one for part in found for name, one in part.items()}
    timed = [name for name in entries if name.endswith("seconds")]
    return {name: one for name, one in entries.items() if not within(name, (*timed, *NO_RESULTS))}


def leaves(name: str, value: Any) -> dict[str, np.ndarray]:
    """Return numbers, words and lists of them by dotted names; JSON is read, None is NaN."""
    value = value.item() if getattr(value, "ndim", 1) == 0 else value
    if isinstance(value, str) and value.startswith("{"):
        value = json.loads(value)
    if isinstance(value, list) and any(isinstance(one, dict | list) for one in value):
        value = {str(k): one for k, one in enumerate(value)}
    if isinstance(value, dict):
        below = [leaves(f"{name}.{key}", one) for key, one in value.items()]
        return {path: leaf for one in below for path, leaf in one.items()}
    if not isinstance(value, np.ndarray):
        value = np.array([np.nan if one is None else one for one in np.atleast_1d(value).tolist()])
    return {name: value}


def within(name: str, sections: Iterable[str]) -> bool:
    return f"{name}.".startswith(tuple(f"{section}." for section in sections))


def new_name(name: str) -> str:
    old = next((one for one in RENAMED if within(name, (one,))), "")
    return RENAMED.get(old, "") + name[len(old) :]


@dataclass
class Comparison:
    """The differences: the largest gap of each entry with its place, and others in words."""

    gaps: list[tuple[float, str]] = field(default_factory=lambda: [(0.0, "")])
    words: list[str] = field(default_factory=list)

    @property
    def agrees(self) -> bool:
        return max(self.gaps)[0] <= TOLERANCE and not self.words


def compare(before: Outcome, after: Outcome) -> Comparison:
    """Compare all entries of both outcomes."""
    old, new = {new_name(name): one for name, one in before.entries.items()}, after.entries
    found = Comparison()
    if not (old or new):
        found.words.append(f"no result of either: {after.message}")
    if before.code != after.code:
        found.words.append(f"exit code {before.code} -> {after.code} {after.message}")
    if old.keys() - new.keys():  # what is new is no difference
        found.words.append(f"only before: {', '.join(sorted(old.keys() - new.keys()))}")
    for name in sorted(old.keys() & new.keys()):
        a, b = old[name], new[name]
        if a.shape != b.shape:
            found.words.append(f"{name}: shape {a.shape} -> {b.shape}")
            if a.shape[1:] != b.shape[1:]:
                continue
            a, b = a[: len(b)], b[: len(a)]  # as far as both histories go
        if {a.dtype.kind, b.dtype.kind} <= set("fiub"):
            found.gaps.append(gap_of(name, a.astype(float), b.astype(float)))
        elif (a != b).any():
            k = tuple(np.argwhere(a != b)[0].tolist())
            found.words.append(f"{name}{list(k)}: {a[k]} -> {b[k]}")
    return found


def gap_of(name: str, a: np.ndarray, b: np.ndarray) -> tuple[float, str]:
    """Return the largest difference of two arrays, and where it is."""
    with np.errstate(invalid="ignore"):
        gaps = np.abs(a - b) / (1.0 + np.minimum(np.abs(a), np.abs(b)))
    gaps[(a == b) | (np.isnan(a) & np.isnan(b))] = 0.0
    gaps[np.isnan(gaps)] = np.inf  # a number on one side only
    largest, wrong = float(gaps.max(initial=0.0)), np.argwhere(gaps > TOLERANCE)
    if not len(wrong):
        return largest, ""
    k = tuple(np.argwhere(gaps == largest)[0].tolist())
    return largest, f"{name}{list(k)} {a[k]:.9g} -> {b[k]:.9g}, differs from row {wrong[0, 0]} on"


def compare_results(before: Path, after: Path, pattern: str, repeat: int) -> bool:
    """Print the table of problems; return whether all agree."""
    old, new = ({file.stem for file in (t / "problems").glob("*.yaml")} for t in (before, after))
    print("| problem | largest difference | where | of older runs | verdict before | after |")
    print("|---|---|---|---|---|---|")
    notes, agreed = [f"{name}: in one revision only" for name in sorted(old ^ new)], []
    names = sorted(one for one in old & new if fnmatch(one, pattern))
    if not names:
        sys.exit(f"no problem of both revisions is called {pattern!r}; names, such as 'plan_*'")
    for name in names:
        was, now = run_problem(before, name), run_problem(after, name)
        found = compare(was, now)
        agreed.append(found.agrees)
        (gap, where), *others = sorted(found.gaps, reverse=True)
        runs = [run_problem(before, name) for _ in range(repeat if gap > TOLERANCE else 0)]
        itself = " ".join(f"{max(compare(was, run).gaps)[0]:.0e}" for run in runs)
        cells = ("", name, f"{gap:.0e}", where, itself, was.verdict, now.verdict, "")
        print(" | ".join(cells).strip(), flush=True)
        wide = [where for other, where in others[:8] if other > TOLERANCE]
        notes += [f"{name}: {one}" for one in (*found.words, *wide)]
    print("\n".join(["", *(f"- {note}" for note in notes), ""]))
    print(f"{sum(agreed)} of {len(agreed)} problems agree to {TOLERANCE:g}.")
    return all(agreed)


SOLVERS = ("proxqp equality", "proxqp reduced", "active_set equality", "active_set reduced")
JOBS = (*SOLVERS, "25 pairs of bodies", "three levels", "without inertia")


def make_run(job: str) -> Any:
    """Return a run of tick.py's job or a variant of it, by this process's revision."""
    import collision
    import tick

    from wbc.constraints import Limits
    from wbc.controllers import KinematicController
    from wbc.robot import Robot

    robot = Robot.load("g1")
    solver, formulation = job.split() if job in SOLVERS else ("proxqp", "equality")
    run = tick.make_run(robot, solver, formulation)
    tasks = controlled = run.controller.tasks  # inertia, CoM, torso, posture
    options: dict[str, Any] = {"contacts": run.controller.contacts, "limits": Limits(robot)}
    if job == "25 pairs of bodies":
        options["constraints"] = [collision.watched(robot, "capsule", few=False)]
    elif job == "three levels":
        for task, priority in zip(tasks, (1, 0, 0, 2), strict=True):
            task.priority = priority
    elif job == "without inertia":
        controlled = tasks[1:]
    else:
        return run
    one = KinematicController(robot, controlled, dt=tick.DT, solver=solver, **options)
    run.controller = SimpleNamespace(tasks=tasks, step=one.step)  # targets of all tasks are moved
    return run


def serve() -> None:
    """Answer [job, ticks] by the ticks' CPU times [us] and the configuration reached."""
    runs: dict[str, Any] = {}
    for line in sys.stdin:
        job, ticks = json.loads(line)
        run = runs[job] if job in runs else runs.setdefault(job, make_run(job))
        known = len(run.cpu)
        for _ in range(ticks):
            run.advance()
        times = [1e6 * seconds for seconds in run.cpu[known:]]
        print(json.dumps({"times": times, "q": run.q.tolist()}), flush=True)


class Server:
    """A process that runs ticks of one revision."""

    def __init__(self, tree: Path) -> None:
        # -P: the revision's own benchmarks, not those beside this file
        command = [sys.executable, "-P", __file__, "--serve"]
        paths = {**os.environ, "PYTHONPATH": f"{tree}{os.pathsep}{tree / 'benchmarks'}"}
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        self.process = subprocess.Popen(command, env=paths, text=True, **pipes)

    def run(self, job: str, ticks: int) -> Any:
        print(json.dumps([job, ticks]), file=self.process.stdin, flush=True)
        line = self.process.stdout.readline() if self.process.stdout else ""
        return json.loads(line) if line else sys.exit("a process ended; see its message above")


def compare_times(before: Path, after: Path, rounds: int, ticks: int) -> None:
    """Print the table of ticks; every round has new processes, so that memory lies elsewhere."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # inherited by the processes
    times: dict[str, list[tuple[list[float], list[float]]]] = {}
    apart = dict.fromkeys(JOBS, 0.0)
    for _ in range(rounds):
        pair = (Server(before), Server(after))
        for job in JOBS:
            times.setdefault(job, []).append(taken := ([], []))
            for turn in range(-(-(WARM_UP + ticks) // TURN)):
                for k in (0, 1) if turn % 2 else (1, 0):
                    taken[k].extend(pair[k].run(job, TURN)["times"])
            ends = [server.run(job, 0)["q"] for server in pair]
            apart[job] = max(apart[job], float(np.abs(np.subtract(*ends)).max()))
        for server in pair:
            server.process.communicate()
    print("\n| tick of g1, us | median | after | p99 | after | median's ratio | p99's | apart |")
    print("|---|---|---|---|---|---|---|---|")
    for job, series in times.items():
        both = np.percentile(np.array(series), (50, 99), axis=2)  # (2, rounds, 2)
        cells = [f"{value:.0f}" for value in np.median(both, axis=1).ravel()]
        for ratio in both[..., 1] / both[..., 0]:
            cells.append(f"{np.median(ratio):.3f} ({ratio.min():.3f} to {ratio.max():.3f})")
        print(f"| {job} | {' | '.join(cells)} | {apart[job]:.0e} |")


@contextmanager
def files_of(revision: str) -> Iterator[Path]:
    """Yield a temporary work tree of a revision, with its core compiled."""
    git = ["git", "-C", str(HERE), "worktree"]
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([*git, "add", "--quiet", "--detach", folder, revision], check=True)
        try:
            if (Path(folder) / "setup.py").exists():  # older ones compile their core when asked
                build = [sys.executable, "setup.py", "--quiet", "build_ext", "--inplace"]
                subprocess.run(build, check=True, cwd=folder, stdout=subprocess.DEVNULL)
            yield Path(folder)
        finally:
            subprocess.run([*git, "remove", "--force", folder], check=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--base", default="HEAD", help="the revision to compare with")
    parser.add_argument("--base-dir", type=Path, help="a folder with its files, instead")
    parser.add_argument("--problems", default="*", help="names, as 'plan_*'")
    parser.add_argument("--only", choices=("results", "times"))
    parser.add_argument("--repeat", type=int, default=3, help="runs of the older revision")
    parser.add_argument("--rounds", type=int, default=5, help="of new processes, for times")
    parser.add_argument("--ticks", type=int, default=1000, help="timed in each round")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve()
        return 0
    agree = True
    given = options.base_dir and nullcontext(options.base_dir.resolve())
    with given or files_of(options.base) as before:
        if options.only != "times":
            agree = compare_results(before, HERE, options.problems, options.repeat)
        if options.only != "results":
            compare_times(before, HERE, options.rounds, options.ticks)
    return 0 if agree else 1


if __name__ == "__main__":
    sys.exit(main())
