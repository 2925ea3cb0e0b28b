"""Models of the settings of a server, with their defaults. `rwt.settings.sources` reads them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from copy import copy
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal, NamedTuple, Self, TypeVar, cast

from pydantic import AfterValidator, Field, ValidationError, create_model, model_validator

from rwt import parts
from rwt.access.settings import (
    MIB,
    Bytes,
    ClientLimits,
    Count,
    Seconds,
    SecondsOrNone,
    SettingsError,
    Table,
    TlsSettings,
)
from rwt.rosbridge.settings import BridgeSettings
from rwt_protocol.error_text import Expected
from rwt_protocol.extensions import extension_names
from rwt_transports.limits import Limits

if TYPE_CHECKING:
    from rwt.declarations import Part


def _check_proxies(networks: tuple[str, ...]) -> tuple[str, ...]:
    if networks:
        from rwt_transports.http.proxies import Proxies  # Settings without proxies load no transport.

        Proxies(networks)
    return networks


def _check_proxy_headers(names: tuple[str, ...]) -> tuple[str, ...]:
    from rwt_transports.http.proxies import Proxies

    return Proxies(headers=names).headers


MEMORY: Final = "memory"
"""Name of the graph of this process."""

M = TypeVar("M", bound=Table)
T = TypeVar("T", str, tuple[str, ...])


def _either(names: Iterable[str]) -> str:
    return " or ".join(f'"{name}"' for name in names)


_GRAPHS: Final = (MEMORY, *parts.names("graph"))
_NODES_EXPECTED: Final = Expected(f"a list of {_either(parts.names('node'))}")
_GATEWAYS_EXPECTED: Final = Expected(f"a list of {_either(parts.names('gateway'))}")
_GRAPH_EXPECTED: Final = Expected(_either(_GRAPHS))


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
        _CONNECTION.connections,
        description="open connections per listener, plain HTTP included; clients share them",
    )
    incoming_bytes: Bytes = Field(
        48 * MIB,
        description="bytes of incomplete messages over all connections, which clients share; beyond it, the"
        " client that holds most loses the connection whose message began first. While complete messages of a"
        " quarter as many bytes wait to be processed, large messages are neither received nor inflated",
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
    video_viewers: Count = Field(
        100, description="concurrent viewers of image streams and snapshots; clients share them"
    )
    video_encoders: Count = Field(
        16,
        description="different image streams at a time, which clients share; equal ones share an encoder",
    )
    video_pixels: Count = Field(
        1_500_000,
        description="pixels per image, summed over all different video streams, which clients share; VP9"
        " counts twice",
    )
    data_frames: Count = Field(_CONNECTION.data_frames, description="the same limit as a number of messages")
    control_bytes: Bytes = Field(
        _CONNECTION.control_bytes,
        description="bytes of replies queued for one client; beyond it, the client is disconnected",
    )
    control_frames: Count = Field(
        _CONNECTION.control_frames, description="the same limit as a number of messages"
    )


class LogSettings(Table):
    """Log of `rwt serve` on standard error. The options `--verbose` and `--log-format` take precedence."""

    level: Literal["debug", "info", "warning", "error"] = Field(
        "info", description="lowest level of its lines"
    )
    format: Literal["text", "json", "logfmt"] = Field(
        "text", description="text lines, one JSON object per line, or logfmt"
    )


class SettingsOfPart(NamedTuple):
    """Part whose settings a :class:`Settings` has.

    Attributes:
        key: name of its table; empty if its settings are at the top level.
        keys: its names at the top level.
    """

    kind: parts.Kind
    name: str
    part: Part
    key: str
    keys: tuple[str, ...]


class Settings(BridgeSettings):
    """All settings of a server: those of the core, and the tables of the parts that are named or set.

    The class of an object is a subclass with these tables (:func:`settings_type`). Tables that nothing names
    have their defaults: :meth:`of` returns them.

    Attributes:
        tables: parts whose settings this class has.

    Raises:
        SettingsError: a setting is unknown, or a value is invalid.
    """

    tables: ClassVar[tuple[SettingsOfPart, ...]] = ()

    def __new__(cls, **values: object) -> Self:
        """Return an empty object of the class with the tables of `values`."""
        if cls is Settings:
            cls = cast("type[Self]", settings_type(frozenset(_parts_in(values))))
        return super().__new__(cls)

    def __init__(self, **values: object) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            from rwt.settings.errors import explain  # It needs this class.

            key, text = explain(error, type(self))
            raise SettingsError(text, key) from None

    @classmethod
    def model_validate(cls, obj: Any, **options: Any) -> Self:
        """Validate a mapping, of which the tables determine the class; see pydantic for the options."""
        if cls is Settings and isinstance(obj, Mapping):
            cls = cast("type[Self]", settings_type(frozenset(_parts_in(obj))))
        return super().model_validate(obj, **options)

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the values that were set: the class is made again from their names."""
        return _restored, ({name: getattr(self, name) for name in self.model_fields_set},)

    listen: tuple[str, ...] = Field(
        ("ws://127.0.0.1:9090",),
        description="URLs to serve on; port 0 selects a free one; may be empty if `dial.urls` is set",
    )
    distro: Literal["humble", "jazzy", "kilted", "lyrical", "noetic", "rolling"] = Field(
        "jazzy",
        description="ROS distribution that determines messages, names, times, parameters and actions; with"
        ' `graph = "ros2"` by default the installed one',
    )
    interfaces: tuple[Path, ...] = Field((), description="folders of `.msg`, `.srv` and `.action` files")
    nodes: Annotated[
        tuple[str, ...],
        _named("rwt.nodes", parts.names("node"), _NODES_EXPECTED),
        _NODES_EXPECTED,
        Field(description="nodes to run in the server; `[]`: none"),
    ] = parts.defaults("node")
    gateways: Annotated[
        tuple[str, ...],
        _named("rwt.gateways", parts.names("gateway"), _GATEWAYS_EXPECTED),
        _GATEWAYS_EXPECTED,
        Field(
            description="protocols beside rosbridge on the same port; `[]`: none; `mcp` (agents) needs the"
            " extra `mcp`"
        ),
    ] = parts.defaults("gateway")
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
            description="addresses or networks of trusted reverse proxies, which name their clients in"
            " `proxy_headers`"
        ),
    ] = ()
    proxy_headers: Annotated[
        tuple[str, ...],
        AfterValidator(_check_proxy_headers),
        Field(
            description="headers that each of `proxies` writes itself, with exactly one for the client's"
            " address: `x-forwarded-for`, `forwarded`, `x-real-ip`, `true-client-ip` or `cf-connecting-ip`;"
            " also `x-forwarded-proto`, `x-forwarded-host` and `x-forwarded-prefix`. Others are ignored"
        ),
    ] = ("x-forwarded-for", "x-forwarded-proto")
    log: LogSettings = LogSettings.model_construct()
    access_log: bool = Field(False, description="log each HTTP request")
    metrics_need_token: bool = Field(
        False,
        description="serve `/metrics` only to clients with a token, whatever `auth.default_role` is",
    )
    socket_mode: str = Field(
        "600",
        pattern=r"^0?[0-7]{3}$",
        description="permissions of the files of `unix://` listeners, in octal digits; clients need the right"
        " to write, such as `660` for those of the file's group",
    )
    limits: LimitSettings = LimitSettings.model_construct()
    tls: TlsSettings = TlsSettings.model_construct()
    graph: Annotated[
        str,
        _named("rwt.graphs", _GRAPHS, _GRAPH_EXPECTED),
        _GRAPH_EXPECTED,
        Field(
            description="`zenoh` shares the graph with other processes and needs the extra `zenoh`;"
            " `ros2` joins the installed ROS 2; `ros1://robot:11311` joins a ROS 1 master,"
            " `ros1` that of ROS_MASTER_URI, and `ros1-master://0.0.0.0:11311` is a master itself, all with"
            ' `distro = "noetic"` by default'
        ),
    ] = MEMORY
    bridge: Annotated[tuple[str, ...], _named("rwt.graphs", _GRAPHS, _GRAPH_EXPECTED)] = Field(
        (),
        description="other graphs with which the server exchanges topics and services, named as in `graph`;"
        " clients use `graph`",
    )
    workers: Count = Field(
        1,
        description="processes that serve the same ports and share one graph over Zenoh; more than one"
        " needs Linux and the extra `zenoh`",
    )

    def of(self, model: type[M]) -> M:
        """Return the settings of the part with this model; its defaults if none are set."""
        for each in type(self).tables:
            if each.part.settings is model:
                if each.key:
                    return cast("M", getattr(self, each.key))
                given = model.model_fields.keys() & self.model_fields_set
                return model(**{name: getattr(self, name) for name in given})
        return model()

    def active(self, *kinds: parts.Kind) -> Iterator[tuple[SettingsOfPart, Table]]:
        """Yield the parts of some kinds that their own settings turn on, in the order of their table."""
        for kind in kinds:
            given = {each.name: each for each in type(self).tables if each.kind == kind}
            # Parts of other distributions are in no table; theirs are those that the settings have.
            for name in dict.fromkeys((*parts.names(kind, by_name=False), *given)):
                if name in given:
                    each = given[name]
                elif name in parts.defaults(kind, by_name=False):
                    each = _settings_of(kind, name)
                else:
                    continue
                table = self.of(each.part.settings)
                is_on = getattr(each.part, "is_on", None)
                if is_on is not None and is_on(table):
                    yield each, table

    @model_validator(mode="before")
    @classmethod
    def _distro_of_graph(cls, given: object) -> object:
        """Use the distribution of the graph, unless another is given."""
        if isinstance(given, dict) and isinstance(given.get("graph"), str):
            distro = default_distro(given["graph"])
            if distro:
                return {"distro": distro, **given}
        return given

    @model_validator(mode="after")
    def _fits_together(self) -> Settings:
        distro = distro_of_graph(self.graph)
        if distro and self.distro != distro:
            raise ValueError(
                f'`distro`: {self.distro!r} cannot be used with `graph = {self.graph!r}`: expected "{distro}"'
            )
        for each in type(self).tables:
            if each.part.check is not None:
                each.part.check(self, self.of(each.part.settings))
        needs_approval = any(rule.approval is not None for rule in self.gate.rules.values())
        for name in self.unanswered_rules(tuple(self._roles_of_asked_users()) if needs_approval else ()):
            raise ValueError(
                f"`gate.rules.{name}.approval.roles`: no client can approve: expected a token in"
                " `auth.tokens` with one of these roles, beside that of the client that asks; or `[]` if only"
                " the robot's own programs approve"
            )
        if not self.listen and not self.brings_clients:
            raise ValueError("`listen`: expected at least one URL, or one in `dial.urls`")
        if self.gate.audit.stdout and any(url.lower().startswith("stdio:") for url in self.listen):
            raise ValueError(
                '`gate.audit.stdout`: standard output carries the protocol of `listen = ["stdio:"]`'
            )
        if self.workers == 1:
            return self
        if not is_shared_graph(self.graph):
            raise ValueError(f"`graph`: {self.graph!r} is of one process: expected `workers = 1`")
        if self.bridge:
            raise ValueError("`bridge`: each process would be a bridge of its own: expected `workers = 1`")
        if self.gate.rules or self.gate.audit.is_on:
            raise ValueError("`gate`: each process would have a gate of its own: expected `workers = 1`")
        return self

    def _roles_of_asked_users(self) -> Iterator[str]:
        """Yield the roles of clients whose gateway asks their user for an approval."""
        for name in self.gateways:
            part = parts.load("gateway", name)
            role_of = getattr(part, "asked_role", None)
            if role_of is not None:
                yield from (token.role for token in self.auth.tokens.values())
                if self.auth.role_without_credentials is not None:
                    yield role_of(self.of(part.settings))

    @property
    def brings_clients(self) -> bool:
        """True if clients can connect without a URL to listen on."""
        return any(getattr(each.part, "brings_clients", False) for each, _ in self.active("service"))


