"""Effort limits from actuators. Oracle: the torque MuJoCo gives at a control without bound."""

from pathlib import Path

import numpy as np
import pytest

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


def load(folder: Path, content: str) -> Robot:
    path = folder / "m.xml"
    path.write_text(content)
    return Robot.load(path)


def test_efforts_are_what_the_actuators_can_give(tmp_path: Path) -> None:
    robot = load(tmp_path, text())
    expected = [4, 3, 6, 7, 3, 10, 2, 60, 60]
    np.testing.assert_array_equal(robot.limits.effort, expected)
    np.testing.assert_array_equal(robot.model.lowerEffortLimit[6:], [-e for e in expected])
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(text())
    data = mujoco.MjData(model)
    for sign in (1.0, -1.0):
        data.ctrl[:] = sign * 1e6
        data.ctrl[2] *= -1.0  # a gear turned round
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_actuator[6:], sign * robot.limits.effort)


def test_efforts_far_below_what_joints_take_are_told(tmp_path: Path) -> None:
    """Controls of [-1, 1] on joints of 88 N m, as in a G1 for motion capture: it stood on 1 N m."""
    assert not any("ranges of controls" in note for note in load(tmp_path, text()).notes)
    normalised = text().replace('"-2 2"/>', '"-100 100"/>', 1)
    (note,) = (one for one in load(tmp_path, normalised).notes if "ranges of controls" in one)
    assert ": joint; where" in note and "effort={joint: N m}" in note


@pytest.mark.parametrize("dynamics", ["filter", "filterexact"])
def test_filtered_motors_give_what_their_controls_bound(tmp_path: Path, dynamics: str) -> None:
    mujoco = pytest.importorskip("mujoco")
    filtered = f'dyntype="{dynamics}" dynprm=".01" gainprm="5" ctrlrange="-2 2"'
    content = text(f'<general joint="motor" {filtered}/>')
    robot = load(tmp_path, content)
    model = mujoco.MjModel.from_xml_string(content)
    data = mujoco.MjData(model)
    data.ctrl[:] = 1e6
    for _ in range(200):
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(robot.limits.effort[0], data.qfrc_actuator[6], rtol=1e-6)


@pytest.mark.parametrize("dynamics", ["filter", "integrator"])
def test_a_range_of_activations_bounds_motors(tmp_path: Path, dynamics: str) -> None:
    mujoco = pytest.importorskip("mujoco")
    motor = f'dyntype="{dynamics}" dynprm=".1" gainprm="5" ctrlrange="-2 2" actrange="-.5 .5"'
    content = text(f'<general joint="motor" {motor}/>')
    model = mujoco.MjModel.from_xml_string(content)
    data = mujoco.MjData(model)
    data.act[:] = data.ctrl[:] = 2.0
    for _ in range(100):
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(load(tmp_path, content).limits.effort[0], data.qfrc_actuator[6])


def test_actuators_after_one_with_two_controls_keep_their_ranges(tmp_path: Path) -> None:
    """Newer MuJoCo counts controls, which are more than actuators."""
    two = (
        '<dcmotor joint="servo" motorconst="1" resistance="1" input="pos vel" controller="9 0 5"/>'
    )
    three = '<motor joint="motor" ctrlrange="-4 4"/><motor joint="force" ctrlrange="-3 3"/>'
    content = text(two + three)
    mujoco = pytest.importorskip("mujoco")
    try:
        model = mujoco.MjModel.from_xml_string(content)
    except ValueError:
        pytest.skip("this MuJoCo has no actuators with two controls")
    assert model.nu == 4
    assert list(load(tmp_path, content).limits.effort[:4]) == [4, 3, np.inf, np.inf]


def test_what_has_no_range_is_not_bounded(tmp_path: Path) -> None:
    loose = (
        '<motor joint="motor"/><position joint="servo" kp="10" ctrlrange="-1 1"/>'
        '<motor joint="force" ctrlrange="-1 1" ctrllimited="false"/>'
    )
    robot = load(tmp_path, text(loose))
    assert set(robot.limits.without_effort) == {*JOINTS} - {"joint"}
    # Ranges that need to be switched on: autolimits off.
    off = text('<motor joint="motor" ctrlrange="-4 4"/>', ' autolimits="false"')
    off = off.replace(' ctrlrange="-4', ' ctrllimited="false" ctrlrange="-4')
    off = off.replace(' actuatorfrcrange="', ' actuatorfrclimited="true" actuatorfrcrange="')
    off = load(tmp_path, off.replace(' range="', ' limited="true" range="'))
    assert "motor" in off.limits.without_effort


@pytest.mark.parametrize(
    ("actuator", "told"),
    [
        ('<motor joint="motor" ctrlrange="-4"/>', "'ctrlrange' does not have enough data"),
        ('<motor joint="motor" gear="nan"/>', "<motor"),
        ('<motor joint="motor" class="none"/>', "unknown default class name 'none'"),
    ],
)
def test_ill_formed_actuators_are_named(tmp_path: Path, actuator: str, told: str) -> None:
    with pytest.raises(ModelError, match=told):
        load(tmp_path, text(actuator))


@pytest.mark.parametrize(("own", "effort"), [("", np.inf), ('forcerange="-3 3"', 3.0)])
def test_the_control_of_a_plugin_is_no_force(tmp_path: Path, own: str, effort: float) -> None:
    config = '<config key="kp" value="40"/>'
    head = '<extension><plugin plugin="mujoco.pid"><instance name="pid">'
    head += f"{config}</instance></plugin></extension>"
    servo = f'<plugin joint="motor" plugin="mujoco.pid" instance="pid" ctrlrange="-1 1" {own}/>'
    content = text(servo).replace("<worldbody>", f"{head}<worldbody>")
    assert load(tmp_path, content).limits.effort[0] == effort
