"""Accepted and rejected offers, and later fragments."""

from __future__ import annotations

from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_webrtc.packets.ice_guard import Reach
from rwt_webrtc.transport.sdp import (
    FRAGMENT_BYTES,
    OFFER_BYTES,
    BadDescription,
    read_description,
    read_fragment,
    with_largest_message,
    without_addresses,
)
from tests.webrtc.descriptions import CHROMIUM


def test_an_offer_of_a_browser() -> None:
    offer = read_description(CHROMIUM.replace("\n", "\r\n").encode(), 10)
    assert offer.media == ("application",)
    assert offer.ufrag == "abcd"
    assert offer.candidates == 1
    left_out = ("tcptype", ".local", "end-of-candidates", "extmap-allow-mixed")
    kept = [line for line in CHROMIUM.splitlines() if not any(each in line for each in left_out)]
    assert offer.text == "\r\n".join(kept) + "\r\n"


@pytest.mark.parametrize(
    ("said", "largest"),
    [("262144", 0), ("65535", 65535), ("0", 0), ("1073741823", 1073741823), (None, 65536)],
)
def test_the_largest_message(said: str | None, largest: int) -> None:
    line = "a=max-message-size:262144\n"
    text = CHROMIUM.replace(line, "" if said is None else f"a=max-message-size:{said}\n")
    assert read_description(text.encode(), 10).largest == largest


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "its first line is not `v=0`"),
        ("{}", "not a line of a session description"),
        (CHROMIUM.replace("v=0", "v=1"), "its first line is not `v=0`"),
        (CHROMIUM.replace("a=ice-ufrag:abcd\n", ""), "no `a=ice-ufrag`"),
        (CHROMIUM.replace("m=application 9", "m=text 9"), "not a section that can be used"),
        (CHROMIUM.replace("m=application 9", "m=application 65536"), "not a section that can be used"),
        (CHROMIUM.replace("a=fingerprint:sha-256 00:11\n", ""), "no `a=fingerprint` with sha-256"),
        (CHROMIUM.replace("sha-256 00:11", "sha-1 00:11"), "no `a=fingerprint` with sha-256"),
        (CHROMIUM.replace("sha-256 00:11", "sha-256 x"), "not a value that can be used"),
        (CHROMIUM.replace("a=setup:actpass\n", ""), "no `a=setup`"),
        (CHROMIUM.replace("actpass", "holdconn"), "not a value that can be used: 'a=setup:holdconn'"),
        (CHROMIUM.replace("ice-pwd:a", "ice-pwd:!"), "not a value that can be used: 'a=ice-pwd"),
        (CHROMIUM.replace("ufrag:abcd", "ufrag:abc"), "not a value that can be used: 'a=ice-ufrag:abc'"),
        (CHROMIUM.replace("sctp-port:5000", "sctp-port:99999"), "not a value that can be used"),
        (CHROMIUM.replace("sctp-port:5000", "sctp-port:0"), "not a value that can be used"),
        (CHROMIUM.replace("46243 typ", "99999 typ"), "not a port: 'candidate:1467250027"),
        (CHROMIUM + "a=rtpmap:128 VP8/90000\n", "not a value that can be used: 'a=rtpmap:128"),
        (CHROMIUM + "a=extmap:300 urn:x\n", "not a value that can be used: 'a=extmap:300"),
        (CHROMIUM.replace("262144", "many"), "not a value that can be used: 'a=max-message-size:many'"),
        (CHROMIUM + "a=" + "x" * 5000 + "\n", "a line of 5002 characters"),
        (CHROMIUM + "a=\x1b[2J\n", r"'a=\\x1b"),
        (CHROMIUM + "a=x\n" * OFFER_BYTES, "the limit is 65536"),
        (
            CHROMIUM + "a=candidate:1 1 udp 1 192.0.2.1 9 typ host\n" * 10,
            r"11 candidates.*webrtc\.candidates",
        ),
    ],
)
def test_offers_that_cannot_be_used(text: str, why: str) -> None:
    with pytest.raises(BadDescription, match=why):
        read_description(text.encode(), 10)


def test_an_offer_that_is_no_text() -> None:
    with pytest.raises(BadDescription, match="not UTF-8"):
        read_description(b"v=0\n\xff", 10)


