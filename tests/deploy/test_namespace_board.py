"""A fingertip's board from bare Debian to contacts on a bus, by the playbooks over ssh, in namespaces.

The kernel is this machine's, so the bus is the local hub (its socket reaches into the board) and the camera a
recording; test_booted_board.py has both from a kernel. The tests go on from each other, in this order.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import time

import pytest

from deploy_rig.fingertip_board import SERVICE, fingertip_board, release_of
from deploy_rig.image import PROJECT, changed_wheelhouse
from deploy_rig.playbooks import SSH

pytestmark = pytest.mark.deploy_namespace

CHECK = "/opt/palpate/current/bin/palpate-edge check --config /etc/palpate/fingertip.toml"
WATCHED_S = float(os.environ.get("PALPATE_WATCHED_S", "10"))  # for what is written to the card
MAY_BE_WRITTEN = (  # while a provisioned board serves
    r"/var/lib/palpate/parameters.*",  # when a master stores them
    r"/var/lib/chrony/.*",  # once an hour: how fast the board's clock runs
    r"/var/(lib/apt|cache/apt|lib/dpkg|log/unattended-upgrades|log/apt)/.*",  # once a day: apt
    r"/var/lib/systemd/timers/.*",  # a stamp when a timer has run
)


@pytest.fixture(scope="module")
def board(bare_board, wheels, slow_camera, tmp_path_factory):
    folder, key = tmp_path_factory.mktemp("board"), bare_board / "key"
    with fingertip_board(folder, key, wheels, slow_camera, bare_board / "tree") as board:
        yield board


def links_of(board, python, file):
    """Return the number of releases that share a file with the active one."""
    site_packages = f"/opt/palpate/current/lib/python{python}/site-packages"
    return int(board.machine.run("stat", "--format=%h", f"{site_packages}/{file}"))


@pytest.fixture(scope="module")
def another_release(tmp_path_factory, wheels, bare_board):
    """Wheelhouses of sources with one place changed."""

    def make(name, file, old, new):
        key = bare_board / "key"
        return changed_wheelhouse(tmp_path_factory.mktemp(name), wheels, key, file, old, new)

    return make


def test_check_mode_on_a_bare_board_changes_nothing(board):
    assert board.play("site", "--check").well().changed > 0
    assert not [path for path in board.machine.files_written() if "palpate" in path]


def test_a_bare_board_is_made_to_serve(board):
    """After a run that was killed between a file and its effect."""
    killed = board.play("site", kill_after="Create palpate's folders")
    assert killed.status == -signal.SIGKILL
    board.play("site").well()
    assert board.shown("ActiveState") == "active"
    board.master.contact_after(time.monotonic())
    assert "fail" not in board.machine.run(*CHECK.split())


def test_a_second_run_changes_nothing(board):
    """Also where apt's lists are older than a day, with base_apt_update=false: no mirror is near."""
    stamps = "/var/lib/apt/lists", "/var/lib/apt/periodic/update-success-stamp"
    board.machine.run("touch", "--no-create", "--date=2 days ago", *stamps)
    assert board.play("site").well().changed == 0


def test_nothing_listens_but_ssh_and_the_name(board):
    """avahi answers for NAME.local on UDP port 5353, and asks from two ports of its own."""
    rows = board.machine.run("ss", "--no-header", "--listening", "--tcp", "--udp", "--processes", "--numeric")
    assert rows
    others = [row for row in rows.splitlines() if not ('"sshd"' in row and re.search(r":22\s", row))]
    assert all('"avahi-daemon"' in row and row.startswith("udp") for row in others), rows
    assert any(re.search(r":5353\s", row) for row in others), rows
    assert board.shown("UnitFileState", "avahi-daemon.service") == "enabled"


def test_only_security_updates_come_unasked(board):
    """By unattended-upgrades itself, as apt would start it every day."""
    log = board.machine.run("unattended-upgrade", "--dry-run", "--debug", check=False)
    assert "Allowed origins are: origin=Debian,codename=" in log, log
    (origins,) = re.findall(r"Allowed origins are: (.+)", log)
    assert all(origin.endswith("label=Debian-Security") for origin in re.split(r", (?=origin)|' '", origins))
    for timer in ("apt-daily.timer", "apt-daily-upgrade.timer"):
        assert board.shown("ActiveState", timer) == "active"


