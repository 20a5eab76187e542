"""Effects of noise on `wbc analyze`: how often its 95 % bands hold the truth, and a picture.

A G1 stands on its left foot and swings its arms; its joints are recorded at 200 Hz with white noise
of 1 mrad, and nothing else (the base follows from the planted foot). Trials of other noise are
compared with the analysis of the motion without noise. The picture shows the first of them: without
bands, with them, and at the cutoff of residual analysis.

    python benchmarks/noise.py [--trials 50] [-o benchmarks/noise.json] [--plot PICTURE]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

from wbc.motion import Motion, RmpSeries, analyze
from wbc.motion.uncertainty import BAND
from wbc.robot import Robot
from wbc.view import style
from wbc.view.analysis_plots import plot_margin

RATE, SECONDS, NOISE, SWING = 200.0, 6.0, 1e-3, 0.15  # Hz, s, rad, rad
RIGHT = {"right_hip_pitch_joint": -0.7, "right_knee_joint": 1.0, "right_ankle_pitch_joint": -0.3}
UPPER = {"waist_roll_joint": -0.3, "left_shoulder_roll_joint": 0.6}
ARMS = ("left_shoulder_pitch_joint", "right_shoulder_pitch_joint")
QUANTITIES = (
    *("cop", "cop_margin", "momentum", "momentum_rate", "leg_angles", "semi_axes"),
    "average_angular_velocity",
)
VARIANTS: dict[str, dict[str, Any]] = {
    "low-pass at 10 Hz, without bands": {"noise": None},
    "low-pass at 10 Hz": {},
    "cutoff by residual analysis": {"cutoff": "residual"},
}


def on_one_foot(robot: Robot) -> Motion:
    """Return the motion without noise: CoM over the left foot, arms swinging at 0.5 Hz."""

    def leaning(angle: float) -> np.ndarray:
        legs = {"left_hip_roll_joint": angle, "left_ankle_roll_joint": -angle}
        return robot.posture(
            "standing", {**legs, **RIGHT, **UPPER, "right_hip_roll_joint": angle - 0.1}
        )

    def beside(angle: float) -> float:
        snapshot = robot.snapshot(leaning(angle))
        return float(snapshot.com[1] - snapshot.position(robot.feet["left"].frame)[1])

    time = np.arange(int(RATE * SECONDS)) / RATE
    stand = robot.limits.joint_positions(leaning(float(brentq(beside, -0.26, 0.26))))
    joints = np.tile(stand, (len(time), 1))
    for name in ARMS:
        joints[:, robot.joint_names.index(name)] += SWING * np.sin(np.pi * time)
    return Motion(robot, time, joints, source="one foot")


def noisy(motion: Motion, seed: int) -> Motion:
    """Return the motion with noise on all joints."""
    noise = NOISE * np.random.default_rng(seed).normal(size=motion.joints.shape)
    return Motion(motion.robot, motion.time, motion.joints + noise, source=motion.source)


def coverages(motion: Motion, trials: int) -> dict[str, float]:
    """Return the percentage of the frames of all trials with the truth within the band."""
    truth = analyze(motion, planted="left", noise=None)
    found: dict[str, list[float]] = {name: [] for name in QUANTITIES}
    for seed in range(trials):
        series = analyze(noisy(motion, seed), planted="left")
        for name in QUANTITIES:
            band = BAND * getattr(series.uncertainty, name)
            error = np.abs(getattr(series, name) - getattr(truth, name))
            within = (error[:, :2] if name == "cop" else error) <= band
            found[name].append(float(within.mean()))
    return {name: round(100.0 * float(np.mean(shares)), 1) for name, shares in found.items()}


def judged(series: RmpSeries) -> dict[str, float | int | None]:
    """Return an analysis's figures of the CoP [mm, Hz]."""
    margin, uncertainty = series.cop_margin, series.uncertainty
    assert margin is not None
    deviation = None if uncertainty is None else uncertainty.cop_margin
    return {
        "cutoff": None if series.cutoff is None else round(series.cutoff, 2),
        "frames": len(series),
        "outside": int(series.cop_outside.sum()),
        "infeasible": int(series.infeasible.sum()),
        "least_margin": round(1e3 * float(margin.min()), 1),
        "band": None if deviation is None else round(1e3 * BAND * float(np.median(deviation)), 1),
    }


def draw(found: dict[str, RmpSeries], path: Path) -> None:
    """Draw the CoP's margin of each variant beside the others."""
    figure = style.sheet(10.0, 2.7, "A G1 on one foot, joints recorded with 1 mrad of noise", 2.35)
    for axes, (name, series) in zip(figure.subplots(1, len(found)), found.items(), strict=True):
        plot_margin(axes, series, [])
        says = f"infeasible in {int(series.infeasible.sum())} of {len(series)} frames"
        axes.set_title(f"{name}\n{says}", loc="left", fontsize=style.SMALL, color=style.BLACK)
        axes.set_ylabel("CoP inside by [mm]", fontsize=style.SMALL, color=style.BLACK)
    style.save(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).with_suffix(".json"))
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    clean = on_one_foot(Robot.load("g1"))
    first = noisy(clean, 0)
    found = {name: analyze(first, planted="left", **how) for name, how in VARIANTS.items()}
    result = {
        "without noise": judged(analyze(clean, planted="left")),
        "with 1 mrad": {name: judged(series) for name, series in found.items()},
        "trials": options.trials,
        "per cent within the 95 % band": coverages(clean, options.trials),
    }
    options.output.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))
    if options.plot is not None:
        draw(found, options.plot)


if __name__ == "__main__":
    main()
