"""A real walk in MuJoCo: a few steps, a stop, a landing that comes early; and from the schedule."""

import re
from copy import copy, deepcopy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import wbc
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.gait import GaitSettings, adaptation
from wbc.gait.footsteps import other
from wbc.gait.phases import DoubleSupport, SingleSupport, Standing
from wbc.qp.solution import Status
from wbc.robot import Robot
from wbc.simulation import FallLimits, FallWatch, Plant, Sensors, Step, Terrain, simulate


def walked(walker: wbc.gait.Walker, plant: Plant, duration: float) -> tuple[float, int]:
    """Walk on; return the share of relaxed ticks and how many steps were early or late."""
    watch, relaxed, ticks = FallWatch(plant, FallLimits()), 0, 0
    end = plant.time + duration
    while plant.time < end - 1e-9:
        tick = walker.step(plant.snapshot(), plant.contact_forces)
        plant.step(tick.torque)
        relaxed, ticks = relaxed + bool(tick.policy), ticks + 1
        verdict = watch.verdict()
        assert verdict.stood, verdict
    return relaxed / ticks, ticks


def test_forces_that_are_none_are_a_typed_error(hoap2: Robot) -> None:
    walker, here = wbc.gait.Walker(hoap2), hoap2.snapshot(hoap2.posture())
    walker.command(0.1)
    while not isinstance(walker.phase, SingleSupport):
        walker.prepare(here)
    for bad in ({}, {"left_sole": [1.0], "right_sole": [[1.0], [2.0, 3.0]]}, [1.0], np.zeros(6)):
        with pytest.raises(InvalidInputError, match="walker, force"):
            walker.prepare(here, bad)  # type: ignore[arg-type]
    by_foot = dict.fromkeys(("left", "right"), np.zeros(6))
    for bad, said in (({}, "without any give None"), (by_foot, "'left_sole', only on left, right")):
        with pytest.raises(InvalidInputError, match=said):
            walker.prepare(here, bad)


def test_a_task_named_as_one_of_the_walk_is_refused_by_name(hoap2: Robot) -> None:
    arms = wbc.PostureTask(hoap2, hoap2.posture("standing"))
    with pytest.raises(
        InvalidInputError, match="has a task 'posture' of its own; give yours anoth"
    ):
        wbc.gait.Walker(hoap2, tasks=[arms])


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"dely": 0.0}, "setting of a walker 'dely'; did you mean 'delay'"),
        ({"frction": 0.5}, "did you mean 'friction'"),
        ({"height": 0.2}, r"'height'; it is one of a gait: Walker\(robot, \{'height': "),
        ({"contacts": []}, "setting of a walker 'contacts'"),
    ],
)
def test_settings_that_a_walker_has_not_are_told_as_its_own(hoap2, wrong, said) -> None:
    """They were TypeErrors about a TorqueController; a robot for legs was an AttributeError."""
    with pytest.raises(UnknownNameError, match=said):
        wbc.gait.Walker(hoap2, **wrong)  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="gait, legs: expected a Legs"):
        GaitSettings.of(hoap2)  # type: ignore[arg-type]


def test_soles_with_slack_are_refused(hoap2: Robot) -> None:
    """The first step ended in an unknown contact."""
    with pytest.raises(InvalidInputError, match="slack: 'left_sole' is a sole, whose contact"):
        wbc.gait.Walker(hoap2, slack={"left_sole": 1e3})


