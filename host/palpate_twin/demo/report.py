"""Write report.html: one file with all pictures embedded, readable without network and without scripts."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Sequence
from html import escape
from pathlib import Path

import cv2

from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import ConfigError
from palpate_host.common.mode import Mode
from palpate_twin.demo import lockstep, plots
from palpate_twin.demo.analysis import Analysis, Summary
from palpate_twin.demo.distribution import Distribution
from palpate_twin.demo.film import Film, film_command
from palpate_twin.demo.fingertip_film import draw_fingertips
from palpate_twin.demo.live_view import mode_name
from palpate_twin.demo.orchestrator import commands
from palpate_twin.demo.run_folder import RunFolder
from palpate_twin.demo.verdict import verdict
from palpate_twin.hand.push_recovery import RECOVERY_S

MOST_MODE_CHANGES = 40
ABSENT = "-"
SIGHT_HEIGHT_PX = 300

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; background: #fff; max-width: 1060px;
       margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.6em; } h2 { font-size: 1.2em; margin-top: 2em; border-bottom: 1px solid #ccc; }
div.scroll { overflow-x: auto; }
table { border-collapse: collapse; margin: 0.8em 0; font-variant-numeric: tabular-nums; }
th, td { padding: 0.2em 0.8em; text-align: right; border-bottom: 1px solid #e4e4e4; }
td { white-space: nowrap; } .text td:last-child { white-space: normal; min-width: 18em; }
th { font-weight: 600; vertical-align: bottom; }
th:first-child, td:first-child, .text td, .text th { text-align: left; }
p.verdict { font-size: 1.25em; font-weight: 600; padding: 0.5em 0.8em; border-left: 6px solid #2a8a3e;
            background: #f0f8f1; } p.verdict.bad { border-color: #b3261e; background: #fdf1f0; }
@media (max-width: 640px) { body { margin: 0.5em auto; padding: 0 0.6em; } th, td { padding: 0.2em 0.5em; } }
img { max-width: 100%; height: auto; } .plot img { min-width: 640px; } p.note { color: #555; }
pre { background: #f5f5f5; padding: 0.8em; overflow-x: auto; }
"""


def write_report(
    path: Path, analysis: Analysis, folder: RunFolder, wait_for_film: Callable[[], Film] | None
) -> None:
    """Write the report. wait_for_film: called when all else is drawn; None if a recording was played.

    Raises ConfigError if `path` cannot be written.
    """
    summary = analysis.summary
    below = [
        *_sight_parts(analysis, folder),
        "<h2>Contact and force</h2>",
        _finger_table(summary, analysis),
        *(
            f"<h3>{escape(finger.name)}</h3>"
            + _plot(plots.contact_plot(pairs, analysis.begin_us), finger.name)
            for finger, pairs in zip(summary.fingers, analysis.pairs, strict=True)
        ),
        "<h2>From exposure to the bus</h2>",
        _latency_table(summary),
        _plot(plots.latency_plot(analysis), "latency"),
        "<h2>The hand</h2>",
        _plot(plots.hand_plot(analysis), "modes, orientation error and torques"),
        _hand_tables(summary, analysis),
        "<h2>Bus load</h2>",
        _plot(plots.load_plot(analysis), "bus load"),
        _traffic_table(summary),
        "<h2>How to reproduce this report</h2>",
        _commands(analysis, folder),
        "<h2>About this run</h2>",
        _header_table(summary, analysis),
    ]
    film = wait_for_film() if wait_for_film else None
    above = [*_verdict_parts(summary, folder, film), *_turn_parts(analysis, folder, film)]
    parts = ["<h1>palpate demo</h1>", *above, *below]
    page = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><title>palpate demo</title>'
        f"<style>{STYLE}</style></head>\n<body>\n" + "\n".join(parts) + "\n</body></html>\n"
    )
    write_atomically(path, page.encode(), ConfigError)


