"""`palpate-host command`: commands for a running hand."""

from __future__ import annotations

import sys
from pathlib import Path

import click
import msgspec

from palpate_bus.cli.bus_options import NODE
from palpate_edge.common.atomic_write import atomic_text
from palpate_edge.common.errors import ConfigError, reason_of
from palpate_host.common.command import (
    FEWEST_CORNERS,
    MOST_CORNERS,
    Accepted,
    Command,
    CommandError,
    Grasp,
    Move,
    Recover,
    Release,
    Reorient,
    Rotate,
    Stop,
)
from palpate_host.common.mode import STOPPED
from palpate_host.common.status import LATE_BINS_US, HostStatus
from palpate_host.config.finger_key import with_finger_key
from palpate_host.operator.client import OperatorClient
from palpate_host.operator.protocol import Status
from palpate_host.operator.server import default_control_socket

MEANING = {
    "calibration": "Its contacts follow this calibration, and new recordings are bound to it.",
    "software": "Its contacts are computed by another version, so their accuracy may differ. Identity and PDO"
    " mapping still have to agree with the host's EDS.",
    "serial": "It is another device; fingers.calibration, if hand.toml has it, is compared next.",
}
"""Consequence of an accepted difference, by its key."""
ANGLE = click.FloatRange(-180, 180)
LENGTH = click.FloatRange(-1000, 1000)
RAMP = click.option(
    "--ramp",
    "ramp_s",
    type=click.FloatRange(0, 600),
    help="Duration in s.",
)


@click.group()
@click.option(
    "--socket",
    "path",
    type=click.Path(path_type=Path),
    help="The host's control socket [default: $PALPATE_CONTROL, or that of palpate-host run].",
)
@click.pass_context
def command(context: click.Context, path: Path | None) -> None:
    """Send a command to a running hand.

    Exit status: 0 accepted, 8 refused, 9 no host running.

    \b
    Examples:
      palpate-host command grasp
      palpate-host command rotate 0 0 30 --ramp 3
      palpate-host command status
      palpate-host command release
    """
    context.obj = path or default_control_socket()


@command.command()
@click.pass_obj
def grasp(path: Path) -> None:
    """Close the fingers and hold; stop a turn.

    \b
    Example:
      palpate-host command grasp
    """
    _send(path, Grasp())


@command.command(context_settings={"ignore_unknown_options": True})
@click.argument("roll", type=ANGLE)
@click.argument("pitch", type=ANGLE)
@click.argument("yaw", type=ANGLE)
@RAMP
@click.pass_obj
def rotate(path: Path, roll: float, pitch: float, yaw: float, ramp_s: float | None) -> None:
    """Turn the held object by ROLL PITCH YAW degrees.

    The axes are the hand's and do not turn with the object.

    \b
    Example:
      palpate-host command rotate 0 0 30 --ramp 3
    """
    _send(path, Rotate((roll, pitch, yaw), ramp_s))


@command.command(context_settings={"ignore_unknown_options": True})
@click.argument("x", type=LENGTH)
@click.argument("y", type=LENGTH)
@click.argument("z", type=LENGTH)
@click.option(
    "--turn",
    "rpy_deg",
    type=(ANGLE, ANGLE, ANGLE),
    default=(0.0, 0.0, 0.0),
    metavar="ROLL PITCH YAW",
    help="Turn by these angles in degrees at the same time.",
)
@RAMP
@click.pass_obj
def move(
    path: Path, x: float, y: float, z: float, rpy_deg: tuple[float, float, float], ramp_s: float | None
) -> None:
    """Move the held object by X Y Z millimetres.

    The axes are the hand's. Needs control.law = "pose" in hand.toml; a target beyond pose_law.reach_mm or
    reach_deg is refused.

    \b
    Example:
      palpate-host command move 0 0 10 --turn 0 0 15 --ramp 2
    """
    _send(path, Move((x, y, z), rpy_deg, ramp_s))


@command.command(context_settings={"ignore_unknown_options": True})
@click.argument("roll", type=ANGLE)
@click.argument("pitch", type=ANGLE)
@click.argument("yaw", type=ANGLE)
@click.option(
    "--corners",
    "corners_path",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    required=True,
    help="Text file with the object's corners in mm, in the hand's frame: x y z in each line.",
)
@click.pass_obj
def reorient(path: Path, roll: float, pitch: float, yaw: float, corners_path: Path) -> None:
    """Turn the held object far: fingers lift in turn.

    By ROLL PITCH YAW degrees; each finger takes hold again before the next one lifts.

    The axes are the hand's. Needs control.law = "pose" and four fingers. The turn is planned first, while the
    hand holds; `status` has a warning with the reason where it cannot be planned.

    \b
    Example:
      palpate-host command reorient 0 0 90 --corners object.txt
    """
    _send(path, Reorient((roll, pitch, yaw), read_corners(corners_path)))


def read_corners(path: Path) -> tuple[tuple[float, float, float], ...]:
    """Read the corners (k, 3) of an object in mm. Raises ConfigError, with the line, for anything else."""
    corners = []
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), start=1):
        words = line.split("#", 1)[0].replace(",", " ").split()
        if not words:
            continue
        try:
            x, y, z = (float(word) for word in words)
        except ValueError:
            raise ConfigError(f"{path}, line {number}: {line.strip()!r} is not three numbers x y z") from None
        corners.append((x, y, z))
    if not FEWEST_CORNERS <= len(corners) <= MOST_CORNERS:
        raise ConfigError(f"{path}: {len(corners)} corners; an object has {FEWEST_CORNERS} to {MOST_CORNERS}")
    return tuple(corners)


