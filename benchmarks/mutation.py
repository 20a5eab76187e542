"""Which small faults in tasks, constraints, controllers, QPs and inertia do the tests not notice?

Every place is listed where a sign, an operator, a comparison, a condition, a number, a choice such
as ``min`` or a call without result could be wrong. A random sample of these faults is put in, one
by one, and the tests of the same rooms that call the function at fault are run, the quickest first,
until one fails. The compiled core is off, or it would compute what the fault is in; so the files
about it are left out.

    python benchmarks/mutation.py [--faults 300] [--seed 1] [--only qp/kkt.py] [--fresh]

It goes on where it was stopped: what was found is kept in benchmarks/results/mutation_SEED.json,
as is which test calls what. A file that has changed since is tried again.
"""

import argparse
import ast
import hashlib
import importlib
import importlib.machinery
import json
import os
import random
import resource
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from math import sqrt
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = ("wbc/tasks", "wbc/constraints", "wbc/controllers", "wbc/qp", "wbc/robot/inertia.py")
TESTS = ("tests/tasks", "tests/constraints", "tests/controllers", "tests/qp")
TESTS += tuple(f"tests/robot/test_{name}.py" for name in ("state", "kernel", "series", "symbolic"))
LEFT_OUT = ("native_", "daqp_direct.py", "__init__.py")  # files about the core
RESULTS = ROOT / "benchmarks" / "results"
MOST = 25.0  # CPU seconds of tests for one fault; the quickest are taken
SWAPS: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn,
    ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
CHOICES = {"min": "max", "minimum": "maximum", "any": "all", "argmin": "argmax", "lower": "upper"}
CHOICES |= {"zeros": "ones", "floor": "ceil", "sin": "cos", "abs": "float", "less": "greater"}
CHOICES |= {new: old for old, new in CHOICES.items() if new != "float"}
# Faults that change nothing that anyone could see: file, line's text, fault -> why.
EQUIVALENT: dict[tuple[str, str, str], str] = {
    (
        "wbc/qp/native.py",
        "return 2.0 ** math.ceil(-math.log2(largest)) if 1e-12 < largest < 1.0 else 1.0",
        "Lt -> LtE",
    ): "at the one number where it differs nothing depends on it",
    (
        "wbc/controllers/slack.py",
        "return bounds._replace(slack=np.full(bounds.lower.size, weight), push=None)",
        "lower -> upper",
    ): "both ends are as many",
    (
        "wbc/controllers/shaping/motion.py",
        "return time < guide.duration + LINGERING",
        "Lt -> LtE",
    ): "a tick earlier or later",
    (
        "wbc/controllers/shaping/unknowns.py",
        'x = ca.SX.sym("x", n + 3 + 3 * count)',
        "3 -> 4",
    ): "unknowns that nothing uses",
    (
        "wbc/qp/conflict.py",
        "if len(conflict.rows) > MOST_ROWS or _feasible(qp, conflict.rows):",
        "Gt -> GtE",
    ): "a conflict of exactly as many rows is reduced or not",
}


class Fault(NamedTuple):
    """One fault: the file and its hash, the number of the place, the function's line, the words."""

    file: str
    digest: str
    place: int
    function: int
    line: int
    text: str
    what: str

    @property
    def key(self) -> str:
        """The name under which its verdict is kept."""
        return f"{self.file}:{self.digest}:{self.place}"


