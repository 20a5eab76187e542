"""The shipped humanoid: its file, its inertias, its figures, its symmetry and its shapes.

Everything is measured on the URDF as Pinocchio and Coal read it; the generator's tables are used
only for the masses of the primitives of a link, which a URDF does not hold.
"""

import importlib.util
import sys
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

_SPEC = importlib.util.spec_from_file_location(
    "make_hoap2_like", Path(__file__).parents[2] / "benchmarks/make_hoap2_like.py"
)
assert _SPEC is not None and _SPEC.loader is not None
generator = sys.modules[_SPEC.name] = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(generator)

Array = NDArray[np.float64]
URDF = generator.URDF
MIRROR = np.diag([1.0, -1.0, 1.0])  # reflection in the x-z plane
LEG = ("hip_yaw", "hip_roll", "hip_pitch", "knee_pitch", "ankle_pitch", "ankle_roll")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow_pitch", "hand")
TRUNK = ("waist_pitch", "head_yaw", "head_pitch")
AXES = {"roll": "X", "pitch": "Y", "yaw": "Z", "hand": "Y"}  # by the end of a joint's name


@pytest.fixture(scope="module")
def model() -> pin.Model:
    return pin.buildModelFromUrdf(str(URDF), pin.JointModelFreeFlyer())


@pytest.fixture(scope="module")
def shapes(model: pin.Model) -> pin.GeometryModel:
    return pin.buildGeomFromUrdf(model, str(URDF), pin.GeometryType.COLLISION)


@pytest.fixture(scope="module")
def standing(model: pin.Model) -> pin.Data:
    """Positions in the zero posture, the torso's frame along the world's."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    return data


def frame(model: pin.Model, data: pin.Data, name: str) -> pin.SE3:
    index = model.getFrameId(name)
    assert index < model.nframes, name
    return data.oMf[index]


def link_of(model: pin.Model, shape: pin.GeometryObject) -> str:
    return str(model.frames[shape.parentFrame].name)


def shapes_of(
    model: pin.Model, shapes: pin.GeometryModel, link: str
) -> list[tuple[pin.SE3, coal.CollisionGeometry]]:
    """Return the shapes of a link, in the file's order, each with its pose in the link's frame."""
    to_joint = model.frames[model.getFrameId(link, pin.FrameType.BODY)].placement
    found = [shape for shape in shapes.geometryObjects if link_of(model, shape) == link]
    return [(to_joint.actInv(shape.placement), shape.geometry) for shape in found]


def height_span(shape: coal.CollisionGeometry, pose: pin.SE3) -> tuple[float, float]:
    """Return the lowest and the highest altitude of a placed shape [m]."""
    up = pose.rotation[2]  # the world's z, in the shape's frame
    if isinstance(shape, coal.Box):
        reach = np.abs(up) @ shape.halfSide
    elif isinstance(shape, coal.Cylinder):
        reach = shape.halfLength * abs(up[2]) + shape.radius * np.hypot(up[0], up[1])
    else:
        reach = shape.radius
    return pose.translation[2] - reach, pose.translation[2] + reach


def random_joints(model: pin.Model, rng: np.random.Generator) -> Array:
    """Return a configuration within the joints' limits, the base at the origin."""
    q: Array = pin.neutral(model)
    q[7:] = rng.uniform(model.lowerPositionLimit[7:], model.upperPositionLimit[7:])
    return q


def mirrored(model: pin.Model, q: Array) -> Array:
    """Return the configuration that is the image of `q` in the x-z plane.

    Reflecting a rotation, M R M, reverses the parts of its quaternion along x and z.
    """
    image: Array = pin.neutral(model)
    image[:3] = MIRROR @ q[:3]
    image[3:7] = q[3:7] * [-1, 1, -1, 1]
    swap = {"left": "right", "right": "left"}
    for index in range(2, model.njoints):
        name = model.names[index]
        side, _, rest = name.partition("_")
        twin = f"{swap[side]}_{rest}" if side in swap else name
        sign = -1.0 if name.endswith(("yaw", "roll")) else 1.0
        image[model.joints[model.getJointId(twin)].idx_q] = sign * q[model.joints[index].idx_q]
    return image


def touching(
    model: pin.Model, shapes: pin.GeometryModel, q: Array, apart: range
) -> set[tuple[str, str]]:
    """Return the pairs of links in collision, of those that `apart` joints separate.

    Only joints that move count, so that a massless frame adds nothing to a distance.
    """
    checked = shapes.copy()
    checked.removeAllCollisionPairs()
    objects = checked.geometryObjects
    for first in range(len(objects)):
        for second in range(first):
            ends = objects[first].parentJoint, objects[second].parentJoint
            ways = [set(model.supports[joint]) for joint in ends]
            if len(ways[0] ^ ways[1]) in apart:
                checked.addCollisionPair(pin.CollisionPair(second, first))
    assert len(checked.collisionPairs) > 0
    found = checked.createData()
    pin.computeCollisions(model, model.createData(), checked, found, q, False)
    return {
        (link_of(model, objects[pair.first]), link_of(model, objects[pair.second]))
        for pair, result in zip(checked.collisionPairs, found.collisionResults, strict=True)
        if result.isCollision()
    }


