"""Parts of the search and the motion, one by one, by hand; starts by what a sample must be."""

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from wbc.constraints import ComSupport, Limits, Obstacles, PositionBox, SelfCollision, support
from wbc.constraints.margin import SKIN, USED
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.robot.collision import Obstacle
from wbc.shaping import GlobalShaping
from wbc.shaping.basin_hopping import BasinHopping
from wbc.shaping.evaluation import IPOPT_TOLERANCES, kept_constraints, violations
from wbc.shaping.motion import GuidingTasks, worst_violations
from wbc.shaping.nlp import BuiltNlp, build_nlp
from wbc.shaping.outcome import Candidate, ConstraintMargins
from wbc.shaping.problem import ShapingProblem, posture_cost
from wbc.shaping.separation import ActivePairs
from wbc.shaping.starts import Sampling, make_starts
from wbc.tasks import ComTask, InertiaTask, PostureTask

KEPT = ConstraintMargins(0.0, 1.0, None, None, ())


def candidate(q: np.ndarray, cost: float = 1.0, kept: ConstraintMargins = KEPT) -> Candidate:
    return Candidate(q, cost, {}, kept, "ok", True, 1, (0,))


def problem_of(robot: Robot, tasks, contacts=(), constraints=(), limits=None) -> ShapingProblem:
    limits = Limits(robot) if limits is None else limits
    return ShapingProblem(robot, tuple(tasks), tuple(contacts), limits, tuple(constraints))


# ---------------------------------------------------------------------- evaluation


def test_the_worst_of_several_constraints_of_a_kind_is_told(hoap2) -> None:
    """Two polygons and two boxes: distances from their edges and faces by hand."""
    here = hoap2.snapshot(hoap2.posture())
    (x, y, _), base = here.com, here.position("base")
    polygons = [
        ComSupport(
            hoap2, [[x - a, y - 1], [x + 1, y - 1], [x + 1, y + 1], [x - a, y + 1]], margin=m
        )
        for a, m in ((0.05, 0.01), (0.03, 0.005))
    ]
    boxes = [PositionBox(hoap2, "base", base - a, base + 1.0) for a in (0.2, 0.1)]
    problem = problem_of(hoap2, [PostureTask(hoap2, here.q)], (), [*polygons, *boxes])
    kept = kept_constraints(problem, here, IPOPT_TOLERANCES)
    assert kept.support == pytest.approx(0.025) and kept.clearance == pytest.approx(0.1)
    assert kept.broken == () and kept.contact == 0.0
    joints = hoap2.limits.joint_positions(here.q)
    inside = np.minimum(joints - hoap2.limits.lower, hoap2.limits.upper - joints)
    assert kept.limit == pytest.approx(inside.min())
    without = kept_constraints(problem_of(hoap2, problem.tasks), here, IPOPT_TOLERANCES)
    assert without.support is None and without.clearance is None


@pytest.mark.parametrize(("what", "allowed"), [
    ("contact", 1e-6), ("limit", 1e-7), ("support", 1e-7), ("clearance", 1e-6)])  # fmt: skip
def test_what_a_search_found_may_be_off_by_rounding_only(hoap2, what: str, allowed: float) -> None:
    """Just beyond its tolerance a posture is broken and says by what; just within it is not."""
    here = hoap2.snapshot(hoap2.posture())
    (x, y, _), base = here.com, here.position("base")
    assert getattr(IPOPT_TOLERANCES, what) == allowed
    for by, broken in ((0.9 * allowed, False), (1.1 * allowed, True)):
        contacts, constraints, limits = [], [], Limits(hoap2)
        if what == "contact":
            (held,) = support(here, "left")
            contacts = [type(held)(hoap2, held.frame, held.position + [0, 0, by], held.rotation)]
        elif what == "support":
            edge = x - 0.01 + by
            corners = [[edge, y - 1], [x + 1, y - 1], [x + 1, y + 1], [edge, y + 1]]
            constraints = [ComSupport(hoap2, corners, margin=0.01)]
        elif what == "clearance":
            constraints = [PositionBox(hoap2, "base", base + [0, 0, by], base + 1.0)]
        else:
            joints = hoap2.limits.joint_positions(here.q)
            span = np.minimum(joints - hoap2.limits.lower, hoap2.limits.upper - joints)
            limits = Limits(hoap2, margin=float(span.min()) + by)
        problem = problem_of(hoap2, [PostureTask(hoap2, here.q)], contacts, constraints, limits)
        kept = kept_constraints(problem, here, IPOPT_TOLERANCES)
        assert bool(kept.broken) is broken
        assert any(v == pytest.approx(by, rel=1e-3) for v in violations(problem, here).values())
        excused = IPOPT_TOLERANCES.excused_by(violations(problem, here))
        assert not kept_constraints(problem, here, excused).broken


