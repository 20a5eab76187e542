"""A loop and a robot, each a process of its own, over UDP on this machine, in slow motion.

Whole walks in two processes are benchmarks/hardware.py's: a machine that runs tests is too busy.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco")
from hardware import PROBLEM, interrupted

from wbc.hardware.worker import can_fork

# Of ports that nothing else uses, nor another suite at the same time: 9950 to 29949.
DOMAIN = 100 + os.getpid() % 10_000

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not can_fork(), reason="the controller has no process of its own here"),
]


@pytest.mark.parametrize("what", ["killed", "stopped"])
def test_a_loop_that_is_killed_or_stopped_leaves_a_robot_that_brakes(what: str) -> None:
    """Both were starved: an unknown word was that."""
    found = interrupted("udp", what, 4.0, DOMAIN)
    assert found["damping after [ms]"] is not None
    assert not found["commanded again"] and found["log"]


def test_a_simulated_robot_that_is_ended_by_a_signal_says_so(tmp_path: Path) -> None:
    """Its exit code was 0, and a closed terminal left no report."""
    report = tmp_path / "sim.json"
    command = [sys.executable, "-u", "-m", "wbc", "hardware", "sim", "g1", "--bus", "udp"]
    command += ["--domain", str(DOMAIN), "--report", str(report)]
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # tests may run under nohup themselves
    try:
        sim = subprocess.Popen(command, stdout=subprocess.PIPE)
    finally:
        signal.signal(signal.SIGHUP, before)
    with sim:
        assert sim.stdout is not None and sim.stdout.readline().endswith(b"ready\n")
        sim.send_signal(signal.SIGHUP)
        try:
            assert sim.wait(60.0) == 128 + signal.SIGHUP and report.exists()
        finally:
            sim.kill()


def test_an_unattended_robot_that_hangs_ends_with_3(tmp_path: Path) -> None:
    """Scripts took it for a run: it ended with 0."""
    shared = ["--bus", "udp", "--domain", str(DOMAIN), "--slower", "2"]
    wbc = [sys.executable, "-u", "-m", "wbc", "hardware"]
    run = [*wbc, "run", str(PROBLEM), "--robot", "unitree_g1", "--unattended", "1", *shared]
    run += ["--log", str(tmp_path / "log.npz")]
    for _ in range(4):  # a busy machine may not read for 25 ms: then the robot stops for that
        with subprocess.Popen(
            [*wbc, "sim", "g1", "--lifted", "0.35", *shared], stdout=subprocess.PIPE
        ) as sim:
            try:
                assert sim.stdout is not None and sim.stdout.readline().endswith(b"ready\n")
                ended = subprocess.run(
                    run, capture_output=True, text=True, timeout=120.0, check=False
                )
            finally:
                sim.kill()
        if "stop: no usable reading" not in ended.stdout:
            break
    assert ended.returncode == 3 and "it hangs: its feet bear" in ended.stdout, ended.stdout
