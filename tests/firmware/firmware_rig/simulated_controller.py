"""The real binary on a simulated ATmega328P: wires in, wires out, and an I2C controller bit by bit.

A rig for tests, not a part of the product. Time is the simulation's own.
"""

from __future__ import annotations

import errno
import itertools
import random
from pathlib import Path

try:
    from yasimavr.device_library import load_device
    from yasimavr.lib import core
except ModuleNotFoundError:  # the fixture `controller` skips its tests
    load_device = core = None

CLOCK_HZ = 8_000_000
I2C_HZ = 50_000
QUARTER_BIT = CLOCK_HZ // I2C_HZ // 4
BUS_FREE_CYCLES = CLOCK_HZ // 10_000  # what a board's driver needs from one transaction to the next
LONGEST_GLITCH = CLOCK_HZ // 200
HOT_ADC = 128  # 76 degC
STRETCH_LIMIT = 4_000  # quarter bits
IO = 0x20  # the simulator counts I/O registers from there
TCCR0B = 0x45 - IO
COMPARE_OUTPUT, CHANNEL_A = 2, 0


class SimulatedController:
    """Pins: SDA, SCL as an open-drain bus; trigger, both thermistors, the LED's duty."""

    def __init__(self, binary: Path) -> None:
        self.device = load_device("atmega328p")
        self.device.set_option(core.Device.Option.IgnoreBadCpuIO, True)  # it has no DIDR0
        self._loop = core.SimLoop(self.device)
        self._loop.set_fast_mode(True)
        firmware = core.Firmware.read_elf(str(binary))
        firmware.frequency = CLOCK_HZ
        firmware.vcc, firmware.aref = 3.3, 0.5  # of which the firmware must take the first
        self.device.load_firmware(firmware)
        self._probe = core.DeviceDebugProbe(self.device)
        self._sda, self._scl = core.Wire(), core.Wire()
        self._sda.attach(self.device.find_pin("PC4"))
        self._scl.attach(self.device.find_pin("PC5"))
        self._release(self._sda)
        self._release(self._scl)
        self._trigger = core.Wire()
        self._trigger.attach(self.device.find_pin("PD2"))
        self._trigger.set_state("L")
        self._trigger_edges: list[tuple[int, str]] = []
        self._glitches: list[tuple[int, core.Wire, tuple[str, float]]] = []
        self._led: list[tuple[int, bool]] = [(0, False)]
        _, request = self.device.ctlreq(core.IOCTL_TIMER("_", "1"), core.CTLREQ_GET_SIGNAL)
        self._led_hook = core.CallableSignalHook(self._led_changed)
        request.data.as_ptr(core.Signal).connect(self._led_hook, 0)
        self._thermistors = [core.Wire(), core.Wire()]
        for wire, name in zip(self._thermistors, ("PC0", "PC1"), strict=True):
            wire.attach(self.device.find_pin(name))
            wire.set_state("A", 0.5)

    @property
    def bus_is_free(self) -> bool:
        """Both lines of the bus are high."""
        return bool(self._sda.digital_state() and self._scl.digital_state())

    @property
    def cycle(self) -> int:
        return int(self._loop.cycle())

    def run_ms(self, duration_ms: float) -> None:
        self.run_cycles(round(duration_ms * CLOCK_HZ / 1000))

    def run_cycles(self, count: int) -> None:
        end = self.cycle + count
        while self.cycle < end:
            self._drive_trigger()
            self._drive_glitches()
            pending = [edges[0][0] for edges in (self._trigger_edges, self._glitches) if edges]
            self._loop.run(max(1, min(end, *pending) - self.cycle if pending else end - self.cycle))
            assert self.device.state() is not core.Device.State.Crashed, (
                f"crash at {self._probe.read_pc():#x}"
            )

    def set_adc(self, channel: int, reading: int) -> None:
        """The voltage that reads as `reading` of 1023."""
        self._thermistors[channel].set_state("A", (reading + 0.5) / 1024)

    def trigger_at(self, cycle: int) -> None:
        """A 100 us pulse of the camera, at a cycle to come."""
        self._trigger_edges += [(cycle, "H"), (cycle + CLOCK_HZ // 10_000, "L")]

    def disturb(self, rng: random.Random, duration_ms: float) -> None:
        """Random states on every input for the next time, up to 5 ms each; the wires are free at the end."""
        end = self.cycle + round(duration_ms * CLOCK_HZ / 1000)
        for wire in (self._sda, self._scl, self._trigger, *self._thermistors):
            cycle = self.cycle + rng.randrange(LONGEST_GLITCH)
            while cycle < end:
                self._glitches.append((cycle, wire, self._random_state(wire, rng)))
                cycle += round(LONGEST_GLITCH * rng.random() ** 4) + 8
            self._glitches.append((end, wire, self._state_at_rest(wire)))
        self._glitches.sort(key=lambda glitch: glitch[0])

    def _random_state(self, wire: core.Wire, rng: random.Random) -> tuple[str, float]:
        if wire in self._thermistors:
            return "A", rng.choice([0.0, 1.0, rng.random(), (HOT_ADC + 0.5) / 1024])
        return (rng.choice("LU") if wire in (self._sda, self._scl) else rng.choice("LH")), 0.0

    def _state_at_rest(self, wire: core.Wire) -> tuple[str, float]:
        if wire in self._thermistors:
            return "A", 0.5
        return ("L" if wire is self._trigger else "U"), 0.0

    def _drive_glitches(self) -> None:
        while self._glitches and self._glitches[0][0] <= self.cycle:
            _, wire, (state, volts) = self._glitches.pop(0)
            wire.set_state(state, volts) if state == "A" else wire.set_state(state)

    def _drive_trigger(self) -> None:
        while self._trigger_edges and self._trigger_edges[0][0] <= self.cycle:
            self._trigger.set_state(self._trigger_edges.pop(0)[1])

    def _led_changed(self, event: core.signal_data_t, _tag: int) -> None:
        """OC1A, which the simulator does not put on the pin; a disabled output is low."""
        if event.sigid == COMPARE_OUTPUT and event.index == CHANNEL_A:
            level = event.data.type() is not core.vardata_t.Type.Invalid and bool(event.data.as_uint())
            if level != self._led[-1][1]:
                self._led.append((self.cycle, level))

    def led_share(self, duration_ms: float) -> float:
        """How much of the next time the LED driver is on."""
        start = self.cycle
        self.run_ms(duration_ms)
        return self.led_share_between(start, self.cycle)

    def led_share_between(self, start: int, end: int) -> float:
        """The same for the time between two cycles in the past."""
        edges = [*self._led, (end, False)]
        on = sum(
            level * max(0, min(after, end) - max(since, start))
            for (since, level), (after, _) in itertools.pairwise(edges)
        )
        return on / (end - start)

    def led_rises(self, duration_ms: float) -> int:
        """How often the LED driver is switched on in the next time: PWM periods, in steady light."""
        count = len(self._led)
        self.run_ms(duration_ms)
        return sum(level for _, level in self._led[count:])

    def led_edges(self, since: int) -> tuple[int, int]:
        """Cycles of the first rise and of the last fall from a cycle until now."""
        edges = [edge for edge in self._led if edge[0] >= since]
        return next(cycle for cycle, level in edges if level), edges[-1][0]

    def pin_state(self, name: str) -> str:
        """What the chip makes of its pin, in the simulator's words."""
        return str(self.device.find_pin(name).state())

    def stop_tick(self) -> None:
        """Stop timer 0, as a firmware that went astray might."""
        self._probe.write_ioreg(TCCR0B, 0)

    def brown_out(self) -> None:
        self.device.reset(core.Device.ResetFlag.BOD)

    def release(self) -> None:
        """Let go of both lines of the bus."""
        self._release(self._sda)
        self._release(self._scl)

    def _release(self, wire: core.Wire) -> None:
        wire.set_state("U")

    def _wait(self) -> None:
        self.run_cycles(QUARTER_BIT)

    def _raise_clock(self) -> None:
        """Let SCL rise; the target may stretch its low time."""
        self._release(self._scl)
        for _ in range(STRETCH_LIMIT):
            self._wait()
            if self._scl.digital_state():
                return
        raise TimeoutError(errno.ETIMEDOUT, "SCL is held low")

    def _clock(self) -> bool:
        """One clock pulse; SDA while it is high."""
        self._wait()
        self._raise_clock()
        bit = bool(self._sda.digital_state())
        self._wait()
        self._scl.set_state("L")
        self._wait()
        return bit

    def start(self) -> None:
        """Start or repeated start."""
        self._release(self._sda)
        self._wait()
        self._raise_clock()
        self._wait()
        self._sda.set_state("L")
        self._wait()
        self._scl.set_state("L")
        self._wait()

    def stop(self) -> None:
        self._sda.set_state("L")
        self._wait()
        self._raise_clock()
        self._wait()
        self._release(self._sda)
        self.run_cycles(BUS_FREE_CYCLES)

    def send(self, byte: int) -> bool:
        """Eight bits out; whether they were acknowledged."""
        self.send_bits(byte, 8)
        self._release(self._sda)
        return not self._clock()

    def send_bits(self, byte: int, count: int) -> None:
        """The first bits of a byte."""
        for i in range(7, 7 - count, -1):
            if byte >> i & 1:
                self._release(self._sda)
            else:
                self._sda.set_state("L")
            self._clock()

    def receive(self, acknowledge: bool) -> int:
        self._release(self._sda)
        byte = 0
        for _ in range(8):
            byte = byte << 1 | self._clock()
        if acknowledge:
            self._sda.set_state("L")
        self._clock()
        self._release(self._sda)
        return byte
