"""One run of the press rig in virtual time: the real run against the simulated parts, byte by byte."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate_edge.common.frame import Frame
from palpate_edge.press_rig.journal import new_journal
from palpate_edge.press_rig.plan import make_plan
from palpate_edge.press_rig.rig_config import (
    BoxConfig,
    PressConfig,
    PrinterConfig,
    RigConfig,
    ScaleConfig,
)
from palpate_edge.press_rig.rig_core import RigCore
from palpate_edge.press_rig.run_files import RunFiles
from palpate_edge.press_rig.run_sequence import RunSequence
from palpate_twin.camera.deformation import ProbePress
from palpate_twin.camera.renderer import CameraView
from palpate_twin.camera.write_dataset import sensor_toml
from palpate_twin.press_rig.simulated_scale import PERIOD_US
from palpate_twin.press_rig.virtual_rig import Placement, VirtualRig

APEX_MM = (110.0, 105.0, 60.0)
RIG = RigConfig(
    printer=PrinterConfig(port="printer"),
    scale=ScaleConfig(port="scale"),
    box=BoxConfig(low_mm=(40.0, 40.0, 25.0), high_mm=(180.0, 180.0, 90.0)),
    presses=PressConfig(apex_mm=APEX_MM, theta_deg=65.0),
)


class PowerCutError(Exception):
    """Raised by a test inside a run: the process is gone, and nothing is cleaned up."""


class RigTrial:
    """A folder, a simulated rig, and one run after the other on it.

    truth: press and force (3,) in F at each picture, by the frame's index in the journal.
    """

    def __init__(
        self, folder: Path, view: CameraView, mounting: Placement, presses: int, tests: int = 0
    ) -> None:
        self.rig = VirtualRig(view, APEX_MM, mounting, seed=1)
        self.now_us = 1_000_000
        self.lines: list[str] = []
        self.truth: dict[int, tuple[ProbePress | None, np.ndarray]] = {}
        self._view, self._mounting, self._folder = view, mounting, folder
        self._fresh = new_journal(RIG, view.twin.sensor, presses, tests, seed=0)
        self._description = folder.with_name(folder.name + ".toml")
        self._description.write_text(sensor_toml(view.twin.sensor), encoding="utf-8")
        self.files = self._open()

    def _open(self) -> RunFiles:
        return RunFiles(self._folder, self._description, self._fresh)

    @property
    def taken(self) -> int:
        """Return the number of frames in the journal on the disk."""
        return len(self._open().journal.records)

    @property
    def is_clear(self) -> bool:
        """Return whether the ball is off the dome, above its apex."""
        z_mm = float(self.rig.printer.position_mm(self.now_us)[2])
        return self.rig.dome.press is None and z_mm >= APEX_MM[2] + 5

    def restart_printer(self) -> None:
        """Switch the printer off and on and home it; the fingertip stays where it is."""
        self.rig = VirtualRig(self._view, APEX_MM, self._mounting, seed=2)

    def run(self, change: Callable[[RigTrial], None] = lambda _trial: None, seconds: float = 1e5) -> None:
        """Run to the end, as palpate-edge press-rig does; `change` is called at each step.

        Asserts at each step that the head is inside the box.
        """
        self.files = self._open()
        self.sequence = RunSequence(
            RIG,
            self._view.twin.sensor,
            make_plan(self._fresh.plan),
            self.files.journal.done,
            self.files.missing_references,
        )
        self.core = RigCore(RIG, self.sequence.run())
        to_printer, frame = b"", None
        end_us = self.now_us + round(1e6 * seconds)
        while True:
            self.now_us += PERIOD_US
            assert self.now_us < end_us, "the run does not end"
            from_printer, from_scale = self.rig.advance(self.now_us, to_printer)
            position_mm = self.rig.printer.position_mm(self.now_us)
            assert (position_mm >= np.array(RIG.box.low_mm) - 0.1).all()
            assert (position_mm <= np.array(RIG.box.high_mm) + 0.1).all()
            change(self)
            outputs = self.core.process(self.now_us, from_printer, from_scale, frame)
            to_printer, frame = outputs.to_printer, None
            for kept in outputs.keep:
                self.files.keep(kept)
            self.lines += outputs.lines
            if outputs.is_done:
                return
            if outputs.wants_picture:
                frame = Frame(self.rig.picture(), self.now_us + 1, 0, "twin")
                force_N = self.rig.dome.force_N @ self._mounting.to_printer
                self.truth[len(self.files.journal.records)] = self.rig.dome.press, force_N

    @property
    def is_pressing(self) -> bool:
        """Return whether the dome was found and a press is under way."""
        return self.sequence.place is not None and self.rig.dome.press is not None
