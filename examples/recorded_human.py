"""From markers to a human's pendulum; wbc.human.read_markers reads a file."""

import numpy as np

import wbc
from wbc.human import HumanBody, MarkerRecording, human_motion, human_robot

robot, time = human_robot(HumanBody.of(stature=1.75, mass=70.0, sex="female")), np.arange(60) / 50.0
PLACES = {  # of Plug-in Gait's markers [mm], on a body that bows and rises
    "pelvis": {"LASI": (46, 120, 83), "RASI": (46, -120, 83), "SACR": (-110, 0, 75)},
    "trunk": {"LSHO": (0, 180, 415), "RSHO": (0, -180, 415), "C7": (-65, 0, 458)},
    "left_shank": {"LKNE": (0, 58, 0)},
    "left_foot": {"LANK": (0, 42, 0), "LTOE": (150, 0, -55)},
    "right_shank": {"RKNE": (0, -58, 0)},
    "right_foot": {"RANK": (0, -42, 0), "RTOE": (150, 0, -55)},
}
bows = [{"lumbar_flexion": 0.3 * np.sin(np.pi * t) ** 2} for t in time]
states = [robot.snapshot(robot.posture("standing", bow)) for bow in bows]
spots = [(link, spot) for link, markers in PLACES.items() for spot in markers.values()]
seen = [[s.position(a) + s.rotation(a) @ np.array(p) * 1e-3 for a, p in spots] for s in states]
labels = tuple(label for markers in PLACES.values() for label in markers)
human = human_motion(MarkerRecording(time, labels, np.array(seen)), mass=70.0, sex="female")
series = wbc.analyze(human.motion, cutoff=human.cutoff, noise=human.noise)
print(f"{human.body}: {1e3 * human.rms:.1f} mm; push {series.ground_force[30, 2]:.0f} N")
