"""The daemon as a process: a camera that freezes, a bus that dies, seen by systemd, a master and a person."""

from __future__ import annotations

import json
import signal
import struct
import time
from functools import partial

import numpy as np

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_edge.common.signals import IDENTIFY
from palpate_edge.datasets.recording import all_frames, open_recording
from palpate_edge.node.fingertip_objects import Counter

EMCY, TPDO_2 = 0x090, 0x290
STALL_OF_A_BUSY_MACHINE = (0xFF02, 0x0000)
"""Emergencies when this process gave the ring no frame in time, and when it gave one again."""
COMMUNICATION = 0x10
"""Bit of the error register (1001h) while the node id is used twice."""


def flags(data):
    return data[6]


def test_a_frozen_camera_withdraws_the_contact_starves_the_watchdog_and_comes_back(rig):
    def each_stall_has_one_line_and_one_when_it_is_over():
        """Whether it is so by now; a busy machine may stall this test's camera once more."""
        log = (rig.folder / "stderr").read_text()
        return log.count("no frame for 0.5 s") == log.count("finger: camera gives frames again") >= 1

    bus = rig.listen()
    rig.heard(bus, TPDO_2, lambda data: flags(data) & 0x04)
    begun_s = time.monotonic()
    rig.until(lambda: rig.feeds(begun_s) >= 2)
    rig.camera.freeze()
    rig.heard(bus, TPDO_2, lambda data: flags(data) == 0)
    assert struct.unpack_from("<H", rig.heard(bus, EMCY, lambda _: True))[0] == 0xFF02
    assert rig.starves()
    assert rig.process.poll() is None
    rig.camera.thaw()
    rig.heard(bus, TPDO_2, lambda data: flags(data) & 0x04)
    rig.until(each_stall_has_one_line_and_one_when_it_is_over)
    thawed_s = time.monotonic()
    rig.until(lambda: rig.feeds(thawed_s) >= 2)


def test_a_dead_bus_starves_the_watchdog_and_comes_back_while_frames_go_on(rig, effort):
    """The bus is away for a minute at full length."""
    bus = rig.listen()
    rig.heard(bus, TPDO_2, lambda data: flags(data) & 0x04)
    rig.until((rig.folder / "finger.health").exists)
    before = json.loads((rig.folder / "finger.health").read_bytes())
    rig.hub.kill()
    rig.hub.wait()
    assert rig.starves()
    health = json.loads((rig.folder / "finger.health").read_bytes())
    assert health["bus"]["state"] == "down"
    assert health["frames"] > before["frames"] + 30
    time.sleep(effort(0, 60))
    rig.start_hub()
    hub_s = time.monotonic()
    rig.heard(rig.listen(), TPDO_2, lambda data: flags(data) & 0x04)
    back_s = time.monotonic()
    print(f"contacts {back_s - hub_s:.2f} s after the start of the hub")
    assert rig.process.poll() is None
    rig.until(lambda: rig.feeds(back_s) >= 2)


def counter_on_the_bus(rig, bus, sub):
    """A counter of 2041h, by SDO."""
    bus.send([CanFrame(0x610, bytes((0x40, 0x41, 0x20, sub, 0, 0, 0, 0)))])
    answer = rig.heard(bus, 0x590, lambda data: data[3] == sub)
    assert answer[0] == 0x43
    return int.from_bytes(answer[4:], "little")


def test_a_spoofed_frame_a_second_interrupts_the_contacts_and_ends_nothing(rig, effort):
    """Contacts are back within a second after the last one; the limit on a busy machine is the watchdog's."""

    def valid(data):
        return flags(data) & 0x04

    bus = rig.listen()
    rig.heard(bus, TPDO_2, valid)
    rig.until((rig.folder / "finger.health").exists)
    spoofed = effort(2, 60)
    for _ in range(spoofed):
        bus.send([CanFrame(0x190, bytes(8))])
        rig.heard(bus, TPDO_2, lambda data: flags(data) == 0)
        rig.heard(bus, TPDO_2, valid)
        time.sleep(0.3)
    emergencies = [struct.unpack_from("<HB", data) for data in rig._heard.get(EMCY, ())]
    codes = [code for code, _ in emergencies]
    assert [code for code in codes if code not in STALL_OF_A_BUSY_MACHINE] == [0x8150]
    assert all(register & COMMUNICATION for _, register in emergencies[codes.index(0x8150) :])
    rig.until(
        lambda: json.loads((rig.folder / "finger.health").read_bytes())["bus"]["id_conflicts"] == spoofed
    )
    assert counter_on_the_bus(rig, bus, Counter.ID_CONFLICTS) == spoofed
    done = rig.edge("check")
    assert done.returncode == 1
    assert "node id 0x10 is used twice: a frame 0x190 came from another node" in done.stdout
    assert f", {spoofed} with this node id" in done.stdout
    assert (rig.folder / "stderr").read_text().count("node id 0x10 is used twice") == 1
    assert rig.process.poll() is None


