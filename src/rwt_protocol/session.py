"""Wire state of one peer: decodes frames to ops and encodes ops. No I/O, no clock, no log."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, cast

import msgspec
from pydantic import ValidationError

from rwt_protocol.codecs import JSON, codec_of, decode_png
from rwt_protocol.codecs.base import Codec, DecodeFailure, Members, SteppedCodec
from rwt_protocol.codecs.head_tail_split import head_members
from rwt_protocol.codecs.quick_frames import quick_reader
from rwt_protocol.error_text import describe, explain
from rwt_protocol.errors import Level, Misread, Refused
from rwt_protocol.fragments import MessageReassembly, cut
from rwt_protocol.frames import Frame
from rwt_protocol.limits import WIRE_LIMITS, WireLimits
from rwt_protocol.ops import ALIASES, OPS, Direction, Fragment, Op, Png, ReplyTo, SetLevel, Status
from rwt_protocol.ops.base import MOST_MARK
from rwt_protocol.payloads import Encodable
from rwt_protocol.profiles import COMPAT, Profile, StatusRule
from rwt_protocol.readers import readers

_MOST_INSIDE: Final = 4

_MOST_NAME: Final = 40
"""Maximum number of characters of an unknown op that is compared with the known ones."""

_SEVERITY: Final[Mapping[Level, int]] = {"info": 0, "warning": 1, "error": 2, "none": 3}


@dataclass(frozen=True, slots=True)
class Refusal:
    """Rejected part of a frame.

    Attributes:
        reason: error text for the sender.
        op: name of the op as sent; empty if unreadable.
        id: id of the sender; None if unreadable.
        name: name of the service or action; empty if unreadable.
        answer: op that reports it to the sender; None in clients, where the protocol has none.
    """

    reason: str
    op: str = ""
    id: str | int | None = None
    name: str = ""
    answer: Op | None = None


class Session:
    """Wire state of one peer.

    Handles ops for the session itself (`set_level`, `fragment`, `png`) and does not return them.

    Args:
        profile: version of the protocol.
        direction: which messages arrive here: `TO_SERVER` in a server, `TO_CLIENT` in a client.
        limits: limits of the peer.
        codec: exclusive encoding of all messages both ways; None: JSON, and binary encodings are accepted.
        light: True to return common small messages as light ops (:mod:`rwt_protocol.ops.light`). They are no
            `Op`, and have its attributes; a `Dispatcher` calls the handler of the op. The message of a light
            publish may be unvalidated: act on nothing before it is checked against a type, or validated. If
            its validation raises :class:`Misread`, call :meth:`decode_again`.

    Attributes:
        encode: encodes an op; raises `MalformedPayload` if its payload came from another peer and is not
            JSON.
        response: encodes the response to a successful call, from the service, its response and the caller's
            id.
        call: encodes a call to a provider, from the service, its request and the id.
        level: minimum severity of `status` messages for the client; None if it receives none in this profile.
        wants_warnings: True if the client receives `status` messages about warnings; also True if it receives
            those about successes.
    """

    def __init__(
        self,
        profile: Profile = COMPAT,
        direction: Direction = Direction.TO_SERVER,
        limits: WireLimits = WIRE_LIMITS,
        codec: Codec | None = None,
        *,
        light: bool = False,
    ) -> None:
        self._profile = profile
        self._direction = direction
        self._max_size = limits.max_message_size
        self._limits = limits
        self._codec = codec
        outgoing = codec or JSON
        # Bound directly to the codec's methods, to save a call per message.
        self.encode: Callable[[Op], Frame] = outgoing.encode
        self.response: Callable[[str, Encodable, str | int | None], Frame] = outgoing.response
        self.call: Callable[[str, Encodable, str | int], Frame] = outgoing.call
        self._inside = 0
        self._reassembly = MessageReassembly(limits)
        self._readers = readers(profile, direction)
        quick = quick_reader(profile, limits, self._readers) if light and codec is None else None
        # A light op has the attributes of an op. Bound to the reader's method, to save time per message.
        self._read_light = None if quick is None else cast("Callable[[bytes], Op | None]", quick.read)
        self.level: Level | None = "error" if profile.status is StatusRule.FROM_THE_START else None
        self.wants_warnings = False

    def decode(self, data: bytes, binary: bool, now: float) -> Sequence[Op | Refusal]:
        """Return the messages of one frame, in order. Never raises, and keeps nothing of a truncated frame.

        The first byte of a binary frame selects its codec; other frames are JSON text (ENV-12), unless the
        session has an exclusive encoding.

        Args:
            now: seconds of any monotonic clock.
        """
        read_light = self._read_light
        if read_light is not None and not binary:
            op = read_light(data)
            if op is not None:
                return (op,)
        codec = self._codec or (codec_of(data) if binary else JSON)
        return self._decode(data, codec, now)

    def decode_again(self, misread: Misread, now: float) -> Sequence[Op | Refusal]:
        """Return the messages of a frame that was taken for a light op."""
        return self._decode(misread.frame, JSON, now)

    def decode_in_steps(
        self, data: bytes, binary: bool, now: float
    ) -> Generator[None, None, Sequence[Op | Refusal]]:
        """Same as :meth:`decode`, in steps of about a millisecond if the encoding supports it."""
        codec = self._codec or (codec_of(data) if binary else JSON)
        if len(data) > self._max_size or not isinstance(codec, SteppedCodec):
            return self._decode(data, codec, now)
        parts = yield from codec.split_in_steps(data, self._limits)
        return [read for part in parts for read in self._read(part, now)]

    def peek(self, data: bytes, binary: bool) -> Members | None:
        """Return the members of the only message of a frame without handling it; None if there is not one."""
        codec = self._codec or (codec_of(data) if binary else JSON)
        parts = codec.split(data, self._limits)
        return parts[0] if len(parts) == 1 and not isinstance(parts[0], DecodeFailure) else None

    def refuse_skipped(self, head: bytes, reason: str) -> Refusal | None:
        """Reject a message of which only the head was read.

        Args:
            head: first bytes of its JSON text.

        Returns:
            None if the head has no `id` or no `op` that arrives here, so that the sender cannot be answered.
        """
        members = head_members(head)
        op = members.get("op")
        known = isinstance(op, str) and (op in self._readers or ALIASES.get(op) in self._readers)
        return self._refusal(members, f"{op}: {reason}") if known and "id" in members else None

    def _decode(self, data: bytes, codec: Codec, now: float) -> Sequence[Op | Refusal]:
        if len(data) > self._max_size:
            return (
                self._refusal({}, f"{len(data)} bytes: the limit is {self._max_size} (max_message_size)"),
            )
        parts = codec.split(data, self._limits)
        if len(parts) == 1:
            return self._read(parts[0], now)
        return [read for part in parts for read in self._read(part, now)]

    def cut(
        self,
        frame: Frame,
        size: int | None,
        id: str | int | None = None,  # as on the wire
    ) -> Sequence[Frame]:
        """Cut a text frame longer than `size` characters into fragments (FRG-21)."""
        return cut(frame, size, str(id) if id is not None else "") if size else (frame,)

    def answer(self, op: Op) -> Frame | None:
        """Return an op as a frame; None for a `status` below the client's level (STA-02)."""
        if isinstance(op, Status) and not self.wants_status(op.level):
            return None
        return self.encode(op)

    def wants_status(self, level: Level) -> bool:
        """Return True if a `status` of that severity may be sent now (STA-02)."""
        return self.level is not None and level != "none" and _SEVERITY[level] >= _SEVERITY[self.level]

    def _read(self, members: Members | DecodeFailure, now: float) -> Sequence[Op | Refusal]:
        """Read a message as its op; empty if the session handled it."""
        if isinstance(members, DecodeFailure):
            return (self._refusal(members.members, members.reason),)
        try:
            reader = self._readers[members["op"]]
        except (KeyError, TypeError):
            return self._read_other(members, now)
        try:
            op = reader.read(members)
        except ValidationError as error:
            return (self._refusal(members, explain(str(members["op"]), reader.model, error)),)
        except (msgspec.DecodeError, UnicodeDecodeError):
            return (self._refusal(members, f"{members['op']}: holds a string that is not valid"),)
        return self._do(op, now) if reader.in_session else (op,)

    def _read_other(self, members: Members, now: float) -> Sequence[Op | Refusal]:
        """Read a message whose `op` is an alias, unknown or missing."""
        name = members.get("op")
        if isinstance(name, str) and ALIASES.get(name) in self._readers:
            return self._read(members | {"op": ALIASES[name]}, now)
        return (self._refusal(members, self._why_no_op(members)),)

    def _do(self, op: Op, now: float) -> Sequence[Op | Refusal]:
        """Handle an op for the session itself."""
        try:
            if isinstance(op, SetLevel):
                self.level = op.level
                self.wants_warnings = self.wants_status("warning")
            elif isinstance(op, Fragment):
                return self._join(op, now)
            elif isinstance(op, Png):
                return self._decode_inner(decode_png(op.data, self._max_size), now)
        except Refused as refused:
            return (self._refusal({"op": op.op, "id": op.id}, refused.reason),)
        return ()

    def _join(self, fragment: Fragment, now: float) -> Sequence[Op | Refusal]:
        """Add a fragment, and read the message that it completes as if it had arrived whole (FRG-11)."""
        data = self._reassembly.add(fragment, now)
        if data is None:
            return ()
        try:
            return self._decode_inner(data, now)
        finally:
            self._reassembly.forget(fragment.id)

    def _decode_inner(self, data: bytes, now: float) -> Sequence[Op | Refusal]:
        """Read a message that arrived inside another; raises Refused if they are nested too deeply."""
        # A fragment may complete a `png`, whose image holds a fragment: without a limit, a small frame could
        # nest decompressions endlessly.
        if self._inside >= _MOST_INSIDE:
            raise Refused(f"messages inside messages, more than {_MOST_INSIDE} deep")
        self._inside += 1
        try:
            return self._decode(data, JSON, now)
        finally:
            self._inside -= 1

    def _why_no_op(self, members: Members) -> str:
        """Return the reason why the `op` of a message is not accepted (ENV-03, ENV-04, ENV-05)."""
        known = [str(op) for op in self._readers]
        allowed = f"expected one of {', '.join(sorted(known))}"
        if "op" not in members:
            if "receiver" in members:
                return 'a message of rosbridge v1 ("receiver"): in v2 every message has an "op"'
            return f'no "op": {allowed}'
        name = members["op"]
        if not isinstance(name, str):
            return f"op: expected a string, got {describe(name)}"
        if name in OPS and name in self._profile.ops:
            return f'operation "{name}" only goes {OPS[name].direction.value}'
        import difflib  # slow import, rarely needed

        # Few words: to compare them takes long, and clients choose this one.
        similar = [op for op in known if op[:2] == name[:2].lower()] if len(name) <= _MOST_NAME else []
        meant = difflib.get_close_matches(name, similar, n=1)
        instead = f' (did you mean "{meant[0]}"?)' if meant else ""
        return f"unknown operation {describe(name)}{instead}: {allowed}"

    def _refusal(self, members: Members, reason: str) -> Refusal:
        reply_to = _reply_to(members)
        spec = OPS.get(reply_to.op, OPS["status"])
        answer: Op | None = spec.refuse(reply_to, reason, "error")
        if isinstance(answer, Status) and self._direction is Direction.TO_CLIENT:
            answer = None
        return Refusal(reason, reply_to.op, reply_to.id, reply_to.name, answer)


def _reply_to(members: Members) -> ReplyTo:
    op, mark = members.get("op"), members.get("id")
    name = members.get("service", members.get("action"))
    known = (isinstance(mark, str) and len(mark) <= MOST_MARK) or (
        isinstance(mark, int) and not isinstance(mark, bool) and -(2**63) <= mark < 2**64
    )
    return ReplyTo(
        op if isinstance(op, str) else "",
        mark if known and isinstance(mark, str | int) else None,
        name if isinstance(name, str) else "",
    )
