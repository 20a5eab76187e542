"""The push law of the solid pendulum on a real sole with mass, which can tip and slide.

In the law's own simulation the ground can push anywhere inside the foot. Here MuJoCo simulates a
sole (four corners, friction, a mass unknown to the law) that carries leg and reaction mass by an
ankle; the torques of the law's command act between them, held for the time between commands. For
each margin (:attr:`LawBounds.cop_margin`): the largest push that is survived, relative to the
bound of a foot without margin, and the largest height of the sole's corners meanwhile.

    python benchmarks/tipping_sole.py [--margins 0.001 0.005 0.01 0.02] [--dt 0.002] [--sole 1.5]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse

import mujoco
import numpy as np
from push_recovery import BODIES, Body

from wbc.rmp.balance.momentum_qp import MomentumQp

PHYSICS = 2.5e-4  # s
THICK = 0.02  # m
LONGEST, NEAR = 6.0, 0.03  # s; m, m/s and rad from rest at which a push is over
LIFTED = 1e-3  # m: a corner higher than this has tipped


def sole_xml(body: Body, sole_mass: float, friction: float) -> str:
    """Return sole, leg and reaction mass; the ankle is on the ground, the leg lies along x."""
    back, front, right, left = body.sole
    half, middle = (
        ((front - back) / 2, (left - right) / 2),
        ((front + back) / 2, (left + right) / 2),
    )
    corners = "".join(
        f'<geom type="sphere" size="0.002" pos="{middle[0] + i * half[0]} {middle[1] + j * half[1]}'
        f' 0.002" mass="1e-6"/>'
        for i in (-1, 1)
        for j in (-1, 1)
    )
    r = np.square(body.radii)
    inertia = " ".join(map(str, body.mass / 3.0 * (r.sum() - r)))
    small = '<inertial pos="0 0 0" mass="1e-4" diaginertia="1e-6 1e-6 1e-6"/>'
    size = f"{half[0]} {half[1]} {THICK / 2}"
    return f"""
    <mujoco><option timestep="{PHYSICS}" integrator="implicitfast" cone="elliptic"/>
    <default><geom friction="{friction} 0.005 0.0001" solref="0.004 1"/></default>
    <worldbody><geom type="plane" size="5 5 1"/>
      <body name="sole"><freejoint/>{corners}
        <geom type="box" size="{size}" pos="{middle[0]} {middle[1]} {THICK / 2}" mass="{sole_mass}"
              contype="0" conaffinity="0"/>
        <body>{small}<joint name="theta" axis="0 -1 0"/>
          <body>{small}<joint name="phi" axis="0 0 1"/>
            <body name="mass"><joint name="leg" type="slide" axis="1 0 0"/><joint type="ball"/>
              <inertial pos="0 0 0" mass="{body.mass}" diaginertia="{inertia}"/>
    </body></body></body></body></worldbody></mujoco>"""


class Plant:
    """The pendulum on its sole, at rest, and its state in the law's coordinates."""

    def __init__(self, body: Body, sole_mass: float) -> None:
        self.model = mujoco.MjModel.from_xml_string(sole_xml(body, sole_mass, 0.8))
        self.data = mujoco.MjData(self.model)
        self.body = body
        self.sole, self.mass = (self.model.body(name).id for name in ("sole", "mass"))
        self.dofs = [int(self.model.joint(name).dofadr[0]) for name in ("theta", "phi", "leg")]
        places = [int(self.model.joint(name).qposadr[0]) for name in ("theta", "leg")]
        self.data.qpos[places] = np.pi / 2, body.height
        # The frame of the masses starts level although the leg stands up.
        half = np.sqrt(0.5)
        self.data.qpos[-4:] = half, 0.0, half, 0.0
        mujoco.mj_forward(self.model, self.data)
        self.corners = np.array([g.pos for g in map(self.model.geom, range(1, 5))])

    def push(self, impulse: np.ndarray) -> None:
        """Apply an impulse at the CoM; the leg rotates, the masses do not."""
        speed = impulse / self.body.mass / self.body.height
        dofs = self.data.qvel
        dofs[self.dofs[0]], dofs[self.dofs[1]] = -speed[0], speed[1]
        # In their own axes, against what the leg carries them along with.
        R = self.data.xmat[self.mass].reshape(3, 3)
        dofs[-3:] = R.T @ np.array([speed[1], -speed[0], 0.0])

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the pendulum's q (12,), v (11,) in the law's coordinates."""
        data, twist = self.data, np.zeros(6)
        mujoco.mj_forward(self.model, data)
        foot = data.xpos[self.sole]
        mujoco.mj_objectVelocity(self.model, data, mujoco.mjtObj.mjOBJ_BODY, self.mass, twist, 0)
        along = data.xpos[self.mass] - foot
        rate = twist[3:] - data.qvel[:3]
        length = float(np.linalg.norm(along))
        theta, phi = np.arctan2(along[2], along[0]), np.arcsin(along[1] / length)
        flat = along[0] ** 2 + along[2] ** 2
        theta_rate = (along[0] * rate[2] - along[2] * rate[0]) / flat
        length_rate = float(along @ rate) / length
        phi_rate = (rate[1] - along[1] / length * length_rate) / (length * np.cos(phi))
        w, x, y, z = data.xquat[self.mass]
        R = data.xmat[self.mass].reshape(3, 3)
        q = np.array([*foot[:2], theta, phi, length, x, y, z, w, *self.body.radii])
        spin = R.T @ twist[:3]
        v = np.array([0.0, 0.0, theta_rate, phi_rate, length_rate, *spin, 0.0, 0.0, 0.0])
        return q, v

    def apply(self, force: np.ndarray) -> None:
        """Put generalised forces (9,) on ankle, leg and masses; the sole takes the reaction."""
        data = self.data
        data.qfrc_applied[self.dofs] = force[:3]
        torque = data.xmat[self.mass].reshape(3, 3) @ force[3:6]
        data.xfrc_applied[self.mass, 3:] = torque
        data.xfrc_applied[self.sole, 3:] = -torque

    def lifted(self) -> float:
        """Return the height of the sole's highest corner [m]."""
        R = self.data.xmat[self.sole].reshape(3, 3)
        return float((self.data.xpos[self.sole] + self.corners @ R.T)[:, 2].max()) - 0.002


