"""The section ``simulation``: what is made of it, mistakes, and short simulations."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.problem.loading import complaint_of, problem_of
from tests.texts import STAND
from wbc.codegen.recording import CodegenError, check_kind
from wbc.errors import InvalidInputError
from wbc.problem import Problem, load_problem
from wbc.problem.simulation_spec import rotated_to_plane
from wbc.robot import Robot
from wbc.run.phase_support import off_the_ground
from wbc.simulation import SimulationStatus, capture_impulse
from wbc.view.simulation import simulation_figure

PUSHED = (
    STAND
    + """\
simulation:
  duration: 0.3
  pushes: [{impulse_ratio: 0.5, angle: 1.5, at: 0.1, duration: 0.1}]
"""
)


def problem(folder: Path, text: str = PUSHED, overrides: dict[str, Any] | None = None) -> Problem:
    return problem_of(folder, text, overrides)


def test_it_stands_and_tells_of_it(tmp_path: Path) -> None:
    one = problem(tmp_path)
    calls: list[tuple[int, int, dict[str, Any]]] = []
    result = one.simulate(lambda *call: calls.append(call))
    assert result.status is SimulationStatus.STOOD and result.status.good
    assert result.reason == "stood for 0.300 s"
    assert len(result.run.history) == 150
    assert calls[-1][:2] == (150, 150)
    assert len(result.arrays["time"]) == len(result.arrays["errors/com"]) == 151
    assert result.arrays["time"][-1] == pytest.approx(0.3)
    # The CoM at the end, against that of the true state.
    com = one.parts.robot.snapshot(result.arrays["q"][-1]).com
    np.testing.assert_allclose(result.run.final.com, com, atol=1e-15)
    assert 0.0 < result.peak_tilt < 0.2
    assert 0.0 < max(result.torque_use.values()) < 1.0
    torque = dict(zip(result.robot.joint_names, result.arrays["torque"][1:].T, strict=True))
    for name, change in result.torque_change.items():
        steps = np.diff(torque[name])
        assert change == pytest.approx(np.linalg.norm(steps) / np.sqrt(steps.size), abs=1e-12)
    assert [*result.torque_change.values()] == sorted(result.torque_change.values(), reverse=True)
    # The push of half M omega d: the CoM's momentum grows by what the soles did not take.
    assert result.cop_error < 0.02
    (push,) = result.pushes
    start = one.parts.robot.snapshot(one.parts.start)
    size = capture_impulse(start, ("left", "right"), push.impulse)
    assert np.linalg.norm(push.impulse) == pytest.approx(0.5 * size)
    summary = result.summary()["simulation"]
    assert summary["stood"] and summary["pushes"][0]["at"] == 0.1
    assert "mujoco" in result.run.provenance["versions"]


@pytest.mark.parametrize(("duration", "told"), [(0.15, True), (0.2, False)])
def test_a_push_that_the_end_cuts_short_is_told(tmp_path, duration, told) -> None:
    result = problem(tmp_path, overrides={"simulation.duration": duration}).simulate()
    words = "the push on base from 0.1 s on lasts until 0.2 s, and was over with the simulation"
    assert any(words in note for note in result.notes) is told


def test_the_cop_counts_from_the_first_step_on(tmp_path: Path) -> None:
    """Without a torque yet, hoap2 stood on its heels: 34 mm inside its soles in place of 44."""
    result = problem(tmp_path, STAND + "simulation: {duration: 0.1}\n").simulate()
    margins = result.arrays["cop_margin"]
    assert np.isnan(margins[0]) and np.isfinite(margins[1:]).all()
    assert result.least_cop_margin == margins[1:].min() > 0.04


@pytest.mark.parametrize(
    ("left", "words"),
    [
        ("frame: left_sole, type: point, friction: grip", "left_sole: grips of the controller"),
        ("frame: left_hand, friction: grip", "nothing touched left_hand, where the controller"),
        ("frame: left_sole", ""),
    ],
)
def test_contacts_that_the_simulation_does_not_have_are_told(tmp_path, left, words) -> None:
    """Grips bore 200 N of a falling robot in silence; at a sole's point they were a traceback."""
    text = STAND.replace("support: double", f"support: [right_sole, {{{left}}}]")
    result = problem(tmp_path, text + "simulation: {duration: 0.1}\n").simulate()
    assert [note.startswith(words) for note in result.notes] == [True] * bool(words)


