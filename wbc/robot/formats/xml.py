"""XML files and the numbers in them.

Pinocchio's parsers drop a whole element when one attribute is not a number, hence the checks.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

from wbc.errors import ModelError

_NOT_NUMBERS = {"name", "joint", "link", "body", "class", "childclass", "file", "filename", "mesh"}
_NOT_FINITE = {"nan", "inf", "infinity"}


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


def numbers(element: ET.Element, key: str, count: int, where: str) -> list[float]:
    """Return the ``count`` finite numbers of an attribute.

    Raises
    ------
    ModelError
        The attribute is missing, or does not hold exactly so many finite numbers.
    """
    text = element.get(key)
    if text is None:
        raise ModelError(f"{where}: <{element.tag}> has no {key!r}; add it")
    try:
        values = [float(word) for word in text.split()]
    except ValueError as error:
        raise ModelError(f"{where}: <{element.tag} {key}={text!r}> is not a number") from error
    if len(values) != count or not all(math.isfinite(value) for value in values):
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        raise ModelError(f"{where}: <{element.tag} {key}={text!r}>: expected {wanted}")
    return values


def refuse_non_finite(root: ET.Element, path: Path) -> None:
    """Refuse NaN and infinity in any attribute that may hold numbers.

    Raises
    ------
    ModelError
        Naming the element, the attribute and the nearest named element around it.
    """
    _scan(root, "the root element", path)


def _scan(element: ET.Element, nearest: str, path: Path) -> None:
    name = element.get("name")
    if name is not None:
        nearest = f"{element.tag} {name!r}"
    for key, text in element.attrib.items():
        words = {word.lower().lstrip("+-") for word in text.split()}
        if key not in _NOT_NUMBERS and words & _NOT_FINITE:
            raise ModelError(
                f"{path}: in {nearest}: <{element.tag} {key}={text!r}> is not finite; give a number"
            )
    for child in element:
        _scan(child, nearest, path)