def survives(
    law: MomentumQp, body: Body, sole_mass: float, impulse: np.ndarray
) -> tuple[bool, float]:
    """Return whether a push ends at rest, and how far the sole rose [m]."""
    plant = Plant(body, sole_mass)
    for _ in range(round(0.2 / law.dt)):  # settles on its corners
        _advance(plant, law)
    plant.push(impulse)
    highest = 0.0
    for _ in range(round(LONGEST / law.dt)):
        if not _advance(plant, law):
            return False, highest
        highest = max(highest, plant.lifted())
        if not plant.data.xpos[plant.mass][2] > 0.5 * body.height:
            return False, highest
        q, v = plant.state()
        lean = np.abs(plant.data.xpos[plant.mass][:2] - np.asarray(law.com)[:2]).max()
        turned = 2.0 * np.linalg.norm(q[5:8])
        rest = max(lean, np.abs(v).max(), turned)
        if rest < NEAR:
            return True, highest
    return False, highest


def _advance(plant: Plant, law: MomentumQp) -> bool:
    """Command once; return False once the leg has fallen."""
    if not plant.data.xpos[plant.mass][2] > 0.5 * plant.body.height:
        return False
    q, v = plant.state()
    force = law.command(q, v, 0.0).force
    for _ in range(round(law.dt / PHYSICS)):
        plant.apply(force)
        mujoco.mj_step(plant.model, plant.data)
    return True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--body", choices=sorted(BODIES), default="g1")
    parser.add_argument("--margins", type=float, nargs="+", default=[0.001, 0.005, 0.01, 0.02])
    parser.add_argument("--angles", type=float, nargs="+", default=[0.0, 22.5, 45.0])
    parser.add_argument("--dt", type=float, default=2e-3, help="between commands [s]")
    parser.add_argument("--sole", type=float, default=1.5, help="mass of the sole [kg]")
    parser.add_argument("--step", type=float, default=0.02, help="of the scan, parts of the bound")
    options = parser.parse_args()
    body = BODIES[options.body]
    angles = np.radians(options.angles)
    directions = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    bounds = body.limits(directions)
    print(f"{options.body}, sole of {options.sole:g} kg, commands every {options.dt * 1e3:g} ms")
    print(f"{'margin':>8s}{'angle':>7s}{'survived':>10s}{'of wheel':>9s}{'of ankle':>9s}  lifted")
    for margin in options.margins:
        law = body.law(options.dt, "proxqp", cop_margin=margin, torsion=True)
        for angle, e, ankle, most in zip(
            options.angles, directions, bounds.ankle, bounds.wheel, strict=True
        ):
            share, rose = 0.6, 0.0
            while share < 1.2:
                stood, lifted = survives(law, body, options.sole, (share + options.step) * most * e)
                if not stood:
                    break
                share, rose = share + options.step, lifted
            impulse = share * most
            print(
                f"{margin * 1e3:6.1f}mm{angle:6.0f} {impulse:7.2f}Ns{share:9.2f}"
                f"{impulse / ankle:9.2f}  {rose * 1e3:.2f} mm",
                flush=True,
            )


if __name__ == "__main__":
    main()
