"""The jig as parametric OpenSCAD source: a cap with guides on a skirt around the housing. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from palpate_edge.jig.jig_plan import Hole, JigSize

MODULES = """
$fn = 96;
inner_mm = outer_radius_mm + gap_mm;  // radius of the cap's inner side
cap_mm = inner_mm + wall_mm;          // and of its outer side
hole_mm = rod_mm + fit_mm;
guide_diameter_mm = hole_mm + 2 * wall_mm;
opening_mm = (housing_mm + fit_mm) / 2;  // inner radius of the skirt
skirt_radius_mm = max(opening_mm, inner_mm) + wall_mm;

// Along the axis of a hole, from the dome's centre.
module along(hole) { rotate([0, hole[1], hole[2]]) children(); }

module upper_half(radius_mm) {
    intersection() {
        circle(r = radius_mm);
        translate([-radius_mm, 0]) square([2 * radius_mm, radius_mm]);
    }
}

// Half of the section through the axis of cap and skirt.
module section() {
    intersection() {
        difference() {
            union() {
                upper_half(cap_mm);
                translate([0, -skirt_mm]) square([skirt_radius_mm, skirt_mm + wall_mm]);
            }
            upper_half(inner_mm);
            translate([-1, -skirt_mm - 1]) square([opening_mm + 1, skirt_mm + 1]);
        }
        translate([0, -skirt_mm - 1]) square(2 * (skirt_radius_mm + skirt_mm));
    }
}

// The hole's number, on the side of its guide that faces the apex.
module label(hole) {
    along(hole) translate([0.4 - guide_diameter_mm / 2, 0, cap_mm + guide_mm / 2])
        rotate([90, 0, -90]) linear_extrude(1)
            text(str(hole[0]), size = 6, halign = "center", valign = "center");
}

// At azimuth 0: the right side of the picture.
module arrow() {
    translate([skirt_radius_mm - 0.5, 0, -skirt_mm / 2])
        rotate([90, 0, 90]) linear_extrude(1.5) polygon([[-3, -4], [3, -4], [0, 4]]);
}

difference() {
    union() {
        rotate_extrude() section();
        for (hole = holes) along(hole)
            translate([0, 0, inner_mm + 0.2]) cylinder(d = guide_diameter_mm, h = wall_mm + guide_mm - 0.2);
        for (hole = holes) label(hole);
        arrow();
    }
    for (hole = holes) along(hole) cylinder(d = hole_mm, h = cap_mm + guide_mm + 1);
    // three screws M3 hold it; they cut their own thread
    for (turn = [60, 180, 300]) rotate([0, 90, turn])
        translate([skirt_mm / 2, 0, 0]) cylinder(d = 2.6, h = 2 * skirt_radius_mm);
}
"""


def scad_text(outer_radius_mm: float, size: JigSize, holes: Sequence[Hole]) -> str:
    """Return the source: the sizes and the holes as variables, then the solid."""
    sizes = {"outer_radius_mm": outer_radius_mm, **asdict(size)}
    rows = "".join(f"    [{hole.number}, {hole.theta_deg:g}, {hole.phi_deg:g}],\n" for hole in holes)
    return "\n".join(
        [
            "// Jig for a marker dome, written by palpate-edge jig. Lengths in mm, angles in degrees.",
            "// Print it with the skirt down; ream the holes until the rod slides by its own weight.",
            *(f"{name} = {value:g};" for name, value in sizes.items() if name != "largest_theta_deg"),
            "// number, polar angle from the apex, azimuth from the picture's right towards its bottom",
            f"holes = [\n{rows}];",
            MODULES,
        ]
    )
