"""The template of a new problem file, with comments."""

from __future__ import annotations

from shlex import quote

from wbc.problem.source import quoted
from wbc.robot import Robot

_TEXT = """\
{editor}\
# Try it:            wbc run {file} --plot picture.png
# Check it only:     wbc check {file}
# Change one value:  wbc run {file} --set tasks.com.weight=3
# What can be named: wbc robots {typed}

robot: {robot}               # a name that `wbc robots` lists, or a .urdf or .xml file
start: {{posture: standing}}  # or neutral; joints: {{"*elbow*": 0.4}} changes some [rad or m]
support: {support}           # the contacts: floating, {feet}or a list of frames

# What the robot should do. Weights decide between conflicting tasks of the same priority; tasks
# with a higher priority: number never disturb those with a lower one.
tasks:
  com:                       # the centre of mass keeps its position
    type: com
    target: start            # or {{offset: [0, 0, -0.02]}}, or a point [x, y, z] in m
    weight: 10.0
  shape:                     # arms spread: the inertia about the vertical grows
    type: inertia
    components: [zz]
    target: {{scale: 1.1}}     # times the inertia at the start; or numbers in kg m^2
    per_mass: true
    weight: 10.0
    gain: 0.1                # fraction of the error to remove in one tick, up to 1
    ramp: 1.0                # s: the target moves there smoothly
  # hand:                    # a frame of the robot moves to a position
  #   {{type: frame, frame: FRAME, control: position, target: {{offset: [0, 0, 0.1]}}}}
  posture: {{type: posture, target: start, weight: 0.01}}  # decides what other tasks leave free

limits: {{position: true, velocity: 1.0}}  # factor on the velocity limits of the robot's file

# What it must respect. With `slack: 1000` a constraint may be violated, at that cost.
constraints: {{}}
  # bodies: {{type: self_collision, margin: 0.01}}
  # room: {{type: obstacles, things: {{wall: {{half_space: [-1, 0, 0], position: [0.6, 0, 0]}}}}}}

controller: {{dt: 0.005}}      # s, time step
stop:
  duration: 10.0             # s, at most; it ends sooner when the robot is at rest
  speed: 1.0e-4              # rad/s or m/s, below which it is at rest
  accept: {{com: 2.0e-3}}      # m: largest error at the end
"""
EDITOR_LINE = "# yaml-language-server: $schema={}\n"


def problem_template(robot: Robot, name: str, file: str, schema: str | None = None) -> str:
    """Return the text of a problem that runs: a robot spreads its arms where it stands.

    ``name``: the robot's name in the file.
    ``file``: the file's name in the comments.
    ``schema``: path of the JSON Schema for editors, relative to the file; None leaves it out.
    """
    double = {"left", "right"} <= set(robot.feet)
    return _TEXT.format(
        robot=quoted(name),
        typed=quote(name),
        file=quote(file),
        support="double  " if double else "all     " if robot.feet else "floating",
        feet="left, right, double, " if double else "all, " if robot.feet else "",
        editor="" if schema is None else EDITOR_LINE.format(schema),
    )
