"""Simulations that begin above the ground or moving, phases that end at touchdown, a somersault."""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from tests.problem.loading import problem_of
from wbc.errors import InvalidInputError, ProblemFileError
from wbc.problem import Problem, load_problem
from wbc.robot import Robot
from wbc.run import Stop
from wbc.simulation import FallLimits, Plant, SimulationResult, run_trial

PROBLEMS = Path(__file__).parents[2] / "problems"
DROP = """\
robot: {model: hoap2_like, armature: 0.003}
tasks:
  com: {type: com, axes: [x, y], target: start, kp: 60, weight: 30}
  height: {type: com, axes: [z], target: start, kp: 80, kd: 12, weight: 30}
  torso: {type: frame, frame: base, control: orientation, target: start, kp: 50}
  posture: {type: posture, weight: 0.3, kp: 100}
phases:
  fall: {duration: 0.3, until: touchdown, support: floating}
  land: {duration: 0.15, support: double, tasks: {height: {target: {offset: [0, 0, -0.02]}}}}
controller: {level: torque, solver: active_set}
simulation: {start: {height: 0.03}, falls: {com_height: 0.3}}
"""


def problem(folder: Path, overrides: dict[str, Any] | None = None, text: str = DROP) -> Problem:
    return problem_of(folder, text, overrides)


@pytest.fixture(scope="module")
def drop(tmp_path_factory: pytest.TempPathFactory) -> SimulationResult:
    return problem(tmp_path_factory.mktemp("drop"), {"phases.land.ramp": 0.1}).simulate()


def test_a_phase_ends_when_the_feet_bear_load(drop: SimulationResult) -> None:
    assert drop.status.good, drop.reason
    history = drop.run.history
    landed = history.time[history.phase == "land"][0]
    # Free fall of 3 cm: sqrt(2 h / g); the physics steps by 1 ms, the controller by 2.
    assert landed == pytest.approx(np.sqrt(2 * 0.03 / 9.81), abs=0.004)
    force = drop.arrays["forces/left_sole"][:, 2] + drop.arrays["forces/right_sole"][:, 2]
    before = drop.arrays["time"] < landed - 0.0021
    assert (force[before] == 0.0).all()
    # What the fall was shorter than 0.3 s, the last phase is longer.
    assert drop.duration == pytest.approx(0.45)
    assert history.support[-1] == "left,right"
    assert (history.support[history.phase == "fall"] == "").all()


def test_targets_get_there_within_the_ramp(drop: SimulationResult) -> None:
    history, first = drop.run.history, drop.arrays["q"][0]
    target = drop.robot.snapshot(first).com[2] - 0.03 - 0.02
    k = int(np.searchsorted(history.time, history.time[history.phase == "land"][0] + 0.1)) + 1
    heights = [drop.robot.snapshot(q).com[2] for q in history.q[k:]]
    np.testing.assert_allclose(history.errors["height"][k:, 0], np.array(heights) - target)


def test_without_a_touchdown_a_phase_lasts_its_duration(tmp_path: Path) -> None:
    one = problem(tmp_path, {"simulation.start.height": 0.5, "phases.fall.duration": 0.1})
    result = one.simulate()
    assert result.status == "not_standing"
    assert "phase 'land' cannot begin" in result.reason
    assert len(result.run.history) == 50


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"phases.land.until": "touchdown"}, "phases.land.until: the next phase puts no foot down"),
        ({"phases.land.support": "floating"}, "phases.fall.until: the next phase puts no foot"),
        ({"phases.land.ramp": 0.4}, "phases.land.ramp: 0.4 s is longer than the phase"),
        ({"phases.land.ramp": 0.0}, "phases.land.ramp"),
        ({"phases.fall.until": "landing"}, "phases.fall.until"),
        ({"simulation.start.height": -0.1}, "simulation.start.height"),
        ({"simulation.gravity": "none"}, "simulation.gravity"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, overrides: dict[str, Any], words: str) -> None:
    with pytest.raises(ProblemFileError, match=words.replace("[", r"\[")):
        problem(tmp_path, overrides)


def test_nobody_feels_a_touchdown_at_the_velocity_level(tmp_path: Path) -> None:
    text = DROP.split("controller:")[0].replace(", kp: 60", "").replace(", kp: 80, kd: 12", "")
    text = text.replace(", kp: 50", "").replace(", kp: 100", "")
    with pytest.raises(ProblemFileError, match=r"phases\.fall\.until: belongs to the torque level"):
        problem(tmp_path, text=text)


