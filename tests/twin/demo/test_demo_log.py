"""The log of the demo in lock step: an export gives what the host published, and a replay repeats the run."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner
from tests.host.recorded_run import Run, check_export, replay
from tests.integrations_page import commands
from tests.tiers import seeds

from palpate_host.cli.main import cli
from palpate_host.common.status import HostStatus
from palpate_host.service.host import load_hand
from palpate_host.service.host_records import HostRecorder
from palpate_twin.demo import lockstep
from palpate_twin.demo.run_folder import make_run_folder

DURATION_S = 8.5
"""The first turn is that of hand.toml, the second one is a command."""


@pytest.mark.parametrize("seed", seeds(reduced=0, full=20))
def test_the_export_is_what_was_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    """Other sensors, skins and noise with each seed: `action` is RPDO 1 of every tick.

    The log becomes a dataset by the command of docs/integrations.md.
    """
    statuses: list[HostStatus] = []

    class KeepingRecorder(HostRecorder):
        def notes(self, status: HostStatus):
            statuses.append(status)
            return super().notes(status)

    monkeypatch.setattr(lockstep, "HostRecorder", KeepingRecorder)
    demo, export, _ = commands("Datasets of recorded runs")
    assert demo == "palpate-host demo --lockstep --output turns"
    folder = make_run_folder(tmp_path / "turns" / "run", None, 1_000_000)
    lockstep.run(folder, DURATION_S, seed, lambda _line: None, lambda _sample, _elapsed_s: None)
    config, hand = load_hand(folder.hand_toml)
    sent = len(folder.commands.read_text().splitlines())
    assert sent == 1
    run = Run(folder.hand_toml, folder.log, config, hand, statuses, sent)
    check_export(run, tmp_path / "run.csv")
    done = replay(run)
    assert done.exit_code == 0, done.output
    assert f"{len(statuses)} ticks: every frame of the host is as recorded" in done.stdout
    monkeypatch.chdir(tmp_path)
    exported = CliRunner().invoke(cli, shlex.split(export.removeprefix("palpate-host ")))
    assert exported.exit_code == 0, exported.output
    info = json.loads((tmp_path / "turns-set" / "meta" / "info.json").read_text())
    assert (info["fps"], info["total_episodes"], info["robot_type"]) == (50, 1, "palpate_hand")
    assert info["total_frames"] > 50 * DURATION_S
