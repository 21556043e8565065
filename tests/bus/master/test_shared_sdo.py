"""An SDO client beside another one of the same server: responses to the other's requests are not its own."""

from __future__ import annotations

import canopen
import pytest
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from palpate_bus.master.session import SharedSdoClient

OTHER_READ = bytes.fromhex("4320100178563412")  # 1020h:01, the response to another client
OTHER_ABORT = bytes.fromhex("8020100100000206")  # 1020h:01, object does not exist
OTHER_WRITTEN = bytes.fromhex("6020100100000000")
VALUE = bytes.fromhex("4318100104030201")  # 1018h:01
WRITTEN = bytes.fromhex("6017100000000000")  # 1017h:00


class Server:
    """Stands in for the network: sends these responses to the first request of a transfer."""

    def __init__(self, client, *responses):
        self._client, self._responses = client, responses

    def send_message(self, _can_id, _data, _remote=False):
        responses, self._responses = self._responses, ()
        for response in responses:
            self._client.on_response(0x590, bytearray(response), 0.0)


def client_of(kind, *responses):
    client = kind(0x610, 0x590, canopen.ObjectDictionary())
    client.RESPONSE_TIMEOUT = 0.01
    client.network = Server(client, *responses)
    return client


@pytest.mark.parametrize("other", [OTHER_READ, OTHER_ABORT, OTHER_WRITTEN])
def test_a_read_ignores_responses_with_another_object(other):
    assert client_of(SharedSdoClient, other, VALUE).upload(0x1018, 1) == b"\x04\x03\x02\x01"
    with pytest.raises((SdoCommunicationError, SdoAbortedError)):
        client_of(SdoClient, other, VALUE).upload(0x1018, 1)


@pytest.mark.parametrize("other", [OTHER_READ, OTHER_ABORT, OTHER_WRITTEN])
def test_a_write_ignores_responses_with_another_object(other):
    client_of(SharedSdoClient, other, WRITTEN).download(0x1017, 0, b"\x64\x00")


def test_no_own_response_is_a_time_out():
    with pytest.raises(SdoCommunicationError, match="No SDO response received"):
        client_of(SharedSdoClient, OTHER_READ).upload(0x1018, 1)


def test_an_abort_of_its_own_object_is_its_own():
    with pytest.raises(SdoAbortedError):
        client_of(SharedSdoClient, bytes.fromhex("8018100100000206")).upload(0x1018, 1)
