"""The two engines: Eqs. (4)-(8) against Newton, geometry and energy, and the engines against each other."""

import msgspec
import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from palpate_edge.common.errors import ConfigError
from palpate_host.config import hand_reader
from palpate_host.config.packaged import MODELS
from palpate_host.config.twin_config import ObjectConfig
from palpate_host.control.control_law import joint_torque_Nm
from palpate_host.control.gains import gains_of
from palpate_host.control.hand_model import compiled, read_spec
from palpate_host.service.host import load_hand
from palpate_twin.hand.prism import prism_of
from palpate_twin.hand.twin_model import twin_model
from palpate_twin.paper.trial import make_engine

TABLE_3 = MODELS / "table3.toml"


@pytest.fixture(scope="module")
def table_3():
    return load_hand(TABLE_3)


class Grasp:
    """An engine under the grasping torque of Eq. (10), plus oscillating joint torques."""

    def __init__(self, table_3, name, swing_Nm=0.0, step_s=None):
        self.config, self.hand = table_3
        self.engine = make_engine(self.config, name)
        if step_s is not None:
            self.engine.step_s = step_s
        self.gains = gains_of(self.config)
        self.swing_Nm = swing_Nm

    def run(self, seconds):
        engine = self.engine
        while engine.time_s < seconds - 1e-9:
            pose = self.hand.pose(engine.q_rad)
            u = joint_torque_Nm(pose, np.zeros(self.hand.joint_count), None, None, self.gains)
            engine.step(u + self.swing_Nm * np.sin(7.0 * engine.time_s + np.arange(len(u))))
        return engine


def contact_forces(engine):
    """Return the forces on the object (3, 3) and their points, from the face normals of Table 3's object."""
    R = engine.object_rotation
    sqrt_half = np.sqrt(0.5)
    normals = np.array(
        [[sqrt_half, sqrt_half, 0], [-sqrt_half, sqrt_half, 0], [0, -1, 0]]
    )  # right, left, long
    forces, points = [], []
    for normal, contact in zip(normals, engine.tip_contacts(), strict=True):
        assert abs(contact.friction_N @ R @ normal) < 1e-6
        forces.append(-contact.normal_force_N * (R @ normal) - contact.friction_N)
        points.append(contact.point_m)
    return np.array(forces), np.array(points)


def test_table_3s_object_is_a_right_isosceles_prism():
    uniform = ObjectConfig(
        outline_m=((-0.0272, 0.0), (0.0272, 0.0), (0.0, 0.0272)),
        length_m=0.035,
        mass_kg=0.05,
        position_m=(0, 0, 0),
    )
    np.testing.assert_allclose(prism_of(uniform).inertia_kgm2, [0.0716e-4, 0.1127e-4, 0.0823e-4], rtol=2e-3)
    box = msgspec.structs.replace(uniform, outline_m=((0, 0), (0.1, 0), (0.1, 0.2), (0, 0.2)))
    side = 0.05 / 12 * np.array([0.2**2 + 0.035**2, 0.1**2 + 0.035**2, 0.1**2 + 0.2**2])
    np.testing.assert_allclose(prism_of(box).inertia_kgm2, side, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"outline_m": ((0, 0), (0, 0.03), (0.03, 0))}, "not convex and counter-clockwise"),
        ({"outline_m": ((0, 0), (0.03, 0), (0.01, 0.01), (0, 0.03))}, "not convex"),
        ({"inertia_kgm2": (0.01716e-4, 0.1127e-4, 0.0823e-4)}, "triangle inequality"),
    ],
)
def test_impossible_objects_are_refused(table_3, change, message):
    with pytest.raises(ConfigError, match=message):
        prism_of(msgspec.structs.replace(table_3[0].twin.object, **change))


def test_a_hand_without_a_twin_or_with_another_pose_is_refused(table_3):
    config = table_3[0]
    with pytest.raises(ConfigError, match=r"no \[twin\] section"):
        twin_model(msgspec.structs.replace(config, twin=None), with_contacts=False)
    short = msgspec.structs.replace(config.twin, start_pose_rad=(0.0, 0.3))
    with pytest.raises(ConfigError, match=r"start_pose_rad has 2 angles, but finger-1 has 5 joints"):
        twin_model(msgspec.structs.replace(config, twin=short), with_contacts=False)


