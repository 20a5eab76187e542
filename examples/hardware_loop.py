"""The loop for a real robot: read, step, send; and the handling of lost frames and failed ticks.

Only `read` and `send` know the robot: replace them by your driver. Here they use a simulated plant
with noise, delay and lost frames (extra `sim`).
"""

import numpy as np

import wbc
from wbc.simulation import Plant, Sensors

robot = wbc.Robot.load("hoap2_like")
q, dt = robot.posture("standing"), 0.002
noise = {"position_noise": 1e-4, "velocity_noise": 5e-3, "base_rate_noise": 5e-3}
plant = Plant(robot, dt=dt, sensors=Sensors(**noise, delay=0.002, dropout=0.01, seed=0))
plant.reset(q)


def read() -> tuple[np.ndarray, np.ndarray] | None:
    """Return (q, v) as measured and estimated, or None if no frame came in time."""
    return plant.measure()


def send(torque: np.ndarray) -> None:
    """Command joint torques [N m], held until the next."""
    plant.step(torque)


start = robot.snapshot(q)
tasks = [
    wbc.ComTask(robot, start.com, weight=10.0),
    wbc.OrientationTask(robot, "torso", start.rotation("torso"), name="torso"),
    wbc.PostureTask(robot, q, weight=0.1),
]
contacts = wbc.support(start, "double")
controller = wbc.TorqueController(robot, tasks, contacts=contacts, limits=wbc.Limits(robot), dt=dt)

lost = lost_in_a_row = 0
torque: np.ndarray = np.zeros(robot.nv - 6)
relaxed: list[tuple[int, str]] = []
for k in range(2000):  # 4 s
    state = read()
    lost_in_a_row = lost_in_a_row + 1 if state is None else 0
    if lost_in_a_row > 10:
        raise SystemExit("no state for 20 ms: stop the motors")
    if state is None:
        lost += 1  # hold the last torque
    else:
        tick = controller.step(robot.snapshot(*state))  # NaN or a wrong size is a typed error
        torque = tick.torque  # always finite and inside the torque bounds
        if not tick.ok or tick.relaxed:
            relaxed.append((k, tick.report()))  # names the relaxed rows
    send(torque)

off = 1e3 * np.linalg.norm(plant.com - start.com)
print(f"stood 4 s, {lost} frames lost; CoM within {off:.1f} mm")
print(f"{len(relaxed)} ticks relaxed {relaxed[:1]}")
