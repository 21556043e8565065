"""The host without its bus, in virtual time: the core between loss and recover, and the rim over a driver
that does as it is told. The hub's loss is in test_session.py, the kernel's in tests/kernel."""

import errno
import logging
import socket
from contextlib import ExitStack, closing
from dataclasses import replace
from itertools import pairwise

import can
import msgspec
import pytest

from palpate_bus.eds.cia402 import DriveState
from palpate_edge.can_bus.bus import Bus, BusConfig
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.link import CAN_ERR_BUSOFF, CAN_ERR_RESTARTED
from palpate_edge.can_bus.python_can_link import PythonCanLink
from palpate_edge.can_bus.reconnecting_bus import BusState, BusStateChange
from palpate_edge.common.errors import BusError, BusOffError
from palpate_edge.common.local_sockets.sd_notify import Notifier, WatchdogGate
from palpate_host.common.command import CommandError, Grasp, Recover, Stop
from palpate_host.common.mode import Mode
from palpate_host.config.hand_config import RunConfig, StartMode
from palpate_host.network.nmt_master import SYNC
from palpate_host.service.bus_reports import BusReports
from palpate_host.service.host_bus import HostBus
from palpate_host.service.host_core import HostCore

TICK_US = 10_000
GONE = "the cable is out"
QUICK_STOP_OR_OFF = {b"\x02\x00", b"\x00\x00"}


@pytest.fixture
def waiting_config(table_4):
    config, hand = table_4
    return msgspec.structs.replace(config, run=RunConfig(start=StartMode.COMMAND)), hand


@pytest.fixture
def grasping(bench, waiting_config):
    rig = bench.VirtualBench(*waiting_config)
    run_until(rig, Mode.READY)
    while "waiting for a command" not in rig.run(0.02).reason:
        pass
    rig.core.command(Grasp())
    run_until(rig, Mode.GRASP)
    rig.run(0.1)
    return rig


def run_until(rig, mode):
    """So far, and no further: virtual time is dear."""
    end_us = rig.now_us + 2_000_000
    while rig.run(0.01).mode is not mode:
        assert rig.now_us < end_us, rig.statuses[-1]


def lose(rig):
    rig.cut_off.add(rig.host_id)
    rig.core.bus_lost(rig.now_us, GONE)


def regain(rig):
    rig.cut_off.clear()
    rig.core.bus_restored(rig.now_us)


def run_in_silence(rig, duration_s):
    """Returns the statuses of it; the core may not say anything meanwhile."""
    begun, end_us = len(rig.statuses), rig.now_us + round(duration_s * 1e6)
    while rig.now_us < end_us:
        rig._step()
        assert rig.output.frames_out == ()
    return rig.statuses[begun:]


def commands_since(rig, begun_us):
    return {
        frame.data[:2] for stamp_us, frame in rig.log if stamp_us >= begun_us and 0x200 < frame.can_id < 0x20A
    }


def enabled(rig):
    return sum(drive.state is DriveState.OPERATION_ENABLED for drive in rig.drives)


def test_a_lost_bus_is_a_fault_without_a_frame_and_its_status_goes_on(grasping):
    lose(grasping)
    statuses = run_in_silence(grasping, 1.0)
    times_us = [status.time_us for status in statuses]
    assert len(times_us) == 100 and {b - a for a, b in pairwise(times_us)} == {TICK_US}
    assert {(status.mode, status.reason) for status in statuses} == {(Mode.FAULT, GONE)}
    for joint in statuses[0].joints:
        assert (joint.position_rad, joint.drive_state, joint.command_Nm) == (None, "no status", 0.0)
    assert not any(finger.in_contact for finger in statuses[0].fingers)
    assert enabled(grasping) == 0  # by the drives' own watchdogs
    with pytest.raises(CommandError, match=rf"recover is refused in mode fault \({GONE}\): the bus is lost"):
        grasping.core.command(Recover())


