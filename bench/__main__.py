"""Print the tables of every benchmark, all on one core."""

from __future__ import annotations

import cv2

from bench import bus, estimate_to_bus, estimator, frames, host, latency, node, startup, tick, twin, twin_hand
from bench.timing import table


def main() -> None:
    cv2.setNumThreads(1)
    materials = list(frames.materials())
    for material in materials:
        print(estimator.report(material))
        print()
    print(startup.report(materials[0]))
    print()
    print(table("Fingertip node and hub", bus.rows()))
    print()
    print(node.report())
    print()
    print(estimate_to_bus.report())
    print()
    print(table("Host, 3 fingers x 3 joints", host.rows()))
    print()
    print(
        table(
            "Kinematics, gravity, Eqs. (9)-(16) and limits, 3 fingers x 5 joints, processor time", tick.rows()
        )
    )
    print()
    print(latency.report_of_a_demo())
    print()
    print(table("The twin's camera, 640x480 in colour, processor time", twin.rows()))
    print()
    print(table("The twin's hand and object, steps of 0.5 ms, processor time", twin_hand.rows()))
    print()
    print(twin_hand.report())


if __name__ == "__main__":
    main()
