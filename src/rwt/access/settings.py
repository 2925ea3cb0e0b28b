"""Settings of access control: the models alone."""

from __future__ import annotations

import hashlib
import ipaddress
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    SecretStr,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticKnownError

from rwt_protocol.error_text import plain_type
from rwt_protocol.limits import WIRE_LIMITS
from rwt_transports.limits import Limits

MIB: Final = 1024 * 1024

#: Beyond what any machine has. Within it sums and products of settings stay exact in a float, and neither a
#: timer of an event loop nor a counter of a library overflows.
_MOST_BYTES: Final = 1 << 40
_MOST: Final = 1_000_000_000

Bytes = Annotated[int, Field(ge=1024, le=_MOST_BYTES)]
Count = Annotated[int, Field(ge=1, le=_MOST)]
CountOrNone = Annotated[int, Field(ge=0, le=_MOST)]
Seconds = Annotated[float, Field(ge=0.001, le=_MOST, allow_inf_nan=False)]
SecondsOrNone = Annotated[float, Field(ge=0, le=_MOST, allow_inf_nan=False)]
Globs = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class NamesOf:
    """Metadata of a setting whose globs are for names of the robot, which should match one.

    Attributes:
        kinds: `topic`, `service` and `action`; one of them is enough.
    """

    kinds: tuple[Literal["topic", "service", "action"], ...]


TopicGlobs = Annotated[Globs, NamesOf(("topic",))]
ServiceGlobs = Annotated[Globs, NamesOf(("service",))]
ActionGlobs = Annotated[Globs, NamesOf(("action",))]

_LABEL: Final = r"[A-Za-z0-9](?:[A-Za-z0-9-]{0,61}[A-Za-z0-9])?"
_HOST_NAME: Final = re.compile(rf"{_LABEL}(?:\.{_LABEL})*")


def is_host_name(text: str) -> bool:
    """Return True if a text is a DNS name (RFC 1123 section 2.1); IPv4 addresses look like one."""
    return len(text) <= 253 and _HOST_NAME.fullmatch(text) is not None


def _check_host(text: str) -> str:
    with suppress(ValueError):
        return str(ipaddress.ip_address(text))
    if not is_host_name(text):
        raise ValueError(f"{text!r} is no name or address of a host: expected one such as robot.example.org")
    return text.lower()


def _check_host_glob(text: str) -> str:
    if not is_host_name(re.sub(r"[*?]", "a", text)):
        with suppress(ValueError):
            return str(ipaddress.ip_address(text))
        raise ValueError(
            f"{text!r} is no name of a host: expected one without scheme and port, for example"
            " robot.example.org or *.example.org"
        )
    return text


_ORIGIN: Final = re.compile(
    r"[a-z*][a-z0-9+.*-]*://(?P<host>\[[0-9a-f:.]+\]|[^\s/:?#@\[\]]+)(?::(?:\d{1,5}|\*))?/?", re.IGNORECASE
)


def _check_origin_glob(text: str) -> str:
    if text in ("*", "null", "file://"):
        return text
    found = _ORIGIN.fullmatch(text)
    if found is None:
        raise ValueError(f'{text!r} is no origin: expected one such as https://ui.example.org, or "null"')
    if not found["host"].startswith("["):
        _check_host_glob(found["host"])
    return text


HostGlobs = tuple[Annotated[str, AfterValidator(_check_host_glob)], ...]
"""Names of hosts, in which `*` stands for any characters, and addresses."""

OriginGlobs = tuple[Annotated[str, AfterValidator(_check_origin_glob)], ...]
"""Origins of web pages, in which `*` stands for any characters."""

HostName = Annotated[str, AfterValidator(_check_host)]
"""A name in lower case, or an address in its shortest form."""


