"""Imports go down the floors only: nothing upstream reads downstream; names are given once."""

import ast
from collections import Counter
from collections.abc import Sequence
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "wbc"
FLOORS = {
    "attributes": 0,
    "errors": 0,
    "files": 0,
    "kinds": 0,
    "extras": 0,
    "minimum_jerk": 0,
    "validate": 0,
    "spatial": 0,
    "rotations": 0,
    "polygon": 0,
    "native": 0,
    "placement": 0,
    "sparse": 0,
    "notebook": 0,
    "safe_pickle": 0,
    "journal": 0,
    "workers": 0,
    "robot": 1,
    "rmp": 1,
    "qp": 1,
    "tasks": 2,
    "constraints": 2,
    "laws": 2,
    "reduction": 2,
    "tracking": 2,
    "controllers": 3,
    "shaping": 3,
    "gait": 4,
    "flight": 4,
    "estimation": 4,
    "motion": 4,
    "human": 4,
    "retargeting": 4,
    "run": 4,
    "hardware": 5,
    "simulation": 5,
    "problem": 5,
    "view": 6,
    "batch": 6,
    "codegen": 6,
    "cli": 6,
    "__main__": 6,
}
# Rooms inside a room that stand on a floor of their own: a balance law may solve a QP.
INNER = {"rmp/balance": 2}
# Rooms on one floor that must not know each other.
STRANGERS = [{"robot", "rmp", "qp"}]
# Third-party packages and the only rooms, or files of a room, that may import them.
ONLY_IN = {
    "casadi": {"rmp", "flight", "placement", "robot/symbolic", "shaping", "sparse"},
    "pinocchio": {"robot", "rotations", "gait/legs"},
    "coal": {"robot"},
    "proxsuite": {"qp"},
    "qpsolvers": {"qp"},
    "ruamel": {"problem"},
    "pydantic": {"problem"},
    "matplotlib": {"view"},
    "viser": {"view/live"},
    "typer": {"cli"},
    "rich": {"cli"},
    "mujoco": {"simulation", "robot/formats"},
    "cyclonedds": {"hardware/unitree"},
    "distributed": {"batch"},
    "pyarrow": {"batch", "run/columns"},
    "pandas": {"run/columns"},
}
FILES = sorted(PACKAGE.rglob("*.py"))


def room(parts: Sequence[str]) -> str:
    inner = "/".join(parts[:2])
    return inner if inner in INNER else parts[0]


def parts_of(path: Path) -> tuple[str, ...]:
    return path.relative_to(PACKAGE).with_suffix("").parts


def room_of(path: Path) -> str:
    return room(parts_of(path))


def floor(name: str) -> int:
    return (FLOORS | INNER)[name]


@cache
def imported(path: Path, members: bool = False) -> frozenset[str]:
    """Return the modules that a file imports; with ``members`` also what it takes out of them."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(node.module or "")
            if members:
                names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(names)


def test_imports_go_down() -> None:
    wrong = []
    for path in FILES:
        here, places = room_of(path), {parts_of(path)[0], "/".join(parts_of(path)[:2])}
        for name in imported(path):
            parts = name.split(".")
            said = f"{path.relative_to(PACKAGE)} imports {name}"
            if parts[0] == "wbc" and len(parts) > 1:
                there = room(parts[1:])
                if here != "__init__" and floor(there) > floor(here):
                    wrong.append(said)
                if any({here, there} <= group and here != there for group in STRANGERS):
                    wrong.append(said)
            allowed = ONLY_IN.get(parts[0])
            if allowed is not None and not places & allowed:
                wrong.append(said)
    assert not wrong


def test_every_room_has_a_floor() -> None:
    rooms = {room_of(path) for path in FILES} - {"__init__"}
    assert set(ONLY_IN) <= {name.split(".")[0] for path in FILES for name in imported(path)}
    assert rooms == set(FLOORS) | set(INNER)


def test_no_two_files_import_each_other_in_a_circle() -> None:
    """Imports for types and inside functions count too."""
    modules = {".".join(("wbc", *parts_of(path))).removesuffix(".__init__") for path in FILES}
    graph = {
        ".".join(("wbc", *parts_of(path))): {
            name for name in imported(path, members=True) if name in modules
        }
        for path in FILES
        if path.stem != "__init__"
    }

    def reached(start: str) -> set[str]:
        seen: set[str] = set()
        ahead = set(graph.get(start, ()))
        while ahead:
            name = ahead.pop()
            if name not in seen:
                seen.add(name)
                ahead |= graph.get(name, set())
        return seen

    circles = sorted(name for name in graph if name in reached(name))
    assert not circles


def test_no_name_of_a_file_is_given_twice() -> None:
    """Python keeps the later one, in silence: what was made before reads that, too."""
    twice = []
    for path in (*FILES, *Path(__file__).parent.rglob("*.py")):
        names = Counter[str]()
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names[node.name] += 1
            elif isinstance(node, ast.Assign):
                named = (part for target in node.targets for part in ast.walk(target))
                names.update(
                    part.id
                    for part in named
                    if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store)
                )
        twice += [f"{path}: {name}" for name, count in names.items() if count > 1]
    assert not twice
