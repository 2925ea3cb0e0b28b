"""Session descriptions (RFC 8866, RFC 8829): validation of those of the other side, and changes to ours.

aiortc uses most values only in a task of its own, after the description was accepted. So the values that it
uses are validated here, and all other lines are left out.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from aiortc import RTCIceCandidate
from aiortc.sdp import candidate_from_sdp

from rwt_transports.errors import TransportError
from rwt_webrtc.packets.ice_guard import Reach, is_unicast, reach_of

OFFER_BYTES: Final = 64 * 1024
"""Largest offer that is looked at; a browser's with every codec it has takes 10 KiB."""
CANDIDATES: Final = 256
"""Addresses that a peer may have, where nothing says how many."""
LINE_BYTES: Final = 4096
ALIKE_LINES: Final = 256
"""Lines of one attribute but candidates: aiortc compares each of some of them with all others."""
WILDCARDS: Final = 16
"""Lines of feedback for every codec, each of which is multiplied by the codecs there are."""
SECTIONS: Final = 16
FRAGMENT_BYTES: Final = 16 * 1024
"""Largest body of a PATCH with candidates."""
LIBWEBRTC_BYTES: Final = 256 * 1024
"""Message size that Chromium, Safari and aiortc announce. They accept more, and roslib relies on that."""

UNSAID_BYTES: Final = 64 * 1024
"""Largest message of who says nothing about it (RFC 8841 section 6.1)."""


class BadDescription(TransportError):
    """The session description, or a piece of one, is not usable."""


@dataclass(frozen=True, slots=True)
class Description:
    """Content of an offer or an answer.

    Attributes:
        text: the description without what is not used here: unknown attributes, candidates that are no UDP or
            that only multicast could resolve, and the end of candidates, after which aiortc would give up
            where none is left.
        media: the kinds of its sections, in order.
        candidates: number of remaining candidates.
        ufrag: its ICE user name fragment.
        largest: bytes of the largest message to send on a data channel; 0 for any.
    """

    text: str
    media: tuple[str, ...]
    candidates: int
    ufrag: str
    largest: int


def read_description(body: bytes, most_candidates: int = CANDIDATES) -> Description:
    """Parse an offer or an answer.

    Raises:
        BadDescription: it cannot be used; says why.
    """
    if len(body) > OFFER_BYTES:
        raise BadDescription(f"a session description of {len(body)} bytes; the limit is {OFFER_BYTES}")
    lines = list(_lines(body))
    if not lines or lines[0] != "v=0":
        raise BadDescription("this is no session description: its first line is not `v=0` (RFC 8866)")
    kept: list[str] = []
    media: list[str] = []
    candidates, ufrag, largest = 0, "", UNSAID_BYTES
    _check_counts(lines)
    for line in lines:
        if line.startswith("a=") and not _is_known(line):
            continue
        if line.startswith("m="):
            media.append(_media_kind(line))
        elif line.startswith("a=candidate:"):
            if not _is_usable(line[2:]):
                continue
            candidates += 1
        elif line == "a=end-of-candidates":
            continue
        elif line.startswith("a=ice-ufrag:"):
            ufrag = ufrag or line.partition(":")[2]
        elif line.startswith("a=max-message-size:"):
            said = int(line.partition(":")[2])
            largest = 0 if said == LIBWEBRTC_BYTES else said
        kept.append(line)
    if candidates > most_candidates:
        raise BadDescription(f"{candidates} candidates; the limit is {most_candidates} (webrtc.candidates)")
    if len(media) > SECTIONS:
        raise BadDescription(f"{len(media)} sections; the limit is {SECTIONS}")
    if not ufrag:
        raise BadDescription("the session description has no `a=ice-ufrag`")
    _check_sections(kept)
    return Description("\r\n".join(kept) + "\r\n", tuple(media), candidates, ufrag, largest)


