"""A hand's host and a fingertip from bare Debian by one run of the playbooks, in namespaces.

On their bus, the local hub, are simulated drives and two more fingertips from these sources. All of it
shares this machine's cores: the host waits longer for a drive's position, and its watchdog for the host.
The tests go on from each other, in this order.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from types import SimpleNamespace

import pytest

from deploy_rig.image import PROJECT, changed_sources, wheelhouse
from deploy_rig.namespace_board import namespace_board
from deploy_rig.playbooks import Playbooks
from palpate_edge.can_bus.bus import BusConfig, open_bus

pytestmark = pytest.mark.deploy_hand

EDGE, HOST = "palpate_edge.cli.main", "palpate_host.cli.main"
SERVICE = "palpate-host.service"
SERVICES = {"finger-1": "palpate-fingertip.service", "hand": SERVICE}
GATEWAY = "palpate-az.service"
ADAPTER = "/run/adapter"
AZ_TOML = f"""
[bus]
interface = "palpate"
channel = "/run/outside/hub.sock"

[[ports]]
path = "{ADAPTER}"
parity = "none"
axes = [{{drive_node = 20, device_id = 1, torque_limit_Nm = 0.5}}]
"""
PATIENCE_S = 60.0
MOST_EXPOSED = 1.5  # of 10
POSITIONS = "joint_stop_ms = 100"
BUSY = "[Service]\nWatchdogSec=10s\n"
BUS = re.compile(r"^\[bus\]\n(?:(?!\[).*\n)*", re.MULTILINE)


@pytest.fixture(scope="module")
def hand(bare_board, python, drawn_dataset, drawn_calibration_file, tmp_path_factory):
    """The two boards, what stands on their bus beside them, and the playbooks."""
    folder = tmp_path_factory.mktemp("hand")
    wheels = wheelhouse(folder / "wheelhouse", parts=("edge", "host"), python=python, key=bare_board / "key")
    table_4 = (PROJECT / "host/palpate_host/models/table4.toml").read_text()
    assert POSITIONS in table_4
    table_4 = table_4.replace(POSITIONS, "joint_stop_ms = 3000")
    with ExitStack() as stack:
        boards = {
            name: stack.enter_context(namespace_board(folder / name, bare_board / "tree"))
            for name in SERVICES
        }
        (boards["hand"].outside / "busy.conf").write_text(BUSY)
        for service in (SERVICE, GATEWAY):
            busy = f"/etc/systemd/system/{service}.d/busy.conf"
            boards["hand"].run("install", "-D", "-m", "644", "/run/outside/busy.conf", busy)
        shutil.copytree(drawn_dataset, boards["finger-1"].outside / "presses")
        hub = folder / "hub.sock"

        def outside(program, *words):
            command = [sys.executable, "-m", program, *words]
            log = folder / f"{len(list(folder.glob('*.log')))}.log"
            process = stack.enter_context(
                subprocess.Popen(command, stderr=stack.enter_context(log.open("w")))
            )
            stack.callback(process.terminate)
            return SimpleNamespace(process=process, log=log)

        outside(HOST, "bus", "hub", "--socket", str(hub), "--txqueuelen", "512")  # of a busy PC
        wait_for(hub.exists)
        hub.chmod(0o666)  # the boards' user is another
        for board in boards.values():
            os.link(hub, board.outside / "hub.sock")
        hand_toml, drives_toml = folder / "hand.toml", folder / "drives.toml"
        for file, socket in ((hand_toml, "/run/outside/hub.sock"), (drives_toml, hub)):
            text = BUS.sub(f'[bus]\ninterface = "palpate"\nchannel = "{socket}"\n\n', table_4)
            file.write_text(text)
        drives = outside(HOST, "drives", "--config", str(drives_toml))
        for node in (0x11, 0x12):
            config = folder / f"{node}.toml"
            config.write_text(
                f'name = "outside-{node}"\n[capture]\nsource = "recorded"\npath = "{drawn_dataset}"\n'
                f'loop = true\n[estimator]\ncalibration = "{drawn_calibration_file}"\n[node]\nid = {node}\n'
                f'[bus]\ninterface = "palpate"\nchannel = "{hub}"\n'
            )
            outside(EDGE, "run", "--config", str(config))
        finger = {
            **boards["finger-1"].ssh,
            "fingertip_calibration": str(drawn_calibration_file),
            "fingertip_capture": {"source": "recorded", "path": "/run/outside/presses", "loop": True},
            "fingertip_bus": {"interface": "palpate", "channel": "/run/outside/hub.sock"},
        }
        host = {**boards["hand"].ssh, "ansible_host": "127.0.0.2", "host_hand_file": str(hand_toml)}
        playbooks = Playbooks(
            folder, bare_board / "key", {"fingertips": {"finger-1": finger}, "hands": {"hand": host}}
        )
        yield SimpleNamespace(
            boards=boards, playbooks=playbooks, wheels=wheels, drives=drives, folder=folder, hub=hub
        )


def wait_for(condition, patience_s=PATIENCE_S):
    end_s = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.1)


def play(hand, book, **variables):
    begin_s = time.monotonic()
    played = hand.playbooks.play(book, release_wheelhouse=str(hand.wheels), **variables)
    print(f"{book} on a fingertip and a host: {played.changed} changed, {time.monotonic() - begin_s:.0f} s")
    return played.well()


def shown(hand, service, name):
    return hand.boards["hand"].run("systemctl", "show", "--value", f"--property={name}", service)


def state(hand, service):
    return shown(hand, service, "ActiveState")


def as_user(hand, user, *words):
    """`palpate-host command` as a person on the host types it: its exit status and its words."""
    command = f"palpate-host command {' '.join(words)} 2>&1; echo exit status $?"
    said = hand.boards["hand"].run("runuser", "--login", user, "--command", command)
    text, _, status = said.rpartition("exit status ")
    return int(status), text.strip()


def test_a_hand_is_provisioned(hand):
    play(hand, "site")
    for name, service in SERVICES.items():
        assert hand.boards[name].run("systemctl", "is-active", service) == "active"
    wait_for(lambda: as_user(hand, "root", "status")[1].startswith("ready: "))
    print(as_user(hand, "root", "status")[1])


def test_a_second_run_changes_nothing(hand):
    assert play(hand, "site").changed == 0


@pytest.mark.parametrize("name", SERVICES)
def test_what_a_board_is(hand, name):
    board = hand.boards[name]
    rows = board.run("ss", "--no-header", "--listening", "--tcp", "--udp", "--processes", "--numeric")
    assert rows
    others = [row for row in rows.splitlines() if not ('"sshd"' in row and re.search(r":22\s", row))]
    time_servers = [row for row in others if '"chronyd"' in row and re.search(r":123\s", row)]
    assert bool(time_servers) == (name == "hand"), rows
    others = [row for row in others if row not in time_servers]
    assert all('"avahi-daemon"' in row and row.startswith("udp") for row in others), rows
    assert board.run("systemctl", "--failed", "--no-legend") == ""
    unsafe = board.run("find", "/etc/palpate", "/opt/palpate", "-perm", "/022", "-not", "-type", "l")
    assert unsafe == ""


def test_a_fingertip_has_its_time_from_the_host(hand):
    """The host is 127.0.0.2 in the inventory; it answers private networks and no others."""
    assert "127.0.0.2" in hand.boards["finger-1"].run("chronyc", "-n", "sources")
    board = hand.boards["hand"]
    for address, answer in (("192.168.7.1", "System clock wrong by"), ("203.0.113.1", "Timeout reached")):
        board.run("ip", "address", "add", f"{address}/32", "dev", "lo")
        asked = f"chronyd -Q -t 10 'server {address} iburst maxsamples 1' 2>&1"
        assert answer in board.run("sh", "-c", asked, check=False)


@pytest.mark.parametrize(("name", "service"), SERVICES.items())
def test_the_services_as_the_board_has_them(hand, name, service):
    board = hand.boards[name]
    verify = f"cd /etc/systemd/system && systemd-analyze verify {service} palpate.target 2>&1"
    said = board.run("sh", "-c", verify)
    assert [line for line in said.splitlines() if "palpate" in line] == []
    overall = board.run("sh", "-c", f"cd / && systemd-analyze security --no-pager {service}")
    exposure = float(re.findall(r"Overall exposure level for \S+: ([\d.]+)", overall)[0])
    print(f"{service}: exposure {exposure}")
    assert exposure <= MOST_EXPOSED


def test_the_group_commands_the_hand_and_others_do_not(hand):
    board = hand.boards["hand"]
    board.run("useradd", "--create-home", "--groups", "palpate", "pilot")
    board.run("useradd", "--create-home", "stranger")
    mode = board.run("stat", "--format=%U:%G %a", "/run/palpate-host", "/run/palpate-host/palpate-host.sock")
    assert mode.splitlines() == ["palpate:palpate 750", "palpate:palpate 660"]
    assert as_user(hand, "pilot", "status")[0] == 0
    status, said = as_user(hand, "stranger", "status")
    assert status == 9
    assert "Permission denied" in said


def links(board):
    return board.run("readlink", "/opt/palpate/current", "/opt/palpate/previous", check=False)


def test_a_hand_is_updated_whole_or_not_at_all(hand, bare_board, python, tmp_path):
    """The new release runs on the fingertip, which is switched first, and not on the host."""
    sources = changed_sources(
        tmp_path / "sources",
        "host/palpate_host/cli/run.py",
        "CONFIG = ",
        "raise RuntimeError('bad')\nCONFIG = ",
    )
    packages = tmp_path / "packages"
    for folder in hand.wheels.glob("cp*/*/x86_64"):
        shutil.copytree(folder, packages, dirs_exist_ok=True)
    broken = wheelhouse(
        tmp_path / "house",
        sources,
        parts=("edge", "host"),
        packages=packages,
        python=python,
        key=bare_board / "key",
    )
    before = {name: links(board) for name, board in hand.boards.items()}
    played = hand.playbooks.play("update", release_wheelhouse=str(broken), release_patience_s=20)
    assert played.status != 0
    assert played.tells("no board of the hand has the new release"), played.said
    assert {name: links(board) for name, board in hand.boards.items()} == before
    wait_for(lambda: as_user(hand, "root", "status")[1].startswith("ready: "))


def test_a_hand_in_use_is_not_restarted_unasked(hand):
    assert as_user(hand, "root", "grasp") == (0, "")
    wait_for(lambda: re.match("grasp|manipulate|hold|blind", as_user(hand, "root", "status")[1]))
    played = hand.playbooks.play("update", release_wheelhouse=str(hand.wheels), release_interrupt=False)
    assert played.status != 0
    assert played.tells("would interrupt it"), played.said
    assert re.match("grasp|manipulate|hold|blind", as_user(hand, "root", "status")[1])


def test_an_operator_lets_the_hand_grasp_and_stops_it(hand):
    assert as_user(hand, "pilot", "grasp")[0] in (0, 8)  # 8: it grasps already
    wait_for(lambda: re.match("grasp|manipulate|hold|blind", as_user(hand, "pilot", "status")[1]))
    print(as_user(hand, "pilot", "status")[1])
    assert as_user(hand, "pilot", "stop") == (0, "")
    wait_for(lambda: as_user(hand, "pilot", "status")[1].startswith("stop: "))


def test_a_hung_host_is_ended_by_its_watchdog(hand):
    """The bad release of the update has failed before."""
    board = hand.boards["hand"]
    before, begin_s = len(board.failures(SERVICE)), time.monotonic()
    pid = board.run("systemctl", "show", "--value", "--property=MainPID", SERVICE)
    assert pid != "0"
    board.run("kill", f"-{signal.SIGSTOP.value}", pid)
    wait_for(lambda: board.failures(SERVICE)[before:] == ["watchdog"])
    wait_for(lambda: as_user(hand, "pilot", "status")[1].startswith("ready: "))
    print(f"hang to ready: {time.monotonic() - begin_s:.1f} s, 10 s of them the watchdog's")


def plug_adapter_in(hand):
    """A simulated drive on the board behind a pseudo terminal; its group is the one that udev gives."""
    board = hand.boards["hand"]
    simulate = "/usr/local/bin/palpate-host az simulate --config /run/outside/az.toml"
    board.run("systemd-run", "--quiet", "--collect", "--unit=adapter", *simulate.split())
    wait_for(lambda: board.run("ls", ADAPTER, check=False))
    board.run("sh", "-c", f"t=$(readlink -f {ADAPTER}) && chgrp dialout $t && chmod 660 $t")


def test_a_gateway_is_added(hand):
    az_toml = hand.folder / "az.toml"
    az_toml.write_text(AZ_TOML)
    shutil.copy(az_toml, hand.boards["hand"].outside)
    assert state(hand, GATEWAY) == "inactive"
    plug_adapter_in(hand)
    play(hand, "site", host_az_file=str(az_toml))
    assert (state(hand, GATEWAY), state(hand, SERVICE)) == ("active", "active")
    board = hand.boards["hand"]
    assert board.run("systemctl", "is-enabled", GATEWAY) == "enabled"
    assert board.run("stat", "--format=%U:%G %a", "/etc/palpate/az.toml") == "root:palpate 640"
    with open_bus(BusConfig(interface="palpate", channel=str(hand.hub)), "test", [0x714]) as bus:
        wait_for(lambda: bus.receive(0.5))


def test_an_adapter_that_was_away_is_used_when_it_is_back(hand):
    """For seven starts, a third of what the limit is asked to bear."""
    board = hand.boards["hand"]
    before = len(board.failures(GATEWAY))
    board.run("systemctl", "stop", "adapter")
    wait_for(lambda: len(board.failures(GATEWAY)) > before + 3)
    assert board.failures(GATEWAY)[before : before + 4] == ["watchdog", *["exit-code"] * 3]
    words = board.run("journalctl", "--unit", GATEWAY, "--output=cat")
    assert f"{ADAPTER}: cannot be opened" in words
    plug_adapter_in(hand)
    wait_for(lambda: state(hand, GATEWAY) == "active")


def test_the_gateway_stops_after_the_host(hand):
    board = hand.boards["hand"]
    board.run("systemctl", "stop", "palpate.target")
    wait_for(lambda: state(hand, GATEWAY) == "inactive")
    host_gone_us = int(shown(hand, SERVICE, "InactiveEnterTimestampMonotonic"))
    gateway_told_us = int(shown(hand, GATEWAY, "ActiveExitTimestampMonotonic"))
    assert 0 < host_gone_us <= gateway_told_us
    board.run("systemctl", "start", SERVICE, GATEWAY)
    assert (shown(hand, GATEWAY, "Result"), shown(hand, SERVICE, "Result")) == ("success", "success")


def test_a_gateway_that_is_not_wanted_any_more_is_off(hand):
    play(hand, "site")
    assert state(hand, GATEWAY) == "inactive"
    assert hand.boards["hand"].run("systemctl", "is-enabled", GATEWAY, check=False) == "disabled"
    wait_for(lambda: as_user(hand, "root", "status")[1].startswith("ready: "))


def test_the_drives_are_off_when_the_host_is_stopped(hand):
    hand.boards["hand"].run("systemctl", "stop", "palpate.target")
    wait_for(lambda: state(hand, SERVICE) == "inactive")
    hand.drives.process.terminate()
    hand.drives.process.wait()
    assert "9 switch on disabled" in hand.drives.log.read_text()