def test_the_contact_that_is_farthest_off_counts(hoap2) -> None:
    here = hoap2.snapshot(hoap2.posture())
    moved = [
        type(one)(hoap2, one.frame, one.position + [0.0, by, 0.0], one.rotation)
        for one, by in zip(support(here, "double"), (0.003, 0.002), strict=True)
    ]
    kept = kept_constraints(
        problem_of(hoap2, [PostureTask(hoap2, here.q)], moved), here, IPOPT_TOLERANCES
    )
    assert kept.contact == pytest.approx(0.003)
    assert len(kept.broken) == 2 and kept.broken[1].startswith("right_sole is 0.002 off")


@pytest.mark.parametrize("axis", range(6))
def test_an_obstacle_that_moves_along_one_axis_is_refused(hoap2, axis: int) -> None:
    ball = Obstacle.sphere("ball", (1.0, 0.0, 0.0), 0.1)
    motion = np.zeros(6)
    motion[axis] = 0.1
    ball.velocity, ball.angular_velocity = motion[:3], motion[3:]
    problem = problem_of(hoap2, [PostureTask(hoap2, hoap2.posture())], (),
                         [Obstacles(hoap2, [ball])])  # fmt: skip
    with pytest.raises(InvalidInputError, match="'ball' moves"):
        build_nlp(problem)


def test_what_is_derived_is_not_searched_for_as_what_it_is_derived_from(hoap2) -> None:
    q = hoap2.posture()
    here = hoap2.snapshot(q)

    class Lower(ComTask):
        def residual(self, snapshot):
            found = super().residual(snapshot)
            return found._replace(error=found.error + [0.0, 0.0, 0.03])

    class Symbolic(Lower):
        def symbolic_error(self, posture):
            return super().symbolic_error(posture) + [0.0, 0.0, 0.03]

    class Named(ComTask):
        """No other than its parent."""

    class Smaller(PositionBox):
        def distances(self, snapshot, keys=None):
            return super().distances(snapshot, keys)

    with pytest.raises(InvalidInputError, match=r"'com' is a Lower, .* define symbolic_error\(\)"):
        GlobalShaping(hoap2, [Lower(hoap2, here.com)])
    box = Smaller(hoap2, "base", here.com - 1.0, here.com + 1.0)
    with pytest.raises(InvalidInputError, match=r"is a Smaller, .* define symbolic_rows\(\)"):
        GlobalShaping(hoap2, [Named(hoap2, here.com)], constraints=[box])
    rest = PostureTask(hoap2, q, weight=1e-3)
    best = GlobalShaping(hoap2, [Symbolic(hoap2, here.com), rest]).solve(q, 1, workers=1).best
    np.testing.assert_allclose(best.errors["com"], 0.0, atol=1e-3)


# ---------------------------------------------------------------------- keeping apart


@cache
def kept_apart(robot: Robot, fit: str) -> BuiltNlp:
    """In world axes: the base turns too."""
    watched = SelfCollision(robot, margin=0.01, fit=fit)
    return build_nlp(problem_of(robot, [InertiaTask(robot, np.eye(3))], (), [watched]))


def test_pairs_that_are_too_near_are_added_until_none_is_new(hoap2) -> None:
    """Which are too near by the constraint's own distances; of hulls the foremost corners."""
    q = hoap2.posture()
    for fit in ("capsule", "hull"):
        built = kept_apart(hoap2, fit)
        (watched,) = built.unknowns.problem.constraints
        pairs = ActivePairs(built.nlp.separation)
        start = built.start(q)
        assert not pairs.grow(start.x, start.p) and pairs.used == {}
        found = watched.model.measure(hoap2.snapshot(q), np.arange(len(watched.model.pairs)))
        kept = watched.margins + SKIN
        assert pairs.least(start.x, start.p) == pytest.approx((found.distance - kept).min())
        folded = q.copy()
        folded[7:] = hoap2.limits.lower
        bad = built.start(folded)
        found = watched.model.measure(hoap2.snapshot(folded), np.arange(len(watched.model.pairs)))
        near = np.flatnonzero(found.distance - kept < -USED)
        assert near.size and pairs.grow(bad.x, bad.p)
        assert sorted(pairs.used) == near.tolist()
        assert not pairs.grow(bad.x, bad.p), "the same posture needs nothing more"
        bodies = built.nlp.separation.bodies
        for k, corners in pairs.used.items():
            for body, chosen, sign in zip(bodies.pairs[k], corners, (-1.0, 1.0), strict=True):
                every = bodies.corners(int(body))
                if len(every) <= 8:
                    assert chosen == frozenset(range(len(every)))
                    continue
                R = hoap2.snapshot(folded).joint_placements[0][bodies.bodies[int(body)].joint]
                along = sign * (every @ R.T) @ found.normal[k]
                assert chosen == frozenset(np.flatnonzero(along >= along.max() - 0.005).tolist())
        # Planes lie half-way between the bodies, as seen from the base.
        planes = pairs.planes(bad.x, bad.p).reshape(-1, 4)
        here = hoap2.snapshot(folded)
        n = planes[:, :3] @ here.rotation("base").T
        np.testing.assert_allclose(n, found.normal[near], atol=1e-9)
        middle = found.point[near] - 0.5 * found.distance[near, None] * found.normal[near]
        offsets = np.einsum("ki,ki->k", n, middle - here.position("base"))
        np.testing.assert_allclose(planes[:, 3], offsets, atol=1e-9)


