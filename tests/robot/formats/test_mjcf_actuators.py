"""Effort limits from actuators. Oracle: the torque MuJoCo gives at a control without bound."""

import numpy as np
import pytest

from tests.robot.formats.mjcf_texts import mujoco
from wbc.errors import ModelError
from wbc.robot import Robot

JOINTS = ("motor", "force", "geared", "servo", "both", "general", "joint", "servo2", "classed")
BODY = '<body name="{0}" pos="0 0 -.1"><joint name="{0}" axis="0 1 0" range="-1 1"{1}/>'
INERTIAL = '<inertial pos="0 0 -.1" mass="1" diaginertia=".1 .1 .1"/>'
EXTRA = {"joint": ' actuatorfrcrange="-2 2"'}
ACTUATORS = """
  <motor joint="motor" ctrlrange="-4 4"/>
  <motor joint="force" ctrlrange="-4 4" forcerange="-3 3"/>
  <motor joint="geared" gear="-6 0 0" ctrlrange="-1 1"/>
  <position joint="servo" kp="100" forcerange="-7 7"/>
  <motor joint="both" ctrlrange="-1 1"/><motor joint="both" gear="2" ctrlrange="-1 1"/>
  <general joint="general" gainprm="5" ctrlrange="-2 2"/>
  <motor joint="joint" ctrlrange="-9 9"/>
  <position joint="servo2" kp="100" class="strong"/>
  <motor joint="classed" class="strong"/>
"""
DEFAULTS = """<default><default class="strong"><motor gear="3" forcerange="-20 20"/></default>
  </default>"""


def text(actuators: str = ACTUATORS, compiler: str = "") -> str:
    bodies = "".join(BODY.format(name, EXTRA.get(name, "")) + INERTIAL for name in JOINTS)
    return (
        f'<mujoco model="m"><compiler angle="radian"{compiler}/>{DEFAULTS}<worldbody>'
        f'<body name="trunk"><freejoint/>{INERTIAL}{bodies}{"</body>" * len(JOINTS)}</body>'
        f"</worldbody><actuator>{actuators}</actuator></mujoco>"
    )


def test_efforts_are_what_the_actuators_can_give() -> None:
    robot = Robot.load(text())
    expected = [4, 3, 6, 7, 3, 10, 2, 60, 60]
    np.testing.assert_array_equal(robot.limits.effort, expected)
    np.testing.assert_array_equal(robot.model.lowerEffortLimit[6:], [-e for e in expected])
    model = mujoco.MjModel.from_xml_string(text())
    data = mujoco.MjData(model)
    for sign in (1.0, -1.0):
        data.ctrl[:] = sign * 1e6
        data.ctrl[2] *= -1.0  # a gear turned round
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_actuator[6:], sign * robot.limits.effort)


def test_efforts_far_below_what_joints_take_are_told() -> None:
    """Controls of [-1, 1] on joints of 88 N m, as in a G1 for motion capture: it stood on 1 N m."""
    assert not any("ranges of controls" in note for note in Robot.load(text()).notes)
    normalised = Robot.load(text().replace('"-2 2"/>', '"-100 100"/>', 1))
    (note,) = (one for one in normalised.notes if "ranges of controls" in one)
    assert ": joint; where" in note and "effort={joint: N m}" in note


@pytest.mark.parametrize(
    ("motor", "steps", "rtol"),
    [
        ('dyntype="filter" dynprm=".01"', 200, 1e-6),
        ('dyntype="filterexact" dynprm=".01"', 200, 1e-6),
        ('dyntype="filter" dynprm=".1" actrange="-.5 .5"', 100, 1e-7),
        ('dyntype="integrator" dynprm=".1" actrange="-.5 .5"', 100, 1e-7),
    ],
)
def test_motors_with_activations_give_what_these_or_their_controls_bound(
    motor: str, steps: int, rtol: float
) -> None:
    content = text(f'<general joint="motor" {motor} gainprm="5" ctrlrange="-2 2"/>')
    model = mujoco.MjModel.from_xml_string(content)
    data = mujoco.MjData(model)
    data.act[:], data.ctrl[:] = 2.0, 1e6
    for _ in range(steps):
        mujoco.mj_step(model, data)
    found = Robot.load(content).limits.effort[0]
    np.testing.assert_allclose(found, data.qfrc_actuator[6], rtol=rtol)


@pytest.mark.parametrize(
    ("actuator", "told"),
    [
        ('muscle name="a" joint="motor" lengthrange="0 1"', ["both ways: a", "(delay, dyntype)"]),
        ('damper name="a" joint="motor" kv="3" ctrlrange="0 1"', ["both ways: a"]),
        ('general name="a" joint="motor" dyntype="filter" dynprm=".1"', ["not used: a"]),
        ('motor name="a" joint="motor" delay=".01" nsample="9"', ["not used: a"]),
        ('position name="a" joint="motor" kp="9" kv="1" forcerange="-9 9"', []),
    ],
)
def test_what_gives_no_torque_at_once_or_both_ways_is_told(actuator: str, told: list[str]) -> None:
    content = text(f"<{actuator}/>")
    try:
        mujoco.MjModel.from_xml_string(content)
    except ValueError:
        pytest.skip("this MuJoCo has no such actuator")
    notes = Robot.load(content).notes
    found = [one for one in notes if "muscles" in one or "at once" in one]
    assert len(found) == len(told)
    assert all(words in note for words, note in zip(told, found, strict=True))


def test_actuators_after_one_with_two_controls_keep_their_ranges() -> None:
    """Newer MuJoCo counts controls, which are more than actuators."""
    two = '<dcmotor joint="servo" motorconst="1" resistance="1" input="pos vel"'
    three = '<motor joint="motor" ctrlrange="-4 4"/><motor joint="force" ctrlrange="-3 3"/>'
    content = text(f'{two} controller="9 0 5"/>{three}')
    try:
        model = mujoco.MjModel.from_xml_string(content)
    except ValueError:
        pytest.skip("this MuJoCo has no actuators with two controls")
    assert model.nu == 4
    assert list(Robot.load(content).limits.effort[:4]) == [4, 3, np.inf, np.inf]


def test_what_has_no_range_is_not_bounded() -> None:
    loose = (
        '<motor joint="motor"/><position joint="servo" kp="10" ctrlrange="-1 1"/>'
        '<motor joint="force" ctrlrange="-1 1" ctrllimited="false"/>'
    )
    robot = Robot.load(text(loose))
    assert set(robot.limits.without_effort) == {*JOINTS} - {"joint"}
    # Ranges that need to be switched on: autolimits off.
    off = text('<motor joint="motor" ctrlrange="-4 4"/>', ' autolimits="false"')
    off = off.replace(' ctrlrange="-4', ' ctrllimited="false" ctrlrange="-4')
    off = off.replace(' actuatorfrcrange="', ' actuatorfrclimited="true" actuatorfrcrange="')
    found = Robot.load(off.replace(' range="', ' limited="true" range="'))
    assert "motor" in found.limits.without_effort


@pytest.mark.parametrize(
    ("actuator", "told"),
    [
        ('<motor joint="motor" ctrlrange="-4"/>', "'ctrlrange' does not have enough data"),
        ('<motor joint="motor" gear="nan"/>', "<motor"),
        ('<motor joint="motor" class="none"/>', "unknown default class name 'none'"),
    ],
)
def test_ill_formed_actuators_are_named(actuator: str, told: str) -> None:
    with pytest.raises(ModelError, match=told):
        Robot.load(text(actuator))


@pytest.mark.parametrize(("own", "effort"), [("", np.inf), ('forcerange="-3 3"', 3.0)])
def test_the_control_of_a_plugin_is_no_force(own: str, effort: float) -> None:
    config = '<config key="kp" value="40"/>'
    head = '<extension><plugin plugin="mujoco.pid"><instance name="pid">'
    head += f"{config}</instance></plugin></extension>"
    servo = f'<plugin joint="motor" plugin="mujoco.pid" instance="pid" ctrlrange="-1 1" {own}/>'
    content = text(servo).replace("<worldbody>", f"{head}<worldbody>")
    assert Robot.load(content).limits.effort[0] == effort
