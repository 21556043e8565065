"""Three fingertip nodes on a bus that feel an object at their apexes 30 times a second: a process for tests.

python touching_fingertips.py HAND.toml [FINGER ...]     only these fingers, all by default
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from palpate_edge.can_bus.bus import open_bus
from palpate_edge.common.contact import Contact
from palpate_edge.common.signals import stop_event
from palpate_edge.node.events import StoreRequested
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import Health, MethodCode
from palpate_host.config import hand_reader

PERIOD_US = 33_333
LATENCY_US = 5_000


def felt(sequence: int, exposed_at_us: int) -> Contact:
    return Contact(
        sequence=sequence,
        exposed_at_us=exposed_at_us,
        valid=True,
        in_contact=True,
        position_mm=(0.0, 0.0, 30.0),
        normal_force_N=1.0,
        force_N=None,
        torsion_Nmm=None,
        quality=1.0,
        reason="",
        beads_found=85,
        beads_expected=85,
    )


def main(config_path: Path, names: list[str]) -> None:
    config = hand_reader.load(config_path)
    tips = [
        FingertipNode(
            finger.fingertip_node, MethodCode.CORRECTED, "0" * 16, data_bitrate=config.bus.data_bitrate
        )
        for finger in config.fingers
        if not names or finger.name in names
    ]
    for tip in tips:
        tip.report_health(Health(temperature_degC=31.5, frames_dropped=0, led_level=128))
    with open_bus(config.bus, "fingertips") as bus, stop_event() as stopped:
        print("fingertips: on the bus", file=sys.stderr, flush=True)
        sequence, next_us, received = 0, time.time_ns() // 1000, []
        while not stopped.is_set():
            now_us = time.time_ns() // 1000
            if now_us >= next_us:
                sequence, next_us = sequence + 1, max(next_us + PERIOD_US, now_us)
                for tip in tips:
                    tip.publish(felt(sequence, now_us - LATENCY_US), LATENCY_US)
            frames = [frame for _, frame in received]
            for tip in tips:
                output = tip.process(now_us, frames)
                bus.send(output.frames_out)
                if any(isinstance(event, StoreRequested) for event in output.events):
                    tip.slave.store_finished(True)
            received = bus.receive(0.005)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
