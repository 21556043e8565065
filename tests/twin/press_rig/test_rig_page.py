"""The page of ``palpate-edge press-rig --port`` in a real headless Chromium, beside a simulated rig."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from tests.browser.headless_browser import PHONE, Browser
from tests.twin.press_rig.conftest import ServedRig

from palpate_edge.press_rig.journal import read_journal

pytestmark = pytest.mark.slow

PATIENCE_S = 60.0


def start(folder) -> tuple[subprocess.Popen[str], str]:
    """The run as a process, and the address to command it."""
    words = [
        "press-rig",
        "--config",
        "finger.toml",
        "--rig",
        "rig.toml",
        "-o",
        "presses",
        "--yes",
        "--port",
        "0",
    ]
    run = subprocess.Popen(
        [sys.executable, "-m", "palpate_edge.cli.main", *words, "--presses", "200"],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1", "XDG_RUNTIME_DIR": str(folder)},
    )
    assert run.stderr is not None
    lines = [run.stderr.readline() for _ in range(2)]
    assert lines[1].startswith("to watch:"), lines
    return run, lines[0].removeprefix("to command:").strip()


def shown(browser: Browser, selector: str, name: str) -> int:
    return int(browser.run(f"return document.querySelector('{selector}').dataset.{name} || 0"))


def test_the_run_is_watched_and_stopped_in_the_browser(served_rig: ServedRig, browser: Browser) -> None:
    run, address = start(served_rig.folder)
    try:
        browser.open(address.split("#")[0])
        browser.until(lambda: shown(browser, "#top", "presses") >= 3, "no press", "#text", "#figures")
        assert browser.text("#permission").startswith("Watching only.")
        browser.run("document.querySelector('#stop').disabled = false")
        browser.click("#stop")
        browser.until(lambda: "watching only" in browser.text("#answer"), "not refused")
        assert run.poll() is None
        before = shown(browser, "#camera", "sequence")
        browser.until(lambda: shown(browser, "#camera", "sequence") > before + 3, "no live picture")
        markers = served_rig.rig.view.twin.sensor.markers
        beads = sum(ring.count for ring in markers.rings)
        assert shown(browser, "#camera", "beads") == pytest.approx(beads, abs=0.15 * beads)
        assert browser.text("#text").startswith("dome found")
        assert " of " in browser.text("#figures") and "N" in browser.text("#figures")
        browser.resize(PHONE)
        assert browser.run("return document.documentElement.scrollWidth") <= PHONE[0]

        browser.open("about:blank")
        browser.open(address)
        browser.until(lambda: browser.text("#link") == "live, from the run", "not live")
        browser.until(lambda: shown(browser, "#camera", "sequence") > 0, "no picture")
        browser.picture_for_docs("console-rig")
        browser.click("#stop")
        _, errors = run.communicate(timeout=PATIENCE_S)
        assert run.returncode == 8 and "the ball was lifted off" in errors
        assert served_rig.rig.dome.press is None
        link = "return document.querySelector('#link').dataset.state"
        browser.until(lambda: browser.run(link) == "lost", "the end is not shown")
        journal = read_journal(served_rig.folder / "presses")
        assert journal is not None and len(journal.records) >= 3
    finally:
        run.kill()
        run.communicate()
