"""A fingertip's board with a kernel: from bare Debian to contacts that a host outside gets from its CAN bus.

A virtual machine under emulation with Debian's kernel: a CAN card, a V4L2 camera (vivid shows a test picture
without beads, so but for the camera's own test the frames are recorded ones), a disk whose power can be cut.
The tests go on from each other, in this order.
"""

from __future__ import annotations

import re
import time
from types import SimpleNamespace

import pytest

from deploy_rig.booted_board import PATIENCE_S, booted_board
from deploy_rig.image import missing
from deploy_rig.master import master_on
from deploy_rig.playbooks import Playbooks
from palpate_edge.bus import BusConfig

pytestmark = pytest.mark.deploy_booted

SERVICE = "palpate-fingertip.service"
CAMERA = "/dev/v4l/by-path/platform-vivid.0-video-index0"
RECORDED = {"source": "recorded", "path": "/srv/presses", "loop": True, "timeout_ms": 10_000}
# An emulated processor needs ten times a board's time to start Python, and frames come as slowly.
SLOW = r"[Service]\nTimeoutStartSec=600s\nWatchdogSec=60s\nTimeoutStopSec=60s\n"


@pytest.fixture(scope="module")
def board(bare_board, wheels, drawn_dataset, drawn_calibration_file, tmp_path_factory):
    """A booted board on its bus, and its playbooks."""
    if (reason := missing(("qemu-system-x86_64", "qemu-system-x86"))) is not None:
        pytest.skip(reason)
    folder = tmp_path_factory.mktemp("booted")
    begin_s = time.monotonic()
    with booted_board(bare_board, folder / "board") as machine:
        print(f"boot: {time.monotonic() - begin_s:.0f} s")
        machine.put(drawn_dataset, "/srv/presses")
        # What stands for hardware, and for its slowness. The rest is the playbooks'.
        machine.run("printf 'kvaser_pci\\nvivid\\n' >/etc/modules-load.d/hardware.conf")
        machine.run("echo options vivid node_types=1 num_inputs=1 input_types=0 >/etc/modprobe.d/vivid.conf")
        drop_ins = f"/etc/systemd/system/{SERVICE}.d"
        machine.run(f"mkdir -p {drop_ins} && printf '{SLOW}' >{drop_ins}/slow.conf")
        machine.run("modprobe -a kvaser_pci vivid && systemctl mask --now serial-getty@hvc0.service")
        playbooks = Playbooks(
            folder,
            bare_board / "key",
            "fingertips",
            "finger-1",
            ansible_host="127.0.0.1",
            ansible_port=machine.ssh_port,
            ansible_timeout=120,
            release_wheelhouse=str(wheels),
            release_patience_s=600,
            fingertip_calibration=str(drawn_calibration_file),
            fingertip_capture=RECORDED,
        )
        yield SimpleNamespace(machine=machine, playbooks=playbooks, folder=folder)


def play(board, book, *words, **variables):
    begin_s = time.monotonic()
    played = board.playbooks.play(book, *words, prefix=[], **variables)
    print(f"{book} {' '.join(words)}: {played.changed} changed, {time.monotonic() - begin_s:.0f} s")
    return played


def shown(board, name):
    return board.machine.run(f"systemctl show --value --property={name} {SERVICE}")


def wait_for_contact(board):
    """Of the host outside, over slcan on loopback."""
    board.machine.join_bus()
    config = BusConfig(interface="slcan", channel=f"socket://127.0.0.1:{board.machine.bus_port}")
    with master_on(config) as master:
        begin_s = time.monotonic()
        print(f"a valid contact outside after {master.contact_after(begin_s, PATIENCE_S):.1f} s")


def test_a_bare_board_is_made_to_serve_a_host_outside(board):
    play(board, "site").well()
    assert shown(board, "ActiveState") == "active"
    assert "can state ERROR-ACTIVE" in board.machine.run("ip -details link show can0")
    assert "bitrate 1000000" in board.machine.run("ip -details link show can0")
    wait_for_contact(board)


def test_a_second_run_changes_nothing(board):
    assert play(board, "site").well().changed == 0


def test_nothing_listens_but_ssh(board):
    rows = board.machine.run("ss --no-header --listening --tcp --udp --processes --numeric")
    assert rows
    assert all('"sshd"' in row and re.search(r":22\s", row) for row in rows.splitlines()), rows


def test_can_goes_down_and_comes_back(board):
    board.machine.run("ip link set can0 down")
    board.machine.wait_for(lambda: "the bus is down" in journal(board))
    board.machine.run("ip link set can0 up")
    board.machine.wait_for(lambda: "the bus is up" in journal(board))
    wait_for_contact(board)


def journal(board):
    return board.machine.run(f"journalctl --boot --unit {SERVICE} --output=cat")


def test_a_killed_service_comes_back(board):
    before = int(shown(board, "NRestarts"))
    begin_s = time.monotonic()
    board.machine.run(f"systemctl kill --signal=KILL {SERVICE}")
    board.machine.wait_for(lambda: int(shown(board, "NRestarts")) > before)
    board.machine.wait_for(lambda: shown(board, "ActiveState") == "active")
    print(f"kill -9 to ready: {time.monotonic() - begin_s:.1f} s")
    wait_for_contact(board)


def test_a_full_disk_stops_nothing_that_serves(board):
    board.machine.run("dd if=/dev/zero of=/var/tmp/full bs=1M status=none || true")
    assert board.machine.run("df --output=avail / | tail -1").strip() == "0"
    pid = shown(board, "MainPID")
    wait_for_contact(board)
    board.machine.run(f"systemctl restart {SERVICE}")
    assert shown(board, "MainPID") != pid
    wait_for_contact(board)
    board.machine.run("rm /var/tmp/full")


def test_a_board_serves_after_its_power_was_cut(board):
    release = board.machine.run("readlink /opt/palpate/current")
    board.machine.power_cut()
    begin_s = time.monotonic()
    board.machine.boot()
    board.machine.wait_for(lambda: shown(board, "ActiveState") == "active")
    print(f"power to ready: {time.monotonic() - begin_s:.0f} s")
    assert board.machine.run("readlink /opt/palpate/current") == release
    wait_for_contact(board)


def test_power_cut_on_trial_goes_back(board):
    """The disk is what the machine had given out to it, no more."""
    old = board.machine.run("readlink /opt/palpate/current").removeprefix("releases/")
    board.machine.run(f"cp -a /opt/palpate/releases/{old} /opt/palpate/releases/another && sync")
    board.machine.run("(/opt/palpate/bin/palpate-release switch another >/dev/null 2>&1 &)")
    board.machine.wait_for(lambda: board.machine.run("readlink /opt/palpate/current") == "releases/another")
    board.machine.power_cut()
    board.machine.boot()
    board.machine.wait_for(lambda: shown(board, "ActiveState") == "active")
    assert board.machine.run("readlink /opt/palpate/current") == f"releases/{old}"
    wait_for_contact(board)


def test_a_camera_that_goes_is_told_and_found_again(board):
    """vivid's picture has no beads: the contact is refused for that, and for the camera once it is gone."""
    camera = {"source": "v4l2", "path": CAMERA, "timeout_ms": 10_000}
    play(board, "site", fingertip_capture=camera)  # its check fails in beads: told, and nothing to go back to
    board.machine.wait_for(lambda: shown(board, "ActiveState") == "active")
    board.machine.run(f"v4l2-ctl -d {CAMERA} -c disconnect=1")
    board.machine.wait_for(lambda: "camera gives frames again" in journal(board))
