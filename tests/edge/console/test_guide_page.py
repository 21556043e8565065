"""The guided calibration on the page, in a real headless Chromium: from its start to the calibration file."""

from __future__ import annotations

import pytest
from tests.browser.headless_browser import PHONE
from tests.edge.guide.conftest import Bench

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.datasets.weights_table import read_weight_rows


@pytest.fixture
def table(tmp_path):
    bench = Bench()
    with bench.camera(tmp_path) as (camera, config):
        yield bench, camera, config


class GuidedPage:
    """The section of the page with the guide."""

    def __init__(self, browser):
        self._browser = browser

    def click(self, action):
        self._browser.click(f"#guide-actions button[data-action={action}]")

    def step(self, number):
        shown = "return document.querySelector('#guide').dataset.step"
        self._until(lambda: self._browser.run(shown) == str(number), f"step {number}")

    def shows(self, text, selector="#guide-verdict"):
        self._until(lambda: text in self._browser.text(selector), text)

    def enter(self, mass_g):
        self._browser.press_keys("#guide-actions input", f"{mass_g:g}")
        self.click("mass")

    def _until(self, condition, what):
        self._browser.until(condition, what, "#guide-step", "#guide-verdict", "#guide-figures", "#answer")


@pytest.mark.slow
def test_every_button_from_the_start_to_the_file(table, start_watch, browser, tmp_path):
    bench, camera, config = table
    browser.open(start_watch(config).url)
    page = GuidedPage(browser)
    browser.until(lambda: browser.text("#link").startswith("live"), "not live")
    walk_to_the_presses(page)
    press_three_times(page, bench, camera, browser)
    page.click("undo")
    weights = tmp_path / "presses" / "weights.csv"
    browser.until(lambda: len(read_weight_rows(weights)) == 2, "not deleted")
    page.click("next")
    page.step(8)
    assert load_calibration(tmp_path / "table.cal").source.weighed == 2
    page.shows("0 placed, 2 weighed", "#guide-figures")
    page.click("restart")
    page.step(1)
    assert all("409 (Conflict)" in entry for entry in browser.console_errors())  # the two refusals


def walk_to_the_presses(page):
    page.click("start")
    page.step(1)
    page.shows("sharp")
    page.click("next")
    page.step(2)
    page.shows("the light is right")
    page.click("next")
    page.step(3)
    page.shows("every bead of the layout is recognised")
    page.click("next")
    page.step(4)
    page.click("next")
    page.shows("of 20 pictures", "#answer")  # refused
    page.shows("20 pictures of the untouched dome")
    page.click("next")
    page.step(5)
    page.shows("measuring for 30 s")
    page.click("next")
    page.step(6)
    page.shows("no contact", "#guide-figures")
    page.click("take")
    page.shows("no contact: press harder", "#answer")  # refused


def press_three_times(page, bench, camera, browser):
    for image, mass_g in bench.presses[:3]:
        camera.shown = [image]
        page.shows("a contact", "#guide-figures")
        page.click("take")
        page.shows("how many grams")
        if mass_g == bench.presses[0][1]:
            browser.picture_for_docs("console-guide")
        page.enter(mass_g)
        camera.shown = bench.untouched
        page.shows("no contact", "#guide-figures")
    browser.resize(PHONE)
    assert browser.run("return document.documentElement.scrollWidth") <= PHONE[0]


def test_beside_a_daemon_the_guide_is_refused(rig, start_watch):
    rig.until((rig.folder / "finger.watch").exists)
    status, text = start_watch(rig.config).command("guide", action="start")
    assert status == 409
    assert text.startswith("the daemon of finger has the camera: end it")
