"""The recordings of the hand's page: a folder of them, the one being written, the one being played."""

from __future__ import annotations

from pathlib import Path

import msgspec

from palpate_edge.web.broadcast import Broadcast
from palpate_host.common.command import CommandError
from palpate_host.config.hand_config import HandConfig
from palpate_host.console.hand_recorder import HandRecorder
from palpate_host.console.recording_player import RecordingPlayer

MOST_LISTED = 50


class _PageCommand(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="command"):
    pass


class StartRecording(_PageCommand, frozen=True, tag="record"):
    """Record the running hand."""


class StopRecording(_PageCommand, frozen=True, tag="record_no_more"):
    """End the recording that is being written."""


class StartPlaying(_PageCommand, frozen=True, tag="play"):
    """Show a recording in place of the live hand."""

    name: str


class StopPlaying(_PageCommand, frozen=True, tag="play_no_more"):
    """Show the live hand again."""


RecordingCommand = StartRecording | StopRecording | StartPlaying | StopPlaying


class RecordingsNews(msgspec.Struct, frozen=True):
    """names: of the recordings, newest first. recording, playing: the name of one, or empty. failure: why the
    last one ended early, or empty."""

    folder: str
    names: list[str]
    recording: str
    playing: str
    failure: str


class Recordings:
    """Carries out the page's commands for recordings; publishes each change as the event ``recordings``."""

    def __init__(self, folder: Path, config: HandConfig, socket_path: Path, broadcast: Broadcast) -> None:
        self._folder, self._broadcast = folder, broadcast
        self._recorder = HandRecorder(folder, config, socket_path, self._publish)
        self._player = RecordingPlayer(config, broadcast, self._publish)
        self._publish()

    @property
    def is_playing(self) -> bool:
        """Return whether the page shows a recording."""
        return self._player.name != ""

    def run(self, command: RecordingCommand) -> str:
        """Carry out a command; return what happened. Raises PalpateError to refuse it."""
        match command:
            case StartRecording():
                return f"recording {self._folder / self._recorder.start()}"
            case StopRecording():
                return f"recorded {self._folder / self._recorder.stop()}"
            case StartPlaying(name):
                if name not in self._names() or name == self._recorder.name:
                    raise CommandError(f"{name[:40]!r} is no finished recording of {self._folder}")
                self._player.start(self._folder / name)
                return f"playing {name}"
            case StopPlaying():
                self._player.stop()
                return "the live hand is shown"

    def close(self) -> None:
        """End a recording that is being written or played."""
        self._player.close()
        self._recorder.close()

    def _names(self) -> list[str]:
        """Return the names of the newest recordings, newest first."""
        return sorted({path.parent.name for path in self._folder.glob("*/*.mcap")}, reverse=True)[
            :MOST_LISTED
        ]

    def _publish(self) -> None:
        recorder, player = self._recorder, self._player
        failure = recorder.failure or player.failure
        names = [name for name in self._names() if name != recorder.name]
        news = RecordingsNews(str(self._folder), names, recorder.name, player.name, failure)
        self._broadcast.publish("recordings", news)