def _restored(values: Mapping[str, object]) -> Settings:
    return Settings(**values)


def name_of_graph(graph: str) -> str:
    """Return the name of the part in a value of the setting `graph`, which may have an address behind it."""
    return graph.partition("://")[0]


def distro_of_graph(graph: str) -> str:
    """Return the distribution that a graph requires; empty for any."""
    name = name_of_graph(graph)
    return str(getattr(parts.load("graph", name), "distro", "")) if name in parts.names("graph") else ""


def default_distro(graph: str) -> str:
    """Return the distribution of a graph unless another is set; empty for that of all graphs."""
    name = name_of_graph(graph)
    required = distro_of_graph(graph)
    found = None if required or name not in parts.names("graph") else parts.load("graph", name)
    ask = getattr(found, "default_distro", None)
    return required if ask is None else str(ask())


def is_shared_graph(graph: str) -> bool:
    """Return True if several worker processes can join such a graph, or replace it by one that they can."""
    name = name_of_graph(graph)
    return graph == MEMORY or (
        name in parts.names("graph") and bool(getattr(parts.load("graph", name), "is_shared", False))
    )


def _settings_of(kind: parts.Kind, name: str) -> SettingsOfPart:
    part = parts.load(kind, name)
    keys = parts.row(kind, name).settings
    return SettingsOfPart(kind, name, part, "" if part.at_top_level else next(iter(keys), ""), keys)


