"""Campaign files: which runs they are, and every mistake found before the first."""

import os
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import load as load_robot
from tests.texts import CHEAP
from wbc.errors import ProblemFileError, WbcError
from wbc.problem import load_problem
from wbc.problem.campaign import Campaign, load_campaign
from wbc.problem.retarget import load_retarget

TORQUE = """\
robot: hoap2_like
support: double
tasks: {posture: {type: posture, weight: 1.0}}
controller: {level: torque}
simulation: {duration: 0.1, sensors: {position_noise: 1.0e-4}}
"""
PENDULUM = "problems/rmp_static_lean.yaml"


def load(folder: Path, text: str) -> Campaign:
    (folder / "stand.yaml").write_text(CHEAP)
    (folder / "push.yaml").write_text(TORQUE)
    path = folder / "campaign.yaml"
    path.write_text(text)
    return load_campaign(path)


def test_runs_are_the_product_of_everything(tmp_path: Path) -> None:
    campaign = load(
        tmp_path,
        "problems: [stand.yaml, push.yaml]\n"
        "set: {controller.solver: active_set}\n"
        "cases: {soft: {tasks.posture.weight: 0.1}, hard: {tasks.posture.weight: 10}}\n"
        "grid: {limits.margin: [0.0, 0.01, 0.02]}\n",
    )
    runs = campaign.runs
    assert [run.number for run in runs] == list(range(2 * 2 * 3))
    assert [(run.problem, run.case) for run in runs[::3]] == [
        ("stand", "soft"), ("stand", "hard"), ("push", "soft"), ("push", "hard")
    ]  # fmt: skip
    assert runs[4].overrides == {
        "controller.solver": "active_set", "tasks.posture.weight": 10, "limits.margin": 0.01
    }  # fmt: skip
    assert "run 4 (stand, case hard" in runs[4].describe()
    assert set(campaign.texts) == {"stand", "push"} and campaign.texts["push"] == TORQUE
    assert load_problem(runs[4].path, runs[4].overrides).parts


def test_the_most_specific_value_counts(tmp_path: Path) -> None:
    campaign = load(
        tmp_path,
        "problems: [stand.yaml]\nset: {tasks.com.gain: 0.1, tasks.com.weight: 1.0}\n"
        "cases: {a: {tasks.com.gain: 0.2, tasks.com.weight: 2.0}}\n"
        "grid: {tasks.com.gain: [0.3]}\n",
    )
    assert campaign.runs[0].overrides == {"tasks.com.gain": 0.3, "tasks.com.weight": 2.0}


def test_a_section_in_the_grid_does_not_yield_to_a_key_of_a_case(tmp_path: Path) -> None:
    """It would have had the case's gain, as `set` names the section first."""
    com = "{type: com, target: start}"
    text = f"problems: [stand.yaml]\nset: {{tasks.com: {com}}}\ngrid: {{tasks.com: [{com}]}}\n"
    with pytest.raises(ProblemFileError, match=r"replaces tasks\.com\.gain with all else there"):
        load(tmp_path, text + "cases: {a: {tasks.com.gain: 0.2}}\n")


def test_a_case_is_checked_with_the_grid_over_it(tmp_path: Path) -> None:
    """As it is run: the case's own value would be a mistake, and counts nowhere."""
    campaign = load(
        tmp_path,
        "problems: [stand.yaml]\ncases: {a: {}, b: {tasks.com.gain: 7}}\n"
        "grid: {tasks.com.gain: [0.3]}\n",
    )
    assert [run.overrides["tasks.com.gain"] for run in campaign.runs] == [0.3, 0.3]


