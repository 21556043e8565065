"""Run the demo as processes: calibrate, start everything, monitor it for the duration, stop in order."""

from __future__ import annotations

import os
import platform
import shlex
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from palpate_bus.hub.connection import ask
from palpate_bus.hub.control import AskStatistics
from palpate_edge import __version__
from palpate_edge.common.errors import BusError
from palpate_edge.common.signals import stop_event
from palpate_host.common.mode import STARTING
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.service.contract import recording_header
from palpate_host.service.host import bus_time
from palpate_host.service.host_records import HostRecorder
from palpate_twin.demo.live_view import ViewScale
from palpate_twin.demo.monitor import Monitor, MonitorSample
from palpate_twin.demo.processes import Children, DemoError, Program, RealTimePriority
from palpate_twin.demo.programme import Programme, socket_commander
from palpate_twin.demo.run_folder import RunFolder, bind_calibrations

START_TIMEOUT_S = 60.0
PREPARE_TIMEOUT_S = 900.0  # rendering and calibrating the sensors takes 10 s on an idle machine
POLL_PERIOD_S = 0.125

ShowSample = Callable[[MonitorSample, float], None]


class DemoInterruptedError(Exception):
    """SIGINT or SIGTERM interrupted the demo; `run` stops all processes before it raises this."""


@dataclass(frozen=True, slots=True)
class ProcessCommand:
    """Name, program and arguments of one process of the demo."""

    name: str
    program: Program
    arguments: tuple[str, ...]
    priority: RealTimePriority = RealTimePriority.NONE

    @property
    def text(self) -> str:
        """The command as typed in a shell."""
        return shlex.join((self.program.command, *self.arguments))


