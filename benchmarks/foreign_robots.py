"""Third-party robot files: which load, agree with another reader, stand, take a push, and walk.

For each URDF and MJCF in a folder, duplicates left out, in a process of its own:

- it is loaded, or refused with a reason; anything but a typed error counts as a fault;
- frames, masses, mass matrix and ranges are compared at three random postures: for a URDF with a
  reader in NumPy, for an MJCF with the model that MuJoCo compiles;
- robots with feet stand for 3 s and are pushed ahead by 0.3 M omega d, in our plant and, for an
  MJCF, in the file's own model under raw MuJoCo;
- humanoids with soles walk two metres at a Froude number of 0.01, or at the fastest speed that the
  walker admits, with default settings.

Every file is a line of the journal, and is not tried twice, except for parts named by ``--again``.
The report counts lines of other code of this package. Files without moving joints, and scenes (an
include and no body of their own), are skipped.

    python benchmarks/foreign_robots.py FOLDER JOURNAL.jsonl [--only PART ...] [--skip PART ...]
        [--again PART ...] [--files LIST.txt] [--limit 240] [--workers 2]
        [--report | --output benchmarks/RESULTS.md]

The first folder of a file's path counts as its source. ``--report`` prints a journal's results.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import hashlib
import json
import logging
import subprocess
import sys
import time
import traceback
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from foreign_reading import compare, reading_of
from foreign_trial import run_trials
from qpbench.page import put_section
from sources import code_of

from wbc import Robot
from wbc.errors import WbcError
from wbc.journal import Journal

AGREED = 1e-9  # beyond it two readers disagree
MOVING = {"revolute", "continuous", "prismatic"}
LONGEST = 240.0  # s for one file
MARK = "foreign robots"


def robot_files(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder that describe a robot, each content once."""
    seen = set()
    for path in sorted((*folder.rglob("*.urdf"), *folder.rglob("*.xml"))):
        if not path.is_file():
            continue
        content = path.read_bytes()
        digest = hashlib.sha256(content).digest()
        if digest in seen or not _is_robot(path.suffix, content):
            continue
        seen.add(digest)
        yield path


def _is_robot(suffix: str, content: bytes) -> bool:
    """Return whether a file has joints that move; one that is no XML is kept, to be refused."""
    try:
        root = ET.fromstring(content)
    except ET.ParseError:
        return suffix == ".urdf"
    if suffix == ".urdf":
        return any(joint.get("type") in MOVING for joint in root.iter("joint"))
    return root.tag == "mujoco" and any(True for _ in root.iter("body"))


def examine(path: Path) -> dict[str, Any]:
    """Return the results of a file, as plain data."""
    began = time.perf_counter()
    found: dict[str, Any] = {}
    try:
        robot = Robot.load(path)
    except WbcError as error:
        return {"refused": f"{type(error).__name__}: {error}".replace(f"{path}: ", "")[:400]}
    found |= {
        "seconds": time.perf_counter() - began,
        "mass": robot.mass,
        "joints": robot.nv - 6,
        "base": "fixed" if robot.fixed_base else "floating",
        "feet": {name: len(foot.polygon) for name, foot in robot.feet.items()},
        "loops": len(robot.loops),
        "notes": list(robot.notes),
    }
    try:
        found["differs"] = compare(robot, reading_of(path, robot), seed=1)._asdict()
    except (ValueError, KeyError, ArithmeticError, RuntimeError, ET.ParseError) as error:
        found["unread"] = f"{type(error).__name__}: {error}"[:200]
    return found | run_trials(path, robot)


def examine_in_process(path: Path, limit: float) -> dict[str, Any]:
    """Return the results of a file from its own process, which may take ``limit`` seconds."""
    command = [sys.executable, __file__, "--one", str(path)]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, timeout=limit, check=False)
    except subprocess.TimeoutExpired:
        return {"fault": f"took more than {limit:g} s"}
    last = ended.stdout.strip().splitlines()[-1:]
    if ended.returncode or not last:
        return {"fault": f"ended with {ended.returncode}: {ended.stderr.strip()[-300:]}"}
    told: dict[str, Any] = json.loads(last[0])
    return told


def one(path: Path) -> None:
    """Examine a file and print a line of JSON; an unexpected error is a fault, with its place."""
    logging.disable(logging.WARNING)
    try:
        found = examine(path)
    except Exception as error:  # that there is none is what is to be shown
        place = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
        found = {"fault": what[:400]}
    print(json.dumps(found, default=float))


# ---------------------------------------------------------------------- reports


def verdicts(entry: dict[str, Any]) -> dict[str, str]:
    """Return a row of the table, by column."""
    file = entry["file"]
    if "fault" in entry or "refused" in entry:
        reason = entry.get("fault") or entry["refused"]
        kind = "fault" if "fault" in entry else "refused"
        return {"file": file, "loads": f"{kind}: {reason}"}
    differs = entry.get("differs")
    feet = "+".join(map(str, entry["feet"].values())) or entry["base"]
    worst = max(v for k, v in differs.items() if k != "compared") if differs else None
    return {
        "file": file,
        "loads": f"{entry['joints']} joints, {entry['mass']:.4g} kg, {feet}",
        "differs": entry.get("unread", "?") if worst is None else f"{worst:.0e}",
        "stands": _said(entry.get("plant"), "stood"),
        "own": _said(entry.get("own"), "stood"),
        "walks": _said(entry.get("walk"), "walked"),
    }