@command.command()
@click.pass_obj
def release(path: Path) -> None:
    """Open the fingers, then disable the drives.

    \b
    Example:
      palpate-host command release
    """
    _send(path, Release())


@command.command()
@click.pass_obj
def stop(path: Path) -> None:
    """Stop at once and disable the drives; continue with `recover`.

    \b
    Example:
      palpate-host command stop
    """
    _send(path, Stop())


@command.command()
@click.pass_obj
def recover(path: Path) -> None:
    """Leave fault or stop: reset every node and wait for `grasp`.

    \b
    Example:
      palpate-host command recover
    """
    _send(path, Recover())


@command.command()
@click.argument("node", type=NODE, metavar="NODE")
@click.pass_obj
def accept(path: Path, node: int) -> None:
    """Use another fingertip than hand.toml names.

    For a hand that waits in the mode check because the fingertip has another calibration, software version
    or serial number. The command prints what is accepted, the hand continues at once, and hand.toml gets the
    value for the next start. A different PDO mapping cannot be accepted.

    \b
    Example:
      palpate-host command accept 0x10
    """
    with OperatorClient(path) as client:
        answer = client.accept(node)
    accepted = answer.accepted
    if accepted is None:
        return
    click.echo(f"{accepted.finger}: accepted {accepted.key} {accepted.value}, not {accepted.instead_of}.")
    click.echo(MEANING[accepted.key])
    _write(Path(answer.config), accepted)


def _write(config: Path, accepted: Accepted) -> None:
    """Write what was accepted into hand.toml."""
    try:
        text = config.read_text(encoding="utf-8")
    except OSError as exc:
        raise ConfigError(
            f"{config} cannot be read ({reason_of(exc)}): until it has fingers.{accepted.key} of"
            f" {accepted.finger}, each start of the host waits again"
        ) from exc
    changed = with_finger_key(config, text, accepted.finger, accepted.key, accepted.value)
    with atomic_text(config, ConfigError) as file:
        file.write(changed)
    click.echo(f"{config}: fingers.{accepted.key} is written.")


@command.command()
@click.option("--json", "as_json", is_flag=True, help="Print the whole status as one JSON object.")
@click.pass_obj
def status(path: Path, as_json: bool) -> None:
    """Print mode, reason, fingers and joints.

    Exit status: 0, 8 in the modes fault and stop, 9 no host running.

    \b
    Example:
      palpate-host command status --json

    \b
    Example:
      palpate-host command status --json
    """
    with OperatorClient(path) as client:
        found = client.ask(Status())
    if found is None:
        raise CommandError("the host has not ticked yet: ask again")
    click.echo(msgspec.json.encode(found).decode() if as_json else status_text(found))
    if found.mode in STOPPED:
        sys.exit(CommandError.exit_status)


def _send(path: Path, what: Command) -> None:
    with OperatorClient(path) as client:
        client.ask(what)


def status_text(status: HostStatus) -> str:
    """Return the status as lines of text."""
    lines = [f"{status.mode.value}: {status.reason}"]
    if status.warning:
        lines.append(f"warning: {status.warning}")
    for finger in status.fingers:
        touch = "no contact" if not finger.in_contact else "contact, force unknown"
        if finger.normal_force_N is not None:
            touch = f"{finger.normal_force_N:.2f} N"
        age = "never" if finger.age_ms is None else f"{finger.age_ms:.0f} ms old"
        lines.append(f"{finger.name}: {touch}, {finger.frames_per_s:.0f} frames/s, {age}")
    for joint in status.joints:
        place = "unknown" if joint.position_rad is None else f"{joint.position_rad:+.3f} rad"
        lines.append(f"{joint.name}: {place}, {joint.command_Nm or 0.0:+.3f} N m, {joint.drive_state}")
    bins = [f"< {bin_us}" for bin_us in LATE_BINS_US] + [f">= {LATE_BINS_US[-1]}"]
    late = ", ".join(f"{count} {name}" for name, count in zip(bins, status.lateness, strict=False) if count)
    lines.append(f"ticks late by us: {late or 'none yet'}; left out: {status.counters.late_ticks}")
    lines += _counter_lines(status)
    return "\n".join(lines)


def _counter_lines(status: HostStatus) -> list[str]:
    """Return every counter since the start: the bus, and the parts of each fingertip's contacts."""
    host = status.counters
    lines = [
        f"bus: {host.frames_in} frames in, {host.frames_out} out, {host.foreign_frames} foreign, "
        f"{host.transmit_retries} transmit retries, {host.error_frames} error frames, "
        f"{host.receive_overruns} receive overruns, {host.bus_restarts} restarts; "
        f"{host.emergencies} emergencies; {host.status_lines_lost} status lines lost"
    ]
    for finger in status.fingers:
        lines.append(
            f"{finger.name}: {finger.complete} contacts, {finger.lost_frames} frames lost, "
            f"{finger.unpaired} unpaired, {finger.resynchronised} resynchronised; parts: "
            f"{finger.incomplete} incomplete, {finger.out_of_order} out of order, "
            f"{finger.duplicates} duplicates, {finger.late} late, {finger.extra_tpdos} TPDO 5 to 9 taken, "
            f"{finger.extra_missing} missing, {finger.extra_mixed} of another frame"
        )
    return lines
