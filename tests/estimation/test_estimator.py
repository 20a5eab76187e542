"""The estimator on messages of a robot that stands, slips, and whose sensors fail."""

import copy
import pickle
import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.estimation import (
    Estimate,
    EstimatorSettings,
    ImuMount,
    ImuReading,
    JointVelocityFilter,
    Measurement,
    StateEstimator,
)
from wbc.estimation.estimate import count_notes
from wbc.robot import Robot
from wbc.rotations import exp_rotation, log_rotation, quaternion_from, rotation_from
from wbc.validate import Array

DT = 0.002
ALL = {"left": True, "right": True}
MOUNTS = (
    ImuMount("chest", "base", (0.02, 0.0, 0.1), exp_rotation(np.array((0.4, -0.2, 1.0)))),
    ImuMount("spare", "base", (-0.05, 0.03, 0.0)),
)
BIAS = np.array((0.01, -0.02, 0.015))


def messages(
    robot: Robot, count: int, rng: np.random.Generator, tilt: Array | None = None
) -> list[Measurement]:
    """Of a robot at rest, tilted by a rotation vector; its chest's gyroscope has a bias."""
    q = robot.posture()
    R = np.eye(3) if tilt is None else exp_rotation(tilt)
    found = []
    for k in range(count):
        imus = []
        for n, one in enumerate(MOUNTS):
            force = (R @ one.mount.rotation).T @ (0.0, 0.0, 9.81) + 1e-3 * rng.normal(size=3)
            rate = (BIAS if n == 0 else 0.0) + 1e-4 * rng.normal(size=3)
            imus.append(ImuReading(one.name, rate, force))
        found.append(Measurement(k * DT, q[7:].copy(), imus=tuple(imus), contacts=ALL))
    return found


@pytest.fixture
def sent(hoap2: Robot, rng: np.random.Generator) -> list[Measurement]:
    """900 messages of a robot at rest."""
    return messages(hoap2, 900, rng)


def fed(estimator: StateEstimator, sent: Iterable[Measurement]) -> Estimate:
    for one in sent:
        last = estimator.update(one)
    assert last is not None
    return last


def changed(m: Measurement, **values: object) -> Measurement:
    return Measurement(**{**m.__dict__, **values})  # type: ignore[arg-type]


def test_it_begins_from_standing_with_the_tilt_that_it_has(hoap2, rng: np.random.Generator) -> None:
    tilt = np.array((0.1, -0.15, 0.0))
    e = StateEstimator(hoap2, MOUNTS)
    sent = messages(hoap2, 600, rng, tilt)
    assert all(e.update(one) is None for one in sent[:250])
    found = fed(e, sent[250:])
    R = rotation_from(found.q[3:7])
    # Tilt by mean of 1e-3 m/s^2 noise; heading is 0 by definition: that of the base's x axis.
    assert np.allclose(R[2], exp_rotation(tilt)[2], atol=3e-4)
    assert abs(np.arctan2(R[1, 0], R[0, 0])) < 1e-3
    # Of the mean of both IMUs, of which only the first has one.
    assert np.allclose(found.gyroscope_bias, 0.5 * BIAS, atol=3e-4)
    assert np.linalg.norm(found.v) < 2e-3
    assert found.contacts == ("left", "right")
    # A bias of the accelerometer looks like a tilt: what is not known of one is said of the other.
    assert found.tilt_deviation == pytest.approx(2**0.5 * 0.05 / 9.81, rel=0.3)
    assert found.yaw_deviation < 0.05
    q = hoap2.posture()
    q[:3] += (1.0, 2.0, 3.0)
    e.reset(q)
    assert np.allclose(fed(e, sent).q[:3], q[:3], atol=2e-3)


NAMELESS = ImuReading("imu", (0, 0, 0), (0, 0, 9.81))
KEPT = {
    "another name": (
        {"imus": (NAMELESS,)},
        "no reading of IMU 'chest', those of the last message are: 'imu'",
    ),
    "no IMU": ({"imus": ()}, "those of the last message are: none"),
    "turning": (
        {"imus": (ImuReading("chest", (0, 0, 9.0), (0, 0, 9.81)),)},
        "has to stand still; IMU 'chest' says 9 rad/s",
    ),
    "one time": ({"time": 5.0}, "is of 5 s, and the one before it of 5 s"),
}


