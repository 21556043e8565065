"""A hand as text: the fingers with their nodes, and the tips seen from above; pure."""

from __future__ import annotations

import math

from palpate_edge.common.arrays import Array
from palpate_host.config.hand_config import HandConfig

COLUMNS, ROWS = 29, 15  # odd, so that the hand's axis has a cell
COLUMNS_PER_ROW = 2  # a character is twice as high as wide


def fingers_text(config: HandConfig, tip_centre_m: Array, q_rad: Array) -> str:
    """Return a line for each finger: the direction of its tip, its nodes, and each joint with its drive.

    tip_centre_m: (fingers, 3). q_rad: (nq,).
    """
    lines = []
    angles = iter(q_rad)
    for finger, tip in zip(config.fingers, tip_centre_m, strict=True):
        at_deg = math.degrees(math.atan2(tip[1], tip[0]))
        joints = ", ".join(
            f"{joint.name} {joint.drive_node} ({next(angles):+.2f})" for joint in finger.joints
        )
        lines.append(
            f"{finger.name}: tip at {at_deg:.0f} deg, fingertip 0x{finger.fingertip_node:02X};"
            f" joint drive (rad): {joints}"
        )
    return "\n".join(lines)


def top_view(tip_centre_m: Array) -> str:
    """Return the tips (fingers, 3) as numbers on a map seen from +z: +x to the right, +y up, + the axis."""
    half_columns, half_rows = COLUMNS // 2, ROWS // 2
    largest_m = float(abs(tip_centre_m[:, :2]).max()) or 1.0
    cells = [[" "] * COLUMNS for _ in range(ROWS)]
    cells[half_rows][half_columns] = "+"
    for number, (x_m, y_m) in enumerate(tip_centre_m[:, :2], start=1):
        column = half_columns + round(x_m / largest_m * half_rows) * COLUMNS_PER_ROW
        row = half_rows - round(y_m / largest_m * half_rows)
        cells[row][column] = str(number)
    return "\n".join("".join(row).rstrip() for row in cells).strip("\n")