def test_the_committed_file_is_what_the_generator_writes() -> None:
    assert URDF.read_text(encoding="utf-8") == generator.urdf()
    assert "Generated by" in URDF.read_text(encoding="utf-8").splitlines()[1]


@pytest.mark.parametrize("link", generator.links(), ids=lambda link: link.name)
def test_inertia_is_that_of_the_collision_shapes(
    model: pin.Model, shapes: pin.GeometryModel, link: Any
) -> None:
    placed = shapes_of(model, shapes, link.name)
    assert len(placed) == len(link.parts) > 0
    expected = pin.Inertia.Zero()
    for (pose, shape), part in zip(placed, link.parts, strict=True):
        if isinstance(shape, coal.Box):
            inertia = pin.Inertia.FromBox(part.mass, *(2 * shape.halfSide))
        elif isinstance(shape, coal.Cylinder):
            inertia = pin.Inertia.FromCylinder(part.mass, shape.radius, 2 * shape.halfLength)
        else:
            inertia = pin.Inertia.FromSphere(part.mass, shape.radius)
        expected += pose.act(inertia)

    # A moving link's frame is its joint's, so its inertia is the joint's as well.
    body = model.frames[model.getFrameId(link.name, pin.FrameType.BODY)]
    assert body.placement == pin.SE3.Identity()
    actual = model.inertias[body.parentJoint]
    assert actual.mass == pytest.approx(expected.mass, rel=1e-12)
    np.testing.assert_allclose(actual.lever, expected.lever, rtol=0, atol=1e-10)
    size = np.abs(expected.inertia).max()  # the file keeps nine digits
    np.testing.assert_allclose(actual.inertia, expected.inertia, rtol=0, atol=1e-8 * size)


def test_joints(model: pin.Model) -> None:
    expected = {*TRUNK, *(f"{side}_{name}" for side in ("left", "right") for name in LEG + ARM)}
    assert len(expected) == 25
    assert set(model.names) == {"universe", "root_joint", *expected}
    assert (model.nq, model.nv) == (7 + 25, 6 + 25)
    for name in expected:
        joint = model.getJointId(name)
        axis = AXES[name.split("_")[-1]]
        assert model.joints[joint].shortname() == f"JointModelR{axis}"  # about +x, +y or +z
        np.testing.assert_array_equal(model.jointPlacements[joint].rotation, np.eye(3))
    np.testing.assert_array_equal(model.upperVelocityLimit[6:], 5.0)
    np.testing.assert_array_equal(model.upperEffortLimit[6:], 9.0)
    assert (model.lowerPositionLimit[7:] <= 0).all()
    assert (model.upperPositionLimit[7:] >= 0).all()


def test_limits_mirror_and_bend_the_right_way(model: pin.Model) -> None:
    low, high = model.lowerPositionLimit, model.upperPositionLimit
    images = mirrored(model, low), mirrored(model, high)
    np.testing.assert_array_equal(np.minimum(*images)[7:], low[7:])
    np.testing.assert_array_equal(np.maximum(*images)[7:], high[7:])

    def limits(name: str) -> tuple[float, float]:
        index = model.joints[model.getJointId(name)].idx_q
        return round(float(np.rad2deg(low[index])), 6), round(float(np.rad2deg(high[index])), 6)

    assert limits("left_hip_yaw") == (-31, 91)  # far outwards, little inwards
    assert limits("right_hip_yaw") == (-91, 31)
    assert limits("left_hip_roll") == (-21, 31)
    assert limits("right_hip_roll") == (-31, 21)
    assert limits("left_hip_pitch") == limits("right_hip_pitch") == (-82, 71)
    assert limits("left_knee_pitch") == (-1, 130)
    assert limits("left_shoulder_roll") == (-2, 96)

    def moved(joint: str, angle: float, tip: str, of: str) -> Array:
        """Displacement of `tip`, seen from `of`, when the joint turns from zero."""
        data, places = model.createData(), []
        for value in (0.0, angle):
            q = pin.neutral(model)
            q[model.joints[model.getJointId(joint)].idx_q] = value
            pin.framesForwardKinematics(model, data, q)
            places.append(frame(model, data, of).actInv(frame(model, data, tip)).translation)
        return np.asarray(places[1] - places[0])

    flexion = {  # the way along x that `tip` goes, seen from `of`, on the longer side of the range
        "left_hip_pitch": ("left_sole", "pelvis", 1),
        "left_knee_pitch": ("left_sole", "left_thigh", -1),
        "left_shoulder_pitch": ("left_palm", "torso", 1),
        "left_elbow_pitch": ("left_palm", "left_upper_arm", 1),
        "waist_pitch": ("head", "pelvis", 1),
    }
    for joint, (tip, of, sign) in flexion.items():
        ends = np.deg2rad(limits(joint))
        larger = ends[np.argmax(np.abs(ends))]
        assert sign * moved(joint, 0.5 * larger, tip, of)[0] > 0.02, joint
    nod = model.joints[model.getJointId("head_pitch")].idx_q
    assert high[nod] > -low[nod]  # and a positive pitch turns the face down


