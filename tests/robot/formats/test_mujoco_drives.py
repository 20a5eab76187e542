"""Springs, gravity, rotors and motors of compiled MJCF. Oracle: forces of MuJoCo."""

import numpy as np
import pytest

from tests.robot.formats.mjcf_texts import INERTIAL, TRUNK, arm, assert_agree, load, mujoco, text
from wbc.errors import ModelError
from wbc.robot import Robot
from wbc.simulation import Plant

SPRUNG = {
    "spring": 'stiffness="50" springref=".3"',
    "damped": 'springdamper=".2 1"',
    "curved": 'stiffness="50 3 2" springref="-.2" damping="2 1 .5"',
    "from ref": 'stiffness="20" ref=".4" springref=".1"',
}


@pytest.mark.parametrize("case", SPRUNG)
@pytest.mark.parametrize("gravity", ["0 0 -9.81", "0 0 -1.62", "1 0 -2"])
def test_passive_forces_are_mujocos_in_the_robot_and_in_the_plant(case: str, gravity: str) -> None:
    if "curved" in case and tuple(map(int, mujoco.__version__.split(".")[:2])) < (3, 5):
        pytest.skip("polynomial springs are newer")
    fore = f'<body name="fore" gravcomp=".5"><joint name="j2" range="-1 1"/>{INERTIAL.format(2)}'
    lifted = arm(SPRUNG[case], fore + "</body>").replace("<body", '<body gravcomp="1"', 1)
    robot, model = load(text(lifted, head=f'<option gravity="{gravity}"/>'))
    assert_agree(robot, model)
    assert any("springs act on j1" in note for note in robot.notes)
    np.testing.assert_array_equal(robot.model.gravity.linear, model.opt.gravity)
    rng, data, plant = np.random.default_rng(1), mujoco.MjData(model), Plant(robot)
    for _ in range(3):
        q = robot.integrate(robot.postures["neutral"], rng.uniform(-0.7, 0.7, robot.nv), 1.0)
        v = rng.standard_normal(robot.nv)
        plant.reset(q, v)
        data.qpos[:], data.qvel[:] = plant.data.qpos, plant.data.qvel
        mujoco.mj_forward(model, data)
        wanted = data.qfrc_passive.copy()
        wanted[6:] += robot.damping * v[6:]
        wanted[:3] = robot.snapshot(q).rotation("base").T @ wanted[:3]
        np.testing.assert_allclose(robot.passive_forces(q, v), wanted, atol=1e-11)
        np.testing.assert_allclose(plant.data.qacc, data.qacc, rtol=1e-9, atol=1e-9)


def test_springs_that_give_way_and_contacts_that_pull_or_move_are_told() -> None:
    if not hasattr(mujoco.MjModel.from_xml_string("<mujoco/>"), "jnt_springyield"):
        pytest.skip("an older MuJoCo")
    geom = '<geom name="pad" size=".1" mass="0" adhesion="9" surfacevel="1 0 0 0 0 0"/>'
    ball = '<body name="b"><joint name="j2" type="ball" stiffness="5" springyield=".2"/>'
    rest = geom + ball + INERTIAL.format(1) + "</body>"
    robot = Robot.load(text(arm('stiffness="50" springyield=".1"', rest)), feet={})
    told = "springs that give way (springyield) are taken for elastic ones: j1, j2:x, j2:y, j2:z"
    assert told in robot.notes
    assert "adhesion and moving surfaces (surfacevel) are not used: pad" in robot.notes
    plain = Robot.load(text(arm('stiffness="50"')), feet={})
    assert not any("give way" in note or "adhesion" in note for note in plain.notes)


def test_switched_off_physics_does_not_act() -> None:
    newer = hasattr(mujoco.mjtDisableBit, "mjDSBL_SPRING")
    passive = 'spring="disable" damper="disable"' if newer else 'passive="disable"'
    off = f'<option><flag gravity="disable" frictionloss="disable" {passive}/></option>'
    robot, _ = load(text(arm('stiffness="5" damping="2" frictionloss="1"'), head=off))
    assert not robot.passive and robot.gravity == 0.0 and not robot.damping.any()
    assert not robot.friction.any()
    assert any("gravity is the file's: 0 0 0" in note for note in robot.notes)


