"""Plan a large turn: how far the object turns, then which fingers take hold again, and where.

All fingers follow the object until one of them reaches the end of what it can do (finger_reach.py). There
each finger that cannot go on for `WORTH_TURNING_RAD` takes hold again, one after another: of the places on
all faces at which its tip can arrive, the one from which it follows the turn farthest, and of equal ones that
with the smallest friction angle. The three fingers or more that hold meanwhile must need no more friction
than `pose_law.friction` less `FRICTION_MARGIN` (grip_shares.py), and the tip's way must clear the object and
the other tips. The order of the fingers is searched depth first, the smallest need first.

A smaller limit of the friction angle makes more and shorter steps, whose grasps need less friction: the
limits in `STEEPEST` are tried in turn. Han and Trinkle (Dextrous manipulation by rolling and finger gaiting,
ICRA 1998) divide such a turn likewise: motion of all fingers, and change of one while the others hold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.common.gait_plan import (
    GaitPlan,
    GaitRefusal,
    GaitRefusedError,
    Regrasp,
    TurnTo,
    fingers_refused,
)
from palpate_host.control.gait.finger_reach import FingerReach, ObjectPath, Touch
from palpate_host.control.gait.grip_shares import best_shares
from palpate_host.control.gait.object_shape import ObjectShape, ShapeFace

FEWEST_HOLDING = 3
FRICTION_MARGIN = 0.05
EQUAL_MARGIN = 0.05
"""Further margin up to which the fingers share the grip as equally as they can."""
STEEPEST = (0.34, 0.3, 0.26, 0.22)
"""Limits of the tangent of the angle between a contact's normal and the line from the object's place."""
WORTH_TURNING_RAD = math.radians(10.0)
GRID_M = 0.002
GRID_REACH_M = 0.020
"""Places on a face are this far apart, and this far at most from the point below the object's place."""
CLEARANCES_M = (0.006, 0.010, 0.015, 0.020, 0.030)
OVER_OBJECT_M, BETWEEN_TIPS_M = 0.002, 0.004
WAY_POINTS = 12
MOST_REGRASPS = 40


@dataclass(frozen=True, slots=True)
class _Option:
    """A place for a finger: where it ends, and the steepest friction angle on the way."""

    touch: Touch
    reach_rad: float
    steepness: float


def plan_turn(
    reach: FingerReach,
    shape: ObjectShape,
    path: ObjectPath,
    q_rad: Array,
    angle_rad: float,
    friction: float,
) -> GaitPlan:
    """Return the plan of a turn from the present grasp.

    shape: in the object's frame, its origin the place about which the object turns. q_rad: (nq,) joints with
    which all tips touch. friction: of the tips, as the law assumes it.

    Raises GaitRefusedError when the hand cannot.
    """
    if reach.fingers <= FEWEST_HOLDING:
        raise fingers_refused(reach.fingers)
    refused: GaitRefusedError | None = None
    for steepest in STEEPEST:
        try:
            return _Planner(reach, shape, path, friction - FRICTION_MARGIN, steepest).plan(q_rad, angle_rad)
        except GaitRefusedError as error:
            refused = refused or error
    assert refused is not None
    raise refused


