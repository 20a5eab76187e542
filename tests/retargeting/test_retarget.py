"""Human motion on humanoids: feet, limits, margins, CoM and momentum."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import wbc
from tests.retargeting.humans import crouching, facing, stepping
from wbc.retargeting import RetargetWeights, body_map
from wbc.retargeting.initial_guess import interpolate
from wbc.retargeting.result import Reached
from wbc.retargeting.targets import balance_com
from wbc.retargeting.tracking_errors import dissimilarity_notes, penetration_notes
from wbc.robot import Robot
from wbc.view.live.retargeted import human_beside
from wbc.view.mcap_export import write_retargeted


@pytest.fixture(scope="module")
def crouch(hoap2: Robot) -> wbc.Retargeted:
    return wbc.retarget(crouching(), hoap2)


def check_constraints(motion: wbc.Retargeted) -> None:
    """Check the constraints by other means than those that made the motion."""
    robot, limits = motion.robot, motion.robot.limits
    collision = wbc.SelfCollision(robot, margin=0.01)
    for q in motion.q:
        snapshot = robot.snapshot(q)
        assert (snapshot.joint_positions <= limits.upper + 1e-9).all()
        assert (snapshot.joint_positions >= limits.lower - 1e-9).all()
        assert collision.distances(snapshot).clearance.min() > -1e-4  # m
    assert np.all(np.abs(motion.v[:, 6:]) <= limits.velocity * 1.001)
    assert motion.slide < 1e-3


def test_swinging_soles_below_the_ground_are_noted(crouch: wbc.Retargeted) -> None:
    """As in a walk recorded by a drifting suit: 55 mm below it in swing, and nothing was noted."""
    assert penetration_notes(crouch.robot, crouch.targets, crouch.q) == []
    q = crouch.q.copy()
    q[3, 2] -= 0.02
    notes = penetration_notes(crouch.robot, crouch.targets, q)
    assert [note.split(",")[0] for note in notes] == [
        f"the swinging {foot} sole is up to 20 mm below the ground" for foot in crouch.robot.feet
    ]


def test_human_that_faces_backwards_moves_the_robot_alike(hoap2: Robot) -> None:
    """The left foot heads for -177 degrees, the right one for 177: their mean was 0."""
    human = crouching(0.8, inward=-0.05)
    ahead, back = (wbc.retarget(one, hoap2, rounds=2) for one in (human, facing(human, np.pi)))
    assert back.targets.feet.widening == pytest.approx(ahead.targets.feet.widening, abs=1e-9)
    np.testing.assert_allclose(back.q[:, 7:], ahead.q[:, 7:], atol=1e-3)  # rad: solved to 1e-4


def test_a_robot_whose_file_faces_sideways_moves_alike(
    hoap2: Robot, crouch: wbc.Retargeted
) -> None:
    """As where a scene's base is turned: its feet could not reach, 39 degrees off."""
    turn = np.zeros(hoap2.nv)
    turn[5] = 0.5 * np.pi
    sideways = hoap2.integrate(hoap2.posture(), turn, 1.0)
    turned = replace(hoap2, postures={**hoap2.postures, "standing": sideways})
    found = wbc.retarget(crouching(), turned)
    np.testing.assert_allclose(found.q, crouch.q, atol=1e-3)
    assert found.robot is turned


def test_retargeting_uses_one_blas_thread_and_restores_the_others(hoap2: Robot) -> None:
    """Beside other work a motion of a G1 took 40 times as long with the threads of BLAS."""

    def threads() -> set[int]:
        return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}

    seen = set[int]()
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        wbc.retarget(
            crouching(), hoap2, rounds=1, duration=4.0, progress=lambda *_: seen.update(threads())
        )
        assert (seen, threads()) == ({1}, before)


def test_crouch_does_not_move_the_feet(crouch: wbc.Retargeted) -> None:
    check_constraints(crouch)
    robot = crouch.robot
    assert crouch.contacts.all()
    # Both soles by Pinocchio, in all frames: what a sole is off from where it first was.
    data = robot.model.createData()
    for foot in robot.feet.values():
        frame = robot.model.getFrameId(foot.frame)
        places = []
        for q in crouch.q:
            pin.framesForwardKinematics(robot.model, data, q)
            places.append(data.oMf[frame].translation.copy())
        assert np.ptp(places, axis=0).max() < 1e-3
    assert crouch.com_correlation[2] > 0.97  # its joints are slower than the human's
    # A third less deep than the human, by the legs' lengths; the cause is not known.
    depth = np.ptp(crouch.whole.com[:, 2])
    assert depth == pytest.approx(np.ptp(crouch.targets.human_com[:, 2]), rel=0.35)


