"""The cost of the live viewer in the control loop: the same ticks with and without it, in turns.

    python -m benchmarks.viewer [--problem problems/safe_reach_g1.yaml] [--blocks 40] [--ticks 100]

Three loops take turns, block by block: one without a viewer; one that updates a viewer whose frames
are made and thrown away; and one whose frames are drawn by the page's process, with a client that
reads everything. The second measures the viewer's cost in the loop: storing a reference, and the
interpreter's lock while frames are made. The third adds another process next to the loop: free on
an idle processor, otherwise its share of the machine.

Printed are medians over the blocks of the CPU time of the loop's thread and of clock time, and the
median ratio to the neighbouring block without a viewer, with its 90 % bootstrap interval over these
blocks. Each block begins with ticks that are not measured, in which the page finishes drawing.
Paced loops sleep until the next tick is due, as a real one does; their time excludes the sleep. The
client has the lowest priority: it stands for a browser, which is not measured.

On a busy machine these ratios are noise of several percent. The loop's possible loss in its own
process is bounded without them: by the CPU time of update() and of the frames that the viewer's
threads make, as if a paced loop had waited for all of it. Drawing happens in another process.
"""

from __future__ import annotations

import argparse
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from wbc.controllers import Controller
from wbc.problem import load_problem
from wbc.problem.problem import Problem
from wbc.view.live.viewer import PERIOD, Viewer

ALONE, MADE, DRAWN = "nobody looks", "frames made", "frames drawn"
WARM_UP = 0.2  # of a block: its first ticks, not measured
_CLIENT = (
    "import os, sys, msgspec, viser\n"
    "from websockets.sync.client import connect\n"
    "address = sys.argv[1].replace('http', 'ws').replace('localhost', '127.0.0.1')\n"
    "client = connect(address, subprotocols=['viser-v' + viser.__version__], max_size=None)\n"
    "client.send(msgspec.msgpack.encode({**CAMERA, 'type': 'ViewerCameraMessage'}))\n"
    "os.nice(19)\n"
    "client.recv(); print('connected', flush=True)\n"
    "for _ in client: pass\n"
)
CAMERA = {  # a browser counts as a client once it has told its camera
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 0.0, 1.0),
    "fov": 1.0,
    "near": 0.01,
    "far": 100.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


def block(
    controller: Controller, q: np.ndarray, ticks: int, viewer: Viewer | None, paced: bool
) -> tuple[float, float]:
    """Return CPU and clock time per tick [s] of a closed loop from ``q``."""
    robot, dt = controller.robot, controller.dt
    v = np.zeros(robot.nv)
    cpu = clock = 0.0
    due = time.perf_counter()
    first = round(WARM_UP * ticks)
    for k in range(ticks):
        if k == first:
            cpu = clock = 0.0
        began, cpu_began = time.perf_counter(), time.thread_time()
        snapshot = robot.snapshot(q, v)
        tick = controller.step(snapshot)
        v = tick.velocity
        q = robot.integrate(q, v, dt)
        if viewer is not None:
            viewer.update(snapshot, tick, k * dt)
        cpu += time.thread_time() - cpu_began
        clock += time.perf_counter() - began
        if paced:  # as a real loop, which frees the processor until its next period
            due += dt
            time.sleep(max(0.0, due - time.perf_counter()))
    return cpu / (ticks - first), clock / (ticks - first)


