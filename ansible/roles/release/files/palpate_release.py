#!/usr/bin/python3
"""Switch this board to a release of palpate, or roll back, atomically.

current and previous are links into releases/; a link is replaced by a rename. While a release is on trial,
the file trial has both releases, the link previous as it was, and which parts failed before. The next start
of the board, or the next run, first returns to the proven release: docs/deploying.md has the table of states.

One file: copying replaces it whole, so that a power cut leaves no parts of two versions for the next start.
"""

from __future__ import annotations

import argparse
import fcntl
import hashlib
import json
import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

BASE = Path("/opt/palpate")
CURRENT, PREVIOUS, TRIAL = BASE / "current", BASE / "previous", BASE / "trial"
COMPLETE = ".complete"  # in a release whose installation was finished
UNITS, CONFIGS = Path("/etc/systemd/system"), Path("/etc/palpate")
LOADED = "zz-palpate-loaded.conf"  # a drop-in of each service: what its next start loads
LOADED_VARIABLE = "PALPATE_LOADED"
FINGERTIP, GATEWAY, HOST = "palpate-fingertip.service", "palpate-az.service", "palpate-host.service"
CONFIG = "/etc/palpate/fingertip.toml"
READ = {FINGERTIP: ("fingertip.toml", "fingertip.cal"), GATEWAY: ("az.toml",), HOST: ("hand.toml", "az.toml")}
HEALTH, HEALTH_AGE_S = Path("/run/palpate"), 5.0  # palpate-*.json of a running fingertip, renewed each second
IN_USE = {"home", "grasp", "hold", "manipulate", "blind", "release"}  # modes in which joints hold or move
DEVICES = {"camera", "beads", "bus", "clock"}  # parts that may fail though the release is in order
STEADY_S = 5.0  # time without a restart and without a new failing part, after which a release is healthy
REPORT_S = 10.0  # time in which a running fingertip reports what it has loaded
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


def check_rows() -> list[dict[str, str]]:
    """Return the rows of `palpate-edge check` of the active release."""
    command = [str(CURRENT / "bin/palpate-edge"), "check", "--json", "--config", CONFIG]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, check=False)
        return list(json.loads(answer.stdout))
    except (OSError, ValueError):
        return [{"part": "check", "verdict": "fail"}]


def failing_parts() -> set[str]:
    """Return the parts of the fingertip that fail in `palpate-edge check`."""
    return {row["part"] for row in check_rows() if row["verdict"] == "fail"}


def in_use(services: list[str]) -> str:
    """Return which of the services a hand needs now, and how it is; empty if none."""
    if FINGERTIP in services:
        reports = [path for path in HEALTH.glob("palpate-*.json") if age_s(path) < HEALTH_AGE_S]
        if any(json.loads(path.read_bytes()).get("nmt_state") == "operational" for path in reports):
            return "the fingertip is OPERATIONAL"
    if HOST in services:
        command = [str(CURRENT / "bin/palpate-host"), "command", "status", "--json"]
        with suppress(OSError, ValueError):  # no release yet, or no host running
            answer = subprocess.run(command, capture_output=True, text=True, check=False)
            if (mode := json.loads(answer.stdout)["mode"]) in IN_USE:
                return f"the hand is in {mode.upper()}"
    return ""


def age_s(path: Path) -> float:
    try:
        return time.time() - path.stat().st_mtime
    except OSError:
        return math.inf


def refuse_in_use(services: list[str], interrupt: bool) -> None:
    """Refuse a restart that would take touch or torque from a hand in use, unless `interrupt`."""
    if not interrupt and (use := in_use(services)):
        raise SystemExit(
            f"error: {use}, and the restart of {' '.join(services)} would interrupt it: stop the hand first "
            "(systemctl stop palpate-host on the host), or give --interrupt (-e release_interrupt=true)"
        )


def may_fail(service: str) -> set[str]:
    """Return the parts that may fail in another release: of a running service those that fail now."""
    pid = main_pid(service)
    if not pid:
        return set(DEVICES)
    if service != FINGERTIP or loaded_release(pid) != target(CURRENT):
        return set()
    return failing_parts()


def state() -> dict[str, set[str]]:
    """Return the enabled services, each with the parts that may fail."""
    return {service: may_fail(service) for service in enabled()}


def loaded_release(pid: int) -> str:
    """Return the release whose libraries a process has mapped, empty if it has none."""
    try:
        maps = Path(f"/proc/{pid}/maps").read_text()
    except OSError:
        return ""
    found = re.search(rf" {re.escape(str(BASE))}/releases/([^/]+)/", maps)
    return found[1] if found else ""


