"""The QP in which only physics is hard: its cost, minimised over slacks, written out by hand."""

import numpy as np
import pytest

from wbc.constraints import FrictionCone, Limits, SelfCollision, support
from wbc.constraints.contact import Contact
from wbc.constraints.mechanics import BoltedBase
from wbc.constraints.rows import Bounds
from wbc.controllers import TorqueController, relaxation
from wbc.controllers.plan import Decision, LevelPlan
from wbc.controllers.relaxation import Physical, relaxed_amounts, relaxed_qp
from wbc.controllers.slack import Slacks
from wbc.laws import Rows
from wbc.qp import QP
from wbc.qp.problem import Labels
from wbc.robot import Robot
from wbc.tasks import DampingTask, InertiaTask, OrientationTask, PositionTask, PostureTask

FORCES = 4


def rows_of(rng: np.random.Generator, k: int, n: int) -> Rows:
    return Rows(rng.normal(size=(k, n)), rng.normal(size=k), rng.uniform(0.5, 3.0, k))


def qp_of(plan: LevelPlan, tasks, equalities, rows: Bounds | None, box, rest) -> QP:
    """Return the QP of some rows, written out; rest is where x is damped to."""
    decision = plan.decision

    def wide(matrix: np.ndarray) -> np.ndarray:
        return np.hstack((matrix, np.zeros((len(matrix), decision.size - matrix.shape[1]))))

    P, g = np.diag(decision.damping), -decision.damping * rest
    for row in tasks:
        J = wide(row.weight[:, None] * row.matrix)
        P, g = P + J.T @ J, g - (row.weight * row.target) @ J
    given = {} if rows is None else {"C": rows.matrix, "l": rows.lower, "u": rows.upper}
    names = () if rows is None else rows.labels
    qp = QP.build(
        P, g, **given,
        A=np.vstack([np.zeros((0, decision.size)), *(wide(row.matrix) for row in equalities)]),
        b=np.concatenate([np.zeros(0), *(row.target for row in equalities)]),
        lower=np.concatenate((box[0], np.zeros(decision.size - decision.nv))),  # of forces
        upper=np.concatenate((box[1], np.full(decision.size - decision.nv, np.inf))),
    )  # fmt: skip
    return qp._replace(labels=Labels(plan.labels[0].equality, names, decision.names))