def test_updates_wait_while_the_hand_is_in_use(board):
    board.master.contact_after(time.monotonic())
    for service in ("apt-daily.service", "apt-daily-upgrade.service"):
        board.machine.run("systemctl", "start", service, check=False)
        assert board.shown("Result", service) == "exec-condition"
    board.machine.run("systemctl", "stop", SERVICE)
    time.sleep(5)  # the age of the last report
    board.machine.run("systemctl", "start", "apt-daily-upgrade.service", check=False)
    assert board.shown("Result", "apt-daily-upgrade.service") != "exec-condition"
    board.machine.run("systemctl", "start", SERVICE)
    board.master.contact_after(time.monotonic())


def test_passwords_are_refused_though_cloud_init_allows_them(board):
    """The image has 50-cloud-init.conf with PasswordAuthentication yes; the server offers keys only."""
    effective = board.machine.run("sshd", "-T").splitlines()
    for line in ("passwordauthentication no", "kbdinteractiveauthentication no", "x11forwarding no"):
        assert line in effective
    ssh = [
        board.machine.folder / "ssh",
        "-o",
        "PreferredAuthentications=none",
        *SSH.split(),
        "root@127.0.0.1",
    ]
    refused = subprocess.run(ssh, capture_output=True, text=True, check=False)
    assert refused.stderr.strip().endswith("Permission denied (publickey).")


def test_a_file_that_overrides_ssh_is_an_error(board):
    """A name before ours, as a person might write it."""
    file = "/etc/ssh/sshd_config.d/00-my-own.conf"
    board.machine.run("sh", "-c", f"echo PasswordAuthentication yes >{file}")
    played = board.play("site")
    board.machine.run("rm", file)
    assert played.status != 0
    assert played.tells("sshd -T differs from the wanted configuration in passwordauthentication no"), (
        played.said
    )


def test_a_run_killed_after_the_configuration_is_made_good_by_the_next(board):
    """The daemon has another node id loaded than its file has: the next run compares them."""
    before = board.shown("MainPID")
    killed = board.play("site", kill_after="Write the fingertip's configuration", fingertip_node_id="0x11")
    assert killed.status == -signal.SIGKILL
    assert board.shown("MainPID") == before
    assert "id = 17" in board.machine.run("cat", "/etc/palpate/fingertip.toml")
    rows = json.loads(board.machine.run(*CHECK.split(), "--json", check=False))
    assert [row["verdict"] for row in rows if row["part"] == "configuration"] == ["warn"]
    assert board.play("site", fingertip_node_id="0x11").well().changed == 1
    assert board.shown("MainPID") != before
    health = json.loads(board.machine.run("cat", "/run/palpate/palpate-finger-1.json"))
    assert health["node_id"] == 0x11
    board.play("site").well()
    board.master.contact_after(time.monotonic())
    assert board.play("site").well().changed == 0


def test_a_drop_in_that_was_not_loaded_is_loaded_by_the_next_switch(board):
    file, switch = f"/etc/systemd/system/{SERVICE}.d/own.conf", "/opt/palpate/bin/palpate-release"
    for write, nice in ((f"printf '[Service]\\nNice=7\\n' >{file}", "7"), (f"rm {file}", "0")):
        board.machine.run("sh", "-c", write)
        assert board.machine.run(switch, "--interrupt", "switch", board.serving()) == f"started {SERVICE}"
        assert board.machine.run("ps", "-o", "ni=", "-p", board.shown("MainPID")).strip() == nice
        assert board.machine.run(switch, "switch", board.serving()) == f"unchanged: {board.serving()}"
    board.master.contact_after(time.monotonic())


def test_nothing_failed(board):
    assert board.machine.run("systemctl", "--failed", "--no-legend") == ""


def test_files_that_decide_are_roots_and_no_secret(board):
    files = board.machine.run("find", "/etc/palpate", "/opt/palpate", "-perm", "/022", "-not", "-type", "l")
    assert files == ""
    owners = board.machine.run("stat", "--format=%U:%G %a", "/etc/palpate", "/etc/palpate/fingertip.toml")
    assert owners.splitlines() == ["root:palpate 750", "root:palpate 640"]