_NAMES: Final = frozenset(
    {
        "candidate", "end-of-candidates", "fmtp", "group", "ice-lite", "ice-options", "inactive", "msid",
        "msid-semantic", "recvonly", "rtcp", "rtcp-fb", "rtcp-mux", "sctpmap", "sendonly", "sendrecv", "ssrc",
        "ssrc-group",
    }
)  # fmt: skip
"""Attributes that aiortc reads while it accepts a description, where it rejects what it cannot use."""

_VALUES: Final = {
    "extmap": (re.compile(r"([0-9]{1,3})(/[a-z]+)? .*"), 1, 255),
    "fingerprint": (re.compile(r"[!-~]+ [0-9A-Fa-f]{2}(?::[0-9A-Fa-f]{2})*"), 0, 0),
    "ice-pwd": (re.compile(r"[A-Za-z0-9+/]{22,256}"), 0, 0),
    "ice-ufrag": (re.compile(r"[A-Za-z0-9+/]{4,256}"), 0, 0),
    "max-message-size": (re.compile(r"([0-9]{1,19})"), 0, 10**19),
    "mid": (re.compile(r"[!-~]{1,64}"), 0, 0),
    "rtpmap": (re.compile(r"([0-9]{1,3}) .*"), 0, 127),
    "sctp-port": (re.compile(r"([0-9]{1,5})"), 1, 65535),
    "setup": (re.compile(r"active|passive|actpass"), 0, 0),
}
"""Attributes that aiortc uses later: pattern, and the range of its first group."""


def _is_known(line: str) -> bool:
    """Return True if aiortc reads an attribute, False if it is left out.

    Raises:
        BadDescription: its value is invalid.
    """
    name, _, value = line[2:].partition(":")
    if name not in _VALUES:
        return name in _NAMES
    pattern, least, most = _VALUES[name]
    found = pattern.fullmatch(value)
    if found is None or (found.groups() and not least <= int(found[1]) <= most):
        raise BadDescription(f"not a value that can be used: {line[:80]!a}")
    return True


DIGESTS: Final = ("sha-256", "sha-384", "sha-512")
"""Digests of fingerprints that aiortc compares."""
_REQUIRED: Final = ("a=ice-ufrag:", "a=ice-pwd:", "a=setup:", "a=fingerprint:")


def _check_sections(lines: list[str]) -> None:
    """Check that each section has credentials and a fingerprint, of its own or of the session."""
    session: set[str] = set()
    sections = [session]
    for line in lines:
        if line.startswith("m="):
            sections.append(set(session))
        name = next((each for each in _REQUIRED if line.startswith(each)), None)
        if name == "a=fingerprint:" and line[len(name) :].partition(" ")[0].lower() not in DIGESTS:
            continue
        if name is not None:
            sections[-1].add(name)
    for section in sections[1:]:
        for name in _REQUIRED:
            if name not in section:
                digests = f" with {', '.join(DIGESTS)}" if name == "a=fingerprint:" else ""
                raise BadDescription(f"a section has no `{name.rstrip(':')}`{digests}")


def _check_counts(lines: list[str]) -> None:
    """Reject more items of a kind than browsers send: their objects grow faster than the text."""
    counts = Counter(line.partition(":")[0] for line in lines if line.startswith("a="))
    del counts["a=candidate"]
    for name, count in counts.most_common(1):
        if count > ALIKE_LINES:
            raise BadDescription(f"{count} lines of {name[:80]!a}; the limit is {ALIKE_LINES}")
    wildcards = sum(line.startswith("a=rtcp-fb:*") for line in lines)
    if wildcards > WILDCARDS:
        raise BadDescription(f"{wildcards} lines of 'a=rtcp-fb:*'; the limit is {WILDCARDS}")


def _lines(body: bytes) -> Iterator[str]:
    try:
        text = body.decode()
    except UnicodeDecodeError as error:
        raise BadDescription(f"not UTF-8: {error}") from None
    for line in text.split("\n"):
        line = line.removesuffix("\r")
        if not line:
            continue
        if len(line) > LINE_BYTES:
            raise BadDescription(f"a line of {len(line)} characters; the limit is {LINE_BYTES}")
        if not line.isprintable() or line[1:2] != "=" or not line[0].isalpha():
            raise BadDescription(f"not a line of a session description: {line[:80]!a}")
        yield line


