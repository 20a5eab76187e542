"""Run a study and keep its output in ``benchmarks/kept/NAME.txt``, with which pages are compared.

    python benchmarks/keep.py in_the_air python benchmarks/in_the_air.py
    python benchmarks/keep.py push_g1 wbc push problems/push_g1.yaml --directions 16

The file begins with the command and the machine. It is written if the command succeeds.
"""

import shlex
import subprocess
import sys
from pathlib import Path

from qpbench.summary import machine

from wbc.files import write_text
from wbc.problem.provenance import versions

KEPT = Path(__file__).parent / "kept"
PROGRAMS = {"python": [sys.executable], "wbc": [sys.executable, "-m", "wbc"]}


def main() -> None:
    if len(sys.argv) < 3:
        raise SystemExit(__doc__)
    name, program, *rest = sys.argv[1:]
    lines = []
    command = [*PROGRAMS.get(program, [program]), *rest]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout or ():
            print(line, end="", flush=True)
            lines.append(line.rstrip())
    if process.returncode:
        raise SystemExit(process.returncode)
    told = ", ".join(f"{one} {version}" for one, version in versions().items())
    head = f"$ {shlex.join([program, *rest])}\n{machine()}; {told}\n\n"
    KEPT.mkdir(exist_ok=True)
    write_text(KEPT / f"{name}.txt", head + "\n".join(lines).strip("\n") + "\n")


if __name__ == "__main__":
    main()
