"""Touch points: where a force sets in along an approach, and the sphere through several touches."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import RigError
from palpate_edge.press_rig.dome_place import DomePlace

STEPS = 20
MOST_RESIDUAL_MM = 0.3
MOST_REACH_ERROR_MM = 1.5


def onset_mm(travel_mm: Array, force_N: Array) -> float:
    """Return where the force is 0, from travels (n,) and their forces (n,): n >= 4, rising.

    The travel is taken as a parabola of the force: the dome becomes stiffer as the ball sinks in.
    """
    return float(np.polyfit(force_N, travel_mm, 2)[-1])


def fit_place(touches_mm: Array, first: DomePlace, *, free_reach: bool) -> tuple[DomePlace, float]:
    """Return the dome's place by ball positions (n, 3) at first touch, and the residual, mm rms.

    free_reach: fit the distance of the centres as well (n >= 5), else that of `first` counts. The force
    sets in a little late in every direction, and the play of the axes is alike on opposite sides: both
    change the distance and not the centre.
    """
    centre, reach = np.array(first.centre_mm), first.reach_mm
    for _ in range(STEPS):
        away = touches_mm - centre
        distance = np.linalg.norm(away, axis=1)
        columns = [-away / distance[:, None]]
        if free_reach:
            columns.append(-np.ones((len(away), 1)))
        step = np.linalg.lstsq(np.hstack(columns), reach - distance, rcond=None)[0]
        centre = centre + step[:3]
        reach += float(step[3]) if free_reach else 0.0
    off_mm = np.linalg.norm(touches_mm - centre, axis=1) - reach
    x, y, z = centre.tolist()
    return DomePlace((x, y, z), reach), float(np.sqrt((off_mm**2).mean()))


def check_fit(place: DomePlace, residual_mm: float, expected_reach_mm: float) -> None:
    """Raises RigError when the touched surface is not the dome of sensor.toml under the ball of rig.toml."""
    if residual_mm > MOST_RESIDUAL_MM:
        raise RigError(
            f"the touched points are {residual_mm:.2f} mm rms off a sphere, allowed {MOST_RESIDUAL_MM:g}: "
            "fasten the fingertip and the probe, and check the play of the printer's axes"
        )
    if abs(place.reach_mm - expected_reach_mm) > MOST_REACH_ERROR_MM:
        raise RigError(
            f"dome and ball measure {place.reach_mm:.2f} mm from centre to centre, expected "
            f"{expected_reach_mm:.2f}: correct dome.outer_radius_mm in sensor.toml or probe.ball_radius_mm"
        )
