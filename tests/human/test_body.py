"""The body against Pinocchio, the published table and finite differences."""

import numpy as np
import pytest

from tests.human.walker import marching
from wbc.errors import InvalidInputError
from wbc.human.anthropometry import DE_LEVA, segment_table
from wbc.human.body import NAMES, SEGMENT_NAMES, HumanBody, masses
from wbc.human.fit import MarkerSet
from wbc.human.kinematics import DOFS, dimension_jacobian, forward_kinematics, point_jacobian
from wbc.human.landmarks import landmark, landmark_of, landmarks_of
from wbc.human.skeleton import configurations, human_robot

BODY = HumanBody.of(1.80, 80.0, "male")


def test_forward_kinematics_is_that_of_pinocchio() -> None:
    _, poses = marching(0.3)
    robot = human_robot(BODY)
    q, placed = configurations(robot, poses), forward_kinematics(poses, BODY.dimensions)
    for frame in (0, 17):
        state = robot.snapshot(q[frame])
        for k, name in enumerate(SEGMENT_NAMES):  # rounding
            np.testing.assert_allclose(state.position(name), placed.origin[frame, k], atol=1e-12)
            np.testing.assert_allclose(state.rotation(name), placed.rotation[frame, k], atol=1e-12)


@pytest.mark.parametrize("sex", ["female", "male"])
def test_segment_masses_are_those_of_the_table(sex: str) -> None:
    body = HumanBody.of(1.7, 70.0, sex)
    assert human_robot(body).mass == pytest.approx(70.0, rel=1e-12)
    rows, found = DE_LEVA[sex], masses(body)
    trunk = sum(rows[part].mass for part in ("upper_trunk", "middle_trunk", "lower_trunk"))
    assert found["trunk"].mass + found["pelvis"].mass == pytest.approx(70.0 * trunk, rel=2e-4)
    thigh = found["left_thigh"]  # about its own end: m (r^2 + c^2) L^2, as the paper has it
    length, row = body.size("thigh"), segment_table(sex)["thigh"]
    about_hip = thigh.inertia[1, 1] + thigh.mass * thigh.centre[2] ** 2
    expected = 70.0 * row.mass * length**2 * (row.radii[1] ** 2 + row.centre**2)
    assert about_hip == pytest.approx(expected, rel=1e-12)
    # As far behind the line from the joint up to C7 as Dumas et al. (2007) have it, by its length.
    neck = np.array((body.size("neck_x"), 0.0, body.size("neck_z")))
    line = neck / np.linalg.norm(neck)
    off = found["trunk"].centre - line * (line @ found["trunk"].centre)
    behind = {"female": 0.016, "male": 0.036}[sex] * np.linalg.norm(neck)
    assert off[0] == pytest.approx(-behind, rel=1e-3) and off[1] == 0.0
    for part in found.values():  # inertias of real bodies
        moments = np.linalg.eigvalsh(part.inertia)
        assert 0.0 < moments[2] < moments[0] + moments[1]


def test_jacobians_are_those_of_differences() -> None:
    _, poses = marching(0.05)
    poses = poses[np.array([2])]
    marks = tuple(landmark(str(landmark_of(n))) for n in ("LASI", "RWRA", "LTOE", "C7", "RKNE"))
    markers = MarkerSet(tuple("abcde"), marks, np.array([m.place for m in marks]), BODY.dimensions)
    placed = forward_kinematics(poses, BODY.dimensions)
    J = point_jacobian(placed, markers.segments, markers.positions(placed))[0]
    h = 1e-6  # central differences: errors of h^2 = 1e-12 and of rounding, 1e-10
    for k in range(DOFS):
        step = np.zeros((1, DOFS))
        step[0, k] = h
        ahead, behind = (
            markers.positions(forward_kinematics(poses.step(s * step), BODY.dimensions))[0]
            for s in (1, -1)
        )
        np.testing.assert_allclose(J[:, :, k], (ahead - behind) / (2 * h), atol=1e-8)
    D = dimension_jacobian(placed, markers.anchors)[0]
    for k in range(len(NAMES)):
        size = BODY.dimensions.copy()
        size[k] += 1.0  # linear
        moved = markers.positions(forward_kinematics(poses, size))[0] - markers.positions(placed)[0]
        np.testing.assert_allclose(D[:, :, k], moved, atol=1e-12)


def test_impossible_bodies_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="sex: expected female or male"):
        HumanBody.of(1.7, 70.0, "human")
    with pytest.raises(InvalidInputError, match="mass"):
        HumanBody.of(1.7, -1.0, "male")


LABELLED = (
    "R.ASIS right_asis Subject:LASI left_asis r_mknee_study right_knee_medial knee_r_lat"
    " right_knee_lateral LMED left_ankle_medial SACR sacrum R.Wrist.Med right_wrist_ulnar LFLE"
    " left_knee_lateral RLEK right_knee_lateral LSHA left_shank THEAD head_top LKNEin"
    " left_knee_medial RKNE_med right_knee_medial L_ANKLE_LATERAL left_ankle_lateral LTHI4"
    " left_thigh R_LEG_2 right_shank foot_l1 left_foot LHE_L left_elbow_lateral RHEL right_heel"
    " LASI2 None L5 spine_low R.HeelGround None RPower None R.Thigh.Top.Lateral right_thigh"
    " L.MidShank left_shank R_HEEL_UP right_heel RightFifthMet right_metatarsal_5 R1MTH"
    " right_metatarsal_1 RLatMal right_ankle_lateral RMA right_ankle_medial RSH right_acromion RSH2"
    " right_shank LUpperLeg1 left_thigh L.LowerArm.Top left_forearm RUpperArm3 right_upper_arm"
    " SIASr right_asis R.SIPS right_psis l_thigh_cl1 left_thigh r_mall_med right_ankle_medial RANKL"
    " right_ankle_lateral R_2ndMet right_toe L_GREAT_TROCH left_trochanter RFT3 right_foot"
    " R5thMetatarsal right_metatarsal_5 RGreaterTrochanter right_trochanter RxAsis right_asis"
    " LxLatCon left_knee_lateral Psis sacrum LMFH5 left_metatarsal_5 RMFH1 right_metatarsal_1"
    " LHMH2 left_hand RSPH right_ankle_medial LATT left_tibial_tuberosity RTT2 right_toe"
)


def test_labels_are_identified_as_their_landmarks() -> None:
    words = LABELLED.split()
    assert [str(landmark_of(label)) for label in words[::2]] == words[1::2]


def test_what_most_labels_begin_with_is_left_out() -> None:
    plain = ("LASI", "RASI", "SACR", "L_KNEE", "R_KNEE", "C7")
    found = landmarks_of(plain)
    named = landmarks_of([f"P01_walk_{label}" for label in plain] + ["*12"])
    assert found == {label.removeprefix("P01_walk_"): name for label, name in named.items()}
    sides = [f"R_{label}" for label in ("ASIS", "PSIS", "KNEE")]
    assert landmarks_of(sides) == {label: landmark_of(label) for label in sides}