@pytest.mark.parametrize(("change", "said"), KEPT.values(), ids=KEPT)
def test_what_keeps_it_from_beginning_is_said_once(change, said: str, hoap2, sent, caplog) -> None:
    e = StateEstimator(hoap2, MOUNTS)
    for k in range(1100):
        m = changed(sent[0], **({"time": k * DT} | change))
        assert e.update(m) is None
    (warning,) = caplog.messages
    assert "1001 messages, and no estimate yet: " in warning and said in warning


def test_times_in_another_unit_are_said(hoap2: Robot, sent: list[Measurement], caplog) -> None:
    e = StateEstimator(hoap2, MOUNTS)
    fed(e, [changed(m, time=1e3 * m.time) for m in sent[:60]])
    assert "messages are 2 s apart, and dt is 0.002 s: are times in s?" in caplog.text
    e = StateEstimator(hoap2, MOUNTS)
    with pytest.raises(InvalidInputError, match="covariance; messages are 2000 s apart"):
        fed(e, [changed(sent[0], time=2000.0 * k) for k in range(600)])


def test_an_imu_that_says_gravity_downwards_is_refused(hoap2, sent: list[Measurement]) -> None:
    def turned(m: Measurement) -> Measurement:
        imus = [ImuReading(one.name, one.angular_velocity, -one.specific_force) for one in m.imus]
        return changed(m, imus=tuple(imus))

    e = StateEstimator(hoap2, MOUNTS)
    with pytest.raises(InvalidInputError, match="by IMU 'chest' the robot stands on its head"):
        fed(e, map(turned, sent))
    assert fed(e, [changed(m, time=m.time + 10.0) for m in sent]).q[2] > 0.2


def swaying(
    robot: Robot, count: int, mounts: tuple[ImuMount, ...], rng: np.random.Generator
) -> list[tuple[Array, ...]]:
    """Of a robot that sways over its ankles: joints, base's velocity, what IMUs at mounts feel.

    Means over each period by differences, exact to the second order of dt.
    """

    def pose(time: float) -> tuple[Array, Array, Array]:
        q = robot.posture()
        sway = 0.1 * np.sin(8.0 * time) ** 2 if time > 0.0 else 0.0
        q[[robot.joint_index(f"{side}_ankle_pitch") + 1 for side in ALL]] += sway
        q[:7] = np.eye(7)[6]
        s = robot.snapshot(q)
        foot = robot.feet["left"].frame
        R = s.rotation(foot).T
        return q[7:], R, -R @ s.position(foot)

    found = []
    for k in range(count):
        t, half = (k - 260) * DT, 0.5 * DT
        joints, R, p = pose(t)
        _, R_before, p_before = pose(t - DT)
        _, R_half, p_half = pose(t - half)
        readings = []
        for one in mounts:
            arm, own = one.mount.position, one.mount.rotation
            places = [p_before + R_before @ arm, p_half + R_half @ arm, p + R @ arm]
            pull = (places[2] - 2.0 * places[1] + places[0]) / half**2 + (0.0, 0.0, 9.81)
            turn = log_rotation(R_before.T @ R) / DT
            white = 1e-3 * rng.normal(size=6)
            readings.append(np.concatenate((own.T @ turn, own.T @ R_half.T @ pull)) + white)
        _, _, p_after = pose(t + 1e-5)
        found.append((joints, R.T @ (p_after - p) / 1e-5, *readings))
    return found


def test_a_gap_is_said_and_leaves_the_estimate_as_unsure_as_it_is(hoap2, sent) -> None:
    """By one reading the base was predicted over seconds, and as sure of it as before."""
    e = StateEstimator(hoap2, MOUNTS, dt=DT)
    before = fed(e, sent[:400])
    short, long = fed(e, sent[403:404]), fed(e, sent[409:410])
    assert not short.notes and short.velocity_deviation < 2.0 * before.velocity_deviation
    assert long.notes == ("IMU 'chest': nothing for 12 ms, for which one reading stands",)
    gone = 0.5  # s, in which a robot that walks steps elsewhere
    late = [changed(m, time=m.time + gone) for m in sent[410:]]
    found = fed(e, late[:1])
    assert "nothing for 502 ms" in found.notes[0] and not found.contacts
    assert 0.5 * gone < found.velocity_deviation < 10.0 * gone
    assert found.position_deviation > 0.05 * gone
    last = fed(e, late[1:])
    assert last.contacts == ("left", "right") and last.velocity_deviation < 0.02
    assert last.position_deviation > 0.05 * gone  # of where it is nobody tells any more


