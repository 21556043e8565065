"""The page of ``palpate-edge watch`` in a real headless Chromium: every button, a watcher, another origin."""

from __future__ import annotations

import json
import subprocess
import sys

import cv2
import pytest
from tests.browser.headless_browser import PHONE
from tests.browser.other_origin import assert_refused_from_another_origin

pytestmark = pytest.mark.long

LINK, ANSWER = "#link", "#answer"


@pytest.fixture
def watch(rig, start_watch):
    rig.until((rig.folder / "finger.watch").exists)
    return start_watch(rig.config)


def is_live(browser):
    return browser.text(LINK) == "live, from the daemon"


def answers(browser, text):
    browser.until(lambda: text in browser.text(ANSWER), text)


def sequence(browser):
    return int(browser.run("return document.querySelector('#camera').dataset.sequence || 0"))


def test_the_page(rig, watch, browser):
    """In one browser, whose start takes seconds."""
    check_a_page_of_another_origin(rig, watch, browser)
    browser.console_errors()
    check_a_watcher(rig, watch, browser)
    check_every_button(rig, watch, browser)
    check_the_loss_of_daemon_and_console(rig, watch, browser)


def check_a_page_of_another_origin(rig, watch, browser):
    assert_refused_from_another_origin(browser, watch.port, watch.token, "record")
    report = json.loads((rig.folder / "finger.health").read_bytes())
    assert not report["recording"] and not (rig.folder / "recordings").exists()


def check_a_watcher(rig, watch, browser):
    browser.open(watch.url.split("#")[0])
    browser.until(lambda: is_live(browser) and sequence(browser) > 0, "no picture")
    assert browser.text("#permission").startswith("Watching only.")
    disabled = "return [...document.querySelectorAll('button, input')].filter((one) => !one.disabled).length"
    assert browser.run(disabled) == 0
    browser.run("document.querySelector('#record').disabled = false")  # a page may be changed by its reader
    browser.click("#record")
    answers(browser, "watching only")
    assert not (rig.folder / "recordings").exists()


def check_every_button(rig, watch, browser):
    browser.open("about:blank")
    browser.open(watch.url)
    browser.until(lambda: is_live(browser) and sequence(browser) > 0, "no picture")
    assert "token" not in browser.run("return location.href")
    begin = sequence(browser)
    browser.until(lambda: sequence(browser) > begin + 6, "the picture stands still")
    rows = "return document.querySelectorAll('#health tr').length"
    browser.until(lambda: browser.run(rows) > 8, "no health")
    assert browser.run("return document.querySelectorAll('#side .skin, #top .skin').length") == 2
    browser.picture_for_docs("console")

    browser.click("#record")
    answers(browser, "recording under")
    browser.until(lambda: browser.text("#record") == "Stop recording", "no recording")
    browser.click("#record")
    answers(browser, "recording ends")
    browser.until(lambda: browser.text("#record") == "Record", "recording goes on")
    assert list((rig.folder / "recordings").glob("2*/frames.csv"))
    browser.click("[data-command=snapshot]")
    answers(browser, "snapshot ")
    assert cv2.imread(browser.text(ANSWER).removeprefix("snapshot ")).shape == (240, 320, 3)
    browser.click("[data-command=tare]")
    answers(browser, "tare: the next frames")
    browser.click("[data-command=identify]")
    answers(browser, "no LED ring")
    browser.press_keys("#level", "\ue012")  # arrow left
    answers(browser, "no LED ring: set illumination.i2c_bus")

    browser.resize(PHONE)
    assert browser.run("return document.documentElement.scrollWidth") <= PHONE[0]
    browser.click("[data-command=tare]")
    answers(browser, "tare: the next frames")
    assert all(
        "409 (Conflict)" in entry or "401" in entry for entry in browser.console_errors()
    )  # the LEDs' refusals


def check_the_loss_of_daemon_and_console(rig, watch, browser):
    rig.process.kill()
    rig.process.wait()
    browser.until(lambda: not is_live(browser), "the end of the daemon is not shown")
    command = [sys.executable, "-m", "palpate_edge.cli.main", "run", "--config", str(rig.config)]
    again = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        browser.until(lambda: is_live(browser), "the page does not reconnect")
        watch.process.kill()
        watch.process.wait()
        browser.until(lambda: "no answer from palpate-edge watch" in browser.text(LINK), "not shown")
    finally:
        again.terminate()
        again.wait()
