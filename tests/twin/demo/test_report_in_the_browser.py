"""The demo's report in a headless Chromium, at the widths of a phone and of a desktop."""

from __future__ import annotations

import pytest
from tests.browser.headless_browser import DESKTOP, PHONE

IS_WIDER = "return document.scrollingElement.scrollWidth > innerWidth"
OUTSIDE = """
const isBoxed = one => one.closest('div.scroll, pre');
return [...document.querySelectorAll('body *')]
  .filter(one => !isBoxed(one) && one.getBoundingClientRect().right > innerWidth)
  .map(one => one.outerHTML.slice(0, 80));
"""
UNBOXED_TABLES = (
    "return document.querySelectorAll('table').length - document.querySelectorAll('div.scroll table').length"
)
HIDDEN_CELLS = """
return [...document.querySelectorAll('div.scroll:has(table)')].filter(box => {
  box.scrollLeft = 1e6;
  const last = box.querySelector('tr').lastElementChild.getBoundingClientRect();
  box.scrollLeft = 0;
  return last.right > box.getBoundingClientRect().right + 1;
}).length;
"""
FIRST = """
const one = document.querySelector('%s').getBoundingClientRect();
return [one.top, one.bottom, one.height];
"""
HEADINGS = "return [...document.querySelectorAll('h2')].map(one => one.textContent)"


@pytest.mark.demo
@pytest.mark.parametrize("size", [PHONE, DESKTOP], ids=["phone", "desktop"])
def test_the_report_fits_the_page(browser, real_time_demo, size):
    folder, _ = real_time_demo
    browser.resize(size)
    browser.open((folder / "report.html").as_uri())
    assert browser.run("return innerWidth") == size[0]
    assert not browser.run(IS_WIDER)
    assert browser.run(OUTSIDE) == []
    assert browser.run(UNBOXED_TABLES) == 0
    assert browser.run(HIDDEN_CELLS) == 0

    verdict_top, verdict_bottom, _ = browser.run(FIRST % "p.verdict")
    film_top, film_bottom, film_height = browser.run(FIRST % 'img[src^="data:image/webp"]')
    assert 0 < verdict_top < verdict_bottom <= film_top
    assert film_height > 50
    assert film_bottom <= size[1]  # both without scrolling
    assert browser.run(HEADINGS)[-1] == "About this run"  # metadata at the end
    assert browser.console_errors() == []
