"""Named robots: where their files are, which joints are locked, where they stand.

The robots other than ``hoap2_like`` come with the package ``example-robot-data`` (``pip install
wbc[robots]``), whose files are found without importing it. Those of other packages can be named
too: see :mod:`wbc.robot.packages`.
"""

from __future__ import annotations

import importlib.metadata
import os
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from wbc.errors import InvalidInputError, ModelError, UnknownNameError, shown, suggest
from wbc.files import beside
from wbc.robot.feet import FootSpec
from wbc.robot.formats.mjcf_compile import is_mujoco
from wbc.robot.packages import DESCRIPTIONS, MENAGERIE, from_menagerie, from_robot_descriptions

DATA_VARIABLE = "WBC_ROBOT_DATA"  # a folder holding g1_description, talos_data, ...
_DATA = Path("cmeel.prefix/share/example-robot-data/robots")
_HERE = Path(__file__).parent / "models"


@dataclass(frozen=True)
class NamedRobot:
    """A robot known by name."""

    # urdf and srdf: files, relative to the folder of robots (or to this package's, if shipped).
    urdf: str
    srdf: str | None = None
    # Joints that are held, and at what [rad].
    locked: Mapping[str, float] = field(default_factory=dict)
    feet: Mapping[str, FootSpec] = field(default_factory=dict)  # its feet
    # A posture with bent knees and level soles: joint or pattern to value [rad]; others are 0.
    standing: Mapping[str, float] = field(default_factory=dict)
    # Orientation (x, y, z, w) of the base in that posture, to make the robot face +x.
    base_quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    # Rotor inertia as felt at joints or patterns [kg m^2], where the file has none and the mass
    # matrix would be singular without.
    armature: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # what a user should know about the files
    shipped: bool = False  # true if the files come with this package


@dataclass(frozen=True)
class RobotSource:
    """Where a robot is to be read from."""

    name: str | None
    path: Path
    package_dirs: tuple[Path, ...] = ()
    srdf: Path | None = None
    known: NamedRobot | None = None
    given: Any = None  # in place of the file: XML text, an MjSpec or an MjModel


_G1 = NamedRobot(
    urdf="g1_description/urdf/g1_29dof_rev_1_0.urdf",
    feet={"left": FootSpec("left_ankle_roll_link"), "right": FootSpec("right_ankle_roll_link")},
    standing={
        "*_hip_pitch_joint": -0.3,
        "*_knee_joint": 0.6,
        "*_ankle_pitch_joint": -0.3,
        "*_shoulder_pitch_joint": 0.2,
        "left_shoulder_roll_joint": 0.2,
        "right_shoulder_roll_joint": -0.2,
        "*_elbow_joint": 0.6,
    },
)

ROBOTS: Mapping[str, NamedRobot] = {
    "hoap2_like": NamedRobot(
        urdf="hoap2_like.urdf",
        shipped=True,
        feet={"left": FootSpec("left_foot"), "right": FootSpec("right_foot")},
        standing={
            "*_hip_pitch": -0.3,
            "*_knee_pitch": 0.6,
            "*_ankle_pitch": -0.3,
            "left_shoulder_roll": 0.15,
            "right_shoulder_roll": -0.15,
            "*_elbow_pitch": -0.3,
        },
    ),
    "g1": _G1,
    # The 27-joint variant of the robot: the same machine with its waist bolted upright.
    "g1_27": replace(_G1, locked={"waist_roll_joint": 0.0, "waist_pitch_joint": 0.0}),
    # The reduced model is the one that whole-body controllers are published with; the fingers of
    # the full one are coupled (mimic) joints. Its two grippers are held: moving a fingerless
    # linkage would only give the controller two joints that mean nothing.
    "talos": NamedRobot(
        urdf="talos_data/robots/talos_reduced.urdf",
        srdf="talos_data/srdf/talos.srdf",
        locked={"gripper_left_joint": 0.0, "gripper_right_joint": 0.0},
        feet={"left": FootSpec("leg_left_6_link"), "right": FootSpec("leg_right_6_link")},
        standing={
            "leg_*_3_joint": -0.411354,
            "leg_*_4_joint": 0.859395,
            "leg_*_5_joint": -0.448041,
            "arm_left_1_joint": 0.25847,
            "arm_right_1_joint": -0.25847,
            "arm_left_2_joint": 0.173046,
            "arm_right_2_joint": -0.173046,
            "arm_*_4_joint": -0.525366,
            "arm_*_7_joint": 0.1,
            "torso_2_joint": 0.006761,
        },
    ),
    "icub": NamedRobot(
        urdf="icub_description/robots/icub.urdf",
        srdf="icub_description/srdf/icub.srdf",
        # Heel 48 mm behind the ankle and toe 109 mm before it, as drawn; see the note.
        feet={
            side: FootSpec(
                f"{side[0]}_sole", [[-0.029, -0.03], [0.127, -0.03], [0.127, 0.03], [-0.029, 0.03]]
            )
            for side in ("left", "right")
        },
        base_quaternion=(0.0, 0.0, 1.0, 0.0),  # the base's x axis points backwards
        standing={
            "?_hip_pitch": 0.35,
            "?_knee": -0.6,
            "?_ankle_pitch": -0.25,
            "?_shoulder_roll": 0.35,
            "?_shoulder_yaw": 0.5,
            "?_elbow": 0.5,
        },
        armature={"neck_*": 1e-3},
        notes=(
            "the collision shapes of the feet are turned by 90 degrees in the files",
            "the neck's joints get a rotor inertia of 0.001 kg m^2: in the file the neck turns"
            " without moving any mass",
        ),
    ),
    # The model without fingers, whose links have no mass in the full one.
    "romeo": NamedRobot(
        urdf="romeo_description/urdf/romeo_small.urdf",
        srdf="romeo_description/srdf/romeo_small.srdf",
        feet={"left": FootSpec("l_ankle"), "right": FootSpec("r_ankle")},
        standing={
            "?HipPitch": -0.3490658,
            "?KneePitch": 0.6981317,
            "?AnklePitch": -0.3490658,
            "?ShoulderPitch": 1.5,
            "LShoulderYaw": 0.6,
            "RShoulderYaw": -0.6,
            "LElbowRoll": -0.5,
            "RElbowRoll": 0.5,
            "LElbowYaw": -1.05,
            "RElbowYaw": 1.05,
        },
    ),
}


