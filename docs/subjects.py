"""Subjects of pictures: problems shown side by side, and moments of a motion [s]."""

FIG6 = {
    "a: all large": "fig6a_g1",
    "b: vertical large": "fig6b_g1",
    "c: the others large": "fig6c_g1",
}
FIG7 = {
    "backward": "fig7_backward_hoap2",
    "forward": "fig7_forward_hoap2",
    "downward": "fig7_downward_hoap2",
}
# Shiko: standing, squat, over the right foot, left leg half way, at its top, stomp, other leg.
SHIKO = (0.0, 2.0, 4.0, 5.0, 6.0, 6.7, 12.2)
MEASURED = (0.0, 2.0, 4.0, 5.0, 6.0, 6.84, 12.3)
SHIKO_G1 = {"stands": 0.0, "squats": 2.0, "leg up": 7.0, "stomps": 8.06, "the other leg": 15.06}
HOP = {"stands": 0.0, "crouches": 0.9, "takes off": 1.12, "flies": 1.33, "lands": 1.51}
HOP |= {"gives way": 1.7, "rises": 2.1, "stands again": 2.7}
SOMERSAULT = {"spread": 0.0, "draws in": 0.6, "tucked": 0.9, "a turn on": 1.2, "opens": 1.5}
SOMERSAULT |= {"spread again": 1.8, "goes on": 2.08}
# Walking at 0.5 m/s, a push from the right between 2.0 and 2.2 s, and what the feet do of it.
PUSHED = {"walks": 1.8, "pushed": 2.1, "lands wide": 2.25, "steps in": 2.58}
PUSHED |= {"steps aside": 3.05, "walks on": 3.4, "as before": 4.4}
# By a wall: pushed from 0.2 to 0.3 s, the hand on its way, on the wall, and what comes after.
WALL = {"stands": 0.1, "pushed": 0.28, "reaches": 0.36, "leans": 0.43, "lets go": 0.6}
WALL |= {"comes back": 0.9, "stands again": 3.0}
# Walks whose picture has the robot several times, about half a metre apart.
BOARDS = {f"{at} s": at for at in (0.0, 2.1, 3.5, 4.9, 6.3, 7.7, 9.2)}
SLOPE = {f"{at} s": at for at in (0.0, 2.6, 3.9, 5.2, 6.5)}
STAIRS = {f"{at} s": at for at in (0.0, 1.55, 2.85, 4.55, 6.1, 7.7, 10.5)}
STONES = {f"{at} s": at for at in (0.0, 1.85, 3.1, 4.5, 7.5)}
BACK = {"begins": 0.0, "to the right: 4.6 s": 4.6, "backwards: 10.2 s": 10.2}
BACK |= {"around a corner: 14.5 s": 14.5}