def outside(values: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    return np.maximum(values - upper, 0.0) + np.maximum(lower - values, 0.0)


def least_cost(qp: QP, x: np.ndarray) -> float:
    """Return the QP's cost at x, its slacks as small as its rows let them be."""
    slack = np.zeros(qp.g.size - x.size)
    for k in range(slack.size):
        (row,) = np.flatnonzero(qp.C[:, x.size + k])
        value = qp.C[row, : x.size] @ x
        slack[k] = value - np.clip(value, qp.l[row], qp.u[row])
    full = np.concatenate((x, slack))
    assert (qp.C @ full <= qp.u + 1e-9).all() and (qp.C @ full >= qp.l - 1e-9).all()
    return float(0.5 * full @ qp.P @ full + qp.g @ full)


@pytest.mark.parametrize("bounded", [True, False])
def test_costs_are_those_declared(hoap2: Robot, rng, bounded: bool) -> None:
    """Tasks, contacts, limits and margins at one weight; gears, bolts and physics stay hard."""
    here = hoap2.snapshot(hoap2.posture())
    nv = hoap2.nv
    n = nv + FORCES
    contacts = [BoltedBase(hoap2), Contact.hold(here, "left_sole")]
    damping = rng.uniform(1.0, 2.0, nv)
    decision = Decision.velocity(hoap2, damping).extended(
        [f"force {k}" for k in range(FORCES)], np.full(FORCES, 0.5)
    )
    physics_names = tuple(f"dynamics {k}" for k in range(6))
    plan = LevelPlan.of(decision, [PostureTask(hoap2, here.q)], contacts, Slacks({}, contacts, ()),
                   physics_names)  # fmt: skip
    tasks = [rows_of(rng, 5, nv), rows_of(rng, 3, n)]
    held = [rows_of(rng, 6, nv), rows_of(rng, 6, nv)]
    equalities = rows_of(rng, 6, n)
    ends = np.array([-np.inf, 0.5]), np.ones(2)  # the second must bear something
    cone = Bounds(("cone a", "cone b"), rng.normal(size=(2, n)), *ends)
    rest = rng.normal(size=n)
    own_slack = np.array([0.3, np.inf])
    margins = [
        Bounds(("m a", "m b"), rng.normal(size=(2, nv)), np.full(2, -0.1), np.full(2, np.inf)),
        Bounds(("m c", "m d"), rng.normal(size=(2, nv)), np.full(2, -np.inf), np.full(2, 0.2),
               slack=own_slack),
        Bounds((), np.zeros((0, nv)), np.zeros(0), np.zeros(0)),
    ]  # fmt: skip
    lower, upper = np.full(nv, -np.inf), np.full(nv, np.inf)
    lower[6:10], upper[8:12] = -0.5, 0.4
    hard_rows = cone if bounded else None
    given = qp_of(plan, tasks, [equalities, *held], hard_rows, (lower, upper), rest)
    physical = Physical(6, 2 if bounded else 0, slice(1, 2))
    unit = max(np.square(row.weight).max() for row in tasks)
    relaxed = relaxed_qp(plan, given, physical, margins, unit)
    qp = relaxed.qp
    # Hard: what physics and the bolt say, and the cone; forces keep their bounds, v+ has none.
    np.testing.assert_array_equal(qp.A[:6, :n], equalities.matrix)
    np.testing.assert_array_equal(qp.A[6:, :nv], held[0].matrix)
    np.testing.assert_array_equal(qp.b, np.concatenate((equalities.target, held[0].target)))
    assert not qp.A[:, n:].any()
    assert qp.labels.equality == (*physics_names, *plan.held.labels[:6])
    hard = [k for k in range(len(qp.l)) if not qp.C[k, n:].any()]
    assert hard == ([0, 1] if bounded else [])
    np.testing.assert_array_equal(qp.C[hard, :n], cone.matrix[: len(hard)])
    assert (qp.l[hard] == -np.inf).all(), "no foot must be loaded"
    np.testing.assert_array_equal(qp.u[hard], 1.0)
    np.testing.assert_array_equal(qp.lower[:n], np.r_[np.full(nv, -np.inf), np.zeros(FORCES)])
    assert (qp.upper[:n] == np.inf).all()
    named = [label for k, label in enumerate(qp.labels.inequality) if k not in hard]
    assert named == ["m a", "m b", "m c", "m d", *decision.names[6:12]]
    # Soft: half the squares, weighed as the heaviest row of a task.

    def cost(x: np.ndarray) -> float:
        def squares(row: Rows) -> float:
            values = row.matrix @ x[: row.matrix.shape[1]] - row.target
            return float(np.square(row.weight * values).sum())

        total = sum(squares(row) for row in tasks)
        total += squares(held[1]._replace(weight=np.full(6, np.sqrt(unit))))
        weights = (np.full(2, unit), np.minimum(own_slack, unit))
        for part, weight in zip(margins, weights, strict=False):
            missed = outside(part.matrix @ x[:nv], part.lower, part.upper)
            total += float(weight @ np.square(missed))
        total += unit * float(np.square(outside(x[:nv], lower, upper)).sum())
        return 0.5 * (total + float(decision.damping @ np.square(x - rest)))

    points = [0.3 * rng.normal(size=n) for _ in range(40)]
    if bounded:  # where the cone allows them
        points = [point for point in points if (cone.matrix @ point <= 1.0).all()]
    assert len(points) > 5
    constant = cost(points[0]) - least_cost(qp, points[0])
    for point in points:
        assert cost(point) - least_cost(qp, point) == pytest.approx(constant, rel=1e-9)
    # What is missed is told by name, in its own units, unless it is what solvers leave.
    full = np.concatenate((points[0], np.zeros(qp.g.size - n)))
    told = relaxed_amounts(plan, given, physical, relaxed, full)
    values = np.concatenate([row.matrix @ points[0][:nv] - row.target for row in held])
    expected = {name: v for name, v in zip(plan.held.labels, values, strict=True) if abs(v) > 1e-5}
    assert told == pytest.approx(expected)
    full[n + 1], full[n + 2] = 2e-5, 0.5e-5
    told = relaxed_amounts(plan, given, physical, relaxed, full)
    assert told["m b"] == 2e-5 and "m c" not in told


def test_weightless_tasks_leave_a_scale_and_no_rows_no_bounds(hoap2: Robot, rng) -> None:
    """With nothing weighed, slacks cost 1e-6; without limits and margins there are no rows."""
    here = hoap2.snapshot(hoap2.posture())
    nv = hoap2.nv
    decision = Decision.velocity(hoap2, np.ones(nv))
    plan = LevelPlan.of(decision, [PostureTask(hoap2, here.q)], (), Slacks({}, (), ()))
    idle = rows_of(rng, 3, nv)._replace(weight=np.zeros(3))
    free = np.full(nv, np.inf)
    given = qp_of(plan, [idle], [], None, (-free, free), np.zeros(nv))
    nothing = Physical(0, 0, slice(0, 0))
    qp = relaxed_qp(plan, given, nothing, [], 0.0).qp
    assert qp.C.shape == (0, nv) and qp.A.shape == (0, nv)
    one = Bounds(("m",), np.ones((1, nv)), np.zeros(1), np.ones(1))
    qp = relaxed_qp(plan, given, nothing, [one], 0.0).qp
    assert qp.P[nv, nv] == pytest.approx(1e-6)


def test_a_load_that_cannot_be_had_is_dropped(hoap2: Robot) -> None:
    """A foot that must bear ten times the weight does not; everything else is kept."""
    here = hoap2.snapshot(hoap2.posture())
    loaded = FrictionCone(least=10.0 * hoap2.weight)
    contacts = support(here, "double", friction=loaded)
    controller = TorqueController(
        hoap2, [PostureTask(hoap2, here.q)], contacts=contacts, limits=Limits(hoap2), force_ramp=0.0
    )
    tick = controller.step(here)
    assert tick.policy == "relax"
    assert max(map(abs, tick.slack.values()), default=0.0) < 1e-4  # m/s
    forces = tick.reaction.normal_forces()
    assert sum(forces.values()) == pytest.approx(hoap2.weight, rel=0.05)
    assert (np.abs(tick.torque) <= controller.torque_bounds + 1e-9).all()


def test_bodies_are_not_pushed_into_each_other_by_tasks(hoap2, monkeypatch) -> None:
    """Where not all can be kept; as light as a task they gave way to it."""
    here, v = hoap2.snapshot(hoap2.posture("standing")), np.zeros(hoap2.nv)
    v[6:] = 8.0 * np.random.default_rng(1).normal(size=hoap2.nv - 6)
    target = here.q.copy()
    target[7:] += np.random.default_rng(2).uniform(-3.0, 3.0, hoap2.nv - 6)
    missed = []
    for weight in (1.0, relaxation.BODY_MARGIN):
        monkeypatch.setattr(relaxation, "BODY_MARGIN", weight)
        controller = TorqueController(
            hoap2,
            [PostureTask(hoap2, target, kp=2000.0)],
            contacts=(),
            limits=Limits(hoap2),
            constraints=[SelfCollision(hoap2)],
            torque_limits=0.05,
        )
        tick = controller.step(hoap2.snapshot(here.q, v))
        assert tick.policy == "relax"
        missed.append(sum(by**2 for name, by in tick.slack.items() if " vs " in name))
    assert missed[1] < 0.5 * missed[0]


def test_weights_farther_apart_than_numbers_hold_leave_an_answer_and_say_what_is_lost(g1) -> None:
    """Joints were only brought to rest; what is missed is what lesser weights miss."""
    start, missed = g1.snapshot(g1.posture("standing")), []
    for weight in (1e4, 1e6, 1e9):
        rng = np.random.default_rng(0)
        hand = PositionTask(g1, "left_rubber_hand", start.com, weight=weight)
        trunk = OrientationTask(g1, "base", start.rotation("base"), weight=weight)
        controller = TorqueController(
            g1,
            [trunk, hand, PostureTask(g1, start.q, weight=0.3)],
            contacts=support(start, "double"),
            torque_limits=0.1,
        )
        for _ in range(20):
            step, v = 0.02 * rng.normal(size=g1.nv), 0.5 * rng.normal(size=g1.nv)
            tick = controller.step(
                g1.snapshot(g1.limits.clamped(g1.integrate(start.q, step, 1.0)), v)
            )
            assert tick.ok
            if tick.relaxed:
                missed.append(max(map(abs, tick.slack.values())))
                assert ("too far apart" in tick.report()) == (weight > 1e5)
                assert (np.abs(tick.torque) <= controller.torque_bounds).all()
    assert len(missed) == 3
    np.testing.assert_allclose(missed, missed[0], rtol=1e-3)


def test_a_heavy_task_about_all_joints_leaves_relaxed_ticks_an_answer(hoap2: Robot) -> None:
    """Damped by a billionth of its weight, 4 of these 11 ticks were still unsolved."""
    start, rng, relaxed = hoap2.snapshot(hoap2.posture("standing")), np.random.default_rng(2), 0
    feet = support(start, "double")
    controller = TorqueController(
        hoap2,
        [
            DampingTask(hoap2, weight=1e4),
            InertiaTask(hoap2, start.inertia, per_mass=True),
            PostureTask(hoap2, start.q, weight=0.3),
        ],
        contacts=feet,
        slack={feet[0].name: 12.0},
        torque_limits=0.1,
        dt=0.01,
    )
    for _ in range(25):
        step, v = 0.001 * rng.normal(size=hoap2.nv), 1.5 * rng.normal(size=hoap2.nv)
        q = hoap2.limits.clamped(hoap2.integrate(start.q, step, 1.0))
        tick = controller.step(hoap2.snapshot(q, v))
        assert tick.ok
        relaxed += tick.policy == "relax"
    assert relaxed >= 8
