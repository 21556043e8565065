"""The default paths of the programs that tests start lie in a folder of the test process."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate_bus.hub.default_socket import default_socket
from palpate_edge.daemon.health import health_path
from palpate_host.console.serve import token_path
from palpate_host.operator.server import default_control_socket

PATHS = {
    "hub": default_socket,
    "control socket": default_control_socket,
    "health": lambda: health_path("finger-1", ""),
    "token": token_path,
}


@pytest.mark.parametrize("name", PATHS)
def test_a_default_path_is_no_path_of_the_machine(
    name: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The health report of a fingertip on the machine was evaluated in place of the test's own fingertip."""
    at_start = dict(
        entry.split("=", 1) for entry in Path("/proc/self/environ").read_text().split("\0") if entry
    )
    path = PATHS[name]()
    assert path.is_relative_to(tmp_path_factory.getbasetemp())
    assert str(path.parent) != at_start.get("XDG_RUNTIME_DIR")
