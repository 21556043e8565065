"""A line drawing of a hand: links, tips, their frames F and the nodes' ids, by matplotlib alone."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from matplotlib.figure import Figure

from palpate_edge.common.arrays import Array
from palpate_host.common.figure_file import save_figure
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.hand_model import model_of

AXIS_M = 0.02
AXIS_COLOURS = ("tab:red", "tab:green", "tab:blue")


def draw_hand(config: HandConfig, q_rad: Array, path: Path, title: str) -> None:
    """Draw the hand at the joint angles (nq,) into `path`. Raises ConfigError when it cannot be written."""
    model = model_of(config)
    data = mujoco.MjData(model)
    for joint, angle in zip(config.joints, q_rad, strict=True):
        data.qpos[model.joint(joint.name).qposadr[0]] = angle
    mujoco.mj_forward(model, data)
    figure = Figure(figsize=(8, 7), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    axes.set_title(title)
    for finger, site in zip(config.fingers, config.model.tip_sites, strict=True):
        tip = data.site(site)
        points = [*_chain(model, data, int(model.site(site).bodyid[0])), tip.xpos.copy()]
        axes.plot(*np.array(points).T, color="0.4", linewidth=4, solid_capstyle="round")
        for axis, colour in zip(tip.xmat.reshape(3, 3).T, AXIS_COLOURS, strict=True):
            axes.plot(*np.array([tip.xpos, tip.xpos + AXIS_M * axis]).T, color=colour, linewidth=2)
        axes.text(*tip.xpos, f"  {finger.name} 0x{finger.fingertip_node:02X}")
        for joint in finger.joints:
            anchor = data.joint(joint.name).xanchor
            axes.plot(*anchor[:, None], marker="o", color="tab:orange")
            axes.text(*anchor, f" {joint.drive_node}", color="tab:orange", fontsize="small")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_zlabel("z (m)")
    axes.set_aspect("equal")
    save_figure(figure, path)


def _chain(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> list[Array]:
    """Return the positions (3,) of the bodies from the world to `body`."""
    positions = []
    while body > 0:
        positions.append(data.xpos[body].copy())
        body = int(model.body_parentid[body])
    return positions[::-1]
