"""A fingertip's board with a kernel: a card that the playbooks provisioned, a host outside on its CAN bus.

A virtual machine under emulation with Debian's kernel, a CAN card, and a disk whose power can be cut; its
frames are recorded ones. The tests go on from each other, in this order.
"""

from __future__ import annotations

import re
import time

import pytest

from deploy_rig.booted_board import PATIENCE_S, booted_board
from deploy_rig.image import missing
from deploy_rig.master import master_on
from deploy_rig.provisioned_card import provisioned_card
from palpate_edge.can_bus.bus import BusConfig

pytestmark = pytest.mark.deploy_booted

SERVICE = "palpate-fingertip.service"
# What stands for hardware. An emulated processor needs ten times a board's time to start Python.
HARDWARE = {
    "/etc/modules-load.d/hardware.conf": "kvaser_pci\n",
    f"/etc/systemd/system/{SERVICE}.d/slow.conf": (
        "[Service]\nTimeoutStartSec=600s\nWatchdogSec=60s\nTimeoutStopSec=60s\n"
    ),
}


@pytest.fixture(scope="module")
def board(bare_board, wheels, drawn_dataset, drawn_calibration_file, tmp_path_factory):
    """A card that the playbooks provisioned in a namespace (at full speed), then in a machine."""
    if (reason := missing(("qemu-system-x86_64", "qemu-system-x86"))) is not None:
        pytest.skip(reason)
    folder = tmp_path_factory.mktemp("booted")
    camera = drawn_dataset, drawn_calibration_file
    provisioned_card(folder, bare_board, wheels, camera, HARDWARE, "systemctl mask serial-getty@hvc0.service")
    begin_s = time.monotonic()
    with booted_board(bare_board, folder) as machine:
        print(f"boot: {time.monotonic() - begin_s:.0f} s")
        yield machine
    (folder / "disk").unlink()


def shown(board, name):
    return board.run(f"systemctl show --value --property={name} {SERVICE}")


def host_outside(board):
    """Over slcan on loopback."""
    board.join_bus()
    return master_on(BusConfig(interface="slcan", channel=f"socket://127.0.0.1:{board.bus_port}"))


def wait_for_contact(board):
    with host_outside(board) as master:
        begin_s = time.monotonic()
        print(f"a valid contact outside after {master.contact_after(begin_s, PATIENCE_S):.1f} s")


def wait_until_it_serves(board):
    board.wait_for(lambda: shown(board, "ActiveState") == "active")


def test_a_provisioned_card_serves_a_host_outside(board):
    wait_until_it_serves(board)
    link = board.run("ip -details link show can0")
    assert "can state ERROR-ACTIVE" in link
    assert "bitrate 1000000" in link
    wait_for_contact(board)


def test_nothing_failed(board):
    assert board.run("systemctl --failed --no-legend") == ""


def test_nothing_listens_but_ssh_and_the_name(board):
    """avahi answers for NAME.local."""
    rows = board.run("ss --no-header --listening --tcp --udp --processes --numeric")
    assert rows
    others = [row for row in rows.splitlines() if not ('"sshd"' in row and re.search(r":22\s", row))]
    assert all('"avahi-daemon"' in row and row.startswith("udp") for row in others), rows


def test_the_kernel_lets_the_buffer_of_a_can_socket_grow(board):
    assert board.run("sysctl -n net.core.rmem_max") == "1048576"


def test_can_goes_down_and_comes_back(board):
    board.run("ip link set can0 down")
    board.wait_for(lambda: "the bus is down" in journal(board))
    board.run("ip link set can0 up")
    board.wait_for(lambda: "the bus is up" in journal(board))
    wait_for_contact(board)


def journal(board):
    return board.run(f"journalctl --boot --unit {SERVICE} --output=cat")


def test_a_killed_service_comes_back(board):
    before = int(shown(board, "NRestarts"))
    with host_outside(board) as master:
        begin_s = time.monotonic()
        master.contact_after(begin_s, PATIENCE_S)
        board.run(f"systemctl kill --signal=KILL {SERVICE}")
        master.contact_after(time.monotonic() + 0.5, PATIENCE_S)  # what was under way has come by then
        print(f"kill -9 to the next valid contact: {master.longest_gap_s(begin_s):.1f} s")
    assert int(shown(board, "NRestarts")) > before


def test_a_full_disk_stops_nothing_that_serves(board):
    board.run("dd if=/dev/zero of=/var/tmp/full bs=1M status=none || true")
    assert board.run("df --output=avail / | tail -1").strip() == "0"
    pid = shown(board, "MainPID")
    wait_for_contact(board)
    board.run(f"systemctl restart {SERVICE}")
    assert shown(board, "MainPID") != pid
    wait_for_contact(board)
    board.run("rm /var/tmp/full && sync")  # or the power cut brings it back


def test_a_board_serves_after_its_power_was_cut(board):
    release = board.run("readlink /opt/palpate/current")
    board.power_cut()
    begin_s = time.monotonic()
    board.boot()
    wait_until_it_serves(board)
    print(f"power to ready: {time.monotonic() - begin_s:.0f} s")
    assert board.run("readlink /opt/palpate/current") == release
    wait_for_contact(board)


def test_power_cut_on_trial_goes_back(board):
    """The disk is what the machine had given out to it, no more."""
    old = board.run("readlink /opt/palpate/current").removeprefix("releases/")
    board.run(f"cp -a /opt/palpate/releases/{old} /opt/palpate/releases/another && sync")
    board.run("(/opt/palpate/bin/palpate-release --interrupt switch another >/dev/null 2>&1 &)")
    board.wait_for(lambda: board.run("readlink /opt/palpate/current") == "releases/another")
    board.power_cut()
    board.boot()
    wait_until_it_serves(board)
    assert board.run("readlink /opt/palpate/current") == f"releases/{old}"
    wait_for_contact(board)