#: Types of plain values, with the error of pydantic for others. TOML has these types; nothing is converted.
_PLAIN: Final[Mapping[object, tuple[tuple[type, ...], Literal["bool_type", "int_type", "float_type"]]]] = {
    bool: ((bool,), "bool_type"),
    int: ((int,), "int_type"),
    float: ((int, float), "float_type"),
}


class Table(BaseModel):
    """A group of settings: one table of the TOML file."""

    # Built on first use: building all models would be a tenth of the time of `from rwt import Server`.
    # The default of a field that is a table is made by `model_construct`, which needs no built model.
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _may_be_switched(cls, value: object) -> object:
        """Accept a boolean for a table that can be enabled: `webrtc=True`, as `demo=True`."""
        return {"enabled": value} if isinstance(value, bool) and "enabled" in cls.model_fields else value

    @field_validator("*", mode="before")
    @classmethod
    def _has_the_type(cls, value: object, info: ValidationInfo) -> object:
        """Reject values that pydantic would convert, such as "yes" for a boolean."""
        field = cls.model_fields[str(info.field_name)]
        plain = _PLAIN.get(plain_type(field.annotation))
        if plain is None or (value is None and field.default is None):
            return value
        types, error = plain
        if not isinstance(value, types) or (isinstance(value, bool) and bool not in types):
            raise PydanticKnownError(error)
        return value


_PART: Final = r"[A-Za-z][A-Za-z0-9_]*(?:\[[0-9]{0,4}\])?"
_PATH: Final = re.compile(rf"{_PART}(?:\.{_PART})*")


def _field_path(path: str) -> str:
    if _PATH.fullmatch(path) is None:
        raise ValueError(
            f"expected the way to a field, as `linear.x` or `points[].positions[]`, got {path!r}"
        )
    return path


FieldPath = Annotated[str, AfterValidator(_field_path)]
"""Path to a field of a message, as `points[].x`: `[]` selects all items of a list, `[2]` the third."""

Number = Annotated[float, Field(allow_inf_nan=False)]
LeaseSeconds = Annotated[float, Field(ge=0.05, le=60.0)]
RepeatSeconds = Annotated[float, Field(ge=0.0, le=60.0)]
ApprovalSeconds = Annotated[float, Field(ge=1.0, le=3600.0)]
RememberSeconds = Annotated[float, Field(ge=0.0, le=86_400.0)]


class LeaseSettings(Table):
    """One client at a time may publish on the topics of the rule, as long as its messages continue."""

    seconds: LeaseSeconds = Field(
        0.5, description="seconds of silence after which the holder's robot is stopped and the lease is free"
    )
    take: Literal["publish", "service"] = Field(
        "publish", description="how to take a free lease: by publishing, or only by `/gate/take_lease`"
    )
    precedence: tuple[str, ...] = Field(
        (),
        description="roles in order of precedence: each may take the lease from those after it; roles not"
        " listed come last",
    )
    max_age: LeaseSeconds | None = Field(
        None,
        description="largest age of a command by the stamp of its header, in seconds; the clocks of clients"
        " and server must be synchronised; not set: delays are relative to the client's fastest command",
    )


class StopMessageSettings(Table):
    """Message published by the gate to stop the robot."""

    message: Mapping[str, object] = Field(
        default_factory=dict,
        description="field values; omitted fields have their defaults (zero for a velocity)",
    )
    repeat_seconds: RepeatSeconds = Field(
        1.0, description="seconds for which the message is repeated; choose more than the robot's own timeout"
    )


