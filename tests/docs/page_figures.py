"""Measured numbers on pages, and the files in which they must stand.

A page names the command behind a figure where it gives it: in the same row, else in the same
section, else in a section around that. What the command wrote is kept in ``benchmarks/``: its
section of ``RESULTS.md``, ``kept/NAME.txt`` (by ``benchmarks/keep.py``) or its ``.json``. Each
measured number of the page must be among those of that file, to the digits that the page shows;
of a row with :data:`LONG` numbers or more all must stand in one line there, or those of each cell,
or the first of all cells, and the second, and so on.

Files of more than :data:`MOST` numbers are no proof, since some number in them always fits: figures
from them are claims, with their place, in ``test_figures.py``.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
BENCHMARKS = ROOT / "benchmarks"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
MOST = 600
LONG = 4

NUMBER = r"(?<![\w.^/_])[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?(?![\w_]|\.\d)"
UNITS = (
    *("us", "ms", "s", "h", "min", "mm", "cm", "m", "rad", "mrad", "degrees?", "deg", "Hz", "kHz"),
    *("N", "N m", "N s", "kg", "kB", "MB", "GB", "%", "°", "times", "weights?", "M omega d"),
    *(r"kg m\^2(?:/s)?", "m/s", "rad/s", r"rad/s\^2", r"m/s\^2", "rad/s²", "m/s²"),
    *("(?:random |wild )?ticks", "frames", "runs", "QPs", "walks", "trials", "simulations"),
)
SEVERAL = rf"{NUMBER}(?:(?:, | and | to | or |, and |; ){NUMBER})*"
MEASURED = re.compile(
    rf"(?P<of>{NUMBER} of {NUMBER})"
    rf"|(?P<several>{SEVERAL})\s?(?:{'|'.join(sorted(UNITS, key=len, reverse=True))})(?![\w^/])"
    rf"|(?P<decimal>(?<![\w.^/_-])-?\d+\.\d+(?:e-?\d+)?(?![\w.])|(?<![\w.])\d+e-\d+)"
)
# Code, addresses, formulas, sizes of pictures, versions and the paper's sections.
NO_FIGURE = re.compile(
    r"`[^`]*`|\]\([^)]*\)|\\\(.*?\\\)|\$[^$]*\$|<[^>]*>|\{[^}]*\}"
    r"|\b(?:Python|NumPy|SciPy|pin|paper|section|Apache|versions?) [\d.]+(?: to [\d.]+)?"
)
NAMES = re.compile(r"[\w-]+\.(?:py|yaml|jsonl?)\b|wbc bench")
SOURCE = re.compile(r"[\w-]+\.(?:py|yaml)\b|wbc bench")


@dataclass(frozen=True)
class Block:
    """A paragraph, or a row of a table, on one line."""

    text: str
    named: frozenset[str]  # scripts, problems and files, in it or else around it


@dataclass
class Section:
    """What stands below a heading."""

    depth: int
    named: set[str] = field(default_factory=set)
    blocks: list[str] = field(default_factory=list)


def blocks_of(page: Path) -> list[Block]:
    """Return the paragraphs and rows of a page, with what is named for each."""
    above, sections = [Section(0)], [Section(0)]
    around: list[list[Section]] = [above]
    fenced, begins = False, True
    for line in page.read_text("utf-8").splitlines():
        text, section = line.strip(), sections[-1]
        section.named.update(NAMES.findall(line))
        if text.startswith(("```", "~~~")):
            fenced, begins = not fenced, True
        elif fenced or line.startswith("    ") or not text:
            begins = True
        elif found := re.match("(#+) ", text):
            above = [one for one in around[-1] if one.depth < len(found[1])]
            sections.append(Section(len(found[1])))
            around.append([*above, sections[-1]])
            begins = True
        elif begins or text.startswith(("|", "- ", "1. ")):
            section.blocks.append(text)
            begins = text.startswith("|")
        else:
            section.blocks[-1] += f" {text}"
    return [
        Block(text, frozenset(NAMES.findall(text)) or nearest(chain))
        for section, chain in zip(sections, around[: len(sections)], strict=True)
        for text in section.blocks
    ]


def nearest(sections: list[Section]) -> frozenset[str]:
    """Return what is named in the innermost section in which anything is."""
    return next((frozenset(one.named) for one in reversed(sections) if one.named), frozenset())


def hidden(found: re.Match[str]) -> str:
    return " " * len(found[0])


def measured(block: Block) -> Iterator[tuple[int, str]]:
    """Yield where a measured number begins in a block, and it as it stands, with its unit."""
    plain = NO_FIGURE.sub(hidden, block.text)
    for found in MEASURED.finditer(plain):
        yield found.start(), " ".join(found[0].split())
    if plain.startswith("|") and not block.named.isdisjoint(files_of()):
        for cell in re.finditer(rf"(?<=\|)\s*\**({NUMBER}(?:[,;] {NUMBER})*)\**\s*(?=\|)", plain):
            if not MEASURED.search(cell[0]):
                yield cell.start(1), cell[1]


def numbers_in(text: str) -> list[str]:
    return [one.replace(",", "") for one in re.findall(NUMBER, text)]


def leaves(value: Any) -> Iterator[str]:
    """Yield the numbers and texts of a JSON document."""
    if isinstance(value, dict):
        value = [*value, *value.values()]
    if isinstance(value, list):
        for one in value:
            yield from leaves(one)
    elif not isinstance(value, bool) and value is not None:
        yield str(value)


@cache
def files_of() -> dict[str, list[list[str]]]:
    """Return, by script or problem, the lines of numbers that it wrote; of files that are proof."""
    found: dict[str, list[list[str]]] = {}

    def add(names: set[str], text: str) -> None:
        lines = [numbers_in(line) for line in text.splitlines()]
        if sum(map(len, lines)) <= MOST:
            for name in names:
                found.setdefault(name, []).extend(lines)

    for kept in sorted((BENCHMARKS / "kept").glob("*.txt")):
        head = kept.read_text("utf-8").splitlines()[0]
        named = set(SOURCE.findall(head))
        scripts = {one for one in named if one.endswith(".py")}
        add((scripts or named) | {kept.name}, kept.read_text("utf-8"))
    page = (BENCHMARKS / "RESULTS.md").read_text("utf-8")
    for section in re.findall(r"<!-- ([\w -]+) -->(.*?)<!-- /\1 -->", page, flags=re.S):
        add(set(SOURCE.findall(" ".join(re.findall("Command.*", section[1])))), section[1])
    scripts = sorted((one.name for one in BENCHMARKS.glob("*.py")), key=len)
    for kept in sorted(BENCHMARKS.glob("*.json*")):
        text = kept.read_text("utf-8")
        parts = text.splitlines() if kept.suffix == ".jsonl" else [text]
        wrote = [one for one in scripts if kept.stem.startswith(one.removesuffix(".py"))]
        lines = "\n".join(" ; ".join(leaves(json.loads(part))) for part in parts)
        add({kept.name, *wrote[-1:]}, lines)
    return found


def stands_for(shown: str, kept: str) -> bool:
    """Return whether a number of a file is the one that a page shows, to the digits shown there."""
    mantissa, _, power = shown.lower().partition("e")
    digits = len(mantissa.partition(".")[2])
    half = 0.5 * 10.0 ** (int(power or 0) - digits)
    return abs(abs(float(shown)) - abs(float(kept))) <= half * (1.0 + 1e-9)


def is_kept(token: str, names: frozenset[str]) -> bool:
    """Return whether all numbers of a token stand in a line of a file of what is named."""
    shown = numbers_in(token)
    if " of " in token:
        return stand_together(shown, names)
    return all(stand_together([one], names) for one in shown)


def stand_together(shown: list[str], names: frozenset[str]) -> bool:
    """Return whether a line of a file of what is named has all these numbers."""
    lines = [line for name in names for line in files_of().get(name, [])]
    return any(all(any(stands_for(s, k) for k in line) for s in shown) for line in lines)


def row_is_kept(text: str, tokens: list[tuple[int, str]], names: frozenset[str]) -> bool:
    """Return whether the numbers of a row of a table stand together in lines of a file."""
    cells: dict[int, list[str]] = {}
    for at, token in tokens:
        cells.setdefault(text[:at].count("|"), []).extend(numbers_in(token))
    groups = list(cells.values())
    if stand_together([one for group in groups for one in group], names):
        return True
    ways = (groups, zip(*groups, strict=False)) if min(map(len, groups)) > 1 else ()
    return any(all(stand_together(list(one), names) for one in way) for way in ways)
