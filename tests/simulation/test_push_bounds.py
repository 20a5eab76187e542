"""What theory says of pushes, against the linear inverted pendulum; maps of pushes."""

import csv
import json
import math
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import load
from tests.standing import standing
from wbc.constraints.com_support import support_polygon
from wbc.errors import InvalidInputError
from wbc.polygon import polygon_margin
from wbc.simulation import PushGrid, PushMap, PushOutcome, capture_impulse
from wbc.simulation.campaign import compass_angles
from wbc.simulation.push_bounds import hip_torque, pulse_factor, push_bounds
from wbc.simulation.push_map import compare_maps, save_maps

FEET = ("left", "right")
OMEGA = 3.8
GRID = PushGrid(4, (1.0, 1.2, 1.4, 1.6), failures=0)
# By direction and ratio: a limit, a hole, all survived, nothing survived.
SURVIVED = ("110.", "1101", "1111", "0100")


def caught(ratio: float, duration: float, d: float = 0.1, dt: float = 1e-4) -> bool:
    """Whether a LIP whose CoP runs to the edge d at once catches an impulse in parts of M w d."""
    force = ratio * OMEGA * d / duration  # per kg
    xi = 0.0
    for k in range(round(20.0 / OMEGA / dt)):
        pushed = force if k * dt < duration else 0.0
        # xi' = w (xi - p) + F/(M w), exact for a constant right-hand side
        target = d - pushed / OMEGA**2
        xi = target + (xi - target) * np.exp(OMEGA * dt)
        if xi > 10.0 * d:
            return False
        if xi < d and not pushed:
            return True
    return xi <= d


@pytest.mark.parametrize("duration", [0.01, 0.1, 0.3])
def test_a_push_that_takes_time_is_caught_up_to_the_factor(duration: float) -> None:
    limit = pulse_factor(OMEGA, duration)
    assert caught(0.999 * limit, duration)
    assert not caught(1.001 * limit, duration)


def test_a_push_at_once_has_no_factor() -> None:
    assert pulse_factor(OMEGA, 0.0) == 1.0
    assert pulse_factor(OMEGA, 1e-9) == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("name", ["hoap2_like", "g1"])
def test_bounds_of_a_robot(name: str) -> None:
    start = standing(load(name))
    angles = compass_angles(16)
    bounds = push_bounds(start, FEET, angles, 0.1, 1.2)
    units = [capture_impulse(start, FEET, (np.cos(a), np.sin(a))) for a in angles]
    np.testing.assert_allclose(bounds.ankle, units, rtol=1e-9)  # two ways to the same number
    np.testing.assert_allclose(bounds.pulse / bounds.ankle, pulse_factor(bounds.omega, 0.1))
    assert bounds.wheel is not None and (bounds.wheel > bounds.pulse).all()
    smaller = push_bounds(start, FEET, angles, 0.1, 0.4).wheel
    assert smaller is not None and (smaller < bounds.wheel).all()


def test_hips_of_a_g1_are_its_pitch_and_roll_motors() -> None:
    start = standing(load("g1"))
    robot = start.robot
    effort = dict(zip(robot.joint_names, robot.limits.effort.tolist(), strict=True))
    # The pitch axes of a G1 are across the trunk; those of roll are inclined by 27 degrees.
    pitch = 2.0 * effort["left_hip_pitch_joint"]
    assert hip_torque(start, FEET, 1) == pytest.approx(pitch, rel=1e-6)
    roll = 2.0 * effort["left_hip_roll_joint"]
    assert 0.85 * roll < hip_torque(start, FEET, 0) <= roll


def test_without_effort_limits_there_is_no_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wbc.simulation.push_bounds.hip_torque", lambda *_: math.inf)
    bounds = push_bounds(standing(load("hoap2_like")), FEET, compass_angles(4), 0.1, 1.2)
    assert bounds.wheel is None and "effort" in bounds.why_no_wheel


def test_it_moves_the_capture_point_to_the_edge() -> None:
    here = standing(load("hoap2_like"))
    robot = here.robot
    polygon = support_polygon(here, FEET)
    ground = here.position(robot.foot("left").frame)[2]
    omega = np.sqrt(9.81 / (here.com[2] - ground))
    for angle in np.linspace(0.0, 2.0 * np.pi, 9):
        u = np.array((np.cos(angle), np.sin(angle)))
        impulse = capture_impulse(here, FEET, 7.0 * u)
        point = here.com[:2] + impulse / (robot.mass * omega) * u
        np.testing.assert_allclose(polygon_margin(polygon, point), 0.0, atol=1e-12)
    with pytest.raises(InvalidInputError, match="outside the soles"):
        capture_impulse(here, ("left",), (1.0, 0.0))  # between the feet
    over = here.q.copy()
    over[3:7] = 1.0, 0.0, 0.0, 0.0
    with pytest.raises(InvalidInputError, match="below the soles"):
        capture_impulse(robot.snapshot(over), FEET, (1.0, 0.0))


