"""The cost of a fingertip's page in two headless Chromiums: processor time of daemon and console, frames.

The browsers run at low priority and do not count: a person's browser runs on another computer. A machine that
loses frames without them cannot show what they cost; there the test is skipped.
"""

from __future__ import annotations

import time
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
from bench.console import busy_s, running_fingertip
from bench.console import dropped_frames as dropped
from tests.browser.headless_browser import Browser, missing_tools

from palpate_edge.daemon.watching.view_tap import MOST_PICTURES_S

MOST_PERCENT = 3.0  # of a core, for both pages together
COUNT_PICTURES = """
window.shown = 0;
new MutationObserver(() => { window.shown += 1; }).observe(
  document.querySelector('#camera'), {attributes: true, attributeFilter: ['data-sequence']});
"""


@pytest.mark.quiet
def test_two_browsers_cost_three_per_cent_of_a_core_and_no_frame(tmp_path: Path, start_watch) -> None:
    missing = missing_tools()
    if missing:
        pytest.skip(f"{' and '.join(missing)} missing: make system-deps")
    seconds, rounds = 15, 2
    with ExitStack() as stack:
        config, daemon = stack.enter_context(running_fingertip(tmp_path))
        watch = start_watch(config)
        browsers = []
        for number in range(2):
            (tmp_path / f"browser-{number}").mkdir()
            browsers.append(stack.enter_context(closing(Browser(tmp_path / f"browser-{number}"))))
        used_s = {False: [0.0, 0.0], True: [0.0, 0.0]}
        lost, shown, lasted_s = {False: 0, True: 0}, [0, 0], 0.0
        for is_watched in (False, True) * rounds:
            for browser in browsers:
                browser.open(watch.url if is_watched else "about:blank")
            if is_watched:
                for browser in browsers:
                    browser.until(lambda b=browser: b.text("#link") == "live, from the daemon", "not live")
                    browser.run(COUNT_PICTURES)
            time.sleep(1.5)  # the health file is a second old at most
            before_s, before = [busy_s(process) for process in (daemon, watch.process)], dropped(tmp_path)
            counted = [browser.run("return window.shown || 0") for browser in browsers]
            begun_s = time.monotonic()
            time.sleep(seconds)
            took_s = time.monotonic() - begun_s
            for index, process in enumerate((daemon, watch.process)):
                used_s[is_watched][index] += busy_s(process) - before_s[index]
            if is_watched:
                lasted_s += took_s
                for index, browser in enumerate(browsers):
                    shown[index] += browser.run("return window.shown") - counted[index]
            time.sleep(1.5)
            lost[is_watched] += dropped(tmp_path) - before
    more_s = [watched - alone for alone, watched in zip(used_s[False], used_s[True], strict=True)]
    percent = [100 * one_s / lasted_s for one_s in more_s]
    rates = [count / lasted_s for count in shown]
    print(
        f"daemon +{percent[0]:.1f} %, console +{percent[1]:.1f} % of a core; {rates} pictures/s; lost {lost}"
    )
    if lost[False]:
        pytest.skip(f"this machine is too busy: {lost[False]} frames were lost without a browser")
    assert min(rates) > 0.8 * MOST_PICTURES_S
    assert sum(percent) <= MOST_PERCENT
    assert lost[True] == 0