def test_a_copy_walks_on_by_itself(hoap2: Robot) -> None:
    """With the same robot's snapshots; its steps were the original's."""
    walker, here = wbc.gait.Walker(hoap2), hoap2.snapshot(hoap2.posture())
    walker.command(0.1)
    walker.step(here)
    other = copy(walker)
    torques = [other.step(here).torque for _ in range(120)]
    assert isinstance(walker.phase, DoubleSupport) and isinstance(other.phase, SingleSupport)
    for torque in torques:
        np.testing.assert_array_equal(walker.step(here).torque, torque)


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("command", 0.3, r"walker: command is called: walker.command\(0.3\)"),
        ("velocity", 0.3, r"velocity: expected a Velocity, .*walker.command\(0.3\), got 0.3"),
        ("wanted", None, "wanted: expected a Velocity"),
        ("limits", 0.3, "limits: expected a CommandLimits"),
        ("gait", {"height": 0.2}, "gait cannot be assigned; make another Walker"),
        ("dt", 0.004, "dt cannot be assigned; make another Walker"),  # its controller kept the old
        ("controller", None, "controller cannot be assigned; make another Walker"),
    ],
)
def test_assigned_attributes_that_would_do_nothing_are_refused(hoap2, name, value, told) -> None:
    """A number took the place of a method, and the robot stood."""
    walker = wbc.gait.Walker(hoap2)
    with pytest.raises(InvalidInputError, match=told):
        setattr(walker, name, value)
    assert walker.command(0.1).velocity.vx == 0.1


def test_commands_keep_the_limits_that_a_walker_is_given(hoap2: Robot) -> None:
    """Speeds of commands go with those of joints; before, what was asked for could not be done."""
    usual, same, slow, calm = (
        wbc.gait.Walker(hoap2, limits=limits).limits
        for limits in (
            None,
            wbc.Limits(hoap2),
            wbc.Limits(hoap2, velocity=0.25),
            wbc.Limits(hoap2, acceleration=2.0),
        )
    )
    assert same == usual and usual.why[0] == slow.why[0] == "speed of the hips"
    assert slow.forwards == pytest.approx(0.25 * usual.forwards)
    assert calm.why[0] == "torque of the hips" and calm.swing < 0.2 * usual.swing


def test_left_feet_on_the_right_are_refused() -> None:
    feet = {"left": {"link": "right_foot"}, "right": {"link": "left_foot"}}
    robot = Robot.load("hoap2_like", feet=feet)
    with pytest.raises(InvalidInputError, match="left foot of hoap2_like, right_foot, does not st"):
        wbc.gait.Walker(robot)


@pytest.mark.slow
def test_a_walker_made_elsewhere_begins_where_the_robot_stands_and_faces(hoap2: Robot) -> None:
    """As one that was made there does; before, it walked another way."""
    there = hoap2.posture("standing")
    there[:3] += 300.0, -200.0, 0.0
    there[3:7] = 0.0, 0.0, np.sin(1.0), np.cos(1.0)
    ends = []
    for posture in (None, there):
        walker, plant = wbc.gait.Walker(hoap2, posture=posture), Plant(hoap2)
        plant.reset(there)
        walker.command(0.1)
        for _ in range(700):
            plant.step(walker.step(plant.snapshot(), plant.contact_forces).torque)
        ends.append(plant.com)
    np.testing.assert_allclose(*ends, atol=1e-5)
    way = (ends[0] - there[:3])[:2]
    assert way @ (np.cos(2.0), np.sin(2.0)) > 0.03


def test_soles_are_held_where_they_stand_in_the_first_tick(hoap2, caplog) -> None:
    """A robot tilted by a slope of 0.12 and lifted by 20 mm stands on other soles than planned."""
    walker, q = wbc.gait.Walker(hoap2), hoap2.posture("standing")
    tilted = np.concatenate((q[:3] + [0.0, 0.0, 0.02], [0.0, 0.06, 0.0, (1.0 - 0.06**2) ** 0.5]))
    here = hoap2.snapshot(np.concatenate((tilted, q[7:])))
    walker.step(here)
    for contact in walker.controller.contacts:
        np.testing.assert_allclose(contact.residual(here).error, 0.0, atol=1e-12)
    assert "not where they are to be held" not in caplog.text


@pytest.mark.slow
def test_a_robot_that_is_put_elsewhere_while_it_stands_begins_anew_there(hoap2: Robot) -> None:
    """In a second episode it walked the way that the first one faced, and a G1 fell."""
    walker, plant = wbc.gait.Walker(hoap2), Plant(hoap2)
    walker.command(0.1, 0.0, 0.5)
    walked(walker, plant, 2.0)
    walker.command(0.0)
    walked(walker, plant, 2.0)
    assert isinstance(walker.phase, Standing) and walker.heading > 0.5
    plant.reset(hoap2.posture("standing"))
    walker.command(0.1)
    walked(walker, plant, 2.0)
    assert walker.heading == pytest.approx(0.0, abs=1e-9) and not walker.notes
    assert plant.com[0] > 0.1 and abs(plant.com[1]) < 0.03


