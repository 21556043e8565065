"""Command ``palpate-host simulate press-rig``: printer and scale for ``palpate-edge press-rig``."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_twin.cli.camera import seed_option, sensor_option
from palpate_twin.cli.options import FOLDER


@click.command("press-rig")
@click.option("-o", "--output", type=FOLDER, required=True, help="Folder for devices and configurations.")
@sensor_option
@seed_option
@click.option(
    "--offset-mm", type=(float, float), default=(1.0, 0.0), show_default=True, help="Fingertip off centre."
)
@click.option("--lean-deg", default=2.0, show_default=True, help="Lean of the fingertip about the x axis.")
@click.option("--turn-deg", default=2.0, show_default=True, help="Turn of the fingertip about the z axis.")
@click.option(
    "--speed",
    type=click.FloatRange(1, 50),
    default=1.0,
    show_default=True,
    help="Simulated seconds in one second.",
)
def press_rig(
    output: Path,
    sensor_path: Path | None,
    random_seed: int | None,
    offset_mm: tuple[float, float],
    lean_deg: float,
    turn_deg: float,
    speed: float,
) -> None:
    """Simulate a 3-D printer, a scale and a fingertip below.

    Printer (Marlin) and scale (HX711) are pseudo terminals in the folder, the camera is a ring of frames.
    finger.toml and rig.toml are written beside them. Runs until SIGTERM or SIGINT.

    \b
    Examples:
      palpate-host simulate press-rig -o rig --speed 10
      palpate-edge press-rig --config rig/finger.toml --rig rig/rig.toml -o rig/presses --yes
    """
    import cv2  # noqa: PLC0415 (as below: keeps --help fast)

    from palpate_edge.common.signals import stop_event  # noqa: PLC0415
    from palpate_twin.camera.choose_sensor import choose_sensor  # noqa: PLC0415
    from palpate_twin.camera.renderer import CameraView  # noqa: PLC0415
    from palpate_twin.dome.library import load_library  # noqa: PLC0415
    from palpate_twin.press_rig.rig_service import APEX_MM, serve_rig, write_rig_files  # noqa: PLC0415
    from palpate_twin.press_rig.virtual_rig import Placement, VirtualRig  # noqa: PLC0415

    cv2.setNumThreads(1)
    view = CameraView(choose_sensor(sensor_path, random_seed), load_library())
    placement = Placement((*offset_mm, 0.0), (lean_deg, 0.0), turn_deg)
    rig = VirtualRig(view, APEX_MM, placement, seed=random_seed or 0)
    write_rig_files(output, rig)
    with stop_event() as stop:
        click.echo(
            f"in another terminal: palpate-edge press-rig --config {output / 'finger.toml'} "
            f"--rig {output / 'rig.toml'} -o {output / 'presses'}",
            err=True,
        )
        serve_rig(output, rig, stop, speed)
