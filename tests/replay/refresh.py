"""Renews the golden replays: the only way to do it.

    python tests/replay/refresh.py demo/run/bus.log   take the first seconds of a demo's log, then its answers
    python tests/replay/refresh.py --virtual          make new logs in virtual time, then their answers
    python tests/replay/refresh.py                    keep the logs, renew all answers after a meant change
    python tests/replay/refresh.py --frames           estimate the recorded frames anew, then the same
    python tests/replay/refresh.py --rebind           the same after an EDS changed and the recorded frames
                                                      stay valid: the logs' headers take the new contract

``demo`` is what the demo's real processes said on the bus, ``virtual`` a run of the host in virtual time,
``fd`` a short one on a CAN FD bus, the others such a run with what scenarios.py does to it. ``virtual`` and
``fd`` have the host's records too. ``*.answers`` is what the host sends, ``*.fingertip`` what finger-2 sends
(fingertip_rig.py). All are candump logs, compressed.
Look at the difference before you commit it.
"""

from __future__ import annotations

import gzip
import importlib.util
import sys
import tempfile
from pathlib import Path

import click

from palpate_bus.logs.candump import LogHeader, LogRecord, read_log, write_log
from palpate_host.service.contract import EDS_FILES, contract_header
from palpate_host.service.host import load_hand
from palpate_host.service.host_records import HostRecorder
from palpate_host.service.replay import replay_to_log, write_output

HERE = Path(__file__).parent
VIRTUAL_SECONDS = 4.0
FD_SECONDS = 1.5
LARGEST_BYTES = 300_000


def pack(source: Path, target: Path) -> None:
    """Compress without a time stamp or a name, so that equal content is an equal file."""
    with target.open("wb") as raw, gzip.GzipFile("", "wb", compresslevel=9, fileobj=raw, mtime=0) as packed:
        packed.write(source.read_bytes())


def unpack(source: Path, target: Path) -> Path:
    target.write_bytes(gzip.decompress(source.read_bytes()))
    return target


def load(name: str, path: Path):
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def load_bench():
    return load("palpate_virtual_bench", HERE.parent / "host" / "virtual_bench.py")


scenarios = load("palpate_replay_scenarios", HERE / "scenarios.py")
fingertip_rig = load("palpate_replay_fingertip_rig", HERE / "fingertip_rig.py")


def virtual_log(path: Path) -> None:
    """Start-up, turning, one finger letting go for 0.4 s, and turning again."""
    bench = load_bench()
    config, hand = bench.load_table_4()

    def feel(finger, time_us, _pose):
        lost = finger == 2 and 1_800_000 <= time_us - bench.START_US < 2_200_000
        return None if lost else (1.5 * finger, -4.0, 29.7)

    rig = bench.VirtualBench(config, hand, feel=feel)
    rig.run(VIRTUAL_SECONDS)
    recorder = HostRecorder(config)
    notes = [note for status in rig.statuses for note in recorder.notes(status)]
    write_log(path, contract_header(config), [LogRecord(stamp, frame) for stamp, frame in rig.log], notes)


def hand_of(name: str, config_path: Path | None):
    """Return configuration and hand of a log."""
    config, hand = load_hand(config_path or load_bench().TABLE_4)
    return (scenarios.on_fd_bus(config) if name == "fd" else config), hand


def fd_log(path: Path) -> None:
    """Start-up and turning on a CAN FD bus."""
    bench = load_bench()
    config, hand = bench.load_table_4()
    config = scenarios.on_fd_bus(config)
    rig = bench.VirtualBench(config, hand, feel=lambda finger, _time_us, _pose: (1.5 * finger, -4.0, 29.7))
    rig.run(FD_SECONDS)
    recorder = HostRecorder(config)
    notes = [note for status in rig.statuses for note in recorder.notes(status)]
    write_log(path, contract_header(config), [LogRecord(stamp, frame) for stamp, frame in rig.log], notes)


