"""Tracked principal axes against rotations and moments that the inertias were made from."""

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.rmp.axes import are_distinct, follow, track, turning_rate
from wbc.validate import Array


def turn(axis: Array, angles: Array) -> Array:
    """Rotations (n, 3, 3) about a fixed axis, by Rodrigues."""
    x, y, z = axis / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + s * K + (1.0 - c) * (K @ K)


def inertias(axes: Array, second_moments: Array) -> Array:
    """tr(S) 1 - S with S of given eigenvectors (n, 3, 3) and eigenvalues (n, 3)."""
    S = np.einsum("nik,nk,njk->nij", axes, second_moments, axes)
    return np.trace(S, axis1=1, axis2=2)[:, None, None] * np.eye(3) - S


def crossing(n: int = 401) -> tuple[Array, Array]:
    """Axes that make two turns while all three second moments change places."""
    t = np.linspace(0.0, 1.0, n)
    axes = turn(np.array([1.0, 2.0, -0.5]), 4.0 * np.pi * t)
    ones = np.ones(n)
    # Crossings at irrational times, so that no frame is within the gap by chance.
    moments = np.stack((3.0 - 2.3 * t, 1.0 + np.sqrt(3.0) * t, 1.41 * ones), axis=1)
    return axes, moments


def matched(found: Array, true: Array) -> Array:
    """The signed permutation (3, 3) that takes the true axes of one frame to the found ones."""
    C = np.round(true.T @ found)
    assert (np.abs(C).sum(axis=0) == 1).all() and (np.abs(C).sum(axis=1) == 1).all()
    return np.asarray(C)


def test_axes_keep_order_and_sign_through_crossings() -> None:
    axes, moments = crossing()
    found = track(inertias(axes, moments))
    C = matched(found.axes[0], axes[0])
    order = np.abs(C).argmax(axis=0)
    assert not (np.argsort(moments, axis=1) == np.argsort(moments[0])).all()  # they do cross
    clear = found.defined.all(axis=1)
    assert clear.mean() > 0.95
    # Eigenvectors are as good as 1e-16 over the relative gap, at least 1e-3.
    np.testing.assert_allclose(found.axes[clear], (axes @ C)[clear], rtol=0, atol=1e-11)
    np.testing.assert_allclose(
        found.second_moments[clear], moments[:, order][clear], rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(found.axes), 1.0, rtol=1e-12)


def test_axes_that_meet_for_a_while_are_carried_and_come_out_the_same() -> None:
    """Two, then all three second moments are equal (to rounding) for 30 frames each."""
    n = 200
    t = np.linspace(0.0, 1.0, n)
    axes = turn(np.array([0.2, 0.3, 1.0]), 0.6 * t)
    moments = np.tile([3.0, 2.0, 1.0], (n, 1))
    moments[:, 1] += 1.5 * t  # the second becomes the longest in between
    moments[40:70, 0] = moments[40:70, 1]
    moments[120:150] = 2.0
    noise = 1e-13 * np.random.default_rng(1).normal(size=(n, 3, 3))
    given = inertias(axes, moments) + noise + np.swapaxes(noise, 1, 2)
    found = track(given)
    defined = np.ones((n, 3), dtype=bool)
    defined[40:70, :2] = False
    defined[120:150] = False
    near = np.abs(moments[:, 0] - moments[:, 1]) < 1e-3 * moments.max(axis=1)
    defined[near, :2] = False
    np.testing.assert_array_equal(found.defined, defined)
    C = matched(found.axes[0], axes[0])
    clear = defined.all(axis=1)
    np.testing.assert_allclose(found.axes[clear], (axes @ C)[clear], rtol=0, atol=1e-9)
    # Carried axes: still the defined one exactly, and never far from the frame before.
    np.testing.assert_allclose(found.axes[40:70, :, 2], (axes @ C)[40:70, :, 2], atol=1e-9)
    np.testing.assert_array_equal(found.axes[120:150], np.tile(found.axes[119], (30, 1, 1)))
    steps = np.swapaxes(found.axes[:-1], 1, 2) @ found.axes[1:]
    cosine = (np.trace(steps, axis1=1, axis2=2) - 1.0) / 2.0
    assert np.degrees(np.arccos(cosine.clip(-1, 1))).max() < 10.0
    np.testing.assert_allclose(np.linalg.det(found.axes), 1.0, rtol=1e-12)


def test_equal_moments_have_no_axes() -> None:
    found = track(np.tile(2.0 * np.eye(3), (3, 1, 1)))
    assert not found.defined.any()
    np.testing.assert_allclose(found.second_moments, 1.0, rtol=1e-15)
    np.testing.assert_array_equal(found.axes[1:], found.axes[:-1])
    assert are_distinct(np.array([3.0, 1.0, 1.0])).tolist() == [True, False, False]
    assert are_distinct(np.array([3.0, 2.9999, 1.0])).tolist() == [False, False, True]
    assert are_distinct(np.zeros(3)).tolist() == [False, False, False]


