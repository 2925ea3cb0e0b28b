"""Parsed case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from rosbridge_conformance.suite.values import Json

Level: TypeAlias = Literal["MUST", "SHOULD", "COMPAT", "HARDEN", "INFO"]

Side: TypeAlias = Literal["server", "client"]

LEVELS: tuple[Level, ...] = ("MUST", "SHOULD", "COMPAT", "HARDEN", "INFO")

PROFILES = (
    "CORE", "PNG", "CBOR", "CBOR-RAW", "FRAGMENT-IN", "FRAGMENT-OUT", "ACTION", "ACTIONLIB", "ROSAPI", "AUTH",
    "STATUS", "GLOB", "QOS", "TF-REPUBLISH", "TCP", "CLIENT-COUNT", "PARAMETERS",
)  # fmt: skip
"""Parts of the protocol that a target declares; CORE is for every server."""

TEXTS = ("ros1", "ros2", "2.0.0")
"""The three protocol texts: the two branches of rosbridge_suite, and the rewritten one of 2026."""

VIA = ("png", "cbor", "fragments")
"""Wrappings of a frame."""


SIDES: tuple[Side, ...] = ("server", "client")
"""Graded side: a server, by suite clients; or a client library, by a server that the suite plays."""


@dataclass(frozen=True, slots=True)
class Send:
    """Send a frame `times` times, `every` seconds apart; text and hex go out as they stand.

    Attributes:
        via: what a frame to a client library is wrapped in, innermost first.
        fragment_size: characters of text in each fragment, when it goes out in fragments.
    """

    client: str
    form: Literal["json", "text", "hex"]
    body: Json
    times: int = 1
    every: float = 0.0
    via: tuple[str, ...] = ()
    fragment_size: int = 0


@dataclass(frozen=True, slots=True)
class Tolerated:
    """A frame that is not what the rule says but is known in the field; it makes the verdict non-strict."""

    frame: Json
    why: str


@dataclass(frozen=True, slots=True)
class Expect:
    """The next frame of a client has to match; `within` seconds, or the target's time limit.

    Attributes:
        via: what the frame comes wrapped in, outermost first.
        fragment_size: most characters in the data of a fragment, when it comes in fragments.
    """

    client: str
    frame: Json
    within: float | None = None
    via: tuple[str, ...] = ()
    fragment_size: int | None = None
    tolerate: tuple[Tolerated, ...] = ()


@dataclass(frozen=True, slots=True)
class ExpectAll:
    """The next frames of a client have to match these, in any order."""

    client: str
    frames: tuple[Json, ...]
    within: float | None = None


@dataclass(frozen=True, slots=True)
class ExpectNothing:
    """No frame, or no frame that matches, may come for some seconds."""

    client: str
    seconds: float
    matching: Json = None


@dataclass(frozen=True, slots=True)
class ExpectClose:
    """The server has to close the connection, with one of the codes if any are given."""

    client: str
    codes: tuple[int, ...]
    within: float | None = None


@dataclass(frozen=True, slots=True)
class Wait:
    """Let time pass."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Settle:
    """Wait until the server has handled all these clients have sent, and others know of it."""

    clients: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Open:
    """Connect a client, again or for the first time; where clients are graded: wait until it connects."""

    client: str


@dataclass(frozen=True, slots=True)
class Close:
    """The suite's side ends a connection: politely, or by cutting the line."""

    client: str
    abruptly: bool = False


@dataclass(frozen=True, slots=True)
class Tell:
    """Tell the program around a client library what to do next, and wait until it says that it has."""

    command: Json
    within: float | None = None


@dataclass(frozen=True, slots=True)
class Hear:
    """The next thing that a client library gives to its user has to match."""

    event: Json
    within: float | None = None


@dataclass(frozen=True, slots=True)
class HearNothing:
    """A client library may give nothing to its user for some seconds."""

    seconds: float


Step: TypeAlias = (
    Send
    | Expect
    | ExpectAll
    | ExpectNothing
    | ExpectClose
    | Wait
    | Settle
    | Open
    | Close
    | Tell
    | Hear
    | HearNothing
)


@dataclass(frozen=True, slots=True)
class Divergence:
    """Differing behaviour of a server in the field, for the record."""

    server: str
    does: str


@dataclass(frozen=True, slots=True)
class Case:
    """One question to a server, or to a client library.

    Attributes:
        id: the path below the folder of cases without its ending; never changes once released.
        title: what a right server or client does, in a sentence of at most 80 characters.
        rules: ids of the rules it checks.
        spec: section by protocol text, for the texts that say so.
        level: how strongly it is asked; HARDEN is reported apart, INFO never fails.
        profile: the part of the protocol it belongs to.
        ros: the ROS generations it makes sense for.
        needs: features that the target has to declare.
        clients: names of all connections, in order of first use; the first is open from the start, unless
            the first step tells a client library to connect.
        alone: whether other cases may not run meanwhile.
        timed: whether it measures time, and only others that do so too may run meanwhile.
        leftover: whether frames may come that no step expects.
        probe: whether every open connection has to answer after the last step.
        notes: for each step the sentence that its file gives, or "".
        example: names of the examples in the protocol texts that it replays.
        side: who is graded.
    """

    id: str
    title: str
    rules: tuple[str, ...]
    spec: Mapping[str, str]
    level: Level
    profile: str
    steps: tuple[Step, ...]
    notes: tuple[str, ...]
    clients: tuple[str, ...]
    about: str = ""
    ros: tuple[int, ...] = (1, 2)
    needs: tuple[str, ...] = ()
    alone: bool = False
    timed: bool = False
    leftover: bool = False
    probe: bool = True
    example: tuple[str, ...] = ()
    divergences: tuple[Divergence, ...] = ()
    side: Side = "server"

    @property
    def section(self) -> str:
        """The folder the case is in."""
        return self.id.partition("/")[0]
