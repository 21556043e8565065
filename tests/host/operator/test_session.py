"""`Hand` and `palpate-host command` against a host on the local hub, with simulated drives and fingertips."""

import itertools
import json
import os
import signal
import subprocess
import sys
import time

import pytest
from tests.host.hand_on_hub import CLI, PATIENCE_S, TIPS, Running, patient_hand, put_on_the_bus

from palpate_edge.common.errors import PalpateError
from palpate_host import Hand
from palpate_host.common.command import CommandError
from palpate_host.common.mode import Mode
from palpate_host.operator.client import NoHostError
from palpate_host.operator.session import HandStoppedError

pytestmark = pytest.mark.usefixtures("real_time")


@pytest.fixture
def running():
    made = Running()
    yield made
    made.stop()


@pytest.fixture
def config(tmp_path, running):
    """Table 4's hand, everything but its host being on the hub."""
    path = patient_hand(tmp_path)
    put_on_the_bus(running, path)
    return path


def command(socket_path, *words):
    return subprocess.run(
        [*CLI, "command", "--socket", str(socket_path), *map(str, words)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


def test_grasp_rotate_release_and_every_tick_between(config, tmp_path):
    """The README's example: no host runs, so one is started, and ends with the block."""
    with Hand.open(config, tmp_path / "s", timeout_s=PATIENCE_S) as hand:
        pid = hand._process._process.pid
        assert hand.status().mode is Mode.READY
        with pytest.raises(CommandError, match=r"rotate is refused in mode ready .*grasp first"):
            hand.rotate(rpy_deg=(5, 0, 0))
        assert hand.grasp(PATIENCE_S).mode is Mode.GRASP
        turned = hand.rotate(rpy_deg=(0, 0, 5), ramp_s=0.3)
        assert turned.mode is Mode.MANIPULATE and turned.target_rpy_deg == (0.0, 0.0, 5.0)
        ticks = [sample.counters.ticks for sample in itertools.islice(hand.stream(), 20)]
        assert ticks == sorted(set(ticks))
        assert hand.release().mode is Mode.READY
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert not (tmp_path / "s").exists()


def test_a_killed_drive_is_a_fault_and_comes_back_without_a_restart_of_the_others(config, tmp_path, running):
    """kill -9 of the drives' process, then a new one, then recover: host and fingertips go on."""
    with Hand.open(config, tmp_path / "s", timeout_s=PATIENCE_S) as hand:
        hand.grasp(PATIENCE_S)
        running.kill("drives")
        with pytest.raises(HandStoppedError, match=r"drive of|no position"):
            hand.wait_for(lambda _status: False, PATIENCE_S, "go on")
        running.start(
            "drives", *CLI, "drives", "--config", config, "--pose-rad", 0, 0.348, 1.221, until="sim"
        )
        hand.recover(PATIENCE_S)
        assert hand.grasp(PATIENCE_S).mode is Mode.GRASP


def test_killed_fingertips_leave_only_the_grasp_and_come_back_by_themselves(config, tmp_path, running):
    with Hand.open(config, tmp_path / "s", timeout_s=PATIENCE_S) as hand:
        hand.grasp(PATIENCE_S)
        hand.rotate(rpy_deg=(0, 0, 2), ramp_s=0.1)
        running.kill("fingertips")
        hand.wait_for(lambda s: s.mode is Mode.HOLD, PATIENCE_S, "hold")
        running.start("fingertips", sys.executable, TIPS, config, until="on the bus")
        hand.wait_for(lambda s: s.mode is Mode.MANIPULATE, PATIENCE_S, "turn again")


def test_a_killed_hub_is_a_fault_and_a_new_one_is_found(config, tmp_path, running):
    """kill -9 of the bus, then a new one with new nodes on it, then recover: the host goes on."""
    with Hand.open(config, tmp_path / "s", timeout_s=PATIENCE_S) as hand:
        hand.grasp(PATIENCE_S)
        running.kill("hub")
        with pytest.raises(HandStoppedError, match=r"fault: .*the CAN hub at .* has stopped"):
            hand.wait_for(lambda _status: False, PATIENCE_S, "go on")
        for name in ("drives", "fingertips"):
            running.kill(name)
        with pytest.raises(CommandError, match=r"recover is refused .*the bus is lost"):
            hand.recover(PATIENCE_S)
        ticks = [sample.counters.ticks for sample in itertools.islice(hand.stream(), 5)]
        assert ticks == sorted(set(ticks))
        hand.wait_for(lambda s: "no CAN bus at" in s.warning, PATIENCE_S, "try again", stops=False)
        put_on_the_bus(running, config)
        back = hand.wait_for(lambda s: not s.warning, PATIENCE_S, "find the hub", stops=False)
        assert back.mode is Mode.FAULT
        hand.recover(PATIENCE_S)
        assert hand.grasp(PATIENCE_S).mode is Mode.GRASP


def test_a_killed_host_leaves_no_torque_and_a_new_one_takes_over(config, tmp_path):
    """Its socket is left over; the drives' watchdogs fault them, the next host resets that."""
    with Hand.open(config, tmp_path / "s", timeout_s=PATIENCE_S) as hand:
        hand.grasp(PATIENCE_S)
        hand._process._process.send_signal(signal.SIGKILL)
        with pytest.raises(NoHostError):
            hand.wait_for(lambda _status: False, PATIENCE_S, "go on")
    with Hand.open(config, tmp_path / "s", timeout_s=PATIENCE_S) as hand:
        assert hand.grasp(PATIENCE_S).mode is Mode.GRASP


def test_the_command_line(config, tmp_path):
    path = tmp_path / "s"
    nobody = command(path, "grasp")
    assert nobody.returncode == 9 and nobody.stderr.startswith(
        "error: no hand is running; start one: palpate-host run"
    )
    assert f"control socket {path}" in nobody.stderr
    with Hand.open(config, path, timeout_s=PATIENCE_S) as hand:
        refused = command(path, "rotate", 0, 0, 5)
        assert refused.returncode == 8 and "grasp first" in refused.stderr and refused.stderr.count("\n") == 1
        assert command(path, "grasp").returncode == 0
        hand.wait_for(lambda s: s.mode is Mode.GRASP, PATIENCE_S, "grasp")
        assert command(path, "rotate", -2, 0, "5", "--ramp", 0.2).returncode == 0
        hand.wait_for(lambda s: s.target_rpy_deg == (-2.0, 0.0, 5.0), PATIENCE_S, "turn")
        shown = command(path, "status")
        assert shown.returncode == 0
        assert [line.split(":")[0] for line in shown.stdout.splitlines()[1:4]] == [
            "finger-1", "finger-2", "finger-3",
        ]  # fmt: skip
        assert json.loads(command(path, "status", "--json").stdout)["target_rpy_deg"] == [-2.0, 0.0, 5.0]
        assert command(path, "rotate", 0, 0, 400).returncode == 2
        assert command(path, "stop").returncode == 0
        hand.wait_for(lambda s: s.mode is Mode.STOP, PATIENCE_S, "stop", stops=False)
        assert command(path, "status").returncode == 8
        time.sleep(0.7)
        assert command(path, "recover").returncode == 0


def test_a_host_that_cannot_start_says_why(tmp_path):
    with pytest.raises(PalpateError, match=r"the host did not start: .*none.toml"):
        Hand.open(tmp_path / "none.toml", tmp_path / "s")


def test_check_tells_whether_the_bus_is_the_hand_of_the_file(config, tmp_path):
    """As it is: exit status 0. A drive and a fingertip exchanged, and a node that is not there: 1, named."""

    def check(path):
        command = [*CLI, "check", "--config", str(path), "--timeout", "3"]
        command += ["--picture", str(tmp_path / "hand.png")]
        return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)

    right = check(config)
    assert (right.returncode, right.stderr) == (0, "")
    assert "0 of 12 nodes have problems" in right.stdout
    assert "0x01  drive of abduction_1" in right.stdout and "cst, 1.9 N m" in right.stdout
    assert (tmp_path / "hand.png").read_bytes().startswith(b"\x89PNG")
    text = config.read_text().replace("drive_node = 9,", "drive_node = 0x33,")
    text = text.replace("fingertip_node = 0x10", "fingertip_node = 0x01").replace(
        "drive_node = 1,", "drive_node = 0x10,"
    )
    (tmp_path / "wrong.toml").write_text(text)
    wrong = check(tmp_path / "wrong.toml")
    assert wrong.returncode == 1
    for said in (
        "is not a CiA 404 device (its 1000h is of CiA 402)",
        "is not a CiA 402 device (its 1000h is of CiA 404)",
        "does not answer",
        "0x09 is on the bus and not in the file (CiA 402 drive)",
        "3 of 12 nodes have problems",
    ):
        assert said in wrong.stdout