def test_a_tapered_object_has_the_inertia_of_its_mesh():
    """MuJoCo integrates the inertia over the triangles of the convex hull."""
    shape = hand_reader.load(MODELS / "table4-four.toml").twin.object
    prism = prism_of(shape)
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="object", uservert=prism.vertices_m.ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_EXACT
    spec.worldbody.add_body().add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="object", mass=shape.mass_kg)
    of_mesh = spec.compile().body_inertia[1]
    np.testing.assert_allclose(np.sort(prism.inertia_kgm2), np.sort(of_mesh), rtol=1e-6)


def test_tapers_without_a_side_face_are_refused(table_3):
    shape = msgspec.structs.replace(table_3[0].twin.object, taper_m=1.0)
    with pytest.raises(ConfigError, match="leaves no side face"):
        prism_of(shape)


@pytest.mark.parametrize("engine", ["eqs", "mujoco"])
def test_four_fingers_hold_the_object(engine):
    """Each tip pulls with f_d rho/(n r), Eq. (10), and the object stays between opposite tips."""
    loaded = load_hand(MODELS / "table4-four.toml")
    grasp = Grasp(loaded, engine)
    grasp.run(0.3)
    contacts = grasp.engine.tip_contacts()
    assert len(contacts) == 4
    centres = grasp.hand.pose(grasp.engine.q_rad).tip_centre_m
    rho = np.linalg.norm(centres - centres.mean(axis=0), axis=1)
    gains = grasp.gains
    expected_N = gains.f_d_N * rho / (4 * gains.tip_radius_m)
    np.testing.assert_allclose([one.normal_force_N for one in contacts], expected_N, rtol=0.02)
    np.testing.assert_allclose(grasp.engine.object_position_m[:2], 0.0, atol=1e-6)


def test_newton_and_euler_hold_for_the_object(table_3):
    """Eqs. (5), (6): momentum and spin change only by contact forces and torsion, Eq. (7)."""
    grasp = Grasp(table_3, "eqs", swing_Nm=0.01, step_s=2e-5)
    engine = grasp.run(0.02)
    twin, data, h = engine.twin, engine.data, engine.step_s
    inertia = twin.prism.inertia_kgm2
    lin, rot = slice(twin.object_v, twin.object_v + 3), slice(twin.object_v + 3, twin.object_v + 6)

    def momenta():
        R = engine.object_rotation
        return twin.prism.mass_kg * data.qvel[lin], R @ (inertia * data.qvel[rot]), data.qvel.copy()

    p0, L0, v0 = momenta()
    position, R0 = engine.object_position_m, engine.object_rotation
    tips_R = data.xmat.reshape(-1, 3, 3)[engine._tip_bodies].copy()
    points = np.array([contact.point_m for contact in engine.tip_contacts()])
    engine.step(np.zeros(15))
    p1, L1, _ = momenta()
    # The forces are those of the last step; their points are those at its start.
    forces, _ = contact_forces(engine)
    forces = forces @ engine.object_rotation @ R0.T
    np.testing.assert_allclose((p1 - p0) / h, forces.sum(axis=0), atol=1e-4)
    spin = R0 @ data.qvel[rot]
    twist = np.zeros(3)
    for i, normal in enumerate(engine._C[:, 1] @ R0.T):
        tips_now = data.xmat.reshape(-1, 3, 3)[engine._tip_bodies[i]]
        tip_spin = Rotation.from_matrix(tips_now @ tips_R[i].T).as_rotvec() / h
        twist -= 1e-3 * normal * (normal @ (spin - tip_spin))  # b = 1e-3
    moment = np.cross(points - position, forces).sum(axis=0) + twist
    assert np.linalg.norm((L1 - L0) / h) > 1e-4  # the spin changes
    np.testing.assert_allclose((L1 - L0) / h, moment, atol=2e-6)
    assert not np.array_equal(v0, data.qvel)


