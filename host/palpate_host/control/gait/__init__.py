"""Large turns by finger gaiting: one finger lifts and takes hold again while the others hold the object.

Belongs here: the object's faces, the fingers' reach, the plan of a turn and its execution; pure functions of
their inputs. May use: control, config, common.
"""
