"""A recorded human walk against force plates, and its pendulum during a step.

The recording is not part of the project: markers and force plates of a walk, such as comes with
OpenSim's full-body model of Rajagopal et al. (2016), in any format that `wbc analyze` reads.
Results are from the motion alone, and with segments' masses and centres fitted to the plates in one
half of the frames and tested in the other.

    python benchmarks/human_walk.py walk.trc --forces walk_grf.mot [--static static.trc]
        [-o benchmarks/human_walk.json] [--plot PICTURE]
    python benchmarks/human_walk.py --many *.c3d *.trc -o benchmarks/human_walks.json

With ``--many`` only the figures of each; forces of a TRC are those of the MOT with the same name.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from wbc.human import Comparison, HumanMotion, compared, human_motion, read_markers
from wbc.human.body import SEGMENT_NAMES, masses
from wbc.human.contacts import HARMONICS
from wbc.motion import RmpSeries, analyze
from wbc.view.human import human_figure, momentum_scale
from wbc.view.style import save

# Walks on which the constants of wbc/human/roll_over.py and residual_noise.py were chosen; the
# others check them.
CHOSEN_ON = (
    "opencap_walking1",
    "btk_Gait",
    "opensim_test_walking",
    *(f"biomechzoo_HC0{one}" for one in ("02D06", "31A06", "33A10", "38A11", "44A15", "55A09")),
)
# Walks of children who turn by 90 degrees, with few frames of plates: in neither set.
TURNS = tuple(
    f"biomechzoo_HC0{one}"
    for one in (
        *("02D25", "30A22", "31A23", "32A18", "33A22", "36A23"),
        *("38A27", "39A31", "40A40", "44A29", "50A33", "55A34"),
    )
)
MEANS = ("horizontal_percent_of_peak", "cop_single_mm", "cop_double_mm", "within_all_bands_percent")
CUTOFFS = (4.0, 4.5, 5.0, 5.5, 6.0, 8.0, 10.0)  # Hz
TABLE = 0.10  # standard deviation of a segment's mass from the table's
CENTRE = 0.015  # m, of its centre
FORCE, MOMENT = 10.0, 15.0  # N, N m: standard deviations of a fit's residuals


def analyzed(human: HumanMotion, cutoff: float | None = None) -> tuple[RmpSeries, Comparison]:
    """Return a human's series and its comparison with the plates."""
    series = analyze(
        human.motion,
        cutoff=human.cutoff if cutoff is None else cutoff,
        noise=human.noise,
        ground_height=human.ground_height,
    )
    found = compared(series, human.recording.plates, human.down, human.motion.time)
    assert found is not None, "the plates never have all of the force"
    return series, found


def figures(found: Comparison) -> dict[str, Any]:
    """Return the figures of merit, in percent and mm."""
    return {
        "frames": len(found.time),
        "vertical_percent_of_peak": 100.0 * found.vertical,
        "horizontal_percent_of_peak": 100.0 * found.horizontal,
        "cop_single_mm": 1e3 * found.cop_rms(True),
        "cop_double_mm": 1e3 * found.cop_rms(False),
        "plates_late_ms": 1e3 * found.late,
        "within_bands_percent": {name: 100.0 * part for name, part in found.held.items()},
        "within_all_bands_percent": 100.0 * float(np.mean(list(found.held.values()))),
    }


def step_figures(human: HumanMotion, series: RmpSeries, found: Comparison) -> dict[str, Any]:
    """Return the pendulum's changes in the compared frames, and segments' cancellation."""
    inner = (series.time >= found.time[0]) & (series.time <= found.time[-1])
    height = float(series.com[inner, 2].mean()) - series.ground_height
    scale = momentum_scale(series)
    k = series.momentum[inner, 3:]
    parts = segment_momenta(human, series)[:, inner]
    legs = [SEGMENT_NAMES.index(f"left_{part}") for part in ("thigh", "shank", "foot")]
    radii = 1e3 * series.radii[inner]
    long = series.axes[inner, :, 0]
    tilt = np.degrees(np.arccos(np.clip(np.abs(long[:, 2]), 0.0, 1.0)))
    apart = np.linalg.norm((series.cmp - series.cop)[inner], axis=1)
    speed = float(series.com_velocity[inner, :2].mean(axis=0) @ _ahead(series, inner))
    return {
        "speed_m_per_s": speed,
        "com_height_mm": [1e3 * height, 1e3 * float(np.ptp(series.com[inner, 2]))],
        "radii_mm": [[float(r.min()), float(r.max())] for r in radii.T],
        "tilt_of_the_long_axis_deg": [float(tilt.min()), float(tilt.max())],
        "angular_momentum_peak": [float(v) for v in np.abs(k).max(axis=0) / scale],
        "of_one_leg_peak": [float(v) for v in np.abs(parts[legs].sum(axis=0)).max(axis=0) / scale],
        "cancelled_percent": [
            float(100.0 * (1.0 - a / b))
            for a, b in zip(
                np.abs(k).mean(axis=0), np.abs(parts).sum(axis=0).mean(axis=0), strict=True
            )
        ],
        "cmp_to_cop_mm": float(1e3 * apart.max()),
    }