def files_digest(service: str) -> str:
    """Return a digest of unit, drop-ins and configuration as a start would load them."""
    own = UNITS / f"{service}.d"
    names = [UNITS / service, *sorted(path for path in own.glob("*.conf") if path.name != LOADED)]
    names += [CONFIGS / name for name in READ[service]]
    digest = hashlib.sha256(b"gateway" if service == HOST and GATEWAY in enabled() else b"")
    for path in names:
        content = path.read_bytes() if path.exists() else b"\0"
        digest.update(f"{path} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def environment_digest(pid: int) -> str:
    """Return the digest that a process was started with, empty without one."""
    try:
        variables = Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    except OSError:
        return ""
    prefix = f"{LOADED_VARIABLE}=".encode()
    return next((each.removeprefix(prefix).decode() for each in variables if each.startswith(prefix)), "")


def other_configuration() -> bool:
    """Return whether the running fingertip reports another configuration than that of the files."""
    end_s = time.monotonic() + REPORT_S
    while time.monotonic() < end_s:
        verdicts = [row["verdict"] for row in check_rows() if row["part"] == "configuration"]
        if verdicts:
            return verdicts != ["ok"]
        time.sleep(POLL_S)
    return True


def stale(service: str, release: str) -> str:
    """Return why a service does not serve what is wanted, empty if it does."""
    pid = main_pid(service)
    if not pid:
        return f"{service} is {systemctl('is-active', service)}"
    if loaded_release(pid) != release:
        return f"{service} runs another release"
    if environment_digest(pid) != files_digest(service):
        return f"{service} was started with other files"
    if service == FINGERTIP and other_configuration():
        return f"{service} has loaded another configuration"
    return ""


def unhealthy(wanted: dict[str, set[str]], patience_s: float, release: str) -> str:
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
            elif loaded_release(pid) != release:
                fault = f"{service} runs another release"
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


def restart(services: list[str]) -> None:
    """Restart services. They stop in reverse order: the host stops the drives through the gateway."""
    for service in services:
        folder = UNITS / f"{service}.d"
        folder.mkdir(exist_ok=True)
        write(folder / LOADED, f"[Service]\nEnvironment={LOADED_VARIABLE}={files_digest(service)}\n")
    systemctl("daemon-reload")
    for service in reversed(services):
        systemctl("stop", service)
    for service in services:
        systemctl("reset-failed", service)
        systemctl("start", service)


def synced(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    os.fsync(descriptor)
    os.close(descriptor)


def write(path: Path, text: str) -> None:
    """Write a file whole or not at all, also when the power is cut."""
    fresh = path.with_name(f".{path.name}.new")
    with fresh.open("w") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    fresh.rename(path)
    synced(path.parent)


def remove(path: Path) -> None:
    path.unlink(missing_ok=True)
    synced(path.parent)


def point(link: Path, release: str) -> None:
    """Replace a link atomically: at every moment it leads to the old or to the new release."""
    fresh = link.with_name(f"{link.name}.new")
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(Path("releases") / release)
    fresh.rename(link)
    synced(BASE)


def target(link: Path) -> str:
    return link.readlink().name if link.is_symlink() else ""


def begin_trial(new: str, wanted: dict[str, set[str]], then: str | None) -> None:
    """Write the file trial, then point current to the new release; previous never equals current.

    then: the previous release after the trial, empty for none; by default the one that serves now.
    """
    old, previous = target(CURRENT), target(PREVIOUS)
    parts = {service: sorted(failing) for service, failing in wanted.items()}
    trial = {"new": new, "old": old, "previous": previous, "wanted": parts, "proven": False}
    trial["then"] = old if then in (None, new) else then
    write(TRIAL, json.dumps(trial))
    if previous == new:
        remove(PREVIOUS)
    point(CURRENT, new)


def prove_trial() -> None:
    """Stay with the new release: previous becomes the old one. May be repeated after a power cut."""
    trial = json.loads(TRIAL.read_text())
    if not trial["proven"]:
        write(TRIAL, json.dumps(trial | {"proven": True}))
    if then := trial.get("then", trial["old"]):
        point(PREVIOUS, then)
    else:
        remove(PREVIOUS)
    remove(TRIAL)


def undo_trial() -> None:
    """Point the links as before the trial. The file trial stays until the old release's services run."""
    trial = json.loads(TRIAL.read_text())
    if trial["old"]:
        point(CURRENT, trial["old"])
        if trial["previous"]:
            point(PREVIOUS, trial["previous"])


def end_interrupted_trial() -> dict[str, set[str]] | None:
    """Return to the proven release; return the parts that might fail in it, None without a trial."""
    if not TRIAL.exists():
        return None
    try:
        trial = json.loads(TRIAL.read_text())
    except ValueError:  # of an earlier version: the name of the new release
        new, current = TRIAL.read_text().strip(), target(CURRENT)
        old = target(PREVIOUS) if current == new else current
        trial = {"new": new, "old": old, "previous": "", "wanted": {}, "proven": False}
        write(TRIAL, json.dumps(trial))
        remove(PREVIOUS)
    if trial["proven"]:
        prove_trial()
        return None
    undo_trial()
    return {service: set(parts) for service, parts in trial["wanted"].items()}


def renew(release: str, patience_s: float, baseline: dict[str, set[str]] | None, interrupt: bool) -> str:
    """Restart the services that do not serve the active release with the present files."""
    faults = {service: fault for service in enabled() if (fault := stale(service, release))}
    if GATEWAY in faults and HOST in enabled():
        faults.setdefault(HOST, f"{GATEWAY} is restarted")
    if not faults:
        return f"unchanged: {release}"
    services = [service for service in enabled() if service in faults]
    refuse_in_use(services, interrupt)
    before = state() if baseline is None else baseline
    wanted = {service: before.get(service, set()) if main_pid(service) else set() for service in services}
    restart(services)
    if fault := unhealthy(wanted, patience_s, release):
        raise SystemExit(f"error: release {release}: {fault}: journalctl -u {services[0]}")
    return f"started {' '.join(services)}"


def activate(
    release: str,
    patience_s: float,
    baseline: dict[str, set[str]] | None,
    interrupt: bool = False,
    then: str | None = None,
) -> str:
    """Activate `release`; roll back if a part fails that worked before. SystemExit has the reason.

    baseline: the parts that might fail before an interrupted trial; the present state may be that of a
    broken release. then: the previous release afterwards, instead of the one that serves now.
    """
    if not (BASE / "releases" / release / COMPLETE).exists():
        raise SystemExit(f"error: release {release} is not completely installed: run update.yml again")
    old, services = target(CURRENT), enabled()
    if old == release:
        result = renew(release, patience_s, baseline, interrupt)
        remove(TRIAL)
        return result
    refuse_in_use(services, interrupt)
    if not old:
        wanted = {service: set(DEVICES) for service in services}
    else:
        wanted = state() if baseline is None else {each: baseline.get(each, DEVICES) for each in services}
    begin_trial(release, wanted, then)
    restart(services)
    fault = unhealthy(wanted, patience_s, release)
    if fault and old:
        undo_trial()
        restart(services)
        remove(TRIAL)
        old_fault = unhealthy(wanted, patience_s, old)
        result = f"{old} is active again" + (f", and {old_fault}" if old_fault else "")
        raise SystemExit(f"error: release {release} was not healthy: {fault}: {result}")
    if fault:
        remove(TRIAL)
        raise SystemExit(f"error: release {release}: {fault}: there is no previous release to roll back to")
    prove_trial()
    return f"switched to {release}" + (f" from {old}" if old else "")


def switch(release: str, patience_s: float, interrupt: bool = False, then: str | None = None) -> str:
    """Activate `release`, after the end of an interrupted trial."""
    return activate(release, patience_s, end_interrupted_trial(), interrupt, then)


def rollback(patience_s: float, interrupt: bool = False) -> str:
    """Activate the previous release, or the old one of an interrupted trial."""
    baseline = end_interrupted_trial()
    release = target(PREVIOUS if baseline is None else CURRENT)
    if not release:
        raise SystemExit("error: no previous release: install another one with update.yml")
    return activate(release, patience_s, baseline, interrupt)


def settle() -> str:
    """End the trial during which the power failed, at the board's start."""
    new = target(CURRENT)
    end_interrupted_trial()
    remove(TRIAL)
    return f"power was cut while {new} was on trial: {target(CURRENT)} is active"


@contextmanager
def alone() -> Iterator[None]:
    """Wait until no other palpate-release runs: one whose connection was lost ends its trial first."""
    with (BASE / "lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--patience", type=float, default=60.0, help="seconds to become healthy (default: 60)"
    )
    parser.add_argument(
        "--interrupt", action="store_true", help="restart also a fingertip or host that a hand needs now"
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    to = verbs.add_parser("switch", help="activate this release if it is healthy")
    to.add_argument("release")
    to.add_argument("--previous", help="previous release afterwards (default: the one that serves now)")
    verbs.add_parser("in-use", help="exit status 1 if a restart would interrupt a hand")
    verbs.add_parser("rollback", help="activate the previous release")
    verbs.add_parser("settle", help="at the board's start: roll back after a power cut during a trial")
    verbs.add_parser("status", help="list the active, the previous and all installed releases")
    wanted = parser.parse_args()
    if wanted.verb == "switch":
        with alone():
            print(switch(wanted.release, wanted.patience, wanted.interrupt, wanted.previous))
    elif wanted.verb == "rollback":
        with alone():
            print(rollback(wanted.patience, wanted.interrupt))
    elif wanted.verb == "settle":
        with alone():
            print(settle())
    elif wanted.verb == "in-use":
        refuse_in_use(enabled(), wanted.interrupt)
    else:
        print(f"current {target(CURRENT) or 'none'}, previous {target(PREVIOUS) or 'none'}")
        for release in sorted((BASE / "releases").iterdir()):
            print(f"{release.name}{'' if (release / COMPLETE).exists() else ' (incomplete)'}")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
