"""A CiA 402 node with several axes: its EDS, its objects, and the layout of its PDOs.

CiA 402-2 lets one CANopen node hold up to eight axes; those of axis n, from 0 on, have the objects of the
profile n * 800h higher. ``cia402_axes.eds`` describes such a node. Its PDOs are CAN FD frames that hold the
axes of a hand one behind the other; the master maps and enables them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from palpate_edge.common.errors import BusError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.object_dictionary import ObjectDictionary, ObjectKey
from palpate_edge.node.pdo_codec import MappingFault, PdoCodec, PdoDirection, layout_of, pdo_codec

CIA402_AXES_EDS = Path(__file__).with_name("cia402_axes.eds")
MAX_AXES, AXIS_STEP = 8, 0x800
FIRST_INDEX = 0x6000
AXES_OF_A_TPDO = 5
"""Axes whose state fits one CAN FD frame: 12 bytes each of 64."""

STATE_WORDS = (0x60410010, 0x60640020, 0x606C0020, 0x60770010)
"""State of axis 0: statusword, position, velocity, torque."""
CONTROLWORD_WORD = 0x60400010


def axis_index(index: int, axis: int) -> int:
    """Return the index that an object of the profile has for an axis."""
    return index + AXIS_STEP * axis


def axis_key(key: ObjectKey, axis: int) -> ObjectKey:
    """Return the index and sub-index that an object of the profile has for an axis."""
    return axis_index(key[0], axis), key[1]


def profile_key(key: ObjectKey) -> ObjectKey:
    """Return the key that an object of an axis has for axis 0; other objects keep theirs."""
    index, subindex = key
    if FIRST_INDEX <= index < FIRST_INDEX + MAX_AXES * AXIS_STEP:
        index = FIRST_INDEX + (index - FIRST_INDEX) % AXIS_STEP
    return index, subindex


def axis_word(word: int, axis: int) -> int:
    """Return the mapping word that an object of the profile has for an axis."""
    return word + (AXIS_STEP * axis << 16)


def command_words(axes: Sequence[int], target: int) -> tuple[int, ...]:
    """Return the mapping of RPDO 1: controlword and target of each axis. target: the word of axis 0."""
    return tuple(axis_word(word, axis) for axis in axes for word in (CONTROLWORD_WORD, target))


def axes_of_tpdos(axes: Sequence[int]) -> tuple[tuple[int, ...], ...]:
    """Return the axes in TPDO 1, and behind five of them those in TPDO 2."""
    return tuple(tuple(axes[begin : begin + AXES_OF_A_TPDO]) for begin in range(0, len(axes), AXES_OF_A_TPDO))


def state_words(axes: Sequence[int]) -> tuple[int, ...]:
    """Return the mapping of a TPDO: the state of each of its axes."""
    return tuple(axis_word(word, axis) for axis in axes for word in STATE_WORDS)


def axes_dictionary(node_id: int) -> ObjectDictionary:
    """Return the dictionary of a node with eight axes on a CAN FD bus."""
    return msgspec.structs.replace(load_eds(CIA402_AXES_EDS, node_id), has_fd=True)


def axes_codec(node_id: int, direction: PdoDirection, number: int, words: Sequence[int]) -> PdoCodec:
    """Return the codec of a PDO with this mapping, as a CAN FD frame. Raises BusError for one that is
    invalid."""
    od = axes_dictionary(node_id)
    layout = layout_of(od, words, direction, fd=True)
    if isinstance(layout, MappingFault):
        raise BusError(f"{od.source}: {direction.label} {number} maps {layout.value}: map other objects")
    return msgspec.structs.replace(pdo_codec(od, direction, number), layout=layout)
