"""Figures in the pages are those of the file that their command wrote.

What is claimed is written here as it stands on the page, with {} for each figure; the other side is
where the file has it. A benchmark that is run again fails these until its page says what came out.
"""

import json
import re
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RESULTS = (ROOT / "benchmarks" / "RESULTS.md").read_text("utf-8")
TICK = "its tick [us]"
Figures = Callable[[], Iterable[object]]


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


def from_json(name: str, form: str, *paths: str) -> Figures:
    """Return numbers of a file by their places, keys with ``/`` between them, as text."""

    def figures() -> list[str]:
        found = []
        for path in paths:
            value = json.loads((ROOT / "benchmarks" / name).read_text("utf-8"))
            for key in path.split("/"):
                value = value[int(key)] if isinstance(value, list) else value[key]
            found.append(form.format(value))
        return found

    return figures


def both(*parts: Figures) -> Figures:
    return lambda: [figure for part in parts for figure in part()]


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


SEQUENCES = "All sequences, accuracy 1e-06"
OF_SOLVERS = "solved", "shifted geo. mean [us]", "median", "p99"
ENTER = "From Enter to the robot on the page [s]"
HUMAN = "against_plates", "without_static_trial"
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
        f"who stays on both feet: {name}": (
            "docs/howto/retarget.md", f"| `{name}` | {how} | {{}} of {{}} | {{}}, {{}} mm |",
            standing(name),
        )
        for name, how in (
            ("guide_happy", "as it is | 73 mm in 3.5 s"),
            ("call_normal", "as it is | 63 mm in 5.4 s"),
            ("raise-up-right-hand_normal", "as it is | 19 mm in 2.1 s"),
            ("bow_normal", "2 times slower, lean 10 mm | 98 mm in 8.3 s"),
            ("byebye_happy", "lean 10 mm | 148 mm in 7.0 s"),
        )
    },
    **{
        f"solver {name}": (
            "docs/figures.md", f"| {name} | {{}} | {{}} | {{}} | {{}} |",
            lambda name=name: [table("solvers", SEQUENCES)[name][column] for column in OF_SOLVERS],
        )
        for name in ("active_set", "qpsolvers:daqp", "proxqp_checked", "proxqp", "proxqp_cold",
                     "qpsolvers:piqp", "qpsolvers:proxqp", "qpsolvers:osqp", "qpsolvers:clarabel")
    },
    "from Enter to the robot": (
        "docs/figures.md", "push_g1.yaml` {} s with empty caches, {} s again",
        lambda: [row[3] for row in rows_of("viewer-start", ENTER)[1:3]],
    ),
    "a human's markers": (
        "docs/howto/humans.md", "| markers, rms | {} mm |",
        from_json("human_walk.json", "{:.1f}", "markers_mm"),
    ),
    **{
        name: ("docs/howto/humans.md", f"| {name} | {{}} {unit} | {{}} {unit} |",
               from_json("human_walk.json", form, *(f"{one}/{key}" for one in HUMAN)))
        for name, unit, form, key in (
            ("vertical force, rms by its peak", "%", "{:.1f}", "vertical_percent_of_peak"),
            ("horizontal force, rms by its peak", "%", "{:.1f}", "horizontal_percent_of_peak"),
            ("CoP in single support, rms", "mm", "{:.0f}", "cop_single_mm"),
            ("CoP in double support, rms", "mm", "{:.0f}", "cop_double_mm"),
            ("all of these together", "%", "{:.1f}", "within_all_bands_percent"),
        )
    },
    "a second human's markers, forces and CoP": (
        "docs/howto/humans.md",
        "markers {} mm; vertical force {} %, horizontal {} %; CoP {} mm in single and {} mm in"
        " double support; {} % within the bands",
        both(
            from_json("human_walk_treadmill.json", "{:.1f}", "markers_mm",
                      "against_plates/vertical_percent_of_peak",
                      "against_plates/horizontal_percent_of_peak"),
            from_json("human_walk_treadmill.json", "{:.0f}", "against_plates/cop_single_mm",
                      "against_plates/cop_double_mm"),
            from_json("human_walk_treadmill.json", "{:.1f}",
                      "against_plates/within_all_bands_percent"),
        ),
    ),
    "what a hand on a wall is worth": (
        "docs/figures.md",
        "The hand is worth {} times the push without a wall on average and {} times at least.",
        from_json("wall.json", "{:.2f}", *(
            f"hand/by that with no wall/{key}" for key in ("mean", "least")
        )),
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


@pytest.mark.parametrize("claim", CLAIMS)
def test_a_figure_on_a_page_is_that_of_its_file(claim: str) -> None:
    page, text, figures = CLAIMS[claim]
    claimed = as_one_line(text.format(*figures()))
    assert claimed in as_one_line((ROOT / page).read_text("utf-8")), f"{page} lacks: {claimed}"
