"""Where searches begin: samples that fill what is allowed, and hops that are what they are called.

Judged by what a sample must be (its range, its spread, its place on the contacts by Pinocchio), not
by the sequence that it comes from.
"""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from wbc.constraints import Limits, support
from wbc.robot import Robot
from wbc.shaping.basin_hopping import BasinHopping
from wbc.shaping.nlp import BuiltNlp, build_nlp
from wbc.shaping.outcome import Candidate, ConstraintMargins
from wbc.shaping.problem import ShapingProblem, posture_cost
from wbc.shaping.starts import Sampling, make_starts, uniform_rotation
from wbc.tasks import InertiaTask


def built_for(robot: Robot, mode: str, frame: str = "world") -> tuple[BuiltNlp, np.ndarray]:
    q = robot.posture()
    here = robot.snapshot(q)
    task = InertiaTask(robot, np.diag(np.diag(here.inertia_in("base")) * [0.6, 0.5, 0.6]),
                       frame=frame, per_mass=True)  # fmt: skip
    contacts = support(here, mode)
    return build_nlp(ShapingProblem(robot, (task,), contacts, Limits(robot), ())), q


def joints_of(built: BuiltNlp, start) -> np.ndarray:
    q = built.configuration(start, start.x)
    return built.unknowns.problem.robot.limits.joint_positions(q)


def test_samples_fill_the_ranges_and_the_rotations_evenly(hoap2: Robot) -> None:
    """8 are drawn for each start; the cheapest left and the next drawn are taken by turns."""
    built, q = built_for(hoap2, "floating")
    problem = built.unknowns.problem
    sampling = Sampling.of(built, q)
    few = make_starts(sampling, 9, seed=3)
    assert (few.drawn, len(few.starts), few.unclosed) == (64, 9, ())
    every = make_starts(sampling, 65, seed=3)
    assert every.drawn == 8 * 64 and len(every.starts) == 65
    np.testing.assert_allclose(
        built.configuration(every.starts[0], every.starts[0].x), q, atol=1e-9
    )
    places = [built.configuration(one, one.x) for one in every.starts[1:]]
    joints = np.array([hoap2.limits.joint_positions(place) for place in places])
    lower, upper = hoap2.limits.lower, hoap2.limits.upper
    assert (joints >= lower).all() and (joints <= upper).all()
    parts = (joints - lower) / (upper - lower)
    assert min(kstest(column, "uniform").pvalue for column in parts.T) > 1e-4
    turns = np.array([place[3:7] for place in places])  # uniform: each component has 1/4 in square
    np.testing.assert_allclose(np.square(turns).mean(axis=0), 0.25, atol=0.12)
    np.testing.assert_array_equal([place[:3] for place in places], np.tile(q[:3], (64, 1)))
    # The factor on the cost makes a middling sample's 1; it is what parameters end with.
    costs = np.array([posture_cost(problem.tasks, hoap2.snapshot(place)) for place in places])
    assert 0.3 < np.median(costs) * every.scale < 3.0
    for one in every.starts[:3]:
        scaled = float(built.nlp.functions(one.x, one.p)[0])
        place = hoap2.snapshot(built.configuration(one, one.x))
        assert scaled == pytest.approx(every.scale * posture_cost(problem.tasks, place), rel=1e-9)
    picked = np.array([float(built.nlp.functions(one.x, one.p)[0]) for one in few.starts[1:]])
    assert picked[0] < picked[2] < picked[4] < picked[6], "every other one is the cheapest left"
    assert picked[0] == picked.min() and not (np.diff(picked[1::2]) > 0).all()
    again, other = make_starts(sampling, 9, seed=3), make_starts(sampling, 9, seed=4)
    assert all((a.x == b.x).all() for a, b in zip(few.starts, again.starts, strict=True))
    assert not (few.starts[1].x == other.starts[1].x).all()
    alone = make_starts(sampling, 1, seed=3)
    assert (alone.drawn, len(alone.starts)) == (0, 1)


def test_joints_alone_are_drawn_where_the_base_does_not_matter(hoap2: Robot) -> None:
    built, q = built_for(hoap2, "floating", "base")
    assert not built.turns_base
    for one in make_starts(Sampling.of(built, q), 4, seed=1).starts:
        np.testing.assert_array_equal(built.configuration(one, one.x)[:7], q[:7])


def test_samples_are_put_on_their_contacts(hoap2: Robot) -> None:
    """By Pinocchio: within 1 mm and 1 mrad of both anchors, and within the limits."""
    built, q = built_for(hoap2, "double")
    sampling = Sampling.of(built, q)
    found = make_starts(sampling, 9, seed=5)
    assert found.drawn == 3 * 8
    assert len(found.starts) == min(9, 1 + 24 - len(found.unclosed))
    assert all(gap > 1e-3 for gap in found.unclosed)
    data = hoap2.model.createData()
    for one in found.starts:
        assert (one.x >= built.nlp.lower).all() and (one.x <= built.nlp.upper).all()
        pin.framesForwardKinematics(hoap2.model, data, built.configuration(one, one.x))
        for contact in built.unknowns.problem.contacts:
            pose = data.oMf[hoap2.frame_id(contact.frame)]
            np.testing.assert_allclose(pose.translation, contact.position, atol=1e-3)
            turn = Rotation.from_matrix(pose.rotation @ contact.rotation.T)
            assert turn.magnitude() < 2e-3
    # The gap that is told is that of the start that is returned.
    rng = np.random.default_rng(2)
    assert sampling.projection is not None
    for _ in range(3):
        wild = sampling.posture(rng.uniform(sampling.lower, sampling.upper), q[:7])
        projected, gap = sampling.start(wild)
        rows = np.array(built.nlp.functions(projected.x, projected.p)[1]).ravel()
        assert gap == pytest.approx(np.abs(rows[: built.nlp.closures]).max(), rel=1e-9)


