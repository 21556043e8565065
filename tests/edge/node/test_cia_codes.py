"""Codes, identifiers and bits of CiA 301 and 305, by the `canopen` package and by the standard's tables."""

from __future__ import annotations

import canopen.lss
import canopen.sdo.constants as sdo
import pytest
from canopen.emcy import EmcyError
from canopen.sdo.exceptions import SdoAbortedError

from palpate_edge.node.cob_ids import NOT_VALID, check_cob_id
from palpate_edge.node.emcy import EmcyCode, ErrorRegister, is_temperature
from palpate_edge.node.emergencies import REGISTER, Emergency, name_of
from palpate_edge.node.fingertip_objects import ContactFlag, Counter
from palpate_edge.node.lss import LssCommand
from palpate_edge.node.nmt import NmtCommand, NmtState, boot_up, command_for
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError
from palpate_edge.node.sdo_block import DOWNLOAD_BLOCK_ACK, DOWNLOAD_END, DOWNLOAD_END_ACK, crc16

ABORTS = {
    AbortCode.TOGGLE_BIT: sdo.ABORT_TOGGLE_NOT_ALTERNATED,
    AbortCode.TIMED_OUT: sdo.ABORT_TIMED_OUT,
    AbortCode.COMMAND_UNKNOWN: sdo.ABORT_INVALID_COMMAND_SPECIFIER,
    AbortCode.BLOCK_SIZE: sdo.ABORT_INVALID_BLOCK_SIZE,
    AbortCode.SEQUENCE_NUMBER: sdo.ABORT_INVALID_SEQUENCE_NUMBER,
    AbortCode.CRC: sdo.ABORT_CRC_ERROR,
    AbortCode.OUT_OF_MEMORY: sdo.ABORT_OUT_OF_MEMORY,
    AbortCode.WRITE_ONLY: sdo.ABORT_READ_WRITEONLY,
    AbortCode.READ_ONLY: sdo.ABORT_WRITE_READONLY,
    AbortCode.NO_OBJECT: sdo.ABORT_NOT_IN_OD,
    AbortCode.NOT_MAPPABLE: sdo.ABORT_PDO_CANNOT_MAP,
    AbortCode.PDO_TOO_LONG: sdo.ABORT_PDO_LENGTH_EXCEEDED,
    AbortCode.PARAMETER_CLASH: sdo.ABORT_PARAMETER_INCOMPATIBLE,
    AbortCode.HARDWARE: sdo.ABORT_HARDWARE_ERROR,
    AbortCode.LENGTH_MISMATCH: sdo.ABORT_LENGTH_NOT_MATCHED,
    AbortCode.TOO_LONG: sdo.ABORT_LENGTH_TOO_HIGH,
    AbortCode.TOO_SHORT: sdo.ABORT_LENGTH_TOO_LOW,
    AbortCode.NO_SUBINDEX: sdo.ABORT_NO_SUBINDEX,
    AbortCode.VALUE_INVALID: sdo.ABORT_INVALID_VALUE,
    AbortCode.VALUE_TOO_HIGH: sdo.ABORT_VALUE_TOO_HIGH,
    AbortCode.VALUE_TOO_LOW: sdo.ABORT_VALUE_TOO_LOW,
    AbortCode.NOT_STORED: sdo.ABORT_STORE_APPLICATION,
    AbortCode.LOCAL_CONTROL: sdo.ABORT_APPLICATION_LOCAL_CONTROL,
    AbortCode.DEVICE_STATE: sdo.ABORT_APPLICATION_DEVICE_STATE,
    AbortCode.NO_DATA: sdo.ABORT_NO_DATA_AVAILABLE,
}
ABORTS[AbortCode.NOT_STORED] = 0x0800_0020  # the package has the general 0800 0000h for it


@pytest.mark.parametrize("code", AbortCode)
def test_abort_codes_are_those_of_the_package(code: AbortCode) -> None:
    assert int(code) == ABORTS[code]
    assert int(code) in SdoAbortedError.CODES
    assert f"{int(code):08X}h ({code.name})" in str(SdoAbortError(code))


