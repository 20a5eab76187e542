"""How good, how consistent and how fast the state estimator is.

``nis``: in a world that matches the filter's model (:mod:`swaying_base`), 1000 runs of 400
corrections by two feet: how many have a normalised innovation squared within its 95 % bounds of
chi-square (of 100 runs alone it is 95 +- 2 by chance), and the remaining errors of the biases.

``plain``: the same world, from a start wrong by 20 degrees of tilt (one deviation, each axis), 5
degrees of heading and 0.5 m/s, by the invariant filter and by a plain one (:mod:`plain_filter`):
errors in the first second and after, and in how many runs the heading's error exceeds twice the
deviation stated by the filter.

``walk``: a G1 in MuJoCo walks at 1.0 m/s for 20 steps on its estimated state alone, its masses
wrong by up to 10 %: an IMU in the pelvis, encoders, motor torques; no foot forces.

``slip``: a G1 stands, and a hip moves its foot 2 cm sideways in 25 to 250 ms: errors of the
estimated position and velocity, also in standard deviations stated by the filter.

``rate``: messages of such a walk through a second estimator, in this thread's CPU time.

    python benchmarks/estimation.py JOURNAL.jsonl [--only nis plain walk slip rate] [--seeds 10]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import math
import platform
from collections.abc import Iterator
from pathlib import Path
from time import thread_time
from typing import Any

import numpy as np
from disturbed import DT, robot_named, sensed_plant_of
from plain_filter import PlainFilter
from scipy.stats import chi2
from sources import code_of
from swaying_base import DT as STEP
from swaying_base import NOISE, PRIOR, swaying

import wbc
from wbc.estimation import ImuMount, ImuReading, Measurement, StateEstimator
from wbc.gait import Walker
from wbc.journal import Journal
from wbc.rotations import log_rotation
from wbc.simulation import Terrain

GROUPS = ("nis", "plain", "walk", "slip", "rate")
RUNS, CORRECTIONS = 1000, 400
SPEED, WALKED = 1.0, 20  # m/s, steps
FAR_OFF = PRIOR.copy()
FAR_OFF[[0, 1], [0, 1]], FAR_OFF[[3, 4, 5], [3, 4, 5]] = math.radians(20.0) ** 2, 0.5**2
FAR_OFF[2, 2] = math.radians(5.0) ** 2
MADE_OF = {"wbc": wbc.__version__, "code": code_of(), "dt": DT, "speed": SPEED}


def consistency(seed: int) -> dict[str, Any]:
    """NIS of a run against its 95 % bounds, and errors of biases against their deviations."""
    start, moments = swaying(seed, CORRECTIONS, 1.5)
    f, total = start.filter(), 0.0
    for now in moments:
        f.predict(now.rate, now.force, STEP)
        total += sum(f.correct(k, *one).squared for k, one in enumerate(now.feet))
    low, high = chi2.ppf((0.025, 0.975), 12 * CORRECTIONS)
    off = np.concatenate((f.gyroscope_bias, f.accelerometer_bias)) - now.biases
    return {
        "nis": total / (12 * CORRECTIONS),
        "inside": bool(low < total < high),
        "gyroscope": float(np.linalg.norm(off[:3])),
        "gyroscope before": float(np.linalg.norm(now.biases[:3])),
        "accelerometer": float(np.linalg.norm(off[3:])),
        "accelerometer before": float(np.linalg.norm(now.biases[3:])),
    }


def compare_with_plain(seed: int) -> dict[str, Any]:
    """Errors of both filters from a large initial error."""
    start, moments = swaying(1000 + seed, 1000, 1.0, FAR_OFF)
    f = start.filter()
    plain = PlainFilter(NOISE, start.R, start.v, start.p, start.covariance)
    for one in start.feet:
        plain.hold(*one)
    errors = []
    for now in moments:
        f.predict(now.rate, now.force, STEP)
        plain.predict(now.rate, now.force, STEP)
        for k, one in enumerate(now.feet):
            f.correct(k, *one)
            plain.correct(k, *one)
        row = []
        for R, v in ((f.rotation, f.velocity), (plain.R, plain.v)):
            turn = log_rotation(R @ now.R.T)
            row += [float(np.linalg.norm(v - now.v)), float(np.hypot(*turn[:2])), float(turn[2])]
        errors.append(row)
    table, second = np.array(errors), round(1.0 / STEP)
    up = plain.R[2]  # the heading's variance: of a turn about the vertical, in the body's axes
    said = math.sqrt(f.covariance[2, 2]), math.sqrt(float(up @ plain.P[:3, :3] @ up))
    found: dict[str, Any] = {}
    for n, name in enumerate(("invariant", "plain")):
        squares = table[:, 3 * n : 3 * n + 2] ** 2
        found[f"{name} first"] = np.sqrt(squares[:second].mean(axis=0)).tolist()
        found[f"{name} after"] = np.sqrt(squares[second:].mean(axis=0)).tolist()
        found[f"{name} heading"] = abs(float(table[-1, 3 * n + 2])) / said[n]
    return found


def walk_estimated(
    seed: int, keep: list[Measurement] | None = None, steps: int = WALKED
) -> dict[str, Any]:
    """Walk on the estimated state; ``keep`` collects the messages, if given."""
    robot = robot_named("g1")
    plant = sensed_plant_of(robot, seed, Terrain(), robot.posture("standing"))
    if keep is not None:
        update = plant.estimator.update

        def kept(message: Measurement) -> Any:
            keep.append(message)
            return update(message)

        plant.estimator.update = kept  # type: ignore[method-assign]
        plant.reset(robot.posture("standing"))
    walker = Walker(robot, dt=DT)
    while walker.steps < steps and plant.time < 60.0:
        if plant.time >= 0.2 and walker.wanted.at_rest:
            walker.command(SPEED)
        state = plant.measure()
        assert state is not None  # no message is lost here
        plant.step(walker.step(robot.snapshot(*state), plant.felt_forces).torque)
        if plant.com[2] < 0.4:
            break
    errors = plant.errors
    return {
        "stood": bool(plant.com[2] > 0.5),
        "made": walker.steps,
        "velocity": errors.velocity,
        "tilt": math.degrees(errors.tilt),
        "yaw": math.degrees(errors.yaw),
        "way": errors.way,
        "drift": errors.drift / max(errors.way, 1e-9),
        "normalised": errors.normalised,
        "nis": errors.innovation,
        "told": sum(plant.told.values()),
    }


def slip_foot(seed: int) -> dict[str, Any]:
    """Move a foot 2 cm sideways while the base stands, with a duration by the seed."""
    robot, rng = robot_named("g1"), np.random.default_rng(seed)
    q, time = robot.posture("standing"), float(np.geomspace(0.025, 0.25, 10)[seed % 10])
    side = ("left", "right")[seed % 2]
    J = robot.snapshot(q).jacobian(robot.feet[side].frame)
    joint = robot.joint_index(f"{side}_hip_roll_joint")
    angle = 0.02 / abs(float(J[1, joint]))
    estimator, worst = StateEstimator(robot, ImuMount("imu", "imu_in_pelvis"), dt=DT), np.zeros(4)
    estimator.reset(q)
    contacts = dict.fromkeys(robot.feet, True)
    for k in range(750):
        positions = q[7:] + 1e-4 * rng.normal(size=robot.nv - 6)
        positions[joint - 6] += angle * min(max(k * DT - 1.0, 0.0) / time, 1.0)
        white = rng.normal(size=6) * np.repeat((1.2e-4, 1.2e-3), 3) / math.sqrt(DT)
        reading = ImuReading("imu", white[:3], white[3:] + (0.0, 0.0, 9.81))
        found = estimator.update(Measurement(k * DT, positions, imus=(reading,), contacts=contacts))
        if found is None or k * DT < 1.0:
            continue
        off, speed = found.q[:3] - q[:3], found.v[:3]
        P = found.covariance
        worst = np.maximum(
            worst,
            (
                np.linalg.norm(off),
                np.linalg.norm(speed),
                math.sqrt(off @ np.linalg.solve(P[6:9, 6:9], off) / 3.0),
                math.sqrt(speed @ np.linalg.solve(P[3:6, 3:6], speed) / 3.0),
            ),
        )
    names = ("position", "velocity", "position in deviations", "velocity in deviations")
    return {"time": time, **dict(zip(names, worst.tolist(), strict=True))}


def rate(seed: int) -> dict[str, Any]:
    """Samples a second through an estimator, the best of three, since others use the machine."""
    sent: list[Measurement] = []
    walk_estimated(seed, sent, 8)
    robot, best = robot_named("g1"), {}
    for name, change in (("torques", {}), ("no torques", {"torques": None})):
        times = []
        contacts = {} if name == "torques" else {"contacts": dict.fromkeys(robot.feet, True)}
        given = [Measurement(**{**m.__dict__, **change, **contacts}) for m in sent]
        for _ in range(5):
            estimator = StateEstimator(robot, ImuMount("imu", "imu_in_pelvis"), dt=DT)
            began = thread_time()
            for message in given:
                estimator.update(message)
            times.append(thread_time() - began)
        best[name] = len(given) / min(times)
    return {"samples": len(sent), "processor": platform.processor() or platform.machine(), **best}


def measured(groups: list[str], seeds: int) -> Iterator[tuple[str, int, Any]]:
    """Yield groups, seeds and their measurements."""
    made = {
        "nis": (consistency, RUNS),
        "plain": (compare_with_plain, 20),
        "walk": (walk_estimated, seeds),
        "slip": (slip_foot, 10),
        "rate": (rate, 1),
    }
    for group in groups:
        function, count = made[group]
        for seed in range(count):
            yield group, seed, function


def table(rows: list[dict[str, Any]]) -> str:
    """Return the results in words."""
    by = {group: [row for row in rows if row["group"] == group] for group in GROUPS}
    lines = []
    if found := by["nis"]:
        inside = sum(row["inside"] for row in found)
        mean = np.mean([row["nis"] for row in found])
        chance = 0.95 * len(found), math.sqrt(0.95 * 0.05 * len(found))
        lines.append(
            f"nis    {inside} of {len(found)} runs inside 95 % bounds ({chance[0]:.0f} +-"
            f" {chance[1]:.0f} by chance), mean {mean:.4f}"
        )
        for name in ("gyroscope", "accelerometer"):
            first, last = (
                math.sqrt(np.mean([row[key] ** 2 for row in found]))
                for key in (f"{name} before", name)
            )
            lines.append(f"       bias of the {name}: {first:.4f} at first, {last:.4f} at the end")
    if found := by["plain"]:
        for name in ("invariant", "plain"):
            one = [
                np.sqrt(np.mean([np.square(row[f"{name} {when}"]) for row in found], axis=0))
                for when in ("first", "after")
            ]
            wrong = sum(row[f"{name} heading"] > 2.0 for row in found)
            texts = [f"{v:.3f} m/s, {math.degrees(t):.2f} deg" for v, t in one]
            lines.append(
                f"plain  {name:10} first second {texts[0]}; after {texts[1]};"
                f" heading beyond 2 deviations in {wrong} of {len(found)}"
            )
    if found := by["walk"]:
        for key, unit in (("velocity", "m/s"), ("tilt", "deg"), ("drift", "of the way")):
            values = [row[key] for row in found]
            lines.append(
                f"walk   {key:9} rms {math.sqrt(np.mean(np.square(values))):.4f} {unit},"
                f" worst {max(values):.4f}"
            )
        stood = sum(row["stood"] and row["made"] >= WALKED for row in found)
        nees = np.mean([row["normalised"] for row in found], axis=0)
        nis = np.mean([row["nis"] for row in found])
        way = np.mean([row["way"] for row in found])
        lines.append(
            f"       {stood} of {len(found)} walked {way:.1f} m; squares by what is said:"
            f" velocity {nees[0]:.2f}, tilt {nees[1]:.2f}, innovations {nis:.2f}"
        )
    if found := by["slip"]:
        for key in ("position", "velocity", "position in deviations", "velocity in deviations"):
            lines.append(f"slip   {key}: at most {max(row[key] for row in found):.4f}")
    for row in by["rate"]:
        lines.append(
            f"rate   {row['torques']:.0f} samples/s with forces from torques,"
            f" {row['no torques']:.0f} with foot switches ({row['processor']})"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("journal", type=Path)
    parser.add_argument("--only", nargs="+", default=list(GROUPS), choices=GROUPS)
    parser.add_argument("--seeds", type=int, default=10)
    given = parser.parse_args()
    with Journal(given.journal, MADE_OF) as journal:
        rows = list(journal.entries)
        known = {(row["group"], row["seed"]) for row in rows}
        for group, seed, function in measured(given.only, given.seeds):
            if (group, seed) not in known:
                row = {"group": group, "seed": seed, **function(seed)}
                journal.add(row)
                rows.append(row)
    print(table([row for row in rows if row["group"] in given.only]))


if __name__ == "__main__":
    main()
