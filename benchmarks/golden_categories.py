"""Categories of the golden file's ticks: random episodes of each category, by seed."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import wbc
from wbc.rotations import exp_rotation
from wbc.validate import Array

ROBOTS = ("hoap2_like", "g1", "g1_27", "talos", "icub", "romeo")
BOTH, VELOCITY, TORQUE = ("velocity", "torque"), ("velocity",), ("torque",)
MODES = ("double", "left", "right", "floating")
DT = {"velocity": 0.005, "torque": 0.002}
Make = Callable[["Draft"], None]


class Draft:
    """A plain episode, which a category changes.

    Attributes
    ----------
    episode:
        As :mod:`golden_episodes` reads it.
    hurled:
        How fast the robot is thrown now and then [m/s, rad/s].
    outside:
        By how much joints are put outside their range then [rad].
    """

    def __init__(
        self, robot: wbc.Robot, category: str, level: str, rng: np.random.Generator
    ) -> None:
        self.robot, self.rng = robot, rng
        self.here = robot.snapshot(near_standing(robot, level, rng))
        self.hurled, self.outside = 0.3, 0.0
        options = {"dt": DT[level], "solver": "proxqp"}
        if level == "velocity":
            options["on_failure"] = str(rng.choice(["hold", "damp"]))
        self.episode: dict[str, Any] = {
            "robot": robot.name,
            "category": category,
            "level": level,
            "tasks": [],
            "contacts": [],
            "limits": {},
            "constraints": [],
            "options": options,
        }
        self.stand(0, str(rng.choice(MODES)))

    @property
    def level(self) -> str:
        """The controller's level."""
        return self.episode["level"]

    def frames(self, count: int) -> list[str]:
        """Some of the robot's frames."""
        return [str(one) for one in self.rng.choice(self.robot.frame_names, count, replace=False)]

    def gains(self, gain: float | None = None) -> dict[str, float]:
        """Random gains of the level."""
        if self.level == "torque":
            return {"kp": float(10.0 ** self.rng.uniform(1.0, 2.5))}
        return {"gain": float(self.rng.uniform(0.05, 0.8)) if gain is None else gain}

    def task(self, kind: str, motion: Mapping[str, Any] | None = None, **arguments: Any) -> None:
        """Add a task; ``motion`` is what its set_target gets."""
        arguments = {**arguments, "name": f"{kind} {len(self.episode['tasks'])}"}
        self.episode["tasks"].append(
            {"kind": kind, "arguments": plain(arguments), "motion": plain(motion or {})}
        )

    def stand(self, tick: int, mode: str, **friction: float) -> None:
        """Stand on some feet from a tick on, at their standing poses."""
        friction = {"coefficient": 0.6, **friction}
        held = [
            {
                "kind": type(one).__name__,
                "frame": one.frame,
                "position": plain(one.position),
                "rotation": plain(one.rotation),
                "friction": friction,
            }
            for one in wbc.support(self.here, mode)
        ]
        self.episode["contacts"].append({"tick": tick, "held": held})

    def margins(self) -> None:
        """Keep bodies apart."""
        self.episode["constraints"].append({"kind": "SelfCollision", "arguments": {}})

    def com(self, reach: float = 0.05, priority: int = 0, weight: float = 3.0) -> None:
        """Move the CoM, towards a target that moves."""
        target = self.here.com + reach * self.rng.normal(size=3)
        moving = {"target": target, "rate": 0.1 * self.rng.normal(size=3)}
        moving["acceleration"] = 0.1 * self.rng.normal(size=3)
        arguments = {"target": target, "priority": priority, "weight": weight}
        self.task("ComTask", moving, **arguments, **self.gains())

    def reach(self, reach: float = 0.2, priority: int = 0, **law: float) -> None:
        """Bring a frame somewhere."""
        (frame,) = self.frames(1)
        target = self.here.position(frame) + reach * self.rng.normal(size=3)
        law = {**self.gains(), **law}
        self.task("PositionTask", frame=frame, target=target, priority=priority, **law)

    def turn(self, angle: float = 0.5, priority: int = 0) -> None:
        """Turn a frame."""
        (frame,) = self.frames(1)
        target = self.here.rotation(frame) @ exp_rotation(angle * self.rng.normal(size=3))
        rate = 0.2 * self.rng.normal(size=3)
        moving = {"target": target, "rate": rate, "acceleration": rate}
        arguments = {"frame": frame, "target": target, "priority": priority}
        self.task("OrientationTask", moving, **arguments, **self.gains())

    def posture(self, weight: float = 0.1, priority: int = 0, away: float = 0.0) -> None:
        """Bring all joints to a posture."""
        step = np.concatenate((np.zeros(6), away * self.rng.normal(size=self.robot.nv - 6)))
        target = self.robot.limits.clamped(self.robot.integrate(self.here.q, step, 1.0))
        law = {"weight": weight, "priority": priority, **self.gains(0.1)}
        self.task("PostureTask", target=target, **law)

    def inertia(self, priority: int = 0, **arguments: Any) -> None:
        """Change the shape, in axes of the world or the base."""
        frame = str(self.rng.choice(["world", "base"]))
        target = self.here.inertia_in(frame) * np.exp(0.3 * self.rng.normal())
        moving = {"target": target, "rate": 0.1 * target, "acceleration": 0.1 * target}
        law = {"per_mass": True, "frame": frame, "priority": priority, **arguments}
        self.task("InertiaTask", moving, target=target, weight=10.0, **law, **self.gains())