@pytest.mark.slow
def test_the_same_file_gives_the_same_bits(tmp_path: Path) -> None:
    noisy = {"simulation.sensors": {"position_noise": 1e-4, "dropout": 0.1, "seed": 3}}
    one = problem(tmp_path, overrides=noisy)
    first, second = (one.simulate().arrays for _ in range(2))
    for name in ("q", "v", "torque", "cop"):
        np.testing.assert_array_equal(first[name], second[name])
    other = problem(tmp_path, overrides={**noisy, "simulation.sensors.seed": 4}).simulate()
    assert abs(other.arrays["q"] - first["q"]).max() > 1e-9
    assert other.lost > 0


def test_a_strong_push_makes_it_fall(tmp_path: Path) -> None:
    result = problem(tmp_path, overrides={
        "simulation.pushes[0].impulse_ratio": 4.0, "simulation.duration": 2.0
    }).simulate()  # fmt: skip
    assert result.status is SimulationStatus.FELL
    assert result.reason.startswith("fell at t = ")
    assert result.duration < 1.5
    assert result.relaxed > 0.0
    assert list(result.gave_way.values()) == sorted(result.gave_way.values(), reverse=True)


def test_tolerances_at_the_end_are_judged(tmp_path: Path) -> None:
    result = problem(tmp_path, PUSHED + "stop: {accept: {com: 1.0e-7}}\n").simulate()
    assert result.status is SimulationStatus.NOT_REACHED
    assert "not within tolerance: com" in result.reason


@pytest.mark.slow
def test_phases_lift_a_foot_in_physics(tmp_path: Path) -> None:
    text = STAND + (
        "phases:\n"
        "  shift: {duration: 1.0, tasks: {com: {target: {over: left}}}}\n"
        "  stand: {duration: 0.3, support: left}\n"
    )
    result = problem(tmp_path, text).simulate()
    assert result.status is SimulationStatus.STOOD, result.reason
    assert list(dict.fromkeys(result.run.history.support)) == ["left,right", "left"]
    # What the controller let go of bears hardly anything any more.
    weight = 9.81 * result.robot.mass
    assert result.arrays["forces/left_sole"][-1, 2] > 0.9 * weight
    assert result.duration == pytest.approx(1.3)


def test_a_level_foot_in_the_air_rises_by_nothing(hoap2: Robot) -> None:
    """It rose "by 1.4e-14 mm" from corner to corner."""
    q = hoap2.posture("standing")
    q[2] += 0.03
    said = off_the_ground(hoap2.snapshot(q), "left")
    assert said is not None
    assert said.endswith("30 mm above the ground, and from corner to corner it rises by 0 mm")


def test_on_a_slope_the_robot_is_turned_with_the_ground(tmp_path: Path) -> None:
    one = problem(tmp_path, overrides={"simulation.terrain.slope": [0.06, -0.04]})
    start = one.parts.robot.snapshot(one.parts.start)
    ground = one.spec.simulation.ground()
    for foot in ("left", "right"):
        assert off_the_ground(start, foot) is not None
        assert off_the_ground(start, foot, ground.height, 1e-9) is None
    assert one.simulate().status is SimulationStatus.STOOD


def test_soles_are_flat_on_steep_slopes(tmp_path: Path) -> None:
    """They were taken to be on level ground: a corner was told to be "27 mm above" it."""
    steep = STAND + "simulation: {duration: 0.1, terrain: {slope: [0.3, -0.2]}}\n"
    start = problem(tmp_path, steep).parts.at_start
    ground = problem(tmp_path, steep).spec.simulation.ground().height
    assert all(off_the_ground(start, foot, ground, 1e-9) is None for foot in ("left", "right"))
    bent = steep + "start: {joints: {left_ankle_pitch: 0.5}}\n"
    assert "the left foot does not stand" in complaint_of(tmp_path, bent)


def test_contacts_with_drift_are_asked_for(tmp_path: Path) -> None:
    assert not problem(tmp_path).spec.simulation.ground().drift
    one = problem(tmp_path, overrides={"simulation.terrain.drift": True})
    assert one.spec.simulation.ground().drift and one.plant().terrain.drift


def test_turning_with_a_plane() -> None:
    normal = np.array((-0.3, 0.2, 1.0)) / np.linalg.norm((-0.3, 0.2, 1.0))
    q = np.array((1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.4))
    turned = rotated_to_plane(q, normal)
    np.testing.assert_allclose(np.linalg.norm(turned[3:7]), 1.0)
    assert turned[7] == 0.4
    x, y, z, w = turned[3:7]
    up = np.array((2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)))
    np.testing.assert_allclose(up, normal, atol=1e-15)  # the base's z axis
    assert normal @ turned[:3] == pytest.approx(3.0)  # as far from the plane as before