def test_a_configuration_that_everybody_may_write_is_refused(board):
    board.machine.run("chmod", "666", "/etc/palpate/fingertip.toml")
    board.machine.run("systemctl", "restart", SERVICE, check=False)
    assert (board.shown("ActiveState"), board.shown("ExecMainStatus")) == ("failed", "2")
    log = board.machine.run("journalctl", "--unit", SERVICE, "--lines=20", "--output=cat")
    assert "/etc/palpate/fingertip.toml may be written by everybody (mode 666): chmod o-w" in log
    board.machine.run("chmod", "640", "/etc/palpate/fingertip.toml")
    board.machine.run("systemctl", "start", SERVICE)
    board.master.contact_after(time.monotonic())


def test_a_killed_service_comes_back(board):
    before = int(board.shown("NRestarts"))
    begin_s = time.monotonic()
    board.machine.run("kill", "-KILL", board.shown("MainPID"))
    print(f"kill -9 to the next valid contact: {board.master.contact_after(begin_s + 0.2) + 0.2:.1f} s")
    assert int(board.shown("NRestarts")) > before
    assert board.machine.failures(SERVICE)[-1] == "signal"


def test_a_hung_service_is_ended_by_its_watchdog(board):
    before, pid = int(board.shown("NRestarts")), board.shown("MainPID")
    failures = board.machine.failures(SERVICE)
    begin_s = time.monotonic()
    board.machine.run("kill", f"-{signal.SIGSTOP.value}", pid)
    took_s = board.master.contact_after(begin_s + 0.5) + 0.5
    print(f"hang to the next valid contact: {took_s:.1f} s, 2 s of them the watchdog's")
    assert int(board.shown("NRestarts")) > before
    assert board.shown("MainPID") != pid
    assert board.machine.failures(SERVICE) == [*failures, "watchdog"]


@pytest.fixture
def soon_given_up(board):
    """The unit's start limit at its own rate, 4 s a start, after four starts in place of sixty; more words go
    into the same file."""
    file = f"/run/systemd/system/{SERVICE}.d/soon.conf"

    def write(more=""):
        text = f"[Unit]\nStartLimitIntervalSec=16s\nStartLimitBurst=4\n{more}"
        (board.machine.outside / "soon.conf").write_text(text)
        board.machine.run("install", "-D", "-m", "644", "/run/outside/soon.conf", file)
        board.machine.run("systemctl", "daemon-reload")
        board.machine.run("systemctl", "reset-failed", SERVICE)

    assert board.shown("StartLimitBurst") == "60"
    assert board.shown("StartLimitIntervalUSec") == "4min"
    write()
    yield write
    board.machine.run("rm", file)
    board.machine.run("systemctl", "daemon-reload")


def wait_for(condition, patience_s=120.0):
    end_s = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.1)


def test_a_bus_that_is_away_is_waited_for_and_a_crash_loop_ends(board, soon_given_up):
    machine, before = board.machine, len(board.machine.failures(SERVICE))
    hub, away = machine.outside / "hub.sock", machine.outside / "hub.away"
    hub.rename(away)
    machine.run("systemctl", "restart", SERVICE, check=False)
    wait_for(lambda: len(machine.failures(SERVICE)) >= before + 7)
    away.rename(hub)
    board.master.contact_after(time.monotonic())
    soon_given_up("[Service]\nExecStart=\nExecStart=/bin/false\n")
    before = len(machine.failures(SERVICE))
    machine.run("systemctl", "restart", SERVICE, check=False)
    wait_for(lambda: board.shown("ActiveState") == "failed")
    assert machine.failures(SERVICE)[before:][:4] == ["exit-code"] * 4
    soon_given_up()
    machine.run("systemctl", "start", SERVICE)
    board.master.contact_after(time.monotonic())


def test_a_release_that_dies_is_rolled_back(board, another_release):
    before, begin_s = board.serving(), time.monotonic()
    broken = another_release(
        "dies",
        "edge/palpate_edge/daemon/daemon.py",
        "    cv2.setNumThreads(1)\n",
        "    raise RuntimeError('bad')\n",
    )
    played = board.play("update", release_wheelhouse=str(broken), release_patience_s=8)
    assert played.status != 0
    assert played.tells(f"release {release_of(broken)} was not healthy"), played.said
    assert played.tells(f"{before} is active again"), played.said
    assert board.serving() == before
    board.master.contact_after(time.monotonic())
    print(f"without contacts: {board.master.longest_gap_s(begin_s):.1f} s, 8 s of them the patience")


