"""Stacks of singular tasks, rank and condition of a tick: bounds and closed forms by numpy."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.linalg import null_space

from wbc.constraints import PositionBox, support
from wbc.controllers import KinematicController, Tick, TorqueController
from wbc.controllers.conditioning import conditioning
from wbc.controllers.singular import reduce_singular
from wbc.laws import Rows
from wbc.qp import QP
from wbc.robot import Robot
from wbc.tasks import ComTask, PositionTask, PostureTask


def random_rows(rng, sizes: Sequence[int], nv: int) -> list[Rows]:
    """Stacks of rows that are nearly dependent, of very different weights and thresholds."""
    common = rng.normal(size=(max(sizes), nv))
    return [
        Rows(
            common[:k] + 10.0 ** rng.uniform(-6, 1) * rng.normal(size=(k, nv)),
            rng.normal(size=k),
            10.0 ** rng.uniform(-2, 2) * rng.uniform(0.5, 2.0, k),
            singular_threshold=10.0 ** rng.uniform(-2, 0),
        )
        for k in sizes
    ]


def test_what_is_asked_for_needs_no_more_than_the_wanted_rate_over_the_threshold(rng) -> None:
    """Stacks of tasks: the bound of wbc.controllers.singular, by the pseudo-inverses of numpy.

    The held rows ask for motion too; the bound is on what the tasks add to the least such motion,
    in joint rates of the motion that the joints' weights choose.
    """
    nv, changed = 12, 0
    for _ in range(200):
        rows = random_rows(rng, (2, 3, 1), nv)
        C, c = rng.normal(size=(4, nv)), rng.normal(size=4)
        root = np.exp(rng.normal() + 0.5 * rng.normal(size=nv))
        out, found = reduce_singular(rows, [Rows(C, c, np.ones(4))], root)
        metric = np.concatenate([row.matrix for row in rows]) / root
        free = null_space(C / root)
        J = metric @ free
        brought = metric @ np.linalg.pinv(C / root) @ c
        asked, wanted = (np.concatenate([row.target for row in rs]) - brought for rs in (out, rows))
        motion = np.linalg.pinv(J, rcond=1e-9) @ asked
        least = np.concatenate([np.full(row.target.size, row.singular_threshold) for row in rows])
        joints = free @ motion / root
        assert np.linalg.norm(joints) <= np.linalg.norm(wanted / least) * (1 + 1e-6)
        np.testing.assert_allclose(J @ motion, asked, atol=1e-5)  # all of it can be done
        lost = [found[k].rate_reduction for k in range(3) if found[k].rate_reduction is not None]
        if lost:
            changed += 1
            np.testing.assert_allclose(np.concatenate(lost), wanted - asked, atol=1e-12)
    assert 50 < changed < 200


def test_what_held_rows_bring_about_is_not_asked_for(rng) -> None:
    """One task beside held rows that move; oracle: SVD of the motions that weights choose."""
    nv = 9
    C, c = rng.normal(size=(3, nv)), rng.normal(size=3)
    root = np.exp(rng.normal(size=nv))
    row = Rows(rng.normal(size=(3, nv)), rng.normal(size=3), np.ones(3))
    metric = row.matrix / root
    free = null_space(C / root)
    V, inverse, _ = np.linalg.svd((free @ np.linalg.pinv(metric @ free) / root[:, None]).T)
    U, s = V[:, ::-1], 1.0 / inverse[::-1]
    threshold = 0.5 * (s[0] + s[1])
    row = row._replace(singular_threshold=threshold)
    _, found = reduce_singular([row], [Rows(C, c, np.ones(3))], root)
    missing = row.target - metric @ np.linalg.pinv(C / root) @ c
    lost = U @ ((1.0 - np.minimum(1.0, s / threshold) ** 2) * (U.T @ missing))
    np.testing.assert_allclose(found[0].rate_reduction, lost, atol=1e-12)


def test_two_tasks_that_nearly_repeat_each_other(g1_27: Robot) -> None:
    """Two points 5 cm apart on a hand are to cross: each is easy, both together are not."""
    here = g1_27.snapshot(g1_27.posture("standing"), np.zeros(g1_27.nv))
    places = {f: here.position(f) for f in ("left_wrist_yaw_link", "left_wrist_pitch_link")}
    apart = np.subtract(*places.values())
    aside = np.cross(apart, [0, 0, 1.0])
    aside *= 0.5 / np.linalg.norm(aside)

    def step(yaw: float, pitch: float) -> Tick:
        tasks = [
            PositionTask(g1_27, frame, (0.0, 0.0, 0.0), singular_threshold=least, name=frame)
            for frame, least in zip(places, (yaw, pitch), strict=True)
        ]
        for task, sign in zip(tasks, (1, -1), strict=True):
            task.set_target(places[task.frame], sign * aside)
        return KinematicController(g1_27, tasks, contacts=support(here, "double")).step(here)

    alone, both = step(0.0, 0.06), step(0.06, 0.06)
    assert min(one.least for one in both.singular.values()) > 0.06
    assert alone.singular["left_wrist_pitch_link"].rate_reduction is None
    assert np.abs(alone.velocity).max() > 9.0
    assert np.abs(both.velocity).max() < 0.5 * np.abs(alone.velocity).max()
    assert all(one.rate_reduction is not None for one in both.singular.values())


def test_tasks_that_contradict_each_other_settle_by_their_weights(g1_27: Robot) -> None:
    """One point in two places at once: the rate is the mean, weighted by the squared weights."""
    here = g1_27.snapshot(g1_27.posture("standing"), np.zeros(g1_27.nv))
    place = here.position("left_wrist_yaw_link")
    tasks = [
        PositionTask(
            g1_27, "left_wrist_yaw_link", place + [0.01 * sign, 0, 0], name=name,
            weight=weight, singular_threshold=0.02,
        )
        for name, sign, weight in (("a", 1.0, 1.0), ("b", -1.0, 3.0))
    ]  # fmt: skip
    tick = KinematicController(g1_27, tasks, contacts=support(here, "double")).step(here)
    rate = here.jacobian("left_wrist_yaw_link")[:3] @ tick.velocity
    # By 1 to 9, as without thresholds, but for (0.02 / singular value)^2.
    np.testing.assert_allclose(rate, [(1 - 9) / 10, 0, 0], atol=0.01)


def test_a_level_that_holds_nothing_and_one_that_holds_everything(g1_27: Robot) -> None:
    here = g1_27.snapshot(g1_27.posture("standing"), np.zeros(g1_27.nv))
    com = ComTask(g1_27, here.com, priority=1, singular_threshold=0.08)
    nothing = PostureTask(g1_27, here.q)
    controller = KinematicController(g1_27, [nothing, com], contacts=())
    nothing.weight = 0.0
    tick = controller.step(here)
    least = np.linalg.svd(here.com_jacobian, compute_uv=False)[-1]
    assert tick.singular["com"].least == pytest.approx(least, rel=1e-9)
    everything = PostureTask(g1_27, here.q)
    contacts = support(here, "left")
    tick = KinematicController(g1_27, [everything, com], contacts=contacts).step(here)
    assert tick.ok
    assert tick.singular["com"].rank == 0
    assert tick.singular["com"].least < 1e-7


def test_rank_and_condition_are_those_of_the_rows(hoap2: Robot) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    hand = here.position("left_hand")
    tasks = [ComTask(hoap2, here.com, weight=3.0), PositionTask(hoap2, "left_hand", hand)]
    controller = KinematicController(hoap2, tasks, contacts=support(here, "double"), damping=1e-9)
    found = controller.conditioning(controller.step(here))
    J = np.concatenate((3.0 * here.com_jacobian, here.jacobian("left_hand")[:3]))
    held = np.concatenate([here.jacobian(f"{side}_sole") for side in ("left", "right")])
    free = null_space(held)
    values = np.linalg.svd(J @ free, compute_uv=False)
    assert found.free == free.shape[1]
    assert found.rank == np.linalg.matrix_rank(J @ free) == 6
    # The squares of 1e-9 of rounding and damping, relative to the least curvature.
    assert found.condition == pytest.approx((values[0] / values[-1]) ** 2, rel=1e-5)


def test_redundant_tasks_have_less_rank_than_rows(hoap2: Robot) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    hand = here.position("left_hand")
    same = [
        PositionTask(hoap2, "left_hand", hand),
        PositionTask(hoap2, "left_hand", hand, name="again"),
    ]
    controller = KinematicController(hoap2, same)
    tick = controller.step(here)
    assert tick.ok
    assert controller.conditioning(tick).rank == 3
    assert controller.conditioning(tick).free == hoap2.nv


def test_slacks_are_no_motions(hoap2: Robot) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    room = PositionBox.height(hoap2, here.position("base")[2] - 0.1, frame="base")
    found = []
    for slack in ({}, {room.name: 10.0}):
        controller = KinematicController(
            hoap2,
            [ComTask(hoap2, here.com, weight=3.0)],
            contacts=support(here, "double"),
            constraints=[room],
            slack=slack,
            damping=1e-9,
        )
        tick = controller.step(here)
        found.append(controller.conditioning(tick))
    np.testing.assert_array_equal(tick._evidence.slack_weights, [10.0])
    assert found[1] == found[0]


def test_forces_leave_the_motions_that_contacts_leave(hoap2: Robot) -> None:
    """Feet bear any motion that they allow; in the air the momentum is given."""
    here = hoap2.snapshot(hoap2.posture("standing"))
    task, posture = ComTask(hoap2, here.com, weight=3.0), PostureTask(hoap2, here.q)
    standing = TorqueController(hoap2, [task], contacts=support(here, "double"), damping=1e-9)
    falling = TorqueController(hoap2, [task, posture], contacts=())
    borne, thrown = (one.conditioning(one.step(here)) for one in (standing, falling))
    held = np.concatenate([here.jacobian(f"{side}_sole") for side in ("left", "right")])
    values = np.linalg.svd(here.com_jacobian @ null_space(held), compute_uv=False)
    assert borne.free == hoap2.nv - 12 and borne.rank == 3
    assert borne.condition == pytest.approx((values[0] / values[-1]) ** 2, rel=1e-5)
    assert thrown.free == thrown.rank == hoap2.nv - 6


def test_where_only_the_damping_decides_the_condition_is_one() -> None:
    """Curvatures of 9, 11 and 44 times the damping: that of tasks begins at ten times."""
    damping, weights = 0.5, np.array([1.0, 2.0, 4.0])

    def of(*curvatures: float) -> tuple[int, int, float]:
        P = np.diag(weights * (np.array(curvatures) + 1.0) * damping)
        return tuple(conditioning(QP.build(P, np.zeros(3)), damping, weights))

    assert of(0.0, 0.0, 9.0) == (3, 0, 1.0)
    assert of(9.0, 11.0, 0.0) == (3, 1, 1.0)
    assert of(44.0, 9.0, 11.0) == (3, 2, pytest.approx(4.0))