def test_feet_with_inward_toes_are_shifted_outward(hoap2: Robot) -> None:
    motion = wbc.retarget(crouching(1.0, inward=0.35), hoap2)
    check_constraints(motion)
    toes = [motion.targets.feet.paths[side].heading[0] for side in ("left", "right")]
    assert toes[1] - toes[0] == pytest.approx(0.7, abs=0.1)  # they still do


def test_human_beside_the_robot_moves_at_the_same_times(crouch: wbc.Retargeted) -> None:
    human = crouching()
    beside = human_beside(human, crouch)
    assert beside.shape == (len(crouch), human.motion.robot.nq)
    own = np.array([human.motion.robot.snapshot(q).com[2] for q in beside])
    # Half a frame of the recording, 10 ms, of a CoM that sinks at 0.3 m/s.
    wanted = crouch.targets.human_com[:, 2] / crouch.scale.length
    np.testing.assert_allclose(own - own[0], wanted - wanted[0], atol=6e-3)
    soles = [human.motion.robot.feet[side].frame for side in ("left", "right")]
    low = human.motion.robot.snapshot(beside[0])
    assert max(abs(low.position(sole)[2]) for sole in soles) < 0.02
    assert crouch.q[0, 1] - beside[0, 1] == pytest.approx(0.5, abs=0.1)  # it looks along x


def test_wrenches_satisfy_newton_and_euler(crouch: wbc.Retargeted) -> None:
    """By Newton and Euler about the CoM, and by Pinocchio's inverse dynamics for the torques."""
    robot, k = crouch.robot, len(crouch) // 3
    force = crouch.wrenches[k, :, :3].sum(axis=0)
    wanted = crouch.whole.momentum_rate[k, :3] + [0.0, 0.0, robot.weight]
    assert force == pytest.approx(wanted, abs=0.01 * robot.weight)
    assert (crouch.wrenches[..., 2] >= 0.0).all()
    data = robot.model.createData()
    tau = pin.rnea(robot.model, data, crouch.q[k], crouch.v[k], crouch.acceleration[k])
    snapshot = robot.snapshot(crouch.q[k])
    for n, foot in enumerate(robot.feet.values()):
        tau -= snapshot.jacobian(foot.frame).T @ crouch.wrenches[k, n]
    assert crouch.torque[k] == pytest.approx(tau[6:], abs=0.02 * np.abs(tau).max())
    assert np.abs(tau[:6]).max() < 0.02 * robot.weight  # nothing holds the base


