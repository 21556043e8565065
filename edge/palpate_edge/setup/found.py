"""The parts that a search found on this board, and one line of text for each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FoundCamera:
    """A source of frames. source: its name in finger.toml; path: a stable name; what: a description.

    size_px: width and height that it gives, None when several or unknown; problem: why it cannot be used,
    empty if it can.
    """

    source: str
    path: str
    what: str
    size_px: tuple[int, int] | None = None
    problem: str = ""

    @property
    def line(self) -> str:
        """The camera as a line of text."""
        return f"{self.source:<14}{self.path}: {self.what}" + (f" ({self.problem})" if self.problem else "")


@dataclass(frozen=True, slots=True)
class FoundBus:
    """A CAN interface of the kernel, or the local hub. what: its state; is_down: no frame can be sent."""

    interface: str
    channel: str
    what: str
    is_down: bool = False

    @property
    def line(self) -> str:
        """The bus as a line of text."""
        return f"{self.interface:<14}{self.channel or '(default)'}: {self.what}"


@dataclass(frozen=True, slots=True)
class FoundLight:
    """An I2C bus. problem: why no illumination controller was found on it, empty if one answered."""

    i2c_bus: int
    problem: str

    @property
    def line(self) -> str:
        """The I2C bus as a line of text."""
        return f"/dev/i2c-{self.i2c_bus}: {self.problem or 'illumination controller'}"