def test_gravity_is_three_numbers() -> None:
    with pytest.raises(InvalidInputError, match="gravity"):
        Plant(Robot.load("hoap2_like"), gravity=(0.0, 9.81))


def test_the_start_moves_as_one_body(tmp_path: Path) -> None:
    velocity, turning = [0.3, -0.2, 0.5], [0.5, 2.0, -1.0]
    start = {"height": 1.0, "velocity": velocity, "angular_velocity": turning}
    one = problem(tmp_path, {"simulation.start": start, "phases.fall.duration": 0.002})
    spec = one.spec.simulation
    q, v = spec.start.state(one.parts.robot.snapshot(one.parts.start))
    model = one.parts.robot.model
    data = model.createData()
    pin.ccrba(model, data, q, v)
    np.testing.assert_allclose(data.hg.linear / one.parts.robot.mass, velocity, atol=1e-12)
    np.testing.assert_allclose(data.hg.angular, data.Ig.inertia @ turning, atol=1e-12)
    assert q[2] == one.parts.start[2] + 1.0


@pytest.mark.slow
def test_a_tuck_speeds_a_somersault_up_as_momentum_says() -> None:
    """The ratio of the base's rates is that of the moments of inertia, by Pinocchio, within 1 %."""
    short = {"spread": 0.05, "draw out": 0.002, "spread again": 0.002}
    overrides = {f"phases.{name}.duration": time for name, time in short.items()}
    one = load_problem(PROBLEMS / "somersault_hoap2.yaml", overrides)
    assert isinstance(one, Problem)
    result = one.simulate()
    assert result.status.good, result.reason
    model, history = one.parts.robot.model, result.run.history
    data = model.createData()
    rates, moments, momenta = [], [], []
    for phase in ("spread", "tucked"):
        k = int(np.flatnonzero(history.phase == phase)[-1])
        q, v = result.arrays["q"][k], result.arrays["v"][k]
        pin.ccrba(model, data, q, v)
        R = pin.Quaternion(q[3:7]).toRotationMatrix()
        rates.append(v[4])
        moments.append((R.T @ data.Ig.inertia @ R)[1, 1])
        momenta.append(data.hg.angular.copy())
    assert rates[1] / rates[0] > 1.7  # it is a tuck
    assert rates[1] / rates[0] == pytest.approx(moments[0] / moments[1], rel=0.01)
    # The physics conserves angular momentum to the order of its step, 1 ms.
    np.testing.assert_allclose(momenta[1], momenta[0], rtol=2e-3, atol=1e-6)


LIFT = """\
robot: {model: hoap2_like, armature: 0.003}
support: double
tasks:
  com: {type: com, target: start, kp: 100, weight: 30}
  foot:
    {type: frame, frame: left_sole, control: pose, target: start, kp: 900, weight: 20,
     active: false}
  posture: {type: posture, weight: 0.1, kp: 50}
phases:
  over: {duration: 0.4, tasks: {com: {target: {over: right}}}}
  lift:
    duration: 0.1
    support: right
    tasks: {foot: {active: true, target: {position: {offset: [0, 0, 0.01]}}}}
controller: {level: torque, solver: active_set}
"""


@pytest.mark.parametrize("ramp", [0.06, 0.0])
def test_forces_ramp_where_phases_change(tmp_path: Path, ramp: float) -> None:
    """A foot that is let go bears at most what is linear in time; the controller stays the same."""
    one = problem(tmp_path, {"controller.force_ramp": ramp}, LIFT)
    seen = []
    result = one.simulate(show=lambda _, controller: seen.append(controller))
    assert result.status.good, result.reason
    assert len({id(controller) for controller in seen}) == 1
    phases, force = result.run.history.phase, result.arrays["planned_forces/left_sole"][1:, 2]
    first = int(np.flatnonzero(phases == "lift")[0])
    ticks = round(ramp / 0.002)
    loads = force[first : first + ticks]
    bound = force[first - 1] * (1.0 - np.arange(1, ticks + 1) / max(ticks, 1))
    assert force[first - 1] > 1.0
    # Normal to the sole, which is tilted by a milliradian: the world's z is not quite that.
    assert (loads <= bound + 1e-3 * force[first - 1]).all() and (
        force[first + ticks :] == 0.0
    ).all()
    assert not ticks or loads[0] > 0.5 * force[first - 1]


