"""The global search: its answers judged by Pinocchio and by SciPy's optimisers."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize
from scipy.spatial import ConvexHull

from wbc.constraints import ComSupport, Limits, PointContact, support
from wbc.controllers import KinematicController
from wbc.robot import Robot
from wbc.shaping import GlobalShaping, NoPostureError
from wbc.shaping.problem import posture_cost
from wbc.tasks import ComTask, InertiaTask, PostureTask, PrincipalInertiaTask


def standing_moments(robot: Robot) -> np.ndarray:
    return np.diag(robot.snapshot(robot.posture()).inertia_in("base")).copy()


def by_pinocchio(robot: Robot, q: np.ndarray) -> tuple[pin.Data, np.ndarray]:
    data = robot.model.createData()
    pin.ccrba(robot.model, data, q, np.zeros(robot.nv))
    pin.updateFramePlacements(robot.model, data)
    return data, np.array(data.Ig.inertia)


def assert_within_limits(robot: Robot, q: np.ndarray, margin: float = 0.0) -> None:
    joints = robot.limits.joint_positions(q)
    assert (joints >= robot.limits.lower + margin - 1e-9).all()
    assert (joints <= robot.limits.upper - margin + 1e-9).all()


@pytest.mark.slow
def test_no_worse_than_scipy_and_not_to_be_improved(hoap2) -> None:
    """Fifteen L-BFGS-B searches from random postures, and one more from the answer itself."""
    q = hoap2.posture()
    target = standing_moments(hoap2) * [0.5, 0.6, 1.6]
    scale = 1.0 / float(target @ target)
    task = InertiaTask(hoap2, np.diag(target), frame="base", weight=np.sqrt(scale), gain=1.0)

    def cost(joints: np.ndarray) -> tuple[float, np.ndarray]:
        here = hoap2.snapshot(np.concatenate((q[:7], joints)))
        error = here.inertia_in("base")[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
        error = error - np.diag(target)[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
        pull = scale * np.array([1, 2, 2, 1, 2, 1]) * error
        return 0.5 * float(pull @ error), here.base_inertia_jacobian[:, 6:].T @ pull

    lower, upper = hoap2.limits.lower, hoap2.limits.upper
    bounds = list(zip(lower, upper, strict=True))
    options = {"maxiter": 500, "ftol": 1e-15, "gtol": 1e-9}

    def search(joints: np.ndarray) -> float:
        found = minimize(cost, joints, method="L-BFGS-B", jac=True, bounds=bounds, options=options)
        return float(found.fun)

    rng = np.random.default_rng(3)
    outcome = GlobalShaping(hoap2, [task]).solve(q, starts=24, workers=1)
    best = outcome.best
    theirs = min(search(rng.uniform(lower, upper)) for _ in range(15))
    assert best.cost <= 1.01 * theirs + 1e-12
    assert best.optimal
    assert best.cost == pytest.approx(cost(best.q[7:])[0], rel=1e-9, abs=1e-15)
    # IPOPT's barrier leaves about 1e-8 of the cost of a middling posture.
    assert search(best.q[7:]) >= best.cost - 1e-7 * cost(q[7:])[0]
    assert_within_limits(hoap2, best.q)
    costs = [candidate.cost for candidate in outcome.candidates]
    assert costs == sorted(costs)
    np.testing.assert_array_equal(best.q[:7], q[:7])  # the base does not matter here


@pytest.mark.slow
def test_standing_on_both_feet_inside_the_polygon(g1_27) -> None:
    q = g1_27.posture()
    here = g1_27.snapshot(q)
    anchors = {
        f.frame: (here.position(f.frame), here.rotation(f.frame)) for f in g1_27.feet.values()
    }
    target = np.diag(standing_moments(g1_27) * [1.3, 1.3, 0.5])
    # Drawn 30 cm forwards: out of the polygon, so that its edge, less the margin, must hold.
    tasks = [
        InertiaTask(g1_27, target, per_mass=True),
        ComTask(g1_27, here.com + [0.3, 0.0, 0.0], weight=3.0),
    ]
    margin = 0.02
    limits = Limits(g1_27, margin=0.05)
    balance = ComSupport.over(here, margin=margin)
    shaping = GlobalShaping(g1_27, tasks, support(here, "double"), limits, [balance])
    outcome = shaping.solve(q, starts=8, workers=1)
    corners = np.concatenate(
        [
            anchors[f.frame][0][:2] + f.polygon @ anchors[f.frame][1][:2, :2].T
            for f in g1_27.feet.values()
        ]
    )
    edges = ConvexHull(corners).equations
    inside = []
    for candidate in outcome.candidates:
        data, _ = by_pinocchio(g1_27, candidate.q)
        for frame, (position, rotation) in anchors.items():
            pose = data.oMf[g1_27.frame_id(frame)]
            np.testing.assert_allclose(pose.translation, position, atol=1e-6)
            np.testing.assert_allclose(pose.rotation, rotation, atol=1e-6)
        com = pin.centerOfMass(g1_27.model, g1_27.model.createData(), candidate.q)
        inside.append(-(edges[:, :2] @ com[:2] + edges[:, 2]).max())
        assert_within_limits(g1_27, candidate.q, margin=0.05)
        assert candidate.kept.support == pytest.approx(inside[-1] - margin, abs=1e-9)
    assert min(inside) >= margin - 1e-7
    # The best one leans on the edge, but for the 0.1 mm that the QP keeps too.
    assert inside[0] == pytest.approx(margin + 1e-4, abs=1e-5)


@pytest.mark.slow
def test_free_base_turns_to_world_axes_and_to_principal_ones(hoap2) -> None:
    """In world axes a floating robot can do what it can for principal moments, and no more."""
    q = hoap2.posture()
    moments = np.sort(standing_moments(hoap2) * [0.7, 0.9, 1.4])
    world = InertiaTask(hoap2, np.diag(moments), per_mass=True)
    principal = PrincipalInertiaTask(hoap2, moments, per_mass=True)
    costs = []
    for task in (world, principal):
        best = GlobalShaping(hoap2, [task]).solve(q, starts=16, workers=1).best
        _, inertia = by_pinocchio(hoap2, best.q)
        assert best.cost == pytest.approx(posture_cost([task], hoap2.snapshot(best.q)), rel=1e-9)
        reached = np.linalg.eigvalsh(inertia)
        costs.append(0.5 * task.gain * float(np.sum((reached - moments) ** 2)) / hoap2.mass**2)
    np.testing.assert_allclose(costs[0], costs[1], rtol=1e-2, atol=1e-12)


def test_point_contacts_hold_points(hoap2) -> None:
    q = hoap2.posture()
    here = hoap2.snapshot(q)
    frames = ("left_sole", "right_sole")
    contacts = [
        PointContact(hoap2, frame, here.position(frame), here.rotation(frame)) for frame in frames
    ]
    task = ComTask(hoap2, here.com + [0.02, 0.01, -0.03])
    best = GlobalShaping(hoap2, [task], contacts).solve(q, starts=3, workers=1).best
    data, _ = by_pinocchio(hoap2, best.q)
    for frame in frames:
        pose = data.oMf[hoap2.frame_id(frame)]
        np.testing.assert_allclose(pose.translation, here.position(frame), atol=1e-6)
    assert np.linalg.norm(best.errors["com"]) < 1e-4


def test_impossible_constraints_are_reported(hoap2) -> None:
    q = hoap2.posture()
    here = hoap2.snapshot(q)
    contacts = list(support(here, "double"))
    far = contacts[1].position + [0.0, -3.0, 0.0]  # a split that no leg can do
    contacts[1] = type(contacts[1])(hoap2, contacts[1].frame, far, contacts[1].rotation)
    outcome = GlobalShaping(hoap2, [PostureTask(hoap2, q)], contacts).solve(q, 2, workers=1)
    assert not outcome.candidates
    assert any("off its anchor" in rejected.reason for rejected in outcome.rejected)
    assert any(rejected.start is None for rejected in outcome.rejected)  # samples not searched from
    with pytest.raises(NoPostureError, match=r"none of 2 starts .* off its anchor"):
        print(outcome.best)


def test_a_start_outside_its_limits_and_continuous_joints(robot_named, rng, random_snapshot):
    robot = robot_named("mixed_joints")
    assert robot.limits.unbounded
    q = random_snapshot(robot, rng).q
    target = robot.snapshot(q).inertia_in("base")
    start = robot.posture()
    k = int(np.flatnonzero(np.isfinite(robot.limits.upper))[0])
    start[robot.limits.starts[k]] = robot.limits.upper[k] + 0.1
    task = InertiaTask(robot, target, frame="base", per_mass=True)
    best = GlobalShaping(robot, [task]).solve(start, starts=8, workers=1).best
    assert best.cost < 1e-10  # the inertia of a posture within the limits can be had
    assert_within_limits(robot, best.q)


@pytest.mark.parametrize("law", [{"gain": 0.2}, {"gain": 0.2, "weighs_error": True},
                                 {"gain_per_second": 10.0}])  # fmt: skip
def test_the_best_posture_is_where_the_controller_rests(hoap2: Robot, law) -> None:
    """Two tasks that exclude each other, whatever makes the one's weight: they counted by gain."""
    q, dt = hoap2.posture(), 0.01
    contacts = support(hoap2.snapshot(q), "double")
    height = hoap2.snapshot(q).com[2] - 0.02
    tasks = [
        ComTask(hoap2, [0.0, 0.0, height], axes=("z",), weight=30.0, **law),
        PostureTask(hoap2, q, gain=0.9),
    ]
    limits = Limits(hoap2)
    controller = KinematicController(hoap2, tasks, contacts=contacts, limits=limits, dt=dt)
    at, v = q, None
    for _ in range(400):
        v = controller.step(hoap2.snapshot(at, v)).velocity
        at = hoap2.integrate(at, v, dt)
    best = GlobalShaping(hoap2, tasks, contacts, limits, dt=dt).solve(at, 1, workers=1).best
    np.testing.assert_allclose(hoap2.difference(at, best.q), 0.0, atol=2e-4)
    off = [float(np.linalg.norm(best.errors[task.name])) for task in tasks]
    assert min(off) > 1e-3  # both give way
