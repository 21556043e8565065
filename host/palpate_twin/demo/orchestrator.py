"""One run of the demo: calibrate, bring everything up, watch for the duration, stop in order."""

from __future__ import annotations

import os
import platform
import shlex
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from palpate_bus.hub.connection import ask
from palpate_bus.hub.control import AskStatistics
from palpate_edge import __version__
from palpate_edge.common.errors import BusError
from palpate_edge.common.signals import stop_event
from palpate_host.common.mode import STARTING
from palpate_host.config.hand_config import HandConfig
from palpate_host.service.host import bus_time
from palpate_host.service.replay import contract_header
from palpate_twin.demo.live_view import Scale
from palpate_twin.demo.monitor import Monitor, MonitorSample
from palpate_twin.demo.processes import Children, DemoError, Program, Urgency
from palpate_twin.demo.programme import Programme, ask_by_socket
from palpate_twin.demo.run_folder import RunFolder

START_TIMEOUT_S = 60.0
PREPARE_TIMEOUT_S = 900.0  # sensors are rendered and calibrated in 10 s; a slow machine shows its progress
LOOK_PERIOD_S = 0.125

Show = Callable[[MonitorSample, float], None]


class DemoInterruptedError(Exception):
    """SIGINT or SIGTERM came; everything has been stopped by the time this leaves `run`."""


@dataclass(frozen=True, slots=True)
class ProcessCommand:
    """One process of the demo, by name, with what a person would type."""

    name: str
    program: Program
    arguments: tuple[str, ...]
    urgency: Urgency = Urgency.NONE

    @property
    def text(self) -> str:
        return shlex.join((self.program.command, *self.arguments))


def commands(folder: RunFolder, hand: HandConfig, recording: Path | None) -> list[ProcessCommand]:
    """Everything the demo starts, in order; the first one ends by itself. recording: None with the twin.

    Beside a recording they run in the real-time class, as on boards. The twin's pictures cost more than all
    else: ahead of them, the others would only wait longer for the next one.
    """
    header = log_header(hand, "palpate demo")
    entries = [text for key, value in header.items() for text in ("--header", f"{key}={value}")]
    hub = ("bus", "hub", "--socket", str(folder.hub_socket), "--bitrate", str(hand.bus.bitrate))
    clock = ("--clock", hand.bus.clock) if hand.bus.clock else ()
    config = ("--config", str(folder.hand_toml))
    sockets = ("--status", str(folder.status_socket), "--socket", str(folder.control_socket))
    if recording is None:
        bus = fingertip = host = Urgency.NONE
        made = ("simulate", "fingertips", "--hand", str(folder.hand_toml), "-o", str(folder.sensors))
        rings = [text for finger in hand.fingers for text in ("--ring", str(folder.ring(finger.name)))]
        paths = ("--sensors", str(folder.sensors), "--truth", str(folder.truth))
        first = ProcessCommand("fingertips", Program.HOST, made)
        moves = ProcessCommand("twin", Program.HOST, ("simulate", "live", *config, *paths, *rings))
    else:
        bus, fingertip, host = Urgency.BUS, Urgency.FINGERTIP, Urgency.HOST
        calibrate = ("calibrate", str(recording / "press"), "-o", str(folder.calibration))
        first = ProcessCommand("calibrate", Program.EDGE, calibrate)
        moves = ProcessCommand("drives", Program.HOST, ("drives", *config), Urgency.DRIVES)
    return [
        first,
        ProcessCommand("hub", Program.HOST, (*hub, *clock, "--log", str(folder.log), *entries), bus),
        moves,
        *(
            ProcessCommand(
                finger.name,
                Program.EDGE,
                ("run", "--config", str(folder.finger_toml(finger.name))),
                fingertip,
            )
            for finger in hand.fingers
        ),
        ProcessCommand("host", Program.HOST, ("run", *config, *sockets), host),
    ]


def log_header(hand: HandConfig, origin: str) -> dict[str, str]:
    """Of the bus log: what its frames mean, and what they come from."""
    return {**contract_header(hand).entries, "origin": origin, "palpate": __version__, **_machine()}


def view_scale(hand: HandConfig, duration_s: float, force_N: float) -> Scale:
    """What the live view is drawn against."""
    return Scale(
        duration_s=duration_s,
        bitrate=hand.bus.bitrate,
        dome_radius_mm=1e3 * hand.control.tip_radius_m,
        force_N=force_N,
        torque_limit_Nm=tuple(joint.torque_limit_Nm for joint in hand.joints),
    )