@pytest.mark.slow
def test_a_planned_hop_flies_as_planned_and_is_landed() -> None:
    """Feet clear 10 cm, the CoM rises by what its take-off says, nothing turns on the way."""
    overrides = {"phases.rise.duration": 1.1, "stop.accept": {}}
    one = load_problem(PROBLEMS / "hop_g1.yaml", overrides)
    assert isinstance(one, Problem) and one.parts.plan is not None
    result = one.simulate()
    assert result.status.good, result.reason
    model, arrays = one.parts.robot.model, result.arrays
    data, time = model.createData(), arrays["time"]
    force = (arrays["forces/left_sole"] + arrays["forces/right_sole"])[:, 2]
    com, soles = [], []
    for q in arrays["q"]:
        pin.centerOfMass(model, data, q)
        pin.updateFramePlacements(model, data)
        com.append(data.com[0].copy())
        soles.append(
            [data.oMf[model.getFrameId(f"{s}_sole")].translation[2] for s in ("left", "right")]
        )
    height, clear = np.array(com)[:, 2], np.array(soles).min(axis=1)
    assert clear.max() > 0.10
    flying = np.flatnonzero(force <= 0.0)
    flying = flying[(time[flying] > 1.0) & (time[flying] < 1.7)]
    t = time[flying] - time[flying[0]]
    a, v = np.polyfit(t, height[flying], 2)[:2]
    assert 2.0 * a == pytest.approx(-9.81, rel=0.01)  # nothing holds it
    planned = one.parts.plan.at(np.array((1.12,))).com_velocity[0, 2]
    assert v == pytest.approx(planned, rel=0.1) and 0.36 < t[-1] < 0.42
    weight = 9.81 * pin.computeTotalMass(model)
    assert np.convolve(force, np.full(5, 0.2), "valid").max() < 4.0 * weight


@pytest.mark.slow
@pytest.mark.parametrize("seed", [None, 4, 9])
def test_a_fall_of_30_cm_is_landed_softly(seed: int | None) -> None:
    """The ground pushes with less than 3.9 weights in every step of the physics.

    Also with noise and delay, with masses 10 % smaller (4), which the spring throws up
    again, and larger (9), whose soles come down faster.
    """
    overrides: dict[str, Any] = {
        "phases.rise.duration": 0.01,
        "phases.rise.ramp": 0.01,
        "stop.accept": {},
    }
    mass = 1.0 if seed is None else 1.1 if seed % 2 else 0.9
    if seed is not None:
        sensors = {"position_noise": 1e-3, "base_rotation_noise": 1e-3, "delay": 0.002}
        sensors |= {"velocity_noise": 0.05, "base_rate_noise": 0.05, "seed": seed}
        overrides["simulation.sensors"] = sensors
        overrides["simulation.model_error"] = {"mass": mass, "seed": seed}
    one = load_problem(PROBLEMS / "drop_g1.yaml", overrides)
    assert isinstance(one, Problem)
    plant = one.plant()
    forces, step = list[float](), plant.step

    def step_by_step(torque: np.ndarray, dt: float) -> None:
        for _ in range(round(dt / plant.physics_dt)):
            step(torque, plant.physics_dt)
            forces.append(float(np.linalg.norm(plant.contacts.forces.sum(axis=0))))

    plant.step = step_by_step  # type: ignore[method-assign, assignment]
    falls = FallLimits(**one.spec.simulation.falls)
    stop = Stop(**one.spec.whole_stop.model_dump())
    result = run_trial(one.supervisor(plant), plant, stop, falls=falls)
    assert result.status.good, result.reason
    model, arrays = one.parts.robot.model, result.arrays
    phase = result.run.history.phase
    # Without the rise, which is made in 10 ms here.
    before = round(0.002 / plant.physics_dt) * int(np.flatnonzero(phase == "settle")[-1])
    force = np.array(forces[:before]) / (mass * 9.81 * pin.computeTotalMass(model))
    means = np.convolve(force, np.full(10, 0.1), "valid")
    landed = result.run.history.time[phase == "land"][0]
    # It has fallen by 0.3 m and by what its legs drew in: 0.3 m take 0.247 s.
    assert 0.247 < landed < 0.30
    assert means.max() > 2.5 and force.max() < 3.9
    data, k = model.createData(), int(np.flatnonzero(phase == "settle")[-1])
    pin.centerOfMass(model, data, arrays["q"][k], arrays["v"][k])
    assert data.com[0][2] > 0.3 and np.abs(data.vcom[0]).max() < 0.5  # on its feet, at rest