def test_files_have_the_fields_of_policy_training(crouch: wbc.Retargeted, tmp_path: Path) -> None:
    robot = crouch.robot
    crouch.save(tmp_path / "own.npz")
    again = wbc.read_motion(tmp_path / "own.npz", robot)
    assert again.joints == pytest.approx(crouch.q[:, 7:])
    with np.load(tmp_path / "own.npz") as file:
        summary = json.loads(str(file["summary"]))
        assert summary["robot"] == robot.name and file["wrenches"].shape == (len(crouch), 2, 6)
    crouch.save(tmp_path / "rows.csv", "unitree")
    rows = np.loadtxt(tmp_path / "rows.csv", delimiter=",")
    assert rows == pytest.approx(crouch.q, abs=1e-6)
    again = wbc.read_motion(tmp_path / "rows.csv", robot, rate=50.0)
    assert again.joints == pytest.approx(crouch.q[:, 7:], abs=1e-6)
    assert again.base == pytest.approx(crouch.q[:, :7], abs=1e-5)
    np.savetxt(tmp_path / "less.csv", rows[:, 1:], delimiter=",")
    with pytest.raises(wbc.WbcError, match=f"the {robot.nq} of Unitree's files .* {robot.nq - 1}$"):
        wbc.read_motion(tmp_path / "less.csv", robot, rate=50.0)
    crouch.save(tmp_path / "track.npz", "tracking")
    again = wbc.read_motion(tmp_path / "track.npz", robot)
    assert again.rate == pytest.approx(50.0)
    assert again.joints == pytest.approx(crouch.q[:, 7:], abs=1e-6)
    assert again.base == pytest.approx(crouch.q[:, :7], abs=1e-5)
    with np.load(tmp_path / "track.npz") as file:
        names = [str(name) for name in file["body_names"]]
        assert file["fps"][0] == pytest.approx(50.0)
        assert file["joint_pos"] == pytest.approx(crouch.q[:, 7:], abs=1e-6)
        place, quaternion = file["body_pos_w"], file["body_quat_w"]
        velocity = file["body_lin_vel_w"]
    assert place.shape == (len(crouch), robot.model.njoints - 1, 3)
    hand = names.index("left_hand_link") if "left_hand_link" in names else len(names) - 1
    # Velocities are those of the places; w comes first.
    moved = np.gradient(place[:, hand], crouch.targets.dt, axis=0)[5:-5]
    assert velocity[5:-5, hand] == pytest.approx(moved, abs=0.02)
    assert quaternion[0, 0] == pytest.approx(crouch.q[0][[6, 3, 4, 5]], abs=1e-6)
    reader = pytest.importorskip("mcap.reader")
    with write_retargeted(crouch, tmp_path / "a.mcap").open("rb") as file:
        messages = list(reader.make_reader(file, validate_crcs=True).iter_messages())
    com = [json.loads(m.data) for _, channel, m in messages if channel.topic == "/com"]
    assert [com[-1][axis] for axis in "xyz"] == crouch.whole.com[-1].tolist()
    with pytest.raises(wbc.WbcError, match=r"written as \.csv"):
        crouch.save(tmp_path / "x.npz", "unitree")
    with pytest.raises(wbc.WbcError, match="unknown layout"):
        crouch.save(tmp_path / "x.npz", "mujoco")


def test_legs_without_ankle_roll_stand_on_lines() -> None:
    """As a Unitree H1's: flat feet left its CoM nowhere to go."""
    ankles = {"left_ankle_roll": 0.0, "right_ankle_roll": 0.0}
    found = wbc.retarget(crouching(inward=0.2), Robot.load("hoap2_like", locked=ankles))
    check_constraints(found)
    assert sum("cannot roll its sole" in note for note in found.notes) == 2
    assert not found.broken
    assert found.com_correlation[2] > 0.95


def test_legs_without_ankle_roll_stand_as_wide_as_the_hips() -> None:
    """With feet as near as a human's the legs lean inward, and the soles tilt with them."""
    ankles = {"left_ankle_roll_joint": 0.0, "right_ankle_roll_joint": 0.0}
    robot = Robot.load("g1", locked=ankles)
    found = wbc.retarget(crouching(1.0, inward=0.2), robot)
    left, right = (found.targets.feet.paths[side].origin[0, 1] for side in ("left", "right"))
    standing = robot.snapshot(robot.postures["standing"])
    own = np.subtract(*(standing.position(robot.feet[side].frame) for side in ("left", "right")))
    assert left - right == pytest.approx(own[1], abs=5e-3)  # 0.142 of 0.237 m before
    soles = [
        robot.snapshot(q).rotation(foot.frame) for q in found.q for foot in robot.feet.values()
    ]
    assert np.abs(np.array(soles)[:, 2, 1]).max() < np.radians(1.5)
    assert found.com_correlation[2] > 0.95


def test_only_fingers_are_fixed(hoap2: Robot) -> None:
    """As a Unitree H2 plus': 600 near pairs in every frame took minutes."""
    text, fingers = hoap2.path.read_text(), list[str]()
    for side in ("left", "right"):
        for k, x in enumerate((-0.01, 0.01)):
            for above, below, at in (("hand_link", "a", x), (f"finger_{k}_a", "b", 0.0)):
                name = f"{side}_finger_{k}_{below}"
                fingers.append(f"{name}_joint")
                part = (
                    f'<link name="{name}"><inertial><mass value="0.01"/><inertia ixx="1e-6" ixy="0"'
                    ' ixz="0" iyy="1e-6" iyz="0" izz="1e-6"/></inertial><collision><origin'
                    ' xyz="0 0 -0.02"/><geometry><sphere radius="0.008"/></geometry></collision>'
                    f'</link><joint name="{name}_joint" type="revolute"><parent'
                    f' link="{side}_{above}"/><child link="{name}"/><origin xyz="{at} 0 -0.03"/>'
                    '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="5"/>'
                    "</joint>"
                )
                text = text.replace("</robot>", f"{part}</robot>")
    gripping = Robot.load(text, base="floating")
    found = wbc.retarget(crouching(1.0), gripping)
    assert any(note.startswith("fingers are held as they stand, 8: ") for note in found.notes)
    moved = dict(zip(gripping.joint_names, np.ptp(found.q[:, 7:], axis=0), strict=True))
    assert {name for name, way in moved.items() if way == 0.0} == {*fingers}
    check_constraints(found)
    # With the same joints locked by the file's reader the motion is the same one.
    rigid = Robot.load(text, base="floating", locked=dict.fromkeys(fingers, 0.0))
    same = wbc.retarget(crouching(1.0), rigid)
    for name in rigid.joint_names:
        mine, theirs = (
            one.robot.limits.joint_positions(one.q)[:, one.robot.joint_names.index(name)]
            for one in (found, same)
        )
        np.testing.assert_allclose(mine, theirs, atol=1e-3)  # rad; standing is settled twice