def test_every_form_of_a_push(tmp_path: Path) -> None:
    pushes = [
        {"force": [1.0, 2.0, 3.0], "at": 0.0, "point": [0.0, 0.1, 0.2], "body": "head_link"},
        {"impulse": 2.0, "direction": [0.0, 0.0, -5.0], "at": 0.1, "duration": 0.2},
        {"impulse": 2.0, "angle": 0.0, "at": 0.1, "profile": "half_sine"},
    ]
    frames = problem(tmp_path).parts.robot.frame_names
    pushes[0]["body"] = next(name for name in frames if "head" in name)
    one = problem(tmp_path, overrides={"simulation.pushes": pushes})
    start = one.parts.robot.snapshot(one.parts.start)
    first, second, third = (
        spec.push(start, ("left", "right")) for spec in one.spec.simulation.pushes
    )
    np.testing.assert_allclose(first.force, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(first.point, [0.0, 0.1, 0.2])
    np.testing.assert_allclose(second.force, [0.0, 0.0, -10.0])
    np.testing.assert_allclose(third.impulse, [2.0, 0.0, 0.0], atol=1e-15)
    assert third.force[0] == pytest.approx(2.0 / 0.1 * np.pi / 2)
    place = start.position("base") + start.rotation("base") @ second.point
    np.testing.assert_allclose(place, start.com, atol=1e-15)


def test_a_velocity_problem_is_not_simulated(tmp_path: Path) -> None:
    text = (
        "robot: hoap2_like\nsupport: floating\n"
        "tasks: {hand: {type: frame, frame: left_hand, control: position, target: start}}\n"
    )
    with pytest.raises(InvalidInputError, match=r"level is velocity.*wbc run .*level: torque"):
        problem(tmp_path, text).simulate()
    words = "p.yaml:4: simulation: belongs to the torque level; give controller: {level: torque}"
    assert words in complaint_of(tmp_path, text + "simulation: {duration: 1}\n")


PUSH = "impulse_ratio: 0.5, angle: 1.5"
MISTAKES = [
    ("duration: 0.3", "duraton: 0.3", "p.yaml:10: simulation.duraton: unknown key; did you mean"),
    ("duration: 0.3", "duration: 0", "p.yaml:10: simulation.duration: must be greater than 0"),
    ("duration: 0.3", "friction: -1", "simulation.friction: must be at least 0"),
    ("duration: 0.3", "physics_dt: 0.0015", "controller.dt: 0.002 s is no multiple of simul"),
    ("duration: 0.3", "sensors: {delay: 0.0005}", "simulation.sensors.delay: 0.0005 s is no mult"),
    ("duration: 0.3", "sensors: {nois: 1}", "simulation.sensors.nois: unknown key"),
    ("duration: 0.3", "sensors: {dropout: 2}", "simulation.sensors.dropout: "),
    ("duration: 0.3", "model_error: {mass: 0}", "simulation.model_error: "),
    ("duration: 0.3", "falls: {trunk: bse}", "falls.trunk: unknown frame 'bse'; did you mean"),
    ("duration: 0.3", "falls: {lifted: right}", "falls.lifted: the right foot stands at the start"),
    ("duration: 0.3", "gravity: -9.81", "simulation.gravity: must be at least 0, got -9.81"),
    ("duration: 0.3", "estimate: true\n  devices: {imus: [{rotation: {rpy: [1.57, 0, 0]}}]}",
     "devices.imus[0].rotation: expected three rows of a rotation matrix, got"),
    ("duration: 0.3", "terrain: {slope: 1}", "simulation.terrain.slope: expected a list"),
    ("at: 0.1", "at: 0.7, body: bsae", "p.yaml:11: simulation.pushes[0].body: unknown frame 'bsa"),
    ("at: 0.1", "at: 0.7", "pushes[0].at: begins after the end of the simulation (0.3 s)"),
    ("at: 0.1", "profile: sine", "simulation.pushes[0]: 'at' is missing"),
    ("at: 0.1", "at: 0, profile: half", "profile: 'half' does not exist; did you mean 'half_sine'"),
    (PUSH, "angle: 1", "simulation.pushes[0]: give one of force, impulse, impulse_ratio"),
    (PUSH, "impulse: 1", "pushes[0].impulse: impulse is a number: give angle or direction"),
    (PUSH, f"{PUSH}, force: 1", "pushes[0].impulse_ratio: give one of force, impulse"),
    (PUSH, "force: [1, 0, 0], angle: 2", "angle: force is a vector and has a direction of its ow"),
    (PUSH, "impulse_ratio: 1, direction: [0, 0, 1]", "direction: impulse_ratio is about horizont"),
    (PUSH, "impulse: 1, direction: [0, 0, 0]", "pushes[0].direction: needs some length"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "words"), MISTAKES)
def test_mistakes_are_told_with_their_place(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in PUSHED
    assert words in complaint_of(tmp_path, PUSHED.replace(old, new, 1))


def test_how_long_it_is_is_said_once(tmp_path: Path) -> None:
    words = "p.yaml:12: stop.duration: belongs to the velocity level; a simulation lasts for"
    assert words in complaint_of(tmp_path, PUSHED + "stop: {duration: 1}\n")
    phases = "phases: {only: {duration: 0.2}}\n"
    words = "p.yaml:10: simulation.duration: a run with phases ends after the last"
    assert words in complaint_of(tmp_path, PUSHED + phases)


def test_noise_delay_and_a_wrong_model_are_what_the_file_says() -> None:
    path = Path(__file__).parents[2] / "problems" / "stand_hoap2_like.yaml"
    one = load_problem(path, {"simulation.duration": 0.3, "simulation.sensors.dropout": 0.2})
    assert isinstance(one, Problem)
    result = one.simulate()
    assert result.status is SimulationStatus.STOOD, result.reason
    assert result.lost > 10
    # What the controller saw is not what was true, but near it.
    com = np.array([result.robot.snapshot(q).com for q in result.arrays["q"]])
    seen = result.run.history.com
    apart = np.abs(seen - com[: len(seen)]).max()
    assert 1e-5 < apart < 2e-2


def test_what_is_to_be_kept_is_judged_by_where_the_robot_is(tmp_path: Path) -> None:
    """Feet seem to move by what the base's position is measured wrong by; they do not."""
    noise = {
        "simulation.sensors": {"base_position_noise": 4e-3, "seed": 1},
        "simulation.pushes": [],
    }
    result = problem(tmp_path, overrides=noise).simulate()
    seen = max(slip.max() for name, slip in result.arrays.items() if name.startswith("slip/"))
    assert seen > 8e-3  # of a normal distribution of 4 mm, along three axes, in 150 ticks
    # Oracle: where the soles of the recorded true states are.
    robot = result.robot
    soles = np.array(
        [
            [here.position(foot.frame) for foot in robot.feet.values()]
            for here in map(robot.snapshot, result.arrays["q"])
        ]
    )
    moved = np.linalg.norm(soles - soles[0], axis=2).max()
    assert result.run.slip is not None
    # The anchors are where the soles are planned; the ground gives by less than a millimetre.
    assert result.run.slip.value == pytest.approx(moved, abs=1e-3)
    assert result.run.slip.value < 5e-3
    assert result.status is SimulationStatus.STOOD, result.reason


CARRYING = (
    STAND
    + """\
simulation:
  duration: 0.2
  wrenches: [{frame: left_hand, force: [0, 0, -5], at: 0.1, duration: .inf}]
"""
)


@pytest.mark.slow
def test_payloads_and_wrenches_of_a_file_are_known_recorded_and_drawn(tmp_path: Path) -> None:
    """A robot that is told of both keeps its hand; who is not told lets it sag."""
    payload = [{"frame": "right_hand", "mass": 0.3, "com": [0.02, 0.0, 0.0]}]
    sag = {}
    for told in (True, False):
        text = CARRYING.replace("at: 0.1", f"told: {str(told).lower()}, at: 0.1")
        one = problem(tmp_path, text, {"robot.payload": payload})
        robot = one.parts.robot
        assert [body.mass for body in robot.payloads] == [0.3]
        result = one.simulate()
        q = result.arrays["q"]
        first, last = (robot.snapshot(q[k]).position("left_hand") for k in (0, -1))
        sag[told] = np.linalg.norm(last - first)
        acted = result.arrays["wrenches/left_hand"]
        assert np.flatnonzero(acted[:, 2])[0] == 51 and (acted[51:, 2] == -5.0).all()
        (summary,) = result.summary()["simulation"]["wrenches"]
        assert summary["told"] is told and summary["duration"] is None
    with pytest.raises(CodegenError, match="told of none"):
        check_kind(problem(tmp_path, CARRYING))
    assert sag[True] < 2e-4 < 2e-3 < sag[False]
    simulation_figure(robot, result.arrays, title="pulled")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"simulation.wrenches": [{"frame": "left_hnd", "force": [0, 0, 1]}]}, "left_hand"),
        ({"simulation.wrenches": [{"frame": "left_hand"}]}, "give force or moment"),
        ({"simulation.wrenches": [{"frame": "left_hand", "force": [1, 0, 0], "at": 9.0}]},
         "begins after the end"),
        ({"robot.payload": [{"frame": "left_hand", "mass": 0.0}]}, "greater than 0"),
        ({"robot.payload": [{"frame": "hand", "mass": 1.0}]}, "unknown frame 'hand'"),
    ],
)  # fmt: skip
def test_mistakes_in_payloads_and_wrenches_are_named(tmp_path, change, said) -> None:
    assert said in complaint_of(tmp_path, CARRYING, change)