@contextmanager
def client(url: str) -> Iterator[None]:
    """Start a client in another process, which reads whatever the page sends."""
    program = _CLIENT.replace("CAMERA", repr(CAMERA))
    process = subprocess.Popen([sys.executable, "-c", program, url], stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None and process.stdout.readline(), "the client has ended"
        yield
    finally:
        process.terminate()
        process.wait()


def measure(problem: Problem, blocks: int, ticks: int, paced: bool, update: float) -> None:
    """Print the viewer's cost; ``update`` [s] is that of one update."""
    controller, q = problem.executor().controller, problem.parts.start
    found: dict[str, list[tuple[float, float]]] = {ALONE: [], MADE: [], DRAWN: []}
    frames: list[float] = []  # CPU time of each, in blocks whose frames are drawn
    with Viewer(problem.parts.robot, controller, quiet=True) as viewer, client(viewer.url):
        send: Callable[[object], None] = viewer._page.send

        def throw_away(message: object) -> None:
            pickle.dumps(message, pickle.HIGHEST_PROTOCOL)

        block(controller, q, 10 * ticks, viewer, paced=True)  # the page loads its meshes
        for k in range(blocks):
            for name in list(found)[:: 1 if k % 2 else -1]:
                viewer._page.send = throw_away if name == MADE else send  # type: ignore[method-assign]
                one = None if name == ALONE else viewer
                before, made = threads_cpu(viewer), viewer._taken
                found[name].append(block(controller, q, ticks, one, paced))
                if name == DRAWN:
                    made = viewer._taken - made
                    frames.append((threads_cpu(viewer) - before) / max(made, 1))
        viewer._page.send = send  # type: ignore[method-assign]
    alone = np.array(found[ALONE])
    for name, times in found.items():
        here = np.array(times)
        cpu, clock = 1e6 * np.median(here, axis=0)
        more = [increase(ratio) for ratio in (here / alone).T]
        print(
            f"  {name:12} {cpu:7.1f} us CPU a tick {more[0]}, {clock:7.1f} by the clock {more[1]}"
        )
    frame, tick = float(np.median(frames)), float(np.median(alone[:, 0]))
    most = update + frame * (controller.dt if paced else tick) / PERIOD
    print(
        f"  in the loop's process: {1e6 * frame:.0f} us CPU a frame, at most {1e6 * most:.1f} us a"
        f" tick ({100.0 * most / tick:.2f} %)"
    )


def threads_cpu(viewer: Viewer) -> float:
    """Return the CPU time of the viewer's threads in this process [s]."""
    clocks = [time.pthread_getcpuclockid(one.ident) for one in viewer._threads if one.ident]
    return sum(time.clock_gettime(clock) for clock in clocks)


def increase(ratios: np.ndarray) -> str:
    """Return the median increase of ratios, with its 90 % interval by bootstrap, in words."""
    again = np.random.default_rng(0).choice(ratios, (2000, len(ratios)))
    low, high = np.quantile(np.median(again, axis=1), (0.05, 0.95))
    found = [100.0 * (one - 1.0) for one in (np.median(ratios), low, high)]
    return f"({found[0]:+.1f} %, {found[1]:+.1f} to {found[2]:+.1f})"


def update_cost(problem: Problem) -> float:
    """Return the time of one update by itself [s]."""
    robot, controller = problem.parts.robot, problem.executor().controller
    snapshot = robot.snapshot(problem.parts.start)
    tick = controller.step(snapshot)
    with Viewer(robot, controller, quiet=True) as viewer:
        count = 200_000
        began = time.thread_time()
        for k in range(count):
            viewer.update(snapshot, tick, 0.001 * k)
        return (time.thread_time() - began) / count


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--problem", type=Path, default=Path("problems/safe_reach_g1.yaml"))
    parser.add_argument("--blocks", type=int, default=40)
    parser.add_argument("--ticks", type=int, default=100)
    options = parser.parse_args()
    problem = load_problem(options.problem)
    assert isinstance(problem, Problem), "a robot's problem"
    update = update_cost(problem)
    print(f"update(): {1e6 * update:.2f} us of CPU")
    for paced in (True, False):
        pace = "in real time" if paced else "as fast as can be"
        print(f"{options.problem.stem}, {pace}, load {os.getloadavg()[0]:.1f}:", flush=True)
        measure(problem, options.blocks, options.ticks, paced, update)


if __name__ == "__main__":
    main()