class Places(ast.NodeTransformer):
    """Goes through a file and counts where faults could be; puts one in at the place wanted."""

    def __init__(self, wanted: int = -1) -> None:
        self.wanted, self.found = wanted, list[tuple[int, int, str]]()
        self._functions = [0]

    def _at(self, node: Any, what: str, change: Callable[[], Any]) -> Any:
        self.found.append((self._functions[-1], node.lineno, what))
        return change() if len(self.found) - 1 == self.wanted else node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Go into a function; annotations and decorators have no faults."""
        first = node.decorator_list[0].lineno if node.decorator_list else node.lineno
        self._functions.append(first)
        node.body = [self.visit(part) for part in node.body]
        node.args.defaults = [self.visit(part) for part in node.args.defaults]
        self._functions.pop()
        return node

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        """Go into a class; decorators have no faults."""
        node.body = [self.visit(part) for part in node.body]
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        """Leave annotations alone."""
        if node.value is not None:
            node.value = self.visit(node.value)
        return node

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        """Leave messages alone."""
        return node

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        """Leave words alone."""
        return node

    def visit_If(self, node: ast.If) -> ast.AST:
        """The other way round."""
        self.generic_visit(node)
        if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            return node
        return self._at(node, "if not", lambda: _set(node, "test", ast.Not(), node.test))

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        """The other one."""
        self.generic_visit(node)
        return self._at(node, "if not", lambda: _set(node, "test", ast.Not(), node.test))

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Another operator."""
        self.generic_visit(node)
        return self._swap(node)

    visit_AugAssign = visit_BoolOp = visit_BinOp

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        """Another comparison, of the first if there are two."""
        self.generic_visit(node)
        swapped = SWAPS[type(node.ops[0])]

        def change() -> ast.AST:
            node.ops[0] = swapped()
            return node

        return self._at(node, f"{type(node.ops[0]).__name__} -> {swapped.__name__}", change)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        """No sign, no negation."""
        self.generic_visit(node)
        return self._at(node, f"no {type(node.op).__name__}", lambda: node.operand)

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        """Another number."""
        if isinstance(node.value, bool):
            return self._at(node, f"{not node.value}", lambda: ast.Constant(not node.value))
        if isinstance(node.value, int | float):
            other = node.value + 1 if isinstance(node.value, int) else 2.0 * node.value + 1e-3
            return self._at(node, f"{node.value} -> {other}", lambda: ast.Constant(other))
        return node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        """Another choice."""
        if node.id in ("min", "max", "any", "all", "abs"):
            return self._at(node, f"{node.id} -> {CHOICES[node.id]}", lambda: _set_name(node, "id"))
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """Another choice."""
        self.generic_visit(node)
        if node.attr in CHOICES and node.attr != "abs":
            what = f"{node.attr} -> {CHOICES[node.attr]}"
            return self._at(node, what, lambda: _set_name(node, "attr"))
        return node

    def visit_Expr(self, node: ast.Expr) -> ast.AST:
        """A call that is left out."""
        self.generic_visit(node)
        if isinstance(node.value, ast.Call):
            return self._at(node, "left out", ast.Pass)
        return node

    def _swap(self, node: Any) -> ast.AST:
        swapped = SWAPS.get(type(node.op))
        if swapped is None:
            return node
        what = f"{type(node.op).__name__} -> {swapped.__name__}"
        return self._at(node, what, lambda: (setattr(node, "op", swapped()), node)[1])


def _set(node: Any, name: str, operator: ast.unaryop, value: ast.expr) -> Any:
    setattr(node, name, ast.UnaryOp(operator, value))
    return node


def _set_name(node: Any, name: str) -> Any:
    setattr(node, name, CHOICES[getattr(node, name)])
    return node


def files() -> list[Path]:
    """Return the files in which faults are made."""
    places = [ROOT / source for source in SOURCES]
    every = [p for one in places for p in (sorted(one.rglob("*.py")) if one.is_dir() else [one])]
    return [p for p in every if not any(part in p.name for part in LEFT_OUT)]


def faults() -> Iterator[Fault]:
    """Yield every fault there could be."""
    for path in files():
        text = path.read_text()
        name, digest = str(path.relative_to(ROOT)), hashlib.sha256(text.encode()).hexdigest()[:8]
        places, lines = Places(), text.splitlines()
        places.visit(ast.parse(text))
        for place, (function, line, what) in enumerate(places.found):
            yield Fault(name, digest, place, function, line, lines[line - 1].strip(), what)


# ---------------------------------------------------------------------- tests


class Watch:
    """A plugin of pytest that notes which test calls what, and for how long it runs."""

    def __init__(self) -> None:
        self.seen: dict[str, dict[str, Any]] = {}
        self._names = {str(path): str(path.relative_to(ROOT)) for path in files()}

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Trace the calls of one test."""
        calls: set[str] = set()
        names = self._names

        def trace(frame: Any, event: str, _: Any) -> None:
            name = names.get(frame.f_code.co_filename)
            if name is not None:
                calls.add(f"{name}:{frame.f_code.co_firstlineno}")

        start = process_time()
        sys.settrace(trace)
        yield
        sys.settrace(None)
        found = self.seen.setdefault(item.nodeid, {"passed": True})
        found |= {"calls": sorted(calls), "seconds": process_time() - start}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Forget tests that do not pass even so."""
        if not report.passed:
            self.seen.setdefault(report.nodeid, {})["passed"] = False


def watched_tests(path: Path) -> dict[str, dict[str, Any]]:
    """Return what every quick test calls, from a file or by running all of them."""
    if not path.exists():
        print("which test calls what: all tests of the rooms are run once", flush=True)
        watch = Watch()

        def run() -> int:
            pytest.main(["-q", "-n0", "-pno:cacheprovider", "-m", "not slow", *TESTS], [watch])
            seen = {key: one for key, one in watch.seen.items() if one["passed"]}
            path.write_text(json.dumps(seen))
            return 0

        _forked(run, 3600)
    stored: dict[str, dict[str, Any]] = json.loads(path.read_text())
    return stored


