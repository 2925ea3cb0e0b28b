"""Models of the settings of a server, with their defaults. `rwt.settings.sources` reads them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal, TypeVar

from pydantic import AfterValidator, Field, SecretStr, ValidationError, model_validator

from rwt.access.settings import (
    BUILT_IN_ROLES,
    MIB,
    Bytes,
    ClientLimits,
    Count,
    PlainToken,
    Seconds,
    SecondsOrNone,
    SettingsError,
    Table,
    TlsSettings,
)
from rwt.extensions.foxglove.settings import FoxgloveSettings
from rwt.extensions.http.settings import HttpSettings
from rwt.extensions.mcp.settings import McpSettings
from rwt.rosbridge.settings import BridgeSettings
from rwt_protocol.error_text import Expected
from rwt_protocol.extensions import extension_names
from rwt_transports.limits import Limits


def _check_proxies(networks: tuple[str, ...]) -> tuple[str, ...]:
    if networks:
        from rwt_transports.http.routes import Proxies  # Settings without proxies load no transport.

        Proxies(networks)
    return networks


T = TypeVar("T", str, tuple[str, ...])

NODES: Final = ("rosapi", "tf2_web_republisher", "web_video_server")
GATEWAYS: Final = ("foxglove", "http", "mcp")
GRAPHS: Final = ("memory", "ros1", "ros1-master", "ros2", "zenoh")
ROS1_GRAPHS: Final = ("ros1", "ros1-master")


def _either(names: Iterable[str]) -> str:
    return " or ".join(f'"{name}"' for name in names)


_NODES_EXPECTED: Final = Expected(f"a list of {_either(NODES)}")
_GATEWAYS_EXPECTED: Final = Expected(f"a list of {_either(GATEWAYS)}")
_GRAPH_EXPECTED: Final = Expected(_either(GRAPHS))


def _named(group: str, builtin: tuple[str, ...], expected: Expected) -> AfterValidator:
    """Accept built-in names and those of entry points, which are not imported here."""

    def check(given: T) -> T:
        names = (given,) if isinstance(given, str) else given
        # A graph may be given with an address: `ros1://robot:11311`.
        unknown = [name for name in names if name.partition("://")[0] not in builtin]
        installed = extension_names(group) if unknown else []
        for name in unknown:
            if name not in installed:
                known = " or ".join(filter(None, (expected.text, _either(installed))))
                raise ValueError(f"expected {known}, got {name!r}")
        return given

    return AfterValidator(check)


_CONNECTION: Final = Limits()


class LimitSettings(ClientLimits):
    """Limits per client and in total. A rejection names the setting."""

    connections: Count = Field(
        _CONNECTION.connections, description="open connections per listener, plain HTTP included"
    )
    incoming_bytes: Bytes = Field(
        48 * MIB,
        description="bytes of incomplete messages over all connections; beyond it, the client whose message"
        " began first is disconnected. While complete messages of a quarter as many bytes wait to be"
        " processed, large messages are neither received nor inflated",
    )
    handshake_seconds: Seconds = Field(
        _CONNECTION.handshake_seconds, description="seconds from connecting to the end of the HTTP request"
    )
    idle_http_seconds: Seconds = Field(
        _CONNECTION.idle_http_seconds,
        description="idle seconds between two requests on a kept-alive HTTP connection",
    )
    stalled_http_seconds: Seconds = Field(
        _CONNECTION.stalled_http_seconds,
        description="seconds without progress after which the reader of a page or stream is disconnected",
    )
    ping_seconds: SecondsOrNone = Field(
        _CONNECTION.ping_seconds, description="seconds of silence after which a client is pinged; 0: never"
    )
    pong_seconds: Seconds = Field(
        _CONNECTION.pong_seconds,
        description="further seconds of silence after which a client is disconnected",
    )
    idle_peer_seconds: Seconds = Field(
        _CONNECTION.idle_peer_seconds, description="seconds of silence after which a UDP client is forgotten"
    )
    close_seconds: Seconds = Field(
        _CONNECTION.close_seconds, description="seconds that closing a connection may take"
    )
    video_viewers: Count = Field(100, description="concurrent viewers of image streams and snapshots")
    video_encoders: Count = Field(
        16, description="different image streams at a time; equal ones share an encoder"
    )
    video_pixels: Count = Field(
        1_500_000, description="pixels per image, summed over all different video streams; VP9 counts twice"
    )
    data_frames: Count = Field(_CONNECTION.data_frames, description="the same limit as a number of messages")
    control_bytes: Bytes = Field(
        _CONNECTION.control_bytes,
        description="bytes of replies queued for one client; beyond it, the client is disconnected",
    )
    control_frames: Count = Field(
        _CONNECTION.control_frames, description="the same limit as a number of messages"
    )


class DialSettings(Table):
    """Hubs that the robot connects to, so that clients outside of its network reach it."""

    urls: tuple[str, ...] = Field((), description="hubs, as `wss://HUB/robots/NAME` with the robot's name")
    token: PlainToken | None = Field(
        None, description="token for the hubs: 16 to 256 of the characters A-Z a-z 0-9 - . _ ~"
    )
    cafile: Path | None = Field(
        None,
        description="PEM file with the authority of the hubs' certificates; not set: the system's"
        " authorities",
    )


class ZenohSettings(Table):
    """Connection to other processes over Zenoh. Used with `graph = "zenoh"`."""

    listen: tuple[str, ...] = Field((), description="endpoints to listen on, such as `tcp/0.0.0.0:7447`")
    connect: tuple[str, ...] = Field(
        (), description="endpoints of peers or routers; unreachable ones are retried"
    )
    mode: Literal["peer", "client", "router"] | None = Field(
        None,
        description="`client` communicates only through the router it is connected to; not set: the mode in"
        " `config`, or peer",
    )
    multicast: bool | None = Field(
        None, description="discover peers on the local network; not set: as in `config`, or no"
    )
    config: Path | None = Field(
        None, description="Zenoh's own configuration file (JSON5), for example for TLS and access control"
    )
    domain: int = Field(
        0, ge=0, le=2**32 - 1, description="ROS_DOMAIN_ID: graphs of different domains are separate"
    )


class Ros2Settings(Table):
    """Connection to the installed ROS 2. Used with `graph = "ros2"`."""

    use_sim_time: bool = Field(False, description="take ROS time from the topic `/clock`")
    remap: tuple[str, ...] = Field(
        (),
        description="remapping rules, such as `/cmd_vel:=/input/cmd_vel`, `__ns:=/robot1` for all nodes of"
        " the server, or `rosapi:__node:=api`",
    )


class RecorderSettings(Table):
    """Recordings that clients start and end, by `/recorder/start` and `/recorder/stop`. Needs the extra
    `mcap`."""

    folder: Path | None = Field(None, description="folder for recordings; not set: the services do not exist")
    recording_bytes: Bytes = Field(
        1024 * MIB, description="largest recording in bytes before compression; it ends there"
    )
    folder_bytes: Bytes = Field(
        8 * 1024 * MIB,
        description="largest size of all files in the folder; recordings end there, and none starts",
    )


class WebSettings(Table):
    """The dashboard, served at `/`."""

    enabled: bool = Field(
        True, description="serve the dashboard if it was built; otherwise `/` is a plain list"
    )
    layouts: Path | None = Field(
        None, description="folder of layouts, `NAME.json`, which every visitor can open with `?layout=NAME`"
    )
    embed: tuple[str, ...] = Field(
        (),
        description="origins of pages that may embed the dashboard in a frame, such as `https://example.org`",
    )


class WebRtcSettings(Table):
    """WebRTC through the port of `ws://` and `wss://` listeners. Needs the extra `webrtc`, and asyncio."""

    enabled: bool = Field(False, description="accept offers at `/webrtc`: rosbridge over data channels")
    servers: tuple[str, ...] = Field(
        (),
        max_length=8,
        description="STUN and TURN servers, such as `stun:stun.example.org` and"
        " `turn:turn.example.org:3478?transport=udp`; none for peers in one network",
    )
    username: str = Field("", description="user name for the TURN servers")
    credential: SecretStr | None = Field(
        None, description="password for the TURN servers, sent to clients with each answer"
    )
    credential_command: tuple[str, ...] = Field(
        (),
        description="command that prints a temporary TURN credential as JSON: `username`, `password`, `ttl`"
        " in seconds, and optionally `uris`",
    )
    credential_url: str | None = Field(
        None, pattern=r"^https?://", description="URL that returns such a credential"
    )
    addresses: Literal["auto", "all", "relay"] = Field(
        "auto",
        description="addresses that peers are told and that are tried: `auto`, private ones only for"
        " clients with private addresses; `all`, private ones for every client, such as one in the robot's"
        " network that comes through a hub; `relay`, only those of a TURN server",
    )
    peers: Count = Field(32, description="open peer connections")
    handshakes: Count = Field(
        8, description="peer connections that are still connecting; offers wait up to 5 s for one"
    )
    channels: Count = Field(16, description="data channels per peer; each is a client")
    candidates: Count = Field(64, description="candidate addresses per peer")
    connect_seconds: Seconds = Field(
        15.0, description="seconds from the offer until the connection must be established"
    )

    @model_validator(mode="after")
    def _one_credential(self) -> WebRtcSettings:
        if sum(map(bool, (self.credential, self.credential_command, self.credential_url))) > 1:
            raise ValueError(
                "expected at most one of `credential`, `credential_command` and `credential_url`"
            )
        if self.addresses == "relay" and not self.servers and not self.credential_command:
            raise ValueError('`addresses = "relay"` needs a TURN server in `servers`')
        return self


class Settings(BridgeSettings):
    """All settings of a server.

    Raises:
        SettingsError: a setting is unknown, or a value is invalid.
    """

    if not TYPE_CHECKING:  # Checkers know the arguments from the fields.

        def __init__(self, **values: object) -> None:
            try:
                super().__init__(**values)
            except ValidationError as error:
                from rwt.settings.errors import explain  # It needs this class.

                key, text = explain(error)
                raise SettingsError(text, key) from None

    listen: tuple[str, ...] = Field(
        ("ws://127.0.0.1:9090",),
        description="URLs to serve on; port 0 selects a free one; may be empty if `dial.urls` is set",
    )
    distro: Literal["jazzy", "noetic"] = Field(
        "jazzy", description="ROS distribution that determines names, times, parameters and actions"
    )
    interfaces: tuple[Path, ...] = Field((), description="folders of `.msg`, `.srv` and `.action` files")
    packages: tuple[Path, ...] = Field(
        (), description="folders of ROS packages whose meshes are served under `/packages/`"
    )
    package_links: bool = Field(
        False,
        description="serve files outside of the folders of `packages` that links in them lead to, after"
        " `colcon build --symlink-install`; anyone who can write there can publish any mesh or image",
    )
    demo: bool = Field(False, description="add the demo robot")
    nodes: Annotated[
        tuple[str, ...],
        _named("rwt.nodes", NODES, _NODES_EXPECTED),
        _NODES_EXPECTED,
        Field(description="nodes to run in the server; `[]`: none"),
    ] = NODES
    gateways: Annotated[
        tuple[str, ...],
        _named("rwt.gateways", GATEWAYS, _GATEWAYS_EXPECTED),
        _GATEWAYS_EXPECTED,
        Field(
            description="protocols beside rosbridge on the same port; `[]`: none; `mcp` (agents) needs the"
            " extra `mcp`"
        ),
    ] = ("foxglove", "http")
    encodings: Annotated[
        tuple[str, ...],
        _named("rwt.codecs", (), Expected("a list of names of installed encodings")),
        Field(
            description="encodings of other distributions that clients may request with `compression`,"
            " beside the built-in ones"
        ),
    ] = ()
    deflate: Literal["off", "shared", "context"] = Field(
        "off",
        description="permessage-deflate for WebSocket clients that offer it: `shared` (no context takeover)"
        " or with `context`",
    )
    proxies: Annotated[
        tuple[str, ...],
        AfterValidator(_check_proxies),
        Field(
            description="addresses or networks of trusted reverse proxies, whose forwarded client addresses"
            " are used"
        ),
    ] = ()
    access_log: bool = Field(False, description="log each HTTP request")
    limits: LimitSettings = LimitSettings()
    tls: TlsSettings = TlsSettings()
    dial: DialSettings = DialSettings()
    recorder: RecorderSettings = RecorderSettings()
    web: WebSettings = WebSettings()
    foxglove: FoxgloveSettings = FoxgloveSettings()
    api: HttpSettings = HttpSettings()
    mcp: McpSettings = McpSettings()
    webrtc: WebRtcSettings = WebRtcSettings()
    graph: Annotated[
        str,
        _named("rwt.graphs", GRAPHS, _GRAPH_EXPECTED),
        _GRAPH_EXPECTED,
        Field(
            description="`zenoh` shares the graph with other processes and needs the extra `zenoh`;"
            " `ros2` joins the installed ROS 2; `ros1://robot:11311` joins a ROS 1 master,"
            " `ros1` that of ROS_MASTER_URI, and `ros1-master://0.0.0.0:11311` is a master itself, all with"
            ' `distro = "noetic"` by default'
        ),
    ] = "memory"
    bridge: Annotated[tuple[str, ...], _named("rwt.graphs", GRAPHS, _GRAPH_EXPECTED)] = Field(
        (),
        description="other graphs with which the server exchanges topics and services, named as in `graph`;"
        " clients use `graph`",
    )
    zenoh: ZenohSettings = ZenohSettings()
    ros2: Ros2Settings = Ros2Settings()
    workers: Count = Field(
        1,
        description="processes that serve the same ports and share one graph over Zenoh; more than one"
        " needs Linux and the extra `zenoh`",
    )

    @model_validator(mode="before")
    @classmethod
    def _ros1_is_noetic(cls, given: object) -> object:
        if isinstance(given, dict) and str(given.get("graph")).partition(":")[0] in ROS1_GRAPHS:
            return {"distro": "noetic", **given}
        return given

    @model_validator(mode="after")
    def _fits_together(self) -> Settings:
        if self.graph.partition(":")[0] in ROS1_GRAPHS and self.distro != "noetic":
            raise ValueError(f'`distro`: {self.distro!r} cannot join ROS 1: expected "noetic"')
        role, known = self.mcp.default_role, (*BUILT_IN_ROLES, *self.roles)
        if role not in known:
            raise ValueError(f"`mcp.default_role`: there is no role {role!r}; known are {', '.join(known)}")
        if not self.listen and not self.dial.urls:
            raise ValueError("`listen`: expected at least one URL, or one in `dial.urls`")
        if self.gate.audit.stdout and any(url.lower().startswith("stdio:") for url in self.listen):
            raise ValueError(
                '`gate.audit.stdout`: standard output carries the protocol of `listen = ["stdio:"]`'
            )
        if self.workers == 1:
            return self
        if self.recorder.folder is not None:
            raise ValueError("`recorder.folder`: a recorder sees one process: expected `workers = 1`")
        if self.graph not in ("memory", "zenoh"):
            raise ValueError(f"`graph`: {self.graph!r} is of one process: expected `workers = 1`")
        if self.bridge:
            raise ValueError("`bridge`: each process would be a bridge of its own: expected `workers = 1`")
        if self.gate.rules or self.gate.audit.is_on:
            raise ValueError("`gate`: each process would have a gate of its own: expected `workers = 1`")
        return self
