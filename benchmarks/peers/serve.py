"""The job, and the protocol by which run.py runs blocks of ticks of the loops in turns.

NumPy only: this is imported in every peer's own environment.
"""

import gc
import json
import os
import sys
from time import thread_time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

AMPLITUDE = np.array([0.01, 0.02, -0.01])  # of the CoM [m]
FREQUENCY = np.array([0.5, 0.25, 0.4])  # [Hz]
KP = 100.0  # of tasks and contacts of the torque level [1/s^2], critically damped
TURN = np.array([0.0, 0.1, 0.2])  # of the trunk [rad]


class Job:
    """Every loop's job: a humanoid on both feet follows its CoM and its trunk's orientation."""

    def __init__(self, path):
        with open(path, encoding="utf-8") as file:
            told = json.load(file)
        self.robot, self.urdf, self.mjcf = told["robot"], told["urdf"], told["mjcf"]
        self.dt, self.feet, self.trunk = told["dt"], told["feet"], told["trunk"]
        self.joints, self.velocities = told["joints"], told["velocities"]  # by name
        self.efforts, self.corners = told["efforts"], told["corners"]  # of soles, in axes of feet
        self.pairs = told.get("pairs", [])  # of links with a sphere each about their origin
        self.balls = sorted({link for pair in self.pairs for link in pair})
        self.radius, self.margin = told.get("radius"), told.get("margin")
        self.base = np.array(told["base"])  # position, quaternion x y z w

    def com(self, start, k):
        """Return the CoM's target after k ticks."""
        return start + AMPLITUDE * np.sin(2 * np.pi * FREQUENCY * k * self.dt)

    def gap(self, centres):
        """Return the least distance of the pairs' spheres; centres (k, 3) of ``balls``."""
        first, second = ([self.balls.index(pair[k]) for pair in self.pairs] for k in range(2))
        apart = np.linalg.norm(centres[first] - centres[second], axis=1)
        return float(apart.min()) - 2 * self.radius

    def trunk_rotation(self, start, k):
        """Return the trunk's target rotation after k ticks."""
        turn = TURN * np.sin(k * self.dt)
        angle = np.linalg.norm(turn)
        if angle < 1e-12:
            return start.copy()
        x, y, z = turn / angle
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return start @ (np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew)


def serve(make, versions):
    """Run blocks of a loop as they are asked for, and answer with the CPU time of each round.

    ``make(job, ...)`` returns an object with ``start_com``, ``start_trunk`` and what is timed:
    ``aim(com, rotation, k)`` sets the targets, ``tick()`` computes the command from the state, and
    ``move()`` integrates it. Some libraries integrate in the call that computes the command or
    updates the kinematics: it is then part of ``tick()``, and ``move()`` does nothing. Not timed
    are ``com()``, ``feet()`` (positions (2, 3)), ``speed()``, the largest joint velocity in parts
    of its limit, and with pairs ``links(names)``, positions (k, 3).
    """
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # keeps output of libraries out of the answers
    job = Job(sys.argv[1])
    loop = make(job, *sys.argv[2:])
    anchors, k = loop.feet().copy(), 0
    errors, drift, speed, gap = [], 0.0, 0.0, np.inf
    gc.disable()
    print(json.dumps({"versions": versions}), file=out, flush=True)
    for line in sys.stdin:
        times, ticks = [], []
        for _ in range(int(line)):
            com = job.com(loop.start_com, k)
            rotation = job.trunk_rotation(loop.start_trunk, k)
            begin = thread_time()
            loop.aim(com, rotation, k)
            aimed = thread_time()
            loop.tick()
            found = thread_time()
            loop.move()
            times.append(thread_time() - begin)
            ticks.append(found - aimed)
            errors.append(float(np.linalg.norm(loop.com() - com)))
            drift = max(drift, float(np.abs(loop.feet() - anchors).max()))
            speed = max(speed, loop.speed())
            if job.pairs:
                gap = min(gap, job.gap(loop.links(job.balls)))
            k += 1
        gc.collect()
        answer = {
            "times": times,
            "ticks": ticks,
            "com_rms": float(np.sqrt(np.mean(np.square(errors)))),
            "drift": drift,
            "speed": speed,
        } | ({"gap": gap} if job.pairs else {})
        print(json.dumps(answer), file=out, flush=True)
