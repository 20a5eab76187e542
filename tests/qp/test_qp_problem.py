"""The check that guards every solver."""

from dataclasses import replace

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.qp import QP, Labels, check_qp

LABELS = Labels(("foot x",), ("friction", "pair"), ("base", "knee", "hip"))


def valid() -> QP:
    return QP.build(
        np.eye(3), np.ones(3), A=np.ones((1, 3)), b=[0.0], C=np.ones((2, 3)), l=[-np.inf, -1.0],
        u=[1.0, np.inf], lower=[-np.inf, -1.0, -1.0], upper=[np.inf, 1.0, 1.0], labels=LABELS,
    )  # fmt: skip


def test_a_valid_qp_passes_unchanged():
    qp = valid()
    before = {name: np.array(getattr(qp, name)) for name in ("P", "g", "A", "b", "C", "l", "u")}
    check_qp(qp)
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(qp, name), value)


@pytest.mark.parametrize(
    ("field", "shape"),
    [("P", (3, 2)), ("A", (1, 2)), ("C", (3, 3)), ("l", (1,)), ("lower", (2,)), ("upper", (4,)),
     ("b", (1, 1))],
)  # fmt: skip
def test_wrong_shape_names_the_field(field, shape):
    with pytest.raises(InvalidInputError, match=rf"QP\.{field}: expected shape"):
        check_qp(valid()._replace(**{field: np.zeros(shape)}))


@pytest.mark.parametrize("field", ["equality", "inequality", "variables"])
def test_wrong_number_of_labels(field):
    labels = replace(LABELS, **{field: ("one", "two", "three", "four")})
    with pytest.raises(InvalidInputError, match=rf"QP\.labels\.{field}"):
        check_qp(valid()._replace(labels=labels))


@pytest.mark.parametrize(
    ("field", "index", "value", "name"),
    [
        ("lower", 1, 2.0, "knee"),
        ("upper", 2, -5.0, "hip"),
        ("lower", 0, np.inf, "base"),
        ("upper", 0, -np.inf, "base"),
        ("lower", 2, np.nan, "hip"),
        ("l", 0, 2.0, "friction"),
        ("u", 1, -2.0, "pair"),
        ("u", 0, np.nan, "friction"),
        ("l", 1, np.inf, "pair"),
    ],
)
def test_impossible_interval_names_the_row(field, index, value, name):
    qp = valid()
    bounds = np.array(getattr(qp, field))
    bounds[index] = value
    with pytest.raises(InvalidInputError, match=name):
        check_qp(qp._replace(**{field: bounds}))


def test_only_what_is_crossed_is_named():
    """Ends that are equal fix an unknown or a row; that is nothing wrong."""
    qp = valid()
    lower, upper = np.array(qp.lower), np.array(qp.upper)
    lower[0] = upper[0] = 0.5
    fixed = qp._replace(lower=lower, upper=upper)
    check_qp(fixed)
    with pytest.raises(InvalidInputError) as caught:
        check_qp(fixed._replace(upper=np.array([0.5, upper[1], lower[2] - 1.0])))
    told, names = str(caught.value), qp.labels.variables
    assert names[2] in told
    assert names[0] not in told


def test_entries_that_overflow_when_squared_are_refused():
    with pytest.raises(InvalidInputError, match=r"QP\.g: .*beyond 1e\+150.*'hip'"):
        check_qp(valid()._replace(g=np.array([0.0, 0.0, 1e160])))


def test_build_fills_in_what_is_left_out():
    qp = QP.build(np.eye(2), [1.0, 2.0], lower=[0.0, 0.0])
    assert qp.A.shape == qp.C.shape == (0, 2)
    assert qp.b.shape == qp.l.shape == qp.u.shape == (0,)
    np.testing.assert_array_equal(qp.upper, [np.inf, np.inf])
    assert qp.labels.variables == ("x0", "x1")


def test_build_refuses_a_cost_that_is_not_convex():
    """A saddle point was ``solved``; OSQP ended in an exception of its own."""
    box = {"lower": [-1.0, -1.0], "upper": [1.0, 1.0]}
    with pytest.raises(InvalidInputError, match=r"QP.P: .*positive semidefinite"):
        QP.build([[1.0, 0.0], [0.0, -1.0]], [0.0, 0.0], **box)
    rows = np.random.default_rng(0).standard_normal((3, 8)) * [[1e4], [1.0], [1e-4]]
    QP.build(rows.T @ rows, np.zeros(8))  # what rounding leaves below zero is none


def test_build_refuses_an_asymmetric_cost():
    with pytest.raises(InvalidInputError, match="symmetric"):
        QP.build([[2.0, 1.0], [0.0, 2.0]], [1.0, 1.0])
    with pytest.raises(InvalidInputError, match="symmetric"):
        QP.build([[1e12, 1.0], [0.0, 2.0]], [1.0, 1.0])
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    cost = turn @ np.diag([3.7, 3.7]) @ turn.T
    assert cost[0, 1] != cost[1, 0]  # by 1e-16 of rounding
    QP.build(cost, [1.0, 1.0])


def test_a_qp_of_no_unknowns_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"QP\.g: no entries"):
        QP.build(np.zeros((0, 0)), [])