# ---------------------------------------------------------------------- the motion


@pytest.mark.parametrize("leans", [0.0099, 0.0101, None])
def test_guides_lead_along_the_straight_line_in_time(hoap2, leans: float | None) -> None:
    """Half way in half the time, by half the difference; at half the speed limits."""
    q = hoap2.posture()
    here = hoap2.snapshot(q)
    rng = np.random.default_rng(4)
    end = hoap2.integrate(q, 0.4 * rng.normal(size=hoap2.nv), 1.0)
    there = hoap2.snapshot(end)
    tasks = [InertiaTask(hoap2, np.eye(3), weight=2.0), ComTask(hoap2, here.com, weight=[1, 2, 5])]
    supports = [] if leans is None else [ComSupport.over(here)]
    limits = Limits(hoap2, velocity=0.2)
    problem = problem_of(hoap2, tasks, (), supports, limits)
    guide = GuidingTasks(problem, q, candidate(end, kept=replace(KEPT, support=leans)))
    names = [task.name for task in guide.tasks]
    assert names == ["guide: posture", "guide: base"] + ["guide: com"] * (leans is not None)
    way = hoap2.difference(q, end)
    # The smoothest way is at most 1.875 times as fast as the mean.
    slowest = (1.875 * np.abs(way[6:]) / (0.5 * limits.speed)).max()
    assert guide.duration == pytest.approx(np.clip(slowest, 2.0, 20.0))
    assert 2.0 < guide.duration < 20.0
    for time, part in ((0.0, 0.0), (0.5, 0.5), (1.0, 1.0), (7.0, 1.0)):
        guide.move_to(time * guide.duration)
        middle = hoap2.snapshot(hoap2.integrate(q, part * way, 1.0))
        np.testing.assert_allclose(guide.tasks[0].target, middle.q, atol=1e-12)
        np.testing.assert_allclose(guide.tasks[1].target[:3, 3], middle.position("base"))
        np.testing.assert_allclose(guide.tasks[1].target[:3, :3], middle.rotation("base"))
        if leans is not None:
            np.testing.assert_allclose(
                guide.tasks[2].target, here.com + part * (there.com - here.com)
            )
    assert len(guide.lasting) == (leans == 0.0099)
    for held in guide.lasting:  # a thousand times as stiff, in square, as anything after it
        stiffness = sum(
            (task.weight[:, None] * task.residual(there).jacobian).T
            @ (task.weight[:, None] * task.residual(there).jacobian)
            for task in tasks
        )
        expected = np.sqrt(1000.0 * np.linalg.eigvalsh(stiffness)[-1])
        np.testing.assert_allclose(held.weight, expected, rtol=1e-9)
        np.testing.assert_allclose(held.target, there.com)
        assert held.rows == ("x", "y")
    held = support(here, "left")
    anchored = GuidingTasks(problem_of(hoap2, tasks, held, (), limits), q, candidate(end))
    assert [task.name for task in anchored.tasks] == ["guide: posture"]
    # As quick as anything may be, and as slow.
    near = GuidingTasks(problem, q, candidate(hoap2.integrate(q, 1e-3 * way, 1.0)))
    assert near.duration == 2.0
    slow = problem_of(hoap2, tasks, (), (), Limits(hoap2, velocity=1e-3))
    assert GuidingTasks(slow, q, candidate(end)).duration == 20.0


def test_the_worst_of_a_motion_is_told(hoap2) -> None:
    """Clearance and support of the worst state, wherever it is in the motion."""
    q = hoap2.posture()
    here = hoap2.snapshot(q)
    base, (x, y, _) = here.position("base"), here.com
    box = PositionBox(hoap2, "base", base - 1.0, base + 1.0)
    square = [[x - 1, y - 1], [x + 1, y - 1], [x + 1, y + 1], [x - 1, y + 1]]
    balance = ComSupport(hoap2, square, margin=0.0)
    problem = problem_of(hoap2, [PostureTask(hoap2, q)], support(here, "left"), [box, balance])
    states = []
    for by in (0.1, 0.4, 0.2):
        moved = q.copy()
        moved[0] += by
        states.append(hoap2.snapshot(moved))
    kept, first = worst_violations(problem, states, 0.01)
    assert kept.clearance == pytest.approx(0.6) and kept.support == pytest.approx(0.6)
    assert kept.contact == pytest.approx(0.4)
    assert first.startswith("at 0.01 s: left_sole is 0.4 off its anchor")


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


@pytest.mark.parametrize("frame", ["world", "base"])
def test_a_whole_posture_turns_the_base_where_that_matters(hoap2: Robot, frame: str) -> None:
    built, q = built_for(hoap2, "floating", frame)
    hopping = BasinHopping(Sampling.of(built, q), 1.0, seed=1)
    places = [built.configuration(one, one.x) for one in (hopping.start(k, []) for k in (4, 8, 9))]
    turned = [not np.allclose(place[3:7], q[3:7], atol=1e-3) for place in places]
    assert turned == [frame == "world"] * 3
    assert len({round(float(place[3]), 6) for place in places}) == (3 if frame == "world" else 1)