class FieldLimit(Table):
    """Limits for the value of a field."""

    min: Number | None = Field(None, description="minimum")
    max: Number | None = Field(None, description="maximum")
    rate: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = Field(
        None,
        description="largest change per second away from the value of the stop message, on topics; towards"
        " that value there is no limit",
    )
    rate_from: Literal["stop", "last"] = Field(
        "stop",
        description="`last`: `rate` limits changes of the last value in both directions, as for positions;"
        " the first value after a stop is not limited",
    )
    one_of: tuple[str, ...] = Field((), description="accepted strings, such as frame ids")
    beyond: Literal["refuse", "clamp"] = Field(
        "refuse", description="reject a value out of range, or clamp it"
    )

    @model_validator(mode="after")
    def _limits_something(self) -> FieldLimit:
        has_number = self.min is not None or self.max is not None or self.rate is not None
        if not has_number and not self.one_of:
            raise ValueError("expected one of `min`, `max`, `rate` and `one_of`")
        if has_number and self.one_of:
            raise ValueError("`one_of` is for texts: expected it without `min`, `max` and `rate`")
        if self.one_of and self.beyond == "clamp":
            raise ValueError('a text cannot be brought within `one_of`: expected `beyond = "refuse"`')
        if self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError(f"`min` is {self.min:g}, and expected at most `max`, {self.max:g}")
        return self


class ApprovalSettings(Table):
    """Approval by a person before each request, with another token than the requester's."""

    roles: Globs = Field(
        description="roles that may approve, with a token of `auth.tokens`; `[]`: only the robot's own"
        " programs"
    )
    seconds: ApprovalSeconds = Field(
        60.0, description="seconds to approve; after them the request is rejected"
    )
    remember_seconds: RememberSeconds = Field(
        0.0,
        description="longest time in seconds that one approval may cover; 0: each approval is for one"
        " request",
    )


class GateRule(Table):
    """Rule for the names that the globs match. If several rules match, all apply."""

    topics: TopicGlobs = Field((), description="topics that clients publish on")
    type: str | None = Field(
        None,
        description="message type of `topics`; not set: that of the robot's programs, before which only"
        " roles that may do everything can advertise them",
    )
    services: ServiceGlobs = Field((), description="services that clients call")
    actions: ActionGlobs = Field((), description="actions that clients send goals to")
    parameters: Globs = Field(
        (), description="parameters that clients set: `/node:name` on ROS 2, `/name` on ROS 1"
    )
    roles: Globs = Field(("*",), description="roles to which the rule applies")
    emergency: bool = Field(False, description="stopped and rejected by the emergency stop")
    lease: LeaseSettings | None = None
    stop: StopMessageSettings | None = None
    fields: Mapping[FieldPath, FieldLimit] = Field(
        default_factory=dict,
        description="limits of fields of the message, the request or the goal, each under its path",
    )
    finite: bool = Field(True, description="reject NaN and infinity")
    largest_bytes: CountOrNone = Field(
        0, description="largest message, request or goal in bytes; 0: no limit"
    )
    largest_items: Count = Field(
        10_000,
        description="items in all lists of the largest message whose fields or numbers are checked, and 32"
        " times as many bytes: checking them holds the event loop",
    )
    messages_per_second: CountOrNone = Field(
        0, description="messages per second on each topic, of all clients together; 0: no limit"
    )
    approval: ApprovalSettings | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> GateRule:
        if not (self.topics or self.services or self.actions or self.parameters):
            raise ValueError("expected one of `topics`, `services`, `actions` and `parameters`")
        if not self.topics:
            for name in ("type", "lease", "stop", "messages_per_second"):
                if getattr(self, name):
                    raise ValueError(f"`{name}` is about topics: expected `topics`")
            if any(limit.rate is not None for limit in self.fields.values()):
                raise ValueError("`rate` is about topics: expected `topics`")
        if self.fields and not (self.topics or self.services or self.actions):
            raise ValueError("`fields` are those of messages: expected `topics`, `services` or `actions`")
        if self.topics and self.stop is None and (self.lease or self.emergency):
            raise ValueError(
                "`lease` and `emergency` need a stop message for `topics`: expected `stop`, as `stop = {}`"
            )
        return self


class EmergencySettings(Table):
    """Emergency stop: roles that may stop, and release."""

    stop_roles: Globs = Field(("*",), description="roles that may stop the robot")
    release_roles: Globs = Field(("admin",), description="roles that may release the stop")
    at_start: bool = Field(False, description="start stopped, until the stop is released")


