"""Contact forces: what they do to the robot by Pinocchio's Jacobians, what they may be by the cone.

One robot stands on a surface, a point and a grip at once, each turned some way.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import wbc
from wbc.constraints import Contact, FrictionCone, PointContact
from wbc.constraints.mechanics import mechanics_of
from wbc.controllers.contact_forces import ContactForces, Reaction, displaced
from wbc.controllers.saved_tick import SavedTick
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.robot import Robot, Snapshot
from wbc.simulation import Plant, simulate
from wbc.tasks import ComTask

UNIT = 700.0  # N by unknown
CONE = FrictionCone(0.5, facets=6, least=20.0, most=400.0)


@pytest.fixture
def here(hoap2: Robot, rng, random_snapshot) -> Snapshot:
    return random_snapshot(hoap2, rng)


@pytest.fixture
def contacts(here: Snapshot) -> tuple[Contact, ...]:
    surface = Contact.hold(here, "left_sole", friction=CONE)
    point = PointContact.hold(here, "right_sole", friction=FrictionCone(0.7))
    grip = Contact.hold(here, "left_hand", friction=None)
    pin_grip = PointContact.hold(here, "right_hand", friction=None)
    return surface, point, grip, pin_grip


@pytest.fixture
def layout(here: Snapshot, contacts: tuple[Contact, ...]) -> ContactForces:
    return ContactForces(here.robot, [ComTask(here.robot, here.com), *contacts], UNIT)


def test_unknowns_are_named_and_normal_forces_push(here, layout) -> None:
    corners = len(here.robot.feet["left"].polygon)
    size = 3 * corners + 3 + 6 + 3
    assert layout.size == len(layout.names) == len(set(layout.names)) == size
    assert layout.names[2] == "left_sole corner 0 fz" and "left_hand force rx" in layout.names
    assert layout.frames == ("left_sole", "right_sole", "left_hand", "right_hand")
    assert layout.unit == UNIT
    normal = np.array([name.endswith("fz") for name in layout.names])
    np.testing.assert_array_equal(layout.lower, np.where(normal, 0.0, -np.inf))
    assert (layout.upper == np.inf).all()
    assert PointContact.hold(here, "left_hand").corners.tolist() == [[0.0, 0.0, 0.0]]


def test_work_of_forces_is_that_of_their_wrenches(here, contacts, layout, rng) -> None:
    """J' G f by Pinocchio's frame Jacobians and each contact's wrench; linear in f."""
    robot, f = here.robot, rng.normal(size=layout.size)
    model, data = robot.model, robot.model.createData()
    pin.computeJointJacobians(model, data, here.q)
    pin.updateFramePlacements(model, data)
    reaction = Reaction(layout, here, f)
    wrenches = reaction.wrenches()
    total, size = np.zeros(robot.nv), 0.0
    for contact in contacts:
        J = pin.getFrameJacobian(
            model, data, model.getFrameId(contact.frame), pin.LOCAL_WORLD_ALIGNED
        )
        total += J.T @ wrenches[contact.name]
        matrix = np.zeros((6, layout.size))
        layout.wrench_map(contact.frame, here, matrix)
        np.testing.assert_allclose(UNIT * matrix @ f, wrenches[contact.name], atol=1e-9)
        assert not (isinstance(contact, PointContact) and matrix[3:].any())
        size += np.abs(matrix).sum()
    assert size > 0.0
    np.testing.assert_allclose(UNIT * layout.generalized(here) @ f, total, atol=1e-9 * UNIT)


def test_corner_forces_add_up_to_the_wrench(here, layout, rng) -> None:
    """Sum and moment about the frame's origin; the points are the sole's, by its placement."""
    f = rng.normal(size=layout.size)
    reaction = Reaction(layout, here, f)
    wrenches, normals = reaction.wrenches(), reaction.normal_forces()
    found = reaction.corner_forces()
    assert set(found) == set(normals) == {"left_sole", "right_sole"}
    for name, (points, forces) in found.items():
        origin, R = here.position(name), here.rotation(name)
        moment = np.cross(points - origin, forces).sum(axis=0)
        whole = np.concatenate((forces.sum(axis=0), moment))
        np.testing.assert_allclose(wrenches[name][: len(whole)], whole[: len(wrenches[name])])
        up = R[:, 2] if name == "left_sole" else np.array([0.0, 0.0, 1.0])
        assert normals[name] == pytest.approx(float((forces @ up).sum()))
        polygon = here.robot.feet[name.split("_")[0]].polygon
        own = np.column_stack((polygon, np.zeros(len(polygon))))
        expected = origin + own @ R.T if name == "left_sole" else origin[None]
        np.testing.assert_allclose(points, expected, atol=1e-12)