def test_sdo_reads_without_a_pause_keep_the_connection(rig, effort):
    bus = rig.listen()
    rig.heard(bus, TPDO_2, lambda data: flags(data) & 0x04)
    read = CanFrame(0x610, bytes.fromhex("4000100000000000"))

    def sent():
        """A hundred requests, again when the hub's queue was full."""
        bus.receive(0)
        try:
            bus.send([read] * 100)
        except BusError:
            return False
        return True

    for _ in range(effort(20, 200)):
        rig.until(sent)
    rig.heard(bus, TPDO_2, lambda data: flags(data) & 0x04)
    written_at = json.loads((rig.folder / "finger.health").read_bytes())["written_at"]
    rig.until(lambda: json.loads((rig.folder / "finger.health").read_bytes())["written_at"] > written_at)
    health = json.loads((rig.folder / "finger.health").read_bytes())["bus"]
    assert (health["restarts"], health["id_conflicts"]) == (0, 0)
    assert rig.process.poll() is None


def test_lost_beads_are_logged_when_they_begin_and_when_they_are_over(rig):
    def log():
        return (rig.folder / "stderr").read_text()

    rig.until((rig.folder / "finger.health").exists)
    rig.camera.cover()
    rig.until(lambda: "finger: beads lost: see palpate-edge check\n" in log())
    rig.camera.uncover()
    rig.until(lambda: "finger: beads lost: over\n" in log())
    assert json.loads((rig.folder / "finger.health").read_bytes())["beads"]["lost"] > 0


def test_the_counters_of_the_health_report_are_on_the_bus(rig):
    """2041h by SDO, also while the camera is frozen."""
    bus = rig.listen()
    counter = partial(counter_on_the_bus, rig, bus)
    rig.until((rig.folder / "finger.health").exists)
    rig.heard(bus, TPDO_2, lambda data: flags(data) & 0x04)  # started: a withdrawal will be sent
    rig.camera.cover()
    rig.until(lambda: counter(Counter.BEADS_NOT_FOUND) > 0)
    rig.camera.freeze()
    rig.heard(bus, TPDO_2, lambda data: flags(data) == 0)
    time.sleep(2.2)  # two reports later nothing of frames and beads changes any more
    report = json.loads((rig.folder / "finger.health").read_bytes())
    beads, sub_of = report["beads"], Counter
    assert counter(sub_of.BEADS_NOT_FOUND) == beads["lost"]
    assert counter(sub_of.WHOLE_IMAGE_SEARCHES) == beads["searches"]
    assert counter(sub_of.FRAMES_DROPPED) == report["camera"]["dropped"]
    assert counter(sub_of.FRAMES_ESTIMATED) + counter(sub_of.FRAMES_REFUSED) >= report["frames"]
    assert counter(sub_of.TIME_STAMPS_REJECTED) == report["clock"]["rejected"] == 0
    bus.send([CanFrame(0x1FF, bytes(4))])  # a time stamp without a SYNC
    rig.until(lambda: counter(sub_of.TIME_STAMPS_REJECTED) == 1)


def test_stopping_is_told_and_the_health_file_goes(rig):
    rig.until((rig.folder / "finger.health").exists)
    rig.process.terminate()
    assert rig.process.wait(60) == 0
    rig.feeds(0)
    assert rig.notes[-1][1] == "STOPPING=1"
    assert not (rig.folder / "finger.health").exists()


def test_a_health_file_that_cannot_be_written_is_told_once_and_no_reason_to_stop(rig):
    rig.until((rig.folder / "finger.health").exists)
    (rig.folder / "finger.health").unlink()
    (rig.folder / "finger.health").mkdir()
    (rig.folder / "finger.health" / "in-the-way").touch()
    bus = rig.listen()
    for _ in range(75):  # two and a half seconds of frames
        rig.heard(bus, TPDO_2, lambda data: flags(data) & 0x04)
    assert (rig.folder / "stderr").read_text().count("finger.health cannot be written") == 1
    (rig.folder / "finger.health" / "in-the-way").unlink()
    (rig.folder / "finger.health").rmdir()
    rig.until((rig.folder / "finger.health").is_file)