def elite_of(robot: Robot, rng: np.random.Generator, count: int) -> list[Candidate]:
    lower, upper = robot.limits.lower, robot.limits.upper
    found = []
    for number in range(count):
        q = robot.posture()
        q[7:] = rng.uniform(lower, upper)
        q[:3] = rng.normal(size=3)
        found.append(
            Candidate(q, 1.0, {}, ConstraintMargins(0, 1, None, None, ()), "ok", True, 1, (number,))
        )
    return found


def test_hops_mix_two_resample_some_or_draw_a_whole_posture(hoap2: Robot, rng) -> None:
    """Which of the three a start is, is seen in its joints; shares as documented, of 240 hops."""
    built, q = built_for(hoap2, "floating")
    sampling = Sampling.of(built, q)
    hopping = BasinHopping(sampling, 0.5, seed=7)
    elite = elite_of(hoap2, rng, 3)
    theirs = np.array([one.q[7:] for one in elite])
    n = theirs.shape[1]
    kinds, resampled, fresh = [], [], []
    for number in range(240):
        start = hopping.start(number, elite)
        assert start.p[-built.unknowns.x.numel() - 1] == 0.5
        joints = joints_of(built, start)
        assert (joints >= sampling.lower).all() and (joints <= sampling.upper).all()
        same = np.abs(theirs - joints) < 1e-12  # (3, n)
        counts = np.sort(same.sum(axis=1))
        place = built.configuration(start, start.x)
        if same.any(axis=0).all() and counts[2] < n:
            kinds.append("mixed")
            assert counts[0] == 0 and counts[1] >= 2, "of two, and some of each"
        elif counts[2] > n / 2:
            kinds.append("resampled")
            resampled.append(n - counts[2])
            fresh.append(((joints - sampling.lower) / (sampling.upper - sampling.lower))[
                ~same[same.sum(axis=1).argmax()]])  # fmt: skip
        else:
            kinds.append("whole")
            assert counts[2] == 0
            np.testing.assert_array_equal(place[:3], q[:3])
            continue
        first = [one.q[:7] for one in elite if np.allclose(one.q[:3], place[:3], atol=1e-12)]
        assert len(first) == 1, "the base is that of the posture that is changed"
    assert [kinds[k] == "whole" for k in range(240)] == [k % 4 == 0 for k in range(240)]
    # 180 hops, 3 of 4 of them mixtures: 135 +- 5.8; five of these deviations.
    assert kinds.count("mixed") == pytest.approx(135, abs=29)
    assert min(resampled) == 1 and max(resampled) == round(0.4 * n)
    drawn = np.concatenate(fresh)
    assert kstest(drawn, "uniform").pvalue > 1e-4
    assert all(kind == "resampled" for kind in _kinds_of_one(hopping, built, elite[0]))


def _kinds_of_one(hopping: BasinHopping, built: BuiltNlp, only: Candidate) -> list[str]:
    """With one good posture there is nothing to mix."""
    found = []
    for number in (1, 2, 3, 5, 6, 7):
        same = np.abs(joints_of(built, hopping.start(number, [only])) - only.q[7:]) < 1e-12
        found.append("resampled" if 0.5 < same.mean() < 1.0 else "other")
    return found


def test_hops_depend_on_number_seed_and_elite_alone(hoap2: Robot, rng) -> None:
    built, q = built_for(hoap2, "floating")
    sampling, elite = Sampling.of(built, q), elite_of(hoap2, rng, 2)
    one, same, other = (BasinHopping(sampling, 1.0, seed) for seed in (7, 7, 8))
    one.start(11, elite)  # what was asked before does not matter
    for number in (4, 5, 6):
        np.testing.assert_array_equal(one.start(number, elite).x, same.start(number, elite).x)
        assert not np.array_equal(one.start(number, elite).x, other.start(number, elite).x)
    whole = joints_of(built, one.start(5, []))  # nothing good yet
    assert not (np.abs(whole - elite[0].q[7:]) < 1e-12).any()


def test_random_rotations_are_uniform() -> None:
    """Oracle: the angle of a uniform rotation has the distribution (a - sin a) / pi."""
    rng = np.random.default_rng(0)
    turns = [uniform_rotation(rng.random(3)) for _ in range(2000)]
    angles = np.array([turn.magnitude() for turn in turns])
    assert kstest(angles, lambda a: (a - np.sin(a)) / np.pi).pvalue > 1e-3
    mean = np.mean([turn.as_matrix() for turn in turns], axis=0)
    np.testing.assert_allclose(mean, 0.0, atol=0.07)  # 1 / sqrt(3 * 2000) = 0.013, five of these


@pytest.mark.parametrize("frame", ["world", "base"])
def test_a_whole_posture_turns_the_base_where_that_matters(hoap2: Robot, frame: str) -> None:
    built, q = built_for(hoap2, "floating", frame)
    hopping = BasinHopping(Sampling.of(built, q), 1.0, seed=1)
    places = [built.configuration(one, one.x) for one in (hopping.start(k, []) for k in (4, 8, 9))]
    turned = [not np.allclose(place[3:7], q[3:7], atol=1e-3) for place in places]
    assert turned == [frame == "world"] * 3
    assert len({round(float(place[3]), 6) for place in places}) == (3 if frame == "world" else 1)
