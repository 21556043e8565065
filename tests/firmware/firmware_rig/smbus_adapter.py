"""SMBus words with PEC over the simulated wires: what an adapter and the kernel do for smbus2."""

from __future__ import annotations

import errno

from firmware_rig.simulated_controller import SimulatedController


def crc8(data: bytes) -> int:
    """SMBus 3.1, 6.4: polynomial x^8 + x^2 + x + 1, by long division of the whole message."""
    remainder = int.from_bytes(data, "big") << 8
    for bit in range(remainder.bit_length() - 1, 7, -1):
        if remainder >> bit & 1:
            remainder ^= 0x107 << (bit - 8)
    return remainder


class WireSmBus:
    """smbus2's words on the wires of a SimulatedController."""

    pec = 0

    def __init__(self, controller: SimulatedController) -> None:
        self.controller = controller

    def read_word_data(self, i2c_addr: int, register: int) -> int:
        wires = self.controller
        write, read = i2c_addr << 1, i2c_addr << 1 | 1
        wires.start()
        acknowledged = wires.send(write) and wires.send(register)
        wires.start()
        acknowledged = acknowledged and wires.send(read)
        if not acknowledged:
            wires.stop()
            raise OSError(errno.EREMOTEIO, "Remote I/O error")
        data = [wires.receive(True), wires.receive(True), wires.receive(False)]
        wires.stop()
        if crc8(bytes([write, register, read, *data[:2]])) != data[2]:
            raise OSError(errno.EBADMSG, "Bad message")
        return data[0] | data[1] << 8

    def write_word_data(self, i2c_addr: int, register: int, value: int) -> None:
        message = bytes([i2c_addr << 1, register, value & 0xFF, value >> 8])
        self.send([*message, crc8(message)])

    def send(self, message: list[int]) -> None:
        """Raw bytes from the address on; OSError at the first that is not acknowledged."""
        self.controller.start()
        acknowledged = all(self.controller.send(byte) for byte in message)
        self.controller.stop()
        if not acknowledged:
            raise OSError(errno.EREMOTEIO, "Remote I/O error")

    def close(self) -> None:
        """Wires stay."""
