"""What an operator can set, with its defaults: the models alone. `rwt.settings.sources` reads them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Final, Literal, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, SecretStr, model_validator

MIB: Final = 1024 * 1024

Bytes = Annotated[int, Field(ge=1024)]
Count = Annotated[int, Field(ge=1)]
CountOrNone = Annotated[int, Field(ge=0)]
Seconds = Annotated[float, Field(gt=0, allow_inf_nan=False)]
SecondsOrNone = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Globs = tuple[str, ...]
NodeName = Literal["rosapi", "tf2_web_republisher", "web_video_server"]


class SettingsError(ValueError):
    """A setting that cannot be used; the text says which, where it stands and what is expected."""


class Table(BaseModel):
    """A group of settings: one table of the TOML file."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class LimitSettings(Table):
    """What one client, or all of them together, may take. Whoever is refused hears the setting's name."""

    connections: Annotated[
        Count, Field(description="open connections of one listener, plain HTTP included")
    ] = 1024
    connections_per_address: Annotated[
        CountOrNone,
        Field(description="open connections from one address that is not this machine's; 0 for any number"),
    ] = 128
    subscriptions: Annotated[Count, Field(description="subscriptions of one client")] = 1000
    advertisements: Annotated[
        Count, Field(description="topics, services and actions together that one client offers")
    ] = 1000
    calls: Annotated[Count, Field(description="calls and goals of one client under way at a time")] = 10_000
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
    ] = 100
    fragmented_messages: Annotated[
        Count, Field(description="messages of one client that may be in pieces at the same time")
    ] = 16
    fragment_characters: Annotated[
        Count, Field(description="characters of all pieces of one client together")
    ] = 10_000_000
    fragment_seconds: Annotated[
        Seconds, Field(description="time after the last piece until the others are forgotten")
    ] = 600.0
    outgoing_message_bytes: Annotated[
        Bytes,
        Field(description="largest message to a client; a larger reply fails its call, a sample is dropped"),
    ] = 256 * MIB
    handshake_seconds: Annotated[
        Seconds, Field(description="from connecting to the end of the HTTP request")
    ] = 10.0
    idle_http_seconds: Annotated[
        Seconds, Field(description="how long a kept-alive HTTP connection may wait between two requests")
    ] = 60.0
    ping_seconds: Annotated[
        SecondsOrNone, Field(description="silence after which a client is pinged; 0 never pings")
    ] = 20.0
    pong_seconds: Annotated[
        Seconds, Field(description="further silence after which a client counts as gone")
    ] = 40.0
    idle_peer_seconds: Annotated[
        Seconds, Field(description="silence after which a client over UDP is forgotten")
    ] = 60.0
    close_seconds: Annotated[Seconds, Field(description="how long a closing connection may take")] = 2.0
    video_viewers: Annotated[
        Count, Field(description="streams and snapshots of pictures that are looked at at a time")
    ] = 100
    video_encoders: Annotated[
        Count, Field(description="different streams of pictures at a time; equal ones share an encoder")
    ] = 16
    data_bytes: Annotated[
        Bytes,
        Field(description="samples queued for one client; beyond it the oldest of the topic is dropped"),
    ] = 8 * MIB
    data_frames: Annotated[Count, Field(description="the same bound as a number of messages")] = 10_000
    control_bytes: Annotated[
        Bytes, Field(description="replies queued for one client; beyond it the client is disconnected")
    ] = 64 * MIB
    control_frames: Annotated[Count, Field(description="the same bound as a number of messages")] = 100_000


_TOKEN: Final = re.compile(r"[A-Za-z0-9._~-]{16,256}")
_SHA256: Final = re.compile(r"[0-9A-Fa-f]{64}")


def _written_as(pattern: re.Pattern[str], expected: str) -> AfterValidator:
    """Checks a secret without ever quoting it."""

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
    goals: Annotated[Globs, Field(description="actions to send goals to")] = ()
    get_param: Annotated[
        Globs, Field(description="parameters to read: `/node:name` on ROS 2, `/name` on ROS 1")
    ] = ()
    set_param: Annotated[Globs, Field(description="parameters to write and delete")] = ()


class OriginSettings(Table):
    """Which web pages may connect. Programs that are no browsers send no origin and are not asked."""

    allow: Annotated[
        Globs,
        Field(
            description="origins that may connect besides the default ones, for example"
            ' `https://ui.example.com` or `https://*.example.com`; `"*"` lets every page in'
        ),
    ] = ()


class TlsSettings(Table):
    """The certificate of `wss://` and of every other encrypted listener."""

    certfile: Annotated[
        Path | None, Field(description="PEM file with the certificate and those that vouch for it")
    ] = None
    keyfile: Annotated[Path | None, Field(description="PEM file with the private key")] = None

    @model_validator(mode="after")
    def _both(self) -> TlsSettings:
        if (self.certfile is None) != (self.keyfile is None):
            raise ValueError("expected `certfile` and `keyfile` together")
        return self


class DialSettings(Table):
    """Hubs at which the robot dials in, so that clients reach it from outside of its own network."""

    urls: Annotated[
        tuple[str, ...], Field(description="hubs, as `wss://HUB/robots/NAME` with the robot's name")
    ] = ()
    token: Annotated[
        PlainToken | None,
        Field(description="what the hubs want to see: 16 to 256 of the characters A-Z a-z 0-9 - . _ ~"),
    ] = None
    cafile: Annotated[
        Path | None,
        Field(description="PEM file with the authority of the hubs' certificates; not set: the system's"),
    ] = None


