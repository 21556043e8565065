"""The viewer's initial layout: the hand, the plots, the cameras, the host's messages."""

from __future__ import annotations

from collections.abc import Sequence

import rerun.blueprint as rrb

from palpate_edge.common.contact_quantities import QUANTITIES
from palpate_host.view.hand_view import TIMELINE

QUANTITY_PLOTS = {q.panel: [q.plot.format(finger="**")] for q in QUANTITIES if q.panel}
PLOTS = {
    **QUANTITY_PLOTS,
    "Orientation, deg": ["orientation/**"],
    "Joints, rad": ["position/**"],
    "Torques, N m": ["torque/**", "command/**"],
}


def blueprint(cameras: Sequence[str]) -> rrb.Blueprint:
    """Return the layout; cameras: names of the entities below camera/ that will have pictures."""
    scene = rrb.Spatial3DView(origin="/", contents=["hand/**"], name="Hand")
    plots = [rrb.TimeSeriesView(origin="/", contents=content, name=name) for name, content in PLOTS.items()]
    pictures = [rrb.Spatial2DView(origin=f"camera/{name}", name=name) for name in cameras]
    host = rrb.TextLogView(origin="log", name="Host")
    left = rrb.Vertical(scene, host, row_shares=[5, 1])
    if pictures:
        left = rrb.Vertical(scene, rrb.Horizontal(*pictures), host, row_shares=[4, 2, 1])
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Vertical(*plots), column_shares=[3, 2]),
        rrb.TimePanel(timeline=TIMELINE),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )
