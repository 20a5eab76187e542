"""Reports: whole, small, offline, and what they replay is the run."""

import base64
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.command import wbc_command
from tests.needs import BROWSER, SOFTWARE, needs_browser
from tests.problem.loading import problem_of
from tests.standing import sole_corners
from tests.texts import REACH
from tests.view.reading import data_of, numbers
from wbc.errors import InvalidInputError
from wbc.robot.geometry import RobotMeshes
from wbc.run import Result
from wbc.simulation import Step, Terrain
from wbc.view.history import read_history
from wbc.view.report import write_report
from wbc.view.report.replay import MOST, replay_data, replay_rows
from wbc.view.report.report import report_text
from wbc.view.solids import limit_triangles

ODD = """# </script><b>@DATA@ & "quotes"\n""" + REACH


def corners_of(part: dict[str, Any]) -> np.ndarray:
    """Return the corners (k, 3) of a mesh, which are kept in steps from the lowest."""
    return np.array(part["low"]) + np.array(part["step"]) * numbers(part["corners"], (-1, 3), "<u2")


def rotation(quaternion: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(quaternion).as_matrix()


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return problem_of(tmp_path_factory.mktemp("reach"), ODD).run()


@pytest.fixture(scope="module")
def page(result: Result) -> str:
    return report_text(result.robot, result.history, result.summary(), "a <title>")


def test_the_replay_is_the_run(result: Result, page: str) -> None:
    data, history, robot = data_of(page), result.history, result.robot
    rows = replay_rows(history.time)
    assert (rows[0], rows[-1]) == (0, len(history) - 1)
    count = len(rows)
    np.testing.assert_allclose(numbers(data["time"], (count,)), history.time[rows], atol=1e-6)
    np.testing.assert_allclose(numbers(data["com"], (count, 3)), history.com[rows], atol=1e-6)
    places = numbers(data["places"], (count, data["joints"], 7))
    for place, row in zip(places, rows, strict=True):
        rotations, origins = robot.snapshot(history.q[row]).joint_placements
        np.testing.assert_allclose(place[:, :3], origins, atol=1e-6)
        np.testing.assert_allclose(rotation(place[:, 3:]), rotations, atol=1e-6)
    axes, sizes = numbers(data["axes"], (count, 3, 3)), numbers(data["sizes"], (count, 6))
    # Of an ellipsoid of mass M: I = M/5 (tr(S) - S), S = axes diag(a^2) axes'; 3 r^2 = 5 * a^2 / 5.
    S = np.einsum("kij,kj,klj->kil", axes, sizes[:, :3] ** 2, axes)
    inertia = robot.mass / 5 * (np.trace(S, axis1=1, axis2=2)[:, None, None] * np.eye(3) - S)
    expected = history.inertia[rows]
    found = inertia[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    np.testing.assert_allclose(found, expected, atol=1e-6)
    # Six masses M/6 at +-r: sum of 2 M/6 r^2 along each axis is that of the ellipsoid, M/5 a^2.
    np.testing.assert_allclose(sizes[:, 3:] ** 2 / 3, sizes[:, :3] ** 2 / 5, rtol=1e-5)
    assert data["stands"] == [True] * count


def test_what_held_back_ends_with_its_last_tick(result: Result, page: str) -> None:
    label, one = next((k, v) for k, v in result.held_back.items() if v.last > v.first)
    assert one.ticks == round((one.last - one.first) / result.dt) + 1  # without a break
    cells = [f"{x:.4g}" for x in (one.ticks * result.dt, one.first, one.last + result.dt)]
    assert f"<td>{label}</td>" + "".join(f"<td>{cell}</td>" for cell in cells) in page


def test_shapes_are_rounded_by_less_than_a_step(result: Result, page: str) -> None:
    shapes = RobotMeshes(result.robot).in_joint_frames
    meshes = limit_triangles([mesh for _, mesh in shapes], 40_000)
    for part, (joint, _), mesh in zip(data_of(page)["parts"], shapes, meshes, strict=True):
        rounded = np.abs(corners_of(part) - mesh.vertices)
        assert (rounded <= 0.5001 * np.array(part["step"])).all()
        np.testing.assert_array_equal(numbers(part["faces"], (-1, 3), "<u2"), mesh.faces)
        assert part["joint"] == joint


def test_soles_obstacles_and_targets_are_in_it(result: Result, page: str) -> None:
    data, rows = data_of(page), replay_rows(result.history.time)
    assert (len(data["soles"]), len(data["obstacles"])) == (2, 2)
    snapshot = result.robot.snapshot(result.history.q[0])
    sole = data["soles"][0]
    place = numbers(data["places"], (len(rows), data["joints"], 7))[0, sole["joint"]]
    corners = np.array(sole["corners"]) @ rotation(place[3:]).T + place[:3]
    wanted = sole_corners(snapshot)[: len(corners)]
    np.testing.assert_allclose(corners, wanted, atol=1e-6)
    (aim,) = data["aims"]
    targets = numbers(aim["wanted"], (len(rows), 3))
    np.testing.assert_allclose(targets, result.history.targets["hand"][rows], atol=1e-6)


@pytest.mark.slow
def test_slopes_and_boards_are_in_it(result: Result, page: str) -> None:
    level = data_of(page)
    assert (level["slope"], level["boards"]) == ([0.0, 0.0], [])
    count = len(replay_rows(result.history.time))
    com = numbers(level["com"], (count, 3))
    np.testing.assert_array_equal(numbers(level["feet"], (count, 3)), com * (1.0, 1.0, 0.0))
    board = Step(centre=(0.3, -0.1, 0.04), size=(0.2, 0.4, 0.02))
    terrain = Terrain(slope=(0.1, -0.05), steps=(board,))
    data = data_of(report_text(result.robot, result.history, {}, "", None, terrain))
    assert data["slope"] == [0.1, -0.05]
    feet = numbers(data["feet"], (count, 3))
    on_slope = 0.1 * com[:, 0] - 0.05 * com[:, 1]  # nobody stands on the board
    np.testing.assert_allclose(feet, np.column_stack((com[:, :2], on_slope)), atol=1e-6)
    (drawn,) = data["boards"]
    corners = corners_of(drawn)
    np.testing.assert_allclose(corners.min(axis=0), (0.2, -0.3, 0.02), atol=1e-5)
    np.testing.assert_allclose(corners.max(axis=0), (0.4, 0.1, 0.04), atol=1e-5)


def test_it_needs_nothing_else_and_no_text_gets_out(page: str) -> None:
    assert not re.findall(r"(?:src|href)\s*=\s*[\"']?(?!data:)\w+:", page)
    assert "http" not in page.replace("http-equiv", "")
    assert "default-src 'none'" in page
    assert "&lt;/script&gt;&lt;b&gt;@DATA@ &amp; &quot;quotes&quot;" in page
    assert page.count("</script>") == 2
    assert "<h1>a &lt;title&gt;</h1>" in page
    for words in ("Versions", "Tick time", "Held back by", "left_hand_link", "proxsuite"):
        assert words in page
    assert len(data_of(page)["plots"]) == 4


@pytest.mark.slow
def test_ten_seconds_take_less_than_ten_megabytes_and_long_runs_no_more(g1, result) -> None:
    """The robot with the finest meshes; its replay, without plots, which are 0.1 MB each."""
    q = np.tile(g1.posture("standing"), (2000, 1))
    inertia = np.tile([1.0, 0, 0, 1, 0, 1], (2000, 1))
    ten = SimpleNamespace(time=np.arange(2000) * 0.005, q=q, errors={}, inertia=inertia)
    run = read_history(g1, ten)
    rows = replay_rows(run.time)
    assert len(rows) == pytest.approx(300, abs=2)
    data = replay_data(run, rows[:4])
    frames = {name: data[name] for name in ("time", "places", "com", "feet", "axes", "sizes")}
    per_frame = len(json.dumps(frames)) / 4 + len("false, ")  # whether the leg stands
    assert len(json.dumps(data)) + (len(rows) - 4) * per_frame < 5e6
    assert len(replay_rows(np.arange(100_000) * 0.005)) == MOST


def test_plots_know_where_time_runs(result: Result, page: str) -> None:
    for plot in data_of(page)["plots"]:
        assert plot["times"][0] == pytest.approx(0.0)
        assert plot["times"][1] == pytest.approx(result.history.time[-1])
        left, right = plot["across"]
        assert 0.0 < left < right < 1.0
        assert base64.b64decode(plot["png"]).startswith(b"\x89PNG")


@pytest.mark.slow
def test_by_the_command_line(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / "r.npz")
    command = ["report", str(tmp_path / "r.npz"), "-o"]
    answer = wbc_command(*command, tmp_path / "r.html")
    assert answer.exit_code == 0, answer.stderr
    assert answer.stdout.startswith(f"written  {tmp_path / 'r.html'} (0.")
    parts, title = (result.robot, result.history, result.summary()), result.status.value
    again = write_report(*parts, tmp_path / "2.html", title=f"r: {title.replace('_', ' ')}")
    assert again.read_bytes() == (tmp_path / "r.html").read_bytes()
    refused = wbc_command(*command, tmp_path / "r.pdf")
    assert (refused.exit_code, "written as .html" in refused.stderr) == (1, True)


def test_an_inertia_that_is_not_reached_is_below_the_title(result: Result) -> None:
    """ "Every tolerance met" was all that a report said, unlike the command line."""
    said = {"reason": "at rest", "reach": "as far as its joints allow: shape 20 %"}
    page = report_text(result.robot, result.history, result.summary() | said, "far")
    assert "at rest, as far as its joints allow: shape 20 %" in page


def test_a_run_of_one_tick_and_another_ending(result: Result, tmp_path: Path) -> None:
    one = SimpleNamespace(time=[0.0], q=result.history.q[:1], errors={})
    page = report_text(result.robot, one, {}, "one")
    assert len(replay_rows(np.zeros(1))) == 1
    assert "not known" in page
    with pytest.raises(InvalidInputError, match=r"written as \.html"):
        write_report(result.robot, result.history, {}, tmp_path / "r.pdf", title="x")


@needs_browser
def test_a_browser_shows_it_with_the_network_off(page: str, tmp_path: Path) -> None:
    playwright = pytest.importorskip("playwright.sync_api")
    (tmp_path / "r.html").write_text(page, encoding="utf-8")
    with playwright.sync_playwright() as running:
        browser = running.chromium.launch(executable_path=BROWSER, args=list(SOFTWARE))
        tab = browser.new_context(offline=True).new_page()
        complaints: list[str] = []
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        tab.on("console", lambda message: complaints.append(message.text))
        tab.goto((tmp_path / "r.html").as_uri())
        assert tab.inner_text("h1") == "a <title>"
        if not tab.evaluate("!!document.createElement('canvas').getContext('webgl2')"):
            browser.close()
            pytest.skip("no WebGL here")
        begins = tab.evaluate("canvas.toDataURL()")
        tab.evaluate("slider.value = slider.max; slider.dispatchEvent(new Event('input'))")
        ends = tab.evaluate("canvas.toDataURL()")
        clock = tab.inner_text("#clock")
        tab.uncheck("#layers input >> nth=0")
        bare = tab.evaluate("canvas.toDataURL()")
        stays = tab.evaluate("followed(0.3).at(-1)")
        tab.evaluate("com.forEach((_, i) => { if (i % 3 === 0) com[i] = time[i / 3]; })")  # 1 m/s
        left = tab.evaluate("com.at(-3) - followed(0.05).at(-1)[0]")
        tab.evaluate("com.forEach((_, i) => { if (i % 3 === 2) com[i] = i < 3 ? -2 : 2; }); look()")
        middle, distance = tab.evaluate("[camera.centre[2], camera.distance]")
        tab.set_viewport_size({"width": 390, "height": 844})  # a telephone's
        assert tab.evaluate("document.documentElement.scrollWidth") == 390
        wide = tab.evaluate("document.querySelector('.plot').clientWidth")
        assert complaints == []
        tab.evaluate("gl.getExtension('WEBGL_lose_context').loseContext()")  # as a busy GPU does
        tab.wait_for_selector("#trouble:not([hidden])")  # an empty picture, without a word
        assert "reload" in tab.inner_text("#trouble")
        browser.close()
    assert stays == pytest.approx(numbers(data_of(page)["com"], (-1, 3))[0, :2])
    assert 0.05 < left < 0.3  # m: it walks out of the picture, and the view goes after it
    assert abs(middle) + 2.0 < 0.2 * distance  # m: what swings up from below stays in the picture
    assert len({begins, ends, bare}) == 3
    assert wide >= 600  # pixels: the plots' labels can be read, and scroll
    assert clock in ("0.29 s", "0.30 s")
