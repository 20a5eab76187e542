"""What README and documentation show runs: Python as it stands, YAML and commands as they parse.

Fences: ``python`` is ours, run in the order of the page as one program; ``{.python}`` includes an
example, which a test of its own runs. ``py`` with a title is code of others, which only must
compile. ``yaml`` is a problem, or sections of one that are put into a small problem, or a campaign
of small problems. ``sh`` holds command lines, of which ``wbc`` is parsed and ``make`` looked up.
"""

import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
from ruamel.yaml import YAML

from wbc.cli import app
from wbc.problem import load_problem
from wbc.problem.campaign import load_campaign
from wbc.problem.retarget import load_retarget

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FENCE = re.compile(
    r"^([ ]*)``` ?(\w*|{\.python})(?: +title=\"([^\"]+)\")?\n(.*?)^\1```$", re.DOTALL | re.MULTILINE
)
LANGUAGES = {"python", "{.python}", "py", "yaml", "sh", "text"}
EXAMPLE = re.compile(r'--8<-- "(examples/\w+\.py)"')
# What a fragment of a problem file is put into.
SMALL = """
robot: hoap2_like
support: double
tasks:
  com: {type: com, target: {offset: [0, 0, 0]}}
  posture: {type: posture, weight: 0.01}
stop: {duration: 0.01}
"""


def blocks(path: Path, language: str) -> list[str]:
    """Return the blocks of a language, without the indentation of the list they stand in."""
    found = []
    for indent, name, _, body in FENCE.findall(path.read_text(encoding="utf-8")):
        if name == language:
            found.append("\n".join(line.removeprefix(indent) for line in body.splitlines()))
    return found


def pages_with(language: str) -> list[Path]:
    return [path for path in PAGES if blocks(path, language)]


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_every_block_says_what_it_is() -> None:
    for path in PAGES:
        text = path.read_text(encoding="utf-8")
        fences = FENCE.findall(text)
        count = len(re.findall(r"^ *```", text, flags=re.MULTILINE))
        assert count == 2 * len(fences), named(path)
        for _, language, title, _ in fences:
            assert language in LANGUAGES, named(path)
            assert (language == "py") == bool(title), f"{named(path)}: py is others' code"


@pytest.mark.slow
@pytest.mark.parametrize("path", pages_with("python"), ids=named)
def test_python_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "problems").symlink_to(ROOT / "problems")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "__main__"}
    for number, block in enumerate(blocks(path, "python")):
        exec(compile(block, f"{named(path)}, block {number}", "exec"), names)
    assert len(names) > 2, "a page's program gives names to something"


def test_included_examples_exist_and_code_of_others_compiles() -> None:
    for path in PAGES:
        for block in blocks(path, "{.python}"):
            found = EXAMPLE.fullmatch(block)
            assert found and (ROOT / found[1]).is_file(), f"{named(path)}: {block}"
        for block in blocks(path, "py"):
            assert compile(block, named(path), "exec").co_names, f"{named(path)}: {block}"


@pytest.mark.slow
@pytest.mark.parametrize("path", pages_with("yaml"), ids=named)
def test_problems_are_valid(path: Path, tmp_path: Path) -> None:
    yaml = YAML(typ="safe")
    planned = [block for block in blocks(path, "yaml") if "plan" in yaml.load(block)]
    for number, block in enumerate(blocks(path, "yaml")):
        given = yaml.load(block)
        file = tmp_path / f"{number}.yaml"
        for plan in re.findall(r"{plan: (\w+\.yaml)", block):  # the page's own
            (tmp_path / plan).write_text(planned[0], encoding="utf-8")
        if "problems" in given:
            file.write_text(block, encoding="utf-8")
            for problem in given["problems"]:
                (tmp_path / problem).write_text(SMALL, encoding="utf-8")
            assert load_campaign(file).runs, block
            continue
        if "motion" in given:
            file.write_text(block, encoding="utf-8")
            assert load_retarget(file)["robot"] == given["robot"], block
            continue
        if "robot" in given or "model" in given:
            file.write_text(block, encoding="utf-8")
        else:
            whole = yaml.load(SMALL)
            tasks = {**whole["tasks"], **given.get("tasks", {})}
            with file.open("w", encoding="utf-8") as out:
                yaml.dump({**whole, **given, "tasks": tasks}, out)
        assert load_problem(file).parts, block


