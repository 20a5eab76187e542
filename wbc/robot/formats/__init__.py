"""Robot descriptions: readers of URDF, MJCF and compiled MuJoCo models, with their checks."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from wbc.errors import ModelError
from wbc.robot.formats.description import Description
from wbc.robot.formats.mjcf import read_mjcf
from wbc.robot.formats.urdf import read_urdf
from wbc.robot.formats.xml import parsed, read_xml

_DECLARATION = re.compile(r"\A\s*<\?xml[^>]*\?>")


def read_description(
    path: Path, package_dirs: Iterable[Path] = (), given: Any = None
) -> Description:
    """Return what a URDF, an MJCF or a MuJoCo model describes, with a free-flyer at its root.

    ``path``: the file; the root element tells the format, not the file's name.
    ``package_dirs``: folders that hold the packages of ``package://NAME/...`` mesh names. The
    folders above ``path`` and those of the environment variables ``ROS_PACKAGE_PATH`` and
    ``AMENT_PREFIX_PATH`` (ROS 2; ``share`` in each) are searched as well.
    ``given``: in place of a file: XML text, an ``MjSpec`` or an ``MjModel``; ``path`` is what
    messages call it.

    Raises MissingPackageError: MJCF, and MuJoCo is not installed; ModelError: file missing or
    unreadable, broken XML, another format, or something unsupported in it.
    """
    if given is not None and not isinstance(given, str):
        return read_mjcf(given, path)
    # Text says no more in which encoding its bytes were.
    root = read_xml(path) if given is None else parsed(_DECLARATION.sub("", given).encode(), path)
    _without_namespace(root)
    if root.tag == "robot":
        return read_urdf(root, path, tuple(package_dirs))
    if root.tag == "mujoco":
        return read_mjcf(path if given is None else given, path, root)
    raise ModelError(
        f"{path}: the root element is <{root.tag}>; expected <robot> (URDF) or <mujoco> (MJCF)"
    )


def _without_namespace(root: ET.Element) -> None:
    """Call elements as they are written: Drake's files say ``xmlns="http://drake.mit.edu"``."""
    space, closed, _ = root.tag.rpartition("}")
    for element in root.iter():
        if closed and element.tag.startswith(space + closed):
            element.tag = element.tag.removeprefix(space + closed)
