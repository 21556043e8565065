"""The guided calibration on the page, in a real headless Chromium: from its start to the calibration file."""

from __future__ import annotations

import threading
import time
from contextlib import closing

import pytest
from tests.browser.headless_browser import PHONE, Browser, missing_tools
from tests.edge.guide.conftest import Bench

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.capture.frame_ring import RingFormat, RingWriter
from palpate_edge.datasets.weights_table import read_weight_rows

FPS = 15.0


class TableCamera:
    """A camera whose pictures go to a ring in shared memory; `shown` is what is before it."""

    def __init__(self, path, images):
        self.shown = images
        height, width = images[0].shape[:2]
        self._writer = RingWriter(path, RingFormat(width, height, 3))
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        number = 0
        while not self._stopped.wait(1 / FPS):
            image = self.shown[number % len(self.shown)].copy()
            image[0, 0] = number % 256  # a camera whose pictures are all alike is frozen
            number += 1
            self._writer.write(image, number, time.monotonic_ns() // 1000)

    def close(self):
        self._stopped.set()
        self._thread.join()
        self._writer.close()


@pytest.fixture
def browser(tmp_path):
    missing = missing_tools()
    if missing:
        pytest.skip(f"{' and '.join(missing)} missing: make system-deps")
    with closing(Browser(tmp_path)) as browser:
        yield browser


@pytest.fixture
def table(tmp_path):
    bench = Bench()
    bench.files(tmp_path / "presses")
    with closing(TableCamera(tmp_path / "ring", bench.untouched)) as camera:
        config = tmp_path / "finger.toml"
        config.write_text(
            f'name = "table"\nhealth = "{tmp_path / "table.health"}"\n'
            f'[capture]\nsource = "shared_memory"\npath = "{tmp_path / "ring"}"\n'
            '[estimator]\nsensor = "presses/sensor.toml"\ncalibration = "table.cal"\ncalibration_required = false\n'
            f'[node]\nid = 16\n[bus]\ninterface = "palpate"\nchannel = "{tmp_path / "no-hub.sock"}"\n'
        )
        yield bench, camera, config


def button(action):
    return f"#guide-actions button[data-action={action}]"


@pytest.mark.slow
def test_every_button_from_the_start_to_the_file(table, start_watch, browser, tmp_path):
    bench, camera, config = table
    watch = start_watch(config)
    browser.open(watch.url)

    def step(number):
        browser.until(
            lambda: browser.run("return document.querySelector('#guide').dataset.step") == str(number),
            f"step {number}", "#guide-step", "#guide-verdict", "#answer",
        )  # fmt: skip

    def verdict(*texts):
        browser.until(
            lambda: any(text in browser.text("#guide-verdict") for text in texts),
            " or ".join(texts), "#guide-step", "#guide-verdict", "#answer",
        )  # fmt: skip

    browser.until(lambda: browser.text("#link").startswith("live"), "not live")
    browser.click(button("start"))
    step(1)
    verdict("ok", "warn")
    browser.click(button("next"))
    step(2)
    browser.click(button("next"))
    step(3)
    verdict("every bead of the layout is recognised")
    browser.click(button("next"))
    step(4)
    browser.click(button("next"))
    browser.until(lambda: "of 20 pictures" in browser.text("#answer"), "not refused", "#answer")
    verdict("20 pictures of the untouched dome")
    browser.click(button("next"))
    step(5)
    verdict("measuring for 30 s")
    browser.click(button("next"))
    step(6)
    browser.click(button("take"))
    browser.until(lambda: "no contact: press harder" in browser.text("#answer"), "not refused", "#answer")
    for number in range(3):
        image, mass_g = bench.presses[number]
        camera.shown = [image]
        browser.until(
            lambda: "a contact" in browser.text("#guide-figures"), "no contact", "#guide-figures"
        )
        browser.click(button("take"))
        verdict("how many grams")
        browser.press_keys("#guide-actions input", f"{mass_g:g}")
        if number == 2:
            browser.resize(PHONE)
            assert browser.run("return document.documentElement.scrollWidth") <= PHONE[0]
        browser.click(button("mass"))
        camera.shown = bench.untouched
        browser.until(
            lambda: "no contact" in browser.text("#guide-figures"), "contact stays", "#guide-figures"
        )
    browser.click(button("undo"))
    weights = tmp_path / "presses" / "weights.csv"
    browser.until(lambda: len(read_weight_rows(weights)) == 2, "not deleted")
    browser.click(button("next"))
    step(8)
    calibration = load_calibration(tmp_path / "table.cal")
    assert calibration.source.weighed == 2
    assert "0 placed, 2 weighed" in browser.text("#guide-figures")
    browser.click(button("restart"))
    step(1)
    assert all("409 (Conflict)" in entry for entry in browser.console_errors())  # the two refusals


def test_beside_a_daemon_the_guide_is_refused(rig, start_watch):
    rig.until((rig.folder / "finger.watch").exists)
    status, text = start_watch(rig.config).command("guide", action="start")
    assert status == 409
    assert text.startswith("the daemon of finger has the camera: end it")
