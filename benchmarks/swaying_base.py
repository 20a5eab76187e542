"""A base with an IMU that sways over two standing feet: a world that matches the filter's model."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from wbc.estimation import ContactFilter, FilterNoise
from wbc.rotations import exp_rotation
from wbc.validate import Array

G = np.array((0.0, 0.0, -9.81))
NOISE = FilterNoise(1e-3, 1e-2, 1e-4, 1e-3, 5e-3, 5e-3)
PLACE = np.diag(np.repeat((1e-3, 2e-3), 3) ** 2)  # of a foot's measurement [m^2, rad^2]
PRIOR = np.diag(np.repeat((0.05, 0.1, 1e-9, 0.02, 0.1), 3) ** 2)
PRIOR[2, 2] = 1e-18  # the heading is the world's reference
DT = 0.005  # s
MIDDLE = np.array((0.0, 0.0, 0.8))


class FootPose(NamedTuple):
    """A measurement of a foot, (12,) in the IMU's axes, with its covariance."""

    place: Array
    noise: Array


class Moment(NamedTuple):
    """A moment of the world: the truth, the IMU's reading until then, and measurements of feet."""

    R: Array
    v: Array
    p: Array
    biases: Array
    rate: Array
    force: Array
    feet: tuple[FootPose, FootPose]


class Start(NamedTuple):
    """A filter's initial estimate, wrong by the prior."""

    R: Array
    v: Array
    p: Array
    covariance: Array
    feet: tuple[FootPose, FootPose]

    def filter(self) -> ContactFilter:
        """Return the filter there, with both feet held."""
        f = ContactFilter(2, NOISE)
        f.reset(self.R, self.p, self.v, covariance=self.covariance)
        for k, one in enumerate(self.feet):
            f.hold(k, *one)
        return f


def swaying(
    seed: int, steps: int, swing: float = 1.0, prior: Array = PRIOR
) -> tuple[Start, Iterator[Moment]]:
    """Return a filter's start, with biases 0, and the moments that follow."""
    rng = np.random.default_rng(seed)
    wrong = rng.normal(size=15) * np.sqrt(np.diag(prior))
    feet = [(np.array((0.0, y, 0.0)), np.eye(3)) for y in (0.1, -0.1)]
    begun = _seen(rng, np.eye(3), MIDDLE, feet)
    start = Start(exp_rotation(wrong[:3]), wrong[3:6], MIDDLE + wrong[6:9], prior, begun)
    return start, _moments(rng, steps, swing, -wrong[9:], feet)


def _moments(
    rng: np.random.Generator,
    steps: int,
    swing: float,
    biases: Array,
    feet: list[tuple[Array, Array]],
) -> Iterator[Moment]:
    R, v, p, noise = np.eye(3), np.zeros(3), MIDDLE, NOISE
    white = np.repeat((noise.gyroscope, noise.accelerometer), 3) / np.sqrt(DT)
    walk = np.repeat((noise.gyroscope_walk, noise.accelerometer_walk), 3) * np.sqrt(DT)
    phases = rng.uniform(0, 2 * np.pi, 6)
    for i in range(steps):
        t = i * DT
        rate = swing * np.array((0.6, 0.5, 0.4)) * np.sin(3.1 * t + phases[:3])
        acceleration = swing * np.array((1.0, 0.8, 0.6)) * np.sin(4.3 * t + phases[3:])
        acceleration -= 4.0 * v + 4.0 * (p - MIDDLE)  # it stays over its feet
        force = (R @ exp_rotation(0.5 * DT * rate)).T @ (acceleration - G)
        said = np.concatenate((rate, force)) + biases + white * rng.normal(size=6)
        p = p + DT * v + 0.5 * DT * DT * acceleration
        v, R = v + DT * acceleration, R @ exp_rotation(DT * rate)
        biases = biases + walk * rng.normal(size=6)
        moved = np.sqrt(DT) * rng.normal(size=(2, 6)) * np.repeat((noise.creep, noise.roll), 3)
        feet = [
            (d + step[:3], exp_rotation(step[3:]) @ own)
            for (d, own), step in zip(feet, moved, strict=True)
        ]
        yield Moment(R, v, p, biases, said[:3], said[3:], _seen(rng, R, p, feet))


def _seen(
    rng: np.random.Generator, R: Array, p: Array, feet: list[tuple[Array, Array]]
) -> tuple[FootPose, FootPose]:
    found = []
    for d, own in feet:
        off = rng.normal(size=6) * np.sqrt(np.diag(PLACE))
        turned = exp_rotation(off[3:]) @ R.T @ own
        found.append(FootPose(np.concatenate((R.T @ (d - p) + off[:3], turned.ravel())), PLACE))
    return found[0], found[1]
