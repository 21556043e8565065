#!/usr/bin/python3
"""Switch this board to a release of palpate, or roll back, atomically.

current and previous are links into releases/; a link is replaced by a rename. While a release is on trial,
the file trial exists: a board that loses its power meanwhile rolls back at its next start.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

BASE = Path("/opt/palpate")
CURRENT, PREVIOUS, TRIAL = BASE / "current", BASE / "previous", BASE / "trial"
COMPLETE = ".complete"  # in a release whose installation was finished
FINGERTIP, GATEWAY, HOST = "palpate-fingertip.service", "palpate-az.service", "palpate-host.service"
CONFIG = "/etc/palpate/fingertip.toml"
STEADY_S = 5.0  # time without a restart and without a new failing part, after which a release is healthy
POLL_S = 0.5


def systemctl(*words: str) -> str:
    answer = subprocess.run(["systemctl", *words], capture_output=True, text=True, check=False)
    return answer.stdout.strip()


def enabled() -> list[str]:
    """Return the enabled services in the order in which they are started."""
    return [name for name in (FINGERTIP, GATEWAY, HOST) if systemctl("is-enabled", name) == "enabled"]


def main_pid(service: str) -> int:
    """Return the process id of a service, 0 if it is not active."""
    if systemctl("is-active", service) != "active":
        return 0
    return int(systemctl("show", "--value", "--property=MainPID", service))


def failing_parts() -> set[str]:
    """Return the parts of the fingertip that fail in `palpate-edge check`."""
    command = [str(CURRENT / "bin/palpate-edge"), "check", "--json", "--config", CONFIG]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, check=False)
        return {row["part"] for row in json.loads(answer.stdout) if row["verdict"] == "fail"}
    except (OSError, ValueError):
        return {"check"}


def state() -> dict[str, set[str]]:
    """Return the active services, each with its failing parts."""
    return {
        service: failing_parts() if service == FINGERTIP else set()
        for service in enabled()
        if main_pid(service)
    }


def unhealthy(wanted: dict[str, set[str]], patience_s: float) -> str:
    """Wait until the wanted services are healthy for STEADY_S; return the last fault, empty if they are."""
    end_s = time.monotonic() + patience_s
    pids: dict[str, int] = {}
    since_s = time.monotonic()
    while True:
        fault = ""
        now = {service: main_pid(service) for service in wanted}
        for service, pid in now.items():
            if not pid:
                fault = f"{service} is {systemctl('is-active', service)}"
            elif pid != pids.get(service):
                fault = f"{service} was restarted"
            elif service == FINGERTIP and (worse := failing_parts() - wanted[service]):
                fault = f"{service}: palpate-edge check fails in {', '.join(sorted(worse))}"
        pids = now
        if fault:
            since_s = time.monotonic()
        elif time.monotonic() >= since_s + STEADY_S:
            return ""
        if time.monotonic() >= end_s:
            return fault or f"not healthy for {STEADY_S:g} s in a row"
        time.sleep(POLL_S)


def synced(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    os.fsync(descriptor)
    os.close(descriptor)


def point(link: Path, release: str) -> None:
    """Replace a link atomically: at every moment it leads to the old or to the new release."""
    fresh = link.with_name(f"{link.name}.new")
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(Path("releases") / release)
    fresh.rename(link)
    synced(BASE)


def target(link: Path) -> str:
    return link.readlink().name if link.is_symlink() else ""


def begin_trial(release: str) -> None:
    with TRIAL.open("w") as file:
        file.write(release)
        file.flush()
        os.fsync(file.fileno())
    synced(BASE)


def end_trial() -> None:
    TRIAL.unlink(missing_ok=True)
    synced(BASE)


def restart(services: list[str]) -> None:
    """Restart services. They stop in reverse order: the host stops the drives through the gateway."""
    systemctl("daemon-reload")
    for service in reversed(services):
        systemctl("stop", service)
    for service in services:
        systemctl("reset-failed", service)
        systemctl("start", service)


def switch(release: str, patience_s: float) -> str:
    """Activate `release`; roll back if a part fails that worked before. SystemExit has the reason."""
    if not (BASE / "releases" / release / COMPLETE).exists():
        raise SystemExit(f"error: release {release} is not completely installed: run update.yml again")
    old, services = target(CURRENT), enabled()
    if old == release and not TRIAL.exists():
        idle = [service for service in services if not main_pid(service)]
        if not idle:
            return f"unchanged: {release}"
        restart(idle)
        if fault := unhealthy({service: set() for service in idle}, patience_s):
            raise SystemExit(f"error: release {release}: {fault}: journalctl -u {idle[0]}")
        return f"started {' '.join(idle)}"
    wanted = state() if old else {service: {"camera", "beads", "bus", "clock"} for service in services}
    begin_trial(release)
    if old and old != release:
        point(PREVIOUS, old)
    point(CURRENT, release)
    restart(services)
    fault = unhealthy(wanted, patience_s)
    if fault and old and old != release:
        point(CURRENT, old)
        restart(services)
        end_trial()
        old_fault = unhealthy(wanted, patience_s)
        result = f"{old} is active again" + (f", and {old_fault}" if old_fault else "")
        raise SystemExit(f"error: release {release} was not healthy: {fault}: {result}")
    end_trial()
    if fault:
        raise SystemExit(f"error: release {release}: {fault}: there is no previous release to roll back to")
    return f"switched to {release}" + (f" from {old}" if old else "")


def settle() -> str:
    """Roll back at a start with the file trial: the power failed while the new release was on trial."""
    old, new = target(PREVIOUS), target(CURRENT)
    if old and TRIAL.read_text() == new:
        point(CURRENT, old)
    end_trial()
    return f"power was cut while {new} was on trial: {target(CURRENT)} is active"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--patience", type=float, default=60.0, help="seconds to become healthy (default: 60)"
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("switch", help="activate this release if it is healthy").add_argument("release")
    verbs.add_parser("rollback", help="activate the previous release")
    verbs.add_parser("settle", help="at the board's start: roll back after a power cut during a trial")
    verbs.add_parser("status", help="list the active, the previous and all installed releases")
    wanted = parser.parse_args()
    if wanted.verb == "switch":
        print(switch(wanted.release, wanted.patience))
    elif wanted.verb == "rollback":
        if not target(PREVIOUS):
            raise SystemExit("error: no previous release: install another one with update.yml")
        print(switch(target(PREVIOUS), wanted.patience))
    elif wanted.verb == "settle":
        print(settle())
    else:
        print(f"current {target(CURRENT) or 'none'}, previous {target(PREVIOUS) or 'none'}")
        for release in sorted((BASE / "releases").iterdir()):
            print(f"{release.name}{'' if (release / COMPLETE).exists() else ' (incomplete)'}")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
