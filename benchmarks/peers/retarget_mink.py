"""Per-frame IK of a human's motion with mink, as GMR does it: retarget_mink.py JOB.npz OUT.npz.

Two tables of frame tasks one after the other (first feet and rotations, then places), each solved
again while that lessens the error by 1e-3, eleven times at most, with DAQP, damping 0.5 and joint
limits: the procedure and the weights of GMR's ``motion_retarget.py`` and ``bvh_to_g1.json``; elbows
and hands have places in place of rotations.
"""

import os
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")

from importlib.metadata import version
from time import process_time

import mink
import mujoco
import numpy as np

LEAST, MOST, DAMPING, DT = 1e-3, 10, 0.5, 0.002


def tasks_of(sites, costs):
    tasks = {}
    for number, (site, (place, turn)) in enumerate(zip(sites, costs, strict=True)):
        if place > 0.0 or turn > 0.0:
            tasks[number] = mink.FrameTask(site, "site", place, turn, lm_damping=1.0)
    return tasks


def error(configuration, tasks):
    return np.linalg.norm(np.concatenate([t.compute_error(configuration) for t in tasks]))


def settle(configuration, tasks):
    before = error(configuration, tasks)
    for _ in range(MOST + 1):
        velocity = mink.solve_ik(configuration, tasks, DT, "daqp", DAMPING)
        configuration.integrate_inplace(velocity, DT)
        after = error(configuration, tasks)
        if before - after <= LEAST:
            return
        before = after


def main():
    job = np.load(sys.argv[1])
    model = mujoco.MjModel.from_xml_string(str(job["xml"]))
    configuration = mink.Configuration(model, job["start"])
    sites = [str(one) for one in job["sites"]]
    tables = [tasks_of(sites, costs) for costs in job["costs"]]
    place, turn = job["place"], job["rotation"]
    q = np.empty((len(place), model.nq))
    for _ in range(20):  # to get to the first frame
        frame(configuration, tables, place[0], turn[0])
    begun = process_time()
    for k in range(len(place)):
        frame(configuration, tables, place[k], turn[k])
        q[k] = configuration.q
    seconds = process_time() - begun
    order = [int(model.joint(str(name)).qposadr[0]) for name in job["joints"]]
    np.savez(
        sys.argv[2],
        base=q[:, [0, 1, 2, 4, 5, 6, 3]],
        joints=q[:, order],
        seconds=seconds,
        version=version("mink"),
    )


def frame(configuration, tables, place, turn):
    for tasks in tables:
        for number, task in tasks.items():
            turned = mink.SO3.from_matrix(turn[number])
            task.set_target(mink.SE3.from_rotation_and_translation(turned, place[number]))
        settle(configuration, list(tasks.values()))


if __name__ == "__main__":
    main()
