"""Commands of a page, and the picture that a snapshot keeps: the parts that both feeds share."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Protocol

import msgspec

from palpate_edge.common.arrays import Image
from palpate_edge.common.config_file import json_fault
from palpate_edge.common.errors import DatasetError, reason_of
from palpate_edge.common.picture_file import write_picture
from palpate_edge.daemon.watching.watch_messages import Level, WatchCommand, WatchRefusedError

OLDEST_S = 2.0
"""A snapshot of a picture older than this would show the past."""


class PageCommand(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A command of a page. level: of the LEDs, for ``light``; action, number: an answer to the guided
    calibration, for ``guide``."""

    command: str
    level: Level = 0
    action: str = ""
    number: float | None = None


class Feed(Protocol):
    """Something that publishes a fingertip's events and carries out commands."""

    def execute(self, command: WatchCommand, level: int) -> str:
        """Carry out a command; return what happened. Raises PalpateError to refuse it."""
        ...

    def guide(self, action: str, number: float | None) -> str:
        """Start the guided calibration or answer it; return what happened.

        Raises PalpateError to refuse it.
        """
        ...

    def close(self) -> None:
        """Stop; release what was opened."""
        ...


class NewestPicture:
    """The picture shown last, which a snapshot keeps."""

    def __init__(self) -> None:
        self._image: Image | None = None
        self._sequence = 0
        self._at_s = 0.0

    def show(self, image: Image, sequence: int) -> None:
        """Take note of a picture that is shown now."""
        self._image, self._sequence, self._at_s = image, sequence, time.monotonic()

    def save(self, folder: Path) -> Path:
        """Write the picture to `folder`, without what is drawn over it; return its path.

        Raises WatchRefusedError without a recent picture, DatasetError when it cannot be written.
        """
        image, sequence = self._image, self._sequence
        if image is None or time.monotonic() - self._at_s > OLDEST_S:
            raise WatchRefusedError("no picture is shown now: see camera under health")
        path = folder / f"{time.strftime('%Y%m%d-%H%M%S')}-{sequence:06d}.png"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DatasetError(
                f"{folder} cannot be made: {reason_of(error)}; set record.folder to one of this user"
            ) from None
        write_picture(path, image, DatasetError)
        return path


class PageCommands:
    """Decodes a page's commands; snapshots are taken here, all else by the feed."""

    def __init__(self, feed: Feed, picture: NewestPicture, snapshots: Path) -> None:
        self._feed, self._picture, self._snapshots = feed, picture, snapshots

    def run(self, body: bytes) -> str:
        """Carry out a command, a JSON object. Raises PalpateError to refuse it."""
        try:
            request = _commands.decode(body)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            raise WatchRefusedError(f"not a command ({json_fault(body, PageCommand)})") from None
        if request.command == "snapshot":
            return f"snapshot {self._picture.save(self._snapshots)}"
        if request.command == "guide":
            return self._feed.guide(request.action, request.number)
        for command in FEED_COMMANDS:
            if command == request.command:
                return self._feed.execute(command, request.level)
        raise WatchRefusedError(f"unknown command; known: snapshot, {', '.join(FEED_COMMANDS)}, guide")


FEED_COMMANDS: tuple[WatchCommand, ...] = ("record", "record_no_more", "tare", "light", "identify")
_commands = msgspec.json.Decoder(PageCommand)