@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_an_imu_of_100_readings_a_second_has_no_gaps(hoap2, sent, start) -> None:
    """Two of three readings were a gap of 10 ms, by the rounding of times."""
    e = StateEstimator(hoap2, MOUNTS[0], dt=DT)
    for k, one in enumerate(sent):
        imus = () if k % 5 else one.imus
        found = e.update(changed(one, time=start + one.time, imus=imus))
        assert found is None or not found.notes


@pytest.mark.parametrize("every", [2, 5])
def test_a_slow_imu_makes_up_for_what_was_held_in_its_place(hoap2, rng, every) -> None:
    """At 250 readings a second the velocity was three times as far off, at 100 six times."""
    rows = swaying(hoap2, 900, MOUNTS[:1], rng)
    e, off = StateEstimator(hoap2, MOUNTS[0], dt=DT), []
    for k, (joints, v, _) in enumerate(rows):
        due = k >= every and k % every == 0
        felt = np.mean([row[2] for row in rows[k + 1 - every : k + 1]], axis=0) if due else None
        imus = () if felt is None else (ImuReading("chest", felt[:3], felt[3:]),)
        found = e.update(Measurement(k * DT, joints, imus=imus, contacts=ALL))
        if found is not None and due:
            off.append(np.linalg.norm(found.v[:3] - v))
    assert np.sqrt(np.mean(np.square(off))) < 1.3e-3 * every


def test_without_its_imu_an_estimate_is_less_sure(hoap2: Robot, sent: list[Measurement]) -> None:
    e = StateEstimator(hoap2, MOUNTS, dt=DT)
    before = fed(e, sent[:400])
    found = fed(e, [changed(m, imus=()) for m in sent[400:]])
    assert found.velocity_deviation > 10.0 * before.velocity_deviation
    assert np.linalg.norm(found.v[:3]) < 0.05  # feet still tell


@pytest.mark.parametrize(("dt", "said"), [(0.002, False), (0.01, True), (0.0005, True)])
def test_another_period_than_that_of_messages_is_said(dt, said, hoap2, sent, caplog) -> None:
    """Joint velocities are as old as messages are apart; `velocity_delay` said otherwise."""
    e = StateEstimator(hoap2, MOUNTS, dt=dt)
    fed(e, sent[:400])
    assert ("messages are 0.002 s apart" in caplog.text) == said


def test_feet_that_never_bear_are_said(hoap2: Robot, sent: list[Measurement]) -> None:
    """Loads in kN, or switches that are never pressed: the estimate drifted in silence."""
    e = StateEstimator(hoap2, MOUNTS, dt=DT)
    off = dict.fromkeys(ALL, False)
    found = [e.update(changed(m, contacts=off)) for m in sent]
    noted = [one.time for one in found if one is not None and "no foot has stood" in str(one.notes)]
    assert noted[0] == pytest.approx(1.5, abs=0.05) and noted[-1] == sent[-1].time
    again = copy.copy(e).update(changed(sent[1], time=sent[-1].time + DT, contacts=off))
    assert again is not None and "for 1 s: the IMU alone" in str(again.notes)


def test_a_clock_that_jumped_back_is_said_once(hoap2, sent: list[Measurement], caplog) -> None:
    e = StateEstimator(hoap2, MOUNTS, dt=DT)
    fed(e, sent[:400])
    fed(e, [changed(m, time=m.time - 5.0) for m in sent[400:600]])
    (said,) = caplog.messages
    assert "50 messages in a row are older than 0.798 s" in said and "reset() the estimator" in said
    fed(e, sent[400:])


def test_a_mount_in_mm_and_a_delay_in_ms_are_doubted(hoap2: Robot, caplog) -> None:
    """A robot that stood was 2.5 m off, and moved at 0.4 m/s, in silence."""
    settings = EstimatorSettings(encoder_delay=1.0)
    StateEstimator(hoap2, ImuMount("chest", "torso", position=(0.0, 0.0, 83.0)), settings)
    assert caplog.messages == [
        "estimator: IMU 'chest' is mounted 83 m from 'torso'; is its position in m?",
        "estimator: encoders are 1 s late (encoder_delay); is it in s?",
    ]


