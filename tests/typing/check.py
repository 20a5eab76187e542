"""Checks code as users write it with mypy and pyright, both strict: the README's and the examples'.

The files are copied out of the clone first, and wbc is found as an installed package is: what
py.typed, ``__all__`` and ``import X as X`` say of it counts. Return the number of checkers that
complain.

    python tests/typing/check.py
"""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

CLONE = Path(__file__).parents[2]
FOLDER = CLONE / "build" / "typing"
PYRIGHT = {
    "typeCheckingMode": "strict",
    "reportUnnecessaryTypeIgnoreComment": True,
    "enableTypeIgnoreComments": False,  # those are mypy's
    "reportPossiblyUnboundVariable": False,  # what a loop of so many rounds sets is set
}
UNTYPED = ("ros2_node.py",)  # rclpy comes with ROS 2 only, and has no types
CACHE = str(FOLDER.with_name("typing-cache"))
MYPY = ("--strict", "--follow-imports=silent", "--cache-dir", CACHE)


def users_files() -> None:
    """Copy the files, and the Python of the README as one, as it is read."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)
    for path in (*(CLONE / "examples").glob("*.py"), Path(__file__).with_name("users_code.py")):
        if path.name not in UNTYPED:
            shutil.copy(path, FOLDER)
    readme = (CLONE / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", readme, flags=re.DOTALL)
    (FOLDER / "readme.py").write_text("\n".join(blocks), encoding="utf-8")
    (FOLDER / "pyrightconfig.json").write_text(json.dumps(PYRIGHT), encoding="utf-8")


def complains(*command: str, **environment: str) -> bool:
    """Run a checker among the files; return whether it complains."""
    print(f"== {command[0]}", flush=True)
    run = subprocess.run(
        [sys.executable, "-m", *command], cwd=FOLDER, env=os.environ | environment, check=False
    )
    return run.returncode != 0


if __name__ == "__main__":
    users_files()
    config = str(CLONE / "pyproject.toml")
    names = sorted(path.name for path in FOLDER.glob("*.py"))
    mypy = complains("mypy", *MYPY, "--config-file", config, *names, MYPYPATH=str(CLONE))
    pyright = complains("pyright", "--pythonpath", sys.executable, PYTHONPATH=str(CLONE))
    sys.exit(mypy + pyright)
