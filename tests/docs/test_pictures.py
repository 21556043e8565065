"""Pictures of the documents: the README's film is small, and each page of the consoles has its two widths."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
MOST_BYTES = 3_000_000
DESKTOP_PX, PHONE_PX = 1300, 390  # at least, at most


def test_the_film_of_the_readme_moves_and_is_at_most_3_mb() -> None:
    assert "(docs/demo.webp)" in (ROOT / "README.md").read_text()
    film = (DOCS / "demo.webp").read_bytes()
    assert film[:4] == b"RIFF" and film[8:12] == b"WEBP"
    assert film.count(b"ANMF") > 10  # a frame each
    assert len(film) <= MOST_BYTES


@pytest.mark.parametrize("page", ["console", "console-guide", "console-hand", "console-rig"])
def test_a_page_of_the_consoles_is_shown_at_the_width_of_a_desktop_and_of_a_phone(page: str) -> None:
    shown = "".join((DOCS / name).read_text() for name in ("console.md", "press-rig.md"))
    assert f"({page}.jpg)" in shown
    assert f"({page}-phone.jpg)" in shown
    desktop, phone = (cv2.imread(str(DOCS / f"{page}{suffix}.jpg")) for suffix in ("", "-phone"))
    assert desktop is not None and desktop.shape[1] >= DESKTOP_PX
    assert phone is not None and phone.shape[1] <= PHONE_PX
