"""A human of rigid segments: the tree of joints, its dimensions, and the robot made of them.

Axes of every segment in the neutral posture (upright, arms hanging, palms to the thighs): x
forward, y to the left, z up, origin at the joint that carries it; the pelvis' is midway between the
hips. Joints of three axes are three hinges in a row.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbc.human.anthropometry import BEHIND, MEAN_STATURE, SegmentInertia, check_sex, segment_table
from wbc.validate import Array, finite_array, finite_number, read_only, set_fields

# Dimensions [m] of a body whose stature is 1.741 m, and how much people of one stature differ.
# Lengths: de Leva (1996), men, whose hip centres are where those of Harrington et al. (2007) are.
DIMENSIONS: Mapping[str, tuple[float, float]] = {
    "hip_y": (0.086, 0.008),  # from the middle of the hips, either side
    "lumbar_x": (-0.010, 0.010),  # from the middle of the hips to the joint of the trunk
    "lumbar_z": (0.146, 0.015),
    "neck_x": (-0.010, 0.015),  # from there to the joint of the head, as high as C7
    "neck_z": (0.458, 0.025),
    "shoulder_x": (0.000, 0.015),
    "shoulder_y": (0.175, 0.015),
    "shoulder_z": (0.370, 0.025),
    "upper_arm": (0.282, 0.015),
    "forearm": (0.269, 0.015),
    "thigh": (0.422, 0.020),
    "shank": (0.434, 0.020),
}
REFERENCE_STATURE = MEAN_STATURE["male"]
NAMES = tuple(DIMENSIONS)
SIDES = {"left": 1.0, "right": -1.0}  # sign of y
MIDDLE_TRUNK = 215.5 / 457.6  # part of the way from the trunk's joint to C7 that is below the chest
HEEL, ANKLE_HEIGHT = 0.045, 0.075  # m of the reference stature: from the ankle back and down
SOLE_WIDTH = 0.38  # of the foot's length
LIMIT = 1e3  # rad: no joint of a fit is limited, arms that circle add up; models need bounds


Axis = tuple[float, float, float]


@dataclass(frozen=True)
class Hinge:
    """One axis of a joint."""

    name: str
    axis: Axis  # in the axes of the segment before it, neutral posture
    spread: float  # rad: how far it usually is from neutral; a fit leans on this where it must


@dataclass(frozen=True)
class Segment:
    """One rigid segment, and the joint that carries it."""

    name: str
    parent: int  # -1: the base
    hinges: tuple[Hinge, ...]
    # Origin in the parent's axes: a row of (dimension, factor) for x, y and z; 0 without one.
    origin: tuple[tuple[str, float] | None, ...]


def _segments() -> tuple[Segment, ...]:
    """Return all segments, each behind the one that carries it."""
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    back = (0.0, -1.0, 0.0)
    found = [Segment("pelvis", -1, (), (None, None, None))]

    def add(
        name: str,
        parent: str,
        joint: str,
        hinges: dict[str, tuple[Axis, float]],
        *origin: tuple[str, float] | None,
    ) -> None:
        carriers = [segment.name for segment in found]
        made = tuple(Hinge(f"{joint}_{what}", *one) for what, one in hinges.items())
        found.append(Segment(name, carriers.index(parent), made, origin))

    for side, s in SIDES.items():
        inward, across = (-s, 0.0, 0.0), (0.0, 0.0, -s)
        hip = {"flexion": (back, 1.0), "adduction": (inward, 0.5), "rotation": (across, 0.4)}
        add(f"{side}_thigh", "pelvis", f"{side}_hip", hip, None, ("hip_y", s), None)
        knee, down = {"flexion": (y, 1.0)}, ("thigh", -1.0)
        add(f"{side}_shank", f"{side}_thigh", f"{side}_knee", knee, None, None, down)
        ankle = {"dorsiflexion": (back, 0.5), "inversion": (inward, 0.3), "rotation": (across, 0.2)}
        down = ("shank", -1.0)
        add(f"{side}_foot", f"{side}_shank", f"{side}_ankle", ankle, None, None, down)
    for name, parent, joint, spread in (
        ("trunk", "pelvis", "lumbar", 0.5),
        ("head", "trunk", "neck", 0.2),
    ):
        turns = {"flexion": (y, spread), "bending": (x, spread), "rotation": (z, spread)}
        add(name, parent, joint, turns, (f"{joint}_x", 1.0), None, (f"{joint}_z", 1.0))
    half = float(np.sqrt(0.5))
    for side, s in SIDES.items():
        inward, across = (-s, 0.0, 0.0), (0.0, 0.0, -s)
        # Three hinges in a row lose an axis where the last lies along the first: here only where
        # the arm points level, halfway between forwards and sideways.
        swing, lift = (half, s * half, 0.0), (s * half, -half, 0.0)
        shoulder = {"swing": (swing, 1.5), "lift": (lift, 1.5), "rotation": (across, 1.0)}
        place = (("shoulder_x", 1.0), ("shoulder_y", s), ("shoulder_z", 1.0))
        add(f"{side}_upper_arm", "trunk", f"{side}_shoulder", shoulder, *place)
        elbow = {"elbow_flexion": (back, 1.0), "forearm_pronation": (across, 0.7)}
        down = ("upper_arm", -1.0)
        add(f"{side}_forearm", f"{side}_upper_arm", side, elbow, None, None, down)
        wrist, down = {"deviation": (back, 0.2), "flexion": (inward, 0.3)}, ("forearm", -1.0)
        add(f"{side}_hand", f"{side}_forearm", f"{side}_wrist", wrist, None, None, down)
    return tuple(found)


SEGMENTS = _segments()
SEGMENT_NAMES = tuple(segment.name for segment in SEGMENTS)
HINGES = tuple(hinge for segment in SEGMENTS for hinge in segment.hinges)
HINGE_NAMES = tuple(hinge.name for hinge in HINGES)


def origin_maps() -> Array:
    """Return (segments, 3, dimensions): a segment's origin in its parent's axes by dimensions."""
    maps = np.zeros((len(SEGMENTS), 3, len(NAMES)))
    for segment, found in zip(SEGMENTS, maps, strict=True):
        for row, entry in zip(found, segment.origin, strict=True):
            if entry is not None:
                row[NAMES.index(entry[0])] = entry[1]
    return maps


@dataclass(frozen=True, eq=False)
class HumanBody:
    """The dimensions and the mass of one human.

    Attributes
    ----------
    dimensions:
        (12,) [m], in the order of ``wbc.human.body.NAMES``.
    mass:
        [kg].
    stature:
        [m]; of head, hands and feet, whose lengths no joint tells.
    sex:
        ``female`` or ``male``, which table of segments is taken.

    Raises
    ------
    InvalidInputError
        Lengths, mass or stature that are not positive, or another sex.
    """

    dimensions: Array
    mass: float
    stature: float
    sex: str

    def __post_init__(self) -> None:
        sizes = finite_array("body: dimensions", self.dimensions, (len(NAMES),))
        for name, value in zip(NAMES, sizes.tolist(), strict=True):
            if not name.endswith("_x"):
                finite_number(f"body: {name}", value, above=0.0)
        mass = finite_number("body: mass", self.mass, above=0.0)
        stature = finite_number("body: stature", self.stature, above=0.0)
        sex = check_sex(self.sex)
        set_fields(self, dimensions=read_only(sizes), mass=mass, stature=stature, sex=sex)

    def __repr__(self) -> str:
        return f"HumanBody({self.sex}, {self.stature:.2f} m, {self.mass:.1f} kg)"

    @classmethod
    def of(cls, stature: float, mass: float, sex: str) -> HumanBody:
        """Return a body of usual proportions."""
        stature = finite_number("body: stature", stature, above=0.0)
        return cls(usual_dimensions(stature)[0], mass, stature, sex)

    def size(self, name: str) -> float:
        """Return one dimension [m]."""
        return float(self.dimensions[NAMES.index(name)])

    @property
    def scale(self) -> float:
        """Stature, by that of the reference."""
        return self.stature / REFERENCE_STATURE


def usual_dimensions(stature: float) -> tuple[Array, Array]:
    """Return the usual dimensions (12,) [m] at a stature [m], and their standard deviations."""
    both = np.array(list(DIMENSIONS.values())) * (stature / REFERENCE_STATURE)
    return both[:, 0], both[:, 1]


@dataclass(frozen=True, eq=False)
class Mass:
    """A segment's mass [kg], its centre (3,) [m] and inertia (3, 3) about it [kg m^2]."""

    mass: float
    centre: Array
    inertia: Array