def run(
    folder: RunFolder, recording: Path | None, duration_s: float, say: Callable[[str], None], show: Show
) -> None:
    """Run the whole demo; bus.log in `folder` tells the rest.

    say: takes one line for each step of the start. show: takes each look and the seconds since the hand
    operates.
    Raises DemoError naming the process that failed, DemoInterruptedError after Ctrl-C; no process is left
    either way.
    """
    hand = folder.hand()
    prepare, hub, moves, *tips, host = commands(folder, hand, recording)
    with stop_event() as stopped, Children(folder.path) as children:
        watch = _ProcessWatch(children, stopped)
        say("making and calibrating the sensors" if recording is None else "calibrating the sensor")
        watch.finish(prepare, say)
        say("starting the hub, nine drives, three fingertips and the host")
        watch.start(hub)
        watch.until(lambda: _answers(folder.hub_socket), "the hub to answer")
        now_us = bus_time(hand.bus)
        with Monitor(hand, folder.status_socket, now_us) as monitor:
            watch.start(moves)
            if recording is None:
                rings = [folder.ring(finger.name) for finger in hand.fingers]
                watch.until(lambda: all(ring.exists() for ring in rings), "the twin's cameras")
            for command in tips:
                watch.start(command)
            watch.look_until(monitor, lambda _sight: not monitor.not_booted, "the boot-up of every node")
            watch.start(host)
            watch.look_until(monitor, _is_operating, "the hand to operate")
            programme = None
            if recording is None:
                programme = Programme(ask_by_socket(folder.control_socket), folder.commands, duration_s)
            _watch_for(duration_s, now_us, watch, monitor, show, programme)
            children.stop(host.name)
        children.stop(moves.name, *(command.name for command in tips))
        children.stop(hub.name)


def _watch_for(
    duration_s: float,
    now_us: Callable[[], int],
    watch: _ProcessWatch,
    monitor: Monitor,
    show: Show,
    programme: Programme | None,
) -> None:
    begin_us = now_us()
    while (elapsed_s := 1e-6 * (now_us() - begin_us)) < duration_s:
        sight = watch.look(monitor)
        if programme is not None:
            programme.look(sight.status)
        show(sight, elapsed_s)
        watch.pause(min(LOOK_PERIOD_S, max(0.0, duration_s - elapsed_s)))


class _ProcessWatch:
    """Waits that end with an error when a process dies and with DemoInterruptedError when the user stops."""

    def __init__(self, children: Children, stopped: threading.Event) -> None:
        self._children = children
        self._stopped = stopped

    def start(self, command: ProcessCommand) -> None:
        self._children.start(command.name, command.program, command.arguments, command.urgency)

    def finish(self, command: ProcessCommand, say: Callable[[str], None]) -> None:
        """Run a process to its end and pass on what it says."""
        child = self._children.start(command.name, command.program, command.arguments)
        said = ""

        def has_ended() -> bool:
            nonlocal said
            if (words := child.last_words()) != said:
                said = words
                say(words)
            return child.process.poll() is not None

        self.until(has_ended, command.name, PREPARE_TIMEOUT_S, watch_children=False)
        self._children.stop(command.name)

    def pause(self, seconds: float) -> None:
        if self._stopped.wait(seconds):
            raise DemoInterruptedError

    def look(self, monitor: Monitor) -> MonitorSample:
        """One look at the hand, all processes being alive."""
        self._children.check()
        try:
            return monitor.poll()
        except BusError:
            self._children.blame()
            raise

    def until(
        self,
        condition: Callable[[], bool],
        what: str,
        timeout_s: float = START_TIMEOUT_S,
        *,
        watch_children: bool = True,
    ) -> None:
        end_s = time.monotonic() + timeout_s
        while not condition():
            if watch_children:
                self._children.check()
            if time.monotonic() > end_s:
                raise DemoError(f"waited {timeout_s:.0f} s in vain for {what}: see the run folder")
            self.pause(0.02)

    def look_until(self, monitor: Monitor, condition: Callable[[MonitorSample], bool], what: str) -> None:
        self.until(lambda: condition(self.look(monitor)), what)


def _answers(socket_path: Path) -> bool:
    try:
        ask(socket_path, AskStatistics())
    except BusError:
        return False
    return True


def _is_operating(sight: MonitorSample) -> bool:
    return sight.status is not None and sight.status.mode not in STARTING


def _machine() -> dict[str, str]:
    """What the figures were measured on."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    cpu = models[0] if models else platform.machine()
    return {
        "machine": f"{os.cpu_count()} cores, {cpu}, {platform.system()} {platform.release()}",
        "python": platform.python_version(),
    }
