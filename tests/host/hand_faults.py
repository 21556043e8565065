"""What breaks in the closed loop, how it is mended, and by when docs/safety.md says the torque is away."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np

from palpate_edge.node.emcy import ErrorRegister

TICK_US, FRAME_US, DELAY_US, HEARD_US = 10_000, 33_333, 40_000, 2_000
WATCHDOG_US = 200_000  # 1400h:05 of the drives


def load(name):
    """The module `name`.py beside this one, loaded once."""
    path = Path(__file__).with_name(f"{name}.py")
    key = f"palpate_{name}"
    if key not in sys.modules:
        spec = importlib.util.spec_from_file_location(key, path)
        sys.modules[key] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[key])
    return sys.modules[key]


Doubt = load("closed_loop").Doubt

# A fault takes the rig and a random generator, breaks something and returns what mends it. What two faults
# have broken is whole when both are mended.


def broken_until_mended(rig, nodes, node, mend):
    """`node` is one of `nodes` (rig.silent, rig.cut_off) until the last fault that put it there is mended."""
    nodes.add(node)
    rig.faults[id(nodes), node] += 1

    def mend_one():
        rig.faults[id(nodes), node] -= 1
        if not rig.faults[id(nodes), node]:
            mend()

    return mend_one


def kill(rig, node):
    return broken_until_mended(rig, rig.silent, node, lambda: rig.power_up(node))


def cut(rig, node):
    return broken_until_mended(rig, rig.cut_off, node, lambda: rig.cut_off.discard(node))


def kill_drive(rig, rng):
    return kill(rig, int(rng.integers(1, 10)))


def cut_drive(rig, rng):
    return cut(rig, int(rng.integers(1, 10)))


def drive_fault(rig, rng):
    motor = rig.motors[int(rng.integers(0, 9))]
    motor.error_code = 0x2310  # CiA 402-2: continuous over current
    return lambda: None


def drive_too_hot(rig, rng):
    """It says so (CiA 402-2: excess temperature drive) and goes on: the hand is the host's to stop."""
    emcy = rig.drives[int(rng.integers(0, 9))].slave.emcy
    emcy.report(0x4310, ErrorRegister.TEMPERATURE)
    return lambda: emcy.clear(0x4310)


def kill_host(rig, rng):
    return broken_until_mended(rig, rig.silent, rig.host_id, rig.start_host)


def cut_host(rig, rng):
    return cut(rig, rig.host_id)


def kill_fingertip(rig, rng):
    return kill(rig, 0x10 + int(rng.integers(0, 3)))


def cut_fingertip(rig, rng):
    return cut(rig, 0x10 + int(rng.integers(0, 3)))


def doubt(kind, late_us=0):
    def break_(rig, rng):
        doubts, one = rig.doubts[int(rng.integers(0, 3))], Doubt(kind, late_us)
        doubts.append(one)
        return lambda: doubts.remove(one)

    break_.__name__ = kind.replace(" ", "_") if kind else "stale"
    return break_


CAMERA_STALLED, CAMERA_GONE = doubt("camera stalled"), doubt("camera gone")
STALE, FROZEN, WILD = doubt("", late_us=800_000), doubt("frozen"), doubt("wild")
FAULTS = (
    kill_drive, cut_drive, drive_fault, kill_host, cut_host, kill_fingertip, cut_fingertip,
    CAMERA_STALLED, CAMERA_GONE, STALE, FROZEN, WILD, drive_too_hot,
)  # fmt: skip


def times(config):
    """Fault -> (us until the host orders no more torque, us until no more turning); None: it need not.

    A drive that does not hear the host goes by its own watchdog: `Deadlines` adds that.
    """
    joint = config.staleness.joint_stop_ms * 1000 + 2 * TICK_US + HEARD_US
    arrives = DELAY_US + FRAME_US + TICK_US + HEARD_US
    stop = config.staleness.stop_ms * 1000 + TICK_US + HEARD_US
    freeze = config.staleness.freeze_ms * 1000 + TICK_US + HEARD_US
    return {
        kill_drive: (joint, joint),
        cut_drive: (joint, joint),
        drive_fault: (2 * TICK_US + HEARD_US, 2 * TICK_US + HEARD_US),
        drive_too_hot: (2 * TICK_US + HEARD_US, 2 * TICK_US + HEARD_US),
        kill_host: (0, 0),
        cut_host: (joint, joint),
        kill_fingertip: (stop, freeze),
        cut_fingertip: (stop, freeze),
        CAMERA_STALLED: (stop, freeze),
        CAMERA_GONE: (stop, max(freeze, arrives)),
        STALE: (None, freeze + 800_000),
        FROZEN: (None, None),
        WILD: (None, None),
    }


class Deadlines:
    """By when each drive's torque is away, as docs/safety.md promises it.

    A fault that lasts binds every drive to the host's time for it. A drive that hears nothing when that time
    runs out (it is cut off, or the host is cut off or dead) is bound by its watchdog instead, which counts
    from the last that it heard.
    """

    def __init__(self, rig):
        self._rig = rig
        self._limits = times(rig.config)
        self._deaf_since_us = {}
        self.due_us = np.full(len(rig.drives), np.inf)

    def broken(self, fault, lasts_us):
        """`fault` began now and will be mended after `lasts_us`; mended in time, it binds nobody."""
        limit_us = self._limits[fault][0]
        if limit_us is not None and lasts_us > limit_us:
            np.minimum(self.due_us, self._rig.now_us + limit_us, out=self.due_us)

    def look(self):
        """Who is deaf now; to be called whenever something was broken or mended."""
        rig = self._rig
        no_host = rig.host_id in rig.silent | rig.cut_off
        for i, drive in enumerate(rig.drives):
            if not no_host and drive.slave.node_id not in rig.cut_off:
                self._deaf_since_us.pop(i, None)
                continue
            since_us = self._deaf_since_us.setdefault(i, rig.now_us)
            if since_us <= self.due_us[i] < np.inf:
                self.due_us[i] = max(self.due_us[i], since_us + WATCHDOG_US + HEARD_US)

    def late(self):
        """(drive's index, us after its deadline) of every order of torque that came too late."""
        trace = self._rig.torque_trace
        return [
            (int(i), us - self.due_us[i])
            for us, row in trace
            for i in np.flatnonzero((row > 0.0) & (us > self.due_us))
        ]
