"""Recorded sequences: the same bits back, and what is not such a file is refused by name."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from qpbench.sequence import ENDING, FIELDS, QpSequence, load_sequence, save_sequence

from wbc.errors import InvalidInputError
from wbc.files import ArrayFileError
from wbc.qp import QP


def random_qp(rng: np.random.Generator, n: int, me: int, mi: int) -> QP:
    square = rng.standard_normal((n, n))
    lower = np.where(rng.random(n) < 0.3, -np.inf, -rng.random(n))
    return QP.build(
        square.T @ square, rng.standard_normal(n), A=rng.standard_normal((me, n)),
        b=rng.standard_normal(me), C=rng.standard_normal((mi, n)), l=np.full(mi, -np.inf),
        u=rng.random(mi), lower=lower, upper=rng.random(n),
    )  # fmt: skip


@pytest.fixture
def sequence() -> QpSequence:
    """Return QPs whose sizes change, and come back."""
    rng = np.random.default_rng(0)
    sizes = [(5, 2, 3)] * 4 + [(5, 2, 0)] * 2 + [(7, 0, 1)] + [(5, 2, 3)]
    return QpSequence("odd", {"robot": "none"}, tuple(random_qp(rng, *size) for size in sizes))


def test_the_same_bits_come_back(tmp_path: Path, sequence: QpSequence) -> None:
    path = tmp_path / f"odd{ENDING}"
    save_sequence(path, sequence)
    back = load_sequence(path)
    assert (back.name, back.about, back.sizes()) == ("odd", {"robot": "none"}, sequence.sizes())
    for one, other in zip(sequence.qps, back.qps, strict=True):
        for field in FIELDS:
            assert getattr(one, field).tobytes() == getattr(other, field).tobytes()


def test_what_hardly_changes_takes_hardly_any_room(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    qp = random_qp(rng, 30, 6, 20)
    moved = [
        QP.build(qp.P, qp.g + 1e-3 * k, A=qp.A, b=qp.b, C=qp.C, l=qp.l, u=qp.u) for k in range(50)
    ]
    path = tmp_path / f"still{ENDING}"
    save_sequence(path, QpSequence("still", {}, tuple(moved)))
    raw = sum(getattr(one, field).nbytes for one in moved for field in FIELDS)
    assert path.stat().st_size < raw / 10


def rewritten(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    change(arrays)
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def head(**keys: Any) -> Callable[[dict[str, Any]], None]:
    def change(arrays: dict[str, Any]) -> None:
        arrays["head"] = np.array(json.dumps({**json.loads(str(arrays["head"])), **keys}))

    return change


@pytest.mark.parametrize(
    ("change", "kind", "told"),
    [
        (head(format="wbc qp sequence 9"), InvalidInputError, "'wbc qp sequence 9', and"),
        (head(about=3), InvalidInputError, "is not a recorded sequence"),
        (lambda a: a.pop("head"), InvalidInputError, "is not a recorded sequence"),
        (lambda a: a.pop("u"), ArrayFileError, "array 'u': missing"),
        (lambda a: a.update(P=a["P"][:-8]), ArrayFileError, "truncated"),
        (lambda a: a.update(sizes=a["sizes"][:-1]), ArrayFileError, "truncated"),
        (lambda a: a.update(sizes=a["sizes"].ravel()), ArrayFileError, "(k, 3)"),
        (lambda a: a.update(sizes=-a["sizes"]), ArrayFileError, "(k, 3)"),
        (lambda a: a.update(g=np.full_like(a["g"], 255)), InvalidInputError, "QP 0: QP.g"),
        (lambda a: a.update(g=a["g"].astype(float)), ArrayFileError, "'g'"),
    ],
)
def test_what_is_no_sequence_is_refused(tmp_path, sequence, change, kind, told) -> None:
    path = tmp_path / f"odd{ENDING}"
    save_sequence(path, sequence)
    rewritten(path, change)
    with pytest.raises(kind) as caught:
        load_sequence(path)
    assert told in str(caught.value) and path.name in str(caught.value)


@pytest.mark.parametrize("part", [0.0, 0.3, 0.99])
def test_a_file_cut_off_is_refused(tmp_path: Path, sequence: QpSequence, part: float) -> None:
    path = tmp_path / f"odd{ENDING}"
    save_sequence(path, sequence)
    content = path.read_bytes()
    path.write_bytes(content[: int(part * len(content))])
    with pytest.raises(ArrayFileError, match="cannot be read"):
        load_sequence(path)