def test_check_asks_the_daemon(rig):
    rig.until((rig.folder / "finger.health").exists)
    time.sleep(2.2)  # a whole second of frames is told
    done = rig.edge("check", "--json")
    rows = {row["part"]: row for row in json.loads(done.stdout)}
    parts = ["camera", "beads", "calibration", "model", "bus", "clock", "temperature"]
    counters = ["frame errors", "bead errors", "bus errors", "bus losses", "clock errors"]
    assert list(rows) == [*parts, *counters, "configuration"]
    verdicts = {part: row["verdict"] for part, row in rows.items()}
    assert verdicts["bus"] == verdicts["calibration"] == "ok"
    assert verdicts["clock"] == "warn"  # no host
    assert verdicts["temperature"] == "absent"
    assert done.returncode == 0, done.stdout
    rig.hub.kill()
    rig.until(lambda: json.loads((rig.folder / "finger.health").read_bytes())["bus"]["state"] == "down")
    done = rig.edge("check")
    assert done.returncode == 1
    assert "running" in done.stdout
    assert "fail   bus" in done.stdout
    assert "-> check wiring" in done.stdout


def test_frames_dropped_in_a_pause_are_told_of_the_last_minute(rig):
    def report():
        return json.loads((rig.folder / "finger.health").read_bytes())

    rig.until((rig.folder / "finger.health").exists)
    rig.until(lambda: report()["frames"] >= 2)
    before = report()["camera"]["dropped"]
    rig.process.send_signal(signal.SIGSTOP)
    time.sleep(0.3)  # nine frames, and no stall
    rig.process.send_signal(signal.SIGCONT)
    rig.until(lambda: report()["camera"]["dropped"] >= before + 5)
    assert 0.01 < report()["camera"]["dropped_share"] < 1
    assert report()["bus"]["dropped_lately"] == 0
    assert "% lately" in rig.edge("check").stdout


def test_check_without_a_daemon_tries_the_parts(rig):
    rig.process.terminate()
    rig.process.wait(60)
    done = rig.edge("check")
    assert "not running" in done.stdout
    assert "ok     beads" in done.stdout, done.stdout
    assert "ok     bus" in done.stdout
    assert done.returncode == 0
    rig.camera.close = lambda: None  # the fixture's end, which is anticipated here
    rig.camera._ended.set()
    rig.camera._thread.join()
    rig.camera._writer.close()
    done = rig.edge("check")
    assert "fail   camera" in done.stdout
    assert "is missing" in done.stdout
    assert done.returncode == 1


def test_a_recording_is_what_the_camera_gave(rig, drawn_dataset):
    rig.until((rig.folder / "finger.health").exists)
    assert rig.edge("record", "start").returncode == 0
    rig.until(lambda: len(list(rig.folder.glob("recordings/*/*.png"))) >= 20)
    assert rig.edge("record", "stop").returncode == 0
    (folder,) = (rig.folder / "recordings").iterdir()
    rig.until((folder / "frames.csv").exists)
    recorded = [frame.image for frame in all_frames(open_recording(folder))]
    given = [frame.image for frame in all_frames(open_recording(drawn_dataset / "frames"))]
    for image in recorded[:5]:
        assert any(np.array_equal(image[4:], one[4:]) for one in given)  # above is the camera's noise
    assert 20 < open_recording(folder).fps < 40


def test_without_a_daemon_the_camera_is_recorded_directly(rig):
    rig.process.terminate()
    rig.process.wait(60)
    done = rig.edge("record", "start", "--frames", "3", "-o", str(rig.folder / "frames"))
    assert done.returncode == 0 and "no daemon runs" in done.stderr
    assert len(list((rig.folder / "frames").glob("*.png"))) == 3
    done = rig.edge("record", "stop")
    assert done.returncode == 5
    assert "no daemon of finger runs" in done.stderr


def test_without_an_led_ring_there_is_nothing_to_blink(rig):
    rig.until((rig.folder / "finger.health").exists)
    done = rig.edge("identify")
    assert done.returncode == 7
    assert "finger has no LED ring" in done.stderr
    rig.process.send_signal(IDENTIFY)  # as if its file had named one meanwhile
    bus = rig.listen()
    rig.heard(bus, TPDO_2, lambda data: flags(data) & 0x04)