class ZenohSettings(Table):
    """How a graph over Zenoh is joined with those of other processes. Used with `graph = "zenoh"`."""

    listen: Annotated[
        tuple[str, ...], Field(description="endpoints to be found at, like `tcp/0.0.0.0:7447`")
    ] = ()
    connect: Annotated[
        tuple[str, ...],
        Field(description="endpoints of peers or routers; one that is not there yet is tried again"),
    ] = ()
    mode: Annotated[
        Literal["peer", "client", "router"] | None,
        Field(
            description="`client` leaves all to the router it is connected to; not set: the file's, or peer"
        ),
    ] = None
    multicast: Annotated[
        bool | None,
        Field(description="whether peers are looked for on the local network; not set: the file's, or no"),
    ] = None
    config: Annotated[
        Path | None,
        Field(description="Zenoh's own configuration file (JSON5), for TLS, access control and the rest"),
    ] = None
    domain: Annotated[
        int, Field(ge=0, le=2**32 - 1, description="ROS_DOMAIN_ID: graphs of different domains do not meet")
    ] = 0


def _with_known_roles(settings: Settings) -> Settings:
    named = {"auth.default_role": settings.auth.default_role, "auth.rosauth_role": settings.auth.rosauth_role}
    named |= {f"auth.tokens.{name}.role": token.role for name, token in settings.auth.tokens.items()}
    known = (*BUILT_IN_ROLES, *settings.roles)
    for key, role in named.items():
        if role is not None and role not in known:
            raise ValueError(f"`{key}`: there is no role {role!r}; known are {', '.join(known)}")
    return settings


class Settings(Table):
    """Everything a server can be told."""

    listen: Annotated[
        tuple[str, ...],
        Field(description="URLs to serve on; port 0 picks a free one; may be empty where `dial.urls` is not"),
    ] = ("ws://127.0.0.1:9090",)
    distro: Annotated[
        Literal["jazzy", "noetic"], Field(description="ROS distribution whose names and messages are spoken")
    ] = "jazzy"
    interfaces: Annotated[
        tuple[Path, ...], Field(description="folders of `.msg`, `.srv` and `.action` files")
    ] = ()
    packages: Annotated[
        tuple[Path, ...],
        Field(description="folders of ROS packages whose meshes are served under `/packages/`"),
    ] = ()
    demo: Annotated[bool, Field(description="whether the demo robot takes part")] = False
    nodes: Annotated[
        tuple[NodeName, ...],
        Field(description="ready-made nodes that take part; `[]` for none"),
    ] = get_args(NodeName)
    profile: Annotated[
        Literal["compat", "ros1", "ros2-2024", "2.0.0"],
        Field(description="protocol text to follow; `compat` takes what any client sends"),
    ] = "compat"
    max_message_size: Annotated[Bytes, Field(description="largest message taken from a client, bytes")] = (
        64 * MIB
    )
    default_call_service_timeout: Annotated[
        SecondsOrNone,
        Field(description="seconds a service call may take when its caller says nothing; 0 waits for ever"),
    ] = 5.0
    unregister_timeout: Annotated[
        SecondsOrNone, Field(description="seconds a topic outlives its last rosbridge publisher")
    ] = 10.0
    bson_only_mode: Annotated[
        bool, Field(description="whether every message, both ways, is BSON; needs the extra `bson`")
    ] = False
    deflate: Annotated[
        Literal["off", "shared", "context"],
        Field(description="permessage-deflate for WebSocket clients that ask: `shared` or in `context`"),
    ] = "off"
    limits: LimitSettings = LimitSettings()
    auth: AuthSettings = AuthSettings()
    roles: Mapping[str, RoleSettings] = Field(
        default_factory=dict, description="roles besides the built-in `admin` and `viewer`"
    )
    origins: OriginSettings = OriginSettings()
    tls: TlsSettings = TlsSettings()
    dial: DialSettings = DialSettings()
    graph: Annotated[
        Literal["memory", "zenoh"],
        Field(description="`zenoh` joins the graph with those of other processes; needs the extra `zenoh`"),
    ] = "memory"
    zenoh: ZenohSettings = ZenohSettings()
    workers: Annotated[
        Count,
        Field(
            description="processes that serve the same ports, with one graph over Zenoh; more than one needs"
            " Linux and the extra `zenoh`"
        ),
    ] = 1

    @model_validator(mode="after")
    def _reachable(self) -> Settings:
        if not self.listen and not self.dial.urls:
            raise ValueError("`listen`: expected at least one URL, or one in `dial.urls`")
        return self

    @model_validator(mode="after")
    def _roles_exist(self) -> Settings:
        return _with_known_roles(self)


BUILT_IN_ROLES: Final[Mapping[str, RoleSettings]] = MappingProxyType(
    {
        "admin": RoleSettings(
            publish=("*",),
            subscribe=("*",),
            call=("*",),
            provide=("*",),
            goals=("*",),
            get_param=("*",),
            set_param=("*",),
        ),
        "viewer": RoleSettings(read_only=True),
    }
)
"""Roles that are there without being configured; a configured one of the same name takes their place."""
