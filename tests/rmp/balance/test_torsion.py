"""What friction gives about the vertical, against forces at the four corners found by a program."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInputError
from wbc.polygon import half_planes, inset
from wbc.rmp.balance.foot import FlatFoot, physical_rows, torsion_rows
from wbc.rmp.balance.law import BalanceLaw, LawBounds
from wbc.rmp.balance.lqr import Lqr
from wbc.rmp.balance.momentum_qp import MomentumQp
from wbc.rmp.balance.spin_change import SpinChange
from wbc.rmp.balance.stabiliser import PointStabiliser
from wbc.rmp.balance.static_lean import StaticLean
from wbc.rmp.balance.swing_up import SwingUp
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp

FRICTION, MARGIN = 0.8, 0.004
SLOPE = FRICTION / np.sqrt(2.0)


def rectangle(turn: float) -> np.ndarray:
    corners = np.array(((-0.08, -0.05), (0.12, -0.05), (0.12, 0.09), (-0.08, 0.09)))
    c, s = np.cos(turn), np.sin(turn)
    return corners @ np.array(((c, s), (-s, c)))


def corner_forces_exist(corners: np.ndarray, axes: np.ndarray, wrench: np.ndarray) -> bool:
    """Whether forces at the corners, inside pyramids along ``axes``, add up to the wrench (6,)."""
    sums = np.zeros((6, 12))
    inside = []
    for k, (x, y) in enumerate(corners):
        three = slice(3 * k, 3 * k + 3)
        sums[:3, three] = np.eye(3)
        sums[3:, three] = ((0.0, 0.0, y), (0.0, 0.0, -x), (-y, x, 0.0))
        for axis in axes:
            for sign in (1.0, -1.0):
                row = np.zeros(12)
                row[three] = *(sign * axis), -SLOPE
                inside.append(row)
    found = linprog(
        np.zeros(12), A_ub=inside, b_ub=np.zeros(len(inside)), A_eq=sums, b_eq=wrench,
        bounds=(None, None),
    )  # fmt: skip
    return found.status == 0


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_rows_hold_exactly_where_corners_can_hold_the_wrench(turn: float) -> None:
    foot = FlatFoot(SolidRmp(35.0))
    bounds = LawBounds(polygon=rectangle(turn), friction=FRICTION, cop_margin=MARGIN, torsion=True)
    normals, offsets = half_planes(bounds.polygon)
    # the pyramid along world axes is another one on a turned sole
    rows = [row for row in physical_rows(foot, bounds, normals, offsets - MARGIN)
            if not row.label.startswith(("force", "friction"))]  # fmt: skip
    evaluate = ca.Function(
        "rows", [foot.q, foot.v, foot.x], [ca.vertcat(*(r.expression for r in rows))]
    )
    axes = np.array(((np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn))))
    corners = inset(bounds.polygon, MARGIN)
    rng = np.random.default_rng(5)
    seen = {True: 0, False: 0}
    while min(seen.values()) < 40:
        q = np.array([0.0, 0.0, np.pi / 2, 0.0, 0.7, 0.0, 0.0, 0.0, 1.0, 0.3, 0.25, 0.35])
        q[:4] += 0.05 * rng.normal(size=4)
        q[5:9] = Rotation.from_rotvec(0.3 * rng.normal(size=3)).as_quat()
        x = np.zeros(13)
        x[:6] = rng.normal(size=6) * (2.0, 2.0, 1.0, 15.0, 15.0, 15.0)
        com = foot.model.com(q, np.zeros(11))[0]
        force = 35.0 * (x[:3] + (0.0, 0.0, 9.81))
        if np.abs(axes @ force[:2]).max() > SLOPE * force[2]:
            continue
        torque = np.cross(com, force) + Rotation.from_quat(q[5:9]).apply(x[3:6])
        worst = float(evaluate(q, np.zeros(11), x).full().max())
        if abs(worst) < 1e-6:
            continue
        possible = corner_forces_exist(corners, axes, np.concatenate((force, torque)))
        assert possible is (worst < 0.0)
        seen[possible] += 1


def test_rows_are_there_where_they_are_asked_for() -> None:
    foot = FlatFoot(SolidRmp(35.0))
    for asked, count in ((False, 0), (True, 8)):
        bounds = LawBounds(polygon=rectangle(0.0), friction=FRICTION, torsion=asked)
        rows = physical_rows(foot, bounds, *half_planes(bounds.polygon))
        assert sum(row.label.startswith("torsion") for row in rows) == count


@pytest.mark.parametrize("given", [{"friction": np.inf}, {"polygon": [(-1, -1), (1, -1), (0, 1)]}])
def test_where_they_cannot_be_they_are_not_left_out_silently(given: dict) -> None:
    asked = {"polygon": rectangle(0.0), "friction": FRICTION, "wheel_torque": 50.0, "torsion": True}
    with pytest.raises(InvalidInputError, match="torsion needs a finite friction and a rectang"):
        MomentumQp(SolidRmp(35.0), LawBounds(**asked | given), (0.0, 0.0, 0.7), (0.3, 0.3, 0.3))


UPRIGHT, SPINNING = np.array((0.0, np.pi / 2, 0.7, 0.0, 0.3)), np.array((0, 0, 0, 3.0, 0))
laws = pytest.mark.parametrize(
    "law",
    [
        lambda bounds: Lqr(PlanarRmp(35.0), UPRIGHT, bounds=bounds),
        lambda bounds: StaticLean(PlanarRmp(35.0), 1.5, 0.7, 0.3, bounds),
        lambda bounds: SwingUp(PlanarRmp(35.0), 0.7, 0.3, bounds),
        lambda bounds: SpinChange(PlanarRmp(35.0), UPRIGHT, SPINNING, 2.0, 1.0, bounds),
        lambda bounds: PointStabiliser(SolidRmp(35.0), bounds, 0.7, (0.3, 0.3, 0.3)),
    ],
)


@laws
def test_laws_that_cannot_keep_it_say_so(law: Callable[[LawBounds], BalanceLaw]) -> None:
    with pytest.raises(InvalidInputError, match="cannot keep torsion within what friction holds"):
        law(LawBounds(torsion=True, wheel_torque=50.0))


@laws
@pytest.mark.parametrize("broken", [np.full(5, np.nan), np.zeros(4)])
def test_a_state_that_is_none_is_refused(law, broken: np.ndarray) -> None:
    made = law(LawBounds(wheel_torque=50.0))
    for q, v in ((broken, np.zeros(5)), (UPRIGHT, broken)):
        with pytest.raises(InvalidInputError):
            made.command(q, v, 0.0)


def test_only_rectangles_have_such_rows() -> None:
    foot = FlatFoot(SolidRmp(35.0))
    count = {
        name: len(torsion_rows(foot, LawBounds(polygon=polygon, friction=FRICTION), SLOPE))
        for name, polygon in {
            "rectangle": rectangle(0.3),
            "triangle": [(-0.1, -0.1), (0.1, -0.1), (0.0, 0.1)],
            "kite": [(-0.1, 0.0), (0.0, -0.1), (0.2, 0.0), (0.0, 0.1)],
            "trapezium": [(-0.1, -0.1), (0.1, -0.1), (0.05, 0.1), (-0.1, 0.1)],
        }.items()
    }
    assert count == {"rectangle": 8, "triangle": 0, "kite": 0, "trapezium": 0}
