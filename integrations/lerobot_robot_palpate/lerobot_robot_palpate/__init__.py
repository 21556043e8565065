"""LeRobot plug-in: robot type ``palpate_hand``, teleoperators ``palpate_keys``, ``palpate_gamepad`` and
``palpate_turns``.

LeRobot imports every installed distribution whose name begins with ``lerobot_robot_``; importing this package
registers its types.
"""

from lerobot_robot_palpate.configs import (
    PalpateGamepadConfig,
    PalpateHandConfig,
    PalpateKeysConfig,
    PalpateTurnsConfig,
)
from lerobot_robot_palpate.gamepad import PalpateGamepad
from lerobot_robot_palpate.hand import PalpateHand
from lerobot_robot_palpate.keys import PalpateKeys
from lerobot_robot_palpate.turns import PalpateTurns

__all__ = [
    "PalpateGamepad",
    "PalpateGamepadConfig",
    "PalpateHand",
    "PalpateHandConfig",
    "PalpateKeys",
    "PalpateKeysConfig",
    "PalpateTurns",
    "PalpateTurnsConfig",
]
