"""A constraint of your own: the distance of two hands never exceeds a rope's length.

A margin is a distance that must not close, with its Jacobian. Braking distance, recovery and the
look-ahead at the next configuration come from :class:`wbc.Margin`.
"""

import numpy as np

import wbc


class Rope(wbc.Margin):
    """Keep the origins of two frames within ``length`` [m] of each other."""

    def __init__(
        self,
        robot: wbc.Robot,
        frame: str,
        other: str,
        length: float,
        *,
        limits: wbc.Limits | None = None,
    ) -> None:
        super().__init__(robot, "rope", None, limits)
        self.frame, self.other, self.length = frame, other, length

    def distances(self, snapshot: wbc.Snapshot, keys: np.ndarray | None = None) -> wbc.Distances:
        """Return the length of rope left [m] and its Jacobian."""
        offset = snapshot.position(self.frame) - snapshot.position(self.other)
        distance = np.linalg.norm(offset)
        relative = snapshot.jacobian(self.frame)[:3] - snapshot.jacobian(self.other)[:3]
        clearance = np.array([self.length - distance])
        gradient = -(offset / distance @ relative)
        return wbc.Distances(np.array([0]), clearance, gradient[None], None)

    def labels(self, distances: wbc.Distances) -> tuple[str, ...]:
        """Return its name in ticks and reports."""
        return ("rope taut",)

    def curvature_bound(self, distances: wbc.Distances, step: np.ndarray) -> np.ndarray:
        """Bound the second-order error of the row [m]: both hands on levers of a metre."""
        return np.array([2.0 * np.abs(step).sum() ** 2])


robot = wbc.Robot.load("hoap2_like")
q, v, dt = robot.posture("standing"), None, 0.005
start = robot.snapshot(q)
palms = "left_palm", "right_palm"
left, right = (start.position(palm) for palm in palms)
rope = Rope(robot, *palms, length=0.30)
tasks = [
    wbc.PositionTask(robot, palms[0], left + [0.0, 0.2, 0.1]),
    wbc.PositionTask(robot, palms[1], right + [0.0, -0.2, 0.1]),
    wbc.ComTask(robot, start.com, weight=10.0),
    wbc.PostureTask(robot, q, weight=0.01),
]
controller = wbc.KinematicController(
    robot,
    tasks,
    contacts=wbc.support(start, "double"),
    limits=wbc.Limits(robot),
    constraints=[rope],
    dt=dt,
)
longest = 0.0
for _ in range(400):
    tick = controller.step(robot.snapshot(q, v))
    v = tick.velocity
    q = robot.integrate(q, v, dt)
    s = robot.snapshot(q)
    distance = np.linalg.norm(s.position(palms[0]) - s.position(palms[1]))
    longest = max(longest, float(distance))
print(f"hands at most {1e3 * longest:.1f} mm apart, rope {1e3 * rope.length:.0f} mm: {tick.active}")