_NAMED_BY: Final[Mapping[parts.Kind, str]] = {"gateway": "gateways", "node": "nodes", "graph": "graph"}
"""Settings that name parts, by kind."""


def _parts_in(values: Mapping[str, object]) -> Iterator[tuple[parts.Kind, str]]:
    """Yield the parts whose settings are given, and those of other distributions that are named."""
    for key in values:
        owner = None if key in Settings.model_fields else parts.owner_of(key)
        if owner is not None:
            yield owner
    for kind, setting in _NAMED_BY.items():
        given = values.get(setting, ())
        for name in (given,) if isinstance(given, str) else given if isinstance(given, list | tuple) else ():
            if isinstance(name, str) and name not in parts.names(kind) and name in parts.installed(kind):
                yield kind, name


def settings_type(owners: frozenset[tuple[parts.Kind, str]]) -> type[Settings]:
    """Return the class of settings with the tables of some parts.

    Raises:
        SettingsError: the distribution of a part is not installed.
    """
    if not owners:
        return Settings
    if all(name in parts.BUILT_IN[kind] for kind, name in owners):
        return _type_of_built_in(owners)
    return _made_type(owners)


@cache
def _type_of_built_in(owners: frozenset[tuple[parts.Kind, str]]) -> type[Settings]:
    return _made_type(owners)


