"""A run of the whole hand in lock step with random commands, recorded as the demo records it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from random import Random

import palpate_host
from palpate_bus.logs.candump import LogRecord, write_log
from palpate_host.common.command import Grasp, Rotate
from palpate_host.common.mode import Mode
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.service.contract import recording_header
from palpate_host.service.host import load_hand
from palpate_host.service.host_records import HostRecorder
from palpate_twin.closed_loop.lockstep import LockstepLoop
from palpate_twin.closed_loop.tactile_rendering import TrueContactSource
from palpate_twin.paper.trial import make_engine

WIDE = Path(palpate_host.__file__).parent / "models" / "table4-wide.toml"
CALIBRATIONS = ("0123456789abcdef", "1123456789abcdef", "2123456789abcdef")


@dataclass(frozen=True, slots=True)
class Run:
    """A recorded run: its hand.toml, its bus log, and what its host published."""

    hand_toml: Path
    log: Path
    config: HandConfig
    hand: HandKinematics
    statuses: list[HostStatus]
    commands: int


def record_run(folder: Path, seed: int, seconds: float) -> Run:
    """Grasp, turn by random angles at random times, stop; everything follows from the seed."""
    dice = Random(seed)
    text = WIDE.read_text()
    for number, digest in enumerate(CALIBRATIONS, start=1):
        name = f'name = "finger-{number}"'
        text = text.replace(name, f'{name}\ncalibration = "{digest}"', 1)
    hand_toml = folder / "hand.toml"
    hand_toml.write_text(text)
    config, hand = load_hand(hand_toml)
    engine = make_engine(config, "mujoco", has_B=False)
    contacts = TrueContactSource(1e3 * config.control.tip_radius_m, 0.1, seed)
    records: list[LogRecord] = []
    statuses: list[HostStatus] = []
    loop = LockstepLoop(
        *(config, hand, engine, contacts),
        on_frame=lambda stamp_us, frame: records.append(LogRecord(stamp_us, frame)),
        on_tick=statuses.append,
    )
    commands, elapsed_s = 0, 0.0
    while elapsed_s < seconds:
        step_s = dice.uniform(0.05, 0.3)
        loop.run(step_s)
        elapsed_s += step_s
        if loop.status is not None and loop.status.mode in (Mode.MANIPULATE, Mode.GRASP, Mode.HOLD):
            axis = dice.randrange(3)
            rpy_deg = [0.0, 0.0, 0.0]
            rpy_deg[axis] = round(dice.uniform(-25, 25), 3)
            loop.host.command(
                Grasp() if dice.random() < 0.2 else Rotate(tuple(rpy_deg), dice.uniform(0.2, 1))
            )
            commands += 1
    loop.host.request_stop()
    loop.run(1.0)
    assert loop.is_over
    recorder = HostRecorder(config)
    notes = [note for status in statuses for note in recorder.notes(status)]
    write_log(folder / "bus.log", recording_header(config), records, notes)
    return Run(hand_toml, folder / "bus.log", config, hand, statuses, commands)
