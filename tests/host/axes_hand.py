"""Table 4's hand with one drive node a finger: its three joints are axes 0 to 2, on a CAN FD bus."""

import re

import msgspec

MBIT_5 = 5_000_000


def with_axes(config, order=(0, 1, 2)):
    """Finger n has node n, from 1 on. order: the axes of its joints."""
    fingers = tuple(
        msgspec.structs.replace(
            finger,
            joints=tuple(
                msgspec.structs.replace(joint, drive_node=number, axis=axis)
                for joint, axis in zip(finger.joints, order, strict=True)
            ),
        )
        for number, finger in enumerate(config.fingers, 1)
    )
    return msgspec.structs.replace(config, fingers=fingers, bus=on_can_fd(config).bus)


def on_can_fd(config):
    bus = msgspec.structs.replace(config.bus, data_bitrate=MBIT_5)
    return msgspec.structs.replace(config, bus=bus)


def axes_text(text):
    """The same in the text of table4.toml."""
    numbers = iter(range(9))

    def changed(_found):
        number = next(numbers)
        return f"drive_node = {1 + number // 3}, axis = {number % 3},"

    text = re.sub(r"drive_node = \d+,", changed, text)
    return text.replace("[bus]", f"[bus]\ndata_bitrate = {MBIT_5}", 1)
