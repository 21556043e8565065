"""The virtual frame of the fingertips and the frame of the contacts: Eqs. (12), (15) and (16).

Two frames describe the orientation of a grasped object. R_vir follows from the tips' centres alone: from
joint angles, without delay, but wrong by the rolling of the tips. R_c follows from the contact normals:
right, but late by the delay of camera and network. In a symmetric grasp the two are half a turn about z
apart, so a target is always built from R_c(t0), never from R_vir(t0).

Pairing removes the delay: every contact normal is expressed in R_vir at its own frame's EXPOSURE time, so

    M = R_vir(t - tau)^T R_c(t - tau),    R_c now = R_vir(t) M,    R_d_vir = R_d M^T  (Eq. 15)

and the fingers' frames need not be exposed together. At zero delay R_vir cancels from Eq. (15) as printed;
this is correct, since Eq. (14) compares R_d_vir with R_vir(t) again.
"""

from __future__ import annotations

import math

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_host.common import rotation

# The triangle's area over that of the equilateral one with the same longest side.
MIN_TRIANGLE_FLATNESS = 0.02
# Second plus signed third singular value of the sum of normal products; 3 equal normals give 0.
MIN_NORMAL_SEPARATION = 0.05
_COUNTS = {3: "three", 4: "four", 5: "five"}


class FrameError(ConfigError):
    """The tips or contacts define no frame."""


def virtual_frame(tip_centre_m: Array) -> Array:
    """Return R_vir (3, 3) of the tips' centres x_ci (n, 3, a row each), Eq. (12).

    As printed the axes are orthonormal and right-handed: y from tip 3 to tip 2, z normal to the tips'
    triangle on the side from which 1, 2, 3 run counter-clockwise. With more than three fingers z is the
    normal of the polygon 1, 2, 3, ... (the sum of its edges' cross products) and y lies in its plane.
    Raises FrameError when the tips are (nearly) on one line.
    """
    # Plain floats: for nine numbers numpy's overhead exceeds the computation.
    tips = tip_centre_m.tolist()
    x0, y0, z0 = tips[2]
    arms = [(x - x0, y - y0, z - z0) for x, y, z in tips]
    nx = ny = nz = longest_squared = 0.0
    ax, ay, az = arms[-1]
    for bx, by, bz in arms:
        nx, ny, nz = nx + ay * bz - az * by, ny + az * bx - ax * bz, nz + ax * by - ay * bx
        dx, dy, dz = bx - ax, by - ay, bz - az
        squared = dx * dx + dy * dy + dz * dz
        longest_squared = squared if squared > longest_squared else longest_squared
        ax, ay, az = bx, by, bz
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length <= MIN_TRIANGLE_FLATNESS * longest_squared * math.sqrt(3.0) / 2.0:
        raise FrameError(
            f"the {_COUNTS.get(len(tips), len(tips))} fingertip centres lie on one line, Eq. (12) defines no"
            " frame: spread the fingers or correct the zero offsets in hand.toml"
        )
    nx, ny, nz = nx / length, ny / length, nz / length
    yx, yy, yz = arms[1]
    off_plane = yx * nx + yy * ny + yz * nz
    yx, yy, yz = yx - off_plane * nx, yy - off_plane * ny, yz - off_plane * nz
    y_length = math.sqrt(yx * yx + yy * yy + yz * yz)
    if y_length == 0.0:
        raise FrameError("fingertips 2 and 3 are above each other: number the fingers in another order")
    yx, yy, yz = yx / y_length, yy / y_length, yz / y_length
    return _with_x(yx, yy, yz, nx, ny, nz)


def check_numbering(tip_centre_m: Array) -> None:
    """Raise FrameError for fingers numbered clockwise seen from the hand's +z.

    r_z of Eq. (12) would then point into the palm; the paper assumes the counter-clockwise order tacitly.
    """
    if virtual_frame(tip_centre_m)[2, 2] <= 0.0:
        raise FrameError(
            "the fingers are numbered clockwise seen from the hand's +z (palm to object), which flips r_z of"
            " Eq. (12): exchange two entries of [[fingers]] and of model.tip_sites in hand.toml"
        )


