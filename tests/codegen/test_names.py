"""Names that would end a comment or a string, or are none in C: the compiler is the judge."""

import os
import random
import shutil
import subprocess
from pathlib import Path

import pytest

import wbc.robot
from wbc.codegen import CodegenError, export_problem
from wbc.codegen.c_text import LONGEST_IDENTIFIER, LONGEST_LITERAL, comment, identifier, literal

MODEL = Path(wbc.robot.__file__).parent / "models" / "hoap2_like.urdf"
COUNT = int(os.environ.get("WBC_FUZZ", "400"))
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Werror", "-trigraphs")
STANDARDS = ("c99", "c11")
compiles = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc, for -trigraphs")
# By hand: each got out of its comment or string, or does not compile, if written as it is.
ODD = (
    "x*/ int evil = 1; /*", "x*\\\n/ int evil = 1; /*", "x*??/\n/ int evil = 1; /*", "head??/",
    "ends in \\", "ends in ??/", '"', '"; int evil = 1; char *s = "', "??'", "a??!b", "????/",
    "\\x", "/*", "*", "/", "*/*/", "/*/", "\r", "a\nb", "\t", "\x01", "\x7f", "\x85", "\u2028",
    "\u202e", "head_😀", "schulter_ä", "膝", "\\u0041", "%s", "%:", "1joint", "int", "", " ", "é1",
    "a" * 70,
)  # fmt: skip
PIECES = (*"\\?/*\"'\n\r\t\f\x01\x7f%:#<>=!-()01aAZ_ ", "??/", "*/", "/*", "//", "\\\n", "\\u",
          "\u202e", "\u2028", "ä", "膝", "😀", "int evil = 1;", "\ud800")  # fmt: skip


def odd_names(count: int) -> list[str]:
    rng = random.Random(20261126)
    return ["".join(rng.choices(PIECES, k=rng.randrange(1, 12))) for _ in range(count)]


def compile_c(source: Path, standard: str, *arguments: str) -> None:
    command = ["gcc", f"-std={standard}", *STRICT, *arguments, str(source)]
    done = subprocess.run(command, cwd=source.parent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:2000]


@compiles
@pytest.mark.parametrize("standard", STANDARDS)
def test_odd_names_in_comments_strings_and_identifiers_compile_and_come_back(
    standard: str, tmp_path: Path
) -> None:
    names = [*ODD, *odd_names(COUNT)]
    taken = set[str]()
    # The comment stands between a number and its comma: one that ends early is no C.
    numbered = [f"    {identifier(f'T_{one}', taken)} = 1 /* {comment(one)} */," for one in names]
    texts = [f"    {literal(one)} /* {comment(one)} */," for one in names]
    lines = [
        "#include <stdio.h>",
        *("enum numbers {", *numbered, "};"),
        *("static const char *const names[] = {", *texts, "};"),
        "int main(void) {",
        f"    for (int k = 0; k < {len(names)}; k++) {{ fputs(names[k], stdout); putchar(0); }}",
        "    return sizeof names / sizeof names[0] - NUMBER;".replace("NUMBER", str(len(names))),
        "}",
    ]
    source = tmp_path / "names.c"
    source.write_text("\n".join(lines) + "\n", encoding="ascii")
    compile_c(source, standard, "-o", "names")
    done = subprocess.run([tmp_path / "names"], capture_output=True, check=False)
    assert done.returncode == 0
    assert done.stdout.split(b"\0")[:-1] == [one.encode("utf-8", "surrogatepass") for one in names]
    assert len({one[:LONGEST_IDENTIFIER] for one in taken}) == len(names)


def test_names_that_differ_behind_what_c_looks_at_stay_apart() -> None:
    taken = set[str]()
    found = [identifier("WBC_TASK_" + "a" * 80 + end, taken) for end in ("", "b", "c", "_2")]
    assert len(set(found)) == 4 and {len(one) for one in found} == {LONGEST_IDENTIFIER}
    assert [identifier(one, taken) for one in ("T_a b", "T_a-b", "T_a b 2")] == [
        *("T_A_B", "T_A_B_2", "T_A_B_2_2")
    ]


@pytest.mark.parametrize(
    ("name", "said"), [("a" * (LONGEST_LITERAL + 1), "bytes"), ("a\0b", "zero")]
)
def test_names_that_no_string_of_c_holds_are_refused(name: str, said: str) -> None:
    with pytest.raises(CodegenError, match=said):
        literal(name)


PROBLEM = """
robot: r.urdf
support: double
tasks:
  1 com - 膝: {type: com, target: start}
  posture ä: {type: posture, weight: 0.1}
  posture ö: {type: posture, weight: 0.1}
controller: {solver: daqp}
stop: {duration: 0.05}
"""


@compiles
def test_export_of_a_robot_and_a_file_with_odd_names_compiles(tmp_path: Path) -> None:
    """Newlines come as references in XML; names of tasks are words, of any script."""
    model = MODEL.read_text(encoding="utf-8")
    for plain, odd in (
        ('robot name="hoap2_like"', 'robot name="x*\\&#10;/ int evil=1; /*??/&#10;"'),
        ('"head_pitch"', '"head??/"'),
        ('"left_knee_pitch"', '"knee_😀&#10;\\"'),
    ):
        assert model.count(plain) >= 1
        model = model.replace(plain, odd)
    (tmp_path / "r.urdf").write_text(model, encoding="utf-8")
    path = tmp_path / "*??\\ ä.yaml"
    path.write_text(PROBLEM, encoding="utf-8")
    folder = tmp_path / "c"
    made = export_problem(path, folder, ticks=2)
    assert "head??/" in made.recording.controller.robot.joint_names
    for standard in STANDARDS:
        for name in ("plan", "main"):
            arguments = ("-I.", "-Icore", "-c", "-o", f"{name}.o")
            compile_c(folder / f"{name}.c", standard, *arguments)
    command = ["nm", "plan.o"]
    listed = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    assert "evil" not in listed.stdout and "wbc_joint_names" in listed.stdout