def test_what_motors_damp_is_felt_by_the_square_of_their_gear() -> None:
    if not hasattr(mujoco.MjModel.from_xml_string("<mujoco/>"), "actuator_dampingpoly"):
        pytest.skip("an older MuJoCo")
    motors = '<motor joint="j1" gear="-5" damping=".1 .2 .3"/><motor joint="j1" damping="1"/>'
    # The first is off: rotors and friction stay.
    head = '<default><motor group="1"/></default><option actuatorgroupdisable="1"/>'
    tail = f"<actuator>{motors}</actuator>"
    for content in (text(arm('damping=".4"'), tail=tail, head=h) for h in ("", head)):
        robot, model = load(content)
        data, v = mujoco.MjData(model), np.zeros(robot.nv)
        for v[6] in (0.7, -2.0):
            data.qvel[6] = v[6]
            mujoco.mj_forward(model, data)
            given = robot.passive_forces(robot.postures["neutral"], v)[6] - robot.damping[0] * v[6]
            assert given == pytest.approx(data.qfrc_passive[6], rel=1e-12)


def test_motors_act_together_unless_their_group_is_off() -> None:
    """Two that pull against each other give what one does; of two groups, one may be off."""
    pull = '<motor joint="j1" ctrlrange="0 5" gear="{}" group="{}"/>'
    pair = pull.format(1, 0) + pull.format(-1, 0)
    strong = '<motor joint="j1" name="strong" ctrlrange="-30 30" group="2"/>'
    off = '<option actuatorgroupdisable="2"/>'
    for motors, head, effort in ((pair, "", 5), (pair + strong, "", 35), (pair + strong, off, 5)):
        robot, model = load(text(arm(), tail=f"<actuator>{motors}</actuator>", head=head))
        assert robot.limits.effort[0] == effort
        assert not any("one way" in note for note in robot.notes)  # nor harder one way
        told = any("switches off" in note and "strong" in note for note in robot.notes)
        assert told is bool(head)
        data = mujoco.MjData(model)
        for sign in (1.0, -1.0):
            data.ctrl[:] = sign * 1e6 * np.sign(model.actuator_gear[:, 0])
            mujoco.mj_forward(model, data)
            assert data.qfrc_actuator[6] == sign * effort


def test_constraints_that_are_switched_off_do_not_act() -> None:
    """Friction and couplings go with them; ranges are kept, and that is said."""
    two = arm('frictionloss="1"') + arm(name="other").replace("j1", "j2")
    tied = '<equality><joint joint1="j2" joint2="j1"/></equality>'
    for word in ("constraint", "limit", "equality"):
        off = f'<option><flag {word}="disable"/></option>'
        robot, _ = load(text(two, head=off, tail=tied))
        assert robot.friction[0] == (word != "constraint")
        assert bool(robot.couplings) is (word == "limit") and robot.limits.upper[0] == 1.0
        kept = any("switches limits of joints off" in note for note in robot.notes)
        assert kept is (word != "equality")
    off = '<option><flag actuation="disable"/></option>'
    robot, _ = load(text(arm(), head=off, tail='<actuator><motor joint="j1"/></actuator>'))
    assert any("switches all motors off; here they act" in note for note in robot.notes)
    off = '<option><flag clampctrl="disable"/></option>'
    for limits, bound in (("-3 2", 2.0), ("0 0", np.inf)):
        motors = f'<actuator><motor joint="j1" ctrlrange="{limits}"/></actuator>'
        robot, _ = load(text(arm(), head=off, tail=motors))
        said = any("switches limits of controls off" in note for note in robot.notes)
        assert robot.limits.effort[0] == bound and said is bool(bound < np.inf)


def test_weight_that_is_added_counts_where_mujoco_adds_it() -> None:
    """Of negative compensations alone MuJoCo makes nothing."""
    for trunk, nothing in (("1", False), ("0", True)):
        heavy = arm().replace("<body", '<body gravcomp="-.5"', 1)
        root = TRUNK.replace("<body", f'<body gravcomp="{trunk}"')
        robot, model = load(text(heavy, root=root))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        given = robot.passive_forces(robot.postures["neutral"])[6]
        assert given == pytest.approx(data.qfrc_passive[6], abs=1e-12)
        assert (not robot.passive) is nothing


def test_rotors_of_motors_are_in_the_mass_matrix() -> None:
    motors = '<actuator><motor joint="j1" gear="3" armature=".05"/></actuator>'
    content = text(arm('armature=".01"'), tail=motors)
    try:
        robot, model = load(content)
    except ModelError:
        pytest.skip("an older MuJoCo")
    assert_agree(robot, model)
    assert robot.armature[0] == pytest.approx(0.01 + 9 * 0.05)