def _verdict_parts(summary: Summary, folder: RunFolder, film: Film | None) -> list[str]:
    """Return the verdict, the film (None if a recording was played) and the verdict's grounds."""
    judged = verdict(summary)
    grounds = "".join(f"<li>{escape(line)}</li>" for line in judged.grounds)
    kind = "verdict" if judged.is_good else "verdict bad"
    return [
        f'<p class="{kind}">{escape(judged.headline)}</p>',
        *([] if film is None else _film_parts(folder, film)),
        f"<ul>{grounds}</ul>",
    ]


def _sight_parts(analysis: Analysis, folder: RunFolder) -> list[str]:
    """Return what the fingertips saw at the end of the first turn, or in the middle of a run without turns;
    nothing if no pictures were kept."""
    if not folder.has_pictures:
        return []
    figures = analysis.summary.turn
    time_s = figures.steps[0].end_s if figures and figures.steps else analysis.summary.duration_s / 2
    names = [finger.name for finger in analysis.summary.fingers]
    sheet = draw_fingertips(folder, names, analysis.begin_us + 1e6 * time_s, SIGHT_HEIGHT_PX)
    note = (
        f"The cameras' pictures {time_s:.1f} s after the start, and the contacts published for them. Green: "
        "beads found, with arrows of their displacement; red crosses: beads lost. Red arrow: normal force; "
        "red ring: 95 % radius of the position."
    )
    data = cv2.imencode(".png", sheet)[1].tobytes()
    return ["<h2>What the fingertips see</h2>", _picture(data, "beads and contacts"), _note(note)]


def _header_table(summary: Summary, analysis: Analysis) -> str:
    rows = [
        ("started", summary.started_at),
        ("duration", f"{summary.duration_s:.1f} s of bus log, {summary.bus.frames} frames"),
        ("bit rate", f"{summary.bitrate} bit/s"),
        ("contacts from", str(analysis.recording or "rendered fingertips of the simulated hand")),
        *((key, value) for key, value in summary.origin.items() if not key.startswith("node.")),
    ]
    return _table(("", ""), rows, text=True)


def _turn_parts(analysis: Analysis, folder: RunFolder, film: Film | None) -> list[str]:
    """Return stills and the comparison of target and truth; nothing if a recording was played."""
    if film is None:
        return []
    parts = ["<h2>The object</h2>"]
    if film.is_there:
        parts.append(_picture(folder.film.with_suffix(".png").read_bytes(), "the hand at six times"))
    turn, figures = analysis.turn, analysis.summary.turn
    if turn is None or figures is None:
        return [*parts, _note("The host never turned the object.")]
    rows = [
        (
            step.name,
            f"{step.begin_s:.1f} to {step.end_s:.1f}",
            f"{step.error_deg:.2f}",
            f"{step.believed_error_deg:.2f}",
            ", ".join(f"{path:.2f}" for path in step.slip_mm),
            f"{step.friction_ratio:.2f}",
            f"{step.pace:.2f}",
            step.verdict or "ok",
        )
        for step in figures.steps
    ]
    head = (
        "turn",
        "time (s)",
        "error to target (deg)",
        "error of the estimate (deg)",
        "slip of each tip (mm)",
        "friction/normal",
        "speed",
        "result",
    )
    note = (
        "Turns about the roll, pitch and yaw axes of the hand; errors at the end of each turn. Error to "
        "target: angle between the object's true and desired orientation. Error of the estimate: angle "
        "between its true orientation and the one the host estimates from the contacts. Normal forces of the "
        f"fingertips: {figures.smallest_N:.2f} to {figures.largest_N:.2f} N. The object's final height is "
        f"{figures.sunk_mm:.1f} mm below its initial one. Speed: simulated time over real time; it is below "
        "1 while the simulation waits for a frame, a contact or a command. "
        "Target and estimate come from replaying the log through the host core, the truth from the twin's "
        "motion.csv."
    )
    parts = [*parts, _plot(plots.turn_plot(turn), "orientation"), _table(head, rows), _note(note)]
    return [*parts, *_push_parts(analysis.summary)]