def test_a_dead_release_is_never_blessed_though_the_switch_was_killed(board, another_release):
    """The program that watches the trial is killed; the next update finds the dead release as the current."""
    before, links = board.serving(), board.machine.run("readlink", "/opt/palpate/previous", check=False)
    broken = another_release(
        "killed",
        "edge/palpate_edge/daemon/daemon.py",
        "    cv2.setNumThreads(1)\n",
        "    raise RuntimeError\n",
    )
    name = release_of(broken)
    install = board.play("update", kill_after="Mark the release as complete", release_wheelhouse=str(broken))
    assert install.status == -signal.SIGKILL
    switch = board.machine.begin("/opt/palpate/bin/palpate-release", "--interrupt", "switch", name)
    wait_for(lambda: board.serving() == name)
    board.machine.run("pkill", "--full", "^/usr/bin/python3 /opt/palpate/bin/palpate-release")
    switch.wait()
    assert board.serving() == name
    played = board.play("update", release_wheelhouse=str(broken), release_patience_s=8)
    assert played.status != 0
    assert played.tells(f"{before} is active again"), played.said
    assert board.serving() == before
    assert board.machine.run("readlink", "/opt/palpate/previous", check=False) == links
    board.master.contact_after(time.monotonic())


def test_a_release_that_sees_nothing_is_rolled_back(board, another_release):
    """The service runs with its watchdog; its check reports that every frame is rejected."""
    before = board.serving()
    blind = another_release(
        "blind",
        "edge/palpate_edge/common/contact.py",
        "MIN_BEADS_SHARE = 0.",
        "MIN_BEADS_SHARE = 1 + 0.",
    )
    played = board.play("update", release_wheelhouse=str(blind), release_patience_s=8)
    assert played.status != 0
    assert played.tells("palpate-edge check fails in beads"), played.said
    assert board.serving() == before
    board.master.contact_after(time.monotonic())


def test_a_fingertip_in_operational_is_not_restarted_unasked(board, another_release):
    newer = another_release("asked", "edge/palpate_edge/__init__.py", '"""palpate_edge:', '"""palpate_edge !')
    before, pid = board.serving(), board.shown("MainPID")
    board.master.contact_after(time.monotonic())
    for book, variables in (
        ("update", {"release_wheelhouse": str(newer)}),
        ("site", {"fingertip_node_id": "0x11"}),
    ):
        played = board.play(book, release_interrupt=False, **variables)
        assert played.status != 0
        assert played.tells("the fingertip is OPERATIONAL"), played.said
        assert (board.serving(), board.shown("MainPID")) == (before, pid)
    board.play("site").well()
    assert board.shown("MainPID") == pid


def changed(wheels, copy, name):
    """A copy of a wheelhouse with one byte of one file changed."""
    shutil.copytree(wheels, copy)
    (file,) = copy.glob(name)
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    return copy


@pytest.mark.parametrize(
    "name", ["cp*/MANIFEST.json", "cp*/MANIFEST.json.sig", "cp*/edge/x86_64/palpate-*.whl"]
)
def test_a_release_with_one_byte_changed_is_not_unpacked(board, another_release, tmp_path, name):
    newer = another_release("byte", "edge/palpate_edge/__init__.py", '"""palpate_edge:', '"""palpate_edge ?')
    before = board.serving()
    bad = changed(newer, tmp_path / "bad", name)
    played = board.play("update", release_wheelhouse=str(bad))
    assert played.status != 0
    assert played.tells("is not of a key in" if "MANIFEST" in name else "differs from MANIFEST.json"), (
        played.said
    )
    assert board.machine.run("ls", "/opt/palpate/releases").split().count(release_of(newer)) == 0
    assert board.machine.run("find", "/opt/palpate/incoming", "-name", "*.whl", check=False) == ""
    assert board.serving() == before


def test_an_unsigned_release_is_refused(board, another_release, tmp_path):
    newer = another_release("plain", "edge/palpate_edge/__init__.py", '"""palpate_edge:', '"""palpate_edge #')
    (signature,) = newer.glob("cp*/MANIFEST.json.sig")
    signature.unlink()
    played = board.play("update", release_wheelhouse=str(newer))
    assert played.status != 0
    assert played.tells("is not signed") or played.tells("is not of a key in"), played.said


