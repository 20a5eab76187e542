"""What is left out has these values: users' results rest on them, and changing one is a change.

Who changes a default here on purpose says so in the changelog.
"""

import inspect
import math
from typing import Any

import pytest

import wbc
from wbc import qp, shaping

INF = math.inf
# Of every task that hands keywords on to its laws, unless it says otherwise.
LAWS: dict[str, Any] = {
    "weight": 1.0,
    "priority": 0,
    "gain": 0.5,
    "lm_damping": 0.0,
    "singular_threshold": 0.0,
    "curvature_damping": True,
    "weighs_error": False,
    "kp": 100.0,
}
DEFAULTS: dict[str, dict[str, Any]] = {
    "AxisTask": {"axis": (0, 0, 1)},
    "BrakingParameters": {"deceleration": 5.0, "gain": 0.5, "recovery": 0.2, "recovery_speed": 0.1},
    "ComSupport": {"margin": 0.01},
    "ComSupport.over": {"feet": None, "margin": 0.01},
    "ComTask": {"axes": ("x", "y", "z")},
    "ContactForceTask": {
        "target": (0, 0, 0, 0, 0, 0),
        "components": ("fx", "fy", "fz", "mx", "my", "mz"),
        "weight": 1.0,
        "priority": 0,
    },
    "CopTask": {"weight": 1.0, "priority": 0},
    "DampingTask": {"base": True, "weight": 1.0, "priority": 0},
    "ForceRateTask": {"weight": 0.1, "priority": 0},
    "ForceTask": {"weight": 1.0, "priority": 0},
    "FrictionCone": {"coefficient": 0.6, "facets": 4, "inner": True, "least": 0.0, "most": INF},
    "InertiaTask": {
        "components": ("xx", "xy", "xz", "yy", "yz", "zz"),
        "frame": "world",
        "per_mass": False,
        "second_order": False,
    },
    "KinematicController": {
        "constraints": (),
        "dt": 0.005,
        "solver": "proxqp",
        "damping": 1e-06,
        "on_failure": "hold",
    },
    "Limits": {
        "position": True,
        "margin": 0.0,
        "velocity": 1.0,
        "braking": "free",
        "recovery": 0.2,
    },
    "LoadShareTask": {"weight": 1.0, "priority": 0},
    "MomentumTask": {
        "target": (0, 0, 0, 0, 0, 0),
        "components": ("lx", "ly", "lz", "kx", "ky", "kz"),
    },
    "Obstacles": {"margin": 0.02, "pairs": 25, "links": ("*",), "fit": "capsule"},
    "PositionBox.height": {"upper": INF, "frame": "base"},
    "PositionTask": {"axes": ("x", "y", "z")},
    "PostureTask": {"weight": 1.0, "priority": 0},
    "PrincipalInertiaTask": {"per_mass": False},
    "RelativePoseTask": {"components": ("x", "y", "z", "rx", "ry", "rz")},
    "SelfCollision": {"margin": 0.01, "pairs": 25, "fit": "capsule", "include": (), "exclude": ()},
    "Tick": {"step_scale": 1.0},
    "TiltLimit": {"axis": (0.0, 0.0, 1.0)},
    "TorqueController": {
        "constraints": (),
        "dt": 0.002,
        "solver": "proxqp",
        "torque_limits": 1.0,
        "damping": 0.001,
        "force_damping": 0.01,
        "force_ramp": 0.05,
        "on_failure": "damp",
        "delay": 0.0,
        "spring_time": 0.015,
        "friction_compensation": 0.0,
    },
    "TorqueTask": {"target": 0.0, "joints": ("*",), "weight": 0.03, "priority": 0},
    "TorqueTick": {"step_scale": 1.0},
    "stance_torques": {"torque_limits": 1.0},
    "ProxQP": {"eps": 1e-08, "max_iterations": 20, "warm": True, "always": False},
    "ProxQP.solve": {"workspace": "default", "quick": False},
    "find_conflict": {"tolerance": 1e-07},
    "GlobalShaping": {"contacts": (), "constraints": (), "dt": 0.005},
    "GlobalShaping.solve": {"starts": 64, "workers": 2, "seed": 0},
    "GlobalShaping.reach": {"tolerance": 0.01, "attempts": 5, "dt": None, "rest_speed": 1e-05},
}


@pytest.mark.parametrize("name", DEFAULTS)
def test_what_is_left_out(name: str) -> None:
    owner, _, method = name.partition(".")
    found = next(getattr(room, owner) for room in (wbc, qp, shaping) if hasattr(room, owner))
    parameters = inspect.signature(getattr(found, method) if method else found).parameters
    laws = LAWS.keys() & parameters.keys() if "kd" in parameters else ()
    told = {key: LAWS[key] for key in laws} | DEFAULTS[name]
    for key, value in told.items():
        default = parameters[key].default
        assert default == value and type(default) is type(value), key
    numbers = {
        key
        for key, one in parameters.items()
        if isinstance(one.default, bool | int | float) and key != "copy"
    }
    assert numbers <= told.keys(), "a number that is not said here"
