"""A plan of a large turn as an input of the host: a recording keeps it exactly."""

import json

import msgspec
from tests.host.control.gait.gait_hand import planned

from palpate_host.common.command import Reorient
from palpate_host.common.gait_plan import GaitPlan, Regrasp, TurnTo
from palpate_host.common.tick_inputs import HostInput, Planned

STEPS = (
    TurnTo(0.3, (1.0, 1.0, 0.25, 1.0), 0.28),
    Regrasp(1, (0.1, -0.7, -0.7), (1 / 3, 0.0, 0.01), 0.01, (1.0, 0.0, 1.0, 0.7), (1.0,) * 4, 0.27),
)


def recorded(event):
    """The event after its way through a line of JSON, as host_records.py writes it."""
    line = json.dumps(msgspec.to_builtins(HostInput(3, event)))
    return msgspec.convert(json.loads(line), HostInput).event


def test_a_recording_keeps_a_plan_to_the_last_bit():
    event = Planned(GaitPlan((0.0, 0.0, 1.0), 2 / 3, ((1.0, 0.0, 0.0),) * 4, STEPS))
    assert recorded(event) == event
    assert recorded(Planned(None, "why")) == Planned(None, "why")


def test_a_recording_keeps_what_the_planner_makes_and_the_command():
    event = Planned(planned(angle_deg=10.0))
    assert recorded(event) == event
    command = Reorient((0.0, 0.0, 90.0), ((1.0, 2.0, 1 / 3),) * 4)
    assert recorded(command) == command
