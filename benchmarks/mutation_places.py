"""Places in the sources for small faults, and their insertion.

It lists every place where a sign, an operator, a comparison, a condition, a number, a choice such
as ``min`` or a call without result could be wrong.
"""

import ast
import hashlib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
SOURCES = (
    "wbc/tasks",
    "wbc/constraints",
    "wbc/controllers",
    "wbc/qp",
    "wbc/robot/parallel_axis.py",
)
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


NO_EFFECT = ("strict", "overwrite_a", "check_finite")


class Fault(NamedTuple):
    """One fault: the file and its hash, the number of the place, the function's name, the words."""

    file: str
    digest: str
    place: int
    function: str
    line: int
    text: str
    what: str

    @property
    def key(self) -> str:
        """The name under which its verdict is kept."""
        return f"{self.file}:{self.digest}:{self.place}"


class Places(ast.NodeTransformer):
    """Counts possible faults in a file; inserts the one at the given place."""

    def __init__(self, wanted: int = -1) -> None:
        self.wanted, self.found = wanted, list[tuple[str, int, str]]()
        self._names, self._functions = list[str](), [""]

    def _at(self, node: Any, what: str, change: Callable[[], Any]) -> Any:
        self.found.append((self._functions[-1], node.lineno, what))
        return change() if len(self.found) - 1 == self.wanted else node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Visit a function; annotations and decorators have no faults."""
        self._functions.append(".".join([*self._names, node.name]))
        self._names += [node.name, "<locals>"]
        node.body = [self.visit(part) for part in node.body]
        node.args.defaults = [self.visit(part) for part in node.args.defaults]
        given = node.args.kw_defaults
        node.args.kw_defaults = [part and self.visit(part) for part in given]
        self._names = self._names[:-2]
        self._functions.pop()
        return node

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        """Visit a class; decorators have no faults."""
        self._names.append(node.name)
        node.body = [self.visit(part) for part in node.body]
        self._names.pop()
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        """Skip annotations."""
        if node.value is not None:
            node.value = self.visit(node.value)
        return node

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        """Skip messages."""
        return node

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        """Skip formatted strings."""
        return node

    def visit_keyword(self, node: ast.keyword) -> ast.AST:
        """Skip keywords that assert equal lengths, or avoid a copy or a check."""
        return node if node.arg in NO_EFFECT else self.generic_visit(node)

    def visit_If(self, node: ast.If) -> ast.AST:
        """Invert the condition."""
        self.generic_visit(node)
        if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            return node
        return self._at(node, "if not", lambda: _set(node, "test", ast.Not(), node.test))

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        """Take the other branch; not for strings."""
        self.generic_visit(node)
        if isinstance(node.body, ast.Constant) and isinstance(node.body.value, str):
            return node
        return self._at(node, "if not", lambda: _set(node, "test", ast.Not(), node.test))

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Replace the operator."""
        self.generic_visit(node)
        return self._swap(node)

    visit_AugAssign = visit_BoolOp = visit_BinOp

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        """Replace the comparison, the first if there are two."""
        self.generic_visit(node)
        swapped = SWAPS[type(node.ops[0])]

        def change() -> ast.AST:
            node.ops[0] = swapped()
            return node

        return self._at(node, f"{type(node.ops[0]).__name__} -> {swapped.__name__}", change)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        """Remove the sign or negation."""
        self.generic_visit(node)
        return self._at(node, f"no {type(node.op).__name__}", lambda: node.operand)

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        """Change the number."""
        if isinstance(node.value, bool):
            return self._at(node, f"{not node.value}", lambda: ast.Constant(not node.value))
        if isinstance(node.value, int | float):
            other = node.value + 1 if isinstance(node.value, int) else 2.0 * node.value + 1e-3
            return self._at(node, f"{node.value} -> {other}", lambda: ast.Constant(other))
        return node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        """Replace the choice."""
        if node.id in ("min", "max", "any", "all", "abs"):
            return self._at(node, f"{node.id} -> {CHOICES[node.id]}", lambda: _set_name(node, "id"))
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Skip arrays without entries, for which zeros and ones are the same."""
        sizes = node.args[:1]
        if sizes and isinstance(sizes[0], ast.Tuple):
            sizes = sizes[0].elts
        empty = any(isinstance(one, ast.Constant) and one.value == 0 for one in sizes)
        if empty and isinstance(node.func, ast.Attribute) and node.func.attr == "zeros":
            node.args = [self.visit(part) for part in node.args]
            return node
        return self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """Replace the choice; not the size of either end of a range, which is the same."""
        if node.attr == "size" and isinstance(node.value, ast.Attribute):
            return node
        self.generic_visit(node)
        if node.attr in CHOICES and node.attr != "abs":
            what = f"{node.attr} -> {CHOICES[node.attr]}"
            return self._at(node, what, lambda: _set_name(node, "attr"))
        return node

    def visit_Expr(self, node: ast.Expr) -> ast.AST:
        """Remove a call."""
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
    return [p for p in every if p.name != "__init__.py"]


@cache
def source(path: Path) -> str:
    """Return the text of a file as first read: it may change meanwhile."""
    return path.read_text()


def faults() -> Iterator[Fault]:
    """Yield every possible fault."""
    for path in files():
        text = source(path)
        name, digest = str(path.relative_to(ROOT)), hashlib.sha256(text.encode()).hexdigest()[:8]
        places, lines = Places(), text.splitlines()
        places.visit(ast.parse(text))
        for place, (function, line, what) in enumerate(places.found):
            yield Fault(name, digest, place, function, line, lines[line - 1].strip(), what)