def _made_type(owners: frozenset[tuple[parts.Kind, str]]) -> type[Settings]:
    order = [(kind, name) for kind, rows in parts.BUILT_IN.items() for name in rows]
    listed = sorted(owners, key=lambda each: (order.index(each) if each in order else len(order), each))
    found: list[SettingsOfPart] = []
    fields: dict[str, object] = {}
    for kind, name in listed:
        try:
            each = _settings_of(kind, name)
        except parts.PartError as error:
            # A part of another distribution is named by a setting; a built-in one has a table here.
            built_in = name in parts.BUILT_IN[kind]
            setting = parts.row(kind, name).settings[0] if built_in else _NAMED_BY.get(kind, name)
            raise SettingsError(f"`{setting}`: {error}") from error
        found.append(each)
        if each.key:
            fields[each.key] = (each.part.settings, each.part.settings())
        else:
            for field, info in each.part.settings.model_fields.items():
                fields[field] = (info.annotation, copy(info))
    made = create_model("Settings", __base__=Settings, __module__=__name__, **fields)  # type: ignore[call-overload]
    made.tables = tuple(found)
    return cast("type[Settings]", made)


def full_type() -> type[Settings]:
    """Return the class of settings with the tables of all built-in parts that are installed."""
    owners = {(kind, name) for _, kind, name in parts.settings_keys() if parts.is_available(kind, name)}
    return settings_type(frozenset(owners))


def with_all_tables(settings: Settings) -> Settings:
    """Return the same settings with the tables of all parts, those that are not set with their defaults."""
    owners = {(each.kind, each.name) for each in (*full_type().tables, *type(settings).tables)}
    values = {name: getattr(settings, name) for name in settings.model_fields_set}
    return settings_type(frozenset(owners))(**values)


def type_with(key: str) -> type[Settings]:
    """Return the class of settings that has a name at the top level; that of the core for unknown names."""
    owner = None if key in Settings.model_fields else parts.owner_of(key)
    return Settings if owner is None else settings_type(frozenset({owner}))
