"""Figures in the pages are those of the file that their command wrote.

Every measured number of README and docs stands in a file of the command that is named with it
(``page_figures.py``). Where the place in the file counts, or the file is long, it is a claim:
written here as it stands on the page, with {} for each figure; the other side is where the file has
it. A benchmark that is run again fails these until its page says what came out.
"""

import json
import re
from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.docs.allowed_figures import ALLOWED, OPEN
from tests.docs.from_files import Figures, both, from_json
from tests.docs.human_claims import HUMANS
from tests.docs.page_figures import (
    LONG,
    PAGES,
    ROOT,
    Block,
    blocks_of,
    is_kept,
    measured,
    row_is_kept,
    stands_for,
)

RESULTS = (ROOT / "benchmarks" / "RESULTS.md").read_text("utf-8")
TICK = "its tick [us]"


def rows_of(section: str, title: str) -> list[list[str]]:
    """Return the cells of a table of a section of RESULTS.md, row by row."""
    text = RESULTS.split(f"<!-- {section} -->")[1].split(f"<!-- /{section} -->")[0]
    lines = text.split(f"### {title}\n")[1].split("\n#")[0].splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if "|" in line]
    return [rows[0], *rows[2:]]


def table(section: str, title: str) -> dict[str, dict[str, str]]:
    """Return the cells of a table by the first cell of their row, and by their column."""
    header, *body = rows_of(section, title)
    return {row[0]: dict(zip(header, row, strict=True)) for row in body}


def cells(section: str, title: str, column: str, *rows: str) -> Figures:
    return lambda: [table(section, title)[row][column] for row in rows]


def said(section: str, pattern: str) -> Figures:
    """Return what a pattern's groups match in a section of RESULTS.md."""

    def figures() -> Iterable[str]:
        text = RESULTS.split(f"<!-- {section} -->")[1].split(f"<!-- /{section} -->")[0]
        found = re.search(pattern, text, flags=re.S)
        assert found is not None, f"{section}: {pattern}"
        return found.groups()

    return figures


def survived(side: str, phase: int) -> Figures:
    """Return impulses of the ablation of pushed walks, and of the pendulum's bounds beside it."""

    def figures() -> list[str]:
        lines = (ROOT / "benchmarks" / "walk_ablation.jsonl").read_text("utf-8").splitlines()[1:]
        bounds = json.loads((ROOT / "benchmarks" / "walk_bounds.json").read_text("utf-8"))["rows"]
        found = []
        for name in ("regulated", "planned"):
            rows = [row for row in map(json.loads, lines) if row["variant"] == name]
            walks = [r["impulse"] for r in rows if (r["side"], r["phase"]) == (side, phase)]
            found.append(sum(walks) / len(walks))
        for name in BOUNDS:
            place = name, side, phase
            found += [row["impulse"] for row in bounds
                      if (row["bound"], row["side"], row["phase"]) == place]  # fmt: skip
        return [f"{one:.1f}" for one in found]

    return figures


def turned() -> list[float]:
    """Return by how much the standing foot turns in a step of the walks compared [degrees]."""
    lines = (ROOT / "benchmarks" / "walk_comparison.jsonl").read_text("utf-8").splitlines()[1:]
    walks = [row for row in map(json.loads, lines) if row["group"] == "walk"]
    found = []
    for name in ("free", "regulated", "planned"):
        turns = [row["mean_turned"] for row in walks if row["variant"] == name]
        found.append(sum(turns) / len(turns))
    return found


def standing(name: str) -> Figures:
    """Return how many seeds stood, of how many, and the CoM's error: mean rms, worst [mm]."""

    def figures() -> list[str]:
        known = json.loads((ROOT / "benchmarks" / "standing_motions.json").read_text("utf-8"))
        rows = known[f"{name}, g1"]["seeds"]
        mean = sum(row["com_mm"][0] for row in rows) / len(rows)
        worst = max(row["com_mm"][1] for row in rows)
        return [sum(row["stood"] for row in rows), len(rows), f"{mean:.1f}", f"{worst:.1f}"]

    return figures


LEVEL, PAIRS, TORQUE = "The velocity level", "The velocity level, 25 pairs", "The torque level"
WBC = "wbc active_set", "wbc proxqp"


def ticks_and_loops(row: str, *tables: str) -> Figures:
    """Return tick and loop of a row of the comparison with other libraries, of each table."""
    return lambda: [
        table("peers", title)[row][column] for title in tables for column in (TICK, "median [us]")
    ]