def _push_parts(summary: Summary) -> list[str]:
    """Return the table of the pushes on the held object; nothing without a push."""
    if not summary.pushes:
        return []
    rows = [
        (
            push.name,
            f"{push.begin_s:.1f}",
            f"{push.moved_mm:.1f}",
            f"{push.remaining_mm:.1f}",
            "ok" if push.is_held else "NOT HELD",
        )
        for push in summary.pushes
    ]
    head = ("push", "time (s)", "moved by (mm)", f"{RECOVERY_S:g} s after it (mm)", "result")
    note = (
        "Forces at the object's centre of mass, along the axes of the hand, and the distance of the object"
        " from its place before the push. The law is control.law of hand.toml."
    )
    return ["<h3>Pushes</h3>", _table(head, rows), _note(note)]


def _film_parts(folder: RunFolder, film: Film) -> list[str]:
    if not film.is_there:
        return [_note(f"No film: {film.description}")]
    return [
        _picture(folder.film.read_bytes(), "the hand turning the object", "webp"),
        _note(
            "Left: what the camera of one fingertip sees, and the contact that it publishes. Right: the true "
            f"motion of hand and object. {film.description}."
        ),
    ]


def _finger_table(summary: Summary, analysis: Analysis) -> str:
    rows = []
    for finger in summary.fingers:
        error = finger.position_error_mm
        rows.append(
            (
                finger.name,
                *_mean_median_p95(error),
                _number(finger.force_rmse_N, 3),
                _number(finger.force_rmse_percent, 1),
                _number(finger.contact_right_percent, 1),
                finger.frames,
                finger.dropped,
                finger.refused,
                finger.incomplete,
            )
        )
    head = (
        "finger",
        "mean (mm)",
        "median",
        "p95",
        "force RMSE (N)",
        "% of largest",
        "flag correct (%)",
        "frames",
        "dropped",
        "rejected",
        "incomplete",
    )
    note = (
        "Position error: distance between published and true contact, in frames where both have a contact. "
        "Force: published normal force (0 without contact) compared with the truth over all valid frames. "
        "Dropped: gaps in the sequence numbers. Rejected: frames without a valid contact. Incomplete: frames "
        "with a missing, duplicate or late TPDO. "
    )
    if analysis.recording is not None:
        note += "Frame n on the bus belongs to row (n modulo length) of the recording's truth.csv."
    else:
        note += "The truth is the contact that the twin rendered into that frame."
    return _table(head, rows) + _note(note)


def _latency_table(summary: Summary) -> str:
    rows = []
    for finger in summary.fingers:
        value = finger.latency_us
        if value is not None:
            numbers = (value.median, value.mean, value.p95, value.p99, value.largest)
            rows.append((finger.name, *(f"{number / 1000:.2f}" for number in numbers)))
    note = (
        "Time from the exposure, as TPDO 3 gives it on the bus clock, to the hub's time stamp of that TPDO 3 "
        "when it wins arbitration. It includes rendering the frame or decoding a video, which a camera does "
        "not need."
    )
    return _table(("finger", "median (ms)", "mean", "p95", "p99", "largest"), rows) + _note(note)


