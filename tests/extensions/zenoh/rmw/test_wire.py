"""Keys, tokens, QoS and attachments against the public design document of rmw_zenoh, byte by byte."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable
from itertools import accumulate, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.extensions.zenoh.rmw import attachment, keys, qos_text
from rwt.extensions.zenoh.rmw.attachment import Attachment
from rwt.extensions.zenoh.rmw.tokens import EntityKind, Token, TokenEndpoint, all_tokens, gid_of, parse
from rwt_graph.errors import WireError
from rwt_participant.qos import DEFAULT_QOS, LATCHED, SENSOR_DATA, Durability, History, QoS, Reliability

STRING = "std_msgs::msg::dds_::String_"
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
ADD = "example_interfaces::srv::dds_::AddTwoInts_"
ADD_HASH = "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"

TALKER = "@ros2_lv/0/8b20917502ee955ac4476e0266340d5c"
LISTENER = "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21"

#: As the design document prints them.
TOKENS = {
    f"{LISTENER}/0/0/NN/%/%/listener": Token(
        0, "aac3178e146ba6f1fc6e6a4085e77f21", 0, 0, EntityKind.NODE, "/listener"
    ),
    f"{TALKER}/0/10/MP/%/%/talker/%chatter/{STRING}/{STRING_HASH}/::,7:,:,:,,": Token(
        0,
        "8b20917502ee955ac4476e0266340d5c",
        0,
        10,
        EntityKind.PUBLISHER,
        "/talker",
        TokenEndpoint("/chatter", STRING, STRING_HASH, QoS(depth=7)),
    ),
    f"{LISTENER}/0/10/MS/%/%/listener/%chatter/{STRING}/{STRING_HASH}/::,10:,:,:,,": Token(
        0,
        "aac3178e146ba6f1fc6e6a4085e77f21",
        0,
        10,
        EntityKind.SUBSCRIPTION,
        "/listener",
        TokenEndpoint("/chatter", STRING, STRING_HASH, DEFAULT_QOS),
    ),
    f"@ros2_lv/2/a/3/14/SS/%secure/%robot1%arm/adder/%robot1%add/{ADD}/{ADD_HASH}/2:1:2,5:1,2:3,4:,,": Token(
        2,
        "a",
        3,
        14,
        EntityKind.SERVICE,
        "/robot1/arm/adder",
        TokenEndpoint(
            "/robot1/add",
            ADD,
            ADD_HASH,
            QoS(
                History.KEEP_ALL,
                5,
                Reliability.BEST_EFFORT,
                Durability.TRANSIENT_LOCAL,
                1.000000002,
                3.000000004,
            ),
        ),
        enclave="/secure",
    ),
}

#: The GID that the C++ implementation's hash gives the publisher's token above.
GID = bytes.fromhex("eb85fa883b7846dc448a4501890ad062")


@pytest.mark.parametrize("key", TOKENS)
def test_tokens_of_the_design_document(key: str) -> None:
    assert TOKENS[key].key() == key
    assert parse(key) == TOKENS[key]


def test_the_gid_is_the_hash_of_the_token() -> None:
    publisher = next(key for key, token in TOKENS.items() if token.kind is EntityKind.PUBLISHER)
    assert gid_of(publisher) == GID


def test_keys_of_the_design_document() -> None:
    assert keys.data_key(0, "/chatter", STRING, STRING_HASH) == f"0/chatter/{STRING}/{STRING_HASH}"
    assert keys.data_key(2, "/a/add", ADD, ADD_HASH) == f"2/a/add/{ADD}/{ADD_HASH}"
    assert all_tokens(7) == "@ros2_lv/7/**"


@pytest.mark.parametrize(
    ("ros", "dds"),
    [
        ("std_msgs/msg/String", STRING),
        ("example_interfaces/srv/AddTwoInts", ADD),
        ("a_b/action/C_SendGoal", "a_b::action::dds_::C_SendGoal_"),
    ],
)
def test_type_names(ros: str, dds: str) -> None:
    assert keys.dds_type(ros) == dds
    assert keys.type_name(dds) == ros


_NO_TYPES = ("", "String", "std_msgs/String", "a/msg/b/c", "a/idl/B", "/msg/B", "a/msg/")
_NO_DDS_TYPES = ("", "String_", "a::msg::dds_::B", "a::msg::B_", "a::idl::dds_::B_", "::msg::dds_::B_")


@pytest.mark.parametrize(
    ("convert", "name"),
    [*product([keys.dds_type], _NO_TYPES), *product([keys.type_name], (*_NO_DDS_TYPES, "a::msg::dds_::_"))],
)
def test_names_that_are_no_type_names(convert: Callable[[str], str], name: str) -> None:
    with pytest.raises(WireError, match="is not a type name"):
        convert(name)


@pytest.mark.parametrize(
    ("qos", "text"),
    [
        (DEFAULT_QOS, "::,10:,:,:,,"),
        (QoS(depth=42), "::,:,:,:,,"),
        (SENSOR_DATA, "2::,5:,:,:,,"),
        (LATCHED, ":1:,1:,:,:,,"),
        (QoS(history=History.KEEP_ALL), "::2,10:,:,:,,"),
        (QoS(deadline=0.25, lifespan=10.0), "::,10:0,250000000:10,0:,,"),
        (QoS(deadline=0.0, lifespan=0.0), "::,10:,:,:,,"),
    ],
)
def test_qos_texts(qos: QoS, text: str) -> None:
    assert qos_text.encode(qos) == text
    read = qos_text.decode(text)
    assert qos_text.encode(read) == text
    assert (read.depth, read.durability, read.reliability) == (qos.depth, qos.durability, qos.reliability)


def test_qos_that_others_write_out() -> None:
    infinite = "9223372036,854775807"
    assert qos_text.decode(f"1:2:1,10:{infinite}:{infinite}:1,{infinite}") == DEFAULT_QOS
    assert qos_text.decode("4:4:1,:,:,:,,").durability is Durability.BEST_AVAILABLE


def test_best_available_is_written_as_the_default() -> None:
    best = QoS(reliability=Reliability.BEST_AVAILABLE, durability=Durability.BEST_AVAILABLE)
    assert qos_text.encode(best) == "::,10:,:,:,,"


_NO_QOS = ("9::,10:,:,:,,", ":9:,10:,:,:,,", "::9,10:,:,:,,", "::,x:,:,:,,", "::,-1:,:,:,,", "::,10:,:,:,,:")


@pytest.mark.parametrize("text", [*accumulate("2:1:2,5:1,2:3,4:,"), "", "::,²:,:,:,,", *_NO_QOS])
def test_texts_that_are_no_qos(text: str) -> None:
    with pytest.raises(WireError, match="is not a QoS"):
        qos_text.decode(text)


ATTACHMENT = bytes.fromhex("07000000000000000f0000000000000010") + GID


def test_an_attachment_is_33_bytes() -> None:
    made = Attachment(7, 15, GID)
    assert made.encode() == ATTACHMENT
    assert attachment.decode(ATTACHMENT) == made
    assert attachment.SIZE == len(ATTACHMENT) == 33


def test_an_attachment_of_another_size() -> None:
    for size in (*range(33), 34, 66):
        with pytest.raises(WireError, match=f"an attachment of {size} bytes"):
            attachment.decode((ATTACHMENT * 2)[:size])
    with pytest.raises(WireError, match="whose GID has 15 bytes"):
        attachment.decode(ATTACHMENT[:16] + b"\x0f" + ATTACHMENT[17:])


@given(
    st.integers(-(2**63), 2**63 - 1), st.integers(-(2**63), 2**63 - 1), st.binary(min_size=16, max_size=16)
)
def test_attachments_come_back(sequence: int, stamp: int, gid: bytes) -> None:
    made = Attachment(sequence, stamp, gid)
    assert made.encode() == struct.pack("<q", sequence) + struct.pack("<q", stamp) + b"\x10" + gid
    assert attachment.decode(made.encode()) == made


WORD = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,8}", fullmatch=True)
NAME = st.lists(WORD, min_size=1, max_size=4).map(lambda words: "/" + "/".join(words))
SECONDS = st.none() | st.integers(1, 10**12).map(lambda nanoseconds: nanoseconds / 1e9)
PROFILES = st.builds(
    QoS,
    st.sampled_from(History),
    st.integers(0, 10**6),
    st.sampled_from([Reliability.RELIABLE, Reliability.BEST_EFFORT]),
    st.sampled_from([Durability.VOLATILE, Durability.TRANSIENT_LOCAL]),
    SECONDS,
    SECONDS,
)


@given(PROFILES)
def test_every_qos_comes_back(qos: QoS) -> None:
    read = qos_text.decode(qos_text.encode(qos))
    assert (read.history, read.depth, read.reliability, read.durability) == (
        qos.history,
        qos.depth,
        qos.reliability,
        qos.durability,
    )
    for found, given_ in ((read.deadline, qos.deadline), (read.lifespan, qos.lifespan)):
        assert found == (None if given_ is None else pytest.approx(given_, abs=1e-9))


ENDPOINTS = st.builds(
    TokenEndpoint, NAME, WORD.map(lambda w: f"p::msg::dds_::{w}_"), WORD, st.just(DEFAULT_QOS)
)


@given(st.integers(0, 10**6), WORD, st.integers(0, 10**6), st.integers(0, 10**6), NAME, ENDPOINTS, NAME)
def test_every_token_comes_back(
    domain: int, session: str, node_id: int, entity: int, node: str, end: TokenEndpoint, enclave: str
) -> None:
    for kind in EntityKind:
        endpoint = None if kind is EntityKind.NODE else end
        token = Token(domain, session, node_id, entity, kind, node, endpoint, enclave)
        assert parse(token.key()) == token


@given(st.text(alphabet="@ros2_lv/0%NMPSC:,1a", max_size=200))
def test_whatever_comes_is_a_token_or_refused(key: str) -> None:
    with contextlib.suppress(WireError):
        parse(key)


@pytest.mark.parametrize("key", TOKENS)
def test_a_token_that_lacks_parts_or_has_too_many(key: str) -> None:
    parts = key.split("/")
    for count in range(len(parts)):
        with pytest.raises(WireError):
            parse("/".join(parts[:count]))
    with pytest.raises(WireError):
        parse(f"{key}/more")


@pytest.mark.parametrize(
    ("key", "why"),
    [
        ("@ros2_lv/x/a/0/0/NN/%/%/n", "'x' is not a number"),
        ("@ros2_lv/0/a/0/-1/NN/%/%/n", "'-1' is not a number"),
        ("@ros2_lv/0/a/0/0/XX/%/%/n", "unknown kind, 'XX'"),
        ("@ros2_lv/0/a/0/0/NN/%/ns/n", "'ns' does not begin with %"),
        ("@other/0/a/0/0/NN/%/%/n", "is not a liveliness token"),
        ("@ros2_lv/0/a/0/0/MP/%/%/n/%t/\u202ep::msg::dds_::T_/h/::,1:,:,:,,", "expected printable ASCII"),
        ("@ros2_lv/0/a/0/0/NN/%/%/\x1b[2J", "expected printable ASCII"),
        ("@ros2_lv/" + "9" * 5000, "a liveliness token of 5009 characters"),
    ],
)
def test_tokens_that_are_refused_say_why(key: str, why: str) -> None:
    with pytest.raises(WireError, match=why):
        parse(key)
