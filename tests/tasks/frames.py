"""A frame of each robot that some task is about."""

from wbc.robot import Robot

FRAMES = {
    "hoap2_like": "left_palm",
    "g1_27": "left_sole",
    "talos": "right_sole",
    "icub": "left_sole",
    "romeo": "right_sole",
}


def some_frame(robot: Robot) -> str:
    return FRAMES.get(robot.name, "toe")
