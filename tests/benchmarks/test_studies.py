"""Studies run as scripts, find what they should, and judge and picture robots rightly."""

import ast
import subprocess
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import coal
import collision
import library_robots
import numpy as np
import pinocchio as pin
import pytest
import thrown
from exposures import exposures_figure, together
from sources import code_of

from benchmarks import infeasible
from benchmarks.peers import run, serve
from benchmarks.simulation import measure
from wbc.constraints import Limits, SelfCollision
from wbc.errors import InvalidInputError
from wbc.problem.simulation_spec import rotated_to_plane
from wbc.qp.solution import Conflict
from wbc.robot import Robot
from wbc.rotations import exp_rotation
from wbc.simulation import Step, Terrain
from wbc.validate import Array
from wbc.view.options import View
from wbc.view.portrait import Pose, portraits_of
from wbc.view.style import save


@pytest.mark.slow
def test_an_episode_begins_outside_all_margins_and_keeps_them(hoap2: Robot) -> None:
    limits = Limits(hoap2)
    margins = SelfCollision(hoap2, margin=collision.MARGIN, pairs=collision.PAIRS, limits=limits)
    assert margins.margins.min() < collision.MARGIN  # what once made it search for ever
    rng, record = np.random.default_rng(0), collision.Record()
    q = collision.clear_posture(hoap2, margins, rng)
    assert (margins.model.nearest(hoap2.snapshot(q)).distance > margins.margins).all()
    collision.episode(hoap2, margins, limits, "double", rng, "daqp", record)
    assert record.ticks == collision.EPISODE and set(record.statuses) == {"solved"}
    assert record.broken < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "ticks", "seed"), [("g1", 150, 0), ("hoap2_like", 120, 1)])
def test_rows_for_few_pairs_keep_all_pairs_of_a_fast_robot(robot, ticks, seed) -> None:
    """Hundreds were broken, by decimetres, when only the 25 nearest had rows.

    Where a hand moves 3 cm by a radian, as hoap2_like's, a task pushed it 15 mm into others.
    """
    row = thrown.thrown(robot, "nothing", 25, ticks, seed).split()
    broken, worst = int(row[6]), float(row[7])
    assert broken <= 5 and worst < 0.5


@pytest.mark.slow
def test_rows_for_few_pairs_keep_fast_arms_off_obstacles() -> None:
    """Hands went 47 mm into balls, and feet slipped, when only the 5 nearest had rows."""
    row = thrown.thrown("g1", "balls", 5, 150, 2).split()
    broken, worst, slipped = int(row[6]), float(row[7]), float(row[-1])
    assert broken == 0 and worst == 0.0 and slipped < 1.0


@pytest.mark.parametrize("family", infeasible.FAMILIES)
def test_every_row_that_a_tick_names_is_to_blame(hoap2, family) -> None:
    rng, robot = np.random.default_rng(0), hoap2
    controller, here, limits = infeasible.contradictory(robot, family, rng)
    tick, box = controller.step(here), limits.emergency_braking_box(here, controller.dt)
    assert not tick.ok
    assert infeasible.check_answer(tick, box) == []
    fewer = Conflict(tick.conflict.rows[1:])
    other = SimpleNamespace(velocity=tick.velocity, qp=tick.qp, ok=False, conflict=fewer)
    found = infeasible.check_answer(other, box)
    assert found == ["no row named"] or "they can all hold" in found[0]


def test_a_line_of_the_table() -> None:
    cells = [cell.strip() for cell in measure("hoap2_like", "daqp", 0.1).strip("|").split("|")]
    assert cells[:2] == ["hoap2_like", "daqp"] and cells[-1] == "stood for 0.100 s"
    times = [float(cell) for cell in cells[2:9]]
    assert all(time > 0.0 for time in times)
    cpu, physics, ticks, rest = times[1:5]
    assert abs(cpu - physics - ticks - rest) < 0.02  # of which it is the sum, rounded


BOARD = Step(centre=(0.5, 0.0, 0.05), size=(0.4, 0.6, 0.05))
TERRAIN = Terrain(slope=(0.1, 0.0), steps=(BOARD,))
FROM_THE_LEFT = View.of("90,10", "robot,ground,soles,com")


