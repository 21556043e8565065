"""A turn by finger gaiting from its request to its end: what is refused, and what a plan has to fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_host.common import rotation
from palpate_host.common.command import CommandError
from palpate_host.common.gait_plan import GaitPlan, fingers_refused
from palpate_host.control.gains import Gains
from palpate_host.control.gait.gait import Gait
from palpate_host.control.gait.object_shape import hull_of
from palpate_host.control.gait.turn_planner import FEWEST_HOLDING
from palpate_host.control.gait.turn_request import TurnRequest
from palpate_host.control.holding.pose_law import PoseLaw
from palpate_host.control.kinematics import HandPose

LEAST_TURN_RAD = 1e-3
TOUCHES_WITHIN_M = 0.005
"""Largest distance of a tip that touches from the object as it was given."""
PLANNED_WITHIN_M, PLANNED_WITHIN_DEG = 0.002, 2.0
"""Largest motion of the object while its turn is planned."""


class Reorientation:
    """The state of one turn.

    request: waits for its plan. gait: carries the plan out; it is kept until the next turn. problem: why the
    last turn was refused, or ended with the hold; empty otherwise.
    """

    def __init__(self) -> None:
        self.request: TurnRequest | None = None
        self.gait: Gait | None = None
        self.problem = ""

    @property
    def lifted(self) -> int | None:
        """The finger, from 0, that does not hold the object; None while all do."""
        return None if self.gait is None else self.gait.away

    @property
    def is_under_way(self) -> bool:
        """True from the request to the end of the gait."""
        return self.request is not None or (self.gait is not None and not self.gait.is_over)

    def check_free(self, what: str) -> None:
        """Raise CommandError, naming the refused command, while a turn is under way or a finger is lifted."""
        if self.is_under_way:
            raise CommandError(
                f"{what} is refused: a turn by finger gaiting is under way; wait until it is over, or grasp"
            )
        if self.lifted is not None:
            raise CommandError(f"{what} is refused: finger {self.lifted + 1} is lifted; grasp first")

    def ask(
        self,
        law: PoseLaw,
        pose: HandPose,
        gains: Gains,
        rpy_deg: tuple[float, float, float],
        corners_mm: Sequence[tuple[float, float, float]],
    ) -> None:
        """Request the plan of a turn of the held object about the centre of its volume.

        Raises CommandError, and changes nothing, where no such object can be turned.
        """
        self.check_free("reorient")
        assert law.object is not None
        fingers = len(law.object.radius_m)
        if fingers <= FEWEST_HOLDING:
            raise fingers_refused(fingers)
        turn_rad = rotation.log(rotation.from_rpy_deg(*rpy_deg))
        angle_rad = rotation.norm(turn_rad)
        if angle_rad < LEAST_TURN_RAD:
            raise CommandError("reorient is refused: it is a turn of 0 deg")
        try:
            shape, centre_m = hull_of(1e-3 * np.array(corners_mm))
        except ValueError as error:
            raise CommandError(f"reorient is refused: {error}") from None
        gaps_m = shape.gap_m(pose.tip_centre_m) - law.object.radius_m
        farthest = int(np.argmax(np.abs(gaps_m)))
        if abs(gaps_m[farthest]) > TOUCHES_WITHIN_M:
            raise CommandError(
                f"reorient is refused: by corners_mm the tip of finger {farthest + 1} is"
                f" {1e3 * gaps_m[farthest]:.1f} mm from the object; give its corners where it is now"
            )
        self.end()
        law.follow_point(centre_m)
        self.request = TurnRequest(
            q_rad=pose.q_rad,
            R=law.object.R,
            place_m=centre_m,
            shape=shape.moved(np.eye(3), -centre_m).moved(law.object.R.T, np.zeros(3)),
            depth_m=gains.tip_radius_m - float(law.object.radius_m.mean()),
            axis=turn_rad / angle_rad,
            angle_rad=angle_rad,
        )

    def take_plan(self, law: PoseLaw, gains: Gains, plan: GaitPlan | None, problem: str) -> None:
        """Take the answer to the request: begin the turn, or note why not. Without a request: nothing."""
        request, self.request = self.request, None
        if request is None or law.object is None:
            return
        moved_m = rotation.norm(law.object.place_m - request.place_m)
        turned_deg = rotation.angle_deg(law.object.R @ request.R.T)
        if plan is None:
            self.problem = problem
        elif moved_m > PLANNED_WITHIN_M or turned_deg > PLANNED_WITHIN_DEG:
            self.problem = (
                f"the turn is refused: the object moved by {1e3 * moved_m:.1f} mm and {turned_deg:.1f} deg"
                " while it was planned; command it again"
            )
        else:
            self.gait = Gait(plan, law, gains)

    def give_up(self, law: PoseLaw, reason: str) -> None:
        """Stop a turn that is under way, with this reason; a lifted finger stays lifted until `grasp`."""
        if self.request is not None:
            self.end(f"the turn is refused: {reason}")
        elif self.gait is not None and not self.gait.is_over:
            self.gait.stop(law, reason)

    def end(self, problem: str = "") -> None:
        """Forget request and gait. problem: why the turn ended, if it has not been completed."""
        self.request = self.gait = None
        self.problem = problem
