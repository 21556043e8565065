"""Print the tables of the benchmarks, each on one core: all of them, or those that are named.

examples:
  python -m bench                   all, about three minutes
  python -m bench camera hand       the twin's camera; its hand and object
  make bench TABLES="tick latency"
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import cv2

from bench import bus, estimate_to_bus, estimator, frames, host, latency, node, startup, tick, twin, twin_hand
from bench.timing import table


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m bench", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "tables", nargs="*", metavar="TABLE", help=f"any of: {', '.join(TABLES)} [all, in this order]"
    )
    named = parser.parse_args().tables
    unknown = [name for name in named if name not in TABLES]
    if unknown:
        parser.error(f"no table is called {', '.join(unknown)}; there are: {', '.join(TABLES)}")
    cv2.setNumThreads(1)
    for name in named or TABLES:
        print(TABLES[name](), end="\n\n", flush=True)


def _estimator() -> str:
    return "\n\n".join(estimator.report(material) for material in frames.materials())


def _start() -> str:
    return startup.report(next(iter(frames.materials())))


def _bus() -> str:
    return table("Fingertip node and hub", bus.rows())


def _host() -> str:
    return table("Host, 3 fingers x 3 joints", host.rows())


def _tick() -> str:
    title = "Kinematics, gravity, Eqs. (9)-(16) and limits, 3 fingers x 5 joints, processor time"
    return table(title, tick.rows())


def _camera() -> str:
    return table("The twin's camera, 640x480 in colour, processor time", twin.rows())


def _hand() -> str:
    title = "The twin's hand and object, steps of 0.5 ms, processor time"
    return f"{table(title, twin_hand.rows())}\n\n{twin_hand.report()}"


TABLES: dict[str, Callable[[], str]] = {
    "estimator": _estimator,
    "start": _start,
    "bus": _bus,
    "node": node.report,
    "estimate-to-bus": estimate_to_bus.report,
    "host": _host,
    "tick": _tick,
    "latency": latency.report_of_a_demo,
    "camera": _camera,
    "hand": _hand,
}


if __name__ == "__main__":
    main()
