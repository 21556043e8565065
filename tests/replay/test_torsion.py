"""Torsion from rendered frames of a sensor that was never seen before, over the bus to the host."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate_bus.logs.candump import LogHeader, LogRecord, read_log, write_log
from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import Press, PressDataset, read_dataset
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_host.common.tip_contact import TipContact
from palpate_host.network.fingertips import Fingertip
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.camera.write_dataset import Plan, single_presses, write_dataset
from palpate_twin.dome.library import load_library
from palpate_twin.dome.probe import Probe

NODE, FRAME_US = 0x10, 33_333
CONTACT_TPDOS = (0x180, 0x280, 0x300, 0x380)
SEED = 427
LARGEST_RMSE = 0.05  # of the torsion's range


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> PressDataset:
    folder = tmp_path_factory.mktemp("twisted") / "dataset"
    view = CameraView(random_sensor(SEED), load_library())
    plan = Plan(150, 60, (Probe.PLATE,), twist=True)
    write_dataset(folder, view, single_presses(view, plan, SEED), plan.references, SEED, torsion=True)
    return read_dataset(folder)


def over_the_bus(dataset: PressDataset, estimator: Estimator, path: Path) -> list[tuple[Press, TipContact]]:
    """Return the test presses with what the host decodes of their contacts from a bus log."""
    node = FingertipNode(NODE, MethodCode.CORRECTED, "0" * 16)
    node.process(0, (CanFrame(0x000, b"\x01\x00"),))
    presses = {}
    sent: list[LogRecord] = []
    for number, press in enumerate(dataset.split("test")):
        stamp_us = FRAME_US * (number + 1)
        image = read_image(dataset.path(press), grey=False)
        node.publish(estimator.estimate(Frame(image, stamp_us, number, press.frame)), 1000)
        sent += [LogRecord(stamp_us, frame) for frame in node.process(stamp_us, ()).frames_out]
        presses[number] = press
    write_log(path, LogHeader(), sent)
    host = Fingertip(NODE, "finger-1")
    received = [
        host.receive(record.stamp_us, record.frame)
        for record in read_log(path).records
        if record.frame.can_id - NODE in CONTACT_TPDOS
    ]
    return [(presses[tip.sequence], tip) for tip in received if tip is not None]


@pytest.mark.slow
def test_torsion_of_an_unseen_sensor_arrives_with_its_interval(dataset: PressDataset, tmp_path: Path) -> None:
    estimator = Estimator(calibrate(dataset, dome=load_dome_model()))
    pairs = [
        (press.torsion_Nmm, tip)
        for press, tip in over_the_bus(dataset, estimator, tmp_path / "bus.log")
        if press.position_mm is not None and tip.torsion_Nmm is not None
    ]
    assert len(pairs) > 50
    truth = np.array([torsion for torsion, _ in pairs])
    given = np.array([tip.torsion_Nmm for _, tip in pairs])
    half_width = np.array([tip.torsion95_Nmm for _, tip in pairs])
    error = np.abs(given - truth)
    assert np.sqrt((error**2).mean()) < LARGEST_RMSE * np.ptp(truth)
    assert (error <= half_width).mean() > 0.85
    assert all(tip.force95_N is not None for _, tip in pairs)


@pytest.mark.slow
def test_a_calibration_without_torsions_leaves_it_unknown_on_the_bus(
    dataset: PressDataset, tmp_path: Path
) -> None:
    estimator = Estimator(calibrate(dataset))  # the paper's method gives none
    pairs = over_the_bus(dataset, estimator, tmp_path / "bus.log")
    touched = [tip for press, tip in pairs if press.position_mm is not None]
    assert touched
    assert {(tip.torsion_Nmm, tip.torsion95_Nmm, tip.force95_N) for tip in touched} == {(None, None, None)}
