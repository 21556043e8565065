"""The commands under ``palpate-host bus fault``: one for each kind of fault."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeAlias

import click

from palpate_bus.hub.faults import FaultKind, FaultRule
from palpate_edge.can_bus.can_frame import MAX_STANDARD_ID

_HELP = {
    FaultKind.DROP: ("Drop frames before they reach the wire.", "drop --id 0x190 --probability 0.1"),
    FaultKind.DUPLICATE: ("Send frames twice.", "duplicate --port finger-1 --count 100"),
    FaultKind.DELAY: (
        "Delay frames; a range of delays also reorders them.",
        "delay --delay-ms 5 --delay-max-ms 20",
    ),
    FaultKind.TX_FULL: (
        "Refuse frames as if a transmit buffer were full (ENOBUFS).",
        "tx-full --port host --duration-ms 500",
    ),
    FaultKind.BUS_OFF: ("Set a port bus-off.", "bus-off --port finger-1 --duration-ms 2000"),
}
"""Summary of each command and an example of its use."""

Decorator: TypeAlias = Callable[[Callable[..., Any]], Any]


class _Identifier(click.ParamType[int]):
    name = "identifier"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        try:
            number = int(str(value), 0)
        except ValueError:
            self.fail(f"{value!r} is not a number: write for example 0x190 or 400", param, ctx)
        if not 0 <= number <= MAX_STANDARD_ID:
            self.fail(f"{value} is not an 11-bit identifier: give 0 to 0x7FF", param, ctx)
        return number


_MATCH_OPTIONS: tuple[Decorator, ...] = (
    click.option("--id", "can_id", type=_Identifier(), help="Only frames with this identifier."),
    click.option(
        "--mask",
        type=_Identifier(),
        default="0x7FF",
        show_default=True,
        help="Bits of the identifier that are compared with --id.",
    ),
    click.option(
        "--probability",
        type=click.FloatRange(0, 1),
        default=1.0,
        show_default=True,
        help="Share of the frames that are affected.",
    ),
    click.option("--count", type=click.IntRange(min=1), help="End after this many affected frames."),
    click.option("--seed", type=int, default=0, show_default=True, help="Seed of the random numbers."),
)
_DELAY_OPTIONS: tuple[Decorator, ...] = (
    click.option("--delay-ms", type=click.FloatRange(min=0), required=True, help="Delay of each frame, ms."),
    click.option(
        "--delay-max-ms",
        type=click.FloatRange(min=0),
        help="Delay each frame by a random time from --delay-ms to this, ms.",
    ),
)
_WINDOW_OPTIONS: tuple[Decorator, ...] = (
    click.option(
        "--start-ms",
        type=click.FloatRange(min=0),
        default=0.0,
        show_default=True,
        help="Begin after this time, ms.",
    ),
    click.option(
        "--duration-ms",
        type=click.FloatRange(min=0.001),
        help="End after this time, ms; default: until bus fault clear.",
    ),
)


def fault_rule_options(
    socket_option: Decorator, inject: Callable[[Path, FaultRule], None]
) -> Iterator[click.Command]:
    """Yield one command for each kind of fault; it calls `inject` with the socket's path and the rule."""
    for kind in FaultKind:
        port = click.option(
            "--port", required=kind is FaultKind.BUS_OFF, help="Client whose frames are affected."
        )
        options: list[Decorator] = [socket_option, port, *_WINDOW_OPTIONS]
        if kind is not FaultKind.BUS_OFF:
            options += _MATCH_OPTIONS
        if kind is FaultKind.DELAY:
            options += _DELAY_OPTIONS
        yield _command(kind, options, inject)


def _command(
    kind: FaultKind, options: list[Decorator], inject: Callable[[Path, FaultRule], None]
) -> click.Command:
    def run(socket_path: Path, **values: Any) -> None:
        for name in ("start", "duration", "delay", "delay_max"):
            milliseconds = values.pop(f"{name}_ms", None)
            if milliseconds is not None:
                values[f"{name}_us"] = round(milliseconds * 1000)
        inject(socket_path, FaultRule(kind=kind, **values))

    callback: Callable[..., Any] = run
    for option in reversed(options):
        callback = option(callback)
    summary, example = _HELP[kind]
    text = f"{summary}\n\n\b\nExample:\n  palpate-host bus fault {example}"
    return click.command(kind.value, help=text)(callback)