def test_a_robot_that_is_put_elsewhere_in_the_middle_of_a_walk_is_told(hoap2, caplog) -> None:
    walker, q = wbc.gait.Walker(hoap2), hoap2.posture("standing")
    walker.command(0.1)
    walker.prepare(hoap2.snapshot(q))
    assert isinstance(walker.phase, DoubleSupport) and not caplog.records
    q[0] += 1.0
    walker.prepare(hoap2.snapshot(q))
    assert "a foot is 1.00 m from where it was a tick before" in caplog.text
    caplog.clear()
    walker.prepare(hoap2.snapshot(q))
    assert not caplog.records


def test_a_footstep_without_solution_is_counted_and_said(hoap2, monkeypatch, caplog) -> None:
    """A solver that finds nothing: goals stay finite, and the foot in the air lands."""
    walker, here = wbc.gait.Walker(hoap2), hoap2.snapshot(hoap2.posture())
    walker.command(0.1)
    while not isinstance(walker.phase, SingleSupport):
        walker.prepare(here)
    assert walker.unadapted == 0 and not caplog.records
    left = walker.phase.left

    unsolved = SimpleNamespace(status=Status.ITERATION_LIMIT)
    hopeless = SimpleNamespace(eps=-1.0, max_iterations=1, solve=lambda qp, quick: unsolved)
    monkeypatch.setattr(adaptation, "SOLVER", hopeless)
    for k in range(3):
        walker.prepare(here)
        assert walker.unadapted == k + 1 and not walker.phase.adapted
        assert np.isfinite((walker.phase.goal, walker.phase.offset)).all()
        assert k == 0 or walker.phase.left == pytest.approx(left - walker.dt)
        left = walker.phase.left
    assert [one.message for one in caplog.records] == [
        "walker: the QP of a footstep was not solved; the usual one is made instead"
    ]
    monkeypatch.undo()
    while isinstance(walker.phase, SingleSupport):
        walker.prepare(here)
    assert walker.steps == 1 and walker.unadapted == 3


def test_a_gait_follows_its_robot_s_gravity(hoap2: Robot) -> None:
    """Times go with 1/omega; what is no gravity is refused."""
    moon = deepcopy(hoap2)
    moon.model.gravity.linear = np.array((0.0, 0.0, -hoap2.gravity / 4.0))
    gaits = [wbc.gait.Walker(robot).gait for robot in (hoap2, moon)]
    assert gaits[1].height == gaits[0].height
    assert gaits[1].omega == pytest.approx(0.5 * gaits[0].omega, rel=1e-12)
    assert gaits[1].single == pytest.approx(2.0 * gaits[0].single, rel=1e-12)
    space = deepcopy(hoap2)
    space.model.gravity.linear = np.zeros(3)
    vars(space).pop("gravity", None)  # kept since it was looked at
    with pytest.raises(InvalidInputError, match="gravity"):
        wbc.gait.Walker(space)
    with pytest.raises(UnknownNameError, match="gravity"):
        wbc.gait.Walker(hoap2, {"gravity": 1.6})


@pytest.mark.slow
def test_g1_walks_and_stops(g1_27: Robot) -> None:
    walker, plant = wbc.gait.Walker(g1_27), Plant(g1_27, friction=0.7)
    assert not walker.command(0.4).reason
    relaxed, _ = walked(walker, plant, 1.8)
    began = plant.com.copy()
    share, _ = walked(walker, plant, 0.9)
    assert max(relaxed, share) < 0.01
    # at 0.35 m/s or more: within one step the CoM is now faster, now slower
    assert plant.com[0] - began[0] > 0.3 and abs(plant.com[1]) < 0.05
    assert walker.steps >= 4
    walker.command(0.0)
    walked(walker, plant, 2.0)
    assert isinstance(walker.phase, Standing)
    place = plant.com.copy()
    walked(walker, plant, 0.2)
    np.testing.assert_allclose(plant.com, place, atol=5e-3)