@pytest.fixture(scope="module")
def walk(hoap2: Robot) -> dict[str, Array]:
    """Standing on the slope, and half a metre and a metre up."""
    start = rotated_to_plane(hoap2.posture("standing"), TERRAIN.normal)
    found = {}
    for name, ahead in (("0 s", 0.0), ("1 s", 0.5), ("2 s", 1.0)):
        found[name] = start.copy()
        found[name][[0, 2]] += (ahead, 0.1 * ahead)
    return found


def test_robots_stand_where_they_were(hoap2: Robot, walk: dict[str, Array]) -> None:
    poses = {name: Pose(q, terrain=TERRAIN) for name, q in walk.items()}
    portraits = portraits_of(hoap2, poses)
    scene = together(portraits)
    alone = portraits[0].scene
    assert len(scene.corners) == 3 * len(alone.corners)
    np.testing.assert_allclose(scene.corners[-len(alone.corners) :], alone.corners + (1, 0, 0.1))
    assert scene.size == alone.size < scene.spread == pytest.approx(1.0, abs=0.5)
    np.testing.assert_allclose(scene.centre, portraits[1].scene.centre, atol=1e-9)
    (board,) = scene.boards
    assert board.vertices[:, 2].max() == pytest.approx(0.05)
    assert not scene.glass


@pytest.mark.slow
def test_names_stand_above_the_robots_in_their_order(hoap2, walk, tmp_path) -> None:
    way = np.column_stack((np.linspace(0.0, 1.0, 50), np.zeros(50), np.full(50, 0.4)))
    figure = exposures_figure(hoap2, walk, path_of_com=way, terrain=TERRAIN, view=FROM_THE_LEFT)
    (axes,) = figure.axes
    places = {text.get_text(): text.get_position() for text in axes.texts}
    # From the left, ahead is to the left; uphill is higher, and rows count downwards.
    assert list(places) == ["0 s", "1 s", "2 s"]
    x, y = np.array(list(places.values())).T
    assert (np.diff(x) < 0.0).all() and (np.diff(y) < 0.0).all()
    told = [text.get_text() for text in figure.texts]
    assert told == ["quartered disc: CoM; orange: soles; black: path of the CoM on the ground"]
    path = save(figure, tmp_path / "walk.png")
    assert path.read_bytes().startswith(b"\x89PNG")


def test_the_way_of_the_com_is_on_the_ground(hoap2: Robot, walk: dict[str, Array]) -> None:
    """Seen from the side, it is as steep as the slope, and jumps up and down at the board."""
    x = np.linspace(0.0, 1.0, 101)
    way = np.column_stack((x, np.zeros(101), np.full(101, 0.4)))
    figure = exposures_figure(hoap2, walk, path_of_com=way, terrain=TERRAIN, view=FROM_THE_LEFT)
    lines = max(figure.axes[0].collections, key=lambda one: len(one.get_segments()))
    points = np.array([line[0] for line in lines.get_segments()])
    metre = (points[0, 0] - points[-1, 0]) / (x[-2] - x[0])  # pixels, nearly: a long lens
    risen = (points[0, 1] - points[:, 1]) / metre
    on_board = (x[:-1] > 0.31) & (x[:-1] < 0.69) & (0.1 * x[:-1] < 0.05)
    on_slope = (x[:-1] < 0.29) | (x[:-1] > 0.71)
    np.testing.assert_allclose(risen[on_slope], 0.1 * x[:-1][on_slope], atol=4e-3)
    np.testing.assert_allclose(risen[on_board], 0.05, atol=4e-3)


@pytest.mark.parametrize("path", [[[0.0, 0.0]], [0.0, 0.0, 0.0], [["x", 0, 0]], [[np.nan, 0, 0]]])
def test_a_path_that_is_none_is_a_typed_error(hoap2, path) -> None:
    with pytest.raises(InvalidInputError, match="path_of_com"):
        exposures_figure(hoap2, {"stands": hoap2.posture("standing")}, path_of_com=path)


@pytest.fixture(scope="module")
def bolt() -> Robot:
    return Robot.load(library_robots.folder() / "bolt_description/robots/bolt.urdf")