def near_standing(robot: wbc.Robot, level: str, rng: np.random.Generator) -> Array:
    """Return a starting posture, with nearly level soles if these bear load."""
    size = 10.0 ** (rng.uniform(-2.0, -0.7) if level == "velocity" else rng.uniform(-3.0, -1.5))
    step = np.concatenate((np.zeros(6), size * rng.normal(size=robot.nv - 6)))
    return robot.limits.clamped(robot.integrate(robot.posture("standing"), step, 1.0))


def plain(value: Any) -> Any:
    """Return arrays as lists, which JSON writes and reads without loss."""
    if isinstance(value, Mapping):
        return {key: plain(one) for key, one in value.items()}
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def plainly(draft: Draft) -> None:
    draft.com()
    draft.reach()
    draft.turn()
    if draft.rng.random() < 0.5:
        draft.task("MomentumTask", target=draft.rng.normal(size=6), weight=0.1)
    if draft.rng.random() < 0.3:
        draft.task("DampingTask", weight=0.05)
    draft.posture()


def shapes(draft: Draft) -> None:
    draft.com()
    draft.inertia()
    draft.turn()
    draft.posture()


def apart(draft: Draft) -> None:
    draft.margins()
    for _ in range(3):
        draft.reach(0.5)
    shapes(draft)


def switching(draft: Draft) -> None:
    plainly(draft)
    for tick in (3, 9, 16):
        draft.stand(tick, str(draft.rng.choice(MODES)))


def bounded(draft: Draft) -> None:
    draft.episode["limits"] = {"velocity": float(draft.rng.uniform(0.02, 0.2))}
    draft.posture(0.3, away=1.0)
    draft.reach(1.0)
    draft.com(0.3)
    draft.inertia()


def two(draft: Draft) -> None:
    draft.com()
    draft.turn()
    draft.inertia(priority=1)
    draft.reach(priority=1)
    draft.posture(priority=1)


def three(draft: Draft) -> None:
    draft.com(0.1)
    draft.reach(0.3, priority=1)
    draft.turn(priority=1)
    draft.posture(priority=2)
    draft.inertia(priority=2)
    if draft.rng.random() < 0.3:
        draft.margins()


def soft(draft: Draft) -> None:
    draft.episode["contacts"].clear()
    draft.stand(0, str(draft.rng.choice(MODES[:3])))
    slack = {one["frame"]: 100.0 for one in draft.episode["contacts"][0]["held"][:1]}
    if draft.rng.random() < 0.5:
        draft.margins()
        slack["self-collision"] = 300.0
    draft.episode["options"]["slack"] = slack
    plainly(draft)
    draft.reach(0.5)


def second(draft: Draft) -> None:
    draft.com()
    draft.inertia(second_order=True)
    draft.posture(0.03)


def singular(draft: Draft) -> None:
    limit = float(draft.rng.uniform(0.05, 0.4))
    draft.reach(0.8, singular_threshold=limit)
    draft.reach(0.8, priority=int(draft.rng.integers(2)), singular_threshold=limit)
    draft.com()
    draft.posture(0.01, priority=1)


def braking(draft: Draft) -> None:
    acceleration = float(draft.rng.uniform(5.0, 40.0))
    draft.episode["limits"] = {"braking": "bounded", "acceleration": acceleration}
    plainly(draft)
    draft.hurled = 1.0
    if draft.rng.random() < 0.3:
        draft.margins()


def recovery(draft: Draft) -> None:
    plainly(draft)
    draft.outside = 0.1


def own(draft: Draft) -> None:
    (frame,) = draft.frames(1)
    height = float(draft.here.position(frame)[2] + 0.1)
    arguments = {"frame": frame, "height": height, **draft.gains()}
    draft.episode["tasks"].append({"kind": "HeightTask", "arguments": arguments})
    one = {"kind": "LevelBase", "arguments": {"rate": float(draft.rng.uniform(0.01, 0.2))}}
    draft.episode["constraints"].append(one)
    shapes(draft)