@pytest.mark.slow
def test_without_forces_feet_land_when_they_should(hoap2: Robot) -> None:
    walker, plant = wbc.gait.Walker(hoap2), Plant(hoap2)
    walker.command(0.1, 0.0, 0.2)
    for one in simulate(
        walker.controller, plant, 1.5, update=lambda _, snapshot: walker.prepare(snapshot)
    ):
        assert one.verdict.stood
    assert walker.steps >= 3 and plant.com[0] > 0.05
    assert isinstance(walker.phase, DoubleSupport | SingleSupport)


@pytest.mark.slow
def test_a_step_that_is_not_known_is_felt(hoap2: Robot) -> None:
    """The foot lands early on 4 mm, and the CoM goes on above it."""
    walker = wbc.gait.Walker(hoap2)
    board = Step(centre=(0.55, 0.0, 0.004), size=(0.9, 1.0, 0.004))
    plant = Plant(hoap2, terrain=Terrain(steps=(board,)))
    walker.command(0.15)
    walked(walker, plant, 2.2)
    feet = [plant.snapshot().position(foot.frame)[2] for foot in hoap2.feet.values()]
    assert min(feet) > 0.003
    assert plant.com[2] == pytest.approx(walker.gait.height + 0.004, abs=5e-3)


@pytest.mark.slow
def test_a_foot_that_finds_lower_ground_goes_on_ahead(g1: Robot) -> None:
    """A G1 at 1.2 m/s fell at 9 of 10 drops of 2 cm: its foot went down where it was to land."""
    board = Step(centre=(0.0, 0.0, 0.02), size=(4.0, 4.0, 0.02))
    walker, plant = wbc.gait.Walker(g1), Plant(g1, terrain=Terrain(steps=(board,)))
    q = g1.posture("standing")
    q[2] += 0.02
    plant.reset(q)
    walker.command(1.2)
    for _ in range(2200):
        plant.step(walker.step(plant.snapshot(), plant.contact_forces).torque)
    assert plant.com[0] > 3.0 and plant.com[2] > 0.9 * walker.gait.height


def test_the_heading_waits_for_a_foot_that_is_late(hoap2: Robot) -> None:
    """It turned on, and of 96 G1 that turned at a drop of 2 or 3 cm 35 fell (12)."""
    walker, plant, headings = wbc.gait.Walker(hoap2), Plant(hoap2), []
    walker.command(0.1, 0.0, 0.5)
    while len(headings) < 10:
        before, felt = walker.heading, plant.contact_forces
        if walker.steps == 3 and isinstance(walker.phase, SingleSupport):
            felt[hoap2.feet[other(walker.phase.support)].frame] = np.zeros(6)
            headings += [walker.heading] * (walker.phase.swing.late > 0.0)
        plant.step(walker.step(plant.snapshot(), felt).torque)
    assert walker.velocity.yaw_rate == 0.5 and before > 0.1
    assert set(headings) == {before}


@pytest.mark.slow
def test_who_stands_over_an_edge_does_not_tip_over_it(g1: Robot) -> None:
    """A G1 walks off a board of 2 cm, with half a sole beyond its edge before the foot lands."""
    board = Step(centre=(-0.4, 0.0, 0.02), size=(2.0, 4.0, 0.02))
    walker, plant = wbc.gait.Walker(g1), Plant(g1, terrain=Terrain(steps=(board,)))
    q = g1.posture("standing").copy()
    q[2] += 0.02
    plant.reset(q)
    walker.command(0.4)
    steepest = 1.0
    for one in simulate(
        walker.controller,
        plant,
        3.2,
        update=lambda _, snapshot: walker.prepare(snapshot, plant.contact_forces),
    ):
        assert one.verdict.stood, one.verdict
        here = plant.snapshot()
        upright = (here.rotation(foot.frame)[2, 2] for foot in g1.feet.values())
        steepest = min(steepest, *upright)
    assert plant.com[0] > 0.8
    assert np.degrees(np.arccos(steepest)) < 15.0  # 7; 30 where it was pressed beyond the edge


