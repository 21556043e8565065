#!/usr/bin/python3
"""Run on a board: print to the console what is active, previous and whole, as a line "witness: " with JSON.

As a service: start node 10h, wait for its first valid contact; the line has also the seconds from the
kernel's start to the contact, and what runs. As the kernel's first process: do with the card what
palpate-settle.service does, start nothing, and end.
"""

import hashlib
import json
import os
import re
import socket
import struct
import subprocess
from pathlib import Path

BASE, CONSOLE = Path("/opt/palpate"), Path("/dev/console")
FRAME = struct.Struct("<IB3x8s")
WAITS, START, TPDO_2, VALID = 0x710, FRAME.pack(0x000, 2, b"\x01\x10"), 0x290, 0x04


def wait_for_contact() -> float:
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as bus:
        bus.bind(("can0",))
        while True:
            can_id, _, data = FRAME.unpack(bus.recv(16))
            if can_id == WAITS and data[0] == 0x7F:
                bus.send(START)
            if can_id == TPDO_2 and data[6] & VALID:
                return float(Path("/proc/uptime").read_text().split()[0])


def running() -> str:
    words = ["systemctl", "show", "--value", "--property=MainPID", "palpate-fingertip.service"]
    pid = subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()
    return ", ".join(
        sorted(set(re.findall(r"/opt/palpate/releases/([^/]+)/", Path(f"/proc/{pid}/maps").read_text())))
    )


def digest(release: Path) -> str:
    whole = hashlib.sha256()
    for path in sorted(
        path for path in release.rglob("*") if path.is_file() and "__pycache__" not in path.parts
    ):
        whole.update(f"{path} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return whole.hexdigest()


def target(link: str) -> str:
    path = BASE / link
    return path.readlink().name if path.is_symlink() else ""


def card() -> dict[str, object]:
    active = BASE / "releases" / target("current")
    return {
        "current": active.name,
        "previous": target("previous"),
        "complete": (active / ".complete").exists(),
        "trial": (BASE / "trial").exists(),
        "digest": digest(active),
    }


def settle() -> None:
    if (BASE / "trial").exists():
        subprocess.run(["/opt/palpate/bin/palpate-release", "settle"], check=True)


def served() -> dict[str, object]:
    contact_s = wait_for_contact()
    CONSOLE.write_text("witness has a contact\n")
    rmem_max = int(Path("/proc/sys/net/core/rmem_max").read_text())
    return {"contact_s": contact_s, "running": running(), "rmem_max": rmem_max}


seen = {}
if os.getpid() == 1:
    settle()
else:
    seen = served()
CONSOLE.write_text(f"witness: {json.dumps(seen | card())}\n")
