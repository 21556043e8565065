"""Entry-point groups by which other packages extend palpate-host; it never imports those packages by name."""

from __future__ import annotations

COMMANDS = "palpate_host.commands"
"""Commands of palpate-host: a click command."""

SIMULATORS = "palpate_host.simulators"
"""Simulated parts that a command runs in place of the real ones."""

DRIVES = "palpate_host.drives"
"""Drives that hand.toml chooses by name: a `palpate_host.drives.registry.DriveFactory`."""
