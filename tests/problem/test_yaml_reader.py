"""YAML text to data: what is read, where it stood, and everything that is refused."""

import math
from pathlib import Path

import pytest

from wbc.errors import ProblemFileError
from wbc.problem import yaml_reader
from wbc.problem.yaml_reader import MAX_ALIASES, MAX_BYTES, MAX_DEPTH, parse, read_source


def refusal(text: str) -> str:
    with pytest.raises(ProblemFileError) as caught:
        parse(text, "p.yaml")
    return str(caught.value)


def test_values_become_plain_data() -> None:
    source = parse(
        "word: on\nquoted: '110'\nint: 110\nreal: 1e-6\nyes: true\nnothing:\n"
        "list: [1, 2.5]\nnot: .nan\nday: 2026-11-21\nhere: &a {x: 1}\nthere: *a\n",
        "p.yaml",
    )
    assert math.isnan(source.data.pop("not"))
    assert source.data == {
        "word": "on",  # YAML 1.1 would make this true
        "quoted": "110",
        "int": 110,
        "real": 1e-6,
        "yes": True,
        "nothing": None,
        "list": [1, 2.5],
        "day": "2026-11-21",
        "here": {"x": 1},
        "there": {"x": 1},
    }


def test_every_key_and_entry_has_its_line() -> None:
    source = parse("a: 1\nb:\n  c:\n    - 5\n    - d: 6\n", "p.yaml")
    assert source.where(("a",)) == "p.yaml:1"
    assert source.where(("b", "c")) == "p.yaml:3"
    assert source.where(("b", "c", 1, "d")) == "p.yaml:5"
    assert source.where(("b", "c", 1, "missing")) == "p.yaml:5"  # the nearest that exists
    assert source.where(("missing",)) == "p.yaml:1"


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("a: 1\nb: 2\na: 3\n", 3, "a: given twice, first on line 1"),
        ("t:\n  x: {k: 1, k: 2}\n", 2, "t.x.k: given twice"),
        ("a: 1\nb: !!python/object/apply:os.system [ls]\n", 2, "python/object/apply:os.system"),
        ("a: !thing 3\n", 1, "'!thing' is not allowed"),
        ("a: !!binary aGk=\n", 1, "binary"),
        ("a: 1\nm:\n  110: x\n", 3, "m: the key 110 is not text; put it in quotes"),
        ("a: 1\n1.5: x\n", 2, "the key 1.5 is not text"),
        ("? [1, 2]\n: 3\n", 1, "a key must be text"),
        ("a: &x {k: 1}\nb:\n  <<: *x\n", 3, "merge keys"),
        ("a: 1\n---\nb: 2\n", 2, "second document"),
        ("a:\n\tb: 1\n", 2, "indent with spaces"),
        ("a: b: c\n", 1, "needs quotes"),
        ("a: [1, 2\nb: 3\n", 2, "not valid YAML"),
        ("a: 'x\nb: 1\nc: 2\n", 1, "a closing quote is missing"),  # where it opens
        ("t: {a:1}\n", 1, "t.a:1: a blank is missing after the colon: {a: 1}"),
        ("t: {a:{b: 1}}\n", 1, "or a blank after a colon, as in {a: 1"),
        ("joints: {*_knee: 1}\n", 1, "needs quotes"),
        ("a: " + "9" * 5000 + "\n", 1, "not a usable number"),
        ("a: !!int x\n", 1, "not a usable number"),
    ],
)
def test_refused_with_line_and_reason(text: str, line: int, words: str) -> None:
    message = refusal(text)
    assert message.startswith(f"p.yaml:{line}: ")
    assert words in message
    assert "\n" not in message


def test_control_characters_are_refused() -> None:
    assert "p.yaml: not valid YAML" in refusal("a: \x01")


def test_deep_nesting_is_refused_before_any_recursion() -> None:
    assert f"deeper than {MAX_DEPTH} levels" in refusal("[" * 100_000)
    assert f"deeper than {MAX_DEPTH} levels" in refusal("a: " + "{b: " * 40 + "1" + "}" * 40)
    levels = MAX_DEPTH - 1  # the outer mapping is one level too
    assert parse("a: " + "[" * levels + "]" * levels, "p.yaml").data["a"] is not None


def test_alias_bombs_are_refused() -> None:
    # Nine levels of nine references each: 9^9 values from 40 aliases too few to be refused as such.
    lines = ["a0: &a0 [x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 5)}]" for k in range(1, 10)]
    assert len(lines) * 5 - 5 < MAX_ALIASES
    assert "do aliases (*name) repeat themselves" in refusal("\n".join(lines))
    assert f"more than {MAX_ALIASES} aliases" in refusal("a: &x 1\nb: [" + "*x, " * 60 + "]")
    assert "p.yaml:1" in refusal("a: &x [*x]")  # a value inside itself


def test_many_values_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(yaml_reader, "MAX_VALUES", 100)
    assert "more than 100 values" in refusal("a: [" + "1, " * 300 + "]")


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    def complaint(path: Path) -> str:
        with pytest.raises(ProblemFileError) as caught:
            read_source(path)
        return str(caught.value)

    file = tmp_path / "p.yaml"
    assert "no such file" in complaint(file)
    assert "a folder" in complaint(tmp_path)
    for content, words in (
        (b"", "empty"),
        (b"# only a comment\n", "empty"),
        (b"- a\n- b\n", "got a list"),
        (b"hello\n", "got 'hello'"),
        (b"a: 1\nb: \xff\xfe\n", ":2: not UTF-8"),
        (b"#" * (MAX_BYTES + 1), "larger than"),
    ):
        file.write_bytes(content)
        assert words in complaint(file)
        assert str(file) in complaint(file)


def test_a_byte_order_mark_is_not_part_of_the_first_key(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_bytes(b"\xef\xbb\xbfrobot: g1\n")
    assert read_source(file).data == {"robot": "g1"}