def test_a_mount_by_which_soles_stand_on_edge_is_doubted(hoap2, sent, caplog) -> None:
    told = replace(MOUNTS[0], rotation=np.eye(3))
    fed(StateEstimator(hoap2, told), sent[:300])
    assert caplog.messages == [
        "estimator: by IMU 'chest' a sole is tilted by 0.43 rad: is its mount on 'base' right?"
    ]


@pytest.mark.slow
def test_imus_of_one_link_are_one_in_their_middle(hoap2: Robot, rng: np.random.Generator) -> None:
    """Far apart they feel what the other does not; one that goes silent is done without."""
    mounts = (
        ImuMount("front", "base", (0.3, 0.0, 0.1), exp_rotation(np.array((0.4, -0.2, 1.0)))),
        ImuMount("back", "base", (-0.2, 0.1, 0.4)),
    )
    e, off, notes, names = StateEstimator(hoap2, mounts), [0.0], list[str](), ("front", "back")
    for k, (joints, speed, *said) in enumerate(swaying(hoap2, 700, mounts, rng)):
        imus = [ImuReading(n, one[:3], one[3:]) for n, one in zip(names, said, strict=True)]
        given = Measurement(k * DT, joints, imus=tuple(imus[: 2 if k < 550 else 1]), contacts=ALL)
        found = e.update(given)
        if found is not None:
            off.append(float(np.linalg.norm(found.v[:3] - speed)))
            notes += found.notes
    # The base moves at up to 0.25 m/s, and the places 0.4 m apart by 0.3 m/s more. What fell silent
    # is held for 10 ms, at half the weight.
    assert max(off[:300]) < 0.008
    assert max(off) < 0.02
    assert len(notes) == 1
    assert re.fullmatch(r"IMU 'back': silent for 1[02] ms; left out", notes[0])


def test_late_messages_are_filed_to_the_same_bits(hoap2: Robot, sent: list[Measurement]) -> None:
    sent = sent[:320]
    inorder, shuffled = StateEstimator(hoap2, MOUNTS), StateEstimator(hoap2, MOUNTS)
    expected = fed(inorder, sent)
    late = [*sent[:300], *sent[301:306], sent[300], *sent[306:]]
    found = [shuffled.update(one) for one in late]
    assert found[-1] is not None
    assert found[-1].q.tobytes() == expected.q.tobytes()
    assert found[-1].covariance.tobytes() == expected.covariance.tobytes()
    filed = found[305]
    assert filed is not None
    assert filed.time == sent[305].time
    assert "10.0 ms late; 5 were taken in again" in filed.notes[-1]
    for again, word in ((sent[319], "twice"), (sent[260], "dropped")):
        answer = shuffled.update(again)
        assert answer is not None
        assert word in answer.notes[-1]
        assert answer.q.tobytes() == expected.q.tobytes()


def test_a_foot_that_slips_by_two_centimetres_is_not_followed(hoap2, sent) -> None:
    """The left hip rolls; the base is still: in 60 ms the sole moves by 2 cm."""
    k = hoap2.joint_index("left_hip_roll") - 6
    J = hoap2.snapshot(hoap2.posture()).jacobian(hoap2.feet["left"].frame)
    angle = 0.02 / abs(J[1, 6 + k])
    for n in range(300, 450):
        positions = sent[n].positions.copy()
        positions[k] += angle * min((n - 299) / 30, 1.0)
        sent[n] = changed(sent[n], positions=positions)
    e = StateEstimator(hoap2, MOUNTS)
    before = fed(e, sent[:300])
    found = [fed(e, [one]) for one in sent[300:450]]
    notes = [note for one in found for note in one.notes]
    assert any("left foot" in note and "not counted on" in note for note in notes)
    off = np.array([one.q[:3] - before.q[:3] for one in found])
    speeds = [np.linalg.norm(one.v[:3]) for one in found]
    said = [one.position_deviation for one in found]
    # A tenth of the slip at most, and never more than 4 deviations that it said itself.
    assert np.abs(off).max() < 2e-3
    assert np.all(np.linalg.norm(off, axis=1) < 4.0 * np.array(said))
    assert max(speeds) < 0.05
    assert found[-1].contacts == ("left", "right")  # it is still again


