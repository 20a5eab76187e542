"""Errors of the model: the physics has the robot that a changed Pinocchio model describes."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

from tests.conftest import load, random_state
from tests.simulation.accelerations import mass_and_bias
from wbc.errors import InvalidInputError
from wbc.simulation import ModelMismatch, Plant, Terrain


def test_factors_and_shift(rng: np.random.Generator) -> None:
    robot = load("g1")
    mismatch = ModelMismatch(mass=1.1, inertia=0.8, com=[0.01, -0.02, 0.03])
    plant = Plant(robot, mismatch=mismatch, shapes=False)
    model = robot.model.copy()
    for j in range(1, model.njoints):
        body = robot.model.inertias[j]
        lever = body.lever + ([0.01, -0.02, 0.03] if j == 1 else np.zeros(3))
        model.inertias[j] = pin.Inertia(1.1 * body.mass, lever, 1.1 * 0.8 * body.inertia)
    for _ in range(3):
        q, v = random_state(robot, rng)
        plant.reset(q, v)
        M = pin.crba(model, model.createData(), q)
        M = np.triu(M) + np.triu(M, 1).T
        h = pin.nonLinearEffects(model, model.createData(), q, v)
        found = mass_and_bias(plant, q, v)
        np.testing.assert_allclose(found[0], M, atol=1e-12 * np.abs(M).max())
        np.testing.assert_allclose(found[1], h, atol=1e-12 * np.abs(h).max())


def test_spreads_are_within_bounds_and_follow_the_seed() -> None:
    robot = load("g1")
    masses = robot.model.inertias.tolist()
    plain = np.array([body.mass for body in masses][1:])

    def built(seed: int) -> Plant:
        mismatch = ModelMismatch(mass_spread=0.1, inertia_spread=0.2, com_spread=0.01, seed=seed)
        return Plant(robot, mismatch=mismatch, shapes=False)

    first, again, other = built(1), built(1), built(2)
    ids = [first.model.body(f"body {j}").id for j in range(1, robot.model.njoints)]
    factors = first.model.body_mass[ids] / plain
    assert factors.min() >= 0.9 and factors.max() <= 1.1 and np.ptp(factors) > 0.1
    levers = np.array([body.lever for body in masses][1:])
    shifts = first.model.body_ipos[ids] - levers
    assert np.abs(shifts).max() <= 0.01 and np.abs(shifts).max() > 0.005
    exact = Plant(robot, shapes=False)
    stretch = first.model.body_inertia[ids] / exact.model.body_inertia[ids] / factors[:, None]
    assert stretch.min() >= 0.8 - 1e-12 and stretch.max() <= 1.2 + 1e-12
    np.testing.assert_allclose(np.ptp(stretch, axis=1), 0.0, atol=1e-12)  # of a link as a whole
    assert first.model.body_mass.tobytes() == again.model.body_mass.tobytes()
    assert first.model.body_mass.tobytes() != other.model.body_mass.tobytes()


def test_the_friction_of_the_ground() -> None:
    robot = load("hoap2_like")
    plant = Plant(robot, terrain=Terrain(friction=0.5), mismatch=ModelMismatch(friction=0.6))
    assert plant.model.geom("ground").friction[0] == pytest.approx(0.3)


def test_options_are_plain_data() -> None:
    mismatch = pickle.loads(pickle.dumps(ModelMismatch(mass=1.1, seed=4)))
    assert (mismatch.mass, mismatch.seed) == (1.1, 4)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"mass": 0.0}, "mass"),
        ({"mass_spread": 1.0}, "mass_spread"),
        ({"com": [1.0, 2.0]}, "com"),
        ({"friction": -0.1}, "friction"),
        ({"seed": True}, "seed"),
    ],
)
def test_mistakes_are_typed(options: dict[str, object], words: str) -> None:
    with pytest.raises(InvalidInputError, match=words):
        ModelMismatch(**options)
