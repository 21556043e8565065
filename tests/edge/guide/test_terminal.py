"""The guide at a terminal: a person who types, reads, and ends in the middle."""

from __future__ import annotations

import pytest
from tests.edge.guide.conftest import PlayedSource

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.common.errors import CaptureError
from palpate_edge.guide.guide_runner import GuideRunner
from palpate_edge.guide.terminal import QUIT, run_in_terminal


class Typist:
    """Answers what the guide shows: goes on when a step is done, presses and types grams, then calibrates."""

    def __init__(self, bench, runner, presses):
        self.bench, self.runner, self.left = bench, runner, list(range(presses))
        self.typed, self.text, self.seen = [], "", 0

    def picture(self, sequence):
        self.seen += 1
        is_pressing = self.runner.view.title == "Presses on the scale" and self.left
        image = self.bench.presses[self.left[0]][0] if is_pressing else self.bench.at_rest(sequence)
        image = image.copy()
        image[0, 0] = sequence % 256  # a camera whose pictures are all alike is frozen
        return image

    def line(self):
        """Type only after some pictures of the step."""
        view, line = self.runner.view, None
        if self.seen % 8:
            return None
        match view.title:
            case "Presses on the scale" if view.actions[0].unit:
                line = f"{self.bench.presses[self.left.pop(0)][1]:g}"
            case "Presses on the scale":
                line = "" if self.left else "next"
            case "Untouched dome" if view.done < view.total:
                pass
            case _:
                line = ""
        self.typed.append(line)
        return line

    def write(self, text):
        self.text += text


def run(bench, runner, typist, lines=None):
    source = PlayedSource(typist.picture, fps=3.0)
    return run_in_terminal(
        runner, source, lines or typist.line, typist.write, lambda: False, is_live=False
    )  # fmt: skip


@pytest.mark.slow
def test_a_person_types_their_way_to_the_file(bench, tmp_path):
    runner = GuideRunner(bench.files(tmp_path / "presses"))
    typist = Typist(bench, runner, presses=4)
    assert run(bench, runner, typist)
    assert load_calibration(runner.files.calibration).source.weighed == 4
    for heading in ("1/8 Camera and focus", "4/8 Untouched dome", "6/8 Presses on the scale", "8/8 Result"):
        assert heading in typist.text
    assert "how many grams does the scale show?" in typist.text
    assert "Enter: Take the picture; next: Calibrate" in typist.text


def test_quit_keeps_everything_and_nonsense_is_answered(bench, tmp_path):
    runner = GuideRunner(bench.files(tmp_path / "presses"))
    typist = Typist(bench, runner, presses=0)
    lines = iter(["dance", "250", None, QUIT])
    assert not run(bench, runner, typist, lambda: next(lines))
    assert "dance is not possible now; possible answers: next" in typist.text
    assert "a number is not possible now" in typist.text


def test_the_end_of_the_recording_is_an_error(bench, tmp_path):
    runner = GuideRunner(bench.files(tmp_path / "presses"))

    class Ended(PlayedSource):
        def read(self):
            return None

    with pytest.raises(CaptureError, match="the recording has ended"):
        run_in_terminal(
            runner, Ended(lambda _: None), lambda: None, lambda _: None, lambda: False, is_live=False
        )