BOUNDS = ("pendulum", *(f"{what}, {most} N m" for most in (35, 120)
                       for what in ("momentum", "inertia")))  # fmt: skip
SEQUENCES = "All sequences, accuracy 1e-06"
OF_SOLVERS = "solved", "shifted geo. mean [us]", "median", "p99"
ENTER = "From Enter to the robot on the page [s]"
CLAIMS: dict[str, tuple[str, str, Figures]] = {
    "README, velocity ticks": (
        "README.md",
        "wbc {}, PlaCo (C++) {}, mink {}, Pink {}; wbc {}, PlaCo {}, mink {}, Pink {}",
        both(
            cells("peers", LEVEL, TICK, WBC[0], "PlaCo (C++)", "mink daqp", "Pink daqp"),
            cells("peers", PAIRS, TICK, WBC[0], "PlaCo (C++)", "mink daqp", "Pink daqp"),
        ),
    ),
    "README, torque ticks": (
        "README.md",
        "wbc {}, PlaCo {}, TSID (C++) {}",
        cells("peers", TORQUE, TICK, WBC[0], "PlaCo (C++)", "TSID (C++)"),
    ),
    "README, with inertia, and with ProxQP": (
        "README.md",
        "{}, {}, {}; {}, {}, {} | `benchmarks/peers/run.py`",
        both(
            *(cells("peers", title, TICK, f"{WBC[0]}, with inertia")
              for title in (LEVEL, PAIRS, TORQUE)),
            *(cells("peers", title, TICK, WBC[1]) for title in (LEVEL, PAIRS, TORQUE)),
        ),
    ),
    **{
        f"figures, {row}": (
            "docs/figures.md",
            f"| {row} | " + " | ".join(["{}, {}"] * len(tables)),
            ticks_and_loops(row, *tables),
        )
        for row, tables in {
            f"{WBC[0]}, with inertia": (LEVEL, PAIRS, TORQUE),
            WBC[1]: (LEVEL, PAIRS, TORQUE),
            "PlaCo (C++)": (LEVEL, PAIRS, TORQUE),
            "mink daqp": (LEVEL, PAIRS),
            "mink proxqp": (LEVEL, PAIRS),
            "Pink daqp": (LEVEL, PAIRS),
            "Pink proxqp": (LEVEL, PAIRS),
        }.items()
    },
    **{
        f"both feet: {name}": (
            "docs/howto/retarget.md", f"| `{name}` | {how} | {{}} of {{}} | {{}}, {{}} mm |",
            standing(name),
        )
        for name, how in (
            ("guide_happy", "as it is | 122 mm in 3.5 s"),
            ("call_normal", "as it is | 64 mm in 5.4 s"),
            ("raise-up-right-hand_normal", "as it is | 22 mm in 2.1 s"),
            ("bow_normal", "2 times slower, lean 10 mm | 38 mm in 8.3 s"),
            ("byebye_happy", "lean 10 mm | 139 mm in 7.0 s"),
        )
    },
    **{
        f"solver {name}": (
            "docs/figures.md", f"| {name} | {{}} | {{}} | {{}} | {{}} |",
            lambda name=name: [table("solvers", SEQUENCES)[name][column] for column in OF_SOLVERS],
        )
        for name in ("active_set", "qpsolvers:daqp", "proxqp_checked", "proxqp", "proxqp_cold",
                     "proxqp_defaults", "proxqp_refreshed", "qpsolvers:piqp",
                     "qpsolvers:proxqp", "qpsolvers:osqp", "qpsolvers:clarabel")
    },
    "from Enter to the robot": (
        "docs/figures.md", "push_g1.yaml` {} s with empty caches, {} s again",
        lambda: [row[3] for row in rows_of("viewer-start", ENTER)[1:3]],
    ),
    **HUMANS,
    "what a hand on a wall is worth": (
        "docs/figures.md",
        "The hand is worth {} times the push without a wall on average and {} times at least.",
        from_json("wall.json", "{:.2f}", *(
            f"hand/by that with no wall/{key}" for key in ("mean", "least")
        )),
    ),
    **{
        f"walk pushed from {side}, {phase}/4": (
            "docs/figures.md", f"| {side}, {phase}/4 | " + " | ".join(["{}"] * 7) + " |",
            survived(side, phase),
        )
        for side in ("back", "right", "front", "left") for phase in range(4)
    },
    "turns of the standing foot": (
        "docs/figures.md",
        "turns by {:.1f} degrees a step on average free, {:.1f} degrees regulated and {:.1f}"
        " degrees planned",
        turned,
    ),
    "robots of others": (
        "docs/howto/own-robot.md",
        "{} load, {} of {} stand and are pushed in our plant, {} of {} in their own MJCF, {} of {}"
        " humanoids walk",
        said("foreign robots", r": (\d+) load.*omega d: (\d+) of (\d+) in our plant, (\d+) of"
             r" (\d+) in.*walk two metres: (\d+) of (\d+)"),
    ),
    "a human's walk in physics": (
        "README.md", "| {} of {} stand over {} steps | `benchmarks/retarget.py` |",
        said("retarget", r"stands in (\d+) of (\d+) walks of (\d+) steps"),
    ),
    "noise without bands": (
        "docs/howto/analyze.md", '"infeasible in {} of {} frames',
        from_json("noise.json", "{}", *(
            f"with 1 mrad/low-pass at 10 Hz, without bands/{key}"
            for key in ("infeasible", "frames")
        )),
    ),
}  # fmt: skip


