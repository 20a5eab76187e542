"""A human of rigid segments: the tree of joints, its dimensions and masses.

Axes of every segment in the neutral posture (upright, arms hanging, palms to the thighs): x
forward, y to the left, z up, origin at the parent joint, that of the pelvis midway between the
hips. Joints with three axes are three hinges in a row.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wbc.human.anthropometry import BEHIND, MEAN_STATURE, SegmentInertia, check_sex, segment_table
from wbc.validate import Array, finite_array, finite_number, read_only, set_fields

# Dimensions [m] of a body with a stature of 1.741 m, and their standard deviation among people of
# one stature. Lengths: de Leva (1996), men; hip centres agree with Harrington et al. (2007).
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
LIMIT = 1e3  # rad: a fit has no joint limits (circling arms add up), but models need bounds


Axis = tuple[float, float, float]


@dataclass(frozen=True)
class Hinge:
    """One axis of a joint."""

    name: str
    axis: Axis  # in the axes of the segment before it, neutral posture
    spread: float  # rad, standard deviation from neutral: a prior for what no marker tells


@dataclass(frozen=True)
class Segment:
    """One rigid segment and its parent joint."""

    name: str
    parent: int  # -1: the base
    hinges: tuple[Hinge, ...]
    # Origin in the parent's axes: a row of (dimension, factor) for x, y and z; 0 without one.
    origin: tuple[tuple[str, float] | None, ...]


def _segments() -> tuple[Segment, ...]:
    """Return all segments, each after its parent."""
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
        names = [segment.name for segment in found]
        axes = tuple(Hinge(f"{joint}_{what}", *one) for what, one in hinges.items())
        found.append(Segment(name, names.index(parent), axes, origin))

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
        spine = {"flexion": (y, spread), "bending": (x, spread), "rotation": (z, spread)}
        add(name, parent, joint, spine, (f"{joint}_x", 1.0), None, (f"{joint}_z", 1.0))
    half = float(np.sqrt(0.5))
    for side, s in SIDES.items():
        inward, across = (-s, 0.0, 0.0), (0.0, 0.0, -s)
        # Three hinges are singular where the last axis is parallel to the first: here only with a
        # horizontal arm, halfway between forward and sideways.
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
    """Return matrices (segments, 3, 12) from dimensions to origins in the parent's axes."""
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
        [m]; for lengths of head, hands and feet, which have no joint at their end.
    sex:
        ``female`` or ``male``: which table of segments is used.

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
    """Mass [kg] of a segment, centre (3,) [m] and inertia (3, 3) about the centre [kg m^2]."""

    mass: float
    centre: Array
    inertia: Array


def masses(body: HumanBody) -> dict[str, Mass]:
    """Return the segments' masses in their own axes; the trunk joins two of the table's."""
    table = segment_table(body.sex)

    def along(row: SegmentInertia, start: Array, end: Array, forward: Array | None = None) -> Mass:
        """Return a row's mass along a line, its sagittal axis nearest to ``forward``."""
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
    trunk = combine(
        along(table["upper_trunk"], neck + back, chest + back),
        along(table["middle_trunk"], chest + back, back),
    )
    # The head's axis in the table goes from the vertex to C7; the neck leans forward.
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
        offset = np.array((-BEHIND[body.sex][name] * length, 0.0, 0.0))
        return Mass(on_axis.mass, on_axis.centre + offset, on_axis.inertia)

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
    """Return heel and tip of the toes (3,) [m] in the foot's axes: middles of their heights."""
    length = segment_table(body.sex)["foot"].length / MEAN_STATURE[body.sex] * body.stature
    heel = body.scale * np.array((-HEEL, 0.0, -0.6 * ANKLE_HEIGHT))
    return heel, heel + np.array((length, 0.0, -0.2 * ANKLE_HEIGHT * body.scale))


def combine(a: Mass, b: Mass) -> Mass:
    """Return two masses as one rigid body."""
    m = a.mass + b.mass
    centre = (a.mass * a.centre + b.mass * b.centre) / m
    inertia = a.inertia + b.inertia
    for part in (a, b):
        arm = part.centre - centre
        inertia = inertia + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Mass(m, centre, inertia)
