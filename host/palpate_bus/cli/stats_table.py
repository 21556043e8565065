"""Text output of the hub's statistics."""

from __future__ import annotations

from palpate_bus.hub.control import Statistics


def status_line(statistics: Statistics) -> str:
    """Return all totals on one line as ``name value`` pairs."""
    ports = statistics.ports
    return (
        f"uptime_s {statistics.uptime_us / 1e6:.1f} frames {statistics.frames} bits {statistics.bits} "
        f"load {_percent(statistics.load)} clients {len(ports)} "
        f"overruns {sum(port.overruns for port in ports)} garbled_clients {statistics.garbled_clients}"
    )


def stats_table(statistics: Statistics) -> str:
    """Return the totals, then one line for each client, identifier and fault."""
    lines = [
        status_line(statistics),
        "",
        f"{'client':<20}{'sent':>10}{'delivered':>11}{'overruns':>10}{'refused':>9}{'lost':>7}  state",
    ]
    for port in statistics.ports:
        withheld = f", {port.fd_withheld} CAN FD frames withheld" if port.fd_withheld else ""
        lines.append(
            f"{port.name:<20}{port.sent:>10}{port.delivered:>11}{port.overruns:>10}{port.refused:>9}"
            f"{port.lost_to_bus_off:>7}  {'bus-off' if port.bus_off else 'active'}{withheld}"
        )
    lines += ["", f"{'id':<6}{'frames':>10}{'bits':>12}{'share':>8}"]
    for entry in statistics.ids:
        share = entry.bits / statistics.bits
        lines.append(f"{entry.can_id:03X}   {entry.frames:>10}{entry.bits:>12}{share:>8.1%}")
    for fault in statistics.faults:
        rule = fault.rule
        identifier = "any id" if rule.can_id is None else f"id {rule.can_id:03X}/{rule.mask:03X}"
        lines.append(f"fault {rule.kind.value} on {rule.port or 'any port'}, {identifier}: {fault.hits} hits")
    return "\n".join(lines)


def _percent(load: float | None) -> str:
    return "-" if load is None else f"{load:.1%}"
