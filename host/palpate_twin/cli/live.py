"""Commands ``palpate-host simulate fingertips`` and ``live``: a hand in real time, and its sensors."""

from __future__ import annotations

from contextlib import ExitStack, closing
from pathlib import Path

import click

from palpate_edge.common.atomic_write import make_folder
from palpate_edge.common.errors import ConfigError
from palpate_twin.cli.options import FILE, FOLDER, config_option, hand_file, hand_option

seed_option = click.option(
    "--seed", type=click.IntRange(0), default=1, show_default=True, help="Random seed of the sensors."
)


@click.command()
@hand_option
@seed_option
@click.option(
    "-o",
    "--output",
    type=FOLDER,
    required=True,
    help="Folder for a dataset and a calibration per finger; existing ones are kept.",
)
def fingertips(hand_name: str, seed: int, output: Path) -> None:
    """Create a random sensor for each finger of a hand, press it 60 times, and calibrate it.

    \b
    Example:
      palpate-host simulate fingertips -o sensors
    """
    from palpate_host.config import hand_reader  # noqa: PLC0415 (as below: keeps --help fast)
    from palpate_twin.closed_loop.fingertip_sensors import fingertip_sensors  # noqa: PLC0415
    from palpate_twin.dome.library import load_library  # noqa: PLC0415

    config = hand_reader.load(hand_file(hand_name))
    make_folder(output, ConfigError)
    names = [finger.name for finger in config.fingers]
    radius_mm = 1e3 * config.control.tip_radius_m
    fingertip_sensors(output, names, radius_mm, seed, load_library(), lambda line: click.echo(line, err=True))


@click.command()
@config_option("hand.toml with [twin], bus, drives and fingertips.")
@click.option(
    "--sensors",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    required=True,
    help="Folder written by `simulate fingertips`.",
)
@click.option(
    "--ring",
    "rings",
    type=FILE,
    multiple=True,
    required=True,
    help="Path of a fingertip's frame ring to create; once per finger, in the order of hand.toml.",
)
@click.option(
    "--truth",
    type=FOLDER,
    required=True,
    help="Folder for the truth: motion.csv of hand and object, FINGER.csv of each fingertip's contacts, and "
    "in FINGER/ each fifth of its pictures.",
)
@seed_option
def live(config_path: Path, sensors: Path, rings: tuple[Path, ...], truth: Path, seed: int) -> None:
    """Simulate hand, object and drives in real time on a bus, with the cameras in shared memory.

    Runs until SIGTERM or SIGINT. `palpate-edge run` reads the frames, `palpate-host run` controls the drives.

    \b
    Example (with the bus of hand.toml running):
      palpate-host simulate live --config hand.toml --sensors sensors --truth truth \\
        --ring /dev/shm/finger-1 --ring /dev/shm/finger-2 --ring /dev/shm/finger-3
    """
    from palpate_edge.can_bus.bus import open_bus  # noqa: PLC0415 (as below: keeps --help fast)
    from palpate_edge.can_bus.simulated_clock import ClockKeeper  # noqa: PLC0415
    from palpate_edge.common.local_clock import monotonic_us, unix_ahead_us  # noqa: PLC0415
    from palpate_edge.common.signals import stop_event  # noqa: PLC0415
    from palpate_host.service.host import load_hand  # noqa: PLC0415
    from palpate_twin.camera.look import TWIN_FILE  # noqa: PLC0415
    from palpate_twin.closed_loop.live_cameras import CameraFiles, LiveCameras  # noqa: PLC0415
    from palpate_twin.closed_loop.live_hand import LiveHand  # noqa: PLC0415
    from palpate_twin.hand.motion import MotionFile  # noqa: PLC0415
    from palpate_twin.paper.trial import make_engine  # noqa: PLC0415

    config, kinematics = load_hand(config_path)
    names = [finger.name for finger in config.fingers]
    if len(rings) != len(names):
        raise ConfigError(
            f"{len(rings)} --ring for {len(names)} fingers of the hand: give --ring once per finger"
        )
    make_folder(truth, ConfigError)
    files = [
        CameraFiles(sensors / name / TWIN_FILE, ring, truth / f"{name}.csv", truth / name)
        for name, ring in zip(names, rings, strict=True)
    ]
    engine = make_engine(config, "mujoco", has_B=False)
    with ExitStack() as stack:
        stop = stack.enter_context(stop_event())
        motion = stack.enter_context(
            MotionFile(truth / "motion.csv", [j.name for j in config.joints], len(config.fingers))
        )
        cameras = stack.enter_context(closing(LiveCameras(files, seed)))
        keeper = None
        if config.bus.clock:
            keeper = stack.enter_context(closing(ClockKeeper(Path(config.bus.clock))))
        now_us = monotonic_us() if keeper is None else keeper.now_us()
        hand = LiveHand(config, kinematics, engine, cameras, motion, now_us, now_us + unix_ahead_us())
        bus = stack.enter_context(open_bus(config.bus, "twin", hand.accept_ids, echo=True))
        click.echo(f"simulated hand: {len(config.joints)} drives, {len(names)} cameras", err=True)
        hand.serve(bus, stop, keeper)
    click.echo(
        f"simulated hand stopped: {hand.exposures} exposures in {hand.simulated_us / 1e6:.2f} s of simulated "
        f"time, {hand.pace:.3f} of real time",
        err=True,
    )