class AuditSettings(Table):
    """Audit log: one JSON object per line, read by `rwt audit`."""

    file: Path | None = Field(
        None,
        description="file of security events, for example `audit.jsonl`; allowed requests are written to"
        " `audit.traffic.jsonl` beside it; not set: no file",
    )
    stdout: bool = Field(
        False, description="also write the lines to standard output, for example for journald"
    )
    file_bytes: Bytes = Field(10 * MIB, description="size in bytes at which a new file is started")
    file_days: float = Field(
        0.0, ge=0, le=36_500, description="age in days at which a new file is started; 0: by size only"
    )
    files: Annotated[Count, Field(le=1000)] = Field(
        5, description="files to keep of each kind; the newest has no number, older ones are deleted"
    )
    queue_bytes: Bytes = Field(
        MIB, description="bytes queued for the disk; beyond it, lines are dropped and counted"
    )

    @property
    def is_on(self) -> bool:
        """True if lines are written."""
        return self.file is not None or self.stdout


class GateSettings(Table):
    """Rules that requests of clients must pass. The gate is software, not a safety function."""

    mode: Literal["enforce", "observe"] = Field(
        "enforce", description="`observe` only logs what would be rejected"
    )
    rules: Mapping[str, GateRule] = Field(
        default_factory=dict, description="what clients have to keep to, each rule under a name of its own"
    )
    require: Globs = Field(
        (),
        description="topics, services and actions that a rule has to guard: commands on others of these are"
        ' rejected, for example `["/cmd_vel"]`',
    )
    emergency: EmergencySettings = EmergencySettings.model_construct()
    audit: AuditSettings = AuditSettings.model_construct()

    @property
    def is_on(self) -> bool:
        """True if requests of clients are checked or recorded."""
        return bool(self.rules or self.require) or self.audit.is_on

    def named_roles(self) -> Iterator[tuple[str, str]]:
        """The roles that rules name, by the key of the setting, without those that are globs."""
        globs = [
            ("gate.emergency.stop_roles", self.emergency.stop_roles),
            ("gate.emergency.release_roles", self.emergency.release_roles),
        ]
        for name, rule in self.rules.items():
            globs.append((f"gate.rules.{name}.roles", rule.roles))
            if rule.lease is not None:
                globs.append((f"gate.rules.{name}.lease.precedence", rule.lease.precedence))
            if rule.approval is not None:
                globs.append((f"gate.rules.{name}.approval.roles", rule.approval.roles))
        for key, roles in globs:
            for role in roles:
                if not re.search(r"[*?\[]", role):
                    yield key, role


class SettingsError(ValueError):
    """A setting that cannot be used; the text says which, where it stands and what is expected.

    Attributes:
        key: path of the setting; empty if it is not known.
    """

    def __init__(self, text: str, key: tuple[str, ...] = ()) -> None:
        super().__init__(text)
        self.key = key


def _check_rate(seconds: float) -> float:
    if 0 < seconds < _LEAST_RATE:
        raise ValueError(f"expected 0 or at least {_LEAST_RATE:g}, got {seconds:g}")
    return seconds


_LEAST_RATE: Final = 0.001
"""Minimum rate of work; a client with less could not be served."""

WorkRate = Annotated[float, Field(ge=0, le=1000, allow_inf_nan=False), AfterValidator(_check_rate)]
"""Seconds of work each second; 0 for any."""


LINGER_SECONDS: Final = 10.0
"""Default time that a topic outlives its last publisher among the clients (`unregister_timeout`)."""

CALL_SECONDS: Final = 5.0
"""Default time that a service call may take (`default_call_service_timeout`)."""


_CONNECTION: Final = Limits()