@pytest.mark.slow
def test_who_is_pushed_over_a_foot_that_comes_down_sets_it_where_it_catches(g1: Robot) -> None:
    """48 N s made a G1 fall whose foot was held where it touched the ground on its way there."""
    walker, plant = wbc.gait.Walker(g1), Plant(g1)
    walker.command(0.5)
    single = walker.gait.single
    while not (walker.steps == 6 and getattr(walker.phase, "elapsed", 0.0) > 0.7 * single):
        plant.step(walker.step(plant.snapshot(), plant.contact_forces).torque)
    plant.push("torso_link", (0.0, -270.0, 0.0), duration=0.2)
    walked(walker, plant, 2.5)
    assert plant.com[2] > 0.95 * walker.gait.height


def test_a_tick_of_another_robot_is_refused(g1_27: Robot, hoap2: Robot) -> None:
    walker, there = wbc.gait.Walker(hoap2), g1_27.snapshot(g1_27.posture("standing"))
    with pytest.raises(InvalidInputError, match="expected a snapshot"):
        walker.step(there)
    with pytest.raises(InvalidInputError, match="expected a snapshot"):
        walker.follow([wbc.gait.Footstep("left", 0.0, 0.1)], there)


@pytest.mark.slow
def test_who_turns_does_not_turn_back_with_the_arms(g1_27: Robot) -> None:
    """The whole body turns: by the simulation's own heading; arms stay about where they hang."""
    walker, plant = wbc.gait.Walker(g1_27), Plant(g1_27)
    hang = plant.snapshot().q[-14:]
    walker.command(0.0, 0.0, 0.6)
    walked(walker, plant, 2.4)
    assert walker.heading > 1.0
    pelvis = plant.snapshot().rotation("base")
    assert abs(np.arctan2(pelvis[1, 0], pelvis[0, 0]) - walker.heading) < 0.05
    # 0.18 rad; 1.05 with the angular momentum about the vertical held to zero
    assert np.abs(plant.snapshot().q[-14:] - hang).max() < 0.4


def test_a_robot_without_limits_of_effort_and_speed_walks(hoap2: Robot, tmp_path: Path) -> None:
    """As MJCF files give none: what hips can do is not infinite then, which was no number."""
    text = hoap2.path.read_text()
    for limit in ("effort", "velocity"):
        text = re.sub(rf'{limit}="[^"]*"', f'{limit}="0"', text)
    (tmp_path / "unlimited.urdf").write_text(text)
    robot = Robot.load(tmp_path / "unlimited.urdf")
    assert np.isinf(robot.limits.effort).all()
    walker, plant = wbc.gait.Walker(robot, torque_limits=None), Plant(robot)
    walker.command(0.1)
    walked(walker, plant, 0.8)
    assert walker.steps >= 1


@pytest.mark.slow
def test_a_walk_goes_on_with_a_known_delay(hoap2: Robot) -> None:
    """Measured 8 ms late, forces too: told so it walks as without; its goals are of now."""
    late, dt = 4, 0.002
    walker = wbc.gait.Walker(hoap2, dt=dt, delay=late * dt)
    plant = Plant(hoap2, dt=dt, sensors=Sensors(delay=late * dt))
    watch, felt = FallWatch(plant, FallLimits()), [plant.contact_forces]
    walker.command(0.15)
    while walker.steps < 3:
        felt = [*felt, plant.contact_forces][-late - 1 :]
        measured = plant.measure()
        assert measured is not None and plant.time < 3.0
        snapshot = hoap2.snapshot(*measured)
        tick = walker.step(snapshot, felt[0])
        true, ahead = plant.state()[1], walker.controller.predicted(snapshot).v
        if plant.time > 0.1 and isinstance(walker.phase, SingleSupport):
            assert np.linalg.norm(ahead[:3] - true[:3]) < 0.05  # m/s
        plant.step(tick.torque)
        assert watch.verdict().stood
