"""Functions of core.c, called one at a time, in a library for this machine or in the simulated binary.

Both have the same methods, so that a property can be tested on both. The chip computes in 16 bits where this
machine computes in 32.
"""

from __future__ import annotations

import ctypes
import itertools
import subprocess
from pathlib import Path
from typing import Protocol

from firmware_rig.simulated_controller import CLOCK_HZ, core, load_device

REGISTERS = 0x19
DATA = 0x800000  # where the linker counts RAM from
FREE_RAM, STRIDE, SLOTS = 0x200, 0x80, 8  # above the program's variables
STACK = 0x8F0
CALL_CYCLES = 20_000  # the longest function takes 1000


def fields(pack: int) -> type[ctypes.Structure]:
    """core_t of core.h; the AVR has no alignment, which is `pack` 1."""

    class Thermistor(ctypes.Structure):
        _pack_ = pack
        _fields_ = (("adc", ctypes.c_uint16), ("broken", ctypes.c_uint8))

    class Core(ctypes.Structure):
        _pack_ = pack
        _fields_ = (
            ("reg", ctypes.c_uint16 * REGISTERS),
            ("level_now", ctypes.c_uint16),
            ("silent_ms", ctypes.c_uint16),
            ("ms", ctypes.c_uint16),
            ("led", Thermistor),
            ("silicone", Thermistor),
            ("received", ctypes.c_uint8),
            ("sent", ctypes.c_uint8),
            ("crc", ctypes.c_uint8),
            ("command", ctypes.c_uint8),
            ("value", ctypes.c_uint16),
        )

    return Core


class FirmwareCalls(Protocol):
    """`new` gives a place for a core_t, `core` its content; `call` returns 16 bits."""

    def new(self) -> int: ...
    def core(self, place: int) -> ctypes.Structure: ...
    def call(self, name: str, *arguments: int) -> int: ...


class HostCalls:
    """core.c compiled for this machine."""

    def __init__(self, library: Path) -> None:
        self._library = ctypes.CDLL(str(library))
        for name in ("core_duty", "smbus_write", "smbus_read", "thermistor_dC"):
            getattr(self._library, name).restype = ctypes.c_int16
        self._type = fields(0)
        self._cores: list[ctypes.Structure] = []

    def new(self) -> int:
        self._cores = [*self._cores[-SLOTS:], self._type()]
        return ctypes.addressof(self._cores[-1])

    def core(self, place: int) -> ctypes.Structure:
        return self._type.from_address(place)

    def call(self, name: str, *arguments: int) -> int:
        first, *others = arguments
        place = first if name == "thermistor_dC" else ctypes.c_void_p(first)
        return int(getattr(self._library, name)(place, *others)) & 0xFFFF


class ChipCalls:
    """illumination.elf on a simulated ATmega328P, stopped at the begin of main().

    Arguments and results go by avr-gcc's calling convention: r25:r24, then r23:r22 and so on.
    """

    def __init__(self, binary: Path) -> None:
        self._device = load_device("atmega328p")
        self._loop = core.SimLoop(self._device)
        self._loop.set_fast_mode(True)
        firmware = core.Firmware.read_elf(str(binary))
        firmware.frequency, firmware.vcc, firmware.aref = CLOCK_HZ, 3.3, 3.3
        self._device.load_firmware(firmware)
        self._probe = core.DeviceDebugProbe(self._device)
        listing = subprocess.run(["avr-nm", binary], check=True, capture_output=True, text=True).stdout
        self._at = {name: int(address, 16) for address, _, name in map(str.split, listing.splitlines())}
        self._type = fields(1)
        self._places = itertools.cycle(range(FREE_RAM, FREE_RAM + SLOTS * STRIDE, STRIDE))
        assert self._at["_end"] - DATA <= FREE_RAM
        self._probe.insert_breakpoint(self._at["main"])
        self._loop.run(CALL_CYCLES)
        assert self._probe.read_pc() == self._at["main"]
        self._probe.remove_breakpoint(self._at["main"])
        self._end = self._at["__stop_program"]  # every function returns there
        self._probe.insert_breakpoint(self._end)

    def new(self) -> int:
        return next(self._places)

    def core(self, place: int) -> ctypes.Structure:
        return self._type.from_buffer_copy(bytes(self._probe.read_data(place, ctypes.sizeof(self._type))))

    def call(self, name: str, *arguments: int) -> int:
        self._probe.write_sp(STACK)
        self._probe.write_data(STACK + 1, (self._end // 2).to_bytes(2, "big"))
        for index, argument in enumerate(arguments):
            self._probe.write_gpreg(24 - 2 * index, argument & 0xFF)
            self._probe.write_gpreg(25 - 2 * index, argument >> 8 & 0xFF)
        self._probe.write_pc(self._at[name])
        self._probe.set_device_state(core.Device.State.Running)
        self._loop.run(CALL_CYCLES)
        assert self._probe.read_pc() == self._end, f"{name} does not return"
        return int(self._probe.read_gpreg(24) | self._probe.read_gpreg(25) << 8)
