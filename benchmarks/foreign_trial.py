"""Trials of a third-party robot: it stands, is pushed, and walks, in our plant and in its model.

With default gains: CoM, trunk and posture tasks on all feet, limits of joints, torques within the
efforts of the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from foreign_reading import joint_names, spec_of

import wbc
from wbc import Robot
from wbc.errors import WbcError
from wbc.gait import Velocity, Walker
from wbc.gait.scheduled_walk import ScheduledWalk, TimedCommand
from wbc.robot.formats.mjcf_balls import hinge_angles
from wbc.robot.postures import is_standing
from wbc.rotations import exp_rotation
from wbc.simulation import Plant, SimulationError, capture_impulse, simulate

DT = 0.002  # s
DURATION, PUSHED, LASTING, RATIO = 3.0, 0.5, 0.1, 0.3  # s, s, s, of M omega d
LEAST_HEIGHT, MOST_TILT = 0.8, 0.6  # of the CoM's at the start; rad: beyond it has fallen
DISTANCE, FROUDE, SLOWEST = 2.0, 0.1, 0.1  # m; speed in sqrt(g h); m/s
PATIENCE = 2.0  # times the time that the distance takes, and at least so many seconds more
AWAY = np.array((1.0, 0.0, 0.0))


def controller_of(robot: Robot, dt: float = DT, posture: float = 1.0) -> wbc.TorqueController:
    """Return a controller that keeps a robot standing; ``posture`` is that task's weight."""
    start = robot.snapshot(robot.posture())
    motorless = dict.fromkeys(robot.motorless, 0.0)
    tasks = [
        wbc.ComTask(robot, start.com),
        wbc.OrientationTask(robot, "base", start.rotation("base")),
        wbc.PostureTask(robot, start.q, joints=motorless, weight=posture),
    ]
    limits, contacts = wbc.Limits(robot), wbc.support(start, "all")
    return wbc.TorqueController(
        robot, tasks, contacts=contacts, limits=limits, dt=dt, solver="active_set"
    )


def stand_in_plant(robot: Robot) -> dict[str, Any]:
    """Return whether it stands and survives the push in our plant, and how."""
    if robot.fixed_base or not robot.feet:
        return {"stood": None, "why": "fixed base" if robot.fixed_base else "no feet"}
    if not is_standing(robot.model, robot.posture(), robot.feet):
        return {"stood": None, "why": "its posture does not stand"}
    start = robot.snapshot(robot.posture())
    push = RATIO * capture_impulse(start, robot.feet, AWAY)
    plant = Plant(robot, dt=DT)
    plant.push("base", push / LASTING * AWAY, "com", start=PUSHED, duration=LASTING)
    relaxed = ticks = 0
    for now in simulate(controller_of(robot), plant, DURATION):
        ticks += 1
        relaxed += bool(now.tick.policy)
    return {
        "stood": now.verdict.stood,
        "why": now.verdict.reason,
        "push": push,
        "relaxed": relaxed / ticks,
    }


def stand_in_own_model(robot: Robot, path: Path) -> dict[str, Any]:
    """Return the same in the file's own model by raw MuJoCo, with its contacts."""
    import mujoco

    try:
        spec, without = spec_of(mujoco, path)
        spec.copy().compile()
    except (ValueError, mujoco.FatalError) as error:  # its meshes are missing
        return {"stood": None, "why": f"MuJoCo: {' '.join(str(error).split())[:80]}"}
    add_ground(mujoco, spec)
    model = spec.compile()
    if "meshes" in without and not all(_touch(model, foot.link) for foot in robot.feet.values()):
        return {"stood": None, "why": "its feet are meshes, which are missing"}
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    raw = RawModel.of(mujoco, model, robot)
    if raw is None:
        return {"stood": None, "why": "its root has no free joint there"}
    every = max(1, round(DT / model.opt.timestep))
    controller = controller_of(robot, every * float(model.opt.timestep))
    start = robot.snapshot(robot.posture())
    push = RATIO * capture_impulse(start, robot.feet, AWAY) / LASTING * AWAY
    stood, _ = raw.stand(controller, every, DURATION, push, PUSHED)
    if not stood:
        lacks = f", without its {without}" if without else ""
        return {"stood": False, "why": f"fell after {raw.data.time:.2f} s{lacks}"}
    return {"stood": True, "why": f"stood for {DURATION:g} s", "without": without}