def test_further_candidates() -> None:
    fragment = read_fragment(
        b"a=ice-ufrag:abcd\r\na=ice-pwd:x\r\n"
        b"m=application 9 UDP/DTLS/SCTP webrtc-datachannel\r\na=mid:data\r\n"
        b"a=candidate:1 1 udp 2122260223 192.0.2.7 4000 typ srflx raddr 10.0.0.1 rport 5\r\n"
        b"a=candidate:2 1 udp 2122260223 name.local 4000 typ host\r\na=end-of-candidates\r\n"
    )
    assert fragment.ufrag == "abcd"
    (candidate,) = fragment.candidates
    assert (candidate.ip, candidate.port, candidate.type, candidate.sdpMid) == (
        "192.0.2.7",
        4000,
        "srflx",
        "data",
    )


@pytest.mark.parametrize(
    "body",
    [b"a=candidate:1 1 udp x 192.0.2.7 4000 typ host", b"a=candidate:1 1 udp 1 192.0.2.7 \xc2\xb2 typ host"],
)
def test_candidates_that_are_none_are_left_out(body: bytes) -> None:
    assert read_fragment(body).candidates == ()


@pytest.mark.parametrize(
    "address",
    ["0.0.0.0 9", "255.255.255.255 9", "224.0.0.1 9", "240.1.2.3 9", ":: 9", "ff02::1 9",
     "::ffff:224.0.0.1 9",
     "192.0.2.1 0", "name.local 9"],
)  # fmt: skip
def test_candidates_of_no_single_host_are_left_out(address: str) -> None:
    line = f"a=candidate:1 1 udp 1 {address} typ host\n"
    assert read_description((CHROMIUM + line).encode(), 1).candidates == 1
    assert read_fragment(line.encode()).candidates == ()


@pytest.mark.parametrize("words", ["1 2 udp 1 192.0.2.1 9 typ host", "1 1 udp 1 192.0.2.1 9 typ prflx"])
def test_candidates_that_aioice_cannot_use_are_left_out(words: str) -> None:
    assert read_fragment(f"a=candidate:{words}".encode()).candidates == ()


OURS = (
    "m=application 9 UDP/DTLS/SCTP webrtc-datachannel\r\nc=IN IP4 10.0.0.5\r\n"
    "a=candidate:1 1 udp 1 10.0.0.5 4000 typ host\r\n"
    "a=candidate:2 1 udp 1 127.0.0.1 4000 typ host\r\n"
    "a=candidate:3 1 udp 1 8.8.4.4 4000 typ srflx raddr 10.0.0.5 rport 4000\r\n"
)


@pytest.mark.parametrize(
    ("reach", "left"),
    [
        (Reach.LOOPBACK, OURS),
        (Reach.PRIVATE, OURS.replace("a=candidate:2 1 udp 1 127.0.0.1 4000 typ host\r\n", "")),
        (
            Reach.PUBLIC,
            (
                "m=application 9 UDP/DTLS/SCTP webrtc-datachannel\r\nc=IN IP4 0.0.0.0\r\n"
                "a=candidate:3 1 udp 1 8.8.4.4 4000 typ srflx raddr 0.0.0.0 rport 9\r\n"
            ),
        ),
    ],
)
def test_addresses_that_are_told(reach: Reach, left: str) -> None:
    assert without_addresses(OURS, reach) == left


def test_too_many_bytes_of_candidates() -> None:
    with pytest.raises(BadDescription, match=str(FRAGMENT_BYTES)):
        read_fragment(b"a=x\n" * FRAGMENT_BYTES)


def test_the_size_of_messages_that_are_taken_is_said() -> None:
    assert with_largest_message("a=sctp-port:5000\r\na=max-message-size:262144\r\n", 10_000_000) == (
        "a=sctp-port:5000\r\na=max-message-size:10000000\r\n"
    )


@given(st.binary(max_size=400), st.integers(0, 22), st.integers(0, 1200))
def test_no_bytes_raise_anything_else(noise: bytes, line: int, at: int) -> None:
    lines = CHROMIUM.encode().split(b"\n")
    spoiled = b"\n".join([*lines[:line], noise, *lines[line:]])
    for body in (noise, spoiled, CHROMIUM.encode()[:at] + noise):
        for read in (partial(read_description, body, 10), partial(read_fragment, body)):
            try:
                read()
            except BadDescription as error:
                assert str(error).isprintable()