@pytest.mark.parametrize("away_s", [0.05, 1.0])
def test_back_again_nothing_is_enabled_without_recover_and_recover_leads_to_ready(grasping, away_s):
    """0.05 s: the drives' watchdogs have not yet run out, and the host takes their power."""
    lose(grasping)
    run_in_silence(grasping, away_s)
    assert enabled(grasping) == (9 if away_s < 0.2 else 0)
    begun_us = grasping.now_us
    regain(grasping)
    grasping.run(0.05)
    assert enabled(grasping) == 0
    status = grasping.run(1.0)
    assert (status.mode, status.reason, status.warning) == (Mode.FAULT, GONE, "")
    assert enabled(grasping) == 0
    assert commands_since(grasping, begun_us) <= QUICK_STOP_OR_OFF
    grasping.core.command(Recover())
    grasping.run(0.02)
    nmt = [frame.data for stamp_us, frame in grasping.log if stamp_us >= begun_us and frame.can_id == 0]
    assert sorted(data for data in nmt if data[0] == 0x82) == [
        bytes((0x82, node)) for node in (*range(1, 10), 0x10, 0x11, 0x12)
    ]
    status = grasping.run(1.0)
    assert status.mode is Mode.READY and enabled(grasping) == 9
    assert all(joint.command_Nm == 0.0 for joint in status.joints)
    grasping.core.command(Grasp())
    assert grasping.run(0.5).mode is Mode.GRASP


def test_what_was_stamped_before_the_bus_was_back_does_not_count(grasping):
    last = {frame.can_id: (stamp_us, frame) for stamp_us, frame in grasping.log}
    heard = [last[tpdo + drive] for tpdo in (0x180, 0x280) for drive in range(1, 10)]
    lose(grasping)
    run_in_silence(grasping, 0.5)
    regain(grasping)
    before = grasping.core.process(grasping.now_us + TICK_US, heard).status
    assert {joint.drive_state for joint in before.joints} == {"no status"}
    again = [(grasping.now_us + TICK_US + 1, frame) for _, frame in heard]
    after = grasping.core.process(grasping.now_us + 2 * TICK_US, again).status
    assert "no status" not in {joint.drive_state for joint in after.joints}


def test_after_a_gap_one_tick_of_the_old_grid_and_no_stamp_of_an_old_sync(waiting_config):
    core = HostCore(*waiting_config)
    core.process(1_000_000, ())
    core.process(1_005_000, [(1_000_100, SYNC)])
    core.bus_lost(1_006_000, GONE)
    assert core.process(1_010_000, ()).frames_out == ()
    core.bus_restored(6_034_000)
    output = core.process(6_034_500, ())
    sent = [frame.can_id for frame in output.frames_out]
    assert sent.count(SYNC.can_id) == 1 and sent.count(0x700 + 0x7F) <= 1
    assert 0x1FF not in sent
    assert output.next_due_us == 6_040_000
    assert core.process(6_035_000, ()).frames_out == ()


def test_a_wish_to_leave_while_the_bus_is_away_ends_at_the_next_tick_as_a_stop(grasping):
    lose(grasping)
    run_in_silence(grasping, 0.5)
    grasping.core.request_stop()
    assert len(run_in_silence(grasping, 0.01)) == 1
    assert grasping.output.finished and grasping.output.failure == ""
    assert (grasping.output.status.mode, grasping.output.status.reason) == (
        Mode.STOP,
        "stopped by the operator",
    )


def test_an_earlier_fault_keeps_its_reason(grasping):
    grasping.silent.add(3)
    grasping.run(1.5)
    lose(grasping)
    status = run_in_silence(grasping, 0.1)[-1]
    assert status.mode is Mode.FAULT and "curl_1" in status.reason and status.warning == GONE
    grasping.core.request_stop()
    run_in_silence(grasping, 0.01)
    assert grasping.output.finished and "curl_1" in grasping.output.failure


def test_an_operators_stop_stays_one(grasping):
    grasping.core.command(Stop())
    grasping.run(1.0)
    lose(grasping)
    status = run_in_silence(grasping, 0.1)[-1]
    assert (status.mode, status.warning) == (Mode.STOP, GONE)
    regain(grasping)
    grasping.run(0.1)
    grasping.core.command(Recover())
    assert grasping.run(1.0).mode is Mode.READY


class Driver(can.BusABC):
    """What the wire did, to be received; what was sent; whether sending fails."""

    def __init__(self, *arriving):
        self.arriving = list(arriving)
        self.sent = []
        self.is_gone = self.is_closed = False
        super().__init__(channel="driver")

    def send(self, msg, timeout=None):  # noqa: ARG002
        if self.is_gone:
            raise gone()
        self.sent.append(msg.arbitration_id)

    def recv(self, timeout=None):  # noqa: ARG002
        if self.is_gone:
            raise gone()
        one = self.arriving.pop(0) if self.arriving else None
        if isinstance(one, Exception):
            raise one
        return one

    def shutdown(self):
        super().shutdown()
        self.is_closed = True


def gone(why="Network is down"):
    return can.CanOperationError(why, errno.ENETDOWN)


