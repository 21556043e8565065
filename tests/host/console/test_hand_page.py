"""The page of ``palpate-host console`` in a real headless Chromium: a watcher, then every button."""

from __future__ import annotations

import time

import pytest
from tests.browser.headless_browser import PHONE

pytestmark = pytest.mark.long

RECOVER = "[data-command=recover]"


def in_mode(browser, *modes):
    browser.until(lambda: browser.text("#mode") in modes, f"{modes}", "header", "#mode")


def lead_to(browser, button, *modes):
    """Press buttons until the hand is in one of the modes; a busy machine may stop it meanwhile."""
    next_button = {"ready": "[data-command=grasp]", **dict.fromkeys(("fault", "stop"), RECOVER)}

    def is_there():
        mode = browser.text("#mode")
        if mode not in modes and mode not in ("init", "check", "home"):
            browser.click(next_button.get(mode, button))
            time.sleep(0.3)
        return mode in modes

    browser.until(is_there, f"{modes}", "header", "#mode", "#answer")


def answers(browser, text):
    browser.until(lambda: text in browser.text("#answer"), text)


def test_a_watcher_then_every_button_and_the_loss_of_the_host(console, browser):
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
    assert "0, 0, 5°" in browser.text("#state")
    lead_to(browser, "[data-command=release]", "release", "ready")
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
