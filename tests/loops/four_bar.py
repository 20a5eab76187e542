"""A planar four-bar in MJCF, and its positions, velocities and forces in closed form.

In the x-z plane, y pointing away: crank A B, coupler B C, rocker D C. A turn by q about y takes x
to (cos q, -sin q).
"""

import numpy as np

CRANK, COUPLER, PIVOT, PIN = 0.1, 0.2, np.array([0.22, -0.05]), np.array([0.3, 0.0])
ROCKER = float(np.linalg.norm(PIN - PIVOT))
GRAVITY = 9.81
# Mass [kg] and centre of mass in the body's axes, of crank, coupler and rocker.
BODIES = ((0.4, (0.05, 0.01)), (0.6, (0.1, 0.02)), (0.5, (0.02, 0.07)))


def inertial(body: int) -> str:
    mass, (x, z) = BODIES[body]
    return f'<inertial pos="{x} 0 {z}" mass="{mass}" diaginertia=".002 .003 .002"/>'


def mjcf(tie: str = "", more: str = "") -> str:
    """The loop as a <connect>, unless another tie is given."""
    tie = tie or '<connect name="pin" body1="coupler" body2="rocker" anchor=".2 0 0"/>'
    return f"""<mujoco model="four_bar"><compiler angle="radian"/><worldbody>
      <body name="frame" pos="0 0 1"><inertial pos="0 0 0" mass="5" diaginertia=".05 .05 .05"/>
        <body name="crank"><joint name="crank" axis="0 1 0" range="-1.2 1.2"/>{inertial(0)}
          <body name="coupler" pos="{CRANK} 0 0"><joint name="coupler" axis="0 1 0"/>{inertial(1)}
          </body></body>
        <body name="rocker" pos="{PIVOT[0]} 0 {PIVOT[1]}"><joint name="rocker" axis="0 1 0"/>
          {inertial(2)}</body>
      </body></worldbody>
      <equality>{tie}</equality><actuator><motor joint="crank" forcerange="-20 20"/></actuator>
      {more}</mujoco>"""


def along(q: float) -> np.ndarray:
    return np.array([np.cos(q), -np.sin(q)])


def across(q: float) -> np.ndarray:
    """The derivative of along."""
    return np.array([-np.sin(q), -np.cos(q)])


def turned(point: tuple[float, float], q: float) -> np.ndarray:
    x, z = point
    return x * along(q) - z * across(q)


def joints(crank: float) -> np.ndarray:
    """Positions of crank, coupler and rocker: C is where two circles meet, above D B."""
    B = CRANK * along(crank)
    between = PIVOT - B
    d = float(np.linalg.norm(between))
    foot = (d**2 + COUPLER**2 - ROCKER**2) / (2.0 * d)
    height = np.sqrt(COUPLER**2 - foot**2)
    unit = between / d
    C = B + foot * unit + height * np.array([-unit[1], unit[0]])
    coupler = np.arctan2(-(C - B)[1], (C - B)[0])
    drawn, now = PIN - PIVOT, C - PIVOT
    rocker = np.arctan2(drawn[1], drawn[0]) - np.arctan2(now[1], now[0])
    return np.array([crank, coupler - crank, rocker])


def rates(crank: float) -> np.ndarray:
    """Their derivatives by the crank: B C and D C do not change their lengths."""
    _, coupler, rocker = joints(crank)
    psi = crank + coupler
    arm = across_of(PIN - PIVOT, rocker)  # the pin's velocity for each rad/s of the rocker
    moving = CRANK * across(crank)
    by = np.linalg.solve(np.column_stack((arm, -COUPLER * across(psi))), moving)
    return np.array([1.0, by[1] - 1.0, by[0]])


def across_of(point: np.ndarray, q: float) -> np.ndarray:
    x, z = point
    return x * across(q) + z * along(q)


def statics(crank: float) -> tuple[float, np.ndarray]:
    """The crank's torque [N m] and the force of the coupler on the rocker (2,) [N], world axes.

    By moments of the coupler about B and of the rocker about D, then of the crank about A.
    """
    _, coupler, rocker = joints(crank)
    psi = crank + coupler
    BC, DC = COUPLER * along(psi), turned(tuple(PIN - PIVOT), rocker)
    rows, known = [], []
    for arm, (mass, com), angle, sign in ((BC, BODIES[1], psi, -1.0), (DC, BODIES[2], rocker, 1.0)):
        weight = np.array([0.0, -mass * GRAVITY])
        rows.append(sign * np.array([arm[1], -arm[0]]))  # moment about y: z fx - x fz
        known.append(-moment(turned(com, angle), weight))
    F = np.linalg.solve(np.array(rows), np.array(known))
    at_B = np.array([0.0, BODIES[1][0] * GRAVITY]) + F  # of the crank on the coupler
    B, weight = CRANK * along(crank), np.array([0.0, -BODIES[0][0] * GRAVITY])
    return -moment(B, -at_B) - moment(turned(BODIES[0][1], crank), weight), F


def moment(arm: np.ndarray, force: np.ndarray) -> float:
    return float(arm[1] * force[0] - arm[0] * force[1])