def _hand_tables(summary: Summary, analysis: Analysis) -> str:
    hand = summary.hand
    modes = _table(
        ("mode", "s"), [(mode_name(Mode(mode)), f"{seconds:.2f}") for mode, seconds in hand.mode_s.items()]
    )
    joints = _table(
        ("joint", "limit (N m)", "largest (N m)", "commands", "above the limit"),
        [(j.name, f"{j.limit_Nm:.3f}", f"{j.largest_Nm:.3f}", j.commands, j.over_limit) for j in hand.joints],
    )
    error = hand.orientation_error_deg
    turn = "The host never turned the object with contacts."
    if error is not None:
        turn = (
            f"Orientation error in mode {mode_name(Mode.MANIPULATE)}: median {error.median:.2f} deg, "
            f"p95 {error.p95:.2f}, largest {error.largest:.2f}."
        )
    if analysis.recording is not None:
        turn += (
            " The contacts come from a recording and do not follow the hand, so this shows that the "
            "controller runs, not how well it manipulates."
        )
    note = turn + " Modes and orientation error come from replaying the log through the host core, torques"
    note += " from RPDO 1."
    changes = [(f"{c.time_s:.2f}", mode_name(c.mode), c.reason) for c in hand.changes[:MOST_MODE_CHANGES]]
    more = len(hand.changes) - len(changes)
    return (
        _note(note)
        + modes
        + joints
        + _table(("time (s)", "mode", "reason"), changes, text=True)
        + (_note(f"{more} more changes are in summary.json.") if more else "")
    )


def _traffic_table(summary: Summary) -> str:
    rows = [
        (f"{load.can_id:03X}", load.name, load.frames, f"{load.frames_per_s:.1f}", f"{load.load_percent:.3f}")
        for load in sorted(summary.bus.ids, key=lambda load: -load.load_percent)
    ]
    bus = summary.bus
    total = ("all", "", bus.frames, f"{bus.frames / bus.duration_s:.1f}", f"{bus.mean_percent:.3f}")
    return _table(("identifier", "service", "frames", "frames/s", "load (%)"), [*rows, total])


def _commands(analysis: Analysis, folder: RunFolder) -> str:
    origin = analysis.summary.origin["origin"]
    started = [origin.replace("palpate", "palpate-host", 1)]
    if origin != lockstep.ORIGIN:
        started = [command.text for command in commands(folder, analysis.config, analysis.recording)]
    if analysis.recording is None:
        started.append(film_command(folder))
    again = [f"palpate-host demo --report-only --output {folder.path.parent}"]
    checks = [
        f"palpate-host replay {folder.log} --config {folder.hand_toml}",
        f"palpate-host bus pcap {folder.log} {folder.path / 'bus.pcap'}",
        f"tshark -r {folder.path / 'bus.pcap'} -d can.subdissector,canopen",
    ]
    return (
        _note("Processes of this run, one per line:")
        + _code(started)
        + _note("Compute all figures again from bus log and truth (writes report.html and run/summary.json):")
        + _code(again)
        + _note("Replay the log through the host core; decode it with Wireshark:")
        + _code(checks)
    )


def _mean_median_p95(value: Distribution | None) -> tuple[str, str, str]:
    if value is None:
        return ABSENT, ABSENT, ABSENT
    mean, median, p95 = (f"{number:.2f}" for number in (value.mean, value.median, value.p95))
    return mean, median, p95


def _number(value: float | None, digits: int) -> str:
    return ABSENT if value is None else f"{value:.{digits}f}"


def _table(head: Sequence[str], rows: Iterable[Sequence[object]], *, text: bool = False) -> str:
    titles = "".join(f"<th>{escape(title)}</th>" for title in head) if any(head) else ""
    lines = ["".join(f"<td>{escape(str(cell))}</td>" for cell in row) for row in rows]
    body = "".join(f"<tr>{line}</tr>\n" for line in ([titles] if titles else []) + lines)
    style = ' class="text"' if text else ""
    return f'<div class="scroll"><table{style}>\n{body}</table></div>\n'


def _note(text: str) -> str:
    return f'<p class="note">{escape(text)}</p>\n'


def _code(lines: Iterable[str]) -> str:
    return "<pre>" + escape("\n".join(lines)) + "</pre>\n"


def _plot(data: bytes, alternative: str) -> str:
    """Return a plot that scrolls sideways where the page is narrower than its text is readable."""
    return f'<div class="scroll plot">{_picture(data, alternative)}</div>\n'


def _picture(data: bytes, alternative: str, kind: str = "png") -> str:
    text = base64.b64encode(data).decode("ascii")
    return f'<img alt="{escape(alternative)}" src="data:image/{kind};base64,{text}">\n'
