"""The object dictionary of a fingertip on a CAN FD bus: its contact is one TPDO of up to 64 bytes (TPDO 10).

``fingertip.eds`` disables TPDO 10, so a node on a classic bus sends what it always sent, and a master without
CAN FD needs to know nothing of it. docs/bus.md has what is CiA 301 and what is a choice of this project.
"""

from __future__ import annotations

import msgspec

from palpate_edge.common.contact_quantities import CONTACT_TPDOS, FD_TPDO, FD_TPDO_POSES
from palpate_edge.node.object_dictionary import ObjectDictionary
from palpate_edge.node.pdo_codec import PdoDirection
from palpate_edge.node.pdo_parameters import with_tpdos_disabled, with_tpdos_enabled


def on_fd_bus(od: ObjectDictionary, *, poses: bool) -> ObjectDictionary:
    """Return the dictionary with TPDO 10 in place of the classic TPDOs of a contact. poses: it maps them."""
    od = with_tpdos_enabled(with_tpdos_disabled(od, CONTACT_TPDOS), (FD_TPDO,))
    if poses:
        od = od.with_defaults({(PdoDirection.TRANSMIT.mapping_index + FD_TPDO - 1, 0): FD_TPDO_POSES})
    return msgspec.structs.replace(od, has_fd=True)
