"""Modes on the page of ``palpate-host console``, reached by its buttons."""

from __future__ import annotations

import time

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
