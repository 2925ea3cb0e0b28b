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
"""Parts of the protocol that a target declares; CORE applies to every server."""

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
        via: wrappings of a frame to a client library, innermost first.
        fragment_size: characters of text in each fragment, if fragments are sent.
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
    """Frame that deviates from the rule but is common in the field; it makes the verdict non-strict."""

    frame: Json
    why: str


@dataclass(frozen=True, slots=True)
class Expect:
    """Expectation: the next frame of a client matches, `within` seconds or the target's timeout.

    Attributes:
        via: wrappings of the frame, outermost first.
        fragment_size: maximum characters in the data of a fragment, if fragments are received.
    """

    client: str
    frame: Json
    within: float | None = None
    via: tuple[str, ...] = ()
    fragment_size: int | None = None
    tolerate: tuple[Tolerated, ...] = ()


@dataclass(frozen=True, slots=True)
class ExpectAll:
    """Expectation: the next frames of a client match these, in any order."""

    client: str
    frames: tuple[Json, ...]
    within: float | None = None


@dataclass(frozen=True, slots=True)
class ExpectNothing:
    """Expectation: no frame, or no matching frame, for some seconds."""

    client: str
    seconds: float
    matching: Json = None


@dataclass(frozen=True, slots=True)
class ExpectClose:
    """Expectation: the server closes the connection, with one of the codes if given."""

    client: str
    codes: tuple[int, ...]
    within: float | None = None


@dataclass(frozen=True, slots=True)
class Wait:
    """Wait for some seconds."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Settle:
    """Wait until the server has handled everything from these clients, visibly for others."""

    clients: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Open:
    """Connect or reconnect a client; in cases of client libraries, wait until it connects."""

    client: str


@dataclass(frozen=True, slots=True)
class Close:
    """End a connection from the suite's side: by closing it, or by cutting it."""

    client: str
    abruptly: bool = False


@dataclass(frozen=True, slots=True)
class Tell:
    """Send a command to the program around a client library, and wait for its confirmation."""

    command: Json
    within: float | None = None


@dataclass(frozen=True, slots=True)
class Hear:
    """Expectation: the next event of a client library matches."""

    event: Json
    within: float | None = None


@dataclass(frozen=True, slots=True)
class HearNothing:
    """Expectation: no event of a client library for some seconds."""

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
    """Case for a server or a client library.

    Attributes:
        id: path below the folder of cases without extension; never changes once released.
        title: correct behaviour, in a sentence of at most 80 characters.
        rules: ids of the tested rules.
        spec: section by protocol text, for texts with this rule.
        level: requirement level; HARDEN is reported separately, INFO never fails.
        profile: part of the protocol.
        ros: ROS generations that it applies to.
        needs: features that the target has to declare.
        clients: names of all connections, in order of first use; the first is open from the start, unless
            the first step tells a client library to connect.
        alone: True if no other case may run meanwhile.
        timed: True if it measures time; only other such cases may run meanwhile.
        leftover: True if unexpected frames are allowed.
        probe: True if every open connection must respond after the last step.
        notes: description of each step in its file, or "".
        example: names of the examples in the protocol texts that it replays.
        side: graded side.
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
        """Folder of the case."""
        return self.id.partition("/")[0]
