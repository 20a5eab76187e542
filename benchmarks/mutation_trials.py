"""Tries faults on tests: which tests call the faulty function, and does one of them fail?

The tests are collected once, in their own process. Each fault is then tried in a child of it, in
which the faulty functions get other code. A fault outside functions (a constant, a default) is
tried in a child of the first process, which has not imported the package yet.
"""

import ast
import gc
import hashlib
import importlib.machinery
import json
import os
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from types import CodeType, FunctionType
from typing import Any

import pytest

from benchmarks.mutation_places import ROOT, Fault, Places, files, source

ROOMS = "tasks constraints controllers qp reference native loops shaping run problem gait flight"
TESTS = tuple(f"tests/{room}" for room in (*ROOMS.split(), "tracking", "simulation"))
TESTS += tuple(
    f"tests/robot/test_{name}.py" for name in ("state", "kernel", "series", "collision_bounds")
)
TESTS += ("--ignore=tests/shaping/test_search_all.py",)  # of processes that import anew, by time
WHOLE = "bad_input defaults errata public_names reduction validate what_callers_give"
TESTS += tuple(f"tests/test_{name}.py" for name in WHOLE.split())
WARM = ("hoap2_like", "g1_27", "talos", "icub", "romeo", "mixed_joints")  # no faults in loading
ALWAYS = "tests/test_defaults.py"  # looks at signatures, and calls nothing
MEMORY = 8 << 30  # bytes of address space for one fault
LATER = "outside functions"
Tests = dict[str, dict[str, Any]]


class Runs:
    """A pytest plugin that ends the process at the first failure, and reports that test."""

    def __init__(self, pipe: int) -> None:
        self._pipe = pipe

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """End here if this test fails."""
        if report.failed:
            os.write(self._pipe, report.nodeid.encode())
            os._exit(1)


class Watch:
    """A pytest plugin that records the functions called by each test, and its duration."""

    def __init__(self) -> None:
        self.seen: Tests = {}
        self._names = {str(path): str(path.relative_to(ROOT)) for path in files()}

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Trace the calls of one test."""
        calls: set[str] = set()
        names = self._names

        def trace(frame: Any, event: str, _: Any) -> None:
            name = names.get(frame.f_code.co_filename)
            if name is not None:
                calls.add(f"{name}:{frame.f_code.co_qualname}")

        start = process_time()
        sys.settrace(trace)
        yield
        sys.settrace(None)
        found = self.seen.setdefault(item.nodeid, {"passed": True})
        found |= {"calls": sorted(calls), "seconds": process_time() - start}
        found["of"] = _digest(item.path)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Forget tests that fail anyway."""
        if not report.passed:
            self.seen.setdefault(report.nodeid, {})["passed"] = False


