"""A sensor of a drawn flat gel on the bus: from the daemon's camera to the host's contact and records."""

from __future__ import annotations

import csv
import shutil
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
from bench.flat_gel import LABELS, write_gel
from tests.edge.conftest import NODE, Rig

from palpate_edge.calibration.pose.calibrate_pose import calibrate_pose
from palpate_edge.calibration.pose.pose_calibration_file import save_pose_calibration
from palpate_edge.datasets.pose_dataset import read_pose_dataset
from palpate_host.network.finger_state import FingerRecord

TOLERANCE = dict(zip(LABELS, (0.1, 0.5, 0.5, 0.1, 0.1, 0.5), strict=True))  # 40 presses; spans are 1 to 20


@pytest.mark.long
def test_the_pose_of_a_picture_arrives_at_the_host(tmp_path: Path) -> None:
    write_gel(tmp_path / "gel", train=40, test=1)
    with (tmp_path / "gel" / "truth.csv").open() as file:
        truth = list(csv.DictReader(file))[-1]
    save_pose_calibration(calibrate_pose(read_pose_dataset(tmp_path / "gel")), tmp_path / "gel.cal")
    (tmp_path / "played" / "frames").mkdir(parents=True)
    shutil.copy(tmp_path / "gel" / "frames" / truth["frame"], tmp_path / "played" / "frames")
    with ExitStack() as stack:
        rig = Rig(tmp_path, tmp_path / "played", tmp_path / "gel.cal", stack)
        bus = rig.listen()
        finger = FingerRecord("finger", NODE)
        seen: list[int] = []
        end_s = time.monotonic() + 30
        while finger.tip.counters.complete < 2 and time.monotonic() < end_s:
            for stamp_us, frame in bus.receive(0.1):
                if frame.can_id in finger.tip.receive_ids:
                    seen.append(frame.can_id)
                    contact = finger.tip.receive(stamp_us, frame)
                    if contact is not None:
                        finger.note(contact)
        checked = rig.edge("check")
    status = finger.status(0)
    counters = finger.tip.counters
    assert (counters.incomplete, counters.out_of_order, counters.extra_tpdos) == (0, 0, 5 * counters.complete)
    assert seen[:8] == [0x190, 0x1B0, 0x230, 0x290, 0x2B0, 0x310, 0x330, 0x390]
    assert status.valid and status.in_contact and status.flat_pose is not None
    for label, tolerance in TOLERANCE.items():
        assert getattr(status.flat_pose, label) == pytest.approx(float(truth[label]), abs=tolerance)
        assert getattr(status.flat_pose, f"{label}_95") > 0
    assert (status.position_mm, status.normal_force_N, status.shear_N) == (None, None, None)
    assert finger.health(0, heartbeat_timed_out=False).gives_no_place
    assert "pose: depth_mm, tilt_x_deg" in checked.stdout
    assert "place and force unknown" in checked.stdout