def test_mass_and_centre_of_mass(model: pin.Model, standing: pin.Data) -> None:
    assert 7.0 < pin.computeTotalMass(model) < 7.2
    com = pin.centerOfMass(model, model.createData(), pin.neutral(model))
    from_sole = com - frame(model, standing, "left_sole").translation
    assert 0.28 < from_sole[2] < 0.30
    assert abs(from_sole[0]) < 0.02  # well inside the sole
    assert abs(com[1]) < 1e-12


@pytest.mark.parametrize("side", ["left", "right"])
def test_lengths_of_the_leg(
    model: pin.Model, standing: pin.Data, shapes: pin.GeometryModel, side: str
) -> None:
    sign = {"left": 1.0, "right": -1.0}[side]
    hips = [frame(model, standing, f"{side}_hip_{axis}") for axis in ("yaw", "roll", "pitch")]
    hip, knee, ankle, ankle_roll, sole = (
        frame(model, standing, f"{side}_{name}").translation
        for name in ("hip_pitch", "knee_pitch", "ankle_pitch", "ankle_roll", "sole")
    )
    for other in hips:
        np.testing.assert_allclose(other.translation, hip, atol=1e-12)
    np.testing.assert_allclose(ankle_roll, ankle, atol=1e-12)
    np.testing.assert_allclose(hip - knee, [0, 0, 0.100], atol=1e-12)
    np.testing.assert_allclose(knee - ankle, [0, 0, 0.100], atol=1e-12)
    assert ankle[2] - sole[2] == pytest.approx(0.040, abs=1e-12)
    assert hip[1] == pytest.approx(sign * 0.078 / 2, abs=1e-12)

    # The sole's frame is at the centre of the lower face of the sole's box, and along it.
    boxes = [(pose, shape) for pose, shape in shapes_of(model, shapes, f"{side}_foot")]
    pose, box = min(boxes, key=lambda item: height_span(item[1], item[0])[0])
    np.testing.assert_allclose(2 * box.halfSide[:2], [0.094, 0.062], atol=1e-12)
    centre = pose.act(np.array([0.0, 0.0, -box.halfSide[2]]))
    ankle_to_sole = frame(model, standing, f"{side}_foot").actInv(
        frame(model, standing, f"{side}_sole")
    )
    np.testing.assert_allclose(ankle_to_sole.translation, centre, atol=1e-12)
    np.testing.assert_allclose(ankle_to_sole.rotation, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_mirrored_postures_have_mirrored_inertia(model: pin.Model, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = random_joints(model, rng)
    q[:3] = rng.normal(size=3)
    q[3:7] = pin.Quaternion(pin.exp3(rng.normal(size=3))).coeffs()
    data, image = model.createData(), model.createData()
    pin.ccrba(model, data, q, np.zeros(model.nv))
    pin.ccrba(model, image, mirrored(model, q), np.zeros(model.nv))

    com, com_image = data.com[0], image.com[0]
    np.testing.assert_allclose(
        com_image, MIRROR @ com, rtol=0, atol=1e-12 * float(np.linalg.norm(com))
    )
    inertia, size = MIRROR @ data.Ig.inertia @ MIRROR, float(np.linalg.norm(data.Ig.inertia))
    np.testing.assert_allclose(image.Ig.inertia, inertia, rtol=0, atol=1e-12 * size)


def test_links_do_not_touch_in_the_zero_posture(
    model: pin.Model, shapes: pin.GeometryModel
) -> None:
    """Neighbours, which share a joint, may overlap around it; no other pair may."""
    assert touching(model, shapes, pin.neutral(model), range(2, 100)) == set()


@pytest.mark.slow
def test_a_link_clears_the_next_but_one(model: pin.Model, shapes: pin.GeometryModel) -> None:
    """Within the joints' ranges, even across the coincident axes of a hip, shoulder or ankle.

    Excluding the pairs that share a joint is thus enough to look for self-collisions.  Links two
    joints apart by a common parent, such as the two hips, are among the pairs as well.
    """
    rng = np.random.default_rng(0)
    low, high = model.lowerPositionLimit[7:], model.upperPositionLimit[7:]
    for _ in range(60):
        q = random_joints(model, rng)
        assert touching(model, shapes, q, range(2, 3)) == set()
        q[7:] = np.where(rng.random(q.size - 7) < 0.5, low, high)  # a corner of the ranges
        assert touching(model, shapes, q, range(2, 3)) == set()