class Trials:
    """Verdicts on a sample of faults, kept in a file; a plugin of the collecting pytest."""

    def __init__(self, sample: list[Fault], path: Path, watched: Path) -> None:
        self.sample, self.path, self.watched = sample, path, watched
        self._out = os.dup(1)

    def found(self) -> Tests:
        """Return the verdict and the test of each fault so far, by its key."""
        return json.loads(self.path.read_text()) if self.path.exists() else {}

    def known(self, fault: Fault, tests: Tests) -> bool:
        """Say whether a fault can be skipped: it was found, or no test is new since."""
        one = self.found().get(fault.key)
        if one is None or one["verdict"] in ("killed", "endless"):
            return one is not None
        chosen = chosen_tests(fault, tests, set())[0]
        return one["verdict"] != LATER and one["of"] == _of(chosen, tests)

    def say(self, words: str) -> None:
        """Print, although pytest captures output."""
        os.write(self._out, f"{words}\n".encode())

    def note(self, fault: Fault, verdict: str, test: str = "", of: str = "") -> None:
        """Keep a verdict, the test that found the fault, and the tests it was tried on."""
        words = fault._asdict() | {"verdict": verdict, "test": test, "of": of}
        everything = self.found() | {fault.key: words}
        self.path.write_text(json.dumps(everything, indent=0))

    def run(self) -> None:
        """Collect all tests, then try every fault without a verdict."""
        _quiet()
        with TemporaryDirectory() as folder:
            os.environ.setdefault("WBC_CACHE", folder)  # fitted shapes and the core: once
            if code := pytest.main([*_options(), "-m", "not slow", *TESTS], [self]):
                raise RuntimeError(f"pytest ended with code {code}")

    def pytest_internalerror(self, excrepr: object) -> None:
        """Print the error here, since pytest's output is captured."""
        self.say(str(excrepr))

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Try the faults instead of running the tests."""
        from tests.conftest import load

        items = {item.nodeid: item for item in session.items}
        for name in WARM:
            load(name)
        tests = self._watch(items)
        self._all(items, tests)
        while self._forgotten(items, tests):
            self._all(items, tests)
        return True

    def _all(self, items: dict[str, pytest.Item], tests: Tests) -> None:
        for k, fault in enumerate(self.sample):
            if not self.known(fault, tests):
                self._one(fault, items, tests)
                verdict = self.found()[fault.key]["verdict"]
                self.say(f"{k + 1}: {fault.file}:{fault.line}: {verdict}")

    def _one(self, fault: Fault, items: dict[str, pytest.Item], tests: Tests) -> None:
        chosen, spent = chosen_tests(fault, tests, _finders(self.found(), fault.file))
        if not chosen:
            self.note(fault, "never called")
            return
        path = ROOT / fault.file
        sound, faulty = compile(source(path), str(path), "exec"), faulty_code(fault)
        if not _replace(sound, faulty, str(path), try_only=True):
            self.note(fault, LATER)
            return

        def run(pipe: int) -> None:
            _replace(sound, faulty, str(path))
            _run([items[name] for name in chosen], Runs(pipe))

        self.note(fault, *_tried(run, spent), _of(chosen, tests))

    def _watch(self, items: dict[str, pytest.Item]) -> Tests:
        """Return the calls of every test, from a file; new and changed tests are run."""
        stored: Tests = json.loads(self.watched.read_text()) if self.watched.exists() else {}
        digests = {path: _digest(path) for path in {item.path for item in items.values()}}
        known = {key: one for key, one in stored.items() if key in items}
        old = {key for key, one in known.items() if one.get("of") == digests[items[key].path]}
        new = [one for key, one in items.items() if key not in old]
        if new:
            self.say(f"which test calls what: {len(new)} tests are run once")

            def run() -> None:
                watch = Watch()
                _run(new, watch)
                self.watched.write_text(json.dumps(known | watch.seen))

            forked(run, 3600)
            known = json.loads(self.watched.read_text())
        return {key: one for key, one in known.items() if one["passed"]}

    def _forgotten(self, items: dict[str, pytest.Item], tests: Tests) -> int:
        """Run the tests that found faults without any; forget failing ones, and their faults."""
        finders = sorted({one["test"] for one in self.found().values()} & set(items))

        def fails(names: list[str]) -> bool:
            few = [items[name] for name in names]
            return _tried(lambda pipe: _run(few, Runs(pipe)), 600.0)[0] != "survived"

        wrong = [name for name in finders if fails([name])] if finders and fails(finders) else []
        for name in wrong:
            self.say(f"fails without a fault too: {name}")
            tests.pop(name)
            stored = json.loads(self.watched.read_text())
            stored[name]["passed"] = False
            self.watched.write_text(json.dumps(stored))
            rest = {k: one for k, one in self.found().items() if one["test"] != name}
            self.path.write_text(json.dumps(rest, indent=0))
        return len(wrong)


def tried_afresh(trials: Trials) -> None:
    """Try the faults outside functions, importing the package anew for each."""
    tests: Tests = json.loads(trials.watched.read_text())
    tests = {key: one for key, one in tests.items() if one["passed"]}
    for fault in trials.sample:
        if trials.found().get(fault.key, {}).get("verdict") == LATER:
            chosen, spent = chosen_tests(fault, tests, _finders(trials.found(), fault.file))
            verdict, test = _tried(lambda pipe, f=fault, c=chosen: _imported(f, c, pipe), spent)
            trials.note(fault, verdict, test, _of(chosen, tests))
            trials.say(f"{fault.file}:{fault.line}: {verdict}")


def chosen_tests(fault: Fault, tests: Tests, first: set[str]) -> tuple[list[str], float]:
    """Return the tests that call the faulty function, the quickest first, and their time."""
    called, chosen, spent = f"{fault.file}:{fault.function}", list[str](), 0.0
    for name in sorted(tests, key=lambda name: (name not in first, float(tests[name]["seconds"]))):
        calls = tests[name]["calls"]
        found = called in calls if fault.function else any(c.startswith(called) for c in calls)
        found = found or name.startswith(ALWAYS)
        if found:
            chosen.append(name)
            spent += tests[name]["seconds"]
    return chosen, spent


def _finders(found: Tests, file: str) -> set[str]:
    return {str(one["test"]) for one in found.values() if one["file"] == file}


def _of(chosen: list[str], tests: Tests) -> str:
    words = [f"{name} {tests[name]['of']}" for name in sorted(chosen)]
    return hashlib.sha256("\n".join(words).encode()).hexdigest()[:8]


def faulty_code(fault: Fault) -> CodeType:
    """Return the code of a file with a fault."""
    path = ROOT / fault.file
    tree = ast.fix_missing_locations(Places(fault.place).visit(ast.parse(source(path))))
    return compile(tree, str(path), "exec")


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for one in code.co_consts:
        if isinstance(one, CodeType):
            yield from _codes(one)


def _alone(code: CodeType) -> CodeType:
    plain = tuple(None if isinstance(one, CodeType) else one for one in code.co_consts)
    return code.replace(co_consts=plain, co_linetable=b"")


def _replace(sound: CodeType, faulty: CodeType, path: str, try_only: bool = False) -> bool:
    """Replace functions of a file; return whether that covers the whole fault."""
    codes, others = list(_codes(sound)), list(_codes(faulty))
    if len(codes) != len(others):  # a call with a function in it is left out
        return False
    pairs = list(zip(codes, others, strict=True))
    if any(_alone(a) != _alone(b) and not a.co_flags & 0x2 for a, b in pairs):  # no function
        return False
    new = {(a.co_qualname, a.co_firstlineno): b for a, b in pairs if a != b}
    live = [
        one
        for one in gc.get_objects()
        if isinstance(one, FunctionType)
        and one.__code__.co_filename == path
        and (one.__code__.co_qualname, one.__code__.co_firstlineno) in new
    ]
    given = [new[one.__code__.co_qualname, one.__code__.co_firstlineno] for one in live]
    if any(one.__code__.co_freevars != c.co_freevars for one, c in zip(live, given, strict=True)):
        return False
    if not try_only:
        for one, code in zip(live, given, strict=True):
            one.__code__ = code
    return bool(live)


def _run(items: list[pytest.Item], plugin: object) -> None:
    items[0].config.pluginmanager.register(plugin)
    for item, following in zip(items, [*items[1:], None], strict=True):
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)


def _imported(fault: Fault, chosen: list[str], pipe: int) -> None:
    _quiet()
    code, name = faulty_code(fault), str(ROOT / fault.file)
    plain = importlib.machinery.SourceFileLoader.get_code
    importlib.machinery.SourceFileLoader.get_code = lambda self, module: (  # type: ignore
        code if self.path == name else plain(self, module)
    )
    if pytest.main([*_options(), *chosen], [Runs(pipe)]):
        os._exit(1)


def _options() -> list[str]:
    folder = Path(os.environ.get("TMPDIR", "/tmp")) / f"mutation-{os.getpid()}"
    return ["-q", "-n0", "-s", "-pno:cacheprovider", f"--basetemp={folder}"]


def _tried(run: Callable[[int], None], spent: float) -> tuple[str, str]:
    """Return the verdict and the failed test of a run in a child."""
    ours, theirs = os.pipe()
    code = forked(lambda: run(theirs), 10 + 3 * spent)
    os.close(theirs)
    test = os.read(ours, 1 << 16).decode()
    os.close(ours)
    return "endless" if code < 0 else "killed" if code else "survived", test


def forked(run: Callable[[], None], seconds: float) -> int:
    """Return the exit code of ``run`` in a child process; negative if it was killed."""
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            if seconds:
                resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
                resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
                signal.alarm(int(20 * seconds))
            run()
            code = 0
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status)


def _quiet() -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:8]
