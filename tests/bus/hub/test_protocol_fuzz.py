"""Random and damaged bytes: the hub's core refuses them with GarbledStreamError and lives."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_bus.hub import protocol
from palpate_bus.hub.hub_client import Client
from palpate_bus.hub.hub_core import HubCore
from palpate_bus.hub.protocol import GarbledStreamError, Hello, Kind
from palpate_edge.can_bus.can_frame import FD_LENGTHS, CanFrame

CLASSIC = st.builds(CanFrame, st.integers(0, 0x7FF), st.binary(max_size=8), st.booleans())
FD = st.builds(
    CanFrame,
    st.integers(0, 0x7FF),
    st.sampled_from(FD_LENGTHS).flatmap(lambda length: st.binary(min_size=length, max_size=length)),
    fd=st.just(True),
)
FRAMES = st.lists(CLASSIC | FD, max_size=8)
HELLO = protocol.hello_message(Hello("fuzz", 0, receive_own=True, control_only=False, data_bitrate=0))
PAYLOADS = st.one_of(
    st.binary(max_size=64),
    st.binary(min_size=12, max_size=12),
    st.binary(min_size=68, max_size=68),
    st.just(b'{"type":"statistics"}'),
)
STREAMS = st.lists(
    st.one_of(
        st.binary(max_size=32),
        st.builds(protocol.message, st.sampled_from(list(Kind)), PAYLOADS),
        st.just(HELLO),
        st.just(protocol.filters_message(None)),
    ),
    max_size=8,
)


def survives(core: HubCore, client: Client, data: bytes) -> None:
    try:
        core.receive(client, data, 0)
    except GarbledStreamError as error:
        assert "\n" not in str(error)
        core.disconnect(client)
    core.advance(0)


@given(STREAMS)
def test_the_core_survives_any_sequence_of_messages_and_noise(stream):
    core = HubCore(bitrate=0, txqueuelen=4, now_us=0, data_bitrate=5_000_000)
    survives(core, Client(), b"".join(stream))
    late = Client()
    core.receive(late, HELLO, 1)
    assert (Kind.WELCOME, protocol.WELCOME.pack(4, 0)) in protocol.Splitter().feed(bytes(late.output))


@given(FRAMES, st.data())
def test_one_damaged_byte_never_raises_anything_else(frames, data):
    stream = HELLO + protocol.send_messages(frames)
    damaged = bytearray(stream)
    damaged[data.draw(st.integers(0, len(stream) - 1))] ^= data.draw(st.integers(1, 255))
    survives(HubCore(bitrate=0, txqueuelen=8, now_us=0, data_bitrate=5_000_000), Client(), bytes(damaged))


@given(FRAMES, st.lists(st.integers(0, 400), max_size=6))
def test_messages_survive_any_cutting_of_the_stream(frames, cuts):
    stream = HELLO + protocol.send_messages(frames)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    splitter = protocol.Splitter()
    messages = [
        message for start, end in itertools.pairwise(edges) for message in splitter.feed(stream[start:end])
    ]
    assert messages[0][0] is Kind.HELLO
    assert [frame for sent in messages[1:] for _, frame in protocol.parse_frames(*sent)] == frames


def test_another_version_is_named():
    header = protocol.HEADER.pack(protocol.MAGIC, protocol.VERSION + 1, Kind.HELLO, 0)
    with pytest.raises(GarbledStreamError, match=r"version 2 .* install the same palpate"):
        list(protocol.Splitter().feed(header))