def _ahead(series: RmpSeries, inner: np.ndarray) -> np.ndarray:
    way = series.com[inner][-1, :2] - series.com[inner][0, :2]
    return np.asarray(way / np.linalg.norm(way))


def segment_momenta(human: HumanMotion, series: RmpSeries) -> np.ndarray:
    """Return each segment's angular momentum about the whole CoM (s, n, 3) [kg m^2/s]."""
    at, spin, parts = segment_motion(human, series)
    momenta = []
    for k, name in enumerate(SEGMENT_NAMES):
        velocity = make_interp_spline(series.time, at[k], k=5)(series.time, 1)
        orbit = np.cross(at[k] - series.com, parts[name].mass * (velocity - series.com_velocity))
        momenta.append(orbit + spin[k])
    return np.array(momenta)


def segment_motion(
    human: HumanMotion, series: RmpSeries
) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
    """Return segments' centres and own angular momenta (s, n, 3), and their masses."""
    robot, parts = human.motion.robot, masses(human.body)
    at = np.empty((len(SEGMENT_NAMES), len(series), 3))
    spin = np.empty_like(at)
    for frame, (q, v) in enumerate(zip(series.q, series.v, strict=True)):
        state = robot.snapshot(q, v)
        for k, name in enumerate(SEGMENT_NAMES):
            position, R = state.placement(name)
            at[k, frame] = position + R @ parts[name].centre
            turning = state.jacobian(name)[3:] @ v
            spin[k, frame] = R @ parts[name].inertia @ R.T @ turning
    return at, spin, parts


def fitted_on_one_half(human: HumanMotion, series: RmpSeries, found: Comparison) -> dict[str, Any]:
    """Return errors in one half of the frames with masses and centres fitted in the other."""
    at, spin, parts = segment_motion(human, series)
    index = np.searchsorted(series.time, found.time)
    names = [n for n in SEGMENT_NAMES if not n.startswith("right_")]
    groups = [
        [SEGMENT_NAMES.index(n)]
        + ([SEGMENT_NAMES.index(n.replace("left_", "right_"))] if n.startswith("left_") else [])
        for n in names
    ]
    columns = [_wrench(series, at[g], [parts[SEGMENT_NAMES[k]].mass for k in g]) for g in groups]
    trunk = SEGMENT_NAMES.index("trunk")
    # A trunk whose centre is elsewhere along its own axes, x and z.
    rotation = np.array([human.motion.robot.snapshot(q).rotation("trunk") for q in series.q])
    for axis in (0, 2):
        moved = at[[trunk]] + CENTRE * rotation[None, :, :, axis]
        there, here = (_wrench(series, one, [parts["trunk"].mass]) for one in (moved, at[[trunk]]))
        columns.append((there - here) / TABLE)
    A = TABLE * np.stack(columns, axis=2)[index]  # (m, 6, p)
    force, cop = found.force, found.cop
    whole = _wrench(series, at, [parts[n].mass for n in SEGMENT_NAMES])
    spins = make_interp_spline(series.time, spin.sum(axis=0), k=5)(series.time, 1)
    whole[:, 3:] += spins
    free = np.cross(np.column_stack((cop, np.full(len(cop), series.ground_height))), force)
    rest = np.hstack((force, free)) - whole[index]
    use = np.array((0, 1, 2, 3, 4))
    sizes = np.array((FORCE, FORCE, FORCE, MOMENT, MOMENT))
    half = np.arange(len(index)) < len(index) // 2
    answer = {}
    for name, train in (("first", half), ("second", ~half)):
        M = (A[train][:, use] / sizes[:, None]).reshape(-1, A.shape[2])
        y = (rest[train][:, use] / sizes).ravel()
        changes = np.linalg.solve(M.T @ M + np.eye(A.shape[2]), M.T @ y)
        judged = ~train
        for kind, by in (("table", 0.0), ("fitted", 1.0)):
            off = rest[judged] - by * A[judged] @ changes
            now = force[judged] - off[:, :3]
            moment = np.hstack((now, free[judged] - off[:, 3:]))
            spot = np.column_stack((-moment[:, 4], moment[:, 3])) / moment[:, 2:3]
            spot += moment[:, :2] / moment[:, 2:3] * series.ground_height
            answer.setdefault(f"fitted in the {name} half", {})[kind] = {
                "vertical_percent_of_peak": 100.0 * _rms(off[:, 2]) / force[:, 2].max(),
                "horizontal_percent_of_peak": 100.0
                * _rms(np.linalg.norm(off[:, :2], axis=1))
                / np.linalg.norm(force[:, :2], axis=1).max(),
                "cop_mm": 1e3 * _rms(np.linalg.norm(spot - cop[judged], axis=1)),
            }
    return answer