def test_joints_without_ranges_bend_knees_forward(hoap2: Robot) -> None:
    """They gave warnings of NumPy, and knees bent backward."""
    text = re.sub(r'<limit lower="[^"]*" upper="[^"]*"', "<limit", hoap2.path.read_text())
    robot = Robot.load(text.replace('type="revolute"', 'type="continuous"'), base="floating")
    found = wbc.retarget(crouching(0.6), robot, self_collision=False)
    knees = [k for k, name in enumerate(robot.joint_names) if "knee" in name]
    assert (np.array([robot.limits.joint_positions(q)[knees] for q in found.q]) > 0.0).all()
    assert not found.broken


def test_robot_without_shapes_is_retargeted_with_a_note(hoap2: Robot, tmp_path: Path) -> None:
    text = hoap2.path.read_text()
    bare = re.sub(r"<collision>.*?</collision>", "", text, flags=re.DOTALL)
    soles = {
        side: {"link": f"{side}_foot", "polygon": foot.polygon, "height": 0.04}
        for side, foot in hoap2.feet.items()
    }
    found = wbc.retarget(crouching(1.0), Robot.load(bare, feet=soles, base="floating"))
    assert any("bodies are not kept apart" in note for note in found.notes)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["g1", "talos"])
def test_step_satisfies_constraints_and_follows_the_human(name: str) -> None:
    found = wbc.retarget(stepping(), Robot.load(name))
    check_constraints(found)
    left, right = found.contacts.T
    assert right.all() and 0.05 < (~left).mean() < 0.4
    path = found.targets.feet.paths["left"].place
    assert path[-1, 0] - path[0, 0] == pytest.approx(0.2 * found.scale.length, rel=0.35)
    assert found.com_correlation[1] > 0.95  # it goes sideways; ahead this human is not balanced
    assert found.angular_momentum_correlation.min() > 0.9
    # One foot bears alone for a while, and the CoP lies in its sole.
    assert not [one for one in found.unbalanced if one.what.startswith("CoP") and one.by > 0.01]


def test_balance_displaces_the_com_by_part_of_the_human_motion(crouch: wbc.Retargeted) -> None:
    """Of ever more sudden bends: at most a third of the human's standard deviation."""
    robot, targets = crouch.robot, crouch.targets
    for times in (1.0, 30.0, 300.0):
        found = balance_com(targets, robot, times * targets.angular_momentum)
        moved, human = found.com - targets.human_com, targets.human_com
        assert (moved[:, :2].std(axis=0) <= 0.3 * human[:, :2].std(axis=0) + 1e-9).all()
        each = [np.corrcoef(a, b)[0, 1] for a, b in zip(found.com.T, human.T, strict=True)]
        assert min(each) > 0.95
        np.testing.assert_array_equal(found.com[:, 2], targets.com[:, 2])


