"""A campaign file: problems x cases x a grid of values x seeds, all checked beforehand.

Each run is a problem with values that replace those of its file. Wrong names and numbers are found
before the first run: every combination is validated like a file, and every value is built once,
with the first of the others.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shlex import quote
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from wbc.errors import InvalidInputError, ProblemFileError
from wbc.files import beside
from wbc.problem.controller_spec import GlobalSpec, TorqueSpec
from wbc.problem.mistakes import Mistakes, read_section
from wbc.problem.overrides import apply_overrides
from wbc.problem.problem import load_problem
from wbc.problem.provenance import digests_of_files
from wbc.problem.section import Distinct, Forms, Name, Names, NonEmpty, Section
from wbc.problem.source import KeyPath, Source
from wbc.problem.spec import PlainName, ProblemSpec
from wbc.problem.walk import read_problem
from wbc.problem.yaml_reader import read_source

MOST_RUNS = 1_000_000
Values = dict[Name, Any]
Span = Annotated[list[Any], Field(min_length=2, max_length=2)]
Seeds = Annotated[
    Annotated[int, Field(ge=1)] | NonEmpty[Annotated[int, Field(ge=0)]],
    Forms("how many from 0 on, or a list of whole numbers"),
]


class CampaignSpec(Section):
    """Problems times cases times grid times seeds."""

    version: Literal[1] = 1
    """Version of this format."""
    problems: Annotated[Names, Distinct]
    """Problem files, relative to this one."""
    set: Values = Field(default_factory=dict)
    """Values by key path that replace those of every problem, as `--set` of `wbc run` does."""
    cases: Annotated[dict[PlainName, Values], Field(min_length=1)] | None = None
    """The same by names of your choice: every problem is run in every case."""
    grid: dict[Name, Annotated[list[Any], Field(min_length=1)]] = Field(default_factory=dict)
    """Lists of values by key path: every combination is run."""
    seeds: Seeds | None = None
    """How many seeds, from 0 on, or a list of them: what is random in a problem, and what is drawn
    below, is another with each."""
    draw: dict[Name, Span] = Field(default_factory=dict)
    """Values by key path that are drawn evenly between the two given, numbers or lists alike."""


@dataclass(frozen=True)
class Run:
    """One run of a campaign."""

    number: int  # from 0 on
    problem: str  # the problem's name in this campaign
    path: Path  # and its file
    case: str | None  # the name of its case, if there are cases
    seed: int | None  # if there are seeds
    overrides: Mapping[str, Any]  # everything that replaces the file's values, by key path

    def describe(self) -> str:
        """Return the parameters of this run, in words."""
        told = [f"{path}={_short(value)}" for path, value in self.overrides.items()]
        case = [] if self.case is None else [f"case {self.case}"]
        seed = [] if self.seed is None else [f"seed {self.seed}"]
        return f"run {self.number} ({', '.join([self.problem, *case, *seed, *told])})"


@dataclass(frozen=True)
class Campaign:
    """A campaign file, read and checked."""

    path: Path  # the file
    spec: CampaignSpec  # what it says
    texts: Mapping[str, str]  # the problems' texts by name
    files: Mapping[str, Mapping[str, str]]  # digests of the files that each of them names
    # In order: problem by problem, case by case, the last key of the grid and then seeds fastest.
    runs: tuple[Run, ...]

    def inputs(self) -> dict[str, Any]:
        """Return all inputs that the results depend on, as plain data."""
        inputs = {"campaign": self.spec.model_dump(mode="json"), "problems": dict(self.texts)}
        files = {name: dict(found) for name, found in self.files.items() if found}
        return {**inputs, "files": files} if files else inputs


def load_campaign(path: str | Path) -> Campaign:
    """Read a campaign file and its problems, and check every run.

    Raises
    ------
    ProblemFileError
        With every mistake that was found: file, line and key path.
    """
    if not isinstance(path, str | Path) or str(path) == "-":
        raise InvalidInputError(f"load_campaign: expected the path of a file, got {str(path)!r}")
    path = Path(path)
    source = read_source(path, "'problems:'")
    if "problems" not in source.data and source.data.keys() & {"robot", "tasks", "model"}:
        raise ProblemFileError(
            f"{path}: is a problem, not a campaign of problems: wbc run {quote(str(path))};"
            f" a campaign names it: problems: [{path.name}]"
        )
    spec = read_section(CampaignSpec, source)
    mistakes = Mistakes(source)
    if spec.draw and spec.seeds is None:
        mistakes.fail(("draw",), "is drawn by seed: give seeds: 10, or a list of them")
    for drawn in spec.grid.keys() & spec.draw.keys():
        mistakes.note(("grid", drawn), "is drawn as well, in place of these values; leave one out")
    if isinstance(spec.seeds, tuple) and len(set(spec.seeds)) < len(spec.seeds):
        mistakes.fail(("seeds",), "a seed is there twice, which would be the same run")
    files, sources = {}, {}
    for name, text in _names(spec.problems).items():
        with mistakes.at("problems", spec.problems.index(text)):
            files[name] = beside(path.parent, text)
            sources[name] = read_source(files[name])
            load_problem(files[name], spec.set)
    mistakes.raise_any()
    places = [str(beside(path.parent, text).resolve()) for text in spec.problems]
    for key, values in ((("problems",), places), *((("grid", k), v) for k, v in spec.grid.items())):
        texts = [json.dumps(value, default=str) for value in values]
        for k, text in enumerate(texts):
            if text in texts[:k]:
                mistakes.note((*key, k), f"{text} is there twice, which would be the same run")
    mistakes.raise_any()
    seeds = range(spec.seeds) if isinstance(spec.seeds, int) else spec.seeds or (None,)
    count = len(files) * len(spec.cases or "1") * len(seeds)
    for values in spec.grid.values():
        count *= len(values)
    if count > MOST_RUNS:
        mistakes.fail((), f"{count:,} runs; at most {MOST_RUNS:,} are one campaign")
    for file in files.values():
        _check_values(spec, file, mistakes)
    mistakes.raise_any()
    runs = tuple(_runs(spec, files, sources, list(seeds), mistakes))
    replacing = (spec.set, spec.cases, spec.grid)
    named = {
        name: digests_of_files((one.data, *replacing), files[name].parent)
        for name, one in sources.items()
    }
    return Campaign(path, spec, {name: one.text for name, one in sources.items()}, named, runs)


def _names(problems: tuple[str, ...]) -> dict[str, str]:
    """Return the files by name: the stem if it is unique."""
    stems = [Path(file).stem for file in problems]
    return {
        stem if stems.count(stem) == 1 else file: file
        for stem, file in zip(stems, problems, strict=True)
    }


def _check_values(spec: CampaignSpec, file: Path, mistakes: Mistakes) -> None:
    """Build a problem with each value once, and the first of all others; of draws also a middle.

    Where a whole number is wanted the ends may be some, and no draw is.
    """
    cases = spec.cases or {}
    first_of_grid = {key: values[0] for key, values in spec.grid.items()}
    first = _over(spec.set, next(iter(cases.values()), {}), first_of_grid)
    ends = [{key: span[k] for key, span in spec.draw.items()} for k in (0, 1)]
    tried: list[tuple[KeyPath, dict[str, Any]]] = []
    tried += [(("draw",), _over(first, end)) for end in (ends if spec.draw else [])]
    for name, case in cases.items():
        tried.append((("cases", name), _over(spec.set, case, first_of_grid)))
    for key, values in spec.grid.items():
        tried += [(("grid", key, k), {**first, key: value}) for k, value in enumerate(values)]
    done = set[str]()
    for place, overrides in tried:
        text = json.dumps(overrides, default=str)
        if text not in done:
            done.add(text)
            with mistakes.at(*place):
                load_problem(file, overrides)
    for key, (low, high) in spec.draw.items():
        with mistakes.at("draw", key):
            _uniform(np.random.default_rng(0), low, high)
    if spec.draw:
        mistakes.raise_any()
        with mistakes.at("draw"):
            load_problem(file, _over(first, _draws(spec, 0)))


def _runs(
    spec: CampaignSpec,
    files: Mapping[str, Path],
    sources: Mapping[str, Source],
    seeds: list[int | None],
    mistakes: Mistakes,
) -> Iterator[Run]:
    """Yield the runs, every combination validated like a file."""
    numbers = itertools.count()
    cases: Mapping[str | None, Values] = spec.cases or {None: {}}  # type: ignore[assignment]
    for problem, case in itertools.product(files, cases):
        for combination in itertools.product(*spec.grid.values()):
            chosen = dict(zip(spec.grid, combination, strict=True))
            overrides = _over(spec.set, cases[case], chosen)
            place = ("grid",) if chosen else ("cases", case) if case else ()
            found = mistakes.require(place, partial(_checked, sources[problem], overrides))
            seeded = _seed_paths(found)
            if seeds != [None] and not (seeded or spec.draw):
                mistakes.fail(("seeds",), f"nothing is random in {problem}; remove them, or draw")
            whole = overrides.get("controller", {})
            searched = found is not None and isinstance(found.controller, GlobalSpec)
            if searched and "workers" not in whole:
                # The campaign has its own processes; results do not depend on the number of
                # workers.
                workers = overrides.get("controller.workers", 1)
                overrides = {**overrides, "controller.workers": workers}
            for seed in seeds:
                given = (
                    {} if seed is None else {**dict.fromkeys(seeded, seed), **_draws(spec, seed)}
                )
                path = files[problem].resolve()
                yield Run(next(numbers), problem, path, case, seed, _over(overrides, given))


def _over(*layers: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by key path, in the order in which they replace each other: narrower later."""
    found = dict[str, Any]()
    for path, value in itertools.chain.from_iterable(layer.items() for layer in layers):
        found.pop(path, None)
        found[path] = value
    return found


