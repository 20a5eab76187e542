"""What a ramp of a file hands on: every kind of task gets the rate and acceleration of its target.

The oracle is the task's error at a robot that stands still, as its target moves: its derivatives by
differences in time share nothing with what the ramp says. h = 1e-4 with rounding of 1e-16 / h^2.
"""

import numpy as np
import pytest

from wbc.errors import UnknownNameError
from wbc.problem.kinds.com import ComSpec
from wbc.problem.kinds.frame import (
    AxisSpec,
    DistanceSpec,
    OrientationSpec,
    PoseSpec,
    PositionSpec,
    RelativePoseSpec,
)
from wbc.problem.kinds.inertia import InertiaSpec
from wbc.problem.kinds.posture import PostureSpec
from wbc.problem.kinds.rates import MomentumSpec
from wbc.problem.mistakes import Misplaced
from wbc.problem.task_spec import TaskSpec
from wbc.run.ramps import MinimumJerk, MovingTarget

H = 1e-4
LOOP = {"loop": {"left_elbow_pitch": [-0.1, 0.0]}, "period": 1.0}
RPY = {"rpy": [0.6, -0.4, 0.9]}
PLACE = {"position": [0.3, 0.2, 0.9], "orientation": RPY}
PALM = {"type": "frame", "frame": "left_palm"}
SPECS: dict[str, TaskSpec] = {
    "com": ComSpec.model_validate({"type": "com", "target": [0.1, -0.2, 0.3]}),
    "position": PositionSpec.model_validate({**PALM, "control": "position", "target": [1, 0, 1]}),
    "orientation": OrientationSpec.model_validate(
        {**PALM, "control": "orientation", "target": RPY}
    ),
    "pose": PoseSpec.model_validate({**PALM, "control": "pose", "target": PLACE}),
    "axis": AxisSpec.model_validate({**PALM, "control": "axis", "target": [1, -2, 0.3]}),
    "relative pose": RelativePoseSpec.model_validate(
        {"type": "relative_pose", "frame": "left_palm", "relative_to": "right_palm"}
        | {"target": PLACE}
    ),
    "distance": DistanceSpec.model_validate(
        {"type": "distance", "frame": "left_palm", "other": "right_palm", "target": 0.5}
    ),
    "posture": PostureSpec.model_validate(
        {"type": "posture", "target": {"*_elbow_pitch": -0.6, "*_knee_pitch": 0.9}}
    ),
    "inertia": InertiaSpec.model_validate(
        {"type": "inertia", "components": "all", "target": {"scale": 1.4}}
    ),
    "principal inertia": InertiaSpec.model_validate(
        {"type": "inertia", "components": "principal", "target": {"scale": 1.2}}
    ),
}


@pytest.mark.parametrize("kind", SPECS)
def test_ramps_hand_on_rate_and_acceleration(kind: str, hoap2) -> None:
    start = hoap2.snapshot(hoap2.posture("standing"))
    assert SPECS[kind].build(kind, start).moving(start) is None
    one = SPECS[kind].model_copy(update={"ramp": 2.0}).build(kind, start)
    moving = one.moving(start)
    assert moving is not None and "ramp" in type(SPECS[kind]).model_fields

    def error(t: float) -> np.ndarray:
        moving.move_to(t)
        return one.task.residual(start).error

    for t in (0.3, 1.4):
        behind, middle, ahead = error(t - H), error(t), error(t + H)
        moving.move_to(t)
        rate, second = (ahead - behind) / (2 * H), (ahead - 2.0 * middle + behind) / H**2
        scale = np.abs(second).max()
        assert scale > 0.01  # it moves
        np.testing.assert_allclose(one.task.residual(start).bias, rate, atol=2e-6)
        np.testing.assert_allclose(one.task.drift(start), second, atol=1e-4 * max(scale, 1.0))
    moving.move_to(9.0)
    assert not one.task.residual(start).bias.any()


def test_a_loop_with_a_ramp_is_refused(hoap2) -> None:
    spec = PostureSpec.model_validate({"type": "posture", "ramp": 1.0, "target": LOOP})
    with pytest.raises(Misplaced, match="a loop says itself"):
        spec.build("posture", hoap2.snapshot(hoap2.posture("standing")))


def test_a_com_goes_over_several_feet(hoap2) -> None:
    """As a quadruped's that lifts one: before, only one foot, two or all could be said."""
    start = hoap2.snapshot(hoap2.posture("standing", {"left_hip_roll": 0.2}))
    places = [start.position(f"{side}_sole") for side in ("left", "right")]
    spec = ComSpec.model_validate({"type": "com", "target": {"over": ["left", "right"]}})
    goal = spec.build("com", start).goal(start, start.com)
    np.testing.assert_allclose(goal[:2], np.mean(places, axis=0)[:2], atol=1e-12)
    wrong = ComSpec.model_validate({"type": "com", "target": {"over": ["left", "rigth"]}})
    with pytest.raises(UnknownNameError, match="'rigth'; did you mean 'right'"):
        wrong.build("com", start)


def test_a_momentum_that_ramps_is_a_force(hoap2) -> None:
    start = hoap2.snapshot(hoap2.posture("standing"))
    spec = MomentumSpec.model_validate({"type": "momentum", "target": [1, 2, 3, 0.1, 0.2, 0.3]})
    one = spec.build("momentum", start)
    ramp = MinimumJerk(np.zeros(6), np.array(spec.target), 2.0)
    MovingTarget(ramp, one.set_target).move_to(1.0)
    # Half way a minimum-jerk ramp has its peak slope, 1.875 / duration (Flash and Hogan 1985).
    force = 1.875 / 2.0 * np.array(spec.target)
    np.testing.assert_allclose(one.task.target_rate, force)
    np.testing.assert_allclose(one.task.drift(start), -force, atol=1e-12)
