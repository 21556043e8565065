"""SIGTERM and SIGINT as a call, for every process that runs until it is told to stop."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

STOP_SIGNALS = (signal.SIGTERM, signal.SIGINT)


@contextmanager
def on_stop_signal(stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop` on SIGTERM and SIGINT; the former handlers come back afterwards."""
    former = {number: signal.signal(number, lambda *_: stop()) for number in STOP_SIGNALS}
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


@contextmanager
def stop_event() -> Iterator[threading.Event]:
    """An event that SIGTERM and SIGINT set."""
    stopped = threading.Event()
    with on_stop_signal(stopped.set):
        yield stopped


@contextmanager
def record_signals(record: Callable[[bool], None]) -> Iterator[None]:
    """Call `record` with True on SIGUSR1, with False on SIGUSR2; the former handlers come back afterwards."""
    former = {
        signal.SIGUSR1: signal.signal(signal.SIGUSR1, lambda *_: record(True)),
        signal.SIGUSR2: signal.signal(signal.SIGUSR2, lambda *_: record(False)),
    }
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
