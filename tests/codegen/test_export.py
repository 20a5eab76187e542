"""The exported C, compiled and run as a program of its own, against the ticks of Python."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.command import wbc_command
from tests.needs import needs_compiler
from tests.robot.formats.mjcf_texts import arm as mjcf_arm
from tests.robot.formats.mjcf_texts import text as mjcf_text
from wbc.codegen import CodegenError, export_problem
from wbc.errors import InvalidInputError
from wbc.hardware.unitree import profile_named

VELOCITY = """
robot: hoap2_like
support: double
tasks:
  shape: {type: inertia, components: [xx, zz], target: {scale: 1.2}, ramp: 0.2, per_mass: true}
  com: {type: com, axes: [x, y], target: {offset: [0.01, 0.0, 0.0]}, ramp: 0.3, weight: 10}
  hand: {type: frame, frame: left_hand, control: pose, target: {position: {offset: [0.1, 0, 0]}}}
  trunk: {type: frame, frame: base, control: orientation, target: start, weight: 0.5}
  "state": {type: momentum, components: angular, weight: 0.1}
  "a b": {type: posture, target: start, weight: 0.01}
  "a-b": {type: posture, target: start, weight: 0.01}
  posture: {type: posture, target: start, weight: 0.05}
constraints: {bodies: {type: self_collision}}
controller: {solver: active_set}
stop: {duration: 1.0}
"""
TORQUE = """
robot: {model: hoap2_like, armature: 0.003}
support: double
tasks:
  com: {type: com, axes: [x, y], target: start, law: capture_point, weight: 30}
  height: {type: com, axes: [z], target: {offset: [0, 0, -0.02]}, ramp: 0.1, kp: 50}
  trunk: {type: frame, frame: base, control: orientation, target: start, kp: 50}
  facing: {type: frame, frame: torso, control: axis, axis: [1, 0, 0], target: [1, 0.1, 0], kp: 40}
  posture: {type: posture, kp: 30, weight: 0.3}
controller: {level: torque, dt: 0.002, solver: active_set, friction: 0.6}
simulation: {duration: 0.2}
"""
BOLTED = """
robot: {model: hoap2_like, base: fixed}
support: floating
tasks:
  hand: {type: frame, frame: left_hand, control: position, target: {offset: [0.05, 0, 0]}}
  posture: {type: posture, weight: 0.1}
controller: {level: torque, dt: 0.002, solver: active_set}
simulation: {duration: 0.2}
"""
LEVELS = {"velocity": VELOCITY, "torque": TORQUE, "torques of an arm": BOLTED}
TICKS = 50


def write(folder: Path, text: str) -> Path:
    path = folder / "problem.yaml"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def exports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of exports, compiled where that is possible."""
    made = {}
    for level, text in LEVELS.items():
        folder = tmp_path_factory.mktemp(level)
        export_problem(write(folder, text), folder / "c", ticks=TICKS)
        made[level] = folder / "c"
    return made