def restricted() -> set[int]:
    """CiA 301, table of restricted CAN-IDs; 700h, which no node has, is restricted here as well."""
    ranges = (
        (0x000, 0x07F),  # NMT and reserved
        (0x101, 0x180),  # reserved
        (0x581, 0x5FF),  # default SDO, server to client
        (0x601, 0x67F),  # default SDO, client to server
        (0x6E0, 0x6FF),  # reserved
        (0x700, 0x77F),  # NMT error control
        (0x780, 0x7FF),  # reserved, with LSS
    )
    return {can_id for first, last in ranges for can_id in range(first, last + 1)}


def is_refused(value: int, flags: int) -> bool:
    try:
        check_cob_id(value, flags)
    except SdoAbortError as error:
        assert error.code is AbortCode.VALUE_INVALID
        return True
    return False


def test_which_identifiers_are_restricted() -> None:
    assert {can_id for can_id in range(0x800) if is_refused(can_id, 0)} == restricted()


@pytest.mark.parametrize("bit", range(11, 32))
def test_only_the_given_flags_may_be_set_beside_an_identifier(bit: int) -> None:
    assert is_refused(0x190 | 1 << bit, 0)
    assert is_refused(0x190 | 1 << bit, NOT_VALID) is (bit != 31)


def test_the_error_register_has_the_bits_of_1001h() -> None:
    """CiA 301, 7.5.2.2; bit 6 is reserved."""
    bits = [one.name for one in ErrorRegister]
    assert {name: ErrorRegister[name].value for name in bits} == {
        "GENERIC": 1 << 0,
        "CURRENT": 1 << 1,
        "VOLTAGE": 1 << 2,
        "TEMPERATURE": 1 << 3,
        "COMMUNICATION": 1 << 4,
        "DEVICE_PROFILE": 1 << 5,
        "MANUFACTURER": 1 << 7,
    }


def test_the_error_codes_of_cia_301() -> None:
    """Table of emergency error codes: 81xxh communication, 82xxh protocol, 42xxh device temperature."""
    assert {code.name: int(code) for code in EmcyCode} == {
        "DATA_SET": 0x6300,
        "HEARTBEAT": 0x8130,
        "BUS_OFF_RECOVERED": 0x8140,
        "PDO_LENGTH": 0x8210,
        "PDO_LENGTH_EXCEEDED": 0x8220,
        "SYNC_LENGTH": 0x8240,
        "RPDO_TIMEOUT": 0x8250,
    }
    assert Emergency.RECEIVE_OVERRUN == 0x8110 and Emergency.ERROR_PASSIVE == 0x8120
    assert Emergency.BUS_OFF_RECOVERED == 0x8140 and Emergency.ID_COLLISION == 0x8150


@pytest.mark.parametrize("emergency", Emergency)
def test_each_emergency_has_the_register_bit_of_its_class(emergency: Emergency) -> None:
    """The class is the package's; device-specific codes have the manufacturer's bit."""
    kind = EmcyError(emergency, 0, b"", 0.0).get_desc()
    assert is_temperature(emergency) is (kind == "Temperature")
    expected = {
        "Temperature": ErrorRegister.TEMPERATURE,
        "Monitoring": ErrorRegister.COMMUNICATION,
        "Device Specific": ErrorRegister.MANUFACTURER,
    }[kind]
    own = {Emergency.BUS_OFF_RECOVERED: None, Emergency.CLOCK_LOST: ErrorRegister.COMMUNICATION}
    assert REGISTER.get(emergency) == own.get(
        emergency, None if expected is ErrorRegister.MANUFACTURER else expected
    )
    assert name_of(Emergency.CAMERA_LOST) == "camera lost"