def scenario_logs(folder: Path) -> None:
    """Every scenario's log from one normal run."""
    bench = load_bench()
    config, hand = bench.load_table_4()
    rig = bench.VirtualBench(config, hand, feel=lambda finger, _time_us, _pose: (1.5 * finger, -4.0, 29.7))
    rig.run(scenarios.SECONDS)
    normal = [LogRecord(stamp, frame) for stamp, frame in rig.log]
    for name, change in scenarios.SCENARIOS.items():
        write_log(folder / name, contract_header(config), change(normal))
        pack(folder / name, HERE / f"{name}.log.gz")


def cut(source: Path, target: Path, seconds: float) -> None:
    log = read_log(source)
    end_us = log.records[0].stamp_us + round(seconds * 1e6)
    kept = [record for record in log.records if record.stamp_us <= end_us]
    write_log(target, log.header, kept, [note for note in log.notes if note.stamp_us <= end_us])


def rebind(name: str, config_path: Path | None) -> None:
    """Write NAME.log.gz with the present contract in its header; its frames stay."""
    config, _ = hand_of(name, config_path)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log"
        log = read_log(unpack(HERE / f"{name}.log.gz", path))
        kept = {key: value for key, value in log.header.entries.items() if key not in EDS_FILES}
        write_log(path, LogHeader({**kept, **contract_header(config).entries}), log.records, log.notes)
        pack(path, HERE / f"{name}.log.gz")


def renew_answers(name: str, config_path: Path | None) -> None:
    """NAME.answers.log.gz from NAME.log.gz."""
    config, hand = hand_of(name, config_path)
    with tempfile.TemporaryDirectory() as folder:
        log = unpack(HERE / f"{name}.log.gz", Path(folder) / "log")
        result = replay_to_log(log, config, hand)
        answers = Path(folder) / "answers"
        write_output(answers, result)
        pack(answers, HERE / f"{name}.answers.log.gz")
        if name in scenarios.SCENARIOS and name != "node-id-clash":  # there the fingertip leaves the bus
            frames = fingertip_rig.fingertip_frames(name, read_log(log).records)
            write_log(answers, LogHeader(), frames)
            pack(answers, HERE / f"{name}.fingertip.log.gz")
    modes = " ".join(mode.value for mode in result.modes)
    click.echo(f"{name}: {result.frames_in} frames in, {len(result.records)} frames out, modes: {modes}")


@click.command()
@click.argument("recorded", required=False, type=click.Path(path_type=Path, exists=True))
@click.option("--seconds", default=5.0, show_default=True, help="How much of a recorded log to keep.")
@click.option("--virtual", is_flag=True, help="Make the log in virtual time anew.")
@click.option("--frames", is_flag=True, help="Estimate the recorded frames anew (contacts.csv).")
@click.option("--rebind", "rebinds", is_flag=True, help="Put the present contract into the logs' headers.")
@click.option(
    "--config", "config_path", type=click.Path(path_type=Path), help="hand.toml; Table 4's by default."
)
def refresh(
    recorded: Path | None,
    seconds: float,
    virtual: bool,
    frames: bool,
    rebinds: bool,
    config_path: Path | None,
) -> None:
    """Write logs and answers anew."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        if recorded is not None:
            cut(recorded, log, seconds)
            pack(log, HERE / "demo.log.gz")
        if virtual:
            virtual_log(log)
            pack(log, HERE / "virtual.log.gz")
            fd_log(log)
            pack(log, HERE / "fd.log.gz")
            scenario_logs(Path(folder))
    if frames:
        fingertip_rig.write_contacts()
    for name in ("demo", "virtual", "fd", *scenarios.SCENARIOS):
        if rebinds:
            rebind(name, config_path)
        renew_answers(name, config_path)
    for path in HERE.glob("*.log.gz"):
        if path.stat().st_size > LARGEST_BYTES:
            raise click.ClickException(
                f"{path.name} has more than {LARGEST_BYTES} bytes: use fewer --seconds"
            )


if __name__ == "__main__":
    refresh()
