"""Plans of turns by finger gaiting, made in a process of their own: a plan takes seconds."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from palpate_host.common.gait_plan import GaitRefusedError
from palpate_host.common.tick_inputs import Planned
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.gait.turn_request import TurnRequest, plan_of

NICENESS = 10
ENDED = "the turn is refused: its planner ended without a plan; command it again"


class TurnPlans:
    """The process that plans; it lives for one request. Call `update` once a tick, which never blocks."""

    def __init__(self, config: HandConfig) -> None:
        self._config = config
        self._request: TurnRequest | None = None
        self._process: BaseProcess | None = None
        self._answer: Connection | None = None

    def update(self, request: TurnRequest | None) -> Planned | None:
        """Start to plan a new request, or return the plan of the present one once it is made."""
        if request is not self._request:
            self.close()
            if request is not None:
                self._start(request)
        if self._answer is None or self._process is None:
            return None
        if not self._answer.poll(0):
            return None if self._process.is_alive() else self._finished(Planned(None, ENDED))
        try:
            planned: Planned = self._answer.recv()
        except EOFError:
            planned = Planned(None, ENDED)
        return self._finished(planned)

    def close(self) -> None:
        """End a process that still plans."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._process.close()
        if self._answer is not None:
            self._answer.close()
        self._request = self._process = self._answer = None

    def _finished(self, planned: Planned) -> Planned:
        self.close()
        return planned

    def _start(self, request: TurnRequest) -> None:
        context = multiprocessing.get_context("spawn")
        self._answer, theirs = context.Pipe(duplex=False)
        self._process = context.Process(target=_plan, args=(theirs, request, self._config), daemon=True)
        self._process.start()
        theirs.close()
        self._request = request


def _plan(answer: Connection, request: TurnRequest, config: HandConfig) -> None:
    """Plan in the child process, at a low priority and without the host's real-time scheduling."""
    from palpate_host.service.host import hand_of  # noqa: PLC0415 (host.py uses this module)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.nice(NICENESS)
    try:
        planned = Planned(plan_of(request, hand_of(config), config))
    except GaitRefusedError as error:
        planned = Planned(None, str(error))
    answer.send(planned)
