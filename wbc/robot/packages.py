"""Robots of other packages: ``mujoco-menagerie`` and ``robot_descriptions``.

Both download a robot's files when it is first loaded.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from wbc.errors import ModelError, UnknownNameError
from wbc.extras import require

MENAGERIE, DESCRIPTIONS = "menagerie:", "robot_descriptions:"  # what the names begin with


def menagerie_names() -> tuple[str, ...]:
    """Return the names of all robots of the menagerie, as ``Robot.load`` takes them.

    Nothing is downloaded. Empty if the package is not installed.
    """
    if importlib.util.find_spec("mujoco_menagerie") is None:
        return ()
    return tuple(MENAGERIE + str(name) for name in _menagerie().names())


def from_menagerie(name: str) -> Path:
    """Return the file of ``menagerie:NAME`` or ``menagerie:NAME/ENTRY``.

    Without an entry it is the model of the robot alone. The package's own settings say where files
    are kept (``MENAGERIE_CACHE_DIR``) and of which checkout they are (``MENAGERIE_ROOT``).

    Raises MissingPackageError: the package is not installed; UnknownNameError: no such robot or
    entry; ModelError: it cannot be downloaded.
    """
    require("mujoco_menagerie", f"robot {name!r}")
    menagerie = _menagerie()
    robot, _, entry = name.removeprefix(MENAGERIE).partition("/")
    if robot not in menagerie.names():
        raise UnknownNameError("robot of the menagerie", robot, menagerie.names())
    known = menagerie.get(robot)
    if entry and entry not in known.entry_names:
        raise UnknownNameError(f"entry of the menagerie's {robot}", entry, known.entry_names)
    try:
        return Path(known.xml(entry or known.default_model))
    except Exception as error:  # whatever its download raises: no network, no space
        raise ModelError(f"robot {name!r}: mujoco-menagerie cannot provide it: {error}") from error


def _menagerie() -> Any:
    return importlib.import_module("mujoco_menagerie")


def from_robot_descriptions(name: str) -> tuple[Path, tuple[Path, ...]] | None:
    """Return a robot's file in ``robot_descriptions``, and the folders of its meshes, or None.

    ``name``: such as ``g1_description``, or ``g1``; with ``robot_descriptions:`` before it the
    package has to be there, and to have it.

    Raises MissingPackageError: the package is not installed, and is meant; UnknownNameError: it has
    no such robot, and is meant; ModelError: it cannot be downloaded, or has neither URDF nor MJCF.
    """
    meant = name.startswith(DESCRIPTIONS)
    plain = name.removeprefix(DESCRIPTIONS)
    if meant:
        require("robot_descriptions", f"robot {name!r}")
    installed = importlib.util.find_spec("robot_descriptions") is not None
    wanted = (f"robot_descriptions.{plain}", f"robot_descriptions.{plain}_description")
    usable = installed and plain.isidentifier()
    module_name = next((m for m in wanted if usable and importlib.util.find_spec(m)), None)
    if module_name is None:
        if meant:
            package = importlib.import_module("robot_descriptions")
            names = sorted(file.stem for file in Path(str(package.__file__)).parent.glob("*.py"))
            known = [one for one in names if one.endswith("_description")]
            raise UnknownNameError("robot of robot_descriptions", plain, known)
        return None
    try:
        module = importlib.import_module(module_name)
    except Exception as error:  # whatever its download raises: no network, no git, no space
        raise ModelError(f"robot {name!r}: {module_name} cannot provide it: {error}") from error
    path = getattr(module, "URDF_PATH", None) or getattr(module, "MJCF_PATH", None)
    if path is None:
        raise ModelError(f"robot {name!r}: {module_name} has neither a URDF nor an MJCF")
    package_dir = Path(getattr(module, "PACKAGE_PATH", Path(path).parent))
    return Path(path), (package_dir, package_dir.parent)
