"""XML files and the numbers in them.

Pinocchio's parsers drop a whole element when one attribute is not a number, hence the checks.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from pathlib import Path

from wbc.errors import ModelError

_NOT_NUMBERS = {"name", "joint", "link", "body", "class", "childclass", "file", "filename", "mesh"}
MOST_BYTES, MOST_ELEMENTS, MOST_ATTRIBUTES, MOST_DEPTH = 64 << 20, 100_000, 200, 300
LARGEST = 1e9  # of a length [m], mass [kg] or inertia [kg m^2]: larger products overflow
LARGEST_GEAR = 1e3  # of a coupling's ratio or offset [rad or m]
ARCHIVES = b"PK\x03\x04", b"\x1f\x8b"  # how .zip, .mjz and .gz files begin
LFS = b"version https://git-lfs"
_EQUALS = re.compile(rb"=\s*[\"']")
_PREFIX, _DECLARED = re.compile(rb"<([A-Za-z]\w*):\w"), re.compile(rb"xmlns:(\w+)\s*=")
_NOT_FINITE = {"nan", "inf", "infinity"}


def read_xml(path: Path) -> ET.Element:
    """Return the root element of an XML file.

    Raises ModelError: file missing or unreadable, still a xacro file, broken XML, or larger, deeper
    or with more elements or attributes than any robot needs.
    """
    if path.suffix == ".xacro":
        urdf = f"{path.stem.removesuffix('.urdf')}.urdf"
        raise ModelError(f"{path}: expand the xacro first: xacro {path.name} > {urdf}")
    if path.suffix.startswith(".usd") or path.suffix in (".sdf", ".world"):
        raise ModelError(f"{path}: {path.suffix[1:]} files are not read; export a URDF or an MJCF")
    if path.suffix in (".yaml", ".yml"):
        raise ModelError(f"{path}: a problem file; name its robot (robot: {{model: ...}})")
    try:
        if path.is_dir():
            raise ModelError(f"{path}: a folder; name a robot file in it")
        if not path.is_file():
            where = "the folder exists" if path.parent.is_dir() else f"no folder {path.parent}"
            raise ModelError(f"{path}: no such file ({where}); check the path")
        if path.stat().st_size > MOST_BYTES:
            raise ModelError(f"{path}: larger than {MOST_BYTES >> 20} MB; is it a robot?")
        data = path.read_bytes()
    except (OSError, ValueError) as error:
        raise ModelError(f"{path}: cannot be read: {error}") from error
    if data.startswith(ARCHIVES):
        raise ModelError(f"{path}: an archive; unpack it, and name the robot file in it")
    return parsed(data, path)


def parsed(data: bytes, path: Path) -> ET.Element:
    """Return the root element of XML text; messages call it ``path``.

    Raises ModelError: broken XML, or larger, deeper or with more elements or attributes than any
    robot needs.
    """
    if data.startswith(LFS):
        raise ModelError(f"{path}: a Git LFS pointer, not the file itself; git lfs pull")
    try:
        _check_attributes(data, path)
        bare = data.lstrip()  # no space may precede a declaration
        root = ET.fromstring(_with_prefixes(bare if bare.startswith(b"<?xml") else data))
    except ET.ParseError as error:
        raise ModelError(f"{path}: not valid XML: {error}; {_remedy(data, error)}") from error
    except (ValueError, LookupError) as error:  # also of encodings that do not exist
        raise ModelError(f"{path}: cannot be read: {error}") from error
    _check_size(root, path)
    return root


def _with_prefixes(data: bytes) -> bytes:
    """Declare prefixes that a URDF does not, such as Gazebo's <sensor:camera>."""
    used = {*_PREFIX.findall(data)} - {*_DECLARED.findall(data), b"xacro"}
    if len(used) > MOST_ATTRIBUTES:
        return data
    spaces = b"".join(b' xmlns:%s="%s"' % (prefix, prefix) for prefix in sorted(used))
    return re.sub(rb"<robot(?=[\s>])", b"<robot" + spaces, data, count=1)


def _remedy(data: bytes, error: ET.ParseError) -> str:
    """Return what to do about text that is no XML, in words."""
    begins = data.removeprefix(b"\xef\xbb\xbf").lstrip()[:100].lower()
    if b"<!doctype html" in begins or begins.startswith(b"<html"):
        return "it is a web page; download the file itself (raw)"
    if not begins.startswith(b"<"):
        return "is it a robot (URDF or MJCF)?"
    if "unbound prefix" in str(error) and b"<xacro:" in data:
        return "expand its xacro first"
    return "mend the file there"


def _check_attributes(data: bytes, path: Path) -> None:
    """Refuse elements with many attributes: the XML parser's time grows with their square."""
    if b"\0" in data:
        binary = "; of a compiled model: Robot.load(mujoco.MjModel.from_binary_path(...))"
        hint = binary if path.suffix == ".mjb" else ""
        raise ModelError(f"{path}: not a text file in UTF-8; save it as one{hint}")
    for element in data.split(b"<"):  # which no attribute may hold
        if len(element) > MOST_ATTRIBUTES and len(_EQUALS.findall(element)) > MOST_ATTRIBUTES:
            raise ModelError(f"{path}: an element has more than {MOST_ATTRIBUTES} attributes")


def _check_size(root: ET.Element, path: Path) -> None:
    count, depth, level = 0, 0, [root]
    while level:
        count, depth = count + len(level), depth + 1
        if depth > MOST_DEPTH:
            raise ModelError(f"{path}: elements are nested more than {MOST_DEPTH} deep")
        if count > MOST_ELEMENTS:
            raise ModelError(f"{path}: more than {MOST_ELEMENTS} elements")
        level = [child for element in level for child in element]


def numbers(
    element: ET.Element, key: str, count: int, where: str, largest: float = math.inf
) -> list[float]:
    """Return the ``count`` finite numbers of an attribute, at most ``largest`` in magnitude.

    The attribute is rewritten with single spaces: with others the parser below Pinocchio drops the
    element, or the whole link or robot.

    Raises ModelError: the attribute is missing, or does not hold exactly so many such numbers.
    """
    text = element.get(key)
    if text is None:
        raise ModelError(f"{where}: <{element.tag}> has no {key!r}; add it")
    words = text.split()
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    # Python alone reads 1_0 and other scripts' digits.
    if len(values) != len(words) or not text.isascii() or "_" in text:
        shown = text if len(text) < 100 else f"{text[:100]}..."
        raise ModelError(f"{where}: <{element.tag} {key}={shown!r}> is not a number")
    if len(values) != count or not all(math.isfinite(value) for value in values):
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        raise ModelError(f"{where}: <{element.tag} {key}={text!r}>: expected {wanted}")
    if any(abs(value) > largest for value in values):
        raise ModelError(f"{where}: <{element.tag} {key}={text!r}> is larger than {largest:g}")
    element.set(key, " ".join(words))
    return values


def refuse_non_finite(element: ET.Element, path: Path, nearest: str = "the root element") -> None:
    """Refuse NaN and infinity in any attribute that may hold numbers, in all below ``element``."""
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
        refuse_non_finite(child, path, nearest)
