"""The fixture `browser` of the pages' tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from tests.browser.headless_browser import Browser, missing_tools


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    """A headless Chromium of this test."""
    missing = missing_tools()
    if missing:
        pytest.skip(f"{' and '.join(missing)} missing: make system-deps")
    with closing(Browser(tmp_path)) as browser:
        yield browser
