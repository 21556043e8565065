"""Live view in the terminal: the hand's state on top, one panel per finger; needs 80 x 24 characters."""

from __future__ import annotations

from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, RenderResult
from rich.layout import Layout
from rich.panel import Panel
from rich.text import Text

from palpate_host.common.mode import Mode
from palpate_host.common.status import FingerStatus, HostStatus, JointStatus
from palpate_twin.demo.dome_map import dome_map
from palpate_twin.demo.monitor import MonitorSample

HEADER_LINES = 4
WIDE = 30  # panel width in characters from which joint names are written in full
QUALITY_FULL = 255

_MODE_STYLE = {
    Mode.INIT: "bold white on blue",
    Mode.CHECK: "bold white on blue",
    Mode.HOME: "bold white on blue",
    Mode.READY: "bold white on blue",
    Mode.GRASP: "bold black on yellow",
    Mode.HOLD: "bold black on yellow",
    Mode.RELEASE: "bold black on yellow",
    Mode.BLIND: "bold black on yellow",
    Mode.MANIPULATE: "bold white on green",
    Mode.FAULT: "bold white on red",
    Mode.STOP: "bold white on red",
}
_MODE_NAME = {Mode.MANIPULATE: "PROPOSED"}  # the paper's name for the law with contacts


@dataclass(frozen=True, slots=True)
class ViewScale:
    """Full-scale values of bars and maps: one force for all fingers, one torque limit per joint."""

    duration_s: float
    bitrate: int
    dome_radius_mm: float
    force_N: float
    torque_limit_Nm: tuple[float, ...]


def mode_name(mode: Mode) -> str:
    """Return the mode's name in the view and the report."""
    return _MODE_NAME.get(mode, mode.value.upper())


def render(sample: MonitorSample, scale: ViewScale, elapsed_s: float) -> Layout:
    """Return the whole screen."""
    layout = Layout()
    header = Layout(Panel(_header(sample, scale, elapsed_s), title="palpate demo"), size=HEADER_LINES)
    fingers = Layout()
    status = sample.status
    if status is None:
        fingers.update(Panel("starting"))
    else:
        joints = len(status.joints) // len(status.fingers)
        panels = []
        for index, finger in enumerate(status.fingers):
            mine = slice(index * joints, (index + 1) * joints)
            panels.append(
                Layout(
                    FingerPanel(
                        finger,
                        sample.latency_us[index],
                        status.joints[mine],
                        scale.torque_limit_Nm[mine],
                        scale,
                    )
                )
            )
        fingers.split_row(*panels)
    layout.split_column(header, fingers)
    return layout


def plain_line(sample: MonitorSample, elapsed_s: float) -> str:
    """Return the state as one line of text, for a file or a pipe; values not measured are left out."""
    status = sample.status
    if status is None:
        return f"{elapsed_s:5.1f} s  starting"
    load = "" if sample.load is None else f", bus load {_percent(sample.load)}"
    parts = [f"{elapsed_s:5.1f} s  {mode_name(status.mode)} ({status.reason}){load}"]
    for finger, latency_us in zip(status.fingers, sample.latency_us, strict=True):
        latency = "" if latency_us is None else f", {_latency_text(latency_us)}"
        parts.append(f"{finger.name} {_force_text(finger)}, {finger.frames_per_s:.0f} fps{latency}")
    return " | ".join(parts)


def _header(sample: MonitorSample, scale: ViewScale, elapsed_s: float) -> Text:
    status = sample.status
    text = Text(no_wrap=True, overflow="ellipsis")
    if status is None:
        text.append("waiting for the host")
    else:
        text.append(f" {mode_name(status.mode)} ", _MODE_STYLE[status.mode])
        text.append(f" {'; '.join(part for part in (status.reason, status.warning) if part)}")
    rate = f"{scale.bitrate / 1000:g} kbit/s"
    load = f"bus load {_percent(sample.load)} of {rate}"
    text.append(f"\n{elapsed_s:.1f} of {scale.duration_s:g} s   {load}   ")
    text.append(_turn_text(status))
    return text