def build(folder: Path, *programs: str) -> None:
    """Compile a folder: it needs nothing but what is in it."""
    warn = "-std=c99 -O1 -ffp-contract=off -Wall -Wextra -Wpedantic -Werror"
    command = ["make", "replay", *programs, f"CFLAGS={warn}"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


def replay(folder: Path, recording: str = "recording.txt") -> subprocess.CompletedProcess[str]:
    command = ["./replay", recording]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("level", LEVELS)
def test_c_commands_what_python_does(level: str, exports: dict[str, Path]) -> None:
    folder = exports[level]
    build(folder)
    done = replay(folder)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"{TICKS} ticks")
    # What it is compared with decides: another last number is a difference, fewer are no recording.
    text = (folder / "recording.txt").read_text()
    last = text.rsplit(maxsplit=1)[-1]
    other = float.hex(float.fromhex(last) + 1e-6)
    (folder / "other.txt").write_text(text.removesuffix(f"{last}\n") + other)
    assert replay(folder, "other.txt").returncode == 1
    (folder / "short.txt").write_text(text[: len(text) // 2])
    short = replay(folder, "short.txt")
    assert short.returncode == 2
    assert "the recording ends in tick" in short.stderr
    (folder / "robot.txt").write_text(text.replace("wbc recording 1 50 ", "wbc recording 1 50 1"))
    assert replay(folder, "robot.txt").returncode == 2
    assert replay(folder, "nowhere.txt").returncode == 2


@pytest.fixture(scope="module")
def on_bus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a G1's estimator, safety layer and loop, compiled."""
    folder = tmp_path_factory.mktemp("bus")
    text = TORQUE.replace("hoap2_like", "g1").replace("frame: torso", "frame: torso_link")
    path = write(folder, text)
    exported = ["codegen", str(path), "-o", str(folder / "c"), "--ticks", "2"]
    done = wbc_command(*exported, "--robot", "unitree_g1")
    assert done.exit_code == 0, done.output
    build(folder / "c" / "hardware", "loop")
    return folder / "c" / "hardware"


@pytest.mark.slow
@needs_compiler
def test_c_estimates_and_decides_as_python_does(on_bus: Path) -> None:
    """Messages and cycles with some twenty kinds of faults: the same modes and faults, 1e-12."""
    folder = on_bus
    compared = replay(folder)
    assert compared.returncode == 0, compared.stderr
    assert "550 messages" in compared.stdout and "1500 cycles" in compared.stdout
    lines = (folder / "recording.txt").read_text().splitlines()
    # A number of the last estimate, the mode of a cycle and a torque that it commands.
    for line, number in ((550, -40), (1500, -5 * 29 - 4), (1500, -2 * 29 - 1)):
        words = lines[line].split()
        words[number] = float.hex(float.fromhex(words[number]) + 1.0)
        changed = [*lines[:line], " ".join(words), *lines[line + 1 :]]
        (folder / "other.txt").write_text("\n".join(changed))
        assert replay(folder, "other.txt").returncode == 1, (line, number)


@pytest.mark.slow
@needs_compiler
def test_a_reader_of_the_exported_loops_words_that_is_gone_does_not_end_it(on_bus: Path) -> None:
    """As ``./loop | head -1``: a signal ended it, and the robot was told nothing any more."""
    reader, writer = os.pipe()
    os.close(reader)
    command = ["./loop", "1", "127.0.0.1", "0.1", "48"]
    assert subprocess.run(command, cwd=on_bus, stdout=writer, check=False).returncode == 1
    os.close(writer)


@pytest.mark.slow
@needs_compiler
def test_the_exported_loop_stands_a_robot_up_over_udp(on_bus: Path) -> None:
    """Against the simulator process, in slow motion; that is killed, and the loop ends."""
    pytest.importorskip("mujoco")
    slower, domain = "10", "47"  # of ports that nothing else uses
    at = [sys.executable, "-u", "-m", "wbc", "hardware", "sim", "g1", "--bus", "udp"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    asked = [*at, "--slower", slower, "--domain", domain, "--priority", "0"]
    with subprocess.Popen(asked, **pipes) as robot:  # type: ignore[call-overload]
        line = robot.stdout.readline()
        assert "ready" in line, line + robot.stdout.read()
        command = ["./loop", "1", "127.0.0.1", slower, domain]
        with subprocess.Popen(command, cwd=on_bus, **pipes) as loop:  # type: ignore[call-overload]
            said = [loop.stdout.readline() for _ in range(2)]
            time.sleep(3.0)
            robot.kill()
            said.append(loop.stdout.read())
    assert "damping" in said[0] and "standing up" in said[1], said
    assert "no usable reading" in said[2], said
    assert loop.returncode == 3


PARTS = {
    "posture: {type: posture, target: start, weight: 0.05}": {
        "posture: {type: posture, target: start, weight: 0.05, priority: 1}": "levels of priority",
        "posture: {type: posture, target: start, singular_threshold: 0.1}": "singular_threshold of",
    },
    "per_mass: true": {
        "second_order: true": "second_order of task 'shape'",
        "about: left_sole": "an inertia about 'left_sole', as task 'shape'",
        "frame: left_hand": "task 'shape', a InertiaTask of a kind",
    },
    "constraints: {bodies: {type: self_collision}}": {
        "constraints: {over: {type: com_support}}": "constraints .'over'",
        "constraints: {bodies: {type: self_collision, exclude: [['*', '*']]}}": "watches no bodies",
        "constraints: {bodies: {type: self_collision}, over: {type: com_support}}": "'over'",
    },
    "constraints: {bodies: {type: self_collision}}\ncontroller: {solver: active_set}": {
        "controller: {method: pseudo_inverse}": "controller.method"  # which keeps no constraint
    },
    "stop: {duration: 1.0}": {
        "limits: {braking: bounded}": "the braking 'bounded'",
        "phases: {one: {duration: 1, support: double}}": "phases",
    },
    "controller: {solver: active_set}": {
        "controller: {solver: active_set, deadline: 0.001}": "a deadline",
        # It was said that no tick had a solution that is accurate enough.
        "controller: {solver: active_set, eps: 1.0e-4}": "an eps above 1e-06; set controller.eps",
    },
    "support: double": {
        "support: [left_sole, {frame: right_sole, slack: 100}]": "may give way: 'right_sole'"
    },
    "dt: 0.002": {
        "dt: 0.002, delay: 0.004": "a delay to predict over",
        "dt: 0.002, friction_compensation: 1": "dry friction",
    },
}
REFUSED = [(old, new, said) for old, by in PARTS.items() for new, said in by.items()]


@pytest.mark.parametrize(("old", "new", "said"), REFUSED, ids=[said for *_, said in REFUSED])
def test_what_the_core_does_not_know_and_python_makes_up_for_is_named(
    old: str, new: str, said: str, tmp_path: Path
) -> None:
    text = VELOCITY if old in VELOCITY else TORQUE
    assert text.count(old) == 1
    path = write(tmp_path, re.sub(r", ramp: [\d.]+", "", text.replace(old, new)))
    with pytest.raises(CodegenError, match=said):
        export_problem(path, tmp_path / "c")
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize(
    ("model", "support", "controller", "said"),
    [
        ("hoap2_like", "double", "level: torque", "unitree_g1: no motor for joint head_yaw"),
        ("g1", "double", "level: torque, dt: 0.005", "0.005 s is no multiple of the cycle"),
        ("g1", "left", "level: torque, dt: 0.002", "begins with right in the air"),
        ("g1", "double", "dt: 0.002", "a robot is commanded torques"),
    ],
)
def test_what_no_loop_can_run_is_written_for_no_robot(
    model: str, support: str, controller: str, said: str, tmp_path: Path
) -> None:
    """A tick of 5 ms was made every 6, one of 1 every 2; of velocities all torques were 0."""
    end = "simulation" if "torque" in controller else "stop"
    path = write(
        tmp_path,
        f"robot: {model}\nsupport: {support}\ntasks: {{posture: {{type: posture}}}}\n"
        f"controller: {{{controller}}}\n{end}: {{duration: 0.1}}\n",
    )
    with pytest.raises(InvalidInputError, match=said):
        export_problem(path, tmp_path / "c", ticks=2, robot=profile_named("unitree_g1"))
    assert not (tmp_path / "c").exists()


def test_joints_with_springs_are_named_with_what_to_do(tmp_path: Path) -> None:
    arm = mjcf_text(
        mjcf_arm('stiffness="5" springref=".1"'), tail='<actuator><motor joint="j1"/></actuator>'
    )
    (tmp_path / "arm.xml").write_text(arm)
    path = write(tmp_path, BOLTED.replace("hoap2_like", "arm.xml").replace("left_hand", "arm"))
    with pytest.raises(CodegenError, match=r"springs.* \(j1\); leave them .* level: velocity"):
        export_problem(path, tmp_path / "c")


def test_a_safety_layer_of_an_earlier_export_is_not_left_beside_another_controller(
    tmp_path: Path,
) -> None:
    """A G1's joints, gains and limits, beside a small humanoid's tick, agreed with themselves."""
    (tmp_path / "c" / "hardware").mkdir(parents=True)
    (tmp_path / "c" / "hardware" / "data.c").touch()
    with pytest.raises(CodegenError, match=r"hardware: of an earlier export.*--robot"):
        export_problem(write(tmp_path, VELOCITY), tmp_path / "c", ticks=2)


def test_a_recorded_robot_that_fell_is_told(tmp_path: Path) -> None:
    """A single tick to compare with was the only sign of it."""
    fragile = "simulation: {duration: 0.2, falls: {tilt: 1.0e-9}}"
    path = write(tmp_path, TORQUE.replace("simulation: {duration: 0.2}", fragile))
    done = wbc_command("codegen", path, "-o", tmp_path / "c")
    assert "note: the recorded robot fell at t = 0.0" in done.output


@pytest.mark.slow
def test_ticks_that_need_python_are_left_out_and_said(tmp_path: Path) -> None:
    """What no tick can keep is relaxed by Python alone; joints outside limits are no reason."""
    sensors = "simulation: {duration: 0.1, sensors: {position_noise: %s}}"
    path = write(tmp_path, TORQUE.replace("simulation: {duration: 0.2}", sensors % 0.06))
    assert not export_problem(path, tmp_path / "c").recording.left_out
    path = write(tmp_path, TORQUE.replace("simulation: {duration: 0.2}", sensors % 0.3))
    recording = export_problem(path, tmp_path / "c").recording
    reason, left_out = next(iter(recording.left_out.items()))
    assert reason == "its QP has no solution: rows contradict each other"
    assert sum(recording.left_out.values()) + len(recording.ticks) == 50
    done = wbc_command("codegen", path, "-o", tmp_path / "c")
    assert f"note: in {left_out} ticks, left out, C gives no command: {reason}" in done.output
    write(tmp_path, TORQUE.replace("simulation: {duration: 0.2}", sensors % 10.0))
    with pytest.raises(CodegenError, match="in any tick of the run: its QP has no solution"):
        export_problem(path, tmp_path / "none")


def test_command_line(tmp_path: Path) -> None:
    path = write(tmp_path, VELOCITY.replace("solver: active_set", "solver: proxqp"))
    folder = tmp_path / "c"
    done = wbc_command("codegen", path, "-o", folder, "--ticks", "3")
    assert done.exit_code == 0, done.output
    assert "not by proxqp" in done.output
    assert {"Makefile", "README.md", "main.c", "plan.c", "recording.txt"} < set(os.listdir(folder))
    header = (folder / "plan.h").read_text()
    for name in (
        "WBC_TASK_A_B",
        "WBC_TASK_A_B_2",
        "WBC_TASK_HAND_POSITION",
        "WBC_TASK_HAND_ORIENTATION",
        "WBC_CONTACT_LEFT_SOLE",
    ):
        assert f"{name} = " in header
    assert (folder / "recording.txt").read_text().startswith("wbc recording 1 3 ")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["planar"], "give --mass"),
        (["planar", "--mass", "20", "--ticks", "3"], "--ticks: belongs to a problem"),
        (["mine.yaml", "--mass", "20"], "--mass: belongs to a pendulum"),
        (["mine.yaml"], "give --output"),
        (["planer", "-o", "here"], "did you mean 'planar'"),
    ],
)
def test_mistakes_on_the_command_line(arguments: list[str], said: str) -> None:
    done = wbc_command("codegen", *arguments)
    assert done.exit_code == 1
    assert said in done.output