def test_sensors_that_fail_are_named_and_done_without(hoap2, sent: list[Measurement]) -> None:
    good = fed(StateEstimator(hoap2, MOUNTS), sent[:400])

    def spoilt(change: Callable[[int, Measurement], Measurement]) -> tuple[Estimate, list[str]]:
        e = StateEstimator(hoap2, MOUNTS)
        fed(e, sent[:300])
        notes = list[str]()
        for n, one in enumerate(sent[300:400]):
            found = fed(e, [change(n, one)])
            notes += found.notes
        return found, notes

    def spike(n: int, m: Measurement) -> Measurement:
        wild = ImuReading("chest", np.full(3, 100.0), m.imus[0].specific_force)
        return changed(m, imus=(wild, m.imus[1])) if n == 20 else m

    def hung(n: int, m: Measurement) -> Measurement:
        return changed(m, imus=(sent[305].imus[0], m.imus[1])) if n > 5 else m

    def dead(n: int, m: Measurement) -> Measurement:
        return changed(m, imus=m.imus[1:]) if n > 5 else m

    def jumped(n: int, m: Measurement) -> Measurement:
        positions = m.positions.copy()
        positions[3] += 1.0
        return changed(m, positions=positions) if n == 30 else m

    for change, word in (
        (spike, "beyond its range"),
        (hung, "readings in a row are the same"),
        (dead, "'spare' takes over"),
        (jumped, "position jumped"),
    ):
        found, notes = spoilt(change)
        assert any(word in note for note in notes), (word, notes)
        assert np.allclose(found.q, good.q, atol=2e-3), word
        assert np.linalg.norm(found.v[:6]) < 0.02, word


def test_encoders_of_continuous_joints_begin_anew_after_a_turn(hoap2, rng, tmp_path) -> None:
    """At the wrap a joint was held for five messages, and turned at 900 rad/s."""
    text = Path(str(hoap2.path)).read_text()
    head = '<joint name="head_yaw" type='
    (tmp_path / "r.urdf").write_text(text.replace(head + '"revolute"', head + '"continuous"'))
    robot = Robot.load(tmp_path / "r.urdf")
    k = robot.joint_names.index("head_yaw")
    plain, wrapped = StateEstimator(robot, MOUNTS), StateEstimator(robot, MOUNTS)
    for n, one in enumerate(messages(hoap2, 500, rng)):
        joints = one.positions.copy()
        joints[k] = np.pi - 0.1 + max(0.001 * (n - 300), 0.0)
        expected = plain.update(changed(one, positions=joints.copy()))
        joints[k] = np.remainder(joints[k] + np.pi, 2.0 * np.pi) - np.pi
        found = wrapped.update(changed(one, positions=joints))
    assert found is not None and expected is not None and not found.notes
    np.testing.assert_allclose(found.q, expected.q, atol=1e-12)
    np.testing.assert_allclose(found.v, expected.v, atol=1e-9)
    assert found.v[6 + k] == pytest.approx(0.5)


def test_where_no_foot_is_still_the_slower_one_is_counted_on(hoap2, sent) -> None:
    # It hangs at rest, its soles' switches stuck: one leg swings, the other creeps.
    e = StateEstimator(hoap2, MOUNTS)
    fed(e, sent[:300])
    hips = [hoap2.joint_index(f"{side}_hip_pitch") - 6 for side in ALL]
    notes, speeds = list[str](), list[float]()
    for k, one in enumerate(sent[300:400], 1):
        joints = one.positions.copy()
        joints[hips] += k * DT * np.array((-8.0, 1.5))  # feet at 2.0 and 0.4 m/s
        found = fed(e, [changed(one, positions=joints)])
        notes += [note for note in found.notes if note.startswith("no foot is still")]
        speeds.append(float(np.linalg.norm(found.v[:3])))
    assert notes and all("right is counted on" in note for note in notes)
    assert max(speeds) < 0.6


def test_without_contacts_it_says_what_it_takes_for_granted(hoap2, sent: list[Measurement]) -> None:
    given = [changed(one, contacts=None) for one in sent[:300]]
    assert any("taken to bear" in note for note in fed(StateEstimator(hoap2, MOUNTS), given).notes)


