"""Read a robot description file, whichever of the two formats it is in."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

from wbc.errors import ModelError
from wbc.robot.description import Description
from wbc.robot.mjcf import read_mjcf
from wbc.robot.urdf import read_urdf


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


def read_xml(path: Path) -> ET.Element:
    """Return the root element of an XML file.

    Raises
    ------
    ModelError
        File missing or unreadable, still a xacro file, or broken XML.
    """
    if path.suffix == ".xacro":
        raise ModelError(f"{path}: expand the xacro first: xacro {path.name} > {path.stem}")
    if not path.is_file():
        where = "the folder exists" if path.parent.is_dir() else f"no folder {path.parent}"
        raise ModelError(f"{path}: no such file ({where}); check the path")
    try:
        return ET.parse(path).getroot()
    except ET.ParseError as error:
        raise ModelError(f"{path}: not valid XML: {error}; mend the file there") from error
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise ModelError(f"{path}: cannot be read: {error}") from error