def test_seeds_go_where_a_problem_is_random_and_draws_follow_them(tmp_path: Path) -> None:
    campaign = load(
        tmp_path,
        "problems: [push.yaml]\nseeds: [3, 5]\n"
        "set: {simulation.model_error: {mass: 0.1}}\n"
        "draw: {simulation.friction: [0.4, 0.8]}\n",
    )
    assert [run.seed for run in campaign.runs] == [3, 5]
    for run in campaign.runs:
        assert run.overrides["simulation.sensors.seed"] == run.seed
        assert run.overrides["simulation.model_error.seed"] == run.seed
    first, second = (run.overrides["simulation.friction"] for run in campaign.runs)
    assert 0.4 <= first <= 0.8 and 0.4 <= second <= 0.8 and first != second
    again = load(
        tmp_path,
        "problems: [stand.yaml, push.yaml]\nseeds: [5]\n"
        "draw: {tasks.posture.weight: [0.1, 1.0], limits.margin: [0, 0.01]}\n",
    )
    estimated = "set: {simulation.sensors: {}, simulation.estimate: true}\n"
    devices = load(tmp_path, "problems: [push.yaml]\nseeds: [3, 5]\n" + estimated).runs
    assert [run.overrides["simulation.devices.seed"] for run in devices] == [3, 5]
    # One problem's draws do not depend on another's, nor on what else is drawn.
    one, other = (run.overrides["tasks.posture.weight"] for run in again.runs)
    assert one == other
    alone = load(tmp_path, "problems: [stand.yaml]\nseeds: 6\ndraw: {limits.margin: [0, 0.01]}\n")
    assert alone.runs[5].overrides["limits.margin"] == again.runs[0].overrides["limits.margin"]


def test_draws_are_even(tmp_path: Path) -> None:
    campaign = load(
        tmp_path,
        "problems: [stand.yaml]\nseeds: 400\n"
        "draw: {tasks.com.target.offset: [[-0.01, 0, -0.02], [0.01, 0, 0]]}\n",
    )
    drawn = np.array([run.overrides["tasks.com.target.offset"] for run in campaign.runs])
    assert (drawn[:, 1] == 0.0).all()
    # Mean and variance of 400 even draws: within four standard errors.
    assert np.allclose(drawn.mean(axis=0), [0, 0, -0.01], atol=4 * 0.02 / np.sqrt(12 * 400))
    assert np.isclose(drawn[:, 2].std(), 0.02 / np.sqrt(12), rtol=0.1)
    assert abs(np.corrcoef(drawn[:, 0], drawn[:, 2])[0, 1]) < 4 / np.sqrt(400)