@pytest.mark.slow
def test_a_margin_that_raw_shapes_break_is_found(bolt: Robot) -> None:
    margins = SelfCollision(bolt, margin=0.01)
    raw = library_robots.RawShapes(bolt, margins)
    q = bolt.posture("standing")
    assert raw.broken(q) == (0.0, "")
    crossed = bolt.posture("standing", {"FL_HAA": -0.4, "FR_HAA": 0.4})
    by, pair = raw.broken(crossed)
    assert by > 0.0099  # m: they meet
    first, second = pair.split(" vs ")
    data = bolt.model.createData()
    pin.forwardKinematics(bolt.model, data, crossed)
    shapes = {shape.name: shape for shape in bolt.collision_model.geometryObjects}
    placed = []
    for name in (first, second):
        pose = data.oMi[shapes[name].parentJoint] * shapes[name].placement
        placed += [shapes[name].geometry, coal.Transform3s(pose.rotation, pose.translation)]
    meeting = coal.collide(*placed, coal.CollisionRequest(), coal.CollisionResult())
    assert meeting > 0


def test_random_ticks_keep_the_margins_of_bolt(bolt: Robot) -> None:
    seen = library_robots.random_ticks(bolt, ticks=1, seed=3)
    assert seen.startswith("400 ticks, 26 raw pairs")
    assert "margin broken by 0.0000 mm" in seen
    assert "{'solved': 400}" in seen


def test_what_stands_on_two_feet_is_a_humanoid(bolt: Robot) -> None:
    assert library_robots.is_humanoid(bolt)
    assert library_robots.verdict(bolt) == "stands on FL_FOOT (4), FR_FOOT (4)"
    arm = library_robots.loaded(library_robots.folder() / "z1_description/urdf/z1.urdf")
    assert isinstance(arm, Robot)
    assert not library_robots.is_humanoid(arm)
    assert library_robots.verdict(arm) == "fixed base"
    assert "no <link>" in str(
        library_robots.loaded(library_robots.folder() / "ur_description/urdf/ur3.urdf")
    )


@pytest.mark.slow
def test_mimic_joints_of_random_postures_follow_their_drivers() -> None:
    """Else every tick is infeasible, and margins are kept by a robot that stands still."""
    path = next(library_robots.folder().rglob("talos_full_v2.urdf"))
    robot = library_robots.loaded(path)
    margins = SelfCollision(robot, margin=library_robots.MARGIN)
    random, opened = np.random.default_rng(1), 0.0
    assert len(robot.couplings) == 12
    for _ in range(4):
        q = library_robots.clear_posture(robot, margins, random)
        joints = dict(zip(robot.limits.names, robot.limits.joint_positions(q), strict=True))
        for joint, gear in robot.couplings.items():
            assert joints[joint] == pytest.approx(gear.ratio * joints[gear.driver] + gear.offset)
            opened = max(opened, abs(joints[joint]))
    assert opened > 0.01


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


FOLDER = Path(__file__).parents[2] / "benchmarks"
AS_MODULES = {"mutation.py", "mutation_trials.py"}  # python -m benchmarks.mutation


def test_the_code_is_every_source_by_name_and_content(tmp_path: Path) -> None:
    code = partial(code_of.__wrapped__, tmp_path)
    (tmp_path / "gait").mkdir()
    law, rows = tmp_path / "gait" / "law.py", tmp_path / "rows.c"
    law.write_text("gain = 1.0\n")
    rows.write_text("int rows;\n")
    seen = {code()}
    (tmp_path / "law.pyc").write_text("compiled")
    assert code() in seen
    law.write_text("gain = 2.0\n")
    seen.add(code())
    rows.rename(tmp_path / "other.c")
    seen.add(code())
    assert len(seen) == 3


def test_scripts_import_their_neighbours_by_their_own_names() -> None:
    for path in FOLDER.glob("*.py"):
        nodes = [] if path.name in AS_MODULES else ast.walk(ast.parse(path.read_text()))
        found = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
        assert not [name for name in found if name.partition(".")[0] == "benchmarks"], path.name
