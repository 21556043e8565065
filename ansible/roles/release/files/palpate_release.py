#!/usr/bin/python3
"""Which release of palpate serves on this board: switch to one, go back, all or nothing.

current and previous are links into releases/; a link is replaced by a rename. While a switch has not proven
itself the file trial stands: a board that loses its power meanwhile goes back at its next start.
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
STEADY_S = 5.0  # the same process for so long, nothing failing that did not fail before
POLL_S = 0.5


def systemctl(*words: str) -> str:
    answer = subprocess.run(["systemctl", *words], capture_output=True, text=True, check=False)
    return answer.stdout.strip()


def enabled() -> list[str]:
    """In the order in which they are started."""
    return [name for name in (FINGERTIP, GATEWAY, HOST) if systemctl("is-enabled", name) == "enabled"]


def main_pid(service: str) -> int:
    """0 where it does not serve."""
    if systemctl("is-active", service) != "active":
        return 0
    return int(systemctl("show", "--value", "--property=MainPID", service))


def failing_parts() -> set[str]:
    """Return the state of the fingertip from `palpate-edge check`."""
    command = [str(CURRENT / "bin/palpate-edge"), "check", "--json", "--config", CONFIG]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, check=False)
        return {row["part"] for row in json.loads(answer.stdout) if row["verdict"] == "fail"}
    except (OSError, ValueError):
        return {"check"}


def state() -> dict[str, set[str]]:
    """Each service that serves, with the parts that fail in it."""
    return {
        service: failing_parts() if service == FINGERTIP else set()
        for service in enabled()
        if main_pid(service)
    }


def unhealthy(wanted: dict[str, set[str]], patience_s: float) -> str:
    """Waits until all that is wanted has been there for a while: empty, or what was the matter at the end."""
    end_s = time.monotonic() + patience_s
    pids: dict[str, int] = {}
    since_s = time.monotonic()
    while True:
        matter = ""
        now = {service: main_pid(service) for service in wanted}
        for service, pid in now.items():
            if not pid:
                matter = f"{service} is {systemctl('is-active', service)}"
            elif pid != pids.get(service):
                matter = f"{service} was started again"
            elif service == FINGERTIP and (worse := failing_parts() - wanted[service]):
                matter = f"{service}: palpate-edge check fails in {', '.join(sorted(worse))}"
        pids = now
        if matter:
            since_s = time.monotonic()
        elif time.monotonic() >= since_s + STEADY_S:
            return ""
        if time.monotonic() >= end_s:
            return matter or "not steady"
        time.sleep(POLL_S)


def synced(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    os.fsync(descriptor)
    os.close(descriptor)


def point(link: Path, release: str) -> None:
    """At every moment the link leads to the old release or to the new one."""
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
    """They are stopped the other way round: the host stops the drives before their gateway goes."""
    systemctl("daemon-reload")
    for service in reversed(services):
        systemctl("stop", service)
    for service in services:
        systemctl("reset-failed", service)
        systemctl("start", service)


def switch(release: str, patience_s: float) -> str:
    """Serve `release`; go back when it does less than the one before. SystemExit tells why."""
    if not (BASE / "releases" / release / COMPLETE).exists():
        raise SystemExit(f"error: release {release} is not installed whole: run update.yml again")
    old, services = target(CURRENT), enabled()
    if old == release and not TRIAL.exists():
        idle = [service for service in services if not main_pid(service)]
        if not idle:
            return f"unchanged: {release}"
        restart(idle)
        if matter := unhealthy({service: set() for service in idle}, patience_s):
            raise SystemExit(f"error: release {release}: {matter}: journalctl -u {idle[0]}")
        return f"started {' '.join(idle)}"
    wanted = state() if old else {service: {"camera", "beads", "bus", "clock"} for service in services}
    begin_trial(release)
    if old and old != release:
        point(PREVIOUS, old)
    point(CURRENT, release)
    restart(services)
    matter = unhealthy(wanted, patience_s)
    if matter and old and old != release:
        point(CURRENT, old)
        restart(services)
        end_trial()
        back = unhealthy(wanted, patience_s)
        serves = f"{old} serves again" if not back else f"{old} is back, and {back}"
        raise SystemExit(f"error: release {release} was not healthy: {matter}: {serves}")
    end_trial()
    if matter:
        raise SystemExit(f"error: release {release}: {matter}: there is no release before it to go back to")
    return f"switched to {release}" + (f" from {old}" if old else "")


def settle() -> str:
    """At a start with the file trial: power was cut before the new release had proven itself."""
    old, new = target(PREVIOUS), target(CURRENT)
    if old and TRIAL.read_text() == new:
        point(CURRENT, old)
    end_trial()
    return f"power was cut while {new} was on trial: {target(CURRENT)} serves"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--patience", type=float, default=60.0, help="s to become healthy (default: 60)")
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("switch", help="serve this release if it is healthy").add_argument("release")
    verbs.add_parser("rollback", help="serve the release before")
    verbs.add_parser("settle", help="at the board's start: end a trial that lost its power")
    verbs.add_parser("status", help="what serves, what is there")
    wanted = parser.parse_args()
    if wanted.verb == "switch":
        print(switch(wanted.release, wanted.patience))
    elif wanted.verb == "rollback":
        if not target(PREVIOUS):
            raise SystemExit("error: no release before this one: install one with update.yml")
        print(switch(target(PREVIOUS), wanted.patience))
    elif wanted.verb == "settle":
        print(settle())
    else:
        print(f"current {target(CURRENT) or 'none'}, before it {target(PREVIOUS) or 'none'}")
        for release in sorted((BASE / "releases").iterdir()):
            print(f"{release.name}{'' if (release / COMPLETE).exists() else ' (not whole)'}")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
