"""Elements of an observation, named as in the datasets of `palpate-host lerobot`. Pure."""

from __future__ import annotations

from lerobot_robot_palpate.control_socket import HostState, PalpateHandError

JOINT = {"pos_rad": "position_rad", "vel_rad_s": "velocity_rad_s", "torque_Nm": "torque_Nm"}


def joint_values(status: HostState, *, required: bool = True) -> dict[str, float]:
    """Return position, velocity and torque of each joint.

    Raises PalpateHandError for an unknown value; 0 instead unless it is `required`.
    """
    values = {}
    for joint in status["joints"]:
        for name, key in JOINT.items():
            value = joint[key]
            if value is None and required:
                raise PalpateHandError(f"joint {joint['name']}: {key} is not known ({joint['drive_state']})")
            values[f"{joint['name']}.{name}"] = float(value or 0.0)
    return values


def contact_values(status: HostState) -> dict[str, float]:
    """Return each finger's contact point (mm), forces (N), 95 % radius of the point (mm) and flags.

    A value is 0 without contact, and where the sensor does not measure it; `in_contact` is 0 without contact.
    """
    values: dict[str, float] = {}
    for finger in status["fingers"]:
        touches = bool(finger["valid"] and finger["in_contact"])
        x, y, z = finger["position_mm"] or (None, None, None)
        fx, fy = finger["shear_N"] or (None, None)
        elements = {
            "x_mm": x,
            "y_mm": y,
            "z_mm": z,
            "fn_N": finger["normal_force_N"],
            "fx_N": fx,
            "fy_N": fy,
            "radius95_mm": finger["radius95_mm"],
            "in_contact": 1.0,
            "slip": float(finger["slip"]),
        }
        values |= {
            f"{finger['name']}.{name}": float(value or 0.0) if touches else 0.0
            for name, value in elements.items()
        }
    return values