def test_motion_unlike_the_human_is_noted(crouch: wbc.Retargeted) -> None:
    """The human's motion, but with the CoM's vertical motion reversed."""
    human, k = crouch.targets.human_com, crouch.targets.angular_momentum
    momentum = np.hstack((crouch.whole.momentum[:, :3], k))
    same = replace(crouch, whole=replace(crouch.whole, com=human, momentum=momentum), reached=())
    assert dissimilarity_notes(same) == []
    other = replace(same, whole=replace(same.whole, com=human * [1.0, 1.0, -1.0]))
    (note,) = dissimilarity_notes(other)
    assert "CoM correlates by -1.00 along z" in note and "along x" not in note
    still = replace(crouch.targets, human_com=human * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.3])
    assert dissimilarity_notes(replace(same, targets=still)) == []  # it correlates by chance
    statue = replace(crouch.targets, angular_momentum=1e-9 * k[::-1])
    assert dissimilarity_notes(replace(same, targets=statue)) == []
    assert (
        f"moves by {1e3 * np.ptp(human[:, 2]):.0f} mm" in note
        and "momentum" not in note.split(";")[0]
    )
    turned = momentum * [1.0, 1.0, 1.0, -1.0, -1.0, -1.0]
    (note,) = dissimilarity_notes(replace(same, whole=replace(same.whole, momentum=turned)))
    assert "angular momentum correlates by -" in note and "CoM" not in note.split(";")[0]
    far = Reached("principal axis 1", 5.0, 12.0, 0.5, "deg")
    assert (
        "long axis is up to 12 degrees off, at 0.50 s"
        in dissimilarity_notes(replace(same, reached=(far,)))[0]
    )
    arm = Reached("left upper arm", 64.0, 121.0, 2.84, "deg")
    (note,) = dissimilarity_notes(replace(same, reached=(arm, replace(arm, largest=30.0))))
    assert note.count("left upper arm") == 1 and "up to 121 degrees off, at 2.84 s" in note


def test_interpolated_configurations_are_geodesic(hoap2: Robot) -> None:
    rng = np.random.default_rng(3)
    start = hoap2.postures["standing"]
    q = np.array([hoap2.integrate(start, 0.3 * rng.normal(size=hoap2.nv), 1.0) for _ in range(3)])
    found = interpolate(hoap2, q, np.array([0.0, 0.25, 1.0, 1.5, 2.0]))
    np.testing.assert_allclose(found[[0, 2, 4]], q, atol=1e-12)  # rounding
    model = hoap2.model
    for one, (a, b, part) in zip(found[[1, 3]], ((0, 1, 0.25), (1, 2, 0.5)), strict=True):
        np.testing.assert_allclose(one, pin.interpolate(model, q[a], q[b], part), atol=1e-9)


def test_body_map_of_g1_finds_trunk_and_arms() -> None:
    found = body_map(Robot.load("g1"))
    assert found.trunk == "waist_pitch_joint" and found.head is None
    assert found.arms["left"].forearm == "left_elbow_joint"
    assert any("no head" in note for note in found.notes)
    other = body_map(Robot.load("g1"), {"trunk": "torso_link"})
    assert other.trunk == "torso_link"


def test_arm_whose_last_joint_is_the_elbow_has_a_forearm(hoap2: Robot) -> None:
    held = Robot.load("hoap2_like", locked={"left_hand": 0.0, "right_hand": 0.0})
    found, whole = body_map(held).arms, body_map(hoap2).arms
    for side, arm in found.items():
        parts = arm.shoulder, arm.upper_arm, arm.forearm, arm.hand
        assert parts == (
            *(whole[side].shoulder, whole[side].upper_arm),
            *2 * (whole[side].forearm,),
        )
        # To the CoM of what the elbow carries, in place of where the hand is hinged.
        assert arm.forearm_axis @ whole[side].forearm_axis > np.cos(np.radians(10.0))


def test_bad_arguments_are_refused(hoap2: Robot) -> None:
    human = crouching(0.8)
    handstand, footless = replace(human, ground_height=2.0), Robot.load("hoap2_like", feet={})
    for mover, robot, options, words in (
        (human.motion, hoap2, {}, "expected a human's motion"),
        (human, hoap2, {"duration": "fast"}, "duration: expected 'froude'"),
        (human, hoap2, {"rate": 1.0}, "rate"),
        (human, hoap2, {"margin": 10.0}, "margin: 10 m between bodies"),
        (human, hoap2, {"links": {"left_paw": "left_hand"}}, "part of a body"),
        (human, hoap2, {"links": {"left_hand": "left_hand"}}, "name all of the left arm"),
        (human, footless, {}, "two feet"),
        (handstand, hoap2, {}, r"CoM is 1.* m below the ground"),
    ):
        with pytest.raises(wbc.WbcError, match=words):
            wbc.retarget(mover, robot, **options)
    with pytest.raises(wbc.WbcError, match="weights, com"):
        RetargetWeights(com=0.0)
