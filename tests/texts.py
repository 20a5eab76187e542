"""Problem files that several tests begin with."""

# A hand is pulled towards a wall and a ball.
REACH = """\
robot: hoap2_like
support: double
tasks:
  hand: {type: frame, frame: left_hand, control: position, target: {offset: [0.2, 0, 0.1]},
         gain: 0.1}
constraints:
  room: {type: obstacles, links: [left_hand_link], things: {wall: {half_space: [-1, 0, 0],
         position: [0.1, 0, 0]}, ball: {sphere: 0.05, position: [0.3, 0.2, 0.2]}}}
stop: {duration: 0.3}
"""

# A small humanoid stands, by torques; what pushes it is each test's own.
STAND = """\
robot: {model: hoap2_like, armature: 0.003}
support: double
tasks:
  com: {type: com, axes: [x, y], target: start, law: capture_point, weight: 30}
  height: {type: com, axes: [z], target: start, kp: 50, weight: 5}
  torso: {type: frame, frame: base, control: orientation, target: start, kp: 50}
  posture: {type: posture, target: start, weight: 0.3, kp: 30}
controller: {level: torque, solver: active_set}
"""

# The same robot is moved a centimetre, in milliseconds.
CHEAP = """\
robot: hoap2_like
support: double
tasks:
  com: {type: com, target: {offset: [0, 0, -0.01]}, weight: 10.0}
  posture: {type: posture, weight: 0.01}
controller: {solver: active_set}
stop: {duration: 0.02, speed: null}
"""
