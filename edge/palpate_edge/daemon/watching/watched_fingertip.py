"""Commands that a console may give to a fingertip, with a daemon or without one, and their refusals."""

from __future__ import annotations

from pathlib import Path

from palpate_edge.common.contact_quantities import AI_AUTOZERO
from palpate_edge.daemon.capture_factory import AnyCalibration
from palpate_edge.daemon.watching.watch_messages import WatchedFingertip, WatchRefusedError
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.frame_estimator import FrameEstimator
from palpate_edge.illumination.controller_thread import LightController
from palpate_edge.node.change_policy import WriteRates
from palpate_edge.node.nmt import NmtState
from palpate_edge.node.sdo_abort import SdoAbortError

TARE_TEXT = "tare: the next frames are the untouched skin"
NO_LIGHT = "no LED ring: set illumination.i2c_bus to its I2C bus"
NO_TARE = "no tare: a fingertip without calibration, or of poses, has no reference of contacts"
TOO_MANY_TARES = "too many tares: wait a second"


def describe(
    name: str,
    calibration: AnyCalibration | None,
    estimator: FrameEstimator,
    light: LightController | None,
    pictures: Path,
) -> WatchedFingertip:
    """Return the description of a fingertip for its console. pictures: path of the ring of frames."""
    dome = calibration.sensor.dome if isinstance(calibration, Calibration) else None
    return WatchedFingertip(
        name=name,
        method="none" if estimator.method is None else estimator.method.value,
        outer_radius_mm=None if dome is None else dome.outer_radius_mm,
        has_light=light is not None,
        has_tare=dome is not None,
        pictures=str(pictures),
    )


def count_tare(fingertip: WatchedFingertip, rates: WriteRates, now_us: int) -> None:
    """Count a tare at the rate that applies to 6125h.

    Raises WatchRefusedError for a fingertip that has no reference to renew, and beyond the rate.
    """
    if not fingertip.has_tare:
        raise WatchRefusedError(NO_TARE)
    try:
        rates.take(now_us, AI_AUTOZERO)
    except SdoAbortError:
        raise WatchRefusedError(TOO_MANY_TARES) from None


def needed_light(light: LightController | None) -> LightController:
    """Return the controller of the LEDs. Raises WatchRefusedError when there is none, or it does not
    answer."""
    if light is None:
        raise WatchRefusedError(NO_LIGHT)
    if light.latest.problem:
        raise WatchRefusedError(light.latest.problem)
    return light


def refuse_blinking(state: NmtState) -> None:
    """Raise WatchRefusedError while a hand uses the contacts: half of the frames are dark in blinking."""
    if state is NmtState.OPERATIONAL:
        raise WatchRefusedError("the fingertip is operational, a hand uses its contacts: stop the host first")