def error_frame(kind):
    return can.Message(arbitration_id=kind, is_error_frame=True, data=bytes(8))


def message(can_id):
    return can.Message(arbitration_id=can_id, is_extended_id=False)


class Rim:
    """A HostBus and the drivers that it is to open, in turn; a text refuses to open with it."""

    def __init__(self, *to_open, outlives=True):
        self.now_us = 0
        self.opened_at = []
        self.to_open = list(to_open)
        self.bus = HostBus(self.open_one, outlives=outlives, sleep=self.sleep)

    def open_one(self):
        self.opened_at.append(self.now_us)
        driver = self.to_open.pop(0)
        if isinstance(driver, str):
            raise BusError(driver)
        return Bus(PythonCanLink(driver), BusConfig(), "host")

    def sleep(self, duration_s):
        self.now_us += round(duration_s * 1e6)

    def turn(self, *frames):
        """As the host's loop: send, wait at most a tick."""
        self.bus.send(self.now_us, frames)
        began_us = self.now_us
        received = self.bus.receive(began_us, TICK_US * 1e-6)
        if self.now_us == began_us and self.bus.state is not BusState.DOWN:
            self.now_us += TICK_US
        return [frame.can_id for _, frame in received]

    def turn_until(self, end_us):
        while self.now_us < end_us:
            self.turn()


