"""What is wrong with a problem whose method is ``global`` is said with its line, before it runs."""

from pathlib import Path

import pytest

from tests.problem.loading import complaint_of as complaint

TEXT = Path(__file__).with_name("global_small.yaml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("  idle: {type: momentum, active: false}", "  idle: {type: momentum}",
         "p.yaml:8: tasks.idle.type: method global: momentum is about velocities"),
        ("weight: 1.0e-4,", "weight: 1.0e-4, priority: 1,",
         "p.yaml:7: tasks.calm.priority: method global weighs tasks against each other within"
         " one level; give all tasks the same priority ('shape' has 0)"),
        ("gain: 0.3, second", "ramp: 1.0, gain: 0.3, second",
         "p.yaml:6: tasks.shape.ramp: method global looks for the posture that meets"),
        ("limits: {margin: 0.02}", "phases: {a: {duration: 1}}",
         "p.yaml:9: phases: method global looks for one posture"),
        ("support: double", "support: floating",
         "p.yaml:14: controller.support_margin: no contact holds a foot's sole"),
        ("support_margin: 0.01", "support_margin: 0.5",
         "p.yaml:14: controller.support_margin: 0.5 m leaves nothing"),
        ("starts: 12", "starts: 0", "p.yaml:12: controller.starts: must be at least 1, got 0"),
        ("starts: 12", "strats: 12", "p.yaml:12: controller.strats: unknown key; did you mean"),
        ("workers: 1", "workers: two", "p.yaml:13: controller.workers: "),
        ("starts: 12", "seconds: 0", "p.yaml:12: controller.seconds: must be greater than 0"),
        ("workers: 1", "solver: proxpq", "p.yaml:13: controller.solver: unknown QP solver"),
        ("method: global", "method: globl", "p.yaml:11: controller.method: 'globl' does not exist;"
         " did you mean 'global'?"),
        ("second_order: true", "second_order: true, gian: 1",
         "p.yaml:6: tasks.shape.gian: unknown key"),
    ],
)  # fmt: skip
def test_mistakes_are_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert TEXT.count(old) == 1
    assert words in complaint(tmp_path, TEXT.replace(old, new))