_MEDIA: Final = re.compile(r"m=(audio|video|application) ([0-9]{1,5}) [A-Z/]+ [!-~]+( [!-~]+)*")


def _media_kind(line: str) -> str:
    found = _MEDIA.fullmatch(line)
    if found is None or int(found[2]) > 65535:
        raise BadDescription(f"not a section that can be used: {line[:80]!a}")
    return found[1]


def _is_usable(attribute: str) -> bool:
    """Return True if a candidate (RFC 8839 section 5.1) uses UDP and an address of one host.

    Names in `.local` would need multicast; such peers are found by their own checks.

    Raises:
        BadDescription: its port is none.
    """
    parts = attribute.split()
    if len(parts) < 8 or parts[2].lower() != "udp" or parts[6] != "typ":
        return False
    numbers = (parts[1], parts[3], parts[5])
    if not all(each.isascii() and each.isdecimal() and len(each) <= 10 for each in numbers):
        return False
    if int(parts[5]) > 65535:
        raise BadDescription(f"not a port: {attribute[:80]!a}")
    # Component 2 would be RTCP beside RTP, which WebRTC multiplexes.
    return int(parts[1]) == 1 and parts[7] in _TYPES and is_unicast(parts[4], int(parts[5]))


_TYPES: Final = ("host", "srflx", "relay")


@dataclass(frozen=True, slots=True)
class Fragment:
    """Content of a PATCH request (RFC 8840).

    Attributes:
        ufrag: whose candidates they are; empty where it does not say.
        candidates: those that can be used.
    """

    ufrag: str
    candidates: tuple[RTCIceCandidate, ...]


def read_fragment(body: bytes) -> Fragment:
    """Parse a fragment of a description with further candidates.

    Raises:
        BadDescription: it cannot be used; says why.
    """
    if len(body) > FRAGMENT_BYTES:
        raise BadDescription(f"candidates in {len(body)} bytes; the limit is {FRAGMENT_BYTES}")
    ufrag, mid = "", "0"
    candidates: list[RTCIceCandidate] = []
    for line in _lines(body):
        name, _, value = line.partition(":")
        if name == "a=ice-ufrag":
            ufrag = ufrag or value
        elif name == "a=mid":
            mid = value
        elif name == "a=candidate" and _is_usable(line[2:]):
            candidate = _candidate(value)
            candidate.sdpMid = mid
            candidates.append(candidate)
    return Fragment(ufrag, tuple(candidates))


def _candidate(value: str) -> RTCIceCandidate:
    try:
        return candidate_from_sdp(value)
    except (ValueError, AssertionError, IndexError) as error:
        raise BadDescription(f"not a candidate: {value[:80]!a} ({error})") from None


def with_largest_message(text: str, size: int) -> str:
    """Return aiortc's description with another maximum message size."""
    return re.sub(r"(?m)^a=max-message-size:\d+", f"a=max-message-size:{size}", text)


def without_addresses(text: str, reach: Reach) -> str:
    """Return this side's description without candidates and related addresses outside of the reach."""
    kept: list[str] = []
    for line in text.splitlines():
        words = line.split()
        if line.startswith("a=candidate:") and len(words) > 7:
            if reach_of(words[4]) < reach:
                continue
            if "raddr" in words and reach_of(words[words.index("raddr") + 1]) < reach:
                # The format of RFC 8839 section 5.1 for a hidden address.
                at = words.index("raddr")
                words[at + 1], words[at + 3] = "::" if ":" in words[at + 1] else "0.0.0.0", "9"
                line = " ".join(words)
        elif line.startswith("c=") and reach_of(words[2]) < reach:
            line = "c=IN IP4 0.0.0.0"
        elif line.startswith("a=rtcp:") and len(words) > 3 and reach_of(words[3]) < reach:
            line = "a=rtcp:9 IN IP4 0.0.0.0"
        kept.append(line)
    return "\r\n".join(kept) + "\r\n"