def test_the_cop_is_the_mean_of_points_by_their_load(here, layout, rng) -> None:
    """Those of a surface that is a wall's, a turned palm's, are none of it."""
    f = np.zeros(layout.size)
    assert Reaction(layout, here, f).cop() is None
    normal = np.array([name.endswith("fz") for name in layout.names])
    f[normal] = rng.uniform(0.1, 1.0, normal.sum())
    q = here.q.copy()
    upright = pin.Quaternion(here.rotation("left_sole").T) * pin.Quaternion(q[3:7])
    for tilt, counted in ((0.7, slice(0, None)), (0.9, slice(-1, None))):  # the last is the point
        q[3:7] = (pin.Quaternion(pin.utils.rotate("x", tilt)) * upright).coeffs()
        reaction = Reaction(layout, here.robot.snapshot(q), f)
        found = reaction.corner_forces()
        points = np.concatenate([points for points, _ in found.values()])[counted]
        loads = f[normal][counted]
        np.testing.assert_allclose(reaction.cop(), loads @ points / loads.sum(), atol=1e-12)
    # Less than a millionth of a newton is no load.
    for newtons, loaded in ((0.9e-6, False), (1.1e-6, True)):
        small = replace(reaction, f=f * newtons / (UNIT * loads.sum()))
        assert (small.cop() is not None) is loaded


def allowed(layout: ContactForces, here: Snapshot, f: np.ndarray, most: dict[str, float]) -> bool:
    """The cones and ranges by hand: pyramids of given facets inside the cone, whole forces in N."""
    good = True
    for name, cone in (("left_sole", CONE), ("right_sole", FrictionCone(0.7))):
        columns = [k for k, label in enumerate(layout.names) if label.startswith(f"{name} corner")]
        forces = UNIT * f[columns].reshape(-1, 3)
        angles = 2 * np.pi * np.arange(cone.facets) / cone.facets
        along = forces[:, :2] @ np.array([np.cos(angles), np.sin(angles)])
        slope = cone.coefficient * np.cos(np.pi / cone.facets)
        good &= bool((along <= slope * forces[:, 2:]).all())
        most_now = min(cone.most, most.get(name, np.inf))
        good &= min(cone.least, most_now) <= forces[:, 2].sum() <= most_now
    return good


@pytest.mark.parametrize("most", [{}, {"left_sole": 100.0}, {"left_sole": 5.0, "right_sole": 50.0}])
def test_rows_allow_what_cones_and_ranges_do(here, layout, rng, most) -> None:
    bounds = layout.bounds(most)
    assert len(layout.labels) == len(bounds.lower) == len(bounds.matrix) == len(bounds.upper)
    assert bounds.labels[:2] == ("left_sole normal force", "right_sole normal force")
    assert bounds.labels[2] == "left_sole corner 0 friction at 0 deg"
    assert sum("left_sole corner 1 friction at" in name for name in bounds.labels) == CONE.facets
    assert len(set(bounds.labels)) == len(bounds.labels)
    normal = np.array([name.endswith("fz") for name in layout.names])
    verdicts = []
    for _ in range(400):
        f = rng.normal(size=layout.size) * rng.choice([0.003, 0.02])
        f[normal] = rng.uniform(0.0, 0.3, normal.sum()) * rng.choice([0.1, 0.3, 1.0])
        values = bounds.matrix @ f
        verdicts.append(bool((bounds.lower <= values).all() and (values <= bounds.upper).all()))
        assert verdicts[-1] == allowed(layout, here, f, most)
    assert 20 < sum(verdicts) < 380 or most


def test_another_cone_counts_from_the_next_tick_on(here, contacts, layout) -> None:
    before = layout.bounds()
    contacts[0].friction = FrictionCone(0.2, facets=3)
    after = layout.bounds()
    assert after.labels[2:5] == tuple(
        f"left_sole corner 0 friction at {angle} deg" for angle in (0, 120, 240)
    )
    assert after.upper[0] == np.inf and before.upper[0] == CONE.most / UNIT
    contacts[0].friction = replace(contacts[0].friction, most=70.0)  # the same shape
    assert layout.bounds().upper[0] == 70.0 / UNIT
    contacts[0].friction = replace(contacts[0].friction, coefficient=0.3)
    assert (layout.bounds().matrix != after.matrix).any()
    contacts[0].friction = None
    assert not any("left_sole corner" in label for label in layout.bounds().labels)


