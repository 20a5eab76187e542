"""Robot descriptions in files: URDF and MJCF, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from wbc.errors import ModelError
from wbc.robot.formats.description import Description
from wbc.robot.formats.mjcf import read_mjcf
from wbc.robot.formats.urdf import read_urdf
from wbc.robot.formats.xml import read_xml


def read_description(path: Path, package_dirs: Iterable[Path] = ()) -> Description:
    """Return what a URDF or MJCF file describes, with a free-flyer at its root.

    Parameters
    ----------
    path:
        The file; the root element tells the format, not the file's name.
    package_dirs:
        Folders that hold the packages of ``package://NAME/...`` mesh names. The folders above
        ``path`` and those of the environment variable ``ROS_PACKAGE_PATH`` are searched as well.

    Raises
    ------
    ModelError
        File missing or unreadable, broken XML, another format, or something unsupported in it.
    """
    root = read_xml(path)
    if root.tag == "robot":
        return read_urdf(root, path, tuple(package_dirs))
    if root.tag == "mujoco":
        return read_mjcf(root, path)
    raise ModelError(
        f"{path}: the root element is <{root.tag}>; expected <robot> (URDF) or <mujoco> (MJCF)"
    )
