"""What is given to the public API is a typed error unless it is meant, never a crash of the core.

Every entry is called with one argument after the other spoilt, the others sound: where numbers are
wanted by what is none, elsewhere by what is no name that exists, no robot, no settings.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

import wbc
from wbc import Robot, WbcError, support
from wbc.errors import InvalidInputError
from wbc.estimation import (
    ContactFilter,
    EstimatorSettings,
    JointVelocityFilter,
    Measurement,
    MomentumObserver,
    StateEstimator,
)
from wbc.gait import Footstep, Walker
from wbc.hardware import Safety, SensorChecks, UdpBus
from wbc.human import human_motion, human_robot, read_markers
from wbc.motion.forces import MeasuredForces
from wbc.polygon import inset, polygon_margin
from wbc.qp import make_backend
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
from wbc.shaping import GlobalShaping
from wbc.simulation import (
    AppliedWrench,
    Devices,
    FallLimits,
    Imu,
    ModelMismatch,
    Plant,
    Push,
    SensedPlant,
    Sensors,
    Terrain,
    capture_impulse,
)
from wbc.simulation import simulate as simulated
from wbc.simulation.terrain import Step

Call = tuple[Callable[..., Any], dict[str, Any]]
ROBOT = Robot.load("hoap2_like")
HERE = ROBOT.snapshot(ROBOT.posture())
EYE, ZERO = np.eye(3), np.zeros(3)
SQUARE = [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]
SHAPE = HERE.inertia
REST = np.zeros(ROBOT.nv)
FOOT = "left_sole"
MOMENTS = np.array((3.0, 2.0, 1.5))

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
    "one NaN": math.nan,
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
# Of many kinds, none of which is a name that exists, a robot, a snapshot or settings of any kind.
WRONG = dict(enumerate((
    math.nan, -7, 10**400, 3.5, "no such thing", b"bytes", object(), [1, [2]], ["a", "b"], {"a": 1},
    {3}, 1j, np.full(3, np.nan), np.zeros(0), np.eye(2), np.array(["a"]), np.datetime64("now"),
)))  # fmt: skip
# Where any name, path or position means something until a robot or a disk is looked at.
LET = {("load", "package_dirs"), ("load", "name"), ("push", "body"), ("wrench", "frame"),
       ("fall", "trunk"), ("fall", "lifted"), ("axis", "name"), ("orientation", "name"),
       ("place", "name"), ("apart", "name")}  # fmt: skip
# What is meant in these places: torques by name, components left free, points in arrays, no joints.
MEANT = {
    ("torque task", "target", "a dict"),
    ("torque task, set", "target", "a dict"),
    ("plan's state", "com", "None in it"),
    ("plan's state", "radii", "None in it"),
    ("polygon", "points", "cubic"),
    ("measurement", "positions", "empty"),
}


def setter(make: Callable[[], Any], name: str = "set_target") -> Callable[..., Any]:
    return getattr(make(), name)  # type: ignore[no-any-return]


def assign(make: Callable[[], Any], name: str) -> Callable[..., Any]:
    return lambda value: setattr(make(), name, value)


def com() -> Any:
    return wbc.ComTask(ROBOT, HERE.com)


def ball() -> Obstacle:
    return Obstacle.sphere("ball", (3.0, 0.0, 0.0), 0.1)


@pytest.fixture(scope="module")
def calls() -> dict[str, Call]:
    """Return what users call, each with arguments that it takes."""
    robot, s, q = ROBOT, HERE, HERE.q
    held, limits, collision = support(s, "double"), wbc.Limits(robot), wbc.SelfCollision(robot)
    margin = {"braking": None, "limits": None}
    parts = {"robot": robot, "tasks": [com()], "contacts": held, "limits": None, "constraints": ()}
    kinematic = partial(wbc.KinematicController, robot, [com()], contacts=held)
    torque = wbc.TorqueController(robot, [com()], contacts=held, solver="active_set")
    plant, walker, pendulum = Plant(robot), Walker(robot), PlanarRmp(40.0)
    flat = {"q": [0.0, 1.57, 0.9, 0.0, 0.2], "v": np.zeros(5)}
    moving, twists = {"rate": ZERO, "acceleration": ZERO}, np.zeros(6)
    qp = {"P": EYE, "g": ZERO, "A": np.ones((1, 3)), "b": np.ones(1), "C": np.ones((1, 3)),
          "l": np.zeros(1), "u": np.ones(1), "lower": ZERO, "upper": np.ones(3)}  # fmt: skip
    place, rates = np.concatenate((ZERO, EYE.ravel())), JointVelocityFilter(4)
    feet, felt = ContactFilter(2), MomentumObserver(robot)
    for k in range(2):
        feet.hold(k, place, np.eye(6))

    def bus(**given: Any) -> None:
        UdpBus(**given).close()

    def run(**given: Any) -> list[Any]:
        return list(simulated(**given))

    return {
        "load": (Robot.load, {"source": "hoap2_like", "locked": None, "base": None, "srdf": None,
                              "package_dirs": (), "name": None, "loops": None, "unactuated": None}),
        "locked": (lambda x: Robot.load("hoap2_like", locked={"left_knee_pitch": x}), {"x": 0.0}),
        "snapshot": (robot.snapshot, {"q": q, "v": REST}),
        "integrate": (robot.integrate, {"q": q, "v": REST, "dt": 0.1}),
        "difference": (robot.difference, {"q0": q, "q1": q}),
        "posture": (robot.posture, {"reference": "standing", "joints": None, "on_ground": False}),
        "posture of joints": (lambda x: robot.posture(joints={"left_knee*": x}), {"x": 0.0}),
        "foot": (robot.foot, {"name": "left"}),
        "payload": (robot.with_payload, {"frame": FOOT, "mass": 1.0, "inertia": (0.0, 0.0, 0.0)}),
        "passive": (robot.passive_forces_at, {"snapshot": s}),
        "position": (s.position, {"frame": FOOT}),
        "jacobian": (s.jacobian, {"frame": FOOT}),
        "inertia in": (s.inertia_in, {"frame": FOOT, "about": "com"}),
        "hessian": (s.inertia_hessian, {"weights": EYE}),
        # tasks
        "weight": (assign(com, "weight"), {"value": 1.0}),
        "target": (assign(com, "target"), {"value": ZERO}),
        "gain": (assign(com, "gain"), {"value": 0.5}),
        "com": (partial(wbc.ComTask, robot), {"target": ZERO, "weight": 1.0, "kp": 1.0}),
        "com, set": (setter(com), {"target": ZERO, **moving}),
        "residual": (com().residual, {"snapshot": s}),
        "place": (wbc.PositionTask, {"robot": robot, "frame": FOOT, "target": ZERO, "name": None}),
        "orientation": (
            wbc.OrientationTask, {"robot": robot, "frame": FOOT, "target": EYE, "name": None}),
        "orientation, set": (
            setter(lambda: wbc.OrientationTask(robot, FOOT, EYE)), {"target": EYE, **moving}),
        "pose": (partial(wbc.PoseTask, robot, FOOT), {"position": ZERO, "rotation": EYE}),
        "pose, set": (
            setter(lambda: wbc.PoseTask(robot, FOOT, ZERO, EYE)),
            {"position": ZERO, "rotation": EYE, "rate": twists, "acceleration": twists}),
        "pose, target": (
            assign(lambda: wbc.PoseTask(robot, FOOT, ZERO, EYE), "target"), {"value": np.eye(4)}),
        "relative": (wbc.RelativePoseTask, {"robot": robot, "frame": "base", "relative_to": FOOT,
                                            "position": ZERO, "rotation": EYE}),
        "axis": (wbc.AxisTask, {"robot": robot, "frame": "base", "target": EYE[2],
                                "axis": EYE[2], "name": None}),
        "axis, set": (
            setter(lambda: wbc.AxisTask(robot, FOOT, EYE[2])), {"target": EYE[2], **moving}),
        "apart": (wbc.DistanceTask, {"robot": robot, "frame": FOOT, "other": "base", "target": 0.3,
                                     "name": None}),
        "apart, set": (
            setter(lambda: wbc.DistanceTask(robot, FOOT, "right_sole", 0.1)),
            {"target": 0.1, "rate": 0.0, "acceleration": 0.0}),
        "inertia": (wbc.InertiaTask, {"robot": robot, "target": SHAPE, "frame": "base",
                                      "per_mass": True, "second_order": False}),
        "inertia, set": (
            setter(lambda: wbc.InertiaTask(robot, SHAPE)),
            {"target": SHAPE, "rate": twists, "acceleration": np.zeros((3, 3))}),
        "trace": (partial(wbc.InertiaTask, robot, components=("trace",)), {"target": 1.0}),
        "principal": (
            wbc.PrincipalInertiaTask, {"robot": robot, "target": MOMENTS, "per_mass": True}),
        "principal, set": (
            setter(lambda: wbc.PrincipalInertiaTask(robot, MOMENTS)),
            {"target": MOMENTS, **moving}),
        "momentum": (partial(wbc.MomentumTask, robot), {"target": twists}),
        "momentum, set": (
            setter(lambda: wbc.MomentumTask(robot)), {"target": twists, "rate": twists}),
        "joints": (wbc.PostureTask, {"robot": robot, "target": q, "joints": None, "weight": 1.0}),
        "joints, set": (
            setter(lambda: wbc.PostureTask(robot, q)),
            {"target": q, "rate": REST, "acceleration": REST}),
        "joints, weights": (
            lambda x: wbc.PostureTask(robot, q, joints={"left_knee*": x}), {"x": 1.0}),
        "damping": (
            wbc.DampingTask, {"robot": robot, "joints": None, "base": True, "weight": 1.0}),
        "contact force": (
            partial(wbc.ContactForceTask, robot, FOOT), {"target": twists, "weight": 1.0}),
        "cop": (partial(wbc.CopTask, robot), {"target": ZERO}),
        "load share": (
            lambda x: wbc.LoadShareTask(robot, {FOOT: x, "right_sole": 1.0}), {"x": 1.0}),
        "load share, set": (
            setter(lambda: wbc.LoadShareTask(robot, {FOOT: 1.0, "right_sole": 1.0})),
            {"target": [1.0, 1.0]}),
        "torque task": (partial(wbc.TorqueTask, robot), {"target": np.zeros(robot.nv - 6)}),
        "torque task, set": (setter(lambda: wbc.TorqueTask(robot)), {"target": 0.0}),
        "torque of a joint": (lambda x: wbc.TorqueTask(robot, {"left_knee*": x}), {"x": 0.0}),
        # contacts and constraints
        "contact": (
            partial(wbc.Contact, robot, FOOT),
            {"position": ZERO, "rotation": EYE, "corners": SQUARE}),
        "contact held": (partial(wbc.Contact.hold, s, FOOT), {"corners": SQUARE}),
        "slip": (held[0].slip, {"snapshot": s}),
        "support": (support, {"snapshot": s, "mode": "double"}),
        "friction": (wbc.FrictionCone, {"coefficient": 0.6, "facets": 4, "inner": True,
                                        "least": 0.0, "most": 9.0}),
        "limits": (wbc.Limits, {"robot": robot, "position": True, "braking": "free",
                                "margin": 0.0, "velocity": 1.0, "base_twist": np.ones(6),
                                "acceleration": np.ones(robot.nv - 6), "recovery": 0.2}),
        "limits, one": (partial(wbc.Limits, robot), {"acceleration": 1.0}),
        "worst margin": (limits.worst_margin, {"q": q}),
        "limits' box": (limits.box, {"snapshot": s, "dt": 0.01}),
        "com support": (
            wbc.ComSupport, {"robot": robot, "polygon": SQUARE, "margin": 0.01, **margin}),
        "com support, set": (
            setter(lambda: wbc.ComSupport(robot, SQUARE), "set_polygon"), {"polygon": SQUARE}),
        "box": (
            partial(wbc.PositionBox, robot, "base"), {"lower": -np.ones(3), "upper": np.ones(3)}),
        "tilt": (wbc.TiltLimit, {"robot": robot, "frame": "base", "angle": 0.4, "axis": EYE[2],
                                 **margin}),
        "braking": (wbc.BrakingParameters, {"deceleration": 5.0, "gain": 0.5, "recovery": 0.2}),
        "collision": (
            wbc.SelfCollision, {"robot": robot, "fit": "capsule", "model": None, **margin}),
        "distances": (collision.distances, {"snapshot": s, "keys": np.arange(2)}),
        "obstacles": (wbc.Obstacles, {"robot": robot, "obstacles": [ball()], **margin}),
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
        # controllers
        "solver": (make_backend, {"name": "active_set"}),
        "qp": (QP.build, qp),
        "velocity": (
            wbc.KinematicController,
            {**parts, "dt": 0.005, "damping": 1e-6}),
        "joint weights": (lambda x: kinematic(joint_weights={"*": x}), {"x": 1.0}),
        "slack": (lambda x: kinematic(slack={FOOT: x}), {"x": 1.0}),
        "torque": (
            wbc.TorqueController,
            {**parts, "on_failure": "damp", "delay": 0.0, "dt": 0.005, "torque_limits": 1.0,
             "force_damping": 1e-6, "force_ramp": 0.1, "spring_time": 0.1,
             "friction_compensation": 1.0}),
        "ramp": (lambda x: torque.set_contacts(held, ramp=x), {"x": 0.1}),
        "tick": (torque.step, {"snapshot": s, "wrenches": None}),
        "shaping": (GlobalShaping, {**parts, "limits": limits}),
        # walking, estimation, hardware, humans
        "walker": (Walker, {"robot": robot, "weights": None, "limits": None, "tasks": ()}),
        "gait": (Walker, {"robot": robot, "gait": {"height": None}}),
        "height": (lambda height: Walker(robot, {"height": height}), {"height": 0.25}),
        "walk": (walker.step, {"snapshot": s, "forces": None}),
        "footstep": (Footstep, {"foot": "left", "x": 0.1, "y": 0.1}),
        "estimator": (StateEstimator, {"robot": robot, "imus": (), "settings": None}),
        "rates": (JointVelocityFilter, {"joints": 5, "window": 5}),
        "rate": (rates.update, {"time": 0.0, "positions": np.zeros(4)}),
        "filter": (ContactFilter, {"feet": 2, "noise": None}),
        "predict": (feet.predict, {"rate": ZERO, "force": np.ones(3), "dt": 0.01}),
        "hold": (feet.hold, {"k": 1, "place": place, "noise": np.eye(6)}),
        "correct": (feet.correct, {"k": 1, "place": place, "noise": np.eye(6)}),
        "release": (feet.release, {"k": 1}),
        "felt": (felt.update, {"q": q, "v": s.v, "torque": np.zeros(robot.nv - 6), "dt": 0.01}),
        "measurement": (Measurement, {"time": 0.0, "positions": ZERO, "imus": ()}),
        "sensor checks": (SensorChecks, {"robot": robot}),
        "safety": (Safety, {"limits": None, "damping": np.ones(3), "dt": 0.002}),
        "udp": (bus, {"joints": 3, "robot": "127.0.0.1", "port": 0}),
        "human": (human_motion, {"recording": None, "static": None, "sex": "male"}),
        "body": (human_robot, {"body": None}),
        "markers": (read_markers, {"path": "none.c3d"}),
        # simulation
        "plant": (Plant, {"robot": robot, "terrain": None, "shapes": True, "saturate": True}),
        "sensed": (SensedPlant, {"robot": robot, "devices": None, "settings": None}),
        "devices": (Devices, {"imus": Imu(), "feet": None}),
        "imu": (Imu, {"most_rate": 30.0, "rotation": EYE}),
        "run": (run, {"controller": torque, "plant": plant, "duration": 0.002, "update": None,
                      "falls": None}),
        "impulse": (capture_impulse, {"snapshot": s, "feet": ("left",), "direction": (1, 0)}),
        "push": (Push, {"body": "base", "force": EYE[0], "point": ZERO, "start": 0.0,
                        "duration": 1.0, "profile": "half_sine"}),
        "wrench": (AppliedWrench, {"frame": "base", "wrench": np.ones(6), "told": True}),
        "fall": (FallLimits, {"trunk": "base", "lifted": "", "touch": True}),
        "terrain": (Terrain, {"friction": 0.8, "drift": False, "walls": ()}),
        "step": (Step, {"centre": ZERO, "size": np.ones(3), "yaw": 0.0, "friction": 1.0}),
        "mismatch": (ModelMismatch, {"mass": 0.1, "com": ZERO, "inertia": 0.1}),
        # motions and pendulums
        "motion": (wbc.Motion, {"robot": robot, "time": np.arange(9.0),
                                "joints": np.zeros((9, robot.nv - 6)), "base": np.ones((9, 7))}),
        "read": (wbc.read_motion, {"path": "none.csv", "robot": robot}),
        "forces": (
            lambda time, wrench: MeasuredForces(time, {FOOT: wrench}),
            {"time": np.arange(9.0), "wrench": np.zeros((9, 6))}),
        "reduce": (
            wbc.reduce, {"snapshot": s, "feet": None, "wrenches": None, "previous": None}),
        "reduce, numbers": (
            partial(wbc.reduce, s),
            {"acceleration": REST, "density": 1000.0, "ground_height": 0.0, "gap": 0.01}),
        "wrenches": (
            lambda place, wrench: wbc.reduce(s, wrenches=[(place, wrench)]),
            {"place": ZERO, "wrench": np.array((0, 0, 80.0, 0, 0, 0))}),
        "pendulum of": (wbc.pendulum_of, {"start": s}),
        "plan": (wbc.PlanReference, {"plan": None, "start": s}),
        "polygon": (polygon_margin, {"polygon": SQUARE, "points": np.zeros((4, 2))}),
        "inset": (inset, {"polygon": SQUARE, "margin": 0.01}),
        "axes": (track, {"inertias": np.array([SHAPE] * 3), "previous": EYE, "gap": 0.1}),
        "followed axes": (
            follow, {"axes": EYE, "second_moments": MOMENTS, "previous": EYE, "gap": 0.1}),
        "second moment": (second_moment, {"inertia": SHAPE}),
        "ellipsoid": (equimomental, {"inertia": SHAPE, "mass": 1.0}),
        "ellipsoid at density": (equimomental_at_density, {"inertia": SHAPE, "density": 1.0}),
        "radii": (reaction_mass_radii, {"inertia": SHAPE, "mass": 1.0}),
        "pendulum": (pendulum.momenta, flat),
        "pendulum, forces": (
            pendulum.forward_dynamics,
            {**flat, "f": np.zeros(len(pendulum.F)), "cop_acceleration": 0.0}),
        "bounds": (LawBounds, {"polygon": SQUARE, "cop_margin": 0.01}),
        "flat bounds": (LawBounds, {"polygon": (-0.1, 0.1)}),
        "wheel": (Wheel, {"inertia": [1.0, 1.0], "torque": 1.0, "angle": 1.0, "rate": 1.0}),
        "push limits": (
            partial(push_limits, wheel=Wheel(1.0, 1.0)),
            {"directions": [[1.0, 0.0]], "polygon": SQUARE, "mass": 1.0, "height": 1.0,
             "com": (0.0, 0.0)}),
        "hull of feet": (lambda x: hull(SQUARE, x), {"x": SQUARE}),
        "plan's state": (at_rest, {"com": ZERO, "radii": np.ones(3)}),
        "plan's radii": (radii_for, {"mass": 9.0, "inertia": MOMENTS}),
        "plan's phase": (
            lambda duration, support: PlanPhase("p", duration, support),
            {"duration": 1.0, "support": SQUARE}),
    }  # fmt: skip


def are_numbers(value: Any) -> bool:
    return value is not None and np.asarray(value).dtype.kind in "iuf" and np.size(value) > 0


@pytest.mark.filterwarnings("error")
def test_whatever_is_no_such_thing_is_a_typed_error(calls: dict[str, Call]) -> None:
    raw, taken = list[object](), list[object]()
    for name, (call, sound) in calls.items():
        if all(map(are_numbers, sound.values())):
            call(**sound)
        for key, value in sound.items():
            for kind, wrong in (BAD if are_numbers(value) else WRONG).items():
                try:
                    call(**sound | {key: wrong})
                except WbcError:
                    continue
                except Exception as error:
                    raw.append((name, key, kind, error))
                # A number may be one that is meant, and nothing at all a list of none.
                some = not isinstance(wrong, int | float) and getattr(wrong, "size", 1) > 0
                if (are_numbers(value) or some) and (name, key) not in LET:
                    taken.append((name, key, kind))
    assert not raw
    assert set(taken) <= MEANT


def test_a_count_is_kept_as_a_whole_number() -> None:
    robot, bus = Robot.load("hoap2_like"), UdpBus(3.0, port=0.0)  # type: ignore[arg-type]
    bus.close()
    seed: Any = 3.0
    Plant(robot, sensors=Sensors(position_noise=1e-3, seed=seed))
    Plant(robot, mismatch=ModelMismatch(mass_spread=0.1, seed=seed))
    SensedPlant(robot, devices=Devices(seed=seed))
    StateEstimator(robot, settings=EstimatorSettings(history=seed, velocity_window=seed))
    for wrong in (2.5, -1, True, "3"):
        for kind in (Sensors, ModelMismatch, Devices):
            with pytest.raises(wbc.WbcError, match="seed"):
                kind(seed=wrong)


def test_numbers_of_pairs_are_read_whatever_their_width(hoap2: Robot) -> None:
    snapshot, collision = hoap2.snapshot(hoap2.posture("standing")), wbc.SelfCollision(hoap2)
    keys = np.arange(0, 9, 2)
    wanted = collision.distances(snapshot, keys)
    for width in (np.int8, np.uint16, np.int32, np.uint64):
        found = collision.distances(snapshot, keys.astype(width))  # type: ignore[arg-type]
        np.testing.assert_array_equal(found.clearance, wanted.clearance)
        np.testing.assert_array_equal(found.jacobian, wanted.jacobian)


@pytest.mark.parametrize("part", ["tasks", "contacts", "constraints"])
def test_parts_that_can_be_looked_at_once_only_are_refused(hoap2: Robot, part: str) -> None:
    """Checked, a generator is empty: the robot would have stood on nothing."""
    s = hoap2.snapshot(hoap2.posture("standing"))
    parts: dict[str, Any] = {"tasks": [wbc.ComTask(hoap2, s.com)]}
    parts |= {"contacts": wbc.support(s, "double"), "constraints": [wbc.ComSupport.over(s)]}
    for controller in (wbc.KinematicController, wbc.TorqueController):
        with pytest.raises(InvalidInputError, match=f"controller, {part}: expected a list"):
            controller(hoap2, **{**parts, part: (one for one in parts[part])})


def test_obstacles_are_kept_however_they_are_listed(hoap2: Robot) -> None:
    balls = [wbc.Obstacle.sphere(f"ball {k}", (1.0, 0.0, k), 0.1) for k in range(2)]
    assert wbc.Obstacles(hoap2, (one for one in balls)).obstacles == tuple(balls)  # type: ignore[arg-type]


def test_text_in_place_of_its_file_is_told_in_short(hoap2: Robot) -> None:
    text = "robot: g1\n" * 1000
    for read in (wbc.load_problem, lambda text: wbc.read_motion(text, hoap2), read_markers):
        with pytest.raises(InvalidInputError, match="got text of several lines") as error:
            read(text)
        assert len(str(error.value)) < 200


def test_a_ragged_inertia_is_told_what_is_wanted() -> None:
    with pytest.raises(WbcError, match=r"target: expected numbers.*\[\[1.0\], \[2.0, 3.0\]\]"):
        wbc.InertiaTask(ROBOT, SHAPE).set_target([[1.0], [2.0, 3.0]])