def masses(body: HumanBody) -> dict[str, Mass]:
    """Return the segments' masses in their own axes; the trunk is made of two of the table's."""
    table = segment_table(body.sex)

    def along(row: SegmentInertia, start: Array, end: Array, forward: Array | None = None) -> Mass:
        """Return a row's mass along a line; its sagittal axis is as near to ``forward`` as can."""
        line = end - start
        length = float(np.linalg.norm(line))
        z = -line / length
        x = np.array((1.0, 0.0, 0.0)) if forward is None else forward
        x = x - z * (x @ z)
        x /= np.linalg.norm(x)
        R = np.column_stack((x, np.cross(z, x), z))
        m = row.mass * body.mass
        radii = np.array(row.radii) * length
        return Mass(m, start + row.centre * line, R @ np.diag(m * radii**2) @ R.T)

    zero = np.zeros(3)
    lumbar = np.array((body.size("lumbar_x"), 0.0, body.size("lumbar_z")))
    neck = np.array((body.size("neck_x"), 0.0, body.size("neck_z")))
    chest = MIDDLE_TRUNK * neck
    back = np.array((-BEHIND[body.sex]["trunk"] * float(np.linalg.norm(neck)), 0.0, 0.0))
    trunk = joined(
        along(table["upper_trunk"], neck + back, chest + back),
        along(table["middle_trunk"], chest + back, back),
    )
    # The table's axis of the head is from the top down to C7, above which the neck leans forward.
    top = np.array((0.02, 0.0, table["head"].length / MEAN_STATURE[body.sex] * body.stature))
    found = {
        "pelvis": along(table["lower_trunk"], lumbar, zero),
        "trunk": trunk,
        "head": along(table["head"], top, zero),
    }
    up = np.array((0.0, 0.0, 1.0))

    def behind(name: str) -> Mass:
        length = body.size(name)
        on_axis = along(table[name], zero, -up * length)
        off = np.array((-BEHIND[body.sex][name] * length, 0.0, 0.0))
        return Mass(on_axis.mass, on_axis.centre + off, on_axis.inertia)

    hand = table["hand"].length / MEAN_STATURE[body.sex] * body.stature
    heel, toe = foot_ends(body)
    for side in SIDES:
        found |= {
            f"{side}_upper_arm": along(table["upper_arm"], zero, -up * body.size("upper_arm")),
            f"{side}_forearm": along(table["forearm"], zero, -up * body.size("forearm")),
            f"{side}_hand": along(table["hand"], zero, -up * hand),
            f"{side}_thigh": behind("thigh"),
            f"{side}_shank": behind("shank"),
            f"{side}_foot": along(table["foot"], heel, toe, up),
        }
    return found


def foot_ends(body: HumanBody) -> tuple[Array, Array]:
    """Return heel and tip of the toes (3,) [m] in the foot's axes, midway of sole and ankle."""
    length = segment_table(body.sex)["foot"].length / MEAN_STATURE[body.sex] * body.stature
    heel = body.scale * np.array((-HEEL, 0.0, -0.6 * ANKLE_HEIGHT))
    return heel, heel + np.array((length, 0.0, -0.2 * ANKLE_HEIGHT * body.scale))


def joined(a: Mass, b: Mass) -> Mass:
    """Return two masses as one."""
    m = a.mass + b.mass
    centre = (a.mass * a.centre + b.mass * b.centre) / m
    inertia = a.inertia + b.inertia
    for part in (a, b):
        arm = part.centre - centre
        inertia = inertia + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Mass(m, centre, inertia)


def subtree(segment: int) -> NDArray[np.bool_]:
    """Return which segments (n,) a segment carries, itself among them."""
    carried = np.zeros(len(SEGMENTS), dtype=bool)
    carried[segment] = True
    for k in range(segment + 1, len(SEGMENTS)):
        carried[k] = SEGMENTS[k].parent >= 0 and carried[SEGMENTS[k].parent]
    return carried
