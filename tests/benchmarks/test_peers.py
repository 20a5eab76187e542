"""The loop beside the neighbours: the job is the same for all, and unequal work is told."""

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.peers import run, serve
from wbc.robot import Robot
from wbc.rotations import exp_rotation


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> serve.Job:
    return serve.Job(run.write_job(tmp_path_factory.mktemp("job"), 0.005))


def test_the_job_is_a_robot_without_shapes_at_the_same_start(job: serve.Job) -> None:
    robot, stripped = Robot.load(job.robot), Robot.load(job.urdf)
    assert list(job.joints) == list(robot.joint_names) == list(stripped.joint_names)
    q = stripped.posture("neutral", joints=job.joints, on_ground=False)
    q[:7] = job.base
    one, other = robot.snapshot(robot.posture("standing")), stripped.snapshot(q)
    assert np.allclose(one.com, other.com, atol=1e-12)
    assert stripped.mass == pytest.approx(robot.mass)
    for frame in (*job.feet, job.trunk):
        assert np.allclose(one.position(frame), other.position(frame), atol=1e-12)
    # The corners of the soles are on the ground.
    for foot, corners in zip(job.feet, job.corners, strict=True):
        world = one.position(foot) + np.array(corners) @ one.rotation(foot).T
        assert len(world) == 4 and np.allclose(world[:, 2], 0.0, atol=1e-9)
    assert 'type="floating"' in Path(job.mjcf).read_text()


def test_pairs_are_spheres_about_links_and_their_gap_is_measured(tmp_path: Path) -> None:
    pairs = run.sphere_pairs()
    assert len(pairs) == len(set(pairs)) == 25
    job = serve.Job(run.write_job(tmp_path, 0.005, pairs))
    text = Path(job.urdf).read_text()
    assert text.count("<sphere") == Path(job.mjcf).read_text().count("<sphere") == len(job.balls)
    robot = Robot.load(job.robot)
    here = robot.snapshot(robot.posture("standing"))
    apart = [np.linalg.norm(here.position(a) - here.position(b)) for a, b in pairs]
    centres = np.array([here.position(link) for link in job.balls])
    assert job.gap(centres) == pytest.approx(min(apart) - 2 * run.RADIUS)
    assert job.gap(centres) > run.MARGIN


def test_targets_are_what_they_are_said_to_be(job: serve.Job) -> None:
    start = exp_rotation(np.array([0.3, -0.2, 0.5]))
    for k in (0, 1, 77, 400):
        wanted = start @ exp_rotation(serve.TURN * np.sin(k * job.dt))
        assert np.allclose(job.trunk_rotation(start, k), wanted, atol=1e-12)
    # After half a second the CoM's x has made a quarter of its two-second period.
    assert job.com(np.zeros(3), 100)[0] == pytest.approx(0.01)


def test_unequal_work_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with subprocess.Popen(["true"], text=True) as process:
        fine = {"com_rms": 2.5e-4, "drift": 1e-7, "speed": 0.1}
        one = run.Loop("PlaCo (C++)", process, {}, [4e-5, 5e-5, 6e-5], [4e-5] * 3, fine)
        slow = replace(one, label="other", times=[1e-4] * 3, ticks=[3e-5] * 3)
        loops = [slow, replace(one, label="wbc"), one]
        table = run.rows(loops)
        assert "| other | 100 | 100 | 2.00 | 30 | 0.75 | 0.250 |" in table[2]
        assert not capsys.readouterr().err
        for wrong in ({"com_rms": 3e-4}, {"drift": 1e-3}, {"speed": 1.1}, {"gap": 0.009}):
            run.rows([replace(loops[0], last={**fine, **wrong}), *loops[1:]])
            assert "UNEQUAL WORK: other" in capsys.readouterr().err
