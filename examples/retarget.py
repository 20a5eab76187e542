"""A humanoid crouches as a human does; for a recording: human_motion(read_markers(path))."""

import numpy as np

import wbc
from wbc.human import HumanBody, MarkerRecording, human_motion, human_robot

robot, time = human_robot(HumanBody.of(stature=1.75, mass=70.0, sex="male")), np.arange(80) / 50.0
places = {  # of Plug-in Gait's markers [mm]
    "pelvis": {"LASI": (46, 120, 83), "RASI": (46, -120, 83), "SACR": (-110, 0, 75)},
    "trunk": {"LSHO": (0, 180, 415), "RSHO": (0, -180, 415), "C7": (-65, 0, 458)},
}
for side, a, y in (("left", "L", 1), ("right", "R", -1)):
    places[f"{side}_shank"] = {f"{a}KNE": (0, 58 * y, 0)}
    places[f"{side}_foot"] = {f"{a}ANK": (0, 42 * y, 0), f"{a}TOE": (150, 0, -55)}
legs = {"*_knee_flexion": 1.0, "*_hip_flexion": 0.5, "*_ankle_dorsiflexion": 0.5}
bends = [{n: part * np.sin(t / 1.6 * np.pi) ** 2 for n, part in legs.items()} for t in time]
spots = [(link, spot) for link, markers in places.items() for spot in markers.values()]
states = [robot.snapshot(robot.posture("standing", bend)) for bend in bends]
seen = [[s.position(a) + s.rotation(a) @ np.array(p) * 1e-3 for a, p in spots] for s in states]
labels = tuple(label for markers in places.values() for label in markers)
human = human_motion(MarkerRecording(time, labels, np.array(seen)), mass=70.0)
found = wbc.retarget(human, wbc.Robot.load("hoap2_like"))
print(f"feet slide by {1e3 * found.slide:.2f} mm; CoM's height: {found.com_correlation[2]:.3f}")
