"""The course of a run as a generator: it yields requests, receives their answers, and does nothing else.

A stop of any kind (force, silence, Ctrl-C) is thrown into the generator as a RigError wherever it waits. It
then lifts the ball off the dome along the way that it came, goes up, and raises the error again.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import Any

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError, PalpateError, RigError
from palpate_edge.geometry.sensor import Sensor
from palpate_edge.press_rig.collision import check_move, fault_of
from palpate_edge.press_rig.dome_place import DomePlace
from palpate_edge.press_rig.journal import PressRecord
from palpate_edge.press_rig.marlin import position_of
from palpate_edge.press_rig.plan import PlannedPress
from palpate_edge.press_rig.requests import (
    Command,
    Keep,
    MoveTo,
    Request,
    TakePicture,
    Tell,
    Watch,
    Weigh,
    Weight,
)
from palpate_edge.press_rig.rig_config import RigConfig
from palpate_edge.press_rig.sphere_fit import check_fit, fit_place, onset_mm

REFERENCES = 8  # frames without contact before the presses
SAFE_MM = 8.0  # height of the ball over the expected apex in travel, before the dome is found
GUESS_MM = 6.0  # largest error of presses.apex_mm, with some margin
CLEAR_MM = 2.0  # distance of the ball from the skin before and after a press
COARSE_MM, FINE_MM = 0.5, 0.1  # steps of an approach
FINE_TOUCHES = 3.0  # force in touches at which a fine approach ends
FINE_READINGS = 6  # of the scale at each fine step
FEWEST_FINE = 5  # steps with force that a fine approach needs
SIDES_DEG, SIDES = 55.0, 6  # polar angle of the touches from the sides, and their number
FIRST_SIDES_DEG = 45.0
LABEL_READINGS, TARE_READINGS = 8, 8
MISSES = 3  # presses in a row without a force

Run = Generator[Request, Any, None]
Touch = Generator[Request, Any, Array]


class RunSequence:
    """One run: find the dome, then take the frames of the plan that are missing.

    kept: indices of the plan that are done; missing_references: reference frames to take. place: of the
    dome, None until it is found.
    """

    def __init__(
        self,
        rig: RigConfig,
        sensor: Sensor,
        plan: tuple[PlannedPress, ...],
        done: frozenset[int],
        missing_references: range,
    ) -> None:
        self.place: DomePlace | None = None
        self._rig, self._plan, self._done = rig, plan, done
        self._references = missing_references
        self._dome_mm = sensor.dome.outer_radius_mm
        self._reach_mm = self._dome_mm + rig.probe.ball_radius_mm
        apex_x, apex_y, apex_z = rig.presses.apex_mm
        self._guess = DomePlace((apex_x, apex_y, apex_z - self._reach_mm), self._reach_mm)
        self._at_mm: Array = np.zeros(3)
        self._way_out_mm: Array | None = None  # while the ball may touch the dome
        self._first_us: int | None = None

    def run(self) -> Run:
        """Yield the requests of the whole run."""
        for line in ("G21", "G90", *self._rig.printer.start):
            yield Command(line)
        self._at_mm = np.array(position_of((yield Command("M114"))))
        try:
            yield from self._tare()
            yield from self._rise()
            for number in self._references:
                frame = yield TakePicture()
                yield Keep(f"reference/{number:03d}.png", frame.image)
            if len(self._done) < len(self._plan):
                yield from self._find_dome()
                self._check_plan()
                yield from self._press_all()
            yield from self._rise()
        except PalpateError:
            yield from self._retreat()
            raise

    def _press_all(self) -> Run:
        misses = 0
        for index, press in enumerate(self._plan):
            if index in self._done:
                continue
            is_felt = yield from self._take(index, press)
            misses = 0 if is_felt else misses + 1
            if misses == MISSES:
                raise RigError(
                    f"{MISSES} presses in a row gave no force: fasten the ball probe and look whether the "
                    "fingertip moved, then repeat the command to go on"
                )

    def _take(self, index: int, press: PlannedPress) -> Generator[Request, Any, bool]:
        """Take one frame of the plan; return whether the scale felt the press."""
        start = self._ball_mm(press, -CLEAR_MM)
        yield from self._travel(start, CLEAR_MM)
        tare = yield from self._tare()
        if press.depth_mm == 0:
            yield from self._keep(index, press, 0.0, (0.0, 0.0), 0.0, 0.0)
            return True
        self._way_out_mm = start
        yield from self._step_to(self._ball_mm(press, 0.0))
        depth_mm, weight = 0.0, tare
        # The skin pushes against the ball and, held by friction, down: more than this only at a larger force.
        limit_N = tare.mean_N + self._rig.presses.force_N * math.cos(press.theta_rad)
        while depth_mm < press.depth_mm and weight.mean_N < limit_N:
            depth_mm = min(press.depth_mm, depth_mm + COARSE_MM)
            yield from self._step_to(self._ball_mm(press, depth_mm))
            weight = yield Weigh(1)
        slide_mm = np.array(press.slide_mm) * depth_mm / press.depth_mm
        steps = math.ceil(float(np.hypot(*slide_mm)) / COARSE_MM)
        for step in range(1, steps + 1):
            along, azimuthal = (slide_mm * step / steps).tolist()
            yield from self._step_to(self._ball_mm(press, depth_mm, (along, azimuthal)))
            yield Weigh(1)
        weight = yield Weigh(LABEL_READINGS)
        weight_N = weight.mean_N - tare.mean_N
        is_felt = depth_mm < 2 * COARSE_MM or weight_N > self._rig.presses.touch_N / 2
        if is_felt:
            slid = (float(slide_mm[0]), float(slide_mm[1]))
            sd_N = math.hypot(weight.sd_N, tare.sd_N)
            yield from self._keep(index, press, depth_mm, slid, weight_N, sd_N)
        yield from self._leave()
        return is_felt

    def _keep(
        self,
        index: int,
        press: PlannedPress,
        depth_mm: float,
        slide_mm: tuple[float, float],
        weight_N: float,
        weight_sd_N: float,
    ) -> Run:
        frame = yield TakePicture()
        self._first_us = frame.exposed_at_us if self._first_us is None else self._first_us
        x, y, z = press.outward.tolist()
        name = f"{index:05d}.png"
        record = PressRecord(
            index=index,
            frame=name,
            split=press.split,
            time_s=(frame.exposed_at_us - self._first_us) / 1e6,
            outward=(x, y, z) if depth_mm else None,
            depth_mm=depth_mm,
            slide_mm=slide_mm,
            weight_N=weight_N,
            weight_sd_N=weight_sd_N,
        )
        yield Keep(f"frames/{name}", frame.image, record)

    def _find_dome(self) -> Run:
        """Touch the dome from above, from four sides roughly, then finely from above and from six sides."""
        yield Tell("finding the dome")
        top = yield from self._touch(self._guess, 0.0, 0.0, GUESS_MM, fine=False)
        x, y, z = top.tolist()
        first = DomePlace((x, y, z - self._reach_mm), self._reach_mm)
        touches = [top]
        for side in range(4):
            turn = side * math.pi / 2
            touches.append(
                (yield from self._touch(first, math.radians(FIRST_SIDES_DEG), turn, GUESS_MM, fine=False))
            )
        second, _ = fit_place(np.array(touches), first, free_reach=False)
        touches = [(yield from self._touch(second, 0.0, 0.0, CLEAR_MM, fine=True))]
        for side in range(SIDES):
            turn = side * 2 * math.pi / SIDES
            touches.append(
                (yield from self._touch(second, math.radians(SIDES_DEG), turn, CLEAR_MM, fine=True))
            )
        place, residual_mm = fit_place(np.array(touches), second, free_reach=True)
        check_fit(place, residual_mm, self._reach_mm)
        self.place = place
        centre = ", ".join(f"{value:.2f}" for value in place.centre_mm)
        yield Tell(
            f"dome found: centre at {centre} mm, {place.reach_mm:.2f} mm from centre to centre, touches "
            f"{residual_mm:.3f} mm rms off a sphere"
        )

    def _touch(
        self, place: DomePlace, theta_rad: float, azimuth_rad: float, margin_mm: float, *, fine: bool
    ) -> Touch:
        """Approach a sphere from `margin_mm` outside to as much inside; return the position of first touch.

        Raises RigError when the scale feels nothing.
        """
        start = place.ball_mm(theta_rad, azimuth_rad, -margin_mm)
        yield from self._travel(start, margin_mm)
        tare = yield from self._tare()
        self._way_out_mm = start
        touch_N, depth_mm, weight = self._rig.presses.touch_N, -margin_mm, tare
        while weight.mean_N - tare.mean_N < touch_N:
            depth_mm += COARSE_MM
            if depth_mm > margin_mm:
                raise RigError(
                    f"no touch found at polar angle {math.degrees(theta_rad):.0f} deg, azimuth "
                    f"{math.degrees(azimuth_rad):.0f} deg: fasten the ball probe, correct presses.apex_mm "
                    f"(within {GUESS_MM - 1:g} mm), or look at the scale"
                )
            yield from self._step_to(place.ball_mm(theta_rad, azimuth_rad, depth_mm))
            weight = yield Weigh(1)
        if not fine:
            touched_mm = depth_mm - COARSE_MM / 2
        else:
            touched_mm = yield from self._onset(place, theta_rad, azimuth_rad, depth_mm, tare.mean_N)
        yield from self._leave()
        return place.ball_mm(theta_rad, azimuth_rad, touched_mm)

    def _onset(
        self, place: DomePlace, theta_rad: float, azimuth_rad: float, coarse_mm: float, tare_N: float
    ) -> Generator[Request, Any, float]:
        """Approach again in fine steps; return the depth at which the force sets in."""
        touch_N = self._rig.presses.touch_N
        depth_mm = coarse_mm - 3 * COARSE_MM
        depths: list[float] = []
        forces: list[float] = []
        yield from self._step_to(place.ball_mm(theta_rad, azimuth_rad, depth_mm))
        while len(forces) < FEWEST_FINE or forces[-1] < FINE_TOUCHES * touch_N:
            depth_mm += FINE_MM
            if depth_mm > coarse_mm + 2 * COARSE_MM:
                break
            yield from self._step_to(place.ball_mm(theta_rad, azimuth_rad, depth_mm))
            weight = yield Weigh(FINE_READINGS)
            if weight.mean_N - tare_N > touch_N / 4:
                depths.append(depth_mm)
                forces.append(weight.mean_N - tare_N)
        if len(forces) < FEWEST_FINE or forces[-1] <= forces[0]:
            raise RigError(
                "the force on the scale does not grow with the depth: look at the probe and the scale"
            )
        return onset_mm(np.array(depths), np.array(forces))

    def _check_plan(self) -> None:
        """Refuse a plan of which a position is not allowed, before the first press."""
        assert self.place is not None
        for press in self._plan:
            for depth_mm in (-CLEAR_MM, press.depth_mm):
                fault = fault_of(self._ball_mm(press, depth_mm), self._rig, self.place, self._dome_mm)
                if fault is not None:
                    raise ConfigError(
                        f"at polar angle {math.degrees(press.theta_rad):.0f} deg {fault}: set a smaller "
                        "presses.theta_deg, or correct box, probe and fixture in rig.toml"
                    )

    def _tare(self) -> Generator[Request, Any, Weight]:
        """Weigh the untouched fingertip; the limit of force counts from there."""
        weight: Weight = yield Weigh(TARE_READINGS)
        yield Watch(weight.mean_N + self._rig.presses.stop_N)
        return weight

    def _ball_mm(
        self, press: PlannedPress, depth_mm: float, slide_mm: tuple[float, float] = (0.0, 0.0)
    ) -> Array:
        assert self.place is not None
        return self.place.ball_mm(press.theta_rad, press.azimuth_rad, depth_mm, slide_mm)

    def _travel(self, to_mm: Array, clearance_mm: float) -> Run:
        """Go up, level and down to a position outside of the dome."""
        place = self.place or self._guess
        z_mm = place.bypass_z_mm(self._at_mm, to_mm, clearance_mm)
        for x, y in (self._at_mm[:2], to_mm[:2]):
            yield from self._move(np.array([x, y, z_mm]), self._rig.printer.travel_mm_s)
        yield from self._move(to_mm, self._rig.printer.travel_mm_s)

    def _step_to(self, to_mm: Array) -> Run:
        yield from self._move(to_mm, self._rig.printer.press_mm_s)

    def _leave(self) -> Run:
        """Return to where the approach began."""
        assert self._way_out_mm is not None
        yield from self._move(self._way_out_mm, self._rig.printer.press_mm_s)
        self._way_out_mm = None

    def _rise(self) -> Run:
        """Go straight up to the height of travel."""
        z_mm = max(float(self._at_mm[2]), self._rig.presses.apex_mm[2] + SAFE_MM)
        yield from self._move(np.array([*self._at_mm[:2], z_mm]), self._rig.printer.travel_mm_s)

    def _retreat(self) -> Run:
        """Leave the dome after a stop: along the way of the approach, then up."""
        if self._way_out_mm is not None:
            yield MoveTo(self._way_out_mm, self._rig.printer.press_mm_s)
            self._at_mm = self._way_out_mm
        yield from self._rise()

    def _move(self, to_mm: Array, speed_mm_s: float) -> Run:
        if float(np.abs(to_mm - self._at_mm).max()) < 1e-4:
            return
        place, dome_mm = self.place, self._dome_mm
        if place is None:  # the dome may be anywhere near the guess
            place = DomePlace(self._guess.centre_mm, self._reach_mm - GUESS_MM)
            dome_mm -= GUESS_MM
        check_move(self._at_mm, to_mm, self._rig, place, dome_mm)
        self._at_mm = to_mm
        yield MoveTo(to_mm, speed_mm_s)