def as_one_line(text: str) -> str:
    return re.sub(r"\s+", " ", text)


def claimed_on(page: str) -> list[str]:
    """Return what is claimed on a page, figures filled in."""
    claims = (text.format(*figures()) for on, text, figures in CLAIMS.values() if on == page)
    return [as_one_line(claim) for claim in claims]


@pytest.mark.parametrize("claim", CLAIMS)
def test_a_figure_on_a_page_is_that_of_its_file(claim: str) -> None:
    page, text, figures = CLAIMS[claim]
    claimed = as_one_line(text.format(*figures()))
    assert claimed in as_one_line((ROOT / page).read_text("utf-8")), f"{page} lacks: {claimed}"


@pytest.mark.parametrize("page", [str(one.relative_to(ROOT)) for one in PAGES])
def test_every_measured_figure_stands_in_a_file_of_the_command_named_with_it(page: str) -> None:
    if page in OPEN:
        pytest.skip(f"open: {OPEN[page]}")
    allowed = {one for told in ALLOWED.get(page, {}).values() for one in told.split("; ")}
    claims, strange, seen = claimed_on(page), list[str](), set[str]()
    for block in blocks_of(ROOT / page):
        spans = [(block.text.find(one), len(one)) for one in claims if one in block.text]
        held = []
        for at, token in measured(block):
            if any(begin <= at < begin + length for begin, length in spans):
                continue
            if token in allowed:
                seen.add(token)
                continue
            held.append((at, token))
            if not is_kept(token, block.named):
                where = block.text[max(0, at - 60) : at + 60]
                strange.append(f"{token!r}, in no file of {sorted(block.named)}: {where}")
        long = len(held) >= LONG and block.text.startswith("|")
        if long and not row_is_kept(block.text, held, block.named):
            strange.append(f"not together in a file of {sorted(block.named)}: {block.text}")
    assert not strange, "\n".join([page, *strange])
    assert seen == allowed, f"allowed on {page} and not there: {sorted(allowed - seen)}"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("A tick takes 17 us, 3.5 of it.", ["17 us", "3.5"]),
        ("10 of 10 stand, off by 4, 5 and 6 mm", ["10 of 10", "4, 5 and 6 mm"]),
        ("within 1e-9 rad in 20,000 random ticks", ["1e-9 rad", "20,000 random ticks"]),
        (r"`dt=0.005`, [here](a.md#2.5), \(x^2 = 0.5\), g1_27, Python 3.11, eqs. 30 to 37", []),
        ("| squat | 1468 | 2e-3, 5 |", ["2e-3", "1468"]),
    ],
)
def test_a_measured_number_is_found_and_code_is_none(text: str, found: list[str]) -> None:
    block = Block(text, frozenset({"planner.py"}))
    assert [token for _, token in measured(block)] == found


def test_a_number_stands_for_one_that_rounds_to_it() -> None:
    for shown, kept in (("1.6", "1.64"), ("3e-14", "2.9e-14"), ("20", "20"), ("84", "-83.7")):
        assert stands_for(shown, kept)
    for shown, kept in (("1.6", "1.66"), ("1.60", "1.64"), ("3e-14", "2.4e-14"), ("17", "16")):
        assert not stands_for(shown, kept)


def test_a_figure_that_is_in_no_file_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# A\n\n`benchmarks/planner.py`:\n\n| push | 1468 | 2388 |\n\nIn 77.7 ms.\n")
    found = [(token, is_kept(token, one.named)) for one in blocks_of(page)
             for _, token in measured(one)]  # fmt: skip
    assert found == [("1468", True), ("2388", True), ("77.7 ms", False)]