def test_contacts_off_their_anchors_are_told(here) -> None:
    """By more than 1 cm or 0.1 rad; how far is told in metres."""
    robot, frame = here.robot, "left_sole"
    p, R = here.position(frame), here.rotation(frame)

    def found(by: float, turned: float) -> dict[str, float]:
        turn = np.array(pin.exp3(np.array([0.0, turned, 0.0])))
        moved = Contact(robot, frame, p + [0.0, by, 0.0], turn @ R)
        return displaced(here, [ComTask(robot, here.com), moved])

    assert found(0.0099, 0.099) == {}
    assert found(0.0101, 0.0) == pytest.approx({frame: 0.0101})
    assert found(0.0, 0.101) == pytest.approx({frame: 0.0}, abs=1e-12)


def test_what_bears_no_force_has_no_unknowns(geared: Robot) -> None:
    """A gear bears one along its row, a bolted base six; a CoM that is held bears none."""
    here = geared.snapshot(geared.postures["neutral"])
    layout = ContactForces(geared, mechanics_of(geared, [ComTask(geared, here.com)]), UNIT)
    assert layout.size == 7 and layout.frames == () and layout.bounds().lower.size == 0
    f = np.arange(1.0, 8.0)
    wrenches = Reaction(layout, here, f).wrenches()
    assert [len(one) for one in wrenches.values()] == [6, 1]
    np.testing.assert_allclose(np.concatenate([*wrenches.values()]), UNIT * f)
    force = layout.generalized(here) @ f
    np.testing.assert_allclose(force[:6], f[:6])
    name = next(iter(geared.couplings))
    expected = np.zeros(geared.nv - 6)
    expected[geared.joint_index(name) - 6] = 7.0
    driver = geared.couplings[name].driver
    expected[geared.joint_index(driver) - 6] = -7.0 * geared.couplings[name].ratio
    np.testing.assert_allclose(force[6:], expected)
    with pytest.raises(InvalidInputError, match="where its forces act is not known"):
        ContactForces(geared, [Contact.hold(here, geared.frame_names[-1])], UNIT)


def test_what_leaves_the_exact_cone_is_told_in_newtons() -> None:
    cone = FrictionCone(0.5)
    assert cone.excess(np.array([3.0, 4.0, 12.0])) == pytest.approx(5.0 - 6.0)
    assert cone.excess(np.array([-3.0, 4.0, 2.0])) == pytest.approx(4.0)


@pytest.mark.parametrize(("facets", "inner"), [(3, True), (4, False), (8, True), (64, False)])
def test_pyramids_are_inside_the_cone_or_around_it(facets: int, inner: bool) -> None:
    """Along its edges and along the middles of its faces: one of the two touches the cone."""
    cone = FrictionCone(0.5, facets=facets, inner=inner)
    A = cone.matrix()
    np.testing.assert_array_equal(FrictionCone(0.5, float(facets), inner).matrix(), A)
    assert A.shape == (facets, 3)
    turn = 2.0 * np.pi * np.arange(facets) / facets
    for offset, touches in ((0.0, not inner), (np.pi / facets, inner)):
        for angle in turn + offset:
            way = np.array([np.cos(angle), np.sin(angle), 0.0])
            most = min(float(-row[2] / (row @ way)) for row in A if row @ way > 1e-9)
            assert (abs(most - 0.5) < 1e-12) == touches
            assert most <= 0.5 + 1e-12 if inner else most >= 0.5 - 1e-12


WRENCH = np.array([3.0, -2.0, -20.0, 0.5, 0.2, -0.3])


def standing(robot: Robot, **options: float) -> wbc.TorqueController:
    here = robot.snapshot(robot.posture())
    tasks = [
        wbc.ComTask(robot, here.com),
        wbc.OrientationTask(robot, "base", here.rotation("base")),
        wbc.PostureTask(robot, here.q),
    ]
    return wbc.TorqueController(robot, tasks, contacts=wbc.support(here, "double"), **options)