def _touch(model: Any, link: str) -> bool:
    """Whether a body, or a body fixed to it, still has a colliding shape."""
    body = model.body(link).id
    fixed = [k for k in range(model.nbody) if model.body_weldid[k] == model.body_weldid[body]]
    mine = np.isin(model.geom_bodyid, fixed)
    return bool((mine & ((model.geom_contype | model.geom_conaffinity) > 0)).any())


def add_ground(mujoco: Any, spec: Any) -> None:
    """Add a level ground with friction that all shapes touch, if a file has none.

    By the file's defaults it might touch nothing, or without friction.
    """
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    if not any(int(geom.type) == int(plane) for geom in spec.geoms):
        ground = spec.worldbody.add_geom(type=plane, size=[50.0, 50.0, 1.0])
        ground.contype = ground.conaffinity = 2**30 - 1
        ground.condim, ground.friction = 3, [1.0, 0.005, 0.0001]


class RawModel:
    """A compiled file in MuJoCo, and the robot's coordinates in it.

    Balls, which are three hinges NAME:x, NAME:y and NAME:z of the robot, take no torque.
    """

    def __init__(self, mujoco: Any, model: Any, robot: Robot, free: int) -> None:
        self.mujoco, self.model, self.robot = mujoco, model, robot
        self.data = mujoco.MjData(model)
        self.at, self.dof = int(model.jnt_qposadr[free]), int(model.jnt_dofadr[free])
        self.body = int(model.jnt_bodyid[free])
        known = {name: j for j, name in enumerate(joint_names(model))}
        names = robot.joint_names
        own = [(k, known[name]) for k, name in enumerate(names) if name in known]
        self.single = np.array([k for k, _ in own])
        self.places = np.array([model.jnt_qposadr[j] for _, j in own])
        self.rates = np.array([model.jnt_dofadr[j] for _, j in own])
        firsts = [(k, name.removesuffix(":x")) for k, name in enumerate(names)]
        self.balls = [(k, known[name]) for k, name in firsts if names[k] == f"{name}:x"]

    @classmethod
    def of(cls, mujoco: Any, model: Any, robot: Robot) -> RawModel | None:
        """Return a robot in a model; None if its root has no free joint there."""
        known = {name: j for j, name in enumerate(joint_names(model))}
        mine = next(known[name] for name in robot.joint_names if name in known)
        root, kind = int(model.body_rootid[model.jnt_bodyid[mine]]), mujoco.mjtJoint.mjJNT_FREE
        for j in range(model.njnt):
            if int(model.jnt_type[j]) == int(kind) and int(model.jnt_bodyid[j]) == root:
                return cls(mujoco, model, robot, j)
        return None

    def write(self, q: np.ndarray) -> None:
        """Put the robot at a configuration (nq,), at rest; balls where their hinges have them."""
        data, at = self.data, self.at
        data.qpos[at : at + 3], data.qpos[at + 3 : at + 7] = q[:3], q[[6, 3, 4, 5]]
        positions = self.robot.limits.joint_positions(q)
        data.qpos[self.places] = positions[self.single]
        for k, joint in self.balls:
            R = np.eye(3)
            for axis, angle in zip(np.eye(3), positions[k : k + 3], strict=True):
                R = R @ exp_rotation(angle * axis)
            place = int(self.model.jnt_qposadr[joint])
            self.mujoco.mju_mat2Quat(data.qpos[place : place + 4], R.ravel())
        self.mujoco.mj_forward(self.model, data)

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Return configuration (nq,) and velocity (nv,)."""
        data, at, dof = self.data, self.at, self.dof
        q, v = self.robot.posture("neutral", on_ground=False), np.zeros(self.robot.nv)
        q[:3], q[3:7] = data.qpos[at : at + 3], data.qpos[at + 3 : at + 7][[1, 2, 3, 0]]
        R = self.robot.snapshot(q).rotation("base")
        v[:3], v[3:6] = R.T @ data.qvel[dof : dof + 3], data.qvel[dof + 3 : dof + 6]
        positions = np.zeros(self.robot.nv - 6)
        positions[self.single] = data.qpos[self.places]
        v[6 + self.single] = data.qvel[self.rates]
        for k, joint in self.balls:
            place, rate = int(self.model.jnt_qposadr[joint]), int(self.model.jnt_dofadr[joint])
            angles = hinge_angles(data.qpos[place : place + 4])
            positions[k : k + 3] = angles
            v[6 + k : 9 + k] = np.linalg.solve(turning_of(angles), data.qvel[rate : rate + 3])
        self.robot.limits.write_positions(q, positions)
        return q, v

    def stand(
        self, controller: wbc.Controller, every: int, seconds: float, push: np.ndarray, at: float
    ) -> tuple[bool, wbc.Snapshot]:
        """Return whether it stood from its posture on, and its last state.

        A tick is held for ``every`` steps; the push (3,) [N] begins at a time [s].
        """
        start = now = self.robot.snapshot(self.robot.posture())
        self.write(start.q)
        height, up = float(start.com[2]), start.rotation("base")[2]
        for _ in range(round(seconds / controller.dt)):
            now = self.robot.snapshot(*self.state())
            tilt = float(np.arccos(np.clip(now.rotation("base")[2] @ up, -1.0, 1.0)))
            if now.com[2] < LEAST_HEIGHT * height or tilt > MOST_TILT:
                return False, now
            acts = at <= self.data.time < at + LASTING
            self.step(controller.step(now).torque, every, push if acts else None, now.com)
        return True, now

    def step(self, torque: np.ndarray, count: int, push: Any, com: np.ndarray) -> None:
        """Hold torques (nv - 6,) for so many steps, and a push (3,) [N] at the CoM."""
        applied = self.data.qfrc_applied
        applied[:] = 0.0
        applied[self.rates] = torque[self.single]
        if push is not None:
            self.mujoco.mj_applyFT(
                self.model, self.data, push, np.zeros(3), com, self.body, applied
            )
        self.mujoco.mj_step(self.model, self.data, count)


def turning_of(angles: np.ndarray) -> np.ndarray:
    """Return E (3, 3): rates of hinges about x, y, z in turn to the angular velocity of the last.

    That is the ball's, in its own axes, as MuJoCo has it.
    """
    x, y, z = np.eye(3)
    last = exp_rotation(angles[2] * z).T
    return np.column_stack((last @ exp_rotation(angles[1] * y).T @ x, last @ y, z))


def walk_two_metres(robot: Robot) -> dict[str, Any]:
    """Return whether a humanoid walks two metres with default settings."""
    soles = all(len(foot.polygon) > 1 for foot in robot.feet.values())
    if set(robot.feet) != {"left", "right"} or not soles or robot.fixed_base:
        return {"walked": None, "why": "not two flat feet"}
    walker = Walker(robot, dt=DT)
    start = robot.snapshot(robot.posture())
    usual = max(SLOWEST, FROUDE * float(np.sqrt(robot.gravity * start.com[2])))
    speed = min(usual, walker.limits.forwards)
    plant = Plant(robot, dt=DT)
    walk = ScheduledWalk(
        walker, [TimedCommand(0.2, Velocity(speed, 0.0, 0.0))], lambda: plant.felt_forces
    )
    begin = float(plant.com[0])
    most = PATIENCE * DISTANCE / speed + 4.0
    ticks = relaxed = 0
    for now in simulate(walker.controller, plant, most, update=walk.update):
        ticks += 1
        relaxed += bool(now.tick.policy)
        if float(plant.com[0]) - begin >= DISTANCE:
            break
    went = float(plant.com[0]) - begin
    return {
        "walked": bool(now.verdict.stood and went >= DISTANCE),
        "why": now.verdict.reason,
        "went": went,
        "speed": speed,
        "seconds": plant.time,
        "relaxed": relaxed / ticks,
        "held_back": list(walker.held_back_by),
    }


def run_trials(path: Path, robot: Robot) -> dict[str, Any]:
    """Return the results of all trials; refusals are named."""
    found: dict[str, Any] = {}
    trials = [("plant", lambda: stand_in_plant(robot)), ("walk", lambda: walk_two_metres(robot))]
    if path.suffix == ".xml":
        trials.insert(1, ("own", lambda: stand_in_own_model(robot, path)))
    for name, trial in trials:
        if name != "plant" and found["plant"].get("stood") is None:
            continue  # nothing that stands
        try:
            found[name] = trial()
        except (WbcError, SimulationError) as error:
            found[name] = {"refused": str(error)[:300]}
    return found
