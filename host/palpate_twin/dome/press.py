"""Solve one press: a probe moves along the dome's inward normal, along the tangent plane, then twists.

The contact is at azimuth 0, in the x-z plane of frame F; other azimuths follow by rotation about z. Forces
are per shear modulus, in mm^2; times mu in N/mm^2 they are in N. Torques, in mm^3, become N mm.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_twin.dome.equilibrium import ElasticDome, Equilibrium, State
from palpate_twin.dome.probe import Probe, ProbePose

Shear = tuple[float, float]

# Steps of the probe (depth, slide, slide); a step that fails is halved. A point that comes into contact gets
# its anchor at the end of the step, so long steps in depth lose friction (2 % of the force at 0.5 mm).
LONGEST_STEP_MM = np.array([0.25, 0.5, 0.5])
SHORTEST_STEP_MM = 0.01
BASE_SHARE = 0.95  # largest depth of a plate as a fraction of 30 (1 - sin theta), where it reaches the base
NO_SHEAR: Shear = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class PressedDome:
    """Solution of one press, in frame F.

    displacement_mm: (n, 3) of the mesh's nodes; force_per_mu_mm2: (3,) contact force on the whole dome;
    base_per_mu_mm2: (3,) force of the base on the dome, in equilibrium the negative of the contact force;
    touch_mm: (3,) point of first touch; pressure_centre_mm: (3,) centroid of the pressure on the deformed
    surface; largest_pressure: in units of mu; state: start of further steps; twist_rad: of the probe;
    torsion_per_mu_mm3: moment of the contact force about the inward normal through touch_mm.
    """

    theta_rad: float
    depth_mm: float
    shear_mm: Shear
    probe: Probe
    displacement_mm: Array
    force_per_mu_mm2: Array
    base_per_mu_mm2: Array
    touch_mm: Array
    pressure_centre_mm: Array
    largest_pressure: float
    iterations: int
    state: State
    twist_rad: float = 0.0
    torsion_per_mu_mm3: float = 0.0


def directions(theta_rad: float) -> tuple[Array, Array, Array]:
    """Return outward normal, meridional (towards the base) and azimuthal (+y) tangent at azimuth 0."""
    sin, cos = np.sin(theta_rad), np.cos(theta_rad)
    return np.array([sin, 0, cos]), np.array([cos, 0, -sin]), np.array([0.0, 1.0, 0.0])


def largest_depth_mm(theta_rad: float, probe: Probe, outer_radius_mm: float = 30.0) -> float:
    """Return the largest depth of a probe: an infinite plate reaches the base edge at R (1 - sin theta)."""
    if probe is Probe.PLATE:
        return float(BASE_SHARE * outer_radius_mm * (1 - np.sin(theta_rad)))
    return outer_radius_mm


def press(
    dome: ElasticDome,
    theta_rad: float,
    depth_mm: float,
    probe: Probe = Probe.PLATE,
    shear_mm: Shear = NO_SHEAR,
) -> PressedDome:
    """Press to depth_mm at polar angle theta_rad, then slide by shear_mm (towards the base, towards +y).

    Raises ConfigError if the press is impossible or does not converge.
    """
    *_, last = press_path(dome, theta_rad, [(depth_mm, NO_SHEAR), (depth_mm, shear_mm)], probe)
    return last


def press_path(
    dome: ElasticDome,
    theta_rad: float,
    stops: Sequence[tuple[float, Shear]],
    probe: Probe = Probe.PLATE,
    start: PressedDome | None = None,
) -> Iterator[PressedDome]:
    """Yield the press at each stop (depth_mm, shear_mm) of a path that starts undeformed or at `start`.

    The probe moves straight between stops. Raises ConfigError as :func:`press`.
    """
    _check(dome, theta_rad, stops, probe)
    outward, meridional, azimuthal = directions(theta_rad)
    ways = np.stack([-outward, meridional, azimuthal])
    touch_mm = dome.mesh.outer_radius_mm * outward
    state = start.state if start else dome.at_rest()
    twist_rad = start.twist_rad if start else 0.0
    here = np.array([start.depth_mm, *start.shear_mm]) if start else np.zeros(3)
    for depth_mm, shear_mm in stops:
        goal = np.array([depth_mm, *shear_mm])
        first, last = (ProbePose(probe, outward, touch_mm + at @ ways, twist_rad) for at in (here, goal))
        steps = max(1.0, float((np.abs(goal - here) / LONGEST_STEP_MM).max()))
        shortest = SHORTEST_STEP_MM / max(float(np.linalg.norm(last.at_mm - first.at_mm)), SHORTEST_STEP_MM)
        found, iterations = _move_probe(dome, state, first, last, 1 / steps, shortest)
        state, here = found.state, goal
        yield _press(dome, theta_rad, goal, last, touch_mm, found, iterations)


def twist_path(dome: ElasticDome, start: PressedDome, twists_rad: Sequence[float]) -> Iterator[PressedDome]:
    """Yield the press at each twist of the probe about the inward normal, from a press with contact.

    The probe's point of first touch stays where it is. Raises ConfigError as :func:`press`.
    """
    if dome.mesh.half:
        raise ConfigError("twists_rad: a twist needs a mesh of the whole dome, not of a half")
    outward, meridional, azimuthal = directions(start.theta_rad)
    goal = np.array([start.depth_mm, *start.shear_mm])
    at_mm = start.touch_mm + goal @ np.stack([-outward, meridional, azimuthal])
    state, here_rad = start.state, start.twist_rad
    reach_mm = contact_radius_mm(start)
    for twist_rad in twists_rad:
        first, last = (ProbePose(start.probe, outward, at_mm, angle) for angle in (here_rad, twist_rad))
        way_mm = max(reach_mm * abs(twist_rad - here_rad), SHORTEST_STEP_MM)
        steps = max(1.0, way_mm / LONGEST_STEP_MM[1])
        found, iterations = _move_probe(dome, state, first, last, 1 / steps, SHORTEST_STEP_MM / way_mm)
        state, here_rad = found.state, twist_rad
        yield _press(dome, start.theta_rad, goal, last, start.touch_mm, found, iterations)


def contact_radius_mm(pressed: PressedDome) -> float:
    """Return the largest distance of a touching point from the probe's axis; 0 without contact."""
    anchor_mm = pressed.state.anchor_mm
    anchor_mm = anchor_mm[np.isfinite(anchor_mm[:, 0])]
    outward, _, _ = directions(pressed.theta_rad)
    return float(np.linalg.norm(np.cross(anchor_mm, outward), axis=1).max(initial=0.0))