def test_lss_commands_are_those_of_the_package() -> None:
    package = canopen.lss
    assert (LssCommand.SWITCH_GLOBAL, LssCommand.STORE) == (
        package.CS_SWITCH_STATE_GLOBAL,
        package.CS_STORE_CONFIGURATION,
    )
    assert LssCommand.CONFIGURE_NODE_ID == package.CS_CONFIGURE_NODE_ID
    assert LssCommand.CONFIGURE_BIT_TIMING == package.CS_CONFIGURE_BIT_TIMING
    assert (LssCommand.SELECT_FIRST, LssCommand.SELECT_LAST, LssCommand.SELECTED) == (
        package.CS_SWITCH_STATE_SELECTIVE_VENDOR_ID,
        package.CS_SWITCH_STATE_SELECTIVE_SERIAL_NUMBER,
        package.CS_SWITCH_STATE_SELECTIVE_RESPONSE,
    )
    assert (LssCommand.IDENTIFY_FIRST, LssCommand.IDENTIFY_LAST, LssCommand.IDENTIFY_SLAVE) == (
        package.CS_IDENTIFY_REMOTE_SLAVE_VENDOR_ID,
        package.CS_IDENTIFY_REMOTE_SLAVE_SERIAL_NUMBER_HIGH,
        package.CS_IDENTIFY_SLAVE,
    )
    assert (LssCommand.IDENTIFY_NON_CONFIGURED, LssCommand.NON_CONFIGURED_SLAVE) == (
        package.CS_IDENTIFY_NON_CONFIGURED_REMOTE_SLAVE,
        package.CS_IDENTIFY_NON_CONFIGURED_SLAVE,
    )
    assert (LssCommand.FASTSCAN, LssCommand.INQUIRE_NODE_ID) == (
        package.CS_FAST_SCAN,
        package.CS_INQUIRE_NODE_ID,
    )
    assert (LssCommand.INQUIRE_FIRST, LssCommand.INQUIRE_LAST) == (
        package.CS_INQUIRE_VENDOR_ID,
        package.CS_INQUIRE_SERIAL_NUMBER,
    )


def test_block_commands_and_checksum() -> None:
    """Server and client specifiers 5 and 6 in the upper bits; CRC of "123456789" by polynomial 1021h."""
    assert DOWNLOAD_BLOCK_ACK == sdo.RESPONSE_BLOCK_DOWNLOAD | sdo.BLOCK_TRANSFER_RESPONSE
    assert DOWNLOAD_END == sdo.REQUEST_BLOCK_DOWNLOAD | sdo.END_BLOCK_TRANSFER
    assert DOWNLOAD_END_ACK == sdo.RESPONSE_BLOCK_DOWNLOAD | sdo.END_BLOCK_TRANSFER
    assert crc16(b"123456789") == 0x31C3


@pytest.mark.parametrize(
    ("data", "command"),
    [
        (b"\x01\x10", NmtCommand.START),
        (b"\x02\x00", NmtCommand.STOP),
        (b"\x80\x10", NmtCommand.ENTER_PRE_OPERATIONAL),
        (b"\x81\x10", NmtCommand.RESET_NODE),
        (b"\x82\x00", NmtCommand.RESET_COMMUNICATION),
        (b"\x01\x11", None),
        (b"\x03\x10", None),
        (b"\x01", None),
        (b"\x01\x10\x00", None),
    ],
)
def test_nmt_commands_are_for_all_or_for_this_node(data: bytes, command: NmtCommand | None) -> None:
    assert command_for(0x10, data) is command


def test_states_in_the_heartbeat_and_the_boot_up() -> None:
    assert [int(state) for state in NmtState] == [0x00, 0x04, 0x05, 0x7F]
    assert (boot_up(0x10).can_id, boot_up(0x10).data) == (0x710, b"\x00")


def test_objects_of_the_fingertip_that_docs_bus_md_lists() -> None:
    """2010h is a set of bits, 2041h has a sub-index for each counter, without a gap."""
    assert [flag.value for flag in ContactFlag] == [1 << bit for bit in range(6)]
    assert [int(counter) for counter in Counter] == list(range(1, 20))
    assert (Counter.PDOS_DROPPED, Counter.RECEIVE_OVERRUNS, Counter.ID_CONFLICTS) == (7, 8, 19)
