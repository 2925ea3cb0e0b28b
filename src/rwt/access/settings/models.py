"""Tokens, roles, origins, TLS and what one client may have open."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Final

from pydantic import AfterValidator, Field, SecretStr, model_validator

from rwt.access.settings.gate import GateSettings
from rwt.access.settings.types import (
    MIB,
    Bytes,
    Count,
    CountOrNone,
    Globs,
    HostName,
    Seconds,
    SecondsOrNone,
    Table,
)
from rwt_protocol.limits import WIRE_LIMITS
from rwt_transports.limits import Limits


class SettingsError(ValueError):
    """A setting that cannot be used; the text says which, where it stands and what is expected."""


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
    """What one client may have open, send, and be sent."""

    connections_per_address: Annotated[
        CountOrNone,
        Field(
            description="open connections from one address that is not this machine's, those of plain HTTP"
            " and in TLS handshakes included; 0 for any number"
        ),
    ] = _CONNECTION.connections_per_address
    subscriptions: Annotated[Count, Field(description="subscriptions of one client")] = 1000
    advertisements: Annotated[
        Count, Field(description="topics, services and actions together that one client offers")
    ] = 1000
    calls: Annotated[Count, Field(description="calls and goals of one client under way at a time")] = 10_000
    kept_bytes: Annotated[
        Bytes,
        Field(
            description="bytes kept for one client: requests under way, and samples of its latched topics,"
            " also after it has left; clients of one address together four times as many"
        ),
    ] = 64 * MIB
    parameter_bytes: Annotated[
        Bytes,
        Field(
            description="bytes of parameters that one client may have set, until they are deleted or set by"
            " others; clients of one address together twice as many"
        ),
    ] = 2 * MIB
    work_per_second: Annotated[
        WorkRate,
        Field(
            description="seconds of one processor's work that a client may cause each second in the long run,"
            " and all clients of an address that is not this machine's: its messages with all that they set"
            " off, pages and pictures. Beyond it they wait behind the work for others, and pages are refused;"
            " 0 for any number"
        ),
    ] = 0.5
    work_burst: Annotated[
        SecondsOrNone, Field(description="seconds of work at once before their rate counts")
    ] = 0.5
    messages_per_second: Annotated[
        CountOrNone,
        Field(description="messages that one client may send each second in the long run; 0 for any number"),
    ] = 0
    messages_burst: Annotated[
        Count, Field(description="messages that one client may send at once before their rate counts")
    ] = 20_000
    max_depth: Annotated[
        int,
        Field(ge=4, le=500, description="objects and arrays open at once in one message, itself included"),
    ] = WIRE_LIMITS.max_depth
    structure_bytes: Annotated[
        Bytes,
        Field(
            description="bytes of one message in CBOR or BSON beside its long strings and typed arrays;"
            " brackets of one in JSON, unless its payload has every field of its type as ROS writes it"
        ),
    ] = WIRE_LIMITS.structure_bytes
    fragmented_messages: Annotated[
        Count, Field(description="messages of one client that may be in pieces at the same time")
    ] = WIRE_LIMITS.fragmented_messages
    fragment_characters: Annotated[
        Count, Field(description="characters of all pieces of one client together")
    ] = WIRE_LIMITS.fragment_characters
    fragment_seconds: Annotated[
        Seconds, Field(description="time after the last piece until the others are forgotten")
    ] = WIRE_LIMITS.fragment_seconds
    outgoing_message_bytes: Annotated[
        Bytes,
        Field(description="largest message to a client; a larger reply fails its call, a sample is dropped"),
    ] = _CONNECTION.outgoing_bytes
    data_bytes: Annotated[
        Bytes,
        Field(
            description="samples queued for one client behind its connection, and as many again behind its"
            " throttles; beyond it the oldest of the topic is dropped"
        ),
    ] = _CONNECTION.data_bytes


_TOKEN: Final = re.compile(r"[A-Za-z0-9._~-]{16,256}")
_SHA256: Final = re.compile(r"[0-9A-Fa-f]{64}")


def _written_as(pattern: re.Pattern[str], expected: str) -> AfterValidator:
    """Validate the spelling of a secret without quoting it."""

    def check(secret: SecretStr) -> SecretStr:
        if pattern.fullmatch(secret.get_secret_value()) is None:
            raise ValueError(f"expected {expected}")
        return secret

    return AfterValidator(check)


PlainToken = Annotated[SecretStr, _written_as(_TOKEN, "16 to 256 of the characters A-Z a-z 0-9 - . _ ~")]
HashedToken = Annotated[SecretStr, _written_as(_SHA256, "64 hex digits")]


class TokenSettings(Table):
    """A bearer token, in plain or as its SHA-256, and the role that it gives."""

    token: Annotated[
        PlainToken | None,
        Field(description="the token itself: 16 to 256 of the characters A-Z a-z 0-9 - . _ ~"),
    ] = None
    sha256: Annotated[
        HashedToken | None,
        Field(description="the SHA-256 of the token, 64 hex digits, in place of it"),
    ] = None
    role: Annotated[str, Field(description="the role of whoever shows it")]

    @model_validator(mode="after")
    def _exactly_one(self) -> TokenSettings:
        if (self.token is None) == (self.sha256 is None):
            raise ValueError("expected exactly one of `token` and `sha256`")
        return self


class AuthSettings(Table):
    """Who may come in, and as what. With no tokens and no secret everybody may, as `default_role`."""

    default_role: Annotated[
        str | None,
        Field(
            description="role of a client without credentials; not set: `admin` if there are neither tokens"
            " nor a secret, else nobody comes in without"
        ),
    ] = None
    rosauth_secret_file: Annotated[
        Path | None,
        Field(description="file whose first line is the 16 characters of the secret that rosauth shares"),
    ] = None
    rosauth_role: Annotated[
        str | None,
        Field(
            description="role of a client that rosauth vouches for with a `level` that names no role; not"
            " set: `admin` if no roles are configured, else it is refused"
        ),
    ] = None
    allowed_time_delta: Annotated[
        Seconds,
        Field(description="seconds by which the time in an `auth` may differ from this machine's clock"),
    ] = 5.0
    seconds: Annotated[
        Seconds, Field(description="time in which a client that must authenticate has to do it")
    ] = 10.0
    tokens: Mapping[str, TokenSettings] = Field(
        default_factory=dict, description="bearer tokens, each under a name of its own"
    )


class RoleSettings(Table):
    """What a role may do: globs of resolved names, in which `*` also matches `/`; the rest is refused."""

    read_only: Annotated[
        bool, Field(description="may subscribe to every topic and read every parameter, and nothing else")
    ] = False
    publish: Annotated[Globs, Field(description="topics to publish on")] = ()
    subscribe: Annotated[Globs, Field(description="topics to subscribe to")] = ()
    call: Annotated[Globs, Field(description="services to call; those of rosapi are always open")] = ()
    provide: Annotated[Globs, Field(description="services and actions to offer")] = ()
    displace: Annotated[
        Globs,
        Field(
            description="those of `provide` that may also be offered in the place of the robot's own, which"
            " come back when the client leaves"
        ),
    ] = ()
    goals: Annotated[
        Globs, Field(description="actions to send goals to, over their services and topics of ROS 2 too")
    ] = ()
    get_param: Annotated[
        Globs, Field(description="parameters to read: `/node:name` on ROS 2, `/name` on ROS 1")
    ] = ()
    set_param: Annotated[Globs, Field(description="parameters to write and delete")] = ()


class OriginSettings(Table):
    """Which web pages may connect, and by which names. Programs that send no origin are not asked for one."""

    allow: Annotated[
        Globs,
        Field(
            description="origins that may connect besides the default ones, for example"
            ' `https://ui.example.com` or `https://*.example.com`; `"null"` for pages from files, which lets'
            ' in sandboxed frames of every site; `"*"` lets every page in'
        ),
    ] = ()
    hosts: Annotated[
        Globs,
        Field(
            description="names by which this server may be addressed over HTTP and WebSocket, for example"
            " `robot.example.com`; those of this machine always are. Not set: on a loopback address no other,"
            " elsewhere every name"
        ),
    ] = ()


class TlsSettings(Table):
    """The certificate of `wss://` and of every other encrypted listener."""

    certfile: Annotated[
        Path | None, Field(description="PEM file with the certificate and those that vouch for it")
    ] = None
    keyfile: Annotated[Path | None, Field(description="PEM file with the private key")] = None
    auto: Annotated[
        bool,
        Field(
            description="whether the server makes its certificate itself, with a small authority that devices"
            " are given once; needs the extra `tls`"
        ),
    ] = False
    folder: Annotated[
        Path | None,
        Field(description="where that is kept; by default `rwt/tls` in the user's folder for state"),
    ] = None
    names: Annotated[
        tuple[HostName, ...],
        Field(
            max_length=64,
            description="names and addresses that it vouches for, besides the private ones of this machine",
        ),
    ] = ()

    @model_validator(mode="after")
    def _both(self) -> TlsSettings:
        if (self.certfile is None) != (self.keyfile is None):
            raise ValueError("expected `certfile` and `keyfile` together")
        if self.auto and self.certfile is not None:
            raise ValueError("expected either `auto`, or `certfile` and `keyfile`")
        return self


BUILT_IN_ROLES: Final[Mapping[str, RoleSettings]] = MappingProxyType(
    {
        "admin": RoleSettings(
            publish=("*",),
            subscribe=("*",),
            call=("*",),
            provide=("*",),
            displace=("*",),
            goals=("*",),
            get_param=("*",),
            set_param=("*",),
        ),
        "viewer": RoleSettings(read_only=True),
    }
)
"""Roles that are there without being configured; a configured one of the same name takes their place."""


class AccessSettings(Table):
    """Who may come in, and what each role may do."""

    limits: ClientLimits = ClientLimits()
    auth: AuthSettings = AuthSettings()
    roles: Mapping[str, RoleSettings] = Field(
        default_factory=dict, description="roles besides the built-in `admin` and `viewer`"
    )
    origins: OriginSettings = OriginSettings()
    gate: GateSettings = GateSettings()

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
