"""Card of a fingertip that site.yml provisioned in namespaces, at full speed: a disk for another machine."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

from deploy_rig.namespace_board import namespace_board
from deploy_rig.playbooks import Playbooks


def provisioned_card(
    folder: Path,
    bare_board: Path,
    wheels: Path,
    camera: tuple[Path, Path],
    hardware: Mapping[str, str],
    set_up: str,
) -> Path:
    """Return `folder`/disk, an ext4 file system.

    camera: presses that are played as frames, and their calibration. hardware: path -> content of files that
    stand for hardware. set_up: a shell command that is run on the board at the end.
    """
    presses, calibration = camera
    with namespace_board(folder / "card", bare_board / "tree") as card:
        shutil.copytree(presses, card.outside / "presses")
        card.run("cp", "-r", "/run/outside/presses", "/srv/presses")
        variables = {
            **card.ssh,
            "release_wheelhouse": str(wheels),
            "release_patience_s": 1,
            "fingertip_calibration": str(calibration),
            "fingertip_capture": {
                "source": "recorded",
                "path": "/srv/presses",
                "loop": True,
                "timeout_ms": 10_000,
            },
        }
        played = Playbooks(folder, bare_board / "key", {"fingertips": {"finger-1": variables}}).play("site")
        # All but its service, which has no CAN socket there.
        assert played.tells("there is no previous release to roll back to"), played.said
        print(f"provisioned: {played.changed} changed")
        for name, text in hardware.items():
            (card.outside / "file").write_text(text)
            card.run("install", "-D", "-m", "644", "/run/outside/file", name)
        card.run("sh", "-c", set_up)
        card.power_cut()
        card.as_disk(folder / "disk")
    return folder / "disk"