class ClientLimits(Table):
    """Limits of one client: open resources, messages received and sent."""

    connections_per_address: CountOrNone = Field(
        _CONNECTION.connections_per_address,
        description="open connections per remote address, plain HTTP and TLS handshakes included; 0: no"
        " limit",
    )
    subscriptions: Count = Field(1000, description="subscriptions per client")
    advertisements: Count = Field(
        1000, description="topics, services and actions, together, that one client advertises"
    )
    calls: Count = Field(10_000, description="pending calls and goals per client")
    kept_bytes: Bytes = Field(
        64 * MIB,
        description="bytes kept for one client: pending requests, and samples of its latched topics, even"
        " after it disconnects; four times as many for all clients of one address",
    )
    parameter_bytes: Bytes = Field(
        2 * MIB,
        description="bytes of parameters set by one client, until others set or delete them; twice as many"
        " for all clients of one address",
    )
    work_per_second: WorkRate = Field(
        0.5,
        description="CPU seconds per second that one client, or all clients of one remote address, may use"
        " on average, for messages with their consequences, pages and images. Beyond it, messages wait"
        " behind those of others, and pages are rejected; 0: no limit",
    )
    work_burst: SecondsOrNone = Field(
        0.5, description="CPU seconds that a client may use at once before the rate applies"
    )
    messages_per_second: CountOrNone = Field(
        0, description="messages per second that one client may send on average; 0: no limit"
    )
    messages_burst: Count = Field(
        20_000, description="messages that one client may send at once before the rate applies"
    )
    max_depth: int = Field(
        WIRE_LIMITS.max_depth,
        ge=4,
        le=500,
        description="nesting depth of one message, including the message itself",
    )
    structure_bytes: Bytes = Field(
        WIRE_LIMITS.structure_bytes,
        description="structure of one message: in CBOR and BSON, its bytes without long strings and typed"
        " arrays; in JSON, its brackets, unless the payload has every field of its type in the order of ROS",
    )
    fragmented_messages: Count = Field(
        WIRE_LIMITS.fragmented_messages, description="incomplete fragmented messages per client"
    )
    fragment_characters: Count = Field(
        WIRE_LIMITS.fragment_characters, description="characters of all fragments of one client together"
    )
    fragment_seconds: Seconds = Field(
        WIRE_LIMITS.fragment_seconds,
        description="seconds after the last fragment until an incomplete message is dropped",
    )
    outgoing_message_bytes: Bytes = Field(
        _CONNECTION.outgoing_bytes,
        description="largest message to a client; the call of a larger reply fails, a larger sample is"
        " dropped",
    )
    data_bytes: Bytes = Field(
        _CONNECTION.data_bytes,
        description="bytes of samples queued for one client's connection, and as many for its throttles;"
        " beyond it, the oldest sample of the topic is dropped",
    )


TOKEN: Final = re.compile(r"[A-Za-z0-9._~-]{16,256}")
"""Spelling of a token."""
_SHA256: Final = re.compile(r"[0-9A-Fa-f]{64}")


def _written_as(pattern: re.Pattern[str], expected: str) -> AfterValidator:
    """Validate the spelling of a secret without quoting it."""

    def check(secret: SecretStr) -> SecretStr:
        if pattern.fullmatch(secret.get_secret_value()) is None:
            raise ValueError(f"expected {expected}")
        return secret

    return AfterValidator(check)


PlainToken = Annotated[SecretStr, _written_as(TOKEN, "16 to 256 of the characters A-Z a-z 0-9 - . _ ~")]
HashedToken = Annotated[SecretStr, _written_as(_SHA256, "64 hex digits")]


