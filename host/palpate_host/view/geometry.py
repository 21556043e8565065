"""The shapes of a hand's MuJoCo model as Rerun shapes, each at the origin of its own entity."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import mujoco
import numpy as np
import numpy.typing as npt
import rerun as rr

from palpate_edge.common.arrays import Array

GREY = (150, 155, 165, 255)
Colour = npt.NDArray[np.uint8]
Shape = rr.Capsules3D | rr.Ellipsoids3D | rr.Boxes3D | rr.Cylinders3D | rr.Mesh3D


def shapes(model: mujoco.MjModel) -> Iterator[tuple[str, rr.Transform3D, Shape]]:
    """Yield (entity below the body's, pose in the body, shape) of every geom except planes and fields."""
    for geom in range(model.ngeom):
        kind = int(model.geom_type[geom])
        if kind not in _SHAPES:
            continue
        name = model.geom(geom).name or f"geom_{geom}"
        entity = f"{body_name(model, int(model.geom_bodyid[geom]))}/{name}"
        place = transform(model.geom_pos[geom], model.geom_quat[geom])
        yield entity, place, _SHAPES[kind](model, geom)


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Return the body's name, or one made from its number."""
    return str(model.body(body).name or f"body_{body}")


def transform(position_m: Array, wxyz: Array) -> rr.Transform3D:
    """Convert MuJoCo's position (3,) and quaternion (4,), which begins with w."""
    return rr.Transform3D(translation=position_m, quaternion=rr.Quaternion(xyzw=np.roll(wxyz, -1)))


def _sphere(model: mujoco.MjModel, geom: int) -> Shape:
    return rr.Ellipsoids3D(radii=[model.geom_size[geom][0]], colors=[_colour(model, geom)])


def _ellipsoid(model: mujoco.MjModel, geom: int) -> Shape:
    return rr.Ellipsoids3D(half_sizes=[model.geom_size[geom]], colors=[_colour(model, geom)])


def _box(model: mujoco.MjModel, geom: int) -> Shape:
    size = model.geom_size[geom]
    return rr.Boxes3D(half_sizes=[size], colors=[_colour(model, geom)], fill_mode="solid")


def _cylinder(model: mujoco.MjModel, geom: int) -> Shape:
    radius, half, _ = model.geom_size[geom]
    return rr.Cylinders3D(
        lengths=[2 * half], radii=[radius], colors=[_colour(model, geom)], fill_mode="solid"
    )


def _capsule(model: mujoco.MjModel, geom: int) -> Shape:
    """Return a capsule: Rerun's starts at its origin, MuJoCo's is centred on it."""
    radius, half, _ = model.geom_size[geom]
    return rr.Capsules3D(
        lengths=[2 * half],
        radii=[radius],
        translations=[(0.0, 0.0, -half)],
        colors=[_colour(model, geom)],
        fill_mode="solid",
    )


def _mesh(model: mujoco.MjModel, geom: int) -> Shape:
    mesh = int(model.geom_dataid[geom])
    vertex, vertices = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    return rr.Mesh3D(
        vertex_positions=model.mesh_vert[vertex : vertex + vertices],
        triangle_indices=model.mesh_face[face : face + faces],
        albedo_factor=_colour(model, geom),
    )


_SHAPES: dict[int, Callable[[mujoco.MjModel, int], Shape]] = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): _sphere,
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): _ellipsoid,
    int(mujoco.mjtGeom.mjGEOM_BOX): _box,
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): _cylinder,
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): _capsule,
    int(mujoco.mjtGeom.mjGEOM_MESH): _mesh,
}


def _colour(model: mujoco.MjModel, geom: int) -> Colour:
    """Return the model's colour (4,); MuJoCo's default grey becomes a lighter one that shows shading."""
    rgba = model.geom_rgba[geom]
    default = np.allclose(rgba, (0.5, 0.5, 0.5, 1.0))
    return np.asarray(GREY if default else np.rint(255 * rgba), dtype=np.uint8)