def test_what_it_cannot_be_is_a_typed_error(hoap2: Robot) -> None:
    zeros, short = np.zeros(hoap2.nv - 6), EstimatorSettings(standing_time=0.01)
    one = ImuReading("imu", zeros[:3], zeros[:3])

    def begun_in_g() -> None:
        e = StateEstimator(hoap2, settings=short)
        for k in range(10):
            weight = ImuReading("imu", np.zeros(3), np.array((0.0, 0.0, 1.0 + 1e-6 * k)))
            e.update(Measurement(k * DT, zeros, imus=(weight,)))

    mistakes: list[tuple[Callable[[], object], str]] = [
        (lambda: Measurement(0.0, zeros * np.nan), "measurement, positions: NaN"),
        (lambda: ImuReading("imu", (0.0, np.inf, 0.0), zeros[:3]), "angular_velocity"),
        (lambda: Measurement(0.0, zeros, imus=(one,) * 2), r"two readings of one IMU \(imu, imu\)"),
        (
            lambda: StateEstimator(hoap2).update(Measurement(0.0, np.zeros(3))),
            "expected a Measurement of .* joints",
        ),
        (lambda: StateEstimator(hoap2, (ImuMount(), ImuMount())), "names must differ"),
        (lambda: StateEstimator(hoap2, ImuMount(frame="nowhere")), "nowhere"),
        # 1.3 TB of them.
        (lambda: StateEstimator(hoap2, dt=1e-9), r"standing_time: 0.* more than 50000 messages"),
        (lambda: EstimatorSettings(history=-1), "estimator, history"),
        (
            lambda: EstimatorSettings(noise={"creep": 1e-3}),  # type: ignore[arg-type]
            "estimator, noise: expected a FilterNoise",
        ),
        (begun_in_g, "are its units g"),
        (
            lambda: StateEstimator(Robot.load("hoap2_like", base="fixed")),
            "its base is bolted; a base is estimated from",
        ),
        (
            lambda: StateEstimator(hoap2, [ImuMount(f"imu {k}") for k in range(99)]),
            "imus: 99 of them; at most",
        ),
    ]
    for mistake, said in mistakes:
        with pytest.raises((InvalidInputError, UnknownNameError), match=said):
            mistake()


def test_joint_velocities_have_the_delay_and_the_noise_that_is_stated(rng) -> None:
    f = JointVelocityFilter(1, 5, DT)
    assert f.delay == pytest.approx(0.004)
    for k in range(10):  # a parabola of acceleration 3: its slope 4 ms ago
        t = k * DT
        found = f.update(t, np.array((1.5 * t * t,)))
    assert found[0] == pytest.approx(3.0 * (t - f.delay), rel=1e-9)
    noisy = JointVelocityFilter(2000, 5, DT)
    for k in range(5):
        white = noisy.update(k * DT, 1e-3 * rng.normal(size=2000))
    # 2000 samples: their deviation is known to 1 / 4000^(1/2), 1.6 %; here 4 of these.
    assert white.std() == pytest.approx(1e-3 * noisy.gain, rel=0.065)
    with pytest.raises(InvalidInputError, match="window"):
        JointVelocityFilter(1, 1)


def test_joint_velocities_do_not_depend_on_when_a_clock_began() -> None:
    """By seconds since 1970, as of ROS, a joint that stood at 2 rad moved at 0.24 rad/s."""
    f = JointVelocityFilter(1, 5, DT)
    for k in range(2000):
        assert abs(f.update(1.764e9 + k * DT, np.array((2.0,))).item()) < 1e-9


def pickled(estimator: StateEstimator) -> StateEstimator:
    return pickle.loads(pickle.dumps(estimator))


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickled])
@pytest.mark.parametrize("heard", [100, 400])
def test_a_copy_goes_on_to_the_same_bits(copied, heard: int, hoap2: Robot, sent) -> None:
    one = StateEstimator(hoap2, MOUNTS, dt=DT)
    for m in sent[:heard]:
        one.update(m)
    other = copied(one)
    for m in [*sent[heard:450], sent[445], *sent[450:]]:  # one of them late
        first, second = one.update(m), other.update(m)
    assert first is not None and second is not None
    assert first.q.tobytes() == second.q.tobytes() and first.notes == second.notes
    assert first.covariance.tobytes() == second.covariance.tobytes()


def test_it_shows_its_imus_and_how_far_it_is(hoap2: Robot, sent: list[Measurement]) -> None:
    estimator = StateEstimator(hoap2, MOUNTS)
    assert repr(estimator) == "StateEstimator('hoap2_like', chest, spare, standing to begin)"
    fed(estimator, sent[:300])
    assert repr(estimator) == "StateEstimator('hoap2_like', chest, spare, t=0.598 s)"


