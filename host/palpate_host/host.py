"""The host's loop at the rim: bus and clock around HostCore, and an orderly stop whatever happens.

One thread. The bus is waited on until the next tick of an absolute grid, so a late tick never shifts the
following ones. Time is the system's epoch clock, which stamps the bus and, modulo 2^32 us, is the bus clock.
"""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path

from palpate_edge.bus import Bus, open_bus
from palpate_edge.errors import BusError
from palpate_edge.sd_notify import Notifier, WatchdogGate
from palpate_edge.stop_signals import on_stop_signal
from palpate_host import hand_config
from palpate_host.hand import Hand
from palpate_host.hand_config import HandConfig
from palpate_host.hand_model import model_of, source_of
from palpate_host.master import HostCore
from palpate_host.status_stream import StatusStream

BUS_NAME = "host"
# Closing an adapter drops what its queue still holds: the last stop frames get this long to leave it.
LINGER_S = 0.05


def load_hand(path: Path) -> tuple[HandConfig, Hand]:
    """hand.toml and its hand; ConfigError as `hand_config.load`, `model_of` and `Hand` say."""
    config = hand_config.load(path)
    joints = [joint.name for joint in config.joints]
    return config, Hand(model_of(config), joints, config.model.tip_sites, source_of(config))


def now_us() -> int:
    """Epoch time in us."""
    return time.time_ns() // 1000


def run(config_path: Path, duration_s: float | None = None, status_target: Path | None = None) -> None:
    """Run the hand until SIGTERM or SIGINT, for `duration_s`, or until a fault stops it.

    Always leaves with the drives quick-stopped, off and NMT-stopped, if the bus still carries that.
    ConfigError for the configuration; BusError when the bus goes or a fault stopped the hand, with the
    fault's reason.
    """
    config, hand = load_hand(config_path)
    core = HostCore(config, hand)
    stream = StatusStream(status_target) if status_target is not None else None
    try:
        bus_with_echo = open_bus(config.bus, BUS_NAME, core.accept_ids, echo=True)
        with (
            bus_with_echo as bus,
            closing(Notifier()) as notifier,
            on_stop_signal(core.request_stop),
        ):
            notifier.ready(f"on {config.bus.interface}")
            failure = _loop(core, bus, stream, duration_s, notifier)
            notifier.stopping()
    finally:
        if stream is not None:
            stream.close()
    if failure:
        raise BusError(failure)


def _loop(
    core: HostCore, bus: Bus, stream: StatusStream | None, duration_s: float | None, notifier: Notifier
) -> str:
    """Returns the failure, empty after an asked-for stop. The watchdog is fed while ticks and bus go on."""
    gate, ticks = WatchdogGate(notifier.watchdog_us), 0
    end_us = None if duration_s is None else now_us() + round(duration_s * 1e6)
    output = core.process(now_us(), ())
    while True:
        bus.send(output.frames_out)
        if stream is not None and output.frames_out and output.status is not None:
            stream.write(output.status)
        if output.finished:
            time.sleep(LINGER_S)
            return output.failure
        wait_s = max(0, output.next_due_us - now_us()) * 1e-6
        frames = bus.receive(wait_s)
        if end_us is not None and now_us() >= end_us:
            core.request_stop()
        output = core.process(now_us(), frames)
        ticks += 1
        if gate.may_feed(now_us(), ticks, bus.counters.sent + bus.counters.received):
            notifier.feed_watchdog()
