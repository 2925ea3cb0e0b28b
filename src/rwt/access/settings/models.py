"""Tokens, roles, origins, TLS and what one client may have open."""

from __future__ import annotations

import hashlib
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
    HostGlobs,
    HostName,
    OriginGlobs,
    Seconds,
    SecondsOrNone,
    Table,
)
from rwt_protocol.limits import WIRE_LIMITS
from rwt_transports.limits import Limits


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

    connections_per_address: Annotated[
        CountOrNone,
        Field(
            description="open connections per remote address, plain HTTP and TLS handshakes included; 0: no"
            " limit"
        ),
    ] = _CONNECTION.connections_per_address
    subscriptions: Annotated[Count, Field(description="subscriptions per client")] = 1000
    advertisements: Annotated[
        Count, Field(description="topics, services and actions, together, that one client advertises")
    ] = 1000
    calls: Annotated[Count, Field(description="pending calls and goals per client")] = 10_000
    kept_bytes: Annotated[
        Bytes,
        Field(
            description="bytes kept for one client: pending requests, and samples of its latched topics,"
            " even after it disconnects; four times as many for all clients of one address"
        ),
    ] = 64 * MIB
    parameter_bytes: Annotated[
        Bytes,
        Field(
            description="bytes of parameters set by one client, until others set or delete them; twice as"
            " many for all clients of one address"
        ),
    ] = 2 * MIB
    work_per_second: Annotated[
        WorkRate,
        Field(
            description="CPU seconds per second that one client, or all clients of one remote address, may"
            " use on average, for messages with their consequences, pages and images. Beyond"
            " it, messages wait behind those of others, and pages are rejected; 0: no limit"
        ),
    ] = 0.5
    work_burst: Annotated[
        SecondsOrNone, Field(description="CPU seconds that a client may use at once before the rate applies")
    ] = 0.5
    messages_per_second: Annotated[
        CountOrNone,
        Field(description="messages per second that one client may send on average; 0: no limit"),
    ] = 0
    messages_burst: Annotated[
        Count, Field(description="messages that one client may send at once before the rate applies")
    ] = 20_000
    max_depth: Annotated[
        int,
        Field(ge=4, le=500, description="nesting depth of one message, including the message itself"),
    ] = WIRE_LIMITS.max_depth
    structure_bytes: Annotated[
        Bytes,
        Field(
            description="structure of one message: in CBOR and BSON, its bytes without long strings and"
            " typed arrays; in JSON, its brackets, unless the payload has every field of its"
            " type in the order of ROS"
        ),
    ] = WIRE_LIMITS.structure_bytes
    fragmented_messages: Annotated[Count, Field(description="incomplete fragmented messages per client")] = (
        WIRE_LIMITS.fragmented_messages
    )
    fragment_characters: Annotated[
        Count, Field(description="characters of all fragments of one client together")
    ] = WIRE_LIMITS.fragment_characters
    fragment_seconds: Annotated[
        Seconds, Field(description="seconds after the last fragment until an incomplete message is dropped")
    ] = WIRE_LIMITS.fragment_seconds
    outgoing_message_bytes: Annotated[
        Bytes,
        Field(
            description="largest message to a client; the call of a larger reply fails, a larger sample is"
            " dropped"
        ),
    ] = _CONNECTION.outgoing_bytes
    data_bytes: Annotated[
        Bytes,
        Field(
            description="bytes of samples queued for one client's connection, and as many for its"
            " throttles; beyond it, the oldest sample of the topic is dropped"
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
    """Bearer token, in plain text or as SHA-256, and its role."""

    token: Annotated[
        PlainToken | None,
        Field(description="the token: 16 to 256 of the characters A-Z a-z 0-9 - . _ ~"),
    ] = None
    sha256: Annotated[
        HashedToken | None,
        Field(description="SHA-256 of the token, 64 hex digits, instead of `token`"),
    ] = None
    role: Annotated[str, Field(description="role of clients with this token")]

    @model_validator(mode="after")
    def _exactly_one(self) -> TokenSettings:
        if (self.token is None) == (self.sha256 is None):
            raise ValueError("expected exactly one of `token` and `sha256`")
        return self

    @property
    def digest(self) -> bytes:
        """SHA-256 of the token."""
        if self.sha256 is not None:
            return bytes.fromhex(self.sha256.get_secret_value())
        plain = self.token.get_secret_value() if self.token else ""
        return hashlib.sha256(plain.encode()).digest()


class AuthSettings(Table):
    """Authentication. Without tokens and without a secret, every client gets `default_role`."""

    default_role: Annotated[
        str | None,
        Field(
            description="role of clients without credentials; not set: `admin` if neither tokens nor a"
            " secret are configured, otherwise such clients are rejected"
        ),
    ] = None
    rosauth_secret_file: Annotated[
        Path | None,
        Field(description="file whose first line is rosauth's secret of 16 characters"),
    ] = None
    rosauth_role: Annotated[
        str | None,
        Field(
            description="role of rosauth clients whose `level` names no role; not set: `admin` if no roles"
            " are configured, otherwise they are rejected"
        ),
    ] = None
    allowed_time_delta: Annotated[
        Seconds,
        Field(
            description="seconds by which the time of an `auth` message may differ from the server's clock"
        ),
    ] = 5.0
    seconds: Annotated[Seconds, Field(description="seconds within which a client must authenticate")] = 10.0
    tokens: Mapping[str, TokenSettings] = Field(
        default_factory=dict, description="bearer tokens, each under a name of its own"
    )

    @property
    def role_without_credentials(self) -> str | None:
        """Name of the role of clients without credentials; None if they are rejected."""
        is_open = not self.tokens and self.rosauth_secret_file is None
        return self.default_role or ("admin" if is_open else None)

    @model_validator(mode="after")
    def _tokens_differ(self) -> AuthSettings:
        names: dict[bytes, str] = {}
        for name, token in self.tokens.items():
            other = names.setdefault(token.digest, name)
            if other != name:
                raise ValueError(
                    f"`auth.tokens.{name}` and `auth.tokens.{other}` are the same token: expected two"
                )
        return self


class RoleSettings(Table):
    """Permissions of a role: globs of resolved names, in which `*` also matches `/`. All else is rejected."""

    read_only: Annotated[
        bool, Field(description="subscribe to every topic and read every parameter, nothing else")
    ] = False
    publish: Annotated[Globs, Field(description="topics to publish on")] = ()
    subscribe: Annotated[Globs, Field(description="topics to subscribe to")] = ()
    call: Annotated[Globs, Field(description="services to call; those of rosapi are always allowed")] = ()
    provide: Annotated[Globs, Field(description="services and actions to advertise")] = ()
    displace: Annotated[
        Globs,
        Field(
            description="names of `provide` that may replace the robot's own, which return when the client"
            " disconnects"
        ),
    ] = ()
    goals: Annotated[
        Globs,
        Field(description="actions to send goals to, including through their services and topics of ROS 2"),
    ] = ()
    get_param: Annotated[
        Globs, Field(description="parameters to read: `/node:name` on ROS 2, `/name` on ROS 1")
    ] = ()
    set_param: Annotated[Globs, Field(description="parameters to write and delete")] = ()


class OriginSettings(Table):
    """Web pages that may connect, and accepted host names. Requests without an origin are not checked."""

    allow: Annotated[
        OriginGlobs,
        Field(
            description="further origins that may connect, for example `https://ui.example.com` or"
            ' `https://*.example.com`; `"null"`: pages from files, and with them sandboxed'
            ' frames of every site; `"*"`: every page'
        ),
    ] = ()
    hosts: Annotated[
        HostGlobs,
        Field(
            description="accepted host names of this server, for example `robot.example.com`, beside those"
            " of this machine. Not set: no others on a loopback address, all elsewhere"
        ),
    ] = ()


class TlsSettings(Table):
    """Certificate of all encrypted listeners, such as `wss://`."""

    certfile: Annotated[Path | None, Field(description="PEM file with the certificate and its chain")] = None
    keyfile: Annotated[Path | None, Field(description="PEM file with the private key")] = None
    auto: Annotated[
        bool,
        Field(
            description="create a certificate with a local authority, which devices install once; needs the"
            " extra `tls`"
        ),
    ] = False
    folder: Annotated[
        Path | None,
        Field(description="folder of that authority; default: `rwt/tls` in the user's state folder"),
    ] = None
    names: Annotated[
        tuple[HostName, ...],
        Field(
            max_length=64,
            description="further names and addresses in the certificate, beside the private ones of this"
            " machine",
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
    """Limits, credentials, roles, origins and the gate."""

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