class TokenSettings(Table):
    """Bearer token, in plain text, in a file or as SHA-256, and its role."""

    token: PlainToken | None = Field(
        None, description="the token: 16 to 256 of the characters A-Z a-z 0-9 - . _ ~"
    )
    sha256: HashedToken | None = Field(
        None, description="SHA-256 of the token, 64 hex digits, instead of `token`"
    )
    token_file: Path | None = Field(
        None, description="file whose first line is the token, instead of `token`; a reload reads it again"
    )
    role: str = Field(description="role of clients with this token")

    @model_validator(mode="after")
    def _exactly_one(self) -> TokenSettings:
        if sum(each is not None for each in (self.token, self.sha256, self.token_file)) != 1:
            raise ValueError("expected exactly one of `token`, `token_file` and `sha256`")
        return self

    @property
    def digest(self) -> bytes | None:
        """SHA-256 of the token; None if it is in a file."""
        if self.sha256 is not None:
            return bytes.fromhex(self.sha256.get_secret_value())
        return None if self.token is None else digest_of(self.token.get_secret_value())


def digest_of(token: str) -> bytes:
    """Return the SHA-256 of a token."""
    return hashlib.sha256(token.encode("utf-8", "surrogatepass")).digest()


def check_tokens_differ(digests: Mapping[str, bytes]) -> None:
    """Raise ValueError if two tokens, by name, are the same."""
    names: dict[bytes, str] = {}
    for name, digest in digests.items():
        if (other := names.setdefault(digest, name)) != name:
            raise ValueError(
                f"`auth.tokens.{name}` and `auth.tokens.{other}` are the same token: expected two"
            )


class AuthSettings(Table):
    """Authentication. Without tokens and without a secret, every client gets `default_role`."""

    default_role: str | None = Field(
        None,
        description="role of clients without credentials; not set: `admin` if neither tokens nor a secret"
        " are configured, otherwise such clients are rejected",
    )
    rosauth_secret_file: Path | None = Field(
        None, description="file whose first line is rosauth's secret of 16 characters"
    )
    rosauth_role: str | None = Field(
        None,
        description="role of rosauth clients whose `level` names no role; not set: they are rejected",
    )
    rosauth_end_seconds: Seconds = Field(
        86_400.0, description="seconds by which the `end` of an `auth` message may lie after its time"
    )
    allowed_time_delta: Seconds = Field(
        5.0, description="seconds by which the time of an `auth` message may differ from the server's clock"
    )
    seconds: Seconds = Field(10.0, description="seconds within which a client must authenticate")
    message_bytes: Bytes = Field(
        4096,
        description="largest message, or body of a request, of a client that has not authenticated; not used"
        " if clients need no credentials",
    )
    tokens: Mapping[str, TokenSettings] = Field(
        default_factory=dict, description="bearer tokens, each under a name of its own"
    )

    @property
    def is_open(self) -> bool:
        """True if every client is `admin`, because no setting says otherwise."""
        return not (self.tokens or self.rosauth_secret_file or self.default_role)

    @property
    def role_without_credentials(self) -> str | None:
        """Name of the role of clients without credentials; None if they are rejected."""
        return "admin" if self.is_open else self.default_role

    @model_validator(mode="after")
    def _tokens_differ(self) -> AuthSettings:
        check_tokens_differ({name: each.digest for name, each in self.tokens.items() if each.digest})
        return self


class RoleSettings(Table):
    """Permissions of a role: globs of resolved names, in which `*` also matches `/`. All else is rejected."""

    read_only: bool = Field(
        False, description="subscribe to every topic and read every parameter, nothing else"
    )
    publish: TopicGlobs = Field((), description="topics to publish on")
    subscribe: TopicGlobs = Field((), description="topics to subscribe to")
    call: ServiceGlobs = Field((), description="services to call; those of rosapi are always allowed")
    provide: Globs = Field((), description="services and actions to advertise")
    displace: Globs = Field(
        (),
        description="names of `provide` that may replace the robot's own, which return when the client"
        " disconnects",
    )
    goals: ActionGlobs = Field(
        (), description="actions to send goals to, including through their services and topics of ROS 2"
    )
    get_param: Globs = Field((), description="parameters to read: `/node:name` on ROS 2, `/name` on ROS 1")
    set_param: Globs = Field((), description="parameters to write and delete")


