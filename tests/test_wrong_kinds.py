"""What is no such thing is a typed error wherever it is given, and never a crash of the core."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import wbc
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
from wbc.qp import make_backend
from wbc.robot import Robot
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

Call = tuple[str, Callable[..., Any], dict[str, Any]]
# Of many kinds, none of which is a name that exists, a robot, a snapshot or settings of any kind.
WRONG = (
    math.nan, -7, 10**400, 3.5, "no such thing", b"bytes", object(), [1, [2]], ["a", "b"], {"a": 1},
    {3}, 1j, np.full(3, np.nan), np.zeros(0), np.eye(2), np.array(["a"]), np.datetime64("now"),
)  # fmt: skip
# Where any name, path or position means something until a robot or a disk is looked at.
LET = {("load", "package_dirs"), ("load", "name"), ("push", "body"), ("wrench", "frame"),
       ("fall", "trunk"), ("fall", "lifted"), ("axis", "name"), ("orientation", "name"),
       ("place", "name"), ("apart", "name")}  # fmt: skip


@pytest.fixture(scope="module")
def calls(hoap2: Robot) -> list[Call]:
    """Return what users call, each with arguments that it takes."""
    q = hoap2.posture("standing")
    s = hoap2.snapshot(q)
    sole = hoap2.feet["left"].frame
    com, held = wbc.ComTask(hoap2, s.com), wbc.support(s, "double")
    margin = {"braking": None, "limits": None}
    contacts = {"robot": hoap2, "tasks": [com], "contacts": held, "limits": None, "constraints": ()}
    torque = wbc.TorqueController(hoap2, [com], contacts=held, solver="active_set")
    plant, walker = Plant(hoap2), Walker(hoap2)
    collision, limits = wbc.SelfCollision(hoap2), wbc.Limits(hoap2)

    ball = [wbc.Obstacle.sphere("ball", (1.0, 0.0, 1.0), 0.1)]
    place, rates = np.concatenate((np.zeros(3), np.eye(3).ravel())), JointVelocityFilter(4)
    feet, felt = ContactFilter(2), MomentumObserver(hoap2)
    for k in range(2):
        feet.hold(k, place, np.eye(6))

    def bus(**given: Any) -> None:
        UdpBus(**given).close()

    def run(**given: Any) -> list[Any]:
        return list(simulated(**given))

    return [
        ("load", Robot.load, {"source": "hoap2_like", "locked": None, "base": None, "srdf": None,
                              "package_dirs": (), "name": None, "loops": None, "unactuated": None}),
        ("snapshot", hoap2.snapshot, {"q": q, "v": None}),
        ("posture", hoap2.posture, {"reference": "standing", "joints": None, "on_ground": False}),
        ("foot", hoap2.foot, {"name": "left"}),
        ("payload", hoap2.with_payload, {"frame": sole, "mass": 1.0, "inertia": (0.0, 0.0, 0.0)}),
        ("passive", hoap2.passive_forces_at, {"snapshot": s}),
        ("position", s.position, {"frame": sole}),
        ("jacobian", s.jacobian, {"frame": sole}),
        ("inertia in", s.inertia_in, {"frame": sole, "about": "com"}),
        ("hessian", s.inertia_hessian, {"weights": np.eye(3)}),
        ("inertia", wbc.InertiaTask, {"robot": hoap2, "target": s.inertia, "frame": "base",
                                      "per_mass": True, "second_order": False}),
        ("relative", wbc.RelativePoseTask, {"robot": hoap2, "frame": "base", "relative_to": sole,
                                            "position": np.ones(3), "rotation": np.eye(3)}),
        ("axis", wbc.AxisTask, {"robot": hoap2, "frame": "base", "target": (0, 0, 1),
                                "name": None}),
        ("orientation", wbc.OrientationTask, {"robot": hoap2, "frame": "base", "target": np.eye(3),
                                              "name": None}),
        ("place", wbc.PositionTask, {"robot": hoap2, "frame": sole, "target": (0, 0, 1),
                                     "name": None}),
        ("apart", wbc.DistanceTask, {"robot": hoap2, "frame": sole, "other": "base", "target": 0.3,
                                     "name": None}),
        ("damping", wbc.DampingTask, {"robot": hoap2, "joints": None, "base": True}),
        ("joints", wbc.PostureTask, {"robot": hoap2, "target": q, "joints": None, "weight": 1.0}),
        ("principal", wbc.PrincipalInertiaTask, {"robot": hoap2, "target": (1, 2, 3),
                                                 "per_mass": True}),
        ("com support", wbc.ComSupport, {"robot": hoap2, "polygon": np.eye(3)[:, :2], **margin}),
        ("obstacles", wbc.Obstacles, {"robot": hoap2, "obstacles": ball, **margin}),
        ("solver", make_backend, {"name": "active_set"}),
        ("sensor checks", SensorChecks, {"robot": hoap2}),
        ("residual", com.residual, {"snapshot": s}),
        ("slip", held[0].slip, {"snapshot": s}),
        ("support", wbc.support, {"snapshot": s, "mode": "double"}),
        ("friction", wbc.FrictionCone, {"coefficient": 0.6, "facets": 4, "inner": True}),
        ("limits", wbc.Limits, {"robot": hoap2, "position": True, "braking": "free"}),
        ("box", limits.box, {"snapshot": s, "dt": 0.01}),
        ("collision", wbc.SelfCollision, {"robot": hoap2, "fit": "capsule",
                                           "model": None, **margin}),
        ("distances", collision.distances, {"snapshot": s, "keys": np.arange(2)}),
        ("tilt", wbc.TiltLimit, {"robot": hoap2, "frame": "base", "angle": 0.4, **margin}),
        ("velocity", wbc.KinematicController, contacts | {"on_failure": "hold"}),
        ("torque", wbc.TorqueController, contacts | {"on_failure": "damp", "delay": 0.0}),
        ("tick", torque.step, {"snapshot": s, "wrenches": None}),
        ("walker", Walker, {"robot": hoap2, "weights": None, "limits": None, "tasks": ()}),
        ("gait", Walker, {"robot": hoap2, "gait": {"height": None}}),
        ("height", lambda height: Walker(hoap2, {"height": height}), {"height": 0.25}),
        ("plan", wbc.PlanReference, {"plan": None, "start": s}),
        ("sensed", SensedPlant, {"robot": hoap2, "devices": None, "settings": None}),
        ("devices", Devices, {"imus": Imu(), "feet": None}),
        ("human", human_motion, {"recording": None, "static": None, "sex": "male"}),
        ("body", human_robot, {"body": None}),
        ("walk", walker.step, {"snapshot": s, "forces": None}),
        ("footstep", Footstep, {"foot": "left", "x": 0.1, "y": 0.1}),
        ("plant", Plant, {"robot": hoap2, "terrain": None, "shapes": True, "saturate": True}),
        ("run", run, {"controller": torque, "plant": plant, "duration": 0.002, "update": None,
                      "falls": None}),
        ("impulse", capture_impulse, {"snapshot": s, "feet": ("left",), "direction": (1, 0)}),
        ("push", Push, {"body": "base", "force": np.ones(3), "point": np.zeros(3), "start": 0.0,
                        "duration": 1.0, "profile": "half_sine"}),
        ("wrench", AppliedWrench, {"frame": "base", "wrench": np.ones(6), "told": True}),
        ("fall", FallLimits, {"trunk": "base", "lifted": "", "touch": True}),
        ("terrain", Terrain, {"friction": 0.8, "drift": False, "walls": ()}),
        ("imu", Imu, {"most_rate": 30.0, "rotation": np.eye(3)}),
        ("estimator", StateEstimator, {"robot": hoap2, "imus": (), "settings": None}),
        ("rates", JointVelocityFilter, {"joints": 5, "window": 5}),
        ("filter", ContactFilter, {"feet": 2, "noise": None}),
        ("rate", rates.update, {"time": 0.0, "positions": np.zeros(4)}),
        ("predict", feet.predict, {"rate": np.zeros(3), "force": np.ones(3), "dt": 0.01}),
        ("hold", feet.hold, {"k": 1, "place": place, "noise": np.eye(6)}),
        ("correct", feet.correct, {"k": 1, "place": place, "noise": np.eye(6)}),
        ("release", feet.release, {"k": 1}),
        ("felt", felt.update, {"q": q, "v": s.v, "torque": np.zeros(hoap2.nv - 6), "dt": 0.01}),
        ("measurement", Measurement, {"time": 0.0, "positions": np.zeros(3), "imus": ()}),
        ("safety", Safety, {"limits": None, "damping": np.ones(3), "dt": 0.002}),
        ("udp", bus, {"joints": 3, "robot": "127.0.0.1", "port": 0}),
        ("reduce", wbc.reduce, {"snapshot": s, "feet": None, "wrenches": None,
                                "previous": None}),
        ("pendulum", wbc.pendulum_of, {"start": s}),
        ("motion", wbc.Motion, {"robot": hoap2, "time": np.arange(9.0),
                                "joints": np.zeros((9, hoap2.nv - 6))}),
        ("read", wbc.read_motion, {"path": "none.csv", "robot": hoap2}),
        ("markers", read_markers, {"path": "none.c3d"}),
        ("shaping", GlobalShaping, contacts | {"limits": limits}),
    ]  # fmt: skip


def wrongly(calls: list[Call]) -> Iterator[tuple[str, str, object, Exception | None]]:
    for name, call, arguments in calls:
        for key in arguments:
            for wrong in WRONG:
                try:
                    call(**{**arguments, key: wrong})
                except Exception as error:  # judged by the test
                    yield name, key, wrong, error
                else:
                    yield name, key, wrong, None


def test_whatever_is_no_such_thing_is_a_typed_error(calls: list[Call]) -> None:
    raw, taken = list[object](), list[object]()
    for name, key, wrong, error in wrongly(calls):
        if error is not None and not isinstance(error, wbc.WbcError):
            raw.append((name, key, wrong, error))
        # A number may be one that is meant, and nothing at all a list of none.
        some = not isinstance(wrong, int | float) and getattr(wrong, "size", 1) > 0
        if error is None and some and (name, key) not in LET:
            taken.append((name, key, wrong))
    assert not raw
    assert not taken


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