def _said(trial: dict[str, Any] | None, key: str) -> str:
    if trial is None:
        return ""
    if "refused" in trial:
        return f"refused: {trial['refused'][:120]}"
    if trial[key] is None:
        return "" if trial["why"] in ("fixed base", "not two flat feet") else trial["why"]
    return "yes" if trial[key] else f"no: {trial['why']}"


def summary(entries: Sequence[dict[str, Any]], code: str) -> list[str]:
    """Return the totals, including how many lines are of the present code."""
    loaded = [entry for entry in entries if "joints" in entry]
    worst = [max(v for k, v in e["differs"].items() if k != "compared")
             for e in loaded if "differs" in e]  # fmt: skip
    counts = Counter(entry["file"].split("/")[0] for entry in entries)

    def of(trial: str, key: str) -> str:
        answers = [e[trial].get(key) for e in loaded if trial in e]
        return f"{sum(a is True for a in answers)} of {sum(a is not None for a in answers)}"

    others = sum(entry["code"] != code for entry in entries)
    refused = sum("refused" in entry for entry in entries)
    faults = [entry["file"] for entry in entries if "fault" in entry]
    apart = [e["file"] for e, w in zip([e for e in loaded if "differs" in e], worst, strict=True)
             if not w <= AGREED]  # fmt: skip
    return [
        f"{len(entries)} files of {len(counts)} sources: {len(loaded)} load, {refused} are refused"
        f" with a reason, {len(faults)} end in anything else{': ' if faults else ''}"
        + ", ".join(faults),
        f"compared with another reader: {len(worst)}, apart by {max(worst, default=0.0):.1e} at"
        f" most; more than {AGREED:g}: {', '.join(apart) or 'none'}",
        f"stand for 3 s and take 0.3 M omega d: {of('plant', 'stood')} in our plant,"
        f" {of('own', 'stood')} in the file's own model under raw MuJoCo",
        f"humanoids with soles that walk two metres: {of('walk', 'walked')}",
        f"found with other code of this package than the present: {others} of {len(entries)}",
    ]


def table(entries: Sequence[dict[str, Any]]) -> list[str]:
    """Return a Markdown table of all files."""
    columns = ("file", "loads", "differs", "stands", "own", "walks")
    heads = ("file", "loads: joints, mass, corners of feet", "differs", "stands", "in its own MJCF",
             "walks 2 m")  # fmt: skip
    lines = ["| " + " | ".join(heads) + " |", "|" + " --- |" * len(heads)]
    for entry in sorted(entries, key=lambda e: e["file"]):
        row = verdicts(entry)
        cells = (" ".join(row.get(name, "").split()).replace("|", "/") for name in columns)
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("journal", type=Path, nargs="?")
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--only", nargs="+", default=[""], help="parts of paths")
    parser.add_argument("--skip", nargs="+", default=[], help="parts of paths to pass over")
    parser.add_argument("--again", nargs="+", default=[], help="parts of paths to try once more")
    parser.add_argument("--files", type=Path, help="a list of paths below the folder, one a line")
    parser.add_argument("--limit", type=float, default=LONGEST, help="seconds for one file")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--report", action="store_true", help="only tell what the journal holds")
    parser.add_argument("--output", type=Path, help="a Markdown file, in which a part is replaced")
    options = parser.parse_args()
    if options.one is not None:
        one(options.one)
        return
    if options.folder is None or options.journal is None:
        parser.error("give a folder and a journal")
    code = code_of()
    if options.report:
        lines = options.journal.read_text(encoding="utf-8").splitlines()
        entries = [json.loads(line) for line in lines[1:]]
    else:
        with Journal(options.journal, {"kind": MARK}) as journal:
            entries = list(journal.entries)
            known = {
                entry["file"]
                for entry in entries
                if not any(part in entry["file"] for part in options.again)
            }
            names = {path.relative_to(options.folder).as_posix(): path for path in _wanted(options)}
            with ThreadPoolExecutor(options.workers) as pool:
                waiting = {
                    pool.submit(examine_in_process, path, options.limit): name
                    for name, path in names.items()
                    if name not in known
                }
                for done in as_completed(waiting):
                    entry = {"file": waiting[done], "code": code, **done.result()}
                    journal.add(entry)
                    entries.append(entry)
                    print(" | ".join(verdicts(entry).values()), flush=True)
    entries = list({entry["file"]: entry for entry in entries}.values())  # the last of each
    print("\n".join(summary(entries, code)))
    if options.output is not None:
        command = "python benchmarks/foreign_robots.py FOLDER JOURNAL --output"
        points = [f"- {line}" for line in summary(entries, code)]
        lines = [f"Command: {command} {options.output}", "", *points, "", *table(entries)]
        put_section(options.output, MARK, "\n".join(lines).replace(f"{options.folder}/", ""))


def _wanted(options: argparse.Namespace) -> Iterator[Path]:
    folder: Path = options.folder
    if options.files is not None:
        names = options.files.read_text(encoding="utf-8").split("\n")
        yield from (folder / name for name in names if name.strip())
        return
    for path in robot_files(folder):
        name = path.relative_to(folder).as_posix()
        wanted = any(part in name for part in options.only)
        if wanted and not any(part in name for part in options.skip):
            yield path


if __name__ == "__main__":
    main()