def _wrench(series: RmpSeries, at: np.ndarray, each: list[float]) -> np.ndarray:
    """Return force and moment about the origin (n, 6) that move points (s, n, 3) of masses."""
    found = np.zeros((len(series), 6))
    for place, mass in zip(at, each, strict=True):
        push = make_interp_spline(series.time, place, k=5)(series.time, 2)
        push = mass * (push + [0.0, 0.0, series.robot.gravity])
        found += np.hstack((push, np.cross(place, push)))
    return found


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def rounded(value: Any) -> Any:
    """Return the same with four digits of each number."""
    if isinstance(value, dict):
        return {name: rounded(part) for name, part in value.items()}
    if isinstance(value, list):
        return [rounded(part) for part in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def judged(path: Path) -> dict[str, Any]:
    """Return the figures of one more recording."""
    forces = path.with_suffix(".mot") if path.suffix == ".trc" else None
    recording = read_markers(path, forces=forces)
    human = human_motion(recording)
    return {
        "mass_kg": human.body.mass,
        "stature_m": human.body.stature,
        "markers_mm": 1e3 * human.rms,
        **figures(analyzed(human)[1]),
        "by_markers_alone": figures(analyzed(human_motion(recording, by_steps=False))[1]),
    }


def means(half: list[dict[str, Any]]) -> dict[str, list[float]]:
    """Return means over walks: by markers alone, all. Without those that have no such frames."""
    alone = [row["by_markers_alone"] for row in half]
    return {
        key: [float(np.nanmean([row[key] for row in part])) for part in (alone, half)]
        for key in MEANS
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path, nargs="?")
    parser.add_argument("--forces", type=Path)
    parser.add_argument("--static", type=Path)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--many", type=Path, nargs="+", help="recordings, of each less")
    options = parser.parse_args()
    if options.many is not None:
        rows = {path.stem: judged(path) for path in options.many}
        groups = {"chosen on": list[dict[str, Any]](), "others": [], "turns": []}
        for name, row in rows.items():
            kind = "chosen on" if name in CHOSEN_ON else "turns" if name in TURNS else "others"
            groups[kind].append(row)
        rows |= {kind: means(half) for kind, half in groups.items() if half}
        text = json.dumps(rounded(rows), indent=1)
        print(text)
        options.output.write_text(text + "\n")
        return
    recording = read_markers(options.recording, forces=options.forces)
    static = None if options.static is None else read_markers(options.static)
    human = human_motion(recording, static=static)
    series, found = analyzed(human)
    answer = {
        "body": {"stature_m": human.body.stature, "mass_kg": human.body.mass},
        "markers_mm": 1e3 * human.rms,
        "steps_per_minute": 60.0 * human.cutoff / HARMONICS,
        "cutoff_hz": human.cutoff,
        "against_plates": figures(found),
        "by_markers_alone": figures(
            analyzed(human_motion(recording, static=static, by_steps=False))[1]
        ),
        "without_static_trial": figures(analyzed(human_motion(recording))[1]),
        "by_cutoff": {str(c): figures(analyzed(human, c)[1]) for c in CUTOFFS},
        "halves": fitted_on_one_half(human, series, found),
        "step": step_figures(human, series, found),
    }
    text = json.dumps(rounded(answer), indent=1)
    print(text)
    if options.output is not None:
        options.output.write_text(text + "\n")
    if options.plot is not None:
        title = f"A human of {human.body.stature:.2f} m and {human.body.mass:.1f} kg walks"
        save(human_figure(series, found, title=title), options.plot)


if __name__ == "__main__":
    main()