def test_measured_forces_of_feet_tell_which_bear(hoap2: Robot, sent: list[Measurement]) -> None:
    half = 0.5 * hoap2.weight
    for right, stands in ((half, True), (0.0, False)):
        forces = {"left": 2.0 * half - right, "right": right}
        given = [changed(m, contacts=None, forces=forces) for m in sent[:400]]
        found = fed(StateEstimator(hoap2, MOUNTS), given)
        assert ("right" in found.contacts) == stands and "left" in found.contacts


@pytest.mark.parametrize("given", [{"nose": 1.0}, {"left": 1.0}, {"left": 1, "right": 1, "t": 1}])
def test_loads_of_other_feet_than_the_robot_has_are_refused(hoap2, sent, given) -> None:
    """A foot that is not named was one that does not bear, and a misspelt one nothing at all."""
    message = sent[0]
    pressed = {name: bool(load) for name, load in given.items()}
    for loads in ({"contacts": pressed}, {"contacts": None, "forces": given}):
        with pytest.raises(InvalidInputError, match="one for each of the feet left, right"):
            StateEstimator(hoap2, MOUNTS).update(changed(message, **loads))
    with pytest.raises(InvalidInputError, match="measurement, contacts, left: expected True"):
        changed(message, contacts={"left": "no", "right": "yes"})


def test_a_message_that_is_refused_is_not_taken_in_again(hoap2, sent: list[Measurement]) -> None:
    """It was filed before it was refused: messages that came late after it were refused as well.

    One that came late itself took those after it along.
    """
    plain, tried = StateEstimator(hoap2, MOUNTS), StateEstimator(hoap2, MOUNTS)
    expected = fed(plain, sent[:306])
    fed(tried, [*sent[:301], sent[302]])
    for refused in (sent[303], sent[301]):
        with pytest.raises(InvalidInputError, match="one for each of the feet"):
            tried.update(changed(refused, contacts={"left": True}))
    found = fed(tried, [*sent[303:305], sent[301], sent[305]])
    assert found.q.tobytes() == expected.q.tobytes()


def test_notes_are_counted_without_their_numbers_but_by_names_with_theirs() -> None:
    """Which of ``LLEG_JOINT0`` to ``5`` had jumped was not told."""
    told, held = dict[str, int](), "position jumped; held"
    for joint, ms in ((0, 12.5), (1, 3), (0, 40)):
        count_notes(told, [f"joint LEG_{joint}: {held}", f"IMU 'imu2': silent for {ms} ms"])
    assert told == {
        f"joint LEG_0: {held}": 2,
        f"joint LEG_1: {held}": 1,
        "IMU 'imu2': silent for # ms": 3,
    }


def test_a_base_whose_x_axis_points_up_has_the_heading_that_is_told(rng) -> None:
    """The heading of that axis is noise: the estimate of a biped began 22 degrees off."""
    robot = Robot.load(
        '<mujoco model="stool"><worldbody><body name="trunk" quat="0.5 -0.5 -0.5 -0.5"><freejoint/>'
        '<geom type="box" size=".1 .1 .1" mass="5"/><body name="left_foot" pos="-.3 -.1 0">'
        '<joint axis="0 1 0" range="-1 1"/><geom type="box" size=".01 .05 .1" mass="1"/></body>'
        '<body name="right_foot" pos="-.3 .1 0"><joint name="other" axis="0 1 0" range="-1 1"/>'
        '<geom type="box" size=".01 .05 .1" mass="1"/></body></body></worldbody></mujoco>'
    )
    q = robot.posture()
    q[3:7] = quaternion_from(exp_rotation(np.array((0.0, 0.0, 0.7))) @ rotation_from(q[3:7]))
    R = rotation_from(q[3:7])
    estimator, estimate = StateEstimator(robot), None
    estimator.reset(q)
    for k in range(260):
        imu = ImuReading("imu", 1e-4 * rng.normal(size=3), R.T @ (0.1, 0.2, 9.8))
        estimate = estimator.update(Measurement(k * DT, q[7:], imus=(imu,), contacts=ALL))
    assert R[2, 0] > 0.99 and estimate is not None
    assert np.abs(log_rotation(rotation_from(estimate.q[3:7]) @ R.T)).max() < 0.03
