"""``palpate-edge``: the programs of a fingertip's board; each command has a file of its own."""

from __future__ import annotations

import os

import click
import cv2

from palpate_edge import __version__
from palpate_edge.cli.calibrate import calibrate
from palpate_edge.cli.check import check
from palpate_edge.cli.estimate import estimate
from palpate_edge.cli.evaluate import evaluate
from palpate_edge.cli.follow import follow
from palpate_edge.cli.guide import guide
from palpate_edge.cli.identify import identify
from palpate_edge.cli.inspect_frame import inspect
from palpate_edge.cli.jig import jig
from palpate_edge.cli.press_rig import press_rig
from palpate_edge.cli.record import record
from palpate_edge.cli.run import run
from palpate_edge.cli.setup import setup
from palpate_edge.cli.train import train
from palpate_edge.cli.watch import watch
from palpate_edge.common.entry_point import run_cli


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="palpate-edge")
def cli() -> None:
    """Touch for robot hands: the programs of a fingertip's board.

    \b
    Examples:
      palpate-edge setup
      palpate-edge guide --config finger-1.toml
      palpate-edge calibrate demo/recording/press -o finger-1.cal
      palpate-edge estimate demo/recording/press --calibration finger-1.cal --csv contacts.csv
      palpate-edge run --config finger-1.toml
      palpate-edge check --config finger-1.toml

    \b
    Exit status: 0 success, 1 unexpected error, 2 configuration, 3 dataset or image, 4 calibration,
    5 capture, 6 bus, 7 illumination controller, 8 press rig.
    """
    cv2.setNumThreads(1)
    _quieten_libraries()


def _quieten_libraries() -> None:
    """Silence OpenCV and FFmpeg: errors are reported by this program's one line on stderr."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # AV_LOG_QUIET
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


for command in (
    setup,
    guide,
    jig,
    calibrate,
    train,
    estimate,
    evaluate,
    run,
    inspect,
    follow,
    check,
    watch,
    record,
    press_rig,
    identify,
):
    cli.add_command(command)


def main() -> None:
    """Run the command line; an error becomes one line on stderr and an exit status that is not 0."""
    run_cli(cli)


if __name__ == "__main__":
    main()
