"""The guided calibration behind the page: a thread takes the newest picture and publishes the view."""

from __future__ import annotations

import threading

import msgspec

from palpate_edge.common.arrays import Image
from palpate_edge.common.errors import PalpateError
from palpate_edge.daemon.check_rows import Verdict
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.daemon.watching.view_tap import PictureRate
from palpate_edge.daemon.watching.watch_messages import WatchRefusedError
from palpate_edge.guide.guide_files import configured_files
from palpate_edge.guide.guide_runner import GuideRunner
from palpate_edge.guide.guide_view import GuideAction
from palpate_edge.web.broadcast import Broadcast

START = "start"
Offered = tuple[Image, float, int]


class GuideFeed:
    """Runs a guide once a page has started it; `offer` is for the capture thread, `answer` for any."""

    def __init__(self, config: FingertipConfig, broadcast: Broadcast) -> None:
        self._config, self._broadcast = config, broadcast
        self._rate, self._offered = PictureRate(), threading.Condition()
        self._newest: Offered | None = None
        self._stopped = threading.Event()
        self._runner: GuideRunner | None = None
        self._thread: threading.Thread | None = None

    def offer(self, image: Image, exposed_at_us: int, exposure_us: int) -> None:
        """Take a picture for the guide, at most ten a second; never waits."""
        if self._runner is not None and self._rate.takes(exposed_at_us):
            with self._offered:
                self._newest = image, exposed_at_us / 1e6, exposure_us
                self._offered.notify()

    def answer(self, action: str, number: float | None) -> str:
        """Start the guide, or take an answer; return what happened.

        Raises ConfigError, DatasetError or WatchRefusedError to refuse it.
        """
        if action == START:
            return self._start()
        if self._runner is None:
            raise WatchRefusedError("the guided calibration is not started")
        self._runner.answer(action, number)
        self._publish()
        return self._runner.view.title

    def close(self) -> None:
        """End the thread; what was done is on the disk."""
        self._stopped.set()
        if self._thread is not None:
            self._thread.join(2.0)

    def _start(self) -> str:
        if self._runner is not None:
            raise WatchRefusedError("the guided calibration runs already")
        files = configured_files(self._config)
        self._runner = GuideRunner(files)
        self._thread = threading.Thread(target=self._run, args=(self._runner,), daemon=True)
        self._thread.start()
        return f"pictures are kept in {files.folder}"

    def _run(self, runner: GuideRunner) -> None:
        while not self._stopped.is_set():
            with self._offered:
                self._offered.wait_for(lambda: self._newest is not None, 0.2)
                newest, self._newest = self._newest, None
            if newest is None:
                continue
            try:
                runner.frame(*newest)
            except PalpateError as error:  # a full disk ends the guide, not the console
                self._end(runner, str(error))
                return
            self._publish()

    def _end(self, runner: GuideRunner, reason: str) -> None:
        """Show why a file could not be written; a new start goes on from what was saved."""
        self._runner = None
        actions = [GuideAction(START, "Go on")]
        view = msgspec.structs.replace(runner.view, verdict=Verdict.FAIL, text=reason, actions=actions)
        self._broadcast.publish("guide", view)

    def _publish(self) -> None:
        if self._runner is not None:
            self._broadcast.publish("guide", self._runner.view)