def _move_probe(
    dome: ElasticDome, state: State, first: ProbePose, last: ProbePose, step: float, shortest: float
) -> tuple[Equilibrium, int]:
    """Move the probe from the first pose to the last.

    step, shortest: first and shortest step as fractions of the path.
    """
    done, iterations = 0.0, 0
    while True:
        share = min(done + step, 1.0)
        pose = replace(
            last,
            at_mm=first.at_mm + share * (last.at_mm - first.at_mm),
            twist_rad=first.twist_rad + share * (last.twist_rad - first.twist_rad),
        )
        found = dome.balance(state, pose)
        if found is not None:
            state, done, iterations = found.state, share, iterations + found.iterations
            if done >= 1:
                return found, iterations
        elif step > shortest:
            step /= 2
        else:
            x, y, z = last.at_mm
            raise ConfigError(
                f"no equilibrium with {last.probe.label} at {x:.2f}, {y:.2f}, {z:.2f} mm, twist "
                f"{np.degrees(last.twist_rad):.1f} deg: reduce depth and twist, or refine the mesh"
            )


def _press(
    dome: ElasticDome,
    theta_rad: float,
    goal: Array,
    pose: ProbePose,
    touch_mm: Array,
    found: Equilibrium,
    iterations: int,
) -> PressedDome:
    surface, moved = dome.surface, found.state.displacement_mm
    points = surface.points_mm + (surface.to_points @ moved.ravel()).reshape(-1, 3)
    weight = surface.area_mm2 * found.contact.pressure
    centre = weight @ points / weight.sum() if weight.any() else touch_mm
    # The other half of the dome has the mirror image of the forces: the y components cancel.
    whole = np.array([2.0, 0.0, 2.0]) if dome.mesh.half else np.ones(3)
    if dome.mesh.half:
        centre = centre * np.array([1.0, 0.0, 1.0])
    moment = np.cross(points - touch_mm, surface.area_mm2[:, None] * found.contact.traction).sum(axis=0)
    return PressedDome(
        theta_rad=theta_rad,
        depth_mm=float(goal[0]),
        shear_mm=(float(goal[1]), float(goal[2])),
        probe=pose.probe,
        displacement_mm=moved,
        force_per_mu_mm2=whole * found.contact_force,
        base_per_mu_mm2=whole * found.base_force,
        touch_mm=touch_mm,
        pressure_centre_mm=centre,
        largest_pressure=float(found.contact.pressure.max()),
        iterations=iterations,
        state=found.state,
        twist_rad=pose.twist_rad,
        torsion_per_mu_mm3=0.0 if dome.mesh.half else float(-moment @ pose.outward),
    )


def _check(dome: ElasticDome, theta_rad: float, stops: Sequence[tuple[float, Shear]], probe: Probe) -> None:
    if not 0 <= theta_rad < np.pi / 2:
        raise ConfigError(
            f"theta_rad = {theta_rad:g} is not between 0 (the pole) and pi/2 (the base, excluded)"
        )
    limit_mm = largest_depth_mm(theta_rad, probe, dome.mesh.outer_radius_mm)
    for depth_mm, (_, azimuthal_mm) in stops:
        if not 0 <= depth_mm <= limit_mm:
            raise ConfigError(
                f"depth_mm = {depth_mm:g} at theta {np.degrees(theta_rad):.0f} deg is not between 0 and "
                f"{limit_mm:.2f}, where the probe reaches the base"
            )
        if azimuthal_mm and dome.mesh.half:
            raise ConfigError("shear_mm: an azimuthal slide needs a mesh of the whole dome, not of a half")
