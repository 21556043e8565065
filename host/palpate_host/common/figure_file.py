"""Write a matplotlib figure; the ending of its name selects the format."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import ConfigError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = (".png", ".svg", ".pdf")
DPI = 110


def save_figure(figure: Figure, path: Path) -> None:
    """Write the figure, complete or not at all; the same figure gives the same SVG.

    Raises ConfigError when the name has no figure's ending or the file system refuses.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise ConfigError(f"{path} cannot be written: give a name that ends in {', '.join(FORMATS)}")
    buffer = BytesIO()
    metadata = {"Date": None} if suffix == ".svg" else None
    figure.savefig(buffer, format=suffix[1:], dpi=DPI, metadata=metadata)
    write_atomically(path, buffer.getvalue(), ConfigError)