def test_a_free_object_follows_eulers_equations(table_3):
    """Without contact, the object is a torque-free top, solved here by scipy from Euler's equations."""
    config = table_3[0]
    away = msgspec.structs.replace(config.twin.object, position_m=(1.0, 0.0, 0.07))
    config = msgspec.structs.replace(config, twin=msgspec.structs.replace(config.twin, object=away))
    engine = make_engine(config, "eqs")
    engine.step_s = 1e-4
    spin0 = np.array([3.0, 0.5, -2.0])
    rot = slice(engine.twin.object_v + 3, engine.twin.object_v + 6)
    engine.data.qvel[rot] = spin0
    for _ in range(2000):
        engine.step(np.zeros(15))
    inertia = engine.twin.prism.inertia_kgm2
    euler = solve_ivp(
        lambda _, w: np.cross(inertia * w, w) / inertia, (0.0, 0.2), spin0, rtol=1e-10, atol=1e-12
    )
    np.testing.assert_allclose(engine.data.qvel[rot], euler.y[:, -1], atol=2e-3)
    np.testing.assert_allclose(engine.object_position_m, [1.0, 0.0, 0.07], atol=1e-12)  # no weight, Eq. (5)


def test_energy_balances_and_the_balance_closes_with_the_step(table_3):
    errors = []
    for step_s in (1e-3, 2.5e-4):
        grasp = Grasp(table_3, "eqs", swing_Nm=0.01, step_s=step_s)
        begin = grasp.engine.energy_J()
        engine = grasp.run(0.4)
        account = engine.account
        balance = engine.energy_J() - begin - account.work_J + account.dissipated_J
        errors.append(abs(balance) / account.dissipated_J)
    assert account.dissipated_J > 1e-4
    assert errors[1] < 1e-3
    assert errors[1] < 0.5 * errors[0]


def test_tips_roll_equal_arcs(table_3):
    """The contact travels equal distances over the tip's sphere and over the object's face."""
    grasp = Grasp(table_3, "eqs", swing_Nm=0.02)
    engine = grasp.engine
    on_face, on_tip, last = np.zeros(3), np.zeros(3), None
    for tick in range(1, 301):
        grasp.run(tick * 1e-3)
        R, x = engine.object_rotation, engine.object_position_m
        points = np.array([contact.point_m for contact in engine.tip_contacts()])
        centres = engine.data.site_xpos[list(engine.twin.tip_sites)]
        tips = engine.data.site_xmat[list(engine.twin.tip_sites)].reshape(3, 3, 3)
        place = (points - x) @ R
        arm = np.einsum("iba,ib->ia", tips, points - centres)
        if last is not None:
            on_face += np.linalg.norm(place - last[0], axis=1)
            # Arms have the length r - Delta r: count the arc without the change of that length.
            unit, before = (a / np.linalg.norm(a, axis=1, keepdims=True) for a in (arm, last[1]))
            on_tip += np.linalg.norm(unit - before, axis=1) * np.linalg.norm(arm, axis=1)
        last = place, arm
    assert on_face.min() > 2e-4
    np.testing.assert_allclose(on_tip, on_face, rtol=0.01)
    assert engine.slip_m.max() < 1e-5


@pytest.mark.parametrize("name", ["eqs", "mujoco"])
def test_a_joint_stops_at_its_limit_and_moves_back(table_3, name):
    """The second joint of each finger opens against its limit."""
    config, _ = table_3
    engine = make_engine(config, name)
    opening, closing = (np.tile([0.0, sign * 0.05, 0.0, 0.0, 0.0], 3) for sign in (-1.0, 1.0))
    least = [joint.min_rad for joint in config.joints][1::5]
    assert (engine.q_rad[1::5] > np.add(least, 0.1)).all()
    for _ in range(3000):
        engine.step(opening)
    np.testing.assert_allclose(engine.q_rad[1::5], least, atol=0.01)
    np.testing.assert_allclose(engine.qdot_rad_s[1::5], 0.0, atol=1e-3)
    for _ in range(1000):
        engine.step(closing)
    assert (engine.q_rad[1::5] > np.add(least, 0.05)).all()


def test_energy_dissipated_at_joint_limits_is_accounted_for(table_3):
    config, _ = table_3
    engine = make_engine(config, "eqs")
    begin = engine.energy_J()
    opening = np.tile([0.0, -0.2, 0.0, 0.0, 0.0], 3)
    fastest = 0.0
    for _ in range(1500):
        engine.step(opening)
        fastest = max(fastest, float(np.abs(engine.qdot_rad_s[1::5]).max()))
    assert fastest > 1.0
    least = [joint.min_rad for joint in config.joints]
    np.testing.assert_allclose(engine.q_rad[1::5], least[1::5], atol=0.01)
    account = engine.account
    balance = engine.energy_J() - begin - account.work_J + account.dissipated_J
    assert abs(balance) < 1e-3 * account.dissipated_J


