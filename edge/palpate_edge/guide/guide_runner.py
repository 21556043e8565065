"""Carries out what a guide asks for, and lets two threads use it: one with pictures, one with answers."""

from __future__ import annotations

import threading

from palpate_edge.common.arrays import Image
from palpate_edge.common.errors import PalpateError
from palpate_edge.guide.calibration_guide import FitCalibration, SavePress, SaveReference, Work
from palpate_edge.guide.guide_files import GuideFiles
from palpate_edge.guide.guide_view import GuideView


class GuideRunner:
    """A guide with its files. `frame` is for one thread, all else for any."""

    def __init__(self, files: GuideFiles) -> None:
        """Raises DatasetError."""
        self.files = files
        self._guide = files.open_guide()
        self._lock = threading.Lock()

    def frame(self, image: Image, now_s: float, exposure_us: int = 0) -> None:
        """Take a picture, and do what the guide asks for; a fit takes some seconds.

        Raises DatasetError when the disk refuses.
        """
        with self._lock:
            self._guide.frame(image, now_s, exposure_us)
            work = self._guide.take_work()
        for one in work:
            self._do(one)

    def answer(self, name: str, number: float | None = None) -> None:
        """Take an answer. Raises ConfigError when it is not possible now."""
        with self._lock:
            self._guide.answer(name, number)

    @property
    def view(self) -> GuideView:
        """The view at this moment."""
        with self._lock:
            return self._guide.view()

    @property
    def is_finished(self) -> bool:
        """Return whether the calibration is written."""
        with self._lock:
            return self._guide.calibration is not None

    def _do(self, work: Work) -> None:
        match work:
            case SaveReference():
                self.files.save_reference(work)
            case SavePress():
                self.files.save_press(work)
            case FitCalibration():
                try:
                    calibration = self.files.fit(work, self._progress)
                except PalpateError as error:
                    with self._lock:
                        self._guide.refused(str(error))
                else:
                    with self._lock:
                        self._guide.fitted(calibration)

    def _progress(self, done: int, total: int) -> None:
        with self._lock:
            self._guide.progress(done, total)