def test_what_a_free_joint_inherits_is_said_and_left_out() -> None:
    free = TRUNK.replace("<freejoint/>", '<joint type="free"/>')
    head = '<default><joint armature=".1" damping="1" frictionloss=".2"/></default>'
    robot, _ = load(text(arm(), root=free, head=head))
    said = [note for note in robot.notes if "floating base" in note]
    assert len(said) == 3 and robot.armature[0] == 0.1
    assert robot.snapshot(robot.postures["neutral"]).mass_matrix[0, 0] == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("given", "effort"),
    [
        ('joint actuatorfrcrange="-30 50"', 30.0),
        ('joint actuatorfrcrange="0 50"', 50.0),
        ('motor ctrlrange="-4 9" gear="2"', 8.0),
        ('motor forcerange="-7 3" ctrlrange="-100 100"', 3.0),
        ('position kp="100" forcerange="-12 15"', 12.0),
    ],
)
def test_the_smaller_end_of_a_range_bounds_a_motor(given: str, effort: float) -> None:
    kind, _, attributes = given.partition(" ")
    of_joint, motor = (attributes, "motor") if kind == "joint" else ("", given)
    tail = f'<actuator><{motor} joint="j1"/></actuator>'
    robot, _ = load(text(arm(of_joint), tail=tail))
    assert robot.limits.effort[0] == effort
    assert any("one way only" in note for note in robot.notes) == ('"0 50' in given)
    harder = [note for note in robot.notes if "harder one way" in note]
    assert [note.rpartition(": ")[2] for note in harder] == ([] if '"0 50' in given else ["j1"])


def test_tendons_and_joints_without_motors_are_said() -> None:
    tail = (
        '<tendon><fixed name="pull"><joint joint="j1" coef="1"/></fixed></tendon>'
        '<actuator><motor name="winch" tendon="pull"/><motor joint="j2"/></actuator>'
    )
    robot, _ = load(text(arm(rest=arm(name="fore").replace("j1", "j2")), tail=tail))
    said = " | ".join(robot.notes)
    assert "winch" in said and "tendons are not read" in said and "no motor of the file" in said
    assert "here each joint has one, but for unactuated=[...]" in said


def test_a_motor_whose_gear_is_0_drives_nothing() -> None:
    """Its joint was said to have a motor, of no bound."""
    tail = '<actuator><motor name="idle" joint="j1" gear="0"/><motor joint="j2"/></actuator>'
    robot, _ = load(text(arm(rest=arm(name="fore").replace("j1", "j2")), tail=tail))
    assert any(note.endswith("gear is 0, drive nothing: idle") for note in robot.notes)
    assert any(note.startswith("no motor of the file drives j1; ") for note in robot.notes)


def test_what_acts_on_the_free_joint_itself_is_told() -> None:
    """A thruster and a spring move the base in MuJoCo, and nothing here."""
    root = TRUNK.replace("<freejoint/>", '<joint name="root" type="free" stiffness="5"/>')
    thruster = '<actuator><motor name="jet" joint="root" gear="0 0 1 0 0 0"/></actuator>'
    robot, model = load(text(arm(), root=root, tail=thruster))
    assert model.nu == 1
    assert model.jnt_stiffness[0] == 5.0
    assert any(note.endswith("free joints) are not read: jet") for note in robot.notes)
    assert "the file gives the floating base a spring, which is not used" in robot.notes


def test_what_acts_on_joints_that_are_the_floating_base_is_told() -> None:
    kinds = [(kind, axis) for kind in ("slide", "hinge") for axis in ("1 0 0", "0 1 0", "0 0 1")]
    six = "".join(f'<joint name="b{k}" type="{a}" axis="{b}"/>' for k, (a, b) in enumerate(kinds))
    plain, _ = load(text(arm(), root=TRUNK.replace("<freejoint/>", six)))
    assert not any("not used" in note or "do not act" in note for note in plain.notes)
    given = 'armature="1" damping="2" frictionloss="3" stiffness="4" range="-1 1"'
    six = six.replace("<joint ", f"<joint {given} ")
    tail = '<equality><joint name="held" joint1="b3"/></equality>'
    robot, _ = load(text(arm(), root=TRUNK.replace("<freejoint/>", six), tail=tail))
    for what in ("rotor inertia", "damping", "dry friction", "a spring", "a range"):
        assert f"the file gives the floating base {what}, which is not used" in robot.notes
    assert "equality constraints with what is left out do not act: held" in robot.notes
