"""Exchange of time stamps between two boards; runs on the boards, with Python's own library.

A board answers with the times of receipt and reply (`serve`). The asking one sends SAMPLES questions a round
and keeps the one with the shortest way: the error of its offset is at most half of that way. A guest also
notes when it stood still (`watch`), because the computer outside was busy.
"""

from __future__ import annotations

import json
import socket
import struct
import threading
import time
from pathlib import Path

PORT, SAMPLES, TIMEOUT_S, PERIOD_S = 9123, 40, 0.5, 2.0
NAP_S, STOOD_STILL_S = 0.05, 0.5
ANSWER = struct.Struct("!Qqq")  # number of the question, times of receipt and reply, ns
SHARED = Path("/run/shared")


def serve() -> None:
    """Answer until the end."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(("", PORT))
        while True:
            question, sender = port.recvfrom(64)
            received_ns = time.time_ns()
            (number,) = struct.unpack("!Q", question)
            port.sendto(ANSWER.pack(number, received_ns, time.time_ns()), sender)


def ask(port: socket.socket, address: str, number: int) -> tuple[float, float] | None:
    """Return the way there and back, and the offset of the other clock, s; None without an answer."""
    sent_ns = time.time_ns()
    port.sendto(struct.pack("!Q", number), (address, PORT))
    try:
        while True:
            answered, received_ns, replied_ns = ANSWER.unpack(port.recv(64))
            back_ns = time.time_ns()
            if answered == number:
                break
    except OSError:  # no answer in time, or no network yet
        return None
    way_ns = (back_ns - sent_ns) - (replied_ns - received_ns)
    return way_ns * 1e-9, (received_ns - sent_ns + replied_ns - back_ns) * 0.5e-9


def watch() -> None:
    """Write for how long the board stood still, s, each time that a nap lasts too long."""
    while True:
        begin_s = time.monotonic()
        time.sleep(NAP_S)
        still_s = time.monotonic() - begin_s - NAP_S
        if still_s > STOOD_STILL_S:
            with (SHARED / "stood-still").open("a") as file:
                file.write(f"{still_s:.2f}\n")


def measure(addresses: list[str], lasts_s: float) -> None:
    """Write a line of JSON for each round and board: seconds since the start, offset, half of the way, s."""
    begin_s, number = time.monotonic(), 0
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port,
        (SHARED / "offsets.jsonl").open("w") as file,
    ):
        port.settimeout(TIMEOUT_S)
        while time.monotonic() < begin_s + lasts_s:
            for address in addresses:
                answers = []
                for _ in range(SAMPLES):
                    number += 1
                    answers.append(ask(port, address, number))
                heard = [answer for answer in answers if answer]
                if heard:
                    way_s, offset_s = min(heard)
                    row = {"board": address, "at_s": time.monotonic() - begin_s}
                    file.write(json.dumps(row | {"offset_s": offset_s, "error_s": way_s / 2}) + "\n")
                    file.flush()
            time.sleep(PERIOD_S)


if __name__ == "__main__":
    threading.Thread(target=watch, daemon=True).start()
    task = json.loads((SHARED / "task.json").read_text())
    if task["addresses"]:
        measure(task["addresses"], task["lasts_s"])
    else:
        serve()