def commands(path: Path) -> list[str]:
    lines = [line.strip() for block in blocks(path, "sh") for line in block.splitlines()]
    return [line for line in lines if line and not line.startswith("#")]


@pytest.mark.parametrize("path", pages_with("sh"), ids=named)
def test_commands_parse(path: Path) -> None:
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    for line in commands(path):
        words = shlex.split(line.partition(" > ")[0], comments=True)
        if words[0] == "wbc":
            parse(words[1:])
        elif words[0] == "make":
            assert words[1] in targets, line
        else:
            assert words[:2] in (
                ["pip", "install"],
                [".venv/bin/python", "setup.py"],
                ["git", "clone"],
                [".", ".venv/bin/activate"],
            ) or words[0] in ("cd", "python")
        for word in words:
            if word.startswith(("problems/", "examples/", "benchmarks/")):
                assert (ROOT / word).is_file(), line

    # Who pastes a page's commands in order meets no file that is not there.
    made = set[str]()
    for line in commands(path):
        words = shlex.split(line, comments=True)
        if words[0] != "wbc":
            continue
        if words[1] == "init":
            made.add(words[2])
        elif words[1] == "retarget" and "--problem" in words:
            made.add(words[words.index("--problem") + 1])
        elif len(words) > 2 and words[2].endswith(".yaml"):
            assert words[2] in made or (ROOT / words[2]).is_file(), line


@cache
def command_line() -> Any:
    return typer.main.get_command(app)


def parse(words: list[str]) -> None:
    """Let the command line parse its arguments, without running anything."""
    group = command_line()
    context = group.make_context("wbc", list(words))
    rest = [*getattr(context, "_protected_args", ()), *context.args]
    name, command, arguments = group.resolve_command(context, rest)
    command.make_context(name, arguments, parent=context)


def test_a_wrong_command_does_not_parse() -> None:
    parse(["run", "problems/fig6a_g1.yaml", "--plot", "a.png"])
    for wrong in (["runs", "a.yaml"], ["run", "a.yaml", "--plots", "a.png"], ["run"]):
        with pytest.raises(Exception, match=r"No such|[Mm]issing"):
            parse(wrong)


PICTURES = re.compile(r"!\[[^]]*\]\(([^)]+)\)|<img [^>]*?src=\"([^\"]+)\"")


def test_pictures_are_there_large_enough_and_all_shown() -> None:
    shown = set()
    for path in PAGES:
        for pair in PICTURES.findall(path.read_text(encoding="utf-8")):
            picture = (path.parent / max(pair)).resolve()
            shown.add(picture)
            # An 8-byte signature, and then the width of a picture [pixels].
            content = picture.read_bytes()
            assert content.startswith(b"\x89PNG\r\n\x1a\n"), f"{named(path)}: {pair}"
            assert int.from_bytes(content[16:20], "big") >= 600, f"{named(path)}: {pair}"
    assert set((ROOT / "docs" / "pictures").glob("*.png")) <= shown


def test_named_files_exist() -> None:
    tests = {test.name for test in (ROOT / "tests").rglob("test_*.py")}
    for path in PAGES:
        text = path.read_text(encoding="utf-8")
        assert set(re.findall(r"`(?:[\w/]+/)?(test_\w+\.py)", text)) <= tests, named(path)
        for name in re.findall(r"`((?:examples|benchmarks|problems)/[\w./]+\.(?:py|yaml))", text):
            assert (ROOT / name).is_file(), f"{named(path)}: {name}"