@pytest.mark.parametrize("name", ["eqs", "mujoco"])
def test_a_grasp_at_rest_is_in_equilibrium(table_3, name):
    """The contact forces sum to zero, and each normal force is k Delta r^2 of the geometry, Eq. (8)."""
    engine = Grasp(table_3, name).run(1.5)
    centres = engine.data.site_xpos[list(engine.twin.tip_sites)]
    for centre, contact in zip(centres, engine.tip_contacts(), strict=True):
        indentation = 0.010 - np.linalg.norm(centre - contact.point_m)
        assert contact.normal_force_N == pytest.approx(3e5 * indentation**2, rel=0.02)
    forces, points = contact_forces(engine)
    assert np.abs(forces.sum(axis=0)).max() < 0.002 * np.abs(forces).sum()
    moment = np.cross(points - engine.object_position_m, forces).sum(axis=0)
    assert np.abs(moment).max() < 0.002 * 0.011 * np.abs(forces).sum()


def test_the_engines_agree_where_nothing_slips(table_3):
    eqs = Grasp(table_3, "eqs", swing_Nm=0.005).run(0.5)
    other = Grasp(table_3, "mujoco", swing_Nm=0.005).run(0.5)
    apart = Rotation.from_matrix(eqs.object_rotation @ other.object_rotation.T).magnitude()
    moved = Rotation.from_matrix(eqs.object_rotation).magnitude()
    assert np.degrees(moved) > 0.5
    assert np.degrees(apart) < 0.15
    np.testing.assert_allclose(eqs.object_position_m, other.object_position_m, atol=2e-5)
    for a, b in zip(eqs.tip_contacts(), other.tip_contacts(), strict=True):
        assert a.normal_force_N == pytest.approx(b.normal_force_N, rel=0.03)
    assert other.slip_m.max() < 1e-4


def test_without_friction_the_other_engine_slips(table_3):
    config, hand = table_3
    tip = msgspec.structs.replace(config.twin.tip, friction=0.05)
    slick = msgspec.structs.replace(config, twin=msgspec.structs.replace(config.twin, tip=tip))
    engine = Grasp((slick, hand), "mujoco").run(0.5)
    assert engine.slip_m.max() > 1e-4


def test_a_urdf_hand_loads_with_its_tip_links_as_sites(tmp_path, table_3):
    """The tip link's origin moves with the joint as computed by hand."""
    inertia = '<inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="{{0}}"><inertial><mass value="0.1"/>{inertia}</inertial></link>'
    urdf = tmp_path / "hand.urdf"
    urdf.write_text(
        '<robot name="one">'
        + "".join(link.format(name) for name in ("palm", "finger", "tip_1"))
        + '<joint name="bend" type="revolute"><parent link="palm"/><child link="finger"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        '<joint name="end" type="fixed"><parent link="finger"/><child link="tip_1"/>'
        '<origin xyz="0 0 0.08"/></joint></robot>'
    )
    model = compiled(read_spec(str(urdf), ("tip_1",)), str(urdf))
    data = mujoco.MjData(model)
    data.qpos[0] = 0.5
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(
        data.site("tip_1").xpos, [0.08 * np.sin(0.5), 0.0, 0.08 * np.cos(0.5)], atol=1e-9
    )


def test_geometry_and_mjcf_are_either_or(tmp_path):
    text = TABLE_3.read_text()
    path = tmp_path / "hand.toml"
    path.write_text(text.replace("[model]", '[model]\nmjcf = "hand.xml"', 1))
    with pytest.raises(ConfigError, match=r"either model.mjcf or \[geometry\]"):
        hand_reader.load(path)


def test_geometry_must_fit_the_fingers(table_3):
    config = table_3[0]
    fewer = msgspec.structs.replace
    short = fewer(config.geometry, links=config.geometry.links[:2])
    with pytest.raises(ConfigError, match=r"geometry.links has 3 joints, finger 1 of \[\[fingers\]\] has 5"):
        twin_model(fewer(config, geometry=short), with_contacts=False)
    alone = fewer(config.geometry, base_azimuth_deg=(0.0,))
    with pytest.raises(ConfigError, match="1 angles for 3 fingers"):
        twin_model(fewer(config, geometry=alone), with_contacts=False)