def test_a_disc_that_tumbles_for_long_keeps_square_axes() -> None:
    """Two moments are equal throughout: the third axis is followed, rounding does not build up."""
    n = 3000
    rotations = turn(np.array([1.0, -0.4, 0.2]), np.linspace(0.0, 60.0, n))
    found = track(inertias(rotations, np.tile([1.0, 1.0, 0.3], (n, 1))))
    assert (found.defined.sum(axis=1) == 1).all()
    k = int(found.defined[0].argmax())
    assert found.defined[:, k].all()
    sign = np.sign(found.axes[0, :, k] @ rotations[0, :, 2])
    np.testing.assert_allclose(found.axes[:, :, k], sign * rotations[:, :, 2], rtol=0, atol=1e-12)
    squares = np.swapaxes(found.axes, 1, 2) @ found.axes
    np.testing.assert_allclose(squares, np.tile(np.eye(3), (n, 1, 1)), rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(found.axes), 1.0, rtol=1e-13)


def test_gap_is_the_callers() -> None:
    I = inertias(np.eye(3)[None], np.array([[3.0, 2.0, 1.9]]))  # noqa: E741
    assert track(I).defined.all()
    assert track(I, gap=0.1).defined[0].tolist() == [True, False, False]


def test_pieces_and_single_frames_give_the_same() -> None:
    axes, moments = crossing()
    series = inertias(axes, moments)
    whole = track(series)
    head = track(series[:150])
    tail = track(series[150:], previous=head.axes[-1])
    np.testing.assert_allclose(np.concatenate((head.axes, tail.axes)), whole.axes, atol=1e-12)
    before = whole.axes[0]
    for k in range(1, len(series)):
        values, vectors = np.linalg.eigh(np.trace(series[k]) / 2.0 * np.eye(3) - series[k])
        raw = vectors[:, ::-1] * np.sign(np.linalg.det(vectors[:, ::-1]))
        before = follow(raw, values[::-1], before, 1e-3)
        np.testing.assert_allclose(before, whole.axes[k], rtol=0, atol=1e-10)


def test_previous_decides_the_first_frame() -> None:
    I = inertias(np.eye(3)[None], np.array([[1.0, 2.0, 3.0]]))  # noqa: E741
    for previous in (np.eye(3), np.diag([-1.0, 1.0, -1.0]), np.eye(3)[:, [1, 2, 0]]):
        found = track(I, previous=previous)
        np.testing.assert_allclose(found.axes[0], previous, rtol=0, atol=1e-15)
        np.testing.assert_allclose(found.second_moments[0], np.abs(previous).T @ [1.0, 2.0, 3.0])


def test_turning_rate_against_differences_of_eigenvectors() -> None:
    """Axes turn and moments change, both at known rates: I' by differences of I, w known."""
    direction = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    h = 1e-5
    t = np.array([-h, 0.0, h])
    series = inertias(turn(direction, 0.7 + 1.3 * t), np.array([3.0, 2.0, 0.4]) + t[:, None])
    rate = (series[2] - series[0]) / (2.0 * h)
    axes = track(series).axes[1]
    found = turning_rate(series[1], rate, axes)
    # Central differences: h^2 and rounding over h, 1e-10 each.
    np.testing.assert_allclose(found, 1.3 * direction, rtol=0, atol=1e-8)
    several = turning_rate(series[[1, 1]], np.stack((rate, 2.0 * rate)), np.stack((axes, axes)))
    np.testing.assert_allclose(several, [found, 2.0 * found], rtol=1e-14)


@pytest.mark.parametrize(
    ("inertias", "message"),
    [
        (np.empty((0, 3, 3)), "at least one frame"),
        (np.eye(3), r"expected shape \(3, 3, 3\), got \(3, 3\)"),
        (1.0, r"array \(n, 3, 3\)"),
        (np.full((2, 3, 3), np.nan), "NaN or infinite"),
        (np.stack((np.eye(3), np.diag([1.0, 1.0, 3.0]))), r"inertias\[1\]: is that of no body"),
        (np.stack([np.eye(3)] + 2 * [np.triu(np.ones((3, 3)))]), r"\[1\], and 1 more: is not symm"),
    ],
)
def test_impossible_series_are_refused(inertias: Array, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        track(inertias)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gap": 0.0}, "gap"),
        ({"gap": np.nan}, "gap"),
        ({"previous": np.diag([1.0, 1.0, -1.0])}, "rotation"),
        ({"previous": 2.0 * np.eye(3)}, "rotation"),
        ({"previous": np.eye(2)}, "expected shape"),
    ],
)
def test_bad_options_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        track(np.eye(3)[None], **options)  # type: ignore[arg-type]