def test_a_release_is_switched_to_and_back(board, another_release, wheels, python):
    begin_s = time.monotonic()
    newer = another_release("newer", "edge/palpate_edge/__init__.py", '"""palpate_edge:', '"""palpate_edge :')
    board.play("update", release_wheelhouse=str(newer)).well()
    assert board.serving() == release_of(newer)
    board.master.contact_after(time.monotonic())
    # Of others it has the same files, of palpate its own.
    assert links_of(board, python, "numpy/__init__.py") > 1
    assert links_of(board, python, "palpate_edge/__init__.py") == 1
    board.play("rollback").well()
    assert board.serving() == release_of(wheels)
    board.master.contact_after(time.monotonic())
    print(f"an update and a rollback, longest without contacts: {board.master.longest_gap_s(begin_s):.1f} s")
    # What neither serves nor did before is gone.
    releases = board.machine.run("ls", "/opt/palpate/releases").split()
    assert set(releases) == {release_of(wheels), release_of(newer)}


def test_a_power_cut_while_a_release_is_on_trial_goes_back(board, wheels):
    old = board.serving()
    new = next(name for name in board.machine.run("ls", "/opt/palpate/releases").split() if name != old)
    with board.machine.begin("/opt/palpate/bin/palpate-release", "--interrupt", "switch", new):
        while board.serving() != new:
            time.sleep(0.02)
        board.machine.power_cut()
    board.machine.boot()
    assert board.serving() == old
    assert "power was cut while" in board.machine.run("journalctl", "--unit=palpate-settle", "--output=cat")
    assert board.machine.run("ls", "/opt/palpate/trial", check=False) == ""
    board.master.contact_after(time.monotonic())


def test_a_power_cut_during_an_installation_is_made_good_by_the_next(board, another_release):
    new = another_release("cut", "edge/palpate_edge/__init__.py", '"""palpate_edge:', '"""palpate_edge;')
    half = f"/opt/palpate/releases/{release_of(new)}"
    board.machine.run("mkdir", "-p", f"{half}/bin")
    switch = f"/opt/palpate/bin/palpate-release --interrupt switch {release_of(new)} 2>&1"
    assert "is not completely installed" in board.machine.run("sh", "-c", switch, check=False)
    board.play("update", release_wheelhouse=str(new)).well()
    assert board.serving() == release_of(new)


def test_little_is_written_to_the_card(board):
    before = board.machine.files_written()
    time.sleep(WATCHED_S)
    after = board.machine.files_written()
    written = [path for path, at_ns in after.items() if before.get(path) != at_ns]
    print(f"written in {WATCHED_S:.0f} s: {', '.join(written) or 'nothing'}")
    assert [path for path in written if not any(re.fullmatch(one, path) for one in MAY_BE_WRITTEN)] == []


def test_logs_are_collected(board):
    board.play("collect-logs", "-e", f"collect_into={board.folder / 'collected'}").well()
    text = (board.folder / "collected" / "finger-1.txt").read_text()
    for part in (
        "palpate-release status",
        "current ",
        "=== journalctl",
        "node 0x10 on palpate",
    ):
        assert part in text
    assert re.search(r"^(ok|warn) +camera +\d", text, re.MULTILINE)  # a busy machine may drop frames


def test_a_board_without_anything_to_blink_says_so(board):
    played = board.play("identify")
    assert played.status != 0
    assert played.tells("finger-1 has no LED ring"), played.said
    assert played.tells("this board has no LED /sys/class/leds/ACT"), played.said


def test_flashing_without_a_programmer_leaves_the_fingertip_serving(board):
    """And a controller that has this program already is left alone."""
    program, flashed = board.folder / "none.hex", "/opt/palpate/illumination.flashed"
    program.write_text(":00000001FF\n")
    played = board.play("site", "--tags", "illumination", illumination_firmware=str(program))
    assert played.status != 0
    assert played.tells("/dev/spidev0.1"), played.said
    assert board.machine.run("find", "/opt/palpate", "-name", "illumination.flashed") == ""
    board.master.contact_after(time.monotonic())
    fuses = re.findall("-U [lhe]fuse:w:0x..:m", (PROJECT / "firmware/board/README.md").read_text())
    has = f"{hashlib.sha1(program.read_bytes()).hexdigest()} {' '.join(fuses)}"
    board.machine.run("sh", "-c", f"printf %s '{has}' >{flashed}; chmod 644 {flashed}")
    assert (
        board.play("site", "--tags", "illumination", illumination_firmware=str(program)).well().changed == 0
    )