def chosen_tests(fault: Fault, tests: dict[str, dict[str, Any]]) -> tuple[list[str], float]:
    """Return the tests that call the function at fault, the quickest first, and their time."""
    called = f"{fault.file}:" + (f"{fault.function}" if fault.function else "")
    chosen, spent = list[str](), 0.0
    for name in sorted(tests, key=lambda name: float(tests[name]["seconds"])):
        calls = tests[name]["calls"]
        found = called in calls if fault.function else any(c.startswith(called) for c in calls)
        if found and spent + tests[name]["seconds"] <= MOST:
            chosen.append(name)
            spent += tests[name]["seconds"]
    return chosen, spent


def verdict(fault: Fault, tests: dict[str, dict[str, Any]]) -> str:
    """Put the fault in and return what came of it: killed, endless, survived or never called."""
    chosen, spent = chosen_tests(fault, tests)
    if not chosen:
        return "never called"

    def run() -> int:
        path = ROOT / fault.file
        tree = ast.fix_missing_locations(Places(fault.place).visit(ast.parse(path.read_text())))
        code = compile(tree, str(path), "exec")
        plain = importlib.machinery.SourceFileLoader.get_code
        importlib.machinery.SourceFileLoader.get_code = lambda self, name: (  # type: ignore
            code if self.path == str(path) else plain(self, name)
        )
        with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
            return int(pytest.main(["-qx", "-n0", "-pno:cacheprovider", *chosen]))

    ended = _forked(run, 30 + 5 * spent)
    return "endless" if ended < 0 else "killed" if ended else "survived"


def _forked(run: Callable[[], int], seconds: float) -> int:
    """Return the exit code of ``run`` in a process of its own; negative if it was ended."""
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
            code = run()
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status)


# ---------------------------------------------------------------------- the run


def share(killed: int, total: int) -> str:
    """Return a share with its interval of 95 % (Wilson 1927)."""
    z, p = 1.96, killed / total
    middle, width = p + z * z / (2 * total), z * sqrt(p * (1 - p) / total + (z / (2 * total)) ** 2)
    low, high = ((middle + sign * width) / (1 + z * z / total) for sign in (-1, 1))
    return f"{100 * p:.1f} % (95 %: {100 * low:.1f} to {100 * high:.1f})"


def report(sample: list[Fault], verdicts: dict[str, str]) -> str:
    """Return what became of the faults tried so far."""
    tried = [fault for fault in sample if fault.key in verdicts]
    same = [one for one in tried if (one.file, one.text, one.what) in EQUIVALENT]
    rest = [one for one in tried if one not in same]
    killed = Counter(
        one.file.split("/")[1] for one in rest if verdicts[one.key] in ("killed", "endless")
    )
    total = Counter(one.file.split("/")[1] for one in rest)
    lines = [
        f"{one.file}:{one.line}: {one.what}: {one.text}  [{verdicts[one.key]}]"
        for one in rest
        if verdicts[one.key] in ("survived", "never called")
    ]
    lines += [f"{room}: {killed[room]} of {total[room]} killed" for room in sorted(total)]
    if rest:
        counts = f"{killed.total()} of {len(rest)} faults noticed, "
        lines.append(f"{counts}{share(killed.total(), len(rest))}; {len(same)} equivalent")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--faults", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="part of the files' names")
    parser.add_argument("--fresh", action="store_true", help="forget what was found before")
    options = parser.parse_args()
    os.chdir(ROOT)
    os.environ |= {"OMP_NUM_THREADS": "1", "WBC_NATIVE": "off"}  # before anything looks
    for name in ("coal", "numpy", "pinocchio", "scipy.linalg", "scipy.optimize"):
        importlib.import_module(name)  # here, once; nothing of wbc, which has the faults
    RESULTS.mkdir(exist_ok=True)
    path, watched = RESULTS / f"mutation_{options.seed}.json", RESULTS / "mutation_tests.json"
    if options.fresh:
        path.unlink(missing_ok=True)
        watched.unlink(missing_ok=True)
    every = [fault for fault in faults() if options.only in fault.file]
    sample = random.Random(options.seed).sample(every, min(options.faults, len(every)))
    print(f"{len(sample)} of {len(every)} faults", flush=True)
    tests = watched_tests(watched)
    verdicts: dict[str, str] = json.loads(path.read_text()) if path.exists() else {}
    for fault in sample:
        if fault.key not in verdicts:
            verdicts[fault.key] = verdict(fault, tests)
            path.write_text(json.dumps(verdicts))
    print(report(sample, verdicts))


if __name__ == "__main__":
    main()
