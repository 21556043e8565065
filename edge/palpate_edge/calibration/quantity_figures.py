"""Figures of single quantities: errors of torsion and weighed presses, how often 95 % intervals hold."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from palpate_edge.common.contact import Contact
from palpate_edge.datasets.press_dataset import Press

Pairs = Sequence[tuple[Press, Contact]]


class TorsionFigures(msgspec.Struct, frozen=True):
    """Torsion of the touched frames against the truth.

    range_Nmm: largest true torsion less the smallest; rmse_percent: of that range; covered_percent: share of
    the frames whose truth is in the 95 % interval.
    """

    count: int
    range_Nmm: float
    rmse_Nmm: float
    rmse_percent: float
    covered_percent: float | None = None


class WeighedFigures(msgspec.Struct, frozen=True):
    """Normal force of the presses on a scale against its display. rmse_percent: of the largest."""

    count: int
    largest_N: float
    rmse_N: float
    rmse_percent: float


def weighed_figures(pairs: Pairs) -> WeighedFigures | None:
    """Return the figures of the weighed presses whose force is estimated; None without any."""
    known = [
        (press.normal_force_N, contact.normal_force_N)
        for press, contact in pairs
        if press.is_weighed and contact.normal_force_N is not None
    ]
    if not known:
        return None
    truth, given = np.array(known, dtype=np.float64).T
    rmse_N, largest_N = float(np.sqrt(((given - truth) ** 2).mean())), float(truth.max())
    return WeighedFigures(len(known), largest_N, rmse_N, 100 * rmse_N / largest_N)


def torsion_figures(pairs: Pairs) -> TorsionFigures | None:
    """Return the figures of the frames with both torsions known; None without any."""
    known = [
        (press.torsion_Nmm, contact.torsion_Nmm, contact.torsion95_Nmm)
        for press, contact in pairs
        if press.torsion_Nmm is not None and contact.torsion_Nmm is not None
    ]
    if not known:
        return None
    truth, given, half_width = (np.array(column, dtype=np.float64) for column in zip(*known, strict=True))
    error = np.abs(given - truth)
    range_Nmm, rmse_Nmm = float(np.ptp(truth)), float(np.sqrt((error**2).mean()))
    bounded = np.isfinite(half_width)
    return TorsionFigures(
        count=len(known),
        range_Nmm=range_Nmm,
        rmse_Nmm=rmse_Nmm,
        rmse_percent=100 * rmse_Nmm / range_Nmm if range_Nmm else 0.0,
        covered_percent=float(100 * (error <= half_width)[bounded].mean()) if bounded.any() else None,
    )


def force_covered_percent(pairs: Pairs) -> float | None:
    """Return the share of the contacts whose true force is within force95_N; None without any."""
    held = [
        float(np.linalg.norm(np.subtract(contact.force_N, press.force_N))) <= contact.force95_N
        for press, contact in pairs
        if press.force_N is not None and contact.force_N is not None and contact.force95_N is not None
    ]
    return 100 * sum(held) / len(held) if held else None


def quantity_lines(
    torsion: TorsionFigures | None, force_percent: float | None, weighed: WeighedFigures | None = None
) -> list[str]:
    """Return the figures for people; none of quantities that are not known."""
    lines = []
    if weighed is not None:
        lines.append(
            f"weighed: {weighed.count} presses up to {weighed.largest_N:.2f} N, normal force RMSE "
            f"{weighed.rmse_N:.3f} N, {weighed.rmse_percent:.2f} % of the largest"
        )
    if force_percent is not None:
        lines.append(f"force: {force_percent:.1f} % within its 95 % radius")
    if torsion is not None:
        held = (
            ""
            if torsion.covered_percent is None
            else f", {torsion.covered_percent:.1f} % in the 95 % interval"
        )
        lines.append(
            f"torsion: RMSE {torsion.rmse_Nmm:.3f} N mm, {torsion.rmse_percent:.2f} % of its range of "
            f"{torsion.range_Nmm:.2f} N mm{held}"
        )
    return lines