def commands(folder: RunFolder, hand: HandConfig, recording: Path | None) -> list[ProcessCommand]:
    """Return the processes of the demo in the order of their start; the first one exits by itself.

    recording: folder that is played in place of the twin. With a recording, the processes get real-time
    priorities as on boards. With the twin they do not: rendering takes most of the processor time, so
    prioritised processes would only wait longer for the next frame.
    """
    header = log_header(hand, "palpate demo")
    entries = [text for key, value in header.items() for text in ("--header", f"{key}={value}")]
    hub = ("bus", "hub", "--socket", str(folder.hub_socket), "--bitrate", str(hand.bus.bitrate))
    clock = ("--clock", hand.bus.clock) if hand.bus.clock else ()
    config = ("--config", str(folder.hand_toml))
    sockets = ("--status", str(folder.status_socket), "--socket", str(folder.control_socket))
    if recording is None:
        bus = fingertip = host = RealTimePriority.NONE
        sensors = ("simulate", "fingertips", "--hand", str(folder.hand_toml), "-o", str(folder.sensors))
        rings = [text for finger in hand.fingers for text in ("--ring", str(folder.ring(finger.name)))]
        paths = ("--sensors", str(folder.sensors), "--truth", str(folder.truth))
        first = ProcessCommand("fingertips", Program.HOST, sensors)
        plant = ProcessCommand("twin", Program.HOST, ("simulate", "live", *config, *paths, *rings))
    else:
        bus, fingertip, host = RealTimePriority.BUS, RealTimePriority.FINGERTIP, RealTimePriority.HOST
        calibrate = ("calibrate", str(recording / "press"), "-o", str(folder.calibration))
        first = ProcessCommand("calibrate", Program.EDGE, calibrate)
        plant = ProcessCommand("drives", Program.HOST, ("drives", *config), RealTimePriority.DRIVES)
    return [
        first,
        ProcessCommand("hub", Program.HOST, (*hub, *clock, "--log", str(folder.log), *entries), bus),
        plant,
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
    """Return the header of the bus log: the versions of EDS and hand.toml, and the machine and program."""
    return {**recording_header(hand).entries, "origin": origin, "palpate": __version__, **_machine()}


def view_scale(hand: HandConfig, duration_s: float, force_N: float) -> ViewScale:
    """Return the full-scale values of the live view."""
    return ViewScale(
        duration_s=duration_s,
        bitrate=hand.bus.bitrate,
        dome_radius_mm=1e3 * hand.control.tip_radius_m,
        force_N=force_N,
        torque_limit_Nm=tuple(joint.torque_limit_Nm for joint in hand.joints),
    )


def run(
    folder: RunFolder,
    recording: Path | None,
    duration_s: float,
    report_progress: Callable[[str], None],
    show: ShowSample,
) -> None:
    """Run the whole demo; the figures are computed from the files in `folder` afterwards.

    report_progress: called with one line of text for each step of the start. show: called with each sample
    and the seconds since the hand began to operate. Raises DemoError naming the process that failed,
    DemoInterruptedError after Ctrl-C; all processes have ended in either case.
    """
    hand = folder.hand()
    prepare, *_ = commands(folder, hand, recording)
    with stop_event() as stopped, Children(folder.path) as children:
        watch = _ProcessWatch(children, stopped)
        report_progress(
            "making and calibrating the sensors" if recording is None else "calibrating the sensor"
        )
        watch.finish(prepare, report_progress)
        bind_calibrations(folder)
        hand = folder.hand()
        _, hub, plant, *tips, host = commands(folder, hand, recording)
        statuses: list[HostStatus] = []
        report_progress("starting the hub, nine drives, three fingertips and the host")
        watch.start(hub)
        watch.until(lambda: _responds(folder.hub_socket), "a response of the hub")
        now_us = bus_time(hand.bus)
        with Monitor(hand, folder.status_socket, now_us, statuses.append) as monitor:
            watch.start(plant)
            if recording is None:
                rings = [folder.ring(finger.name) for finger in hand.fingers]
                watch.until(lambda: all(ring.exists() for ring in rings), "the twin's cameras")
            for command in tips:
                watch.start(command)
            watch.poll_until(monitor, lambda _sample: not monitor.not_booted, "the boot-up of every node")
            watch.start(host)
            watch.poll_until(monitor, _is_operating, "the hand to operate")
            programme = None
            if recording is None:
                programme = Programme(socket_commander(folder.control_socket), folder.commands, duration_s)
            _watch_for(duration_s, now_us, watch, monitor, show, programme)
            children.stop(host.name, meanwhile=monitor.poll)
            monitor.poll()
        children.stop(plant.name, *(command.name for command in tips))
        children.stop(hub.name)
    _add_notes(folder.log, hand, statuses)


def _add_notes(log: Path, hand: HandConfig, statuses: Sequence[HostStatus]) -> None:
    """Append the host's records to the hub's log."""
    recorder = HostRecorder(hand)
    with log.open("a", encoding="ascii", newline="\n") as file:
        for status in statuses:
            for note in recorder.notes(status):
                file.writelines(f"{line}\n" for line in note.lines())


def _watch_for(
    duration_s: float,
    now_us: Callable[[], int],
    watch: _ProcessWatch,
    monitor: Monitor,
    show: ShowSample,
    programme: Programme | None,
) -> None:
    begin_us = now_us()
    while (elapsed_s := 1e-6 * (now_us() - begin_us)) < duration_s:
        sample = watch.poll(monitor)
        if programme is not None:
            programme.update(sample.status)
        show(sample, elapsed_s)
        watch.pause(min(POLL_PERIOD_S, max(0.0, duration_s - elapsed_s)))


class _ProcessWatch:
    """Waiting with supervision: raises DemoError if a process ends and DemoInterruptedError on Ctrl-C."""

    def __init__(self, children: Children, stopped: threading.Event) -> None:
        self._children = children
        self._stopped = stopped

    def start(self, command: ProcessCommand) -> None:
        self._children.start(command.name, command.program, command.arguments, command.priority)

    def finish(self, command: ProcessCommand, report_progress: Callable[[str], None]) -> None:
        """Run a process to its end and report each new line of its stderr."""
        child = self._children.start(command.name, command.program, command.arguments)
        reported = ""

        def has_ended() -> bool:
            nonlocal reported
            if (line := child.last_line()) != reported:
                reported = line
                report_progress(line)
            return child.process.poll() is not None

        self.until(has_ended, command.name, PREPARE_TIMEOUT_S, watch_children=False)
        self._children.stop(command.name)

    def pause(self, seconds: float) -> None:
        if self._stopped.wait(seconds):
            raise DemoInterruptedError

    def poll(self, monitor: Monitor) -> MonitorSample:
        """Return a sample of the hand's state. Raises DemoError if a process has ended."""
        self._children.check()
        try:
            return monitor.poll()
        except BusError:
            self._children.find_cause()
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
                raise DemoError(
                    f"timed out after {timeout_s:.0f} s waiting for {what}: "
                    "read the .stderr files in the run folder"
                )
            self.pause(0.02)

    def poll_until(self, monitor: Monitor, condition: Callable[[MonitorSample], bool], what: str) -> None:
        self.until(lambda: condition(self.poll(monitor)), what)


def _responds(socket_path: Path) -> bool:
    try:
        ask(socket_path, AskStatistics())
    except BusError:
        return False
    return True


def _is_operating(sample: MonitorSample) -> bool:
    return sample.status is not None and sample.status.mode not in STARTING


def _machine() -> dict[str, str]:
    """Return a description of the machine for the log header."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    cpu = models[0] if models else platform.machine()
    return {
        "machine": f"{os.cpu_count()} cores, {cpu}, {platform.system()} {platform.release()}",
        "python": platform.python_version(),
    }
