"""The host's process: bus and clock around HostCore, and an orderly stop in every case.

One thread waits on the bus until the next tick of an absolute grid, so a late tick does not shift the
following ones. The time is the system's epoch clock, which stamps received frames and, modulo 2^32 us, is the
bus clock.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.simulated_clock import clock_of
from palpate_edge.common.errors import BusError
from palpate_edge.common.gc_freeze import long_lived
from palpate_edge.common.local_sockets.sd_notify import Notifier, WatchdogGate
from palpate_edge.common.signals import on_stop_signal
from palpate_host.config import hand_reader
from palpate_host.config.hand_config import HandConfig, StartMode
from palpate_host.control.damping_stability import check_damping
from palpate_host.control.hand_model import model_of, source_of
from palpate_host.control.kinematics import HandKinematics
from palpate_host.control.turning_stability import turning_gain
from palpate_host.operator.server import OperatorSocket, default_control_socket
from palpate_host.service.bus_load_check import check_bus_load
from palpate_host.service.bus_reports import BusReports
from palpate_host.service.host_bus import HostBus
from palpate_host.service.host_core import HostCore
from palpate_host.service.real_time import become_real_time
from palpate_host.service.status_stream import StatusStream
from palpate_host.service.turn_plans import TurnPlans

BUS_NAME = "host"
# Closing an adapter drops the frames in its queue: the last stop frames get this time to be sent.
LINGER_S = 0.05

_log = logging.getLogger("palpate.host")


def load_hand(path: Path) -> tuple[HandConfig, HandKinematics]:
    """Read hand.toml and build its hand. Raises ConfigError as `hand_reader.load`, `model_of` and
    `HandKinematics`."""
    config = hand_reader.load(path)
    return config, hand_of(config)


def hand_of(config: HandConfig) -> HandKinematics:
    """Return the hand of a configuration. Raises ConfigError as `model_of` and `HandKinematics`."""
    joints = [joint.name for joint in config.joints]
    return HandKinematics(model_of(config), joints, config.model.tip_sites, source_of(config))


def core_of(config: HandConfig, hand: HandKinematics) -> HostCore:
    """Return the core of a hand that may start; raises as its checks and `HostCore`."""
    check_bus_load(config)
    check_damping(config, hand)
    return HostCore(config, hand)


def now_us() -> int:
    """Return the epoch time in us."""
    return time.time_ns() // 1000


def bus_time(bus: BusConfig) -> Callable[[], int]:
    """Return the clock, epoch us, that this bus uses. Raises ConfigError as `clock_of`."""
    return clock_of(bus).now_us if bus.clock else now_us


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a run beside hand.toml. duration_s: None for no limit. status_target: receives the status of
    every tick. control_socket: None for the default path. start: overrides run.start."""

    duration_s: float | None = None
    status_target: Path | None = None
    control_socket: Path | None = None
    start: StartMode | None = None


def run(config_path: Path, options: Options) -> None:
    """Run the hand until SIGTERM or SIGINT, for `duration_s`, or until a fault ends it.

    At the end the drives are quick-stopped, disabled and NMT-stopped, if the bus still works. With run.start
    = "command" a lost bus is a fault, and the bus is reopened; otherwise it ends the run. Raises ConfigError
    for the configuration and for ticks that do not fit on the bus; BusError when the bus cannot be opened or
    is lost, or with the reason of the fault that stopped the hand.
    """
    config, hand = load_hand(config_path)
    if options.start is not None:
        config = config.starting(options.start)
    now_us = bus_time(config.bus)
    core = core_of(config, hand)
    gain = turning_gain(config, hand)
    if gain is not None and not gain.is_stable:
        _log.warning(gain.warning)
    with ExitStack() as stack:
        stream = None
        if options.status_target is not None:
            stream = stack.enter_context(closing(StatusStream(options.status_target)))
        path = options.control_socket or default_control_socket()
        control = stack.enter_context(closing(OperatorSocket(path, config_path)))
        bus = stack.enter_context(closing(_open(config, core)))
        notifier = stack.enter_context(closing(Notifier()))
        stack.enter_context(on_stop_signal(core.request_stop))
        for refusal in become_real_time() if config.run.real_time else ():
            _log.warning(refusal)
        stack.enter_context(long_lived())
        usual = f"on {config.bus.interface}"
        notifier.ready(usual)
        reports = BusReports(core, notifier, usual)
        plans = stack.enter_context(closing(TurnPlans(config)))
        failure = _loop(core, bus, stream, control, options.duration_s, notifier, reports, now_us, plans)
        notifier.stopping()
    if failure:
        raise BusError(failure)


def _open(config: HandConfig, core: HostCore) -> HostBus:
    return HostBus(
        lambda: open_bus(config.bus, BUS_NAME, core.accept_ids, echo=True),
        outlives=config.run.start is StartMode.COMMAND,
    )


def _loop(
    core: HostCore,
    bus: HostBus,
    stream: StatusStream | None,
    control: OperatorSocket,
    duration_s: float | None,
    notifier: Notifier,
    reports: BusReports,
    now_us: Callable[[], int],
    plans: TurnPlans,
) -> str:
    """Run the ticks; return the failure, empty after a requested stop.

    The watchdog is fed while ticks and bus frames continue, and while the bus is being reopened.
    """
    gate, ticks = WatchdogGate(notifier.watchdog_us), 0
    end_us = None if duration_s is None else now_us() + round(duration_s * 1e6)
    output = core.process(now_us(), ())
    while True:
        bus.send(now_us(), output.frames_out)
        if output.ticked and output.status is not None:
            control.serve(core.command, output.status)
            planned = plans.update(core.turn_request)
            if planned is not None:
                core.planned(planned)
            if stream is not None:
                stream.write(output.status)
            reports.ticked(output.status)
            core.set_io_counters(bus.counters, 0 if stream is None else stream.lines_lost)
        if output.finished:
            time.sleep(LINGER_S)
            return output.failure
        wait_s = max(0, output.next_due_us - now_us()) * 1e-6
        frames = bus.receive(now_us(), wait_s)
        if end_us is not None and now_us() >= end_us:
            core.request_stop()
        reports.bus_changed(now_us(), bus.changes())
        output = core.process(now_us(), frames)
        ticks += 1
        if gate.may_feed(now_us(), ticks, bus.activity):
            notifier.feed_watchdog()