def _checked(source: Source, overrides: Mapping[str, Any]) -> ProblemSpec | None:
    """Validate a problem like a file and return its description; None for a pendulum's."""
    changed = apply_overrides(source, overrides)
    return None if "model" in changed.data else read_problem(changed)


def _seed_paths(spec: ProblemSpec | None) -> tuple[str, ...]:
    """Return the key paths of a problem's seeds."""
    if spec is not None and isinstance(spec.controller, GlobalSpec):
        return ("controller.seed",)
    if spec is not None and isinstance(spec.controller, TorqueSpec):
        made = spec.simulation
        used = {"sensors": made.sensors, "model_error": made.model_error, "devices": made.estimate}
        return tuple(f"simulation.{name}.seed" for name, given in used.items() if given)
    return ()


def _draws(spec: CampaignSpec, seed: int) -> dict[str, Any]:
    """Return the values drawn with a seed: the same for all problems and cases, in any order."""
    return {
        key: _uniform(np.random.default_rng([seed, *key.encode()]), *span)
        for key, span in spec.draw.items()
    }


def _uniform(random: np.random.Generator, low: Any, high: Any) -> Any:
    """Return a uniform sample between two numbers, or two lists of them, entry by entry."""
    if isinstance(low, list) and isinstance(high, list) and len(low) == len(high):
        return [_uniform(random, a, b) for a, b in zip(low, high, strict=True)]
    numbers = [one for one in (low, high) if type(one) in (int, float) and np.isfinite(one)]
    if len(numbers) < 2:
        raise InvalidInputError(
            f"expected two numbers, or two lists alike, got {[low, high]}; choices go into grid:"
        )
    if not 0.0 <= high - low < np.inf:
        raise InvalidInputError(f"expected the lower number first, got {[low, high]}")
    return float(random.uniform(low, high))


def _short(value: Any) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) <= 40 else f"{text[:37]}..."
