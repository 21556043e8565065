"""The page of ``palpate-host console`` in a headless Chromium: another origin, a watcher, every button."""

from __future__ import annotations

import time

import pytest
from tests.browser.headless_browser import PHONE
from tests.browser.other_origin import assert_refused_from_another_origin
from tests.host.hand_page import RECOVER, in_mode, lead_to

pytestmark = pytest.mark.long


def answers(browser, text):
    browser.until(lambda: text in browser.text("#answer"), text)


def check_bus_and_recordings(browser):
    """Bus load, temperatures, and a recording made and played by buttons."""
    browser.until(lambda: "bus load" in browser.text("#bus") and "%" in browser.text("#bus"), "no bus load")
    browser.until(lambda: "31.5 °C" in browser.text("#fingers"), "no temperature")
    browser.click("#record")
    browser.until(lambda: browser.text("#record") == "Stop recording", "no recording", "#answer")
    time.sleep(1.5)
    browser.click("#record")
    answers(browser, "recorded ")
    browser.until(lambda: browser.run("return !document.querySelector('#play').disabled"), "not listed")
    name = browser.run("return document.querySelector('#recording').value")
    browser.click("#play")
    browser.until(lambda: browser.text("#shown").startswith(f"recording {name}, "), "not played", "#answer")
    browser.until(lambda: browser.text("#play") == "Play", "does not end")
    browser.until(lambda: browser.text("#shown") == "", "the live hand is not shown")
    browser.click("#play")
    browser.until(lambda: browser.text("#play") == "Stop playing", "not played again")
    browser.click("#play")
    browser.until(lambda: browser.text("#play") == "Play", "not stopped", "#answer")


@pytest.mark.slow
def test_a_watcher_then_every_button_and_the_loss_of_the_host(console, browser):
    assert_refused_from_another_origin(browser, console.port, console.token, "stop")
    assert console.mode_now()["mode"] != "stop"
    browser.console_errors()
    browser.open(console.url.split("#")[0])
    in_mode(browser, "ready", "fault")
    assert browser.text("#permission").startswith("Watching only.")
    browser.run("document.querySelector('#stop').disabled = false")
    browser.click("#stop")
    answers(browser, "watching only")
    in_mode(browser, "ready", "fault")

    browser.open("about:blank")
    browser.open(console.url)
    in_mode(browser, "ready", "fault")
    assert browser.run("return document.querySelector('#scene').dataset.fingers") == "3"
    assert browser.run("return document.querySelectorAll('#joints tr').length") == 9
    browser.click("#turn")
    answers(browser, "grasp first")
    browser.run("document.querySelector('#yaw').value = document.querySelector('#ramp').value = ''")
    browser.press_keys("#yaw", "5")
    browser.press_keys("#ramp", "0.5")
    lead_to(browser, "[data-command=grasp]", "grasp")
    lead_to(browser, "#turn", "manipulate", "blind")
    browser.picture_for_docs("console-hand")
    assert "0, 0, 5°" in browser.text("#state")
    lead_to(browser, "[data-command=release]", "release", "ready")
    check_bus_and_recordings(browser)
    browser.resize(PHONE)
    assert browser.run("return document.documentElement.scrollWidth") <= PHONE[0]
    browser.click("#stop")
    answers(browser, "stop: accepted")
    in_mode(browser, "stop", "fault")
    lead_to(browser, RECOVER, "ready")
    console.kill_host()
    link = "return document.querySelector('#link').dataset.state"
    browser.until(lambda: browser.run(link) == "lost", "not shown")
    console.start_host()
    browser.until(lambda: browser.text("#link") == "live, from the host", "no reconnection")
    refusals = ("401 (Unauthorized)", "409 (Conflict)")
    assert all(any(text in entry for text in refusals) for entry in browser.console_errors())