def test_it_is_opened_again_after_growing_pauses():
    first, last = Driver(message(0x181), gone()), Driver()
    rim = Rim(first, *["no such device"] * 7, last)
    assert rim.turn(SYNC) == [0x181]
    lost_us = rim.now_us
    assert rim.turn() == [] and rim.bus.state is BusState.DOWN and first.is_closed
    rim.turn_until(20_000_000)
    pauses_ms = [(b - a) // 1000 for a, b in pairwise([lost_us, *rim.opened_at[1:]])]
    assert pauses_ms == [100, 200, 400, 500, 500, 500, 500, 500]
    down, still_down, up = rim.bus.changes()
    assert down.state is BusState.DOWN and "Network is down" in down.reason
    assert (still_down.state, still_down.reason) == (BusState.DOWN, "no such device")
    assert (up.state, up.reason) == (BusState.UP, "")
    assert rim.bus.changes() == []
    assert rim.turn(SYNC) == [] and last.sent == [0x080]


def test_sending_notices_as_well_and_nothing_of_then_is_sent_later():
    first, second = Driver(), Driver()
    rim = Rim(first, second)
    first.is_gone = True
    rim.turn(CanFrame(0x201, bytes(5)))
    assert rim.bus.state is BusState.DOWN
    rim.turn(CanFrame(0x202, bytes(5)))
    rim.turn_until(500_000)
    assert rim.bus.state is BusState.UP and second.sent == []


def test_a_link_that_opens_and_is_down_is_not_back():
    rim = Rim(Driver(gone()), Driver(gone()), Driver())
    rim.turn_until(400_000)
    assert [change.state for change in rim.bus.changes()] == [BusState.DOWN, BusState.UP]


@pytest.mark.parametrize(("carries", "pause_ms"), [(True, 100), (False, 200)])
def test_the_pauses_begin_anew_once_something_has_come(carries, pause_ms):
    second = Driver(*[message(0x080)] * carries)
    rim = Rim(Driver(gone()), second, Driver())
    rim.turn_until(150_000)
    lost_us, second.is_gone = rim.now_us, True
    rim.turn_until(1_000_000)
    assert (rim.opened_at[-1] - lost_us) // 1000 == pause_ms


@pytest.mark.parametrize("sign", ["restarted", "a frame"])
def test_bus_off_waits_for_the_controller_and_keeps_the_socket(sign):
    driver = Driver(error_frame(CAN_ERR_BUSOFF))
    rim = Rim(driver)
    rim.turn()
    for _ in range(20):
        rim.turn(SYNC)
    assert rim.bus.state is BusState.BUS_OFF and driver.sent == []
    driver.arriving = [error_frame(CAN_ERR_RESTARTED) if sign == "restarted" else message(0x181)]
    rim.turn()
    assert rim.bus.state is BusState.UP and rim.opened_at == [0]
    off, up = rim.bus.changes()
    assert (off.state, off.after_bus_off, up.after_bus_off) == (BusState.BUS_OFF, True, True)
    assert "went bus-off" in off.reason


@pytest.mark.parametrize("event", [gone(), error_frame(CAN_ERR_BUSOFF)])
def test_where_the_host_does_not_outlive_it_the_loss_is_an_error(event):
    rim = Rim(Driver(event), outlives=False)
    with pytest.raises(BusError, match=r"Network is down|bus-off") as caught:
        rim.turn()
    assert isinstance(caught.value, BusOffError) is not isinstance(event, Exception)


def test_what_cannot_be_opened_at_the_start_is_an_error():
    with pytest.raises(BusError, match="no such device"):
        Rim("no such device")


def test_the_watchdog_is_fed_while_the_bus_is_away_and_not_while_it_is_up_and_carries_nothing():
    rim = Rim(Driver(gone()), *["no such device"] * 20)
    rim.turn()
    gate = WatchdogGate(1_000_000)
    fed = [0]
    while rim.now_us < 5_000_000:
        rim.turn()
        if gate.may_feed(rim.now_us, rim.now_us, rim.bus.activity):
            fed.append(rim.now_us)
    assert max(b - a for a, b in pairwise(fed)) < 400_000
    idle = Rim(Driver())
    idle.turn()
    assert idle.bus.activity == 0


@pytest.fixture
def status(waiting_config):
    """The host's first status."""
    return HostCore(*waiting_config).process(1_000_000, ()).status


def test_a_loose_plug_does_not_fill_the_log(caplog, waiting_config):
    """The bus is lost and found again every 0.4 s for two minutes."""
    caplog.set_level(logging.INFO, "palpate.bus")
    with closing(Notifier({})) as notifier:
        reports = BusReports(HostCore(*waiting_config), notifier, "on can0")
        for number in range(600):
            state, reason = ((BusState.DOWN, "out"), (BusState.UP, ""))[number % 2]
            reports.bus_changed(number * 200_000, [BusStateChange(state, reason, after_bus_off=False)])
        reports.bus_changed(130_000_000, [])
    ours = [one for one in caplog.records if one.name == "palpate.bus"]
    assert len(ours) == 2 * (10 + 1)
    assert (
        ours[-1]
        .getMessage()
        .startswith("290 more changes of the bus in the last minute, the last: the bus is up")
    )


def test_systemd_and_the_log_report_a_lost_bus(tmp_path, caplog, waiting_config, status):
    """Once each; the usual status line is restored by the recovery."""
    caplog.set_level(logging.INFO, "palpate")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd, ExitStack() as stack:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(10.0)
        notifier = stack.enter_context(closing(Notifier({"NOTIFY_SOCKET": str(tmp_path / "notify")})))
        reports = BusReports(HostCore(*waiting_config), notifier, "on can0")
        rim = Rim(Driver(gone("out")), Driver())
        reports.ticked(status)
        while rim.now_us < 200_000:
            rim.turn()
            changes = rim.bus.changes()
            reports.bus_changed(rim.now_us, changes)
            if changes:  # the core's mode with a lost bus: FAULT, for the same reason
                reports.ticked(replace(status, mode=Mode.FAULT, reason=changes[0].reason or "later"))
        reports.ticked(status)
        heard = [systemd.recv(500).decode() for _ in range(3)]
    assert heard[0].startswith("STATUS=the bus is down. socketcan bus") and "cannot receive: out" in heard[0]
    assert heard[1:] == ["STATUS=the bus is up again: palpate-host command recover", "STATUS=on can0"]
    ours = [one for one in caplog.records if one.name.startswith("palpate.")]
    lines = [(one.levelname, one.name, one.getMessage()) for one in ours]
    assert [(level, name) for level, name, _ in lines] == [
        ("ERROR", "palpate.bus"),
        ("INFO", "palpate.bus"),
        ("INFO", "palpate.hand"),  # the recovery
    ]
    assert "cannot receive: out" in lines[0][2]


def test_the_log_has_the_reason_of_a_fault_and_of_a_hold(caplog, waiting_config, status):
    caplog.set_level(logging.INFO, "palpate")
    with closing(Notifier({})) as notifier:
        reports = BusReports(HostCore(*waiting_config), notifier, "on can0")
        for mode in (Mode.INIT, Mode.GRASP, Mode.HOLD, Mode.HOLD, Mode.MANIPULATE, Mode.FAULT, Mode.FAULT):
            reports.ticked(replace(status, mode=mode, reason=f"because of {mode.value}"))
    assert [(one.levelname, one.getMessage()) for one in caplog.records] == [
        ("WARNING", "hold: because of hold"),
        ("INFO", "manipulate: because of manipulate"),
        ("ERROR", "fault: because of fault"),
    ]
