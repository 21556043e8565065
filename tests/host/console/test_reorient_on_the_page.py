"""A turn by finger gaiting from the page of a hand: the command, its progress, and why it was refused."""

from __future__ import annotations

import threading
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from tests.browser.headless_browser import PHONE
from tests.host.console_process import ConsoleProcess

from palpate_host.common.command import CommandError, Reorient, Stop
from palpate_host.common.rotation import from_rpy_deg
from palpate_host.common.status import HoldStatus, matrix
from palpate_host.operator.server import OperatorSocket
from palpate_host.service.host_core import HostCore

pytestmark = pytest.mark.slow

HELD = HoldStatus((None,) * 3, (0.5,) * 3, (None,) * 3, (0,) * 3, 3.0, False)
CUBE = [(x, y, z) for x in (-20.0, 20.0) for y in (-20.0, 20.0) for z in (60.0, 100.0)]
REFUSED = "reorient is refused: it needs four fingers or more"


class GaitingHost:
    """The control socket of a host whose status the test sets. commands: those that it has got."""

    def __init__(self, path, status):
        self._still, self.status, self.commands, self.refusal = status, status, [], ""
        self._socket, self._ends = OperatorSocket(path), threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def show(self, turned_deg, **hold):
        R_c = matrix(from_rpy_deg(0.0, 0.0, turned_deg))
        self.status = replace(self._still, R_c=R_c, hold=replace(HELD, **hold))

    def close(self):
        self._ends.set()
        self._thread.join()
        self._socket.close()

    def _serve(self):
        while not self._ends.wait(0.01):
            self._socket.serve(self._execute, self.status)

    def _execute(self, command):
        if self.refusal and not isinstance(command, Stop):
            raise CommandError(self.refusal)
        self.commands.append(command)


@pytest.fixture
def host(tmp_path, table_4):
    status = HostCore(*table_4).process(1_700_000_000_000_000, ()).status
    with closing(GaitingHost(tmp_path / "s", replace(status, R_c=matrix(np.eye(3)), hold=HELD))) as host:
        yield host


@pytest.fixture
def console(tmp_path, bench, host):
    config = tmp_path / "hand.toml"
    config.write_text(bench.TABLE_4.read_text().replace("[bus]", f'[bus]\nchannel = "{tmp_path / "hub"}"', 1))
    with closing(ConsoleProcess(config, tmp_path / "s", tmp_path / "recordings")) as console:
        yield console


def shows(browser, selector, text):
    browser.until(lambda: browser.text(selector) == text, text, selector)


def test_a_turn_by_finger_gaiting(console, host, browser):
    browser.open(console.url.split("#")[0])
    browser.until(lambda: browser.text("#permission").startswith("Watching only."), "may command")
    assert browser.run("return document.querySelector('#reorient').disabled")
    browser.open("about:blank")
    browser.open(console.url)
    browser.click("details:has(#corners) summary")
    browser.run("document.querySelector('#yaw').value = ''")
    browser.press_keys("#yaw", "90")
    browser.click("#reorient")
    browser.until(
        lambda: "refused" in browser.run("return document.querySelector('#answer').className"), "taken"
    )
    assert host.commands == []  # an object without corners is none

    host.refusal = REFUSED
    lines = "\n".join(f"{x} {y}, {z}  # mm" for x, y, z in CUBE)
    browser.run(f"document.querySelector('#corners').value = {lines!r}")
    browser.click("#reorient")
    shows(browser, "#answer", REFUSED)
    host.refusal = ""
    browser.click("#reorient")
    shows(browser, "#answer", "reorient: accepted")
    assert host.commands == [Reorient((0.0, 0.0, 90.0), tuple(CUBE))]

    host.show(5.0, gait="planning")
    shows(browser, "#gait", "reorient: planning")
    host.show(35.0, gait="carry", lifted=1)
    shows(browser, "#gait", "reorient: carry, finger-2 is lifted, 30° turned")
    browser.resize(PHONE)
    assert browser.run("return document.documentElement.scrollWidth") <= PHONE[0]
    host.show(95.0, gait="done")
    shows(browser, "#gait", "reorient: done, 90° turned")
    host.show(95.0, gait="refused", gait_reason="no place in reach for finger-2")
    shows(browser, "#gait", "reorient: refused, no place in reach for finger-2")
    assert browser.run("return document.querySelector('#gait').className") == "refused"
    host.show(95.0)
    shows(browser, "#gait", "")
