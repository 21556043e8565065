"""The files of a fingertip's pages, and the token that permits their commands."""

from __future__ import annotations

from pathlib import Path

from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.daemon.health import health_path
from palpate_edge.web.token_file import read_or_make_token

PAGE = Path(__file__).parent / "page"


def page_token(config: FingertipConfig) -> str:
    """Return the token of the fingertip, from the file beside its health. Raises ConfigError."""
    health = health_path(config.name, config.health)
    return read_or_make_token(health.with_name(f"{health.stem}.token"))