class OriginSettings(Table):
    """Web pages that may connect, and accepted host names. Programs name no page, and are not checked."""

    allow: OriginGlobs = Field(
        (),
        description="further origins that may connect, for example `https://ui.example.com` or"
        ' `https://*.example.com`; `"null"`: pages from files, and with them sandboxed frames of every'
        ' site; `"*"`: every page',
    )
    hosts: HostGlobs = Field(
        (),
        description="accepted host names of this server, for example `robot.example.com`, beside those of"
        " this machine. Not set: no others on a loopback address, all elsewhere",
    )


class TlsSettings(Table):
    """Certificate of all encrypted listeners, such as `wss://`."""

    certfile: Path | None = Field(None, description="PEM file with the certificate and its chain")
    keyfile: Path | None = Field(None, description="PEM file with the private key")
    auto: bool = Field(
        False,
        description="create a certificate with a local authority, which devices install once; needs the"
        " extra `tls`",
    )
    folder: Path | None = Field(
        None, description="folder of that authority; default: `rwt/tls` in the user's state folder"
    )
    names: tuple[HostName, ...] = Field(
        (),
        max_length=64,
        description="further names and addresses in the certificate, beside the private ones of this machine",
    )

    @model_validator(mode="after")
    def _both(self) -> TlsSettings:
        if (self.certfile is None) != (self.keyfile is None):
            raise ValueError("expected `certfile` and `keyfile` together")
        if self.auto and self.certfile is not None:
            raise ValueError("expected either `auto`, or `certfile` and `keyfile`")
        return self


#: Globs of a role that may do everything.
_EVERYTHING: Final[dict[str, Any]] = dict.fromkeys(set(RoleSettings.model_fields) - {"read_only"}, ("*",))

BUILT_IN_ROLES: Final[Mapping[str, RoleSettings]] = MappingProxyType(
    {
        "admin": RoleSettings.model_construct(**_EVERYTHING),
        "viewer": RoleSettings.model_construct(read_only=True),
    }
)
"""Roles that are there without being configured; a configured one of the same name takes their place."""


def _fits(globs: Globs, role: str) -> bool:
    return any(fnmatchcase(role, glob) for glob in globs)


class AccessSettings(Table):
    """Limits, credentials, roles, origins and the gate."""

    limits: ClientLimits = ClientLimits.model_construct()
    auth: AuthSettings = AuthSettings.model_construct()
    roles: Mapping[str, RoleSettings] = Field(
        default_factory=dict, description="roles besides the built-in `admin` and `viewer`"
    )
    origins: OriginSettings = OriginSettings.model_construct()
    gate: GateSettings = GateSettings.model_construct()

    def unanswered_rules(self, asked: Iterable[str] = ()) -> Iterator[str]:
        """Yield the names of rules with an approval that no client can give.

        Args:
            asked: roles of clients whose users are asked, and therefore need no other token.
        """
        auth = self.auth
        others = len(auth.tokens) > 1 or auth.role_without_credentials or auth.rosauth_secret_file
        for name, rule in self.gate.rules.items():
            roles = () if rule.approval is None else rule.approval.roles
            with_token = any(_fits(roles, token.role) for token in auth.tokens.values())
            if roles and not (with_token and others) and not any(_fits(roles, role) for role in asked):
                yield name

    @model_validator(mode="after")
    def _roles_exist(self) -> AccessSettings:
        auth = self.auth
        named = {"auth.default_role": auth.default_role, "auth.rosauth_role": auth.rosauth_role}
        named |= {f"auth.tokens.{name}.role": token.role for name, token in auth.tokens.items()}
        named |= dict(self.gate.named_roles())
        known = (*BUILT_IN_ROLES, *self.roles)
        for key, role in named.items():
            if role is not None and role not in known:
                raise ValueError(f"`{key}`: there is no role {role!r}; known are {', '.join(known)}")
        return self