def contact_frame(normals: Array) -> Array:
    """Return R_c (3, 3) of n >= 3 unit vectors d_i = (x_ci - x_i)/|x_ci - x_i| (rows), Eq. (16).

    The norms are garbled in print; the reading is that each numerator is divided by its own norm. r_cy
    depends on finger 1 alone, whose noise is then the frame's yaw noise: this frame only starts the estimate,
    `fit_contact_frame` continues it. Raises FrameError when the contacts are opposed or equal (r_cz is 0/0).
    """
    # Plain floats, as in `virtual_frame`.
    rows = normals.tolist()
    zx = zy = zz = 0.0
    ax, ay, az = rows[-1]
    for bx, by, bz in rows:
        zx, zy, zz = zx + ay * bz - az * by, zy + az * bx - ax * bz, zz + ax * by - ay * bx
        ax, ay, az = bx, by, bz
    z_length = math.sqrt(zx * zx + zy * zy + zz * zz)
    if z_length < MIN_NORMAL_SEPARATION:
        raise FrameError(_COLLINEAR)
    zx, zy, zz = zx / z_length, zy / z_length, zz / z_length
    dx, dy, dz = rows[0]
    yx, yy, yz = dy * zz - dz * zy, dz * zx - dx * zz, dx * zy - dy * zx
    y_length = math.sqrt(yx * yx + yy * yy + yz * yz)
    if y_length < MIN_NORMAL_SEPARATION:
        raise FrameError(_COLLINEAR)
    return _with_x(yx / y_length, yy / y_length, yz / y_length, zx, zy, zz)


def _with_x(yx: float, yy: float, yz: float, zx: float, zy: float, zz: float) -> Array:
    """Return the rotation (3, 3) with these second and third columns; the first is y x z."""
    return np.array([[yy * zz - yz * zy, yx, zx], [yz * zx - yx * zz, yy, zy], [yx * zy - yy * zx, yz, zz]])


def fit_contact_frame(reference: Array, normals: Array) -> Array:
    """Return the rotation R that best turns the reference normals (rows, in the object) into `normals`.

    Wahba's problem, solved by SVD: minimise sum |d_i - R d_ref,i|^2 over rotations. With the reference
    R_c(t0)^T d_i(t0) this is Eq. (16) with equal weights of all fingers, and equal to R_c(t0) at t0. It
    assumes contacts on faces that turn with the object, which rolling on a flat face preserves. Raises
    FrameError when the normals leave a rotation undetermined.
    """
    u, s, vt = np.linalg.svd(normals.T @ reference)
    handedness = 1.0 if np.linalg.det(u @ vt) > 0.0 else -1.0
    if s[1] + handedness * s[2] < MIN_NORMAL_SEPARATION:
        raise FrameError(_COLLINEAR)
    return np.asarray(u @ np.diag([1.0, 1.0, handedness]) @ vt)


def misfits_deg(R: Array, reference: Array, normals: Array) -> Array:
    """Return the angle (n,) between each measured normal and its reference turned by `R`."""
    cosines = np.einsum("ij,ij->i", reference @ R.T, normals)
    return np.asarray(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))))


def desired_virtual_frame(R_d: Array, M: Array) -> Array:
    """Return R_d_vir = R_d R_c(t - tau)^T R_vir(t - tau), Eq. (15); M = R_vir(t - tau)^T R_c(t - tau)."""
    return np.asarray(R_d.dot(M.T))


def low_pass(previous: Array, measured: Array, dt_s: float, time_constant_s: float) -> Array:
    """Filter rotations by a first-order low-pass, from `previous` towards `measured` on the shortest arc."""
    if time_constant_s <= 0.0:
        return measured
    share = 1.0 - math.exp(-dt_s / time_constant_s)
    return np.asarray(previous @ rotation.exp(share * rotation.log(previous.T @ measured)))


_COLLINEAR = (
    "the contact normals are (nearly) parallel, Eq. (16) defines no frame:"
    " grasp the object on faces of different directions"
)
