"""Status of the host in each tick, for views and recordings: immutable and ready for JSON."""

from __future__ import annotations

from dataclasses import dataclass

from palpate_edge.common.arrays import Array
from palpate_edge.common.contact_quantities import FlatPose, OptionalQuantities
from palpate_host.common.mode import Mode
from palpate_host.common.tick_inputs import TickInputs

LATE_BINS_US = (50, 100, 200, 500, 1000, 2000, 5000, 10_000)
"""Upper ends of the bins of `HostStatus.lateness`; the last bin has none."""

Matrix = tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class FingerStatus(OptionalQuantities):
    """One fingertip. Position and forces are in frame F, None without contact or where the sensor gives none.

    age_ms: since the last frame's exposure. incomplete, out_of_order, duplicates, late: TPDOs that made no
    contact; lost_frames: gaps in the sequence; unpaired: contacts whose exposure met no known joint angles.
    extra_tpdos: TPDO 5 to 9 taken with their contact; extra_missing, extra_mixed: contacts refused because
    one of these was lost or belongs to another frame. resynchronised: restarts of the sequence numbers.
    flat_pose: of a flat object; None without contact or when the sensor gives no pose. unverified: TPDOs
    that were ignored because the node had not been read since its boot (boot_check.py).
    """

    name: str
    position_mm: tuple[float, float, float] | None
    normal_force_N: float | None
    shear_N: tuple[float, float] | None
    valid: bool
    in_contact: bool
    slip: bool
    quality: int
    sequence: int | None
    age_ms: float | None
    latency_us: int | None
    frames_per_s: float
    complete: int
    incomplete: int
    out_of_order: int
    duplicates: int
    late: int
    lost_frames: int
    unpaired: int
    extra_tpdos: int = 0
    extra_missing: int = 0
    extra_mixed: int = 0
    resynchronised: int = 0
    flat_pose: FlatPose | None = None
    unverified: int = 0


@dataclass(frozen=True, slots=True)
class JointStatus:
    """One joint: its position, its command and the state of its drive.

    command_Nm, torque_Nm: None where a recording lacks them.
    """

    name: str
    position_rad: float | None
    velocity_rad_s: float | None
    command_Nm: float | None
    torque_Nm: float | None
    drive_state: str


@dataclass(frozen=True, slots=True)
class HoldStatus:
    """Friction and grip of the held object; the tuples have an element for each finger.

    friction_ratio: of tangential to normal force, torsion included (tip_friction.py); None where unknown.
    friction: estimate of the skin's friction. friction_margin: friction less its ratio. slips: answered since
    the hold began. grip_N: mean normal force of the internal forces; None unless the pose law holds the
    object. turn_waits: the turn rests, or is undone, because friction allows no more.
    place_mm: of the point in the object that is kept in place (pose_law.object_centre_mm), in the hand's
    frame; place95_mm, orientation95_deg: 95 % radii of it and of R_c. load_N: steady force that the law
    carries, in the hand's frame; is_load_known: False while it is being learned. place_error_mm: distance of
    place_mm from its present target. All of these are None, or False, unless the pose law holds the object.
    gait: of a turn by finger gaiting, planning, refused or its phase (gait.py), empty without one;
    gait_reason: why it was refused or stopped; lifted: the finger, from 0, that does not hold.
    """

    friction_ratio: tuple[float | None, ...]
    friction: tuple[float, ...]
    friction_margin: tuple[float | None, ...]
    slips: tuple[int, ...]
    grip_N: float | None
    turn_waits: bool
    place_mm: tuple[float, float, float] | None = None
    place95_mm: float | None = None
    orientation95_deg: float | None = None
    load_N: tuple[float, float, float] | None = None
    is_load_known: bool = False
    place_error_mm: float | None = None
    gait: str = ""
    gait_reason: str = ""
    lifted: int | None = None


@dataclass(slots=True)
class Counters:
    """Counters since the start. late_ticks: ticks skipped because the loop came too late.

    status_lines_lost: lines of `run --status` that the reader was too slow for. transmit_retries,
    error_frames, receive_overruns, bus_restarts: of the host's CAN controller (`BusCounters`); 0 in a replay.
    foreign_frames: frames of no node of hand.toml, and 29-bit and CAN FD frames.
    """

    ticks: int = 0
    late_ticks: int = 0
    frames_in: int = 0
    frames_out: int = 0
    foreign_frames: int = 0
    emergencies: int = 0
    status_lines_lost: int = 0
    transmit_retries: int = 0
    error_frames: int = 0
    receive_overruns: int = 0
    bus_restarts: int = 0


@dataclass(frozen=True, slots=True)
class HostStatus:
    """The host at `time_us` (epoch us).

    R_vir, R_c, R_d, R_d_vir: rows of Eqs. (12), (16), the target and (15); None while they do not exist.
    orientation_error_deg: angle from R_c to R_d. fit_residual_deg: largest misfit of a contact normal.
    target_rpy_deg: the turn asked for at the end of the ramp. turned: share of that ramp that is done.
    fit_residual_deg, target_rpy_deg and turned are None, and mode is Mode.UNKNOWN, where a recording lacks
    them. lateness: ticks so far by how much later than due they began (LATE_BINS_US). inputs: what the tick
    depends on beside the frames, for a replay; None in recordings that lack it. hold: friction and grip; None
    in recordings that lack it.
    """

    time_us: int
    mode: Mode
    reason: str
    warning: str
    fingers: tuple[FingerStatus, ...]
    joints: tuple[JointStatus, ...]
    R_vir: Matrix | None
    R_c: Matrix | None
    R_d: Matrix | None
    R_d_vir: Matrix | None
    orientation_error_deg: float | None
    fit_residual_deg: float | None
    target_rpy_deg: tuple[float, float, float] | None
    last_emergency: str
    counters: Counters
    turned: float | None = 0.0
    lateness: tuple[int, ...] = ()
    inputs: TickInputs | None = None
    hold: HoldStatus | None = None


def matrix(R: Array | None) -> Matrix | None:
    """A 3 x 3 array as nested tuples."""
    return None if R is None else tuple((float(a), float(b), float(c)) for a, b, c in R)
