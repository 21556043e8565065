"""Simulated AZ drives as a Modbus RTU server on a serial port, with the same bytes as on RS-485."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from pymodbus.constants import ExcCodes
from pymodbus.framer import FramerType
from pymodbus.server import ModbusSerialServer
from pymodbus.simulator import DataType, SimData, SimDevice

from palpate_edge.common.errors import BusError, ConfigError
from palpate_edge.common.local_clock import monotonic_us
from palpate_host.drives.az.config import PortConfig
from palpate_host.drives.az.port import Parity
from palpate_host.drives.az.registers import COMMUNICATION_TIMEOUT
from palpate_twin.drives.az.pty_line import pty_line
from palpate_twin.drives.az.simulated_az import SimulatedAz

LAST_REGISTER = COMMUNICATION_TIMEOUT.address + 1
START_TIMEOUT_S = 5.0


class AzServer:
    """Drives by device id behind one port. lock: protects them from the server's thread."""

    def __init__(self, drives: Mapping[int, SimulatedAz]) -> None:
        self.drives = drives
        self.lock = threading.Lock()

    @contextmanager
    def serve(self, port: str, baud_rate: int) -> Iterator[None]:
        """Serve `port` during the context. Raises BusError if it cannot be opened."""
        ready = threading.Event()
        loop = asyncio.new_event_loop()
        stop = asyncio.Event()
        thread = threading.Thread(
            target=loop.run_until_complete, args=(self._run(port, baud_rate, ready, stop),), name="az server"
        )
        thread.start()
        try:
            if not ready.wait(START_TIMEOUT_S):
                raise BusError(f"{port}: cannot be opened: give a serial port that no other program uses")
            yield
        finally:
            loop.call_soon_threadsafe(stop.set)
            thread.join()
            loop.close()

    async def _run(self, port: str, baud_rate: int, ready: threading.Event, stop: asyncio.Event) -> None:
        server = ModbusSerialServer(
            [self._device(device_id, drive) for device_id, drive in self.drives.items()],
            framer=FramerType.RTU,
            port=port,
            baudrate=baud_rate,
            bytesize=8,
            parity=Parity.NONE.value,
            stopbits=1,
            trace_packet=self._without_foreign_replies,
        )
        await server.serve_forever(background=True)
        ready.set()
        await stop.wait()
        await server.shutdown()  # type: ignore[no-untyped-call]

    def _without_foreign_replies(self, sending: bool, packet: bytes) -> bytes:
        """Suppress the library's error replies for device ids that do not exist, as on a real line."""
        return packet if not sending or packet[0] in self.drives else b""

    def _device(self, device_id: int, drive: SimulatedAz) -> SimDevice:
        async def act(
            _function: int,
            first: int,
            address: int,
            count: int,
            registers: list[int],
            written: list[int] | list[bool] | None,
        ) -> ExcCodes | None:
            with self.lock:
                now_us = monotonic_us()
                if written is not None:
                    if not drive.writable(address, len(written)):
                        return ExcCodes.ILLEGAL_ADDRESS
                    drive.write(now_us, address, [int(word) for word in written])
                elif not drive.readable(address, count):
                    return ExcCodes.ILLEGAL_ADDRESS
                else:
                    start = address - first
                    registers[start : start + count] = drive.read(now_us, address, count)
            return None

        block = SimData(0, values=0, count=LAST_REGISTER + 1, datatype=DataType.REGISTERS)
        return SimDevice(device_id, simdata=[block], action=act)


@contextmanager
def simulated_port(config: PortConfig) -> Iterator[AzServer]:
    """Serve simulated drives for the axes of a port, on a pseudo terminal linked to the port's path."""
    link = Path(config.path)
    server = AzServer({axis.device_id: SimulatedAz(axis.settings.motor) for axis in config.axes})
    with pty_line(config.baud_rate) as (host_end, drive_end), server.serve(drive_end, config.baud_rate):
        try:
            link.symlink_to(host_end)
        except OSError as exc:
            raise ConfigError(
                f"{link}: cannot be created ({exc.strerror}): set ports.path to a new, writable path"
            ) from exc
        try:
            yield server
        finally:
            link.unlink(missing_ok=True)
