"""The law `pose`: a held object keeps its place, follows a target pose, and is held firmly in HOLD.

Belongs here: the estimate of the object's pose, its target, the forces of the contacts and their stiffness;
pure functions of their inputs. May use: control, config, common.
"""
