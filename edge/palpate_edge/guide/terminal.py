"""The guide at a terminal: the step and its live values as text, answers as lines."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import TextIO

from palpate_edge.capture.source import Source
from palpate_edge.common.errors import CaptureError, ConfigError
from palpate_edge.daemon.check_rows import Verdict
from palpate_edge.guide.guide_runner import GuideRunner
from palpate_edge.guide.guide_view import GuideView

SHOW_EVERY_S = 0.5
QUIT = "quit"


class TypedLines:
    """The lines of a stream, read by a thread of its own."""

    def __init__(self, stream: TextIO) -> None:
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        threading.Thread(target=self._read, args=(stream,), daemon=True).start()

    def next(self) -> str | None:
        """Return the next line without its end, None when none was typed; `QUIT` at the stream's end."""
        try:
            line = self._lines.get_nowait()
        except queue.Empty:
            return None
        return QUIT if line is None else line.strip()

    def _read(self, stream: TextIO) -> None:
        for line in stream:
            self._lines.put(line)
        self._lines.put(None)


def run_in_terminal(
    runner: GuideRunner,
    source: Source,
    next_line: Callable[[], str | None],
    write: Callable[[str], None],
    is_stopped: Callable[[], bool],
    *,
    is_live: bool,
) -> bool:
    """Guide a person until the calibration is written, and return True; False after `QUIT` or a stop.

    next_line: see `TypedLines.next`. write: takes text without a line end of its own. is_live: renew the
    values in place; otherwise a line is written when the verdict changes.

    Raises CaptureError when the source ends, DatasetError when the disk refuses.
    """
    shown, written, next_s = "", "", 0.0
    while not is_stopped():
        frame = source.read()
        if frame is None:
            raise CaptureError("the recording has ended: set capture.loop, or use a camera")
        now_s = frame.exposed_at_us / 1e6
        runner.frame(frame.image, now_s, source.exposure_us)
        line = next_line()
        if line == QUIT:
            return False
        if line is not None:
            write(_answer(runner, line))
            next_s = now_s
        view = runner.view
        if view.title != shown:
            shown, written = view.title, ""
            write(f"\n{_heading(view)}\n")
        if now_s >= next_s or runner.is_finished:
            next_s = now_s + SHOW_EVERY_S
            new = status_line(view)
            if is_live:
                write(f"\r\033[K{new}")
            elif view.text != written:
                write(f"{new}\n")
            written = view.text
        if runner.is_finished:
            return True
    return False


def status_line(view: GuideView) -> str:
    """Return verdict, reason, figures and progress in one line."""
    figures = ", ".join(f"{name} {text}" for name, text in view.figures)
    progress = f" [{view.done}/{view.total}]" if view.total else ""
    verdict = "wait" if view.verdict is Verdict.ABSENT else view.verdict.value
    return f"{verdict:<7}{view.text}{progress}" + (f" ({figures})" if figures else "")


def _heading(view: GuideView) -> str:
    answers = [f"Enter: {view.actions[0].label}" if view.actions else ""]
    answers += [f"{action.name}: {action.label}" for action in view.actions[1:]]
    hint = "; ".join(one for one in answers if one)
    return "\n".join(
        one for one in (f"{view.number}/{view.steps} {view.title}", view.instruction, hint) if one
    )


def _answer(runner: GuideRunner, line: str) -> str:
    """Give a typed line to the guide: nothing for the usual answer, a number, or the name of an answer.

    Return what to write: why it was refused, or what comes next.
    """
    actions = runner.view.actions
    number = _number(line)
    if number is not None:
        name = next((action.name for action in actions if action.unit), "a number")
    else:
        name = line or (actions[0].name if actions else "nothing")
    try:
        runner.answer(name, number)
    except ConfigError as refusal:
        return f"\n{refusal}\n"
    after = runner.view
    if after.actions and after.actions[0].unit:
        return f"\n{after.text} "
    return ""


def _number(line: str) -> float | None:
    try:
        return float(line)
    except ValueError:
        return None
