"""Whatever is given for an array or a number of the public API: a typed error, or it is numbers.

Every entry is called with one argument after the other spoilt, the others sound.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

import wbc
from wbc import Robot, WbcError, support
from wbc.motion import Motion
from wbc.motion.forces import MeasuredForces
from wbc.polygon import inset, polygon_margin
from wbc.qp.problem import QP
from wbc.rmp.axes import follow, track
from wbc.rmp.balance.law import LawBounds
from wbc.rmp.balance.push_limits import Wheel, push_limits
from wbc.rmp.ellipsoid import (
    equimomental,
    equimomental_at_density,
    reaction_mass_radii,
    second_moment,
)
from wbc.rmp.plan.schedule import PlanPhase, at_rest, hull, radii_for
from wbc.rmp.planar import PlanarRmp
from wbc.robot.collision.shapes import Capsule, HalfSpace, Hull, Obstacle
from wbc.simulation.mismatch import ModelMismatch
from wbc.simulation.push import Push
from wbc.simulation.push_bounds import capture_impulse
from wbc.simulation.terrain import Step

ROBOT = Robot.load("hoap2_like")
HERE = ROBOT.snapshot(ROBOT.posture())
HELD = support(HERE, "double")
EYE, ZERO = np.eye(3), np.zeros(3)
SQUARE = [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]
SHAPE = HERE.inertia
REST = np.zeros(ROBOT.nv)
FOOT = "left_sole"

BAD: dict[str, Any] = {
    "ragged": [[1.0], [2.0, 3.0]],
    "ragged tuples": ((1.0, 2.0), (1.0,), ()),
    "a word": "x",
    "words": ["a", "b", "c"],
    "bytes": b"123",
    "numerals": ["1", "2", "3"],
    "an object": object(),
    "objects": [object()] * 3,
    "a set": {1.0, 2.0, 3.0},
    "a dict": {},
    "a generator": (x for x in (1.0, 2.0, 3.0)),
    "a function": len,
    "None in it": [None, None, None],
    "complex": np.ones(3) + 1j,
    "complex ones": [1j, 1.0, 1.0],
    "one complex": 1 + 1j,
    "complex objects": np.array([np.complex128(1j)] * 3, dtype=object),
    "NaN": np.full(3, np.nan),
    "beyond floats": 10**400,
    "one beyond floats": [10**400, 1, 1],
    "cubic": np.ones((2, 2, 2)),
    "empty": [],
    "emptier": [[], [], []],
    "dates": np.array(["2020-01-01"] * 3, dtype="datetime64[D]"),
    "spans": np.array([1, 2, 3], dtype="timedelta64[s]"),
    "records": np.zeros(3, dtype=[("a", float)]),
    "truth values": [True, False, True],
    "one truth value": [1.0, np.bool_(True), 2.0],
}


def setter(make: Callable[[], Any], name: str = "set_target") -> Callable[..., Any]:
    return getattr(make(), name)  # type: ignore[no-any-return]


def assign(make: Callable[[], Any], name: str) -> Callable[..., Any]:
    return lambda value: setattr(make(), name, value)


def com() -> Any:
    return wbc.ComTask(ROBOT, HERE.com)


def kinematic(**given: Any) -> Any:
    return wbc.KinematicController(ROBOT, [com()], **{"contacts": HELD} | given)


def torque(**given: Any) -> Any:
    return wbc.TorqueController(ROBOT, [com()], **{"contacts": HELD} | given)


def ball() -> Obstacle:
    return Obstacle.sphere("ball", (3.0, 0.0, 0.0), 0.1)


QP_PARTS = {
    "P": EYE, "g": ZERO, "A": np.ones((1, 3)), "b": np.ones(1), "C": np.ones((1, 3)),
    "l": np.zeros(1), "u": np.ones(1), "lower": ZERO, "upper": np.ones(3),
}  # fmt: skip
FLAT = PlanarRmp(40.0)
FLAT_STATE = {"q": [0.0, 1.57, 0.9, 0.0, 0.2], "v": np.zeros(5)}
MOMENTS = np.array((3.0, 2.0, 1.5))
MOVING = {"rate": ZERO, "acceleration": ZERO}
# The call, and arguments that it takes: each is spoilt in turn.
CALLS: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "weight": (assign(com, "weight"), {"value": 1.0}),
    "target": (assign(com, "target"), {"value": ZERO}),
    "gain": (assign(com, "gain"), {"value": 0.5}),
    "com": (partial(wbc.ComTask, ROBOT), {"target": ZERO, "weight": 1.0, "kp": 1.0}),
    "com, set": (setter(com), {"target": ZERO, **MOVING}),
    "position": (partial(wbc.PositionTask, ROBOT, FOOT), {"target": ZERO}),
    "orientation": (partial(wbc.OrientationTask, ROBOT, FOOT), {"target": EYE}),
    "orientation, set": (
        setter(lambda: wbc.OrientationTask(ROBOT, FOOT, EYE)), {"target": EYE, **MOVING}),
    "pose": (partial(wbc.PoseTask, ROBOT, FOOT), {"position": ZERO, "rotation": EYE}),
    "pose, set": (
        setter(lambda: wbc.PoseTask(ROBOT, FOOT, ZERO, EYE)),
        {"position": ZERO, "rotation": EYE, "rate": np.zeros(6), "acceleration": np.zeros(6)}),
    "pose, target": (
        assign(lambda: wbc.PoseTask(ROBOT, FOOT, ZERO, EYE), "target"), {"value": np.eye(4)}),
    "relative pose": (
        partial(wbc.RelativePoseTask, ROBOT, FOOT, "right_sole"),
        {"position": ZERO, "rotation": EYE}),
    "axis": (partial(wbc.AxisTask, ROBOT, FOOT), {"target": EYE[2], "axis": EYE[2]}),
    "axis, set": (
        setter(lambda: wbc.AxisTask(ROBOT, FOOT, EYE[2])), {"target": EYE[2], **MOVING}),
    "inertia": (partial(wbc.InertiaTask, ROBOT), {"target": SHAPE}),
    "inertia, set": (
        setter(lambda: wbc.InertiaTask(ROBOT, SHAPE)),
        {"target": SHAPE, "rate": np.zeros(6), "acceleration": np.zeros((3, 3))}),
    "trace": (partial(wbc.InertiaTask, ROBOT, components=("trace",)), {"target": 1.0}),
    "principal inertia": (partial(wbc.PrincipalInertiaTask, ROBOT), {"target": MOMENTS}),
    "principal inertia, set": (
        setter(lambda: wbc.PrincipalInertiaTask(ROBOT, MOMENTS)), {"target": MOMENTS, **MOVING}),
    "momentum": (partial(wbc.MomentumTask, ROBOT), {"target": np.zeros(6)}),
    "momentum, set": (
        setter(lambda: wbc.MomentumTask(ROBOT)), {"target": np.zeros(6), "rate": np.zeros(6)}),
    "distance": (partial(wbc.DistanceTask, ROBOT, FOOT, "right_sole"), {"target": 0.1}),
    "distance, set": (
        setter(lambda: wbc.DistanceTask(ROBOT, FOOT, "right_sole", 0.1)),
        {"target": 0.1, "rate": 0.0, "acceleration": 0.0}),
    "posture": (partial(wbc.PostureTask, ROBOT), {"target": HERE.q}),
    "posture, set": (
        setter(lambda: wbc.PostureTask(ROBOT, HERE.q)),
        {"target": HERE.q, "rate": REST, "acceleration": REST}),
    "posture, weights": (
        lambda x: wbc.PostureTask(ROBOT, HERE.q, joints={"left_knee*": x}), {"x": 1.0}),
    "damping": (partial(wbc.DampingTask, ROBOT), {"weight": 1.0}),
    "contact force": (
        partial(wbc.ContactForceTask, ROBOT, FOOT), {"target": np.zeros(6), "weight": 1.0}),
    "cop": (partial(wbc.CopTask, ROBOT), {"target": np.zeros(3)}),
    "load share": (lambda x: wbc.LoadShareTask(ROBOT, {FOOT: x, "right_sole": 1.0}), {"x": 1.0}),
    "load share, set": (
        setter(lambda: wbc.LoadShareTask(ROBOT, {FOOT: 1.0, "right_sole": 1.0})),
        {"target": [1.0, 1.0]}),
    "torque": (partial(wbc.TorqueTask, ROBOT), {"target": np.zeros(ROBOT.nv - 6)}),
    "torque, set": (setter(lambda: wbc.TorqueTask(ROBOT)), {"target": 0.0}),
    "torque of a joint": (lambda x: wbc.TorqueTask(ROBOT, {"left_knee*": x}), {"x": 0.0}),
    "contact": (
        partial(wbc.Contact, ROBOT, FOOT),
        {"position": ZERO, "rotation": EYE, "corners": SQUARE}),
    "contact held": (partial(wbc.Contact.hold, HERE, FOOT), {"corners": SQUARE}),
    "friction": (wbc.FrictionCone, {"coefficient": 0.5, "facets": 4, "least": 0.0, "most": 9.0}),
    "limits": (
        partial(wbc.Limits, ROBOT),
        {"margin": 0.0, "velocity": 1.0, "acceleration": np.ones(ROBOT.nv - 6),
         "base_twist": np.ones(6), "recovery": 0.2}),
    "limits, one": (partial(wbc.Limits, ROBOT), {"acceleration": 1.0}),
    "torques of limits": (wbc.Limits(ROBOT).worst_margin, {"q": HERE.q}),
    "support": (partial(wbc.ComSupport, ROBOT), {"polygon": SQUARE, "margin": 0.01}),
    "support, set": (
        setter(lambda: wbc.ComSupport(ROBOT, SQUARE), "set_polygon"), {"polygon": SQUARE}),
    "box": (partial(wbc.PositionBox, ROBOT, "base"), {"lower": -np.ones(3), "upper": np.ones(3)}),
    "tilt": (partial(wbc.TiltLimit, ROBOT, "base"), {"angle": 0.3, "axis": EYE[2]}),
    "braking": (wbc.BrakingParameters, {"deceleration": 5.0, "gain": 0.5, "recovery": 0.2}),
    "sphere": (partial(Obstacle.sphere, "ball"), {"centre": ZERO, "radius": 0.1}),
    "capsule": (
        partial(Obstacle.capsule, "rod"), {"start": ZERO, "end": EYE[0], "radius": 0.1}),
    "cuboid": (partial(Obstacle.box, "box"), {"size": np.ones(3), "centre": ZERO}),
    "half space": (partial(Obstacle.half_space, "wall"), {"normal": EYE[0], "offset": -3.0}),
    "moved obstacle": (
        setter(ball, "move"),
        {"rotation": EYE, "origin": ZERO, "velocity": ZERO, "angular_velocity": ZERO}),
    "advanced obstacle": (setter(ball, "advance"), {"dt": 0.1}),
    "shapes": (Capsule.of, {"start": ZERO, "end": EYE[0], "radius": 0.1}),
    "hull": (Hull.box, {"size": np.ones(3), "centre": ZERO}),
    "plane": (HalfSpace.of, {"normal": EYE[0], "offset": 0.0}),
    "state": (ROBOT.snapshot, {"q": HERE.q, "v": REST}),
    "integrate": (ROBOT.integrate, {"q": HERE.q, "v": REST, "dt": 0.1}),
    "difference": (ROBOT.difference, {"q0": HERE.q, "q1": HERE.q}),
    "posture of joints": (lambda x: ROBOT.posture(joints={"left_knee*": x}), {"x": 0.0}),
    "locked": (lambda x: Robot.load("hoap2_like", locked={"left_knee_pitch": x}), {"x": 0.0}),
    "controller": (kinematic, {"dt": 0.005, "damping": 1e-6}),
    "joint weights": (lambda x: kinematic(joint_weights={"*": x}), {"x": 1.0}),
    "slack": (lambda x: kinematic(slack={FOOT: x}), {"x": 1.0}),
    "torque controller": (
        torque,
        {"dt": 0.005, "torque_limits": 1.0, "force_damping": 1e-6, "force_ramp": 0.1,
         "spring_time": 0.1, "friction_compensation": 1.0}),
    "ramp": (lambda x: torque().set_contacts(HELD, ramp=x), {"x": 0.1}),
    "reduction": (
        partial(wbc.reduce, HERE),
        {"acceleration": REST, "density": 1000.0, "ground_height": 0.0, "gap": 0.01}),
    "wrenches": (
        lambda place, wrench: wbc.reduce(HERE, wrenches=[(place, wrench)]),
        {"place": ZERO, "wrench": np.array((0, 0, 80.0, 0, 0, 0))}),
    "push": (
        partial(Push, "base"), {"force": EYE[0], "point": ZERO, "start": 0.0, "duration": 0.1}),
    "step": (Step, {"centre": ZERO, "size": np.ones(3), "yaw": 0.0, "friction": 1.0}),
    "mismatch": (ModelMismatch, {"mass": 0.1, "com": ZERO, "inertia": 0.1}),
    "motion": (
        partial(Motion, ROBOT),
        {"time": np.arange(9.0), "joints": np.zeros((9, ROBOT.nv - 6)),
         "base": np.ones((9, 7))}),
    "forces": (
        lambda time, wrench: MeasuredForces(time, {FOOT: wrench}),
        {"time": np.arange(9.0), "wrench": np.zeros((9, 6))}),
    "qp": (QP.build, QP_PARTS),
    "polygon": (polygon_margin, {"polygon": SQUARE, "points": np.zeros((4, 2))}),
    "inset": (inset, {"polygon": SQUARE, "margin": 0.01}),
    "axes": (track, {"inertias": np.array([SHAPE] * 3), "previous": EYE, "gap": 0.1}),
    "followed axes": (
        follow, {"axes": EYE, "second_moments": MOMENTS, "previous": EYE, "gap": 0.1}),
    "second moment": (second_moment, {"inertia": SHAPE}),
    "ellipsoid": (equimomental, {"inertia": SHAPE, "mass": 1.0}),
    "ellipsoid at density": (equimomental_at_density, {"inertia": SHAPE, "density": 1.0}),
    "radii": (reaction_mass_radii, {"inertia": SHAPE, "mass": 1.0}),
    "pendulum": (FLAT.momenta, FLAT_STATE),
    "pendulum, forces": (
        FLAT.forward_dynamics,
        {**FLAT_STATE, "f": np.zeros(len(FLAT.F)), "cop_acceleration": 0.0}),
    "bounds": (LawBounds, {"polygon": SQUARE, "cop_margin": 0.01}),
    "flat bounds": (LawBounds, {"polygon": (-0.1, 0.1)}),
    "wheel": (Wheel, {"inertia": [1.0, 1.0], "torque": 1.0, "angle": 1.0, "rate": 1.0}),
    "push limits": (
        partial(push_limits, wheel=Wheel(1.0, 1.0)),
        {"directions": [[1.0, 0.0]], "polygon": SQUARE, "mass": 1.0, "height": 1.0,
         "com": (0.0, 0.0)}),
    "feet": (lambda x: hull(SQUARE, x), {"x": SQUARE}),
    "plan's state": (at_rest, {"com": ZERO, "radii": np.ones(3)}),
    "plan's radii": (radii_for, {"mass": 9.0, "inertia": MOMENTS}),
    "plan's phase": (
        lambda duration, support: PlanPhase("p", duration, support),
        {"duration": 1.0, "support": SQUARE}),
    "capture": (partial(capture_impulse, HERE, ["left", "right"]), {"direction": EYE[0]}),
}  # fmt: skip
# What is meant in these places: torques by name, components left free, points in arrays.
MEANT = {
    ("torque", "target", "a dict"),
    ("torque, set", "target", "a dict"),
    ("plan's state", "com", "None in it"),
    ("plan's state", "radii", "None in it"),
    ("polygon", "points", "cubic"),
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.filterwarnings("error")
def test_what_is_no_array_of_numbers_is_a_typed_error(name: str) -> None:
    call, sound = CALLS[name]
    call(**sound)
    for argument in sound:
        for kind, bad in BAD.items():
            if (name, argument, kind) not in MEANT:
                with pytest.raises(WbcError):
                    call(**sound | {argument: bad})
                    pytest.fail(f"{argument}: {kind} was accepted")


def test_a_ragged_inertia_is_told_what_is_wanted() -> None:
    with pytest.raises(WbcError, match=r"target: expected numbers.*\[\[1.0\], \[2.0, 3.0\]\]"):
        wbc.InertiaTask(ROBOT, SHAPE).set_target([[1.0], [2.0, 3.0]])