def robot_names() -> tuple[str, ...]:
    """Return the names of the robots that this package describes itself."""
    return tuple(ROBOTS)


def find_robot(source: Any) -> RobotSource:
    """Return where to read a robot from: a file, a name, XML text, or what MuJoCo made.

    A string is taken as XML if it begins with ``<``, as a file if it has a folder in it or a
    file's ending.

    Raises UnknownNameError: not a file and not a known name; ModelError: the robot is known but its
    files are not installed; InvalidInputError: none of these.
    """
    for kind in ("MjModel", "MjSpec"):
        if is_mujoco(source, kind):
            return RobotSource(name=None, path=Path(kind), given=source)
    if isinstance(source, str) and (xml := source.lstrip("\ufeff")).lstrip().startswith("<"):
        return RobotSource(name=None, path=Path("XML text"), given=xml)
    lines = isinstance(source, str) and "\n" in source and not os.path.exists(source)
    if not isinstance(source, str | Path) or lines:  # other text than XML
        text = "; XML is given as text, which begins with <" if isinstance(source, bytes) else ""
        raise InvalidInputError(
            f"robot: expected a file or a name such as 'g1', got {shown(source)}{text}"
        )
    text = str(source)
    if isinstance(source, str) and text.startswith(MENAGERIE):
        robot = text.removeprefix(MENAGERIE).partition("/")[0]
        return RobotSource(name=robot, path=from_menagerie(text))
    if isinstance(source, Path) or is_file_name(text):
        return RobotSource(name=None, path=beside(Path(), source))
    known = ROBOTS.get(text)
    if known is None:
        return _from_packages(text)
    folder = _HERE if known.shipped else _data_folder(text, known.urdf)
    srdf = None if known.srdf is None else folder / known.srdf
    return RobotSource(name=text, path=folder / known.urdf, srdf=srdf, known=known)


def is_file_name(text: str) -> bool:
    """Return whether a robot's name is meant as a file: it has a folder in it or an ending."""
    if text.startswith((MENAGERIE, DESCRIPTIONS)):
        return False
    return "/" in text or os.sep in text or Path(text).suffix != ""


def _data_folder(name: str, urdf: str) -> Path:
    for folder in _data_folders():
        if (folder / urdf).is_file():
            return folder
    given = os.environ.get(DATA_VARIABLE)
    hint = f" ({DATA_VARIABLE} is set to {given!r}, which has no {urdf})" if given else ""
    raise ModelError(
        f"robot {name!r}: its files are not installed{hint}; pip install wbc[robots], or set"
        f" {DATA_VARIABLE} to the folder that holds {urdf.partition('/')[0]}"
    )


def _data_folders() -> Iterator[Path]:
    """Yield the places to look: what the user says, what pip installed, what Python can see."""
    if os.environ.get(DATA_VARIABLE):
        yield Path(os.environ[DATA_VARIABLE])
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        files = []
    for file in files:
        if file.is_relative_to(_DATA):
            yield Path(str(file.locate())).parents[len(file.relative_to(_DATA).parts) - 1]
            break
    yield from (Path(entry) / _DATA for entry in sys.path)


def _from_packages(name: str) -> RobotSource:
    """Return the files of a robot that another package has; may download them."""
    found = from_robot_descriptions(name)
    if found is None:
        known = suggest(name, robot_names()).lstrip("; ")
        known = known.strip("()") if known.startswith("(") else known
        others = ("robot_descriptions", "mujoco-menagerie")
        lacking = [one for one in others if find_spec(one.replace("-", "_")) is None]
        more = f", or pip install {' or '.join(lacking)} for its many" if lacking else ""
        remedy = f"{known}; or give the path of a URDF or MJCF file{more}"
        raise UnknownNameError("robot", name, robot_names(), remedy)
    return RobotSource(name.removeprefix(DESCRIPTIONS), *found)
