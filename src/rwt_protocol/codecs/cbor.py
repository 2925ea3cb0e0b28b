"""The CBOR encoding (CBR): one map a binary frame.

On the way out the message that is published is CBOR already, and is spliced in. On the way in the frame is
decoded once, envelope and payload together: a payload is handed on as the plain objects it was decoded to.
"""

from __future__ import annotations

import gc
import re
import struct
from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Final, NoReturn

from rwt_protocol.codecs.base import DecodeFailure, Members, PublishEncoder, SplitLimits
from rwt_protocol.codecs.object_codec import ObjectCodec, members_of
from rwt_protocol.payloads import FEW_BYTES, Sample
from rwt_protocol.transport import Buffer, Frame

if TYPE_CHECKING:
    import cbor2

MAPS: Final = bytes(range(0xA0, 0xC0))
"""The first bytes of a map."""

_KIND: Final = (
    "an integer",
    "an integer",
    "bytes",
    "a string",
    "an array",
    "a map",
    "a tag",
    "a simple value",
)

TYPED_ARRAYS: Final = {
    64: "<B", 65: ">H", 66: ">I", 67: ">Q", 68: "<B", 69: "<H", 70: "<I", 71: "<Q",
    72: "<b", 73: ">h", 74: ">i", 75: ">q", 77: "<h", 78: "<i", 79: "<q",
    80: ">e", 81: ">f", 82: ">d", 84: "<e", 85: "<f", 86: "<d",
}  # fmt: skip
"""Byte order of the elements of each kind of typed array and their letter in :mod:`struct`, by tag (RFC 8746
section 2.1)."""

_NOT_CBOR: Final = (
    "not CBOR: malformed, nested too deeply, with a key that is no string, or a tag that ROS has not"
)

_READ_SIZE: Final = 1024
"""Bytes that the library reads at a time; of a longer string it reads the rest at once."""

_BYTES, _TEXT, _ARRAY, _MAP, _TAG = range(2, 7)
_HEADS: Final = bytes(range(0x80, 0xE0)) + b"\xf8"
"""The first bytes of arrays, maps and tags, which take the library ten times as long as others, and of simple
values, which take a hundred times as long."""
_BYTES_OF_A_HEAD: Final = 6
"""How many bytes of structure a frame has at least for each array, map or tag in it."""
_SIMPLE_WEIGHT: Final = 16
_ARGUMENT_SIZES: Final = {24: 1, 25: 2, 26: 4, 27: 8}
_LAST_ARGUMENT: Final = 23
_MOST_WALKED: Final = 21_000
"""Arrays and maps, one with its neighbours, that are counted exactly."""
_RUN: Final = re.compile(
    rb"([\x80-\x97\xa0-\xb7\xc0-\xd7]*+)(?:[\x00-\x17\x20-\x37\xf4-\xf7\xff]"
    rb"|[\x18\x38].|[\x19\x39\xf9].{2}|[\x1a\x3a\xfa].{4}|[\x1b\x3b\xfb].{8}|"
    + b"|".join(b"[\\x%02x\\x%02x].{%d}" % (0x40 + size, 0x60 + size, size) for size in range(24))
    + rb")*+",
    re.DOTALL,
)
"""A run of arrays, maps and tags with short heads, then one of numbers and of short texts and octets."""

_FOREIGN: Final = (0, 1, 4, 5, 25, 28, 29, 30, 35, 36, 37, 52, 54, 100, 256, 258, 260, 261, 1004, 43000)
"""Tags that the library would turn into dates, patterns, shared references and so on, which ROS has not."""


class CborCodec(ObjectCodec):
    """The CBOR encoding; see :class:`rwt_protocol.codecs.base.Codec`."""

    def split(self, data: bytes, limits: SplitLimits) -> Sequence[Members | DecodeFailure]:
        """The message in one binary frame. Never raises."""
        import cbor2  # only for those who use it

        large = len(data) > FEW_BYTES
        counted = _Stream(data, limits.max_structure) if large else None
        stream = counted or BytesIO(data)
        # Among hundreds of thousands of new objects the collector finds nothing, and takes most of the time.
        collecting = large and gc.isenabled()
        if collecting:
            gc.disable()
        try:
            decoder = cbor2.CBORDecoder(
                stream,
                tag_hook=_typed_array,
                semantic_decoders=dict.fromkeys(_FOREIGN, _refuse),
                read_size=_READ_SIZE,
                max_depth=limits.max_depth,
                strict_hashable_types=True,
            )
            found = decoder.decode()
        except (cbor2.CBORError, _TooMuchStructure):
            if counted is None or counted.left >= 0:
                return (DecodeFailure(_NOT_CBOR),)
            most = limits.max_structure
            return (
                DecodeFailure(
                    f"more than {most} bytes beside long strings and typed arrays, or more than"
                    f" {most // _BYTES_OF_A_HEAD} arrays and maps (limits.structure_bytes)"
                ),
            )
        finally:
            if collecting:
                gc.enable()
        if stream.tell() != len(data):
            return (DecodeFailure("not CBOR: more than one value in the frame"),)
        if not isinstance(found, dict):
            return (DecodeFailure(f"expected a map, got {_KIND[data[0] >> 5]}"),)
        return (members_of(found, len(data)),)

    def frame(self, message: Mapping[str, object]) -> Frame:
        """A message as one map."""
        import cbor2  # only for those who use it

        return Frame(cbor2.dumps(message), binary=True)

    def publish_encoder(self, topic: str) -> PublishEncoder:
        """An encoder for the samples of `topic`; the message is CBOR already, and is spliced in."""
        prefix = publish_prefix(topic)

        def encode(sample: Sample) -> Frame:
            return Frame(prefix, *sample.payload.cbor_parts(), binary=True)

        return encode


