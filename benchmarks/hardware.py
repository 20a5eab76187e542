"""Two processes over loopback: a G1 stands up, walks, is pushed and sits down; with faults.

    python benchmarks/hardware.py                          # all, over DDS (extra unitree)
    python benchmarks/hardware.py walk --seconds 60 --bus udp
    python benchmarks/hardware.py killed stopped starved gone --repeat 5
    python benchmarks/hardware.py walk --slower 8          # slow motion, on a machine that is busy

``walk``: on estimated state alone. ``killed``, ``stopped``: how long after SIGKILL or SIGSTOP of
the loop the robot brakes. ``starved``: how long after processes of a higher priority than the
loop's, but not above the robot's, took all processors, for 0.2 s. ``gone``: how long after the
robot's process was killed the loop ends. An empty loop of 2 ms measures the machine's own lateness.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from wbc.hardware.real_time import CycleClock, real_time

PROBLEM = Path(__file__).parents[1] / "problems" / "walk_g1.yaml"
RESULT = Path(__file__).with_name("hardware.json")
READY = 60.0  # s in which a process is there
READY_HOGS = 1.0  # likewise
EXPERIMENTS = ("walk", "killed", "stopped", "starved", "gone")
# A process that takes a processor from a time on, for some seconds: above the loop's priority of
# 40, below the 50 of the robot's side.
HOG = """
import os, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(45))
begin = float(sys.argv[2])
time.sleep(max(0.0, begin - time.monotonic()))
while time.monotonic() < begin + 0.2:
    pass
"""
TOLERANCE = 2e-4


class Pair:
    """A simulated robot and a loop, each a process of ``wbc hardware``."""

    def __init__(
        self, bus: str, seconds: float, slower: float, domain: int, folder: Path, push: str = ""
    ) -> None:
        self.folder, self.slower = folder, slower
        shared = ["--bus", bus, "--domain", str(domain), "--slower", f"{slower:g}"]
        sim = ["sim", "g1", *shared, "--report", str(folder / "sim.json")]
        sim += ["--push", push] if push else []
        # The robot is another computer: it does not share a processor with the loop.
        first, *others = sorted(os.sched_getaffinity(0))
        self.sim = self._begin(sim, {first} if others else None)
        self._wait_for(self.sim, "ready")
        files = ["--log", str(folder / "log.npz"), "--report", str(folder / "run.json")]
        walks = ["--set", "gait.commands=[{at: 0.2, vx: 0.3}]"]  # until it is commanded to sit
        told = ["run", str(PROBLEM), *shared, "--unattended", f"{seconds:g}", *files, *walks]
        for cpu in 2 * others[-1:]:  # of the loop, and of its controller
            told += ["--cpu", str(cpu)]
        self.run = self._begin(told)

    def _begin(self, arguments: list[str], cpus: set[int] | None = None) -> subprocess.Popen[str]:
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-u", "-m", "wbc", "hardware", *arguments]
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, cpus or before)  # processes inherit it, with all of their threads
        try:
            return subprocess.Popen(
                command,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                env=environment,
            )
        finally:
            os.sched_setaffinity(0, before)

    def _wait_for(self, process: subprocess.Popen[str], word: str) -> None:
        assert process.stdout is not None
        said = list[str]()
        for line in process.stdout:
            said.append(line)
            if word in line:
                return
        raise RuntimeError(f"never said {word!r}: {''.join(said)}")

    def until(self, word: str) -> None:
        """Wait until the loop prints a word."""
        self._wait_for(self.run, word)

    def end(self) -> dict[str, Any]:
        """End the robot; return its results."""
        self.sim.send_signal(signal.SIGINT)
        self.sim.communicate(timeout=READY)
        return json.loads((self.folder / "sim.json").read_text())

    def __enter__(self) -> Pair:
        return self

    def __exit__(self, *_: object) -> None:
        for process in (self.run, self.sim):
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.kill()
            process.wait()
            if process.stdout is not None:
                process.stdout.close()


def walk(bus: str, seconds: float, slower: float, domain: int) -> dict[str, Any]:
    """Return the results of a whole run with a push of 6.3 N s in the middle."""
    with tempfile.TemporaryDirectory() as name:
        # The robot's clock runs from before the loop does, which takes some seconds to be there.
        push = f"{12.0 / slower + 4.5 + 0.5 * seconds:g},20,60,0.1"
        with Pair(bus, seconds, slower, domain, Path(name), push) as pair:
            said, _ = pair.run.communicate(timeout=600.0 + 2.0 * slower * (seconds + 30.0))
            robot = pair.end()
            file = Path(name) / "run.json"
            if not file.exists():
                raise RuntimeError(said)
            run = json.loads(file.read_text())
            path = np.array(robot["path"])
        keys = ("good", "reason", "cycles", "missed", "held", "lateness_ms", "tick_ms", "faults")
        return {
            "bus": bus,
            "seconds": seconds,
            "slower": slower,
            **{key: run[key] for key in keys},
            "share within 0.2 ms": run["share_within_0.2_ms"],
            "robot": {
                "fell": robot["fell"],
                "tilt": round(robot["tilt"], 3),
                "farthest from its start [m]": float(np.hypot(*path[:, 1:3].T).max().round(3)),
                "lowest, highest CoM [m]": [float(path[:, 4].min()), float(path[:, 4].max())],
                "pushed": any("pushed" in event[1] for event in robot["events"]),
                "commands": robot["commands"],
                "steps made up for": robot["late"],
            },
        }


def interrupted(bus: str, what: str, slower: float, domain: int) -> dict[str, Any]:
    """Return the delay between an interruption of the loop and the robot's braking."""
    with tempfile.TemporaryDirectory() as name, Pair(bus, 5.0, slower, domain, Path(name)) as pair:
        pair.until("standing up")
        time.sleep(1.5 * slower)
        sent = time.monotonic()
        if what == "killed":
            pair.run.kill()
            pair.run.wait()
        elif what == "stopped":
            pair.run.send_signal(signal.SIGSTOP)
            time.sleep(0.3 * slower)
            pair.run.send_signal(signal.SIGCONT)
        else:
            sent += READY_HOGS
            starve(sent)
        time.sleep(1.0 * slower)
        log, latest = Path(name) / "log.npz", time.monotonic() + READY
        while not log.exists() and time.monotonic() < latest:  # a process of its own writes it
            time.sleep(0.1)
        events = [event for event in pair.end()["events"] if event[0] > sent / slower]
        brakes = [event[0] for event in events if "damping" in event[1]]
        return {
            "damping after [ms]": round(1e3 * (brakes[0] - sent / slower), 1) if brakes else None,
            "commanded again": any(event[1] == "commanded" for event in events),
            "log": log.exists(),
        }


