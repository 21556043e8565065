"""The hub's wire goes by the clock of a simulated hand."""

from __future__ import annotations

from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.simulated_clock import ClockKeeper, clock_of

FRAME = CanFrame(0x123, b"12345678")


def test_frames_wait_on_the_wire_while_the_time_is_held(start_hub, tmp_path):
    hub, clock = start_hub("--clock", str(tmp_path / "clock"), "--bitrate", "10000"), tmp_path / "clock"
    config = BusConfig(interface="palpate", channel=str(hub.path), bitrate=10_000, clock=str(clock))
    keeper, now_us = ClockKeeper(clock), clock_of(config).now_us
    with open_bus(config, "ours") as ours, open_bus(config, "theirs") as theirs:
        keeper.go_on(slowly=False)
        ours.send([FRAME])  # which takes 11 ms
        sent_us = now_us()
        assert theirs.receive(0.5) == []  # the time has stood still since 3 ms after the keeper's last word
        frames = []
        for _ in range(500):
            keeper.go_on(slowly=False)
            frames += theirs.receive(0.002)
            if frames:
                break
    ((stamp_us, frame),) = frames
    assert frame == FRAME
    assert abs(stamp_us - sent_us) < 100_000  # the half second was held back
    assert keeper.held_us > 400_000
