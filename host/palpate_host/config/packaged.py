"""Hands and experiments that ship with the package."""

from __future__ import annotations

from pathlib import Path

MODELS = Path(__file__).parents[1] / "models"
"""Folder of table3.toml, table4.toml, its variants -wide, -four and -az, and experiment.toml."""
