"""The guide behind the page, when the disk refuses a press."""

from __future__ import annotations

import json
import time
from contextlib import closing

import cv2
import pytest
from tests.edge.guide.conftest import Bench

from palpate_edge.console.guide_feed import GuideFeed
from palpate_edge.daemon.config import read_config
from palpate_edge.daemon.watching.watch_messages import WatchRefusedError
from palpate_edge.web.broadcast import Broadcast

PATIENCE_S = 60.0


@pytest.mark.slow
def test_a_press_that_cannot_be_saved_ends_the_guide_and_a_new_start_goes_on(tmp_path):
    bench, broadcast = Bench(), Broadcast()
    with bench.camera(tmp_path) as (_, config):
        folder = tmp_path / "presses"
        (folder / "reference").mkdir()
        for number in range(5):
            cv2.imwrite(str(folder / "reference" / f"{number}.png"), bench.at_rest(number))
        image, mass_g = bench.presses[0]
        now_us = 0
        with closing(GuideFeed(read_config(config), broadcast)) as feed, broadcast.listen() as listener:

            def until(text, picture):
                nonlocal now_us
                end_s = time.monotonic() + PATIENCE_S
                while time.monotonic() < end_s:
                    now_us += 150_000
                    shown = picture.copy()
                    shown[0, 0] = now_us // 1000 % 256
                    feed.offer(shown, now_us, 0)
                    for _, data in listener.next(0.05):
                        if text in data.decode():
                            return json.loads(data)
                raise AssertionError(text)

            with pytest.raises(WatchRefusedError, match="is not started"):
                feed.answer("next", None)
            feed.answer("start", None)
            with pytest.raises(WatchRefusedError, match="runs already"):
                feed.answer("start", None)
            until("a contact", image)
            feed.answer("take", None)
            (folder / "frames").write_text("a file where a folder has to be")
            feed.answer("mass", mass_g)
            view = until("cannot be made", image)
            assert view["verdict"] == "fail"
            assert [action["name"] for action in view["actions"]] == ["start"]
            (folder / "frames").unlink()
            feed.answer("start", None)
            until("a contact", image)
