"""The twin's hand and its host in virtual time, no faster than the clock, behind a real control socket."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common.status import HostStatus
from palpate_host.config.control_config import ControlLaw
from palpate_host.config.packaged import MODELS
from palpate_host.operator.server import OperatorSocket
from palpate_host.service.host import load_hand
from palpate_twin.closed_loop.lockstep import LockstepLoop
from palpate_twin.closed_loop.tactile_rendering import TrueContactSource
from palpate_twin.paper.trial import make_engine

WIDE = MODELS / "table4-wide.toml"
SLICE_S = 0.05


class LosableContacts:
    """True contacts, except those of `lost` fingers."""

    def __init__(self) -> None:
        self.lost: set[int] = set()
        self._source = TrueContactSource(30.0, 0.15, 1, 0.03)

    def contact(self, finger: int, truth: Any, exposed_at_us: int, sequence: int) -> Any:
        felt = None if finger in self.lost else truth
        return self._source.contact(finger, felt, exposed_at_us, sequence)


class TwinOnSocket:
    """A thread with the whole chain of a hand under the pose law. The host holds the object by itself.

    rotation, position_m: of the true object after the last tick. statuses: of all ticks.
    """

    def __init__(self, socket: Path, hand_toml: Path = WIDE) -> None:
        config, hand = load_hand(hand_toml)
        config = msgspec.structs.replace(
            config,
            control=msgspec.structs.replace(config.control, law=ControlLaw.POSE),
            target=msgspec.structs.replace(config.target, rpy_deg=(0.0, 0.0, 0.0)),
        )
        self.contacts = LosableContacts()
        self.statuses: list[HostStatus] = []
        engine = make_engine(config, "mujoco", has_B=False)
        self._loop = LockstepLoop(config, hand, engine, self.contacts, on_tick=self._serve)
        self._engine = engine
        self._socket: OperatorSocket | None = None
        self._loop.run(1.5)  # until the object is held
        self._socket = OperatorSocket(socket)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def corners_m(self) -> Array:
        """Return the corners (n, 3) of the true object in the hand's frame."""
        return self._engine.twin.prism.vertices_m @ self.rotation.T + self.position_m

    def end_abruptly(self) -> None:
        """Close the socket as the kernel does for a host that is killed."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        next_s = time.monotonic()
        while not self._ended.is_set() and not self._loop.is_over:
            self._loop.run(SLICE_S)
            next_s = max(next_s + SLICE_S, time.monotonic() - SLICE_S)
            time.sleep(max(0.0, next_s - time.monotonic()))
        if self._socket is not None:
            self._socket.close()

    def _serve(self, status: HostStatus) -> None:
        self.statuses.append(status)
        self.rotation = np.array(self._engine.object_rotation)
        self.position_m = np.array(self._engine.object_position_m)
        if self._socket is not None:
            self._socket.serve(self._loop.host.command, status)