def forces(draft: Draft) -> None:
    draft.episode["contacts"].clear()
    draft.stand(0, "double")
    plainly(draft)
    left, right = (one["frame"] for one in draft.episode["contacts"][0]["held"])
    draft.task("TorqueTask")
    draft.task("LoadShareTask", shares={left: 2.0, right: 1.0}, priority=int(draft.rng.integers(2)))
    draft.task("CopTask", target=draft.here.com[:2])
    draft.task("CopTask", target=[0.01, 0.0], frame=left, weight=0.3)
    draft.task("ForceRateTask", weight=0.05)
    wrench = [0.0, 0.0, 0.3 * draft.robot.weight, 0.0, 0.0, 0.0]
    draft.task("ContactForceTask", frame=right, target=wrench, components=["fx", "fy", "fz"])


def relaxed(draft: Draft) -> None:
    draft.episode["contacts"].clear()
    draft.stand(0, str(draft.rng.choice(MODES[:3])), coefficient=0.3, most=2000.0, least=20.0)
    draft.episode["options"]["torque_limits"] = 0.5
    draft.hurled = 5.0
    plainly(draft)
    if draft.rng.random() < 0.5:
        draft.margins()


def weighed(draft: Draft) -> None:
    draft.episode["options"] |= {"joint_weights": {"base": 3.0, draft.robot.joint_names[-1]: 30.0}}
    draft.episode["options"]["damping"] = 1e-3
    draft.com()
    draft.reach()


def exactly(make: Make) -> Make:
    """The same by an exact solver: levels pass on what a solver leaves."""

    def made(draft: Draft) -> None:
        draft.episode["options"]["solver"] = "daqp"
        make(draft)

    return made


def held(draft: Draft) -> None:
    (apart if draft.rng.random() < 0.5 else bounded)(draft)


# By name: at which levels, and by how much answers may differ (velocities; torques relative to the
# largest of the tick).
CATEGORIES: dict[str, tuple[Make, tuple[str, ...], float]] = {
    "plain": (plainly, BOTH, 1e-9),
    "inertia": (shapes, BOTH, 1e-9),
    "margins": (apart, BOTH, 1e-8),
    "switching": (switching, BOTH, 1e-9),
    "many bounds": (bounded, BOTH, 1e-9),
    "two priorities": (two, BOTH, 1e-6),
    "three priorities": (three, BOTH, 1e-6),
    "soft": (soft, BOTH, 1e-8),
    "two by daqp": (exactly(two), BOTH, 1e-8),
    "three by daqp": (exactly(three), BOTH, 1e-8),
    "second order": (second, VELOCITY, 1e-8),
    "singular": (singular, VELOCITY, 1e-8),
    "bounded braking": (braking, BOTH, 1e-8),
    "outside limits": (recovery, BOTH, 1e-8),
    "own parts": (own, BOTH, 1e-8),
    "forces": (forces, TORQUE, 1e-8),
    "relaxed": (relaxed, TORQUE, 1e-8),
    "reduced": (bounded, BOTH, 1e-8),  # of files that were recorded with this name
    "joint weights": (weighed, BOTH, 1e-8),
    "bounds by daqp": (exactly(held), BOTH, 1e-8),
}


def draft(robot: wbc.Robot, category: str, level: str, rng: np.random.Generator) -> Draft:
    """Return a random episode."""
    made = Draft(robot, category, level, rng)
    CATEGORIES[category][0](made)
    return made


def thrown(draft: Draft, q: Array, v: Array) -> tuple[Array, Array]:
    """Return another state: the robot perturbed, or put somewhere else."""
    robot, rng = draft.robot, draft.rng
    if rng.random() < 0.5:
        q = draft.here.q
    size = 10.0 ** rng.uniform(-5.0, -2.3)  # contacts are off their anchors by as much
    q = robot.integrate(q, size * rng.normal(size=robot.nv), 1.0)
    if not draft.outside:
        return robot.limits.clamped(q), v + draft.hurled * rng.normal(size=robot.nv)
    step, some = np.zeros(robot.nv), rng.integers(6, robot.nv, size=3)
    lower, upper = robot.limits.lower, robot.limits.upper
    at = robot.limits.joint_positions(q)
    for k in some.tolist():
        end = upper[k - 6] if rng.random() < 0.5 else lower[k - 6]
        if np.isfinite(end):
            step[k] = end + np.sign(end) * draft.outside * rng.random() - at[k - 6]
    return robot.integrate(q, step, 1.0), v
