"""The host's status as Rerun entities.

| entity | content |
|---|---|
| hand/BODY, hand/BODY/GEOM | the model's bodies and shapes |
| hand/FINGER, .../dome | frame F, its dome |
| hand/FINGER/contact, .../force | the contact in F (m); an arrow inwards, 10 mm a newton |
| hand/contact_frame, hand/target_frame | R_c of Eq. (16) and R_d at the tips' centroid |
| position/JOINT, torque/JOINT, command/JOINT | rad, N m |
| force/FINGER, shear/FINGER/x, ... | plots of contact_quantities.py; no point while it is not known |
| orientation/error_deg, orientation/misfit_deg | R_vir to R_d_vir; contact normals to their fit |
| age_ms/FINGER | age of the last frame since its exposure |
| log | changes of mode and warnings |
| camera/NAME | pictures of a fingertip's camera |
| camera/NAME/beads, .../motion | the beads that are found; arrows from where they are untouched |

Lengths are in m, the timeline ``time`` is Unix time. Plots have every tick, the 3-D scene at most `scene_Hz`.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
import rerun as rr

from palpate_edge.common.arrays import Array
from palpate_edge.common.contact_quantities import QUANTITIES
from palpate_host.common.mode import Mode
from palpate_host.common.status import FingerStatus, HostStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.hand_model import model_of
from palpate_host.control.kinematics import HandKinematics, HandPose
from palpate_host.view.cameras import Picture
from palpate_host.view.geometry import body_name, shapes, transform

TIMELINE = "time"
ARROW_M_PER_N = 0.010
AXIS_M = 0.03
DOME_COLOUR = (150, 200, 235, 90)
FORCE_COLOUR = (230, 80, 25)
SLIP_COLOUR = (200, 0, 200)


def plotted(finger: FingerStatus) -> Iterator[tuple[str, float]]:
    """Yield entity and value of each contact quantity that is plotted.

    A quantity is left out while it is not known; those that are not optional are 0 without contact.
    """
    for quantity in QUANTITIES:
        value = quantity.of(finger)
        if quantity.plot and not (value is None and (quantity.optional or finger.in_contact)):
            yield quantity.plot.format(finger=finger.name), value or 0.0


class HandView:
    """The view of one hand, written into a recording stream."""

    def __init__(
        self, stream: rr.RecordingStream, config: HandConfig, hand: HandKinematics, scene_Hz: float = 30.0
    ) -> None:
        self._stream, self._hand = stream, hand
        self._model = model_of(config)
        self._data = mujoco.MjData(self._model)
        self._q_address = [int(self._model.joint(joint.name).qposadr[0]) for joint in config.joints]
        self._scene_period_us = 1e6 / scene_Hz
        self._last_scene_us: int | None = None
        self._last_text = ("", "", "")
        self._draw_model(config)

    def add(self, status: HostStatus) -> None:
        """Write one tick."""
        self._stream.set_time(TIMELINE, timestamp=np.datetime64(status.time_us, "us"))
        self._plot(status)
        message = (status.mode.value, status.reason, status.warning)
        if message != self._last_text and status.mode is not Mode.UNKNOWN:
            self._last_text = message
            text = f"{status.mode.value}: {status.reason}"
            if status.warning:
                text += f" ({status.warning})"
            level = rr.TextLogLevel.WARN if status.warning else rr.TextLogLevel.INFO
            self._stream.log("log", rr.TextLog(text, level=level))
        since = None if self._last_scene_us is None else status.time_us - self._last_scene_us
        if since is None or not 0 <= since < self._scene_period_us:
            self._last_scene_us = status.time_us
            self._draw(status)

    def add_picture(self, name: str, exposed_us: int, picture: Picture) -> None:
        """Write a frame of the camera `name` at its exposure time (epoch us)."""
        self._stream.set_time(TIMELINE, timestamp=np.datetime64(exposed_us, "us"))
        for part, shown in picture.items():
            self._stream.log(f"camera/{name}/{part}", shown)

    def _draw_model(self, config: HandConfig) -> None:
        log = self._stream.log
        log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for entity, place, shape in shapes(self._model):
            log(f"hand/{entity}", place, shape, static=True)
        dome = rr.Ellipsoids3D(radii=[config.control.tip_radius_m], colors=[DOME_COLOUR])
        for finger in config.fingers:
            log(f"hand/{finger.name}/dome", dome, static=True)
            log(f"hand/{finger.name}/axes", rr.TransformAxes3D(AXIS_M / 3), static=True)
        for frame in ("contact_frame", "target_frame"):
            log(f"hand/{frame}", rr.TransformAxes3D(AXIS_M), static=True)

    def _plot(self, status: HostStatus) -> None:
        log = self._stream.log
        for joint in status.joints:
            if joint.position_rad is not None:
                log(f"position/{joint.name}", rr.Scalars(joint.position_rad))
            if joint.torque_Nm is not None:
                log(f"torque/{joint.name}", rr.Scalars(joint.torque_Nm))
            if joint.command_Nm is not None:
                log(f"command/{joint.name}", rr.Scalars(joint.command_Nm))
        for finger in status.fingers:
            for entity, value in plotted(finger):
                log(entity, rr.Scalars(value))
            if finger.age_ms is not None:
                log(f"age_ms/{finger.name}", rr.Scalars(finger.age_ms))
        if status.hold is not None:
            for finger, ratio in zip(status.fingers, status.hold.friction_ratio, strict=True):
                if ratio is not None:
                    log(f"friction_ratio/{finger.name}", rr.Scalars(ratio))
        if status.orientation_error_deg is not None:
            log("orientation/error_deg", rr.Scalars(status.orientation_error_deg))
        if status.fit_residual_deg is not None:
            log("orientation/misfit_deg", rr.Scalars(status.fit_residual_deg))

    def _draw(self, status: HostStatus) -> None:
        q_rad = [joint.position_rad for joint in status.joints if joint.position_rad is not None]
        if len(q_rad) < len(status.joints):
            return
        model, data, log = self._model, self._data, self._stream.log
        data.qpos[self._q_address] = q_rad
        mujoco.mj_kinematics(model, data)
        for body in range(1, model.nbody):
            place = transform(data.xpos[body], data.xquat[body])
            log(f"hand/{body_name(model, body)}", place)
        pose = self._hand.pose(np.array(q_rad))
        for index, finger in enumerate(status.fingers):
            frame = rr.Transform3D(translation=pose.tip_centre_m[index], mat3x3=pose.tip_rotation[index])
            log(f"hand/{finger.name}", frame)
            self._draw_contact(finger)
        self._draw_frame("contact_frame", status.R_c, pose)
        self._draw_frame("target_frame", status.R_d, pose)

    def _draw_contact(self, finger: FingerStatus) -> None:
        contact, force = f"hand/{finger.name}/contact", f"hand/{finger.name}/force"
        if not finger.in_contact or finger.position_mm is None:
            self._stream.log(contact, rr.Clear(recursive=False))
            self._stream.log(force, rr.Clear(recursive=False))
            return
        at_m = 1e-3 * np.array(finger.position_mm)
        colour = SLIP_COLOUR if finger.slip else FORCE_COLOUR
        self._stream.log(contact, rr.Points3D([at_m], radii=[0.001], colors=[colour]))
        if finger.normal_force_N is None:
            self._stream.log(force, rr.Clear(recursive=False))
            return
        inwards = -at_m / np.linalg.norm(at_m)
        arrow = ARROW_M_PER_N * finger.normal_force_N * inwards
        self._stream.log(force, rr.Arrows3D(vectors=[arrow], origins=[at_m], colors=[colour]))

    def _draw_frame(self, name: str, R: tuple[tuple[float, ...], ...] | None, pose: HandPose) -> None:
        if R is not None:
            centroid: Array = pose.tip_centre_m.mean(axis=0)
            self._stream.log(f"hand/{name}", rr.Transform3D(translation=centroid, mat3x3=np.array(R)))