def test_a_search_has_a_seed_and_leaves_the_processors_to_the_campaign(tmp_path: Path) -> None:
    text = (Path(__file__).parent / "global_small.yaml").read_text()
    (tmp_path / "search.yaml").write_text(text.replace("  workers: 1\n", ""))
    campaign = load(tmp_path, "problems: [search.yaml]\nseeds: 2\n")
    assert [run.overrides for run in campaign.runs] == [
        {"controller.workers": 1, "controller.seed": seed} for seed in (0, 1)
    ]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("problems: [stand.yaml]\ngird: {}", "campaign.yaml:2: gird: unknown key; did you mean"),
        ("problems: [stnad.yaml]", "stnad.yaml: no such file"),
        ("problems: []", "problems"),
        ("problems: [stand.yaml, stand.yaml]", "named twice"),
        ("problems: [stand.yaml]\nset: {tasks.con.gain: 0.1}", "no task 'con'; did you mean 'com'"),
        ("problems: [stand.yaml]\ngrid:\n  tasks.com.gian: [0.1]", "campaign.yaml:3"),
        ("problems: [stand.yaml]\ngrid:\n  tasks.com.gian: [0.1]", "did you mean 'gain'"),
        ("problems: [stand.yaml]\ngrid: {tasks.com.gain: [0.1, 7]}", "grid.\"tasks.com.gain\"[1]"),
        ("problems: [stand.yaml]\ngrid: {tasks.com.gain: 0.1}", "list"),
        ("problems: [stand.yaml]\ncases: {a: {}, b: {robot: nobody}}", "cases.b"),
        ("problems: [stand.yaml]\nseeds: 3", "nothing is random in stand"),
        ("problems: [stand.yaml]\ndraw: {limits.margin: [0, 0.1]}", "give seeds"),
        ("problems: [stand.yaml]\nseeds: 2\ndraw: {limits.margin: [0, x]}", "limits.margin"),
        ("problems: [stand.yaml]\nseeds: 2\ndraw: {limits.margin: [0]}", "draw"),
        ("problems: [stand.yaml]\nseeds: 2\ndraw: {limits.margin: [0.1, 0]}", "lower number first"),
        # Both ends are whole, and every run was an error.
        ("problems: [stand.yaml]\nseeds: 2\ndraw: {tasks.posture.priority: [0, 1]}",
         "campaign.yaml:3: draw: --set tasks.posture.priority: expected a whole number"),
        # The same runs twice: the values of the grid counted nowhere.
        ("problems: [stand.yaml]\nseeds: 2\ngrid:\n  limits.margin: [0, 0.1]\n"
         "draw: {limits.margin: [0, 0.1]}", "campaign.yaml:4: grid.\"limits.margin\": is drawn"),
        ("problems: [push.yaml]\nseeds: 999999999999", "at most 1,000,000"),
        ("problems: [push.yaml]\nseeds: -1", ": seeds: must be at least 1"),
        ("problems: [push.yaml]\nseeds: []", ": seeds: empty"),
        ("problems: [push.yaml]\nseeds: many", "seeds: expected how many from 0 on, or a list"),
        ("problems: [stand.yaml]\nseeds: 2000000\ndraw: {limits.margin: [0, 0.1]}", "at most"),
        ("problems: [stand.yaml]\nseeds: [1, 2, 1]\ndraw: {limits.margin: [0, 0.1]}", "twice"),
        ("problems: [stand.yaml]\ngrid: {tasks.com.gain: [1, 0.1, 1]}",
         "gain\"[2]: 1 is there twice"),
        ("problems: [stand.yaml, ./stand.yaml]", "problems[1]: "),
        # Of the weight nothing was left, but the table had it.
        ("problems: [stand.yaml]\ngrid:\n  tasks.com.weight: [2]\n"
         "  tasks.com: [{type: com, target: start}]", "replaces tasks.com.weight with all"),
        ("", "at least 'problems:'"),
        # Each value is fine, the last two together are not.
        (
            "problems: [stand.yaml]\nset: {tasks.com.ramp: 0.1}\n"
            "grid: {stop.duration: [0.5, 0.05]}",
            "ramp",
        ),
    ],
)  # fmt: skip
def test_mistakes_are_told_before_anything_runs(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(WbcError) as caught:
        load(tmp_path, text)
    assert told in str(caught.value)


def test_a_pendulum_takes_part_but_has_no_seeds(tmp_path: Path) -> None:
    root = Path(__file__).parents[2]
    (tmp_path / "lean.yaml").write_text((root / PENDULUM).read_text())
    campaign = load(tmp_path, "problems: [lean.yaml]\n")
    assert len(campaign.runs) == 1
    with pytest.raises(ProblemFileError, match="nothing is random in lean"):
        load(tmp_path, "problems: [lean.yaml]\nseeds: 2\n")


def test_files_are_found_in_the_home_and_pipes_are_not_read(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    os.mkfifo(tmp_path / "hoap2_like")  # reading one that nobody writes to has no end
    text = "problems: [~/stand.yaml]\nset: {robot: hoap2_like}\n"
    assert load(tmp_path, text).runs[0].path == tmp_path / "stand.yaml"
    given = tmp_path / "retarget.yaml"
    given.write_text("{motion: ~/walk.bvh, robot: hoap2_like}\n")
    assert load_retarget(given)["motion"] == tmp_path / "walk.bvh"
    given.write_text(f"{{motion: walk.bvh, robot: {'r' * 300}}}\n")  # no name of a file
    assert load_retarget(given)["robot"] == "r" * 300
    with pytest.raises(ProblemFileError, match=r"campaign.yaml:1: problems.1"):
        load(tmp_path, 'problems: [stand.yaml, "\\0"]\n')
    with pytest.raises(ProblemFileError, match="no such file"):
        load(tmp_path, "problems: [stand.yaml]\nset: {robot: ~nobody_of_this_name/own.urdf}\n")


def test_inputs_change_with_the_files_that_problems_name(tmp_path: Path) -> None:
    """A table of another robot, of the same file's name, had all runs already."""
    robot = tmp_path / "own.urdf"
    robot.write_text(Path(str(load_robot("hoap2_like").path)).read_text())
    text = "problems: [stand.yaml]\ngrid: {robot: [own.urdf, hoap2_like]}\n"
    before = load(tmp_path, text).inputs()
    assert load(tmp_path, text).inputs() == before
    robot.write_text(robot.read_text().replace('lower="-', 'lower="-0'))
    after = load(tmp_path, text).inputs()
    assert after.pop("files") != before.pop("files") and after == before
    assert "files" not in load(tmp_path, "problems: [stand.yaml]\n").inputs()