def test_the_robot_s_own_gravity_counts() -> None:
    """M omega d goes with the root of gravity; a plant takes it from the model too."""
    earth = load("hoap2_like")
    moon = deepcopy(earth)
    moon.model.gravity.linear = np.array((0.0, 0.0, -earth.gravity / 4.0))
    impulses = [capture_impulse(standing(one), FEET, (1.0, 0.0)) for one in (earth, moon)]
    assert impulses[1] == pytest.approx(0.5 * impulses[0], rel=1e-12)
    assert moon.weight == pytest.approx(0.25 * earth.weight, rel=1e-12)


def test_a_direction_along_the_ground_is_needed() -> None:
    with pytest.raises(InvalidInputError, match="needs a part along the ground"):
        capture_impulse(standing(load("hoap2_like")), FEET, (0, 0, 1.0))


def outcomes(table: tuple[str, ...]) -> list[PushOutcome]:
    return [
        PushOutcome(float(angle), ratio, ratio, one == "1", "why", 4.0, 0.1, 0.0, 0.0)
        for angle, row in zip(GRID.angles, table, strict=True)
        for ratio, one in zip((1.0, 1.2, 1.4, 1.6), row, strict=True)
        if one != "."
    ]


def made(table: tuple[str, ...]) -> PushMap:
    bounds = push_bounds(standing(load("hoap2_like")), ("left", "right"), GRID.angles, 0.1, 1.2)
    return PushMap("p", "hoap2_like", GRID, outcomes(table), bounds, bounds)


def test_a_limit_is_the_largest_up_to_which_all_were_survived() -> None:
    found = made(SURVIVED)
    np.testing.assert_array_equal(found.limits, [1.2, 1.2, 1.6, 0.0])
    np.testing.assert_array_equal(found.open_ended, [False, False, True, False])
    assert [found.beyond(k) for k in range(4)] == [[], [1.6], [], [1.2]]
    assert not found.complete  # one push was not tried
    assert made(("1100", *SURVIVED[1:])).complete
    first = found.first_failure(1)
    assert first is not None and first.ratio == 1.4
    assert found.first_failure(2) is None


def test_directions_that_were_not_tried_are_not_limits(tmp_path: Path) -> None:
    part = made(("110.", "....", "1...", "...."))
    np.testing.assert_array_equal(part.limits, [1.2, np.nan, 1.0, np.nan])
    np.testing.assert_array_equal(part.tried, [True, False, True, False])
    np.testing.assert_array_equal(part.open_ended, [False, False, True, False])
    assert (part.least, part.mean) == (1.0, pytest.approx(1.1))
    save_maps(tmp_path / "r.json", [part], {})
    (told,) = json.loads((tmp_path / "r.json").read_text())["maps"]
    assert [d["limit"] for d in told["directions"]] == [1.2, None, 1.0, None]
    assert [d["impulse"] is None for d in told["directions"]] == [False, True, False, True]
    assert told["least"] == 1.0
    nothing = made(("....",) * 4)
    assert np.isnan(nothing.least) and np.isnan(nothing.mean)
    assert nothing.summary()["least"] is None


def test_files_hold_what_the_map_says(tmp_path: Path) -> None:
    one, other = made(SURVIVED), made(("1000", "1000", "1110", "1000"))
    for ending in ("json", "npz", "csv"):
        save_maps(tmp_path / f"r.{ending}", [one, other], {"push": {"duration": 0.1}})
    told = json.loads((tmp_path / "r.json").read_text())
    first, second = told["maps"]
    assert [d["limit"] for d in first["directions"]] == [1.2, 1.2, 1.6, 0.0]
    assert first["directions"][1]["survived_beyond"] == [1.6]
    assert first["directions"][2]["at_least"] and first["directions"][2]["first_failure"] is None
    assert len(first["outcomes"]) == 15 and len(second["outcomes"]) == 16
    assert told["compared"]["times"][:3] == pytest.approx([1.2, 1.2, 1.6 / 1.4])
    assert told["compared"]["times"][3] is None  # nothing was survived: nothing is known
    least, mean, _ = compare_maps(one, other)
    assert least == pytest.approx(1.6 / 1.4) and mean == pytest.approx((2.4 + 1.6 / 1.4) / 3)
    nothing = made(("0000",) * 4)
    assert np.isnan(compare_maps(one, nothing)[0])
    with np.load(tmp_path / "r.npz") as archive:
        np.testing.assert_array_equal(archive["survived"][0], [1, 1, 0, -1])
        np.testing.assert_array_equal(archive["2/limit"], [1.0, 1.0, 1.4, 1.0])
        assert np.isnan(archive["time"][0, 3]) and archive["time"][0, 0] == 4.0
    with (tmp_path / "r.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["limit [M omega d]"]) for row in rows] == [1.2, 1.2, 1.6, 0.0]
    assert [row["monotone"] for row in rows] == ["1", "0", "1", "0"]
    assert float(rows[0]["survived [N s]"]) == pytest.approx(1.2 * one.bounds.ankle[0])