class _Planner:
    def __init__(
        self, reach: FingerReach, shape: ObjectShape, path: ObjectPath, most_friction: float, steepest: float
    ) -> None:
        self._reach, self._shape, self._path = reach, shape, path
        self._most_friction, self._steepest = most_friction, steepest
        self._enough = most_friction - EQUAL_MARGIN

    def plan(self, q_rad: Array, angle_rad: float) -> GaitPlan:
        """Return the plan, or raise GaitRefusedError."""
        touches = self._first_touches(q_rad)
        normals = tuple(_vector(touch.face.normal) for touch in touches)
        steps: list[TurnTo | Regrasp] = []
        now = 0.0
        while True:
            ways = [
                self._reach.follow(finger, touch, self._path, now, angle_rad, self._limit(touch, now))
                for finger, touch in enumerate(touches)
            ]
            ends = [found[-1][0] for found, _ in ways]
            until, first = min(ends), int(np.argmin(ends))
            if until > now:
                share, needed = best_shares(
                    [self._grasp(self._at(ways, angle), angle) for angle in (now, until)],
                    [True] * len(touches),
                    self._enough,
                )
                touches = self._at(ways, until)
                steps.append(TurnTo(until, _floats(share), needed))
                now = until
            if now >= angle_rad - 1e-9:
                return GaitPlan(_vector(self._path.axis), angle_rad, normals, tuple(steps))
            going = min(WORTH_TURNING_RAD, angle_rad - now)
            tired = [finger for finger, end in enumerate(ends) if end < now + going - 1e-9]
            options = {finger: self._options(finger, touches[finger], now, angle_rad) for finger in tired}
            for finger in tired:
                best = max((option.reach_rad for option in options[finger]), default=0.0)
                if best < going - 1e-9:
                    raise self._out_of_reach(finger, now, ways[first][1])
            regrasps = self._ordered(touches, tired, options, now)
            if len(steps) + len(regrasps) > MOST_REGRASPS:
                raise self._out_of_reach(first, now, ways[first][1])
            for regrasp, touch in regrasps:
                touches[regrasp.finger] = touch
            steps += [regrasp for regrasp, _ in regrasps]

    def _first_touches(self, q_rad: Array) -> list[Touch]:
        """Return the present contacts, each tip at the distance of its radius from its face."""
        path, touches = self._path, []
        for finger, tip_m in enumerate(self._reach.tips_m(q_rad)):
            face = self._shape.nearest_face(path.R.T @ (tip_m - path.place_m))
            tip_from_place_m = path.R.T @ (tip_m - path.place_m)
            point_m = tip_from_place_m - face.normal * (face.normal @ tip_from_place_m - face.distance_m)
            touch = self._placed(finger, q_rad, face, point_m, 0.0)
            touches.append(Touch(face, q_rad, point_m) if touch is None else touch)
        return touches

    def _limit(self, touch: Touch, angle_rad: float) -> float:
        """Return the limit of the friction angle; a grasp that is steeper from the start may stay so."""
        return max(self._steepest, _steepness(touch) + 1e-6) if angle_rad == 0.0 else self._steepest

    @staticmethod
    def _at(ways: Sequence[tuple[list[tuple[float, Touch]], str]], angle_rad: float) -> list[Touch]:
        return [min(found, key=lambda one: abs(one[0] - angle_rad))[1] for found, _ in ways]

    def _grasp(self, touches: Sequence[Touch], angle_rad: float) -> tuple[Array, Array]:
        """Return contacts and normals (n, 3) in the hand's frame, from the object's place."""
        R = self._path.at(angle_rad)
        return (
            np.array([touch.point_m for touch in touches]) @ R.T,
            np.array([touch.face.normal for touch in touches]) @ R.T,
        )

    def _placed(
        self, finger: int, q_rad: Array, face: ShapeFace, point_m: Array, angle_rad: float
    ) -> Touch | None:
        """Return the touch of a finger at a point (3,) of a face, None where its tip does not get there."""
        centre_m = point_m + self._reach.rolling_radius_m * face.normal
        q = self._reach.with_tip_at(finger, q_rad, self._path.place_m + self._path.at(angle_rad) @ centre_m)
        return None if q is None else Touch(face, q, point_m)

    def _options(self, finger: int, touch: Touch, now: float, end: float) -> list[_Option]:
        """Return the places where a finger may take hold, the best first."""
        R, found = self._path.at(now), []
        axis = R.T @ self._path.axis
        for face in self._shape.faces:
            along = rotation.cross(axis, face.normal)
            if face.distance_m <= 0.0 or rotation.norm(along) < 0.1:
                continue
            along = along / rotation.norm(along)
            for shift_m in np.arange(-GRID_REACH_M, GRID_REACH_M + 1e-9, GRID_M):
                point_m = face.distance_m * face.normal + shift_m * along
                if face.inset_m(point_m) < 0.0 or abs(shift_m) > self._steepest * face.distance_m:
                    continue
                placed = self._placed(finger, touch.q_rad, face, point_m, now)
                if placed is None or self._reach.problem(finger, placed, R, self._steepest):
                    continue
                way, _ = self._reach.follow(finger, placed, self._path, now, end, self._steepest)
                steepness = max(_steepness(one) for _, one in way)
                found.append(_Option(placed, way[-1][0] - now, steepness))
        return sorted(found, key=lambda one: (-round(one.reach_rad, 3), one.steepness))

    def _ordered(
        self, touches: list[Touch], tired: list[int], options: dict[int, list[_Option]], now: float
    ) -> list[tuple[Regrasp, Touch]]:
        """Return the regrasps of all tired fingers in an order in which the others hold the object."""
        worst: list[GaitRefusedError] = []
        found = self._search(list(touches), tired, options, now, worst)
        if found is None:
            raise worst[0]
        return found

    def _search(
        self,
        touches: list[Touch],
        left: list[int],
        options: dict[int, list[_Option]],
        now: float,
        worst: list[GaitRefusedError],
    ) -> list[tuple[Regrasp, Touch]] | None:
        if not left:
            return []
        grasp = self._grasp(touches, now)
        needs = []
        for finger in left:
            share, needed = best_shares(
                [grasp], [other != finger for other in range(len(touches))], self._enough
            )
            needs.append((needed, finger, share))
        for needed, finger, share in sorted(needs, key=lambda one: one[:2]):
            if needed > self._most_friction:
                worst.append(self._too_slippery(finger, now, needed))
                continue
            chosen = self._reachable(finger, touches, options[finger], now)
            if chosen is None:
                worst.append(self._tips_touch(finger, now))
                continue
            touch, clearance_m = chosen
            after = [touch if other == finger else one for other, one in enumerate(touches)]
            share_after, _ = best_shares([self._grasp(after, now)], [True] * len(after), self._enough)
            regrasp = Regrasp(
                finger=finger,
                normal=_vector(touch.face.normal),
                point_m=_vector(touch.point_m),
                clearance_m=clearance_m,
                share=_floats(share),
                share_after=_floats(share_after),
                friction=needed,
            )
            rest = self._search(after, [one for one in left if one != finger], options, now, worst)
            if rest is not None:
                return [(regrasp, touch), *rest]
        return None

    def _reachable(
        self, finger: int, touches: list[Touch], options: list[_Option], now: float
    ) -> tuple[Touch, float] | None:
        """Return the best place to which the tip finds a way, with the clearance of that way."""
        best = options[0].reach_rad
        tips_m = np.array([self._reach.tips_m(one.q_rad)[other] for other, one in enumerate(touches)])
        others_m = np.delete(tips_m, finger, axis=0)
        for option in options:
            if option.reach_rad < 0.7 * best:
                break
            for clearance_m in CLEARANCES_M:
                if self._is_free(finger, touches[finger], option.touch, others_m, clearance_m, now):
                    return option.touch, clearance_m
        return None

    def _is_free(
        self, finger: int, start: Touch, end: Touch, others_m: Array, clearance_m: float, now: float
    ) -> bool:
        """Return whether the straight way between both lifted places clears object and tips, within reach."""
        R, radius_m = self._path.at(now), self._reach.radius_m
        lifted_m = [one.point_m + (radius_m + clearance_m) * one.face.normal for one in (start, end)]
        share = np.linspace(0.0, 1.0, WAY_POINTS)[:, None]
        way_m = (1.0 - share) * lifted_m[0] + share * lifted_m[1]
        if float(self._shape.gap_m(way_m).min()) < radius_m + OVER_OBJECT_M:
            return False
        q = start.q_rad
        for centre_m in [
            *(self._path.place_m + way_m @ R.T),
            self._path.place_m + R @ _centre(end, radius_m),
        ]:
            apart_m = np.linalg.norm(others_m - centre_m, axis=1)
            if float(apart_m.min()) < 2.0 * radius_m + BETWEEN_TIPS_M:
                return False
            found = self._reach.with_tip_at(finger, q, centre_m)
            if found is None:
                return False
            q = found
        return True

    def _out_of_reach(self, finger: int, now: float, why: str) -> GaitRefusedError:
        return GaitRefusedError(
            GaitRefusal.REACH,
            f"the turn is refused: at {math.degrees(now):.0f} deg finger {finger + 1} cannot follow further"
            f" ({why}) and reaches no better place: turn less, or about another axis",
        )

    def _too_slippery(self, finger: int, now: float, needed: float) -> GaitRefusedError:
        return GaitRefusedError(
            GaitRefusal.FRICTION,
            f"the turn is refused: at {math.degrees(now):.0f} deg, without finger {finger + 1}, the grip"
            f" needs a friction of {needed:.2f}, pose_law.friction leaves {self._most_friction:.2f}:"
            " turn less, or use tips with more friction",
        )

    @staticmethod
    def _tips_touch(finger: int, now: float) -> GaitRefusedError:
        return GaitRefusedError(
            GaitRefusal.TIPS,
            f"the turn is refused: at {math.degrees(now):.0f} deg finger {finger + 1} finds no way to a new"
            " place that clears the object and the other tips: turn less, or about another axis",
        )


def _floats(values: Array) -> tuple[float, ...]:
    return tuple(values.tolist())


def _vector(v: Array) -> tuple[float, float, float]:
    x, y, z = v.tolist()
    return x, y, z


def _centre(touch: Touch, radius_m: float) -> Array:
    return touch.point_m + radius_m * touch.face.normal


def _steepness(touch: Touch) -> float:
    """Return the tangent of the angle between a contact's normal and the line from the object's place."""
    height = float(touch.face.normal @ touch.point_m)
    return rotation.norm(touch.point_m - height * touch.face.normal) / max(height, 1e-9)