def _turn_text(status: HostStatus | None) -> str:
    if status is None or status.orientation_error_deg is None:
        return "orientation error -"
    return f"orientation error {status.orientation_error_deg:.2f} deg"


@dataclass(frozen=True, slots=True)
class FingerPanel:
    """Panel of one finger, drawn as large as its layout cell."""

    finger: FingerStatus
    latency_us: float | None
    joints: tuple[JointStatus, ...]
    limits_Nm: tuple[float, ...]
    scale: ViewScale

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        width = options.max_width - 2
        height = (options.height or console.height) - 2
        lines = self._lines(width)
        map_height = max(1, height - len(lines))
        body = dome_map(width, map_height, self.scale.dome_radius_mm, self.finger.position_mm)
        text = Text("\n").join([body, *lines])
        text.no_wrap = True
        limits = ", ".join(f"{limit:g}" for limit in sorted(set(self.limits_Nm)))
        yield Panel(
            text,
            title=f"{self.finger.name}: {self._state()}",
            subtitle=f"limit {limits} N m",
            padding=0,
            height=height + 2,
        )

    def _state(self) -> str:
        if self.finger.sequence is None:
            return "no frame"
        if not self.finger.valid:
            return "[bold red]rejected[/]"
        return "[bold green]contact[/]" if self.finger.in_contact else "free"

    def _lines(self, width: int) -> list[Text]:
        finger = self.finger
        place = "no contact"
        if finger.position_mm is not None:
            x, y, z = finger.position_mm
            place = f"{x:+.1f} {y:+.1f} {z:+.1f} mm"
        force_N = finger.normal_force_N or 0.0
        force = Text(f"{force_N:5.2f} N ")
        force.append(_bar(force_N / self.scale.force_N, width - len(force)), "bright_cyan")
        age = "-" if finger.age_ms is None else f"{finger.age_ms:.0f} ms"
        return [
            Text(place),
            force,
            Text(f"{finger.frames_per_s:.0f} fps, latency {_latency_text(self.latency_us)}"),
            Text(f"quality {finger.quality / QUALITY_FULL:.0%}, age {age}"),
            *(_torque(*pair, width) for pair in zip(self.joints, self.limits_Nm, strict=True)),
        ]


def _torque(joint: JointStatus, limit_Nm: float, width: int) -> Text:
    """Return a joint's name, its torque and a bar from the middle; the bar's ends are the torque limit."""
    name_width = 12 if width >= WIDE else 5
    command_Nm = joint.command_Nm or 0.0
    share = max(-1.0, min(1.0, command_Nm / limit_Nm))
    text = Text(f"{joint.name[: name_width - 1]:<{name_width}}{command_Nm:+.2f} ")
    half = max(0, (width - len(text) - 3) // 2)
    full, partial = divmod(round(abs(share) * half * 2), 2)
    style = "bright_red" if full == half else "bright_green"
    left = ("╺" * partial + "━" * full) if share < 0 else ""
    right = "" if share < 0 else ("━" * full + "╸" * partial)
    text.append("[").append(f"{left:>{half}}", style).append("│").append(f"{right:<{half}}", style).append(
        "]"
    )
    return text


def _bar(share: float, width: int) -> str:
    """Return a bar from the left in eighths of a character (U+2588 to U+258F)."""
    eighths = round(max(0.0, min(1.0, share)) * max(0, width) * 8)
    full, partial = divmod(eighths, 8)
    return "█" * full + (chr(0x2590 - partial) if partial else "")


def _force_text(finger: FingerStatus) -> str:
    return "rejected" if not finger.valid else f"{finger.normal_force_N or 0.0:.2f} N"


def _latency_text(latency_us: float | None) -> str:
    return "-" if latency_us is None else f"{latency_us / 1000:.1f} ms"


def _percent(load: float | None) -> str:
    return "-" if load is None else f"{load:.1%}"
