"""A human that marches on the spot, its markers and its ground force: known, smooth motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wbc.human.body import HINGE_NAMES, HINGES, SEGMENT_NAMES, HumanBody, masses
from wbc.human.kinematics import Poses, forward_kinematics, rotations
from wbc.human.landmarks import landmark, landmark_of
from wbc.human.markers import ForcePlate, MarkerRecording
from wbc.validate import Array

RATE = 100.0
# Plug-in Gait.
LABELS = (  # noqa: SIM905
    "LASI RASI LPSI RPSI C7 T10 CLAV STRN LSHO RSHO LELB RELB LWRA LWRB RWRA RWRB LFIN RFIN"
    " LFHD RFHD LBHD RBHD LTHI RTHI LKNE RKNE LTIB RTIB LANK RANK LHEE RHEE LTOE RTOE"
).split()
SWING = {
    "left_hip_flexion": (0.25, 0.35, 0.0),
    "right_hip_flexion": (0.25, 0.35, np.pi),
    "left_knee_flexion": (0.5, 0.45, -0.4),
    "right_knee_flexion": (0.5, 0.45, np.pi - 0.4),
    "left_ankle_dorsiflexion": (0.0, 0.15, 0.8),
    "right_ankle_dorsiflexion": (0.0, 0.15, np.pi + 0.8),
    "left_hip_adduction": (0.0, 0.06, 0.3),
    "right_hip_adduction": (0.0, 0.06, 0.7),
    "left_hip_rotation": (0.0, 0.08, 0.3),
    "right_hip_rotation": (0.0, 0.08, 0.9),
    "lumbar_flexion": (0.1, 0.05, 0.2),
    "lumbar_rotation": (0.0, 0.1, 0.5),
    "left_shoulder_lift": (0.2, 0.3, np.pi),
    "right_shoulder_lift": (0.2, 0.3, 0.0),
    "left_elbow_flexion": (0.6, 0.3, 0.0),
    "right_elbow_flexion": (0.6, 0.3, np.pi),
    "left_forearm_pronation": (0.2, 0.2, 0.0),
    "right_forearm_pronation": (0.2, 0.2, 1.0),
}


SQUAT = {  # on high, and how much more below
    "hip_flexion": (0.2, 1.7),
    "hip_adduction": (-0.35, -0.1),
    "hip_rotation": (-0.6, -0.3),
    "knee_flexion": (0.1, 2.0),
    "ankle_dorsiflexion": (0.1, 0.5),
    "elbow_flexion": (1.5, 0.0),
    "shoulder_lift": (0.8, 0.0),
    "lumbar_flexion": (0.2, 0.3),
}


def marching(seconds: float = 3.0, rate: float = RATE) -> tuple[Array, Poses]:
    """Return times (n,) and postures of a march with one step a second and leg."""
    t = np.arange(round(seconds * rate)) / rate
    phase = 2.0 * np.pi * t
    angles = np.zeros((len(t), len(HINGES)))
    for name, (mean, size, shift) in SWING.items():
        angles[:, HINGE_NAMES.index(name)] = mean + size * np.sin(phase + shift)
    position = np.column_stack((0.3 * t, 0.02 * np.sin(phase), 0.93 + 0.015 * np.cos(2.0 * phase)))
    turn = np.column_stack((0.03 * np.sin(phase), 0.02 * np.cos(phase), 0.4 + 0.1 * np.sin(phase)))
    return t, Poses(position, rotations(turn), angles)


def squatting(seconds: float = 4.0, rate: float = 50.0) -> tuple[Array, Poses]:
    """Return times (n,) and postures of two deep squats, feet wide and turned out."""
    t = np.arange(round(seconds * rate)) / rate
    deep = 0.5 - 0.5 * np.cos(np.pi * t)
    angles = np.zeros((len(t), len(HINGES)))
    for name, (high, more) in SQUAT.items():
        sides = (name,) if name.startswith("lumbar") else (f"left_{name}", f"right_{name}")
        for side in sides:
            angles[:, HINGE_NAMES.index(side)] = high + more * deep
    still = np.zeros(len(t))
    position = np.column_stack((still, 0.02 * np.sin(3.0 * t), 0.9 - 0.45 * deep))
    turn = np.column_stack((still, 0.5 * deep, 0.1 * np.sin(2.0 * t)))
    return t, Poses(position, rotations(turn), angles)


def marker_places(
    labels: list[str], body: HumanBody, off: float, seed: int
) -> list[tuple[int, int, Array]]:
    """Return segment, anchor and place of markers, off by so many spreads."""
    rng, found = np.random.default_rng(seed), []
    for label in labels:
        mark = landmark(str(landmark_of(label)))
        place_ = body.scale * (np.array(mark.place) + off * mark.spread * rng.standard_normal(3))
        found.append((SEGMENT_NAMES.index(mark.segment), SEGMENT_NAMES.index(mark.anchor), place_))
    return found


def recorded(
    body: HumanBody,
    *,
    labels: list[str] = LABELS,
    seconds: float = 3.0,
    off: float = 0.0,
    noise: float = 0.0,
    seed: int = 0,
    plates: bool = False,
    posed: tuple[Array, Poses] | None = None,
) -> tuple[MarkerRecording, Poses]:
    """Return the recording of a marching (or ``posed``) body, z up, and its true postures."""
    time, poses = marching(seconds) if posed is None else posed
    placed = forward_kinematics(poses, body.dimensions)
    tracks = [
        placed.origin[:, anchor] + placed.rotation[:, segment] @ spot
        for segment, anchor, spot in marker_places(labels, body, off, seed)
    ]
    positions = np.stack(tracks, axis=1)
    positions += noise * np.random.default_rng(seed + 1).standard_normal(positions.shape)
    found = (true_plate(body, poses, time),) if plates else ()
    return MarkerRecording(time, tuple(labels), positions, found, up="z"), poses


def true_plate(body: HumanBody, poses: Poses, time: Array) -> ForcePlate:
    """Return what one plate under all feet feels: segment by segment, by differences of places."""
    placed, parts = forward_kinematics(poses, body.dimensions), masses(body)
    force, moment = np.zeros((2, len(time), 3))
    step = time[1] - time[0]
    for k, name in enumerate(SEGMENT_NAMES):
        part, R = parts[name], placed.rotation[:, k]
        c = placed.origin[:, k] + R @ part.centre
        a = np.gradient(np.gradient(c, step, axis=0), step, axis=0)
        push = part.mass * (a + [0.0, 0.0, 9.81])
        dR = np.gradient(R, step, axis=0)
        W = dR @ np.swapaxes(R, 1, 2)
        w = np.column_stack((W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]))
        spin = (R @ part.inertia @ np.swapaxes(R, 1, 2) @ w[..., None])[..., 0]
        force += push
        moment += np.cross(c, push) + np.gradient(spin, step, axis=0)
    return ForcePlate("plate", time, force, moment)


def write_trc(path: Path, recording: MarkerRecording, decimals: int = 3) -> None:
    """Write a recording as OpenSim does: mm, y up."""
    labels, n = recording.labels, len(recording.time)
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame"
        "\tOrigNumFrames",
        f"{RATE}\t{RATE}\t{n}\t{len(labels)}\tmm\t{RATE}\t1\t{n}",
        "Frame#\tTime\t" + "\t\t\t".join(labels),
        "\t\t" + "\t".join(f"{a}{k + 1}" for k in range(len(labels)) for a in "XYZ"),
        "",
    ]
    for k in range(n):
        cells = [str(k + 1), f"{recording.time[k]:.5f}"]
        for x, y, z in 1e3 * recording.positions[k]:
            seen = np.isfinite(x)
            cells += [f"{v:.{decimals}f}" if seen else "" for v in (x, z, -y)]
        lines.append("\t".join(cells))
    path.write_text("\n".join(lines) + "\n")