def raw_publish_encoder(topic: str) -> PublishEncoder:
    """An encoder for the samples of `topic` as their robot serialises them (CBR-10 to CBR-12)."""
    prefix = publish_prefix(topic)

    def encode(sample: Sample) -> Frame:
        return raw_publish_frame(prefix, sample.payload.serialised_parts(), sample.stamp_ns)

    return encode


def publish_prefix(topic: str) -> bytes:
    """The bytes before the payload in every message of `topic` (CBR-01)."""
    return b"\xa3\x62op\x67publish\x65topic" + _text(topic) + b"\x63msg"


def publish_frame(prefix: bytes, payload: Buffer) -> Frame:
    """One message of the topic of `prefix`; `payload` is CBOR, and is spliced in."""
    return Frame(prefix, payload, binary=True)


def raw_publish_frame(prefix: bytes, data: Sequence[Buffer], stamp_ns: int) -> Frame:
    """One message of the topic of `prefix` as its robot serialises it (CBR-10).

    Args:
        prefix: what :func:`publish_prefix` made.
        data: the serialised message, in parts; spliced in.
        stamp_ns: ROS time, nanoseconds since the epoch. The keys are secs and nsecs in both ROS versions.
    """
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    stamp = b"\xa3\x64secs" + _head(0, seconds) + b"\x65nsecs" + _head(0, nanoseconds)
    return Frame(prefix + stamp + b"\x65bytes" + _head(2, sum(map(len, data))), *data, binary=True)


def _text(text: str) -> bytes:
    """A CBOR text string of definite length (RFC 8949 section 3.1)."""
    data = text.encode()
    return _head(3, len(data)) + data


def _head(major: int, argument: int) -> bytes:
    """The head of a data item, as short as it can be (RFC 8949 section 3)."""
    if argument < 24:
        return bytes((major << 5 | argument,))
    size = (argument.bit_length() + 7) // 8
    exponent = (size - 1).bit_length()
    return bytes((major << 5 | 24 + exponent,)) + argument.to_bytes(1 << exponent, "big")


class _TooMuchStructure(Exception):
    """The frame holds more items, and strings that are short, than it may."""


class _Stream(BytesIO):
    """A frame to decode, which counts what is read of it beside long strings.

    Attributes:
        left: bytes that may still be read; negative once it was too much.
    """

    def __init__(self, data: bytes, max_structure: int) -> None:
        super().__init__(data)
        self.left = max_structure
        self._most_heads = max_structure // _BYTES_OF_A_HEAD
        self._heads = 0
        self._is_walked = False

    def read(self, size: int | None = -1, /) -> bytes:
        """As of any stream.

        Raises:
            _TooMuchStructure: the library has read more small pieces than it may.
        """
        if size is not None and size <= _READ_SIZE:
            self.left -= size if size > 1 else 2  # Each takes its time, however small it is.
            if self.left < 0:
                raise _TooMuchStructure
            data = super().read(size)
            self._heads += len(data) - len(data.translate(None, _HEADS))
            if self._heads > self._most_heads // 8 and not self._is_walked:
                self._is_walked = True
                if _has_more_heads(self.getvalue(), self._most_heads):
                    self.left = -1
                    raise _TooMuchStructure
            return data
        return super().read(size)


def _has_more_heads(data: bytes, most: int) -> bool:
    """Whether more than `most` arrays, maps and tags begin in a frame; a simple value that no message has
    counts as many of them."""
    at, found = 0, 0
    for _ in range(_MOST_WALKED):
        if found > most:
            return True
        run = _RUN.match(data, at)
        if run is not None:  # It may be empty, and matches always.
            found += run.end(1) - at
            at = run.end()
        if at >= len(data):
            return found > most
        major, argument = data[at] >> 5, data[at] & 31
        size = _ARGUMENT_SIZES.get(argument, 0)
        if major in (_BYTES, _TEXT):
            size += int.from_bytes(data[at + 1 : at + 1 + size], "big") if size else argument
        elif major not in (_ARRAY, _MAP, _TAG):
            found += _SIMPLE_WEIGHT
        elif size or argument > _LAST_ARGUMENT:
            found += 1
        else:
            continue
        at += 1 + size
    # What is left is reckoned, so that finding out takes no longer than it is worth.
    left = data[at : at + _BYTES_OF_A_HEAD * most]
    return found + len(left) - len(left.translate(None, _HEADS)) > most


def _typed_array(tag: cbor2.CBORTag, immutable: bool) -> object:
    import cbor2  # loaded already, by `split`

    code = TYPED_ARRAYS.get(tag.tag)
    data = tag.value
    if code is None or not isinstance(data, bytes) or len(data) % struct.calcsize(code):
        raise cbor2.CBORDecodeError("not a typed array")
    if len(data) > FEW_BYTES and code != "<B":
        import numpy as np  # heavy, and few messages need it

        return np.frombuffer(data, code)
    return array_elements(code, data)


def array_elements(code: str, data: Buffer) -> bytes | list[int] | list[float]:
    """The elements of a typed array: octets as bytes, anything else as a list.

    Args:
        code: one of :data:`TYPED_ARRAYS`.
        data: as many whole elements as there are.
    """
    if code == "<B":
        return bytes(data)
    return list(struct.unpack(f"{code[0]}{len(data) // struct.calcsize(code)}{code[1]}", data))


def _refuse(*ignored: object) -> NoReturn:
    import cbor2  # loaded already, by `split`

    raise cbor2.CBORDecodeError("a tag that ROS has not")