@pytest.mark.parametrize("delay", [0.0, 0.004])
def test_torques_bear_them(hoap2: Robot, delay: float, tmp_path: Path) -> None:
    """Oracle: RNEA with the wrench as an external force of its joint; exact to rounding."""
    controller = standing(hoap2, delay=delay)
    rng = np.random.default_rng(5)
    q = hoap2.integrate(hoap2.posture(), 0.02 * rng.normal(size=hoap2.nv), 1.0)
    v = 0.05 * rng.normal(size=hoap2.nv)
    wrenches = {"left_hand": 0.2 * WRENCH, "base": -WRENCH}
    free = controller.step(hoap2.snapshot(q, v))
    measured = hoap2.snapshot(q, v)
    here = controller.predicted(measured)  # the same without a delay
    tick = controller.step(measured, wrenches)
    assert not tick.policy and set(tick.wrenches) == set(wrenches)
    assert np.abs(tick.torque - free.torque).max() > 0.1
    # A file holds them: asked again, the same bits.
    tick.save(tmp_path / "tick.wbc")
    replay = SavedTick.load(tmp_path / "tick.wbc").replay()
    assert replay.same, replay.differences
    model = hoap2.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, here.q)
    external = pin.StdVec_Force([pin.Force.Zero() for _ in range(model.njoints)])
    for frame, wrench in {**wrenches, **tick.forces}.items():
        index = hoap2.frame_id(frame)
        joint, where = model.frames[index].parentJoint, data.oMf[index].translation
        at_origin = pin.SE3(np.eye(3), where).act(pin.Force(wrench))
        external[joint] += data.oMi[joint].actInv(at_origin)
    needed = pin.rnea(model, data, here.q, here.v, tick.acceleration, external)
    needed[6:] += hoap2.damping * (here.v + controller.dt * tick.acceleration)[6:]
    np.testing.assert_allclose(needed[:6], 0.0, atol=1e-6 * hoap2.weight)
    np.testing.assert_allclose(needed[6:], tick.torque, atol=1e-8 * hoap2.weight)
    # Of this tick only.
    assert not controller.step(hoap2.snapshot(q, v)).wrenches


def test_what_no_wrench_is_is_refused_by_name(hoap2: Robot) -> None:
    controller, here = standing(hoap2), hoap2.snapshot(hoap2.posture())
    before = controller.step(here)
    with pytest.raises(UnknownNameError, match="did you mean 'left_hand'"):
        controller.step(here, {"left_hnd": WRENCH})
    with pytest.raises(InvalidInputError, match=r"wrenches\['left_hand'\]"):
        controller.step(here, {"left_hand": WRENCH[:3]})
    with pytest.raises(InvalidInputError, match=r"wrenches\['left_hand'\]"):
        controller.step(here, {"left_hand": WRENCH * np.nan})
    with pytest.raises(InvalidInputError, match=r"expected \{name: value\}"):
        controller.step(here, [WRENCH])
    # A refused one leaves nothing behind.
    np.testing.assert_allclose(controller.step(here).torque, before.torque, atol=1e-9)


def test_the_plant_applies_them_where_they_are_said_to_act(hoap2: Robot) -> None:
    """Oracle: M a + bias = J' w of the snapshot, in the air, before the first step of physics."""
    plant = Plant(hoap2, shapes=False, dt=1e-3, physics_dt=1e-3)
    q = hoap2.posture()
    q[2] += 5.0
    plant.reset(q)
    plant.apply("left_hand", 0.1 * WRENCH, duration=0.01)
    assert plant.known_wrenches()["left_hand"] == pytest.approx(0.1 * WRENCH)
    s = plant.snapshot()
    plant.step(np.zeros(hoap2.nv - 6))
    # Implicit in the joints' damping, as the physics is; armature is in the mass matrix.
    M = s.mass_matrix + 1e-3 * np.diag(np.concatenate((np.zeros(6), hoap2.damping)))
    expected = 1e-3 * np.linalg.solve(M, s.jacobian("left_hand").T @ (0.1 * WRENCH) - s.bias)
    np.testing.assert_allclose(plant.state()[1], expected, atol=1e-4 * abs(expected).max())
    for _ in range(10):
        plant.step(np.zeros(hoap2.nv - 6))
    assert not plant.wrenches and not plant.known_wrenches() and not plant.applied


@pytest.mark.slow
def test_a_g1_told_of_20_newtons_at_its_wrist_does_not_sag(g1: Robot) -> None:
    """Told: within 2 mm for three seconds. Not told: some 90 mm, by the gains of its tasks."""
    robot, hand, sag = g1, "left_wrist_yaw_link", {}
    place = robot.snapshot(robot.posture()).position(hand)
    for told in (True, False):
        plant = Plant(robot)
        plant.apply(hand, (0.0, 0.0, -20.0, 0.0, 0.0, 0.0), start=0.2, told=told)
        away = [
            float(np.linalg.norm(plant.snapshot().position(hand) - place))
            for _ in simulate(standing(robot), plant, 3.0)
        ]
        sag[told] = max(away)
    assert sag[True] < 2e-3 and sag[False] > 0.05