def starve(begin: float) -> None:
    """Take all processors from a time on [s, monotonic]."""
    hogs = [
        subprocess.Popen([sys.executable, "-c", HOG, str(cpu), repr(begin)])
        for cpu in os.sched_getaffinity(0)
    ]
    if any(hog.wait() for hog in hogs):
        raise RuntimeError("SCHED_FIFO was refused: see ulimit -r")


def gone(bus: str, slower: float, domain: int) -> dict[str, Any]:
    """Return the delay between the robot's death and the loop's end, and whether it logs."""
    with tempfile.TemporaryDirectory() as name, Pair(bus, 5.0, slower, domain, Path(name)) as pair:
        pair.until("standing up")
        time.sleep(1.5 * slower)
        sent = time.monotonic()
        pair.sim.kill()
        pair.run.communicate(timeout=READY)
        run = json.loads((Path(name) / "run.json").read_text())
        stops = [event for event in run["events"] if event[1] == "stop"]
        return {
            "stopped after [ms]": round(1e3 * (stops[0][0] - sent / slower), 1),
            "ended after [ms]": round(1e3 * (run["ended_at"] - sent / slower), 1),
            "reason": run["reason"],
            "log": (Path(name) / "log.npz").exists(),
        }


def empty_loop(seconds: float = 10.0) -> dict[str, float]:
    """Return the lateness of the cycles of an empty loop of 2 ms on this machine, now."""
    late = list[float]()
    with real_time(40):
        clock = CycleClock(0.002)
        for _ in range(round(seconds / clock.dt)):
            late.append(clock.wait().lateness)
    share = float(np.mean(np.array(late) <= TOLERANCE))
    return {"share within 0.2 ms": round(share, 5), "worst [ms]": round(1e3 * max(late), 2)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="*", choices=[*EXPERIMENTS, []], help="all")
    parser.add_argument("--bus", choices=("unitree", "udp"), default="unitree")
    parser.add_argument("--seconds", type=float, default=60.0, help="of walking")
    parser.add_argument("--slower", type=float, default=1.0)
    parser.add_argument("--repeat", type=int, default=3, help="of all but the walk")
    parser.add_argument("--domain", type=int, default=17)
    parser.add_argument("--output", type=Path, default=RESULT)
    wanted = parser.parse_args()
    output: Path = wanted.output
    found = json.loads(output.read_text()) if output.exists() else {}
    for what in wanted.what or EXPERIMENTS:
        machine = empty_loop()
        told: Any
        if what == "walk":
            told = walk(wanted.bus, wanted.seconds, wanted.slower, wanted.domain)
        elif what == "gone":
            told = [gone(wanted.bus, wanted.slower, wanted.domain) for _ in range(wanted.repeat)]
        else:
            told = [
                interrupted(wanted.bus, what, wanted.slower, wanted.domain)
                for _ in range(wanted.repeat)
            ]
        found[what] = {"empty loop": machine, "bus": wanted.bus, "slower": wanted.slower}
        found[what]["result"] = told
        print(what, json.dumps(found[what], indent=1), flush=True)
        output.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
