"""Liveliness tokens, for the discovery of nodes, publishers, subscriptions, services and clients.

`@ros2_lv/<domain>/<session>/<node id>/<entity id>/<kind>/<enclave>/<namespace>/<node>`, and for everything
but a node `/<name>/<dds type>/<type hash>/<qos>` (design, "Graph Cache"). In names `/` is replaced by `%`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from rwt.extensions.zenoh.rmw import qos_text
from rwt.extensions.zenoh.rmw.keys import SLASH, data_key, demangle, mangle
from rwt_graph.errors import WireError
from rwt_participant.qos import DEFAULT_QOS, QoS

_PREFIX = "@ros2_lv"

#: Number of parts of a node's token, and of all others.
_NODE_PARTS, _ENDPOINT_PARTS = 9, 13

#: Maximum length of a token in characters.
MAX_LENGTH = 4096


class EntityKind(Enum):
    """Kind of entity of a token."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVICE = "SS"
    CLIENT = "SC"


@dataclass(frozen=True, slots=True)
class TokenEndpoint:
    """Endpoint of a node: topic or service, type and QoS.

    Attributes:
        name: absolute name of the topic or service.
        dds_type: `std_msgs::msg::dds_::String_`.
        type_hash: `RIHS01_…`, or what Humble has in its place.
    """

    name: str
    dds_type: str
    type_hash: str
    qos: QoS = DEFAULT_QOS

    def data_key(self, domain: int) -> str:
        """Return the key of a topic's samples or a service's requests."""
        return data_key(domain, self.name, self.dds_type, self.type_hash)


@dataclass(frozen=True, slots=True)
class Token:
    """Liveliness token.

    Attributes:
        session: the Zenoh session's id, as text.
        node_id, entity_id: numbers within the session; the same for a node.
        node: absolute name of the node.
        endpoint: None for a node.
    """

    domain: int
    session: str
    node_id: int
    entity_id: int
    kind: EntityKind
    node: str
    endpoint: TokenEndpoint | None = None
    enclave: str = "/"

    def key(self) -> str:
        namespace, _, name = self.node.rpartition("/")
        ids = f"{_PREFIX}/{self.domain}/{self.session}/{self.node_id}/{self.entity_id}/{self.kind.value}"
        key = f"{ids}/{mangle(self.enclave)}/{mangle(namespace)}/{name}"
        if self.endpoint is None:
            return key
        end = self.endpoint
        qos = qos_text.encode(end.qos)
        return f"{key}/{mangle(end.name)}/{end.dds_type}/{end.type_hash}/{qos}"


def gid_of(token_key: str) -> bytes:
    """Return the GID of an entity: XXH3-128 of its token, lower 64 bits first, each half little-endian."""
    import xxhash  # Installed with the extra `zenoh`; needed only here.

    return xxhash.xxh3_128(token_key.encode()).digest()[::-1]


def all_tokens(domain: int) -> str:
    """Return the key expression of all tokens of a domain."""
    return f"{_PREFIX}/{domain}/**"


def parse(key: str) -> Token:
    """Decode a token. Raises :exc:`WireError`, which names the invalid part."""
    if len(key) > MAX_LENGTH:
        raise WireError(f"a liveliness token of {len(key)} characters; the longest read is {MAX_LENGTH}")
    if not (key.isascii() and key.isprintable()):
        # Names and types of ROS are ASCII; others could look like them, or control what shows them.
        raise WireError(f"{key[:120]!a} is not a liveliness token of ROS 2: expected printable ASCII")
    parts = key.split("/")
    if len(parts) < _NODE_PARTS or parts[0] != _PREFIX:
        raise WireError(f"{key[:120]!r} is not a liveliness token of ROS 2")
    kind = next((kind for kind in EntityKind if kind.value == parts[5]), None)
    if kind is None:
        raise WireError(f"{key[:120]!r} is a token of an unknown kind, {parts[5][:8]!r}")
    wanted = _NODE_PARTS if kind is EntityKind.NODE else _ENDPOINT_PARTS
    if len(parts) != wanted:
        raise WireError(f"{key[:120]!r} has {len(parts)} parts; a token of kind {kind.value} has {wanted}")
    domain, node_id, entity_id = (_number(parts[index], key) for index in (1, 3, 4))
    endpoint = None
    if kind is not EntityKind.NODE:
        name = _name(parts[9], key)
        endpoint = TokenEndpoint(name, parts[10], parts[11], qos_text.decode(parts[12]))
    node = f"{_name(parts[7], key).rstrip('/')}/{parts[8]}"
    return Token(domain, parts[2], node_id, entity_id, kind, node, endpoint, demangle(parts[6]))


def _name(part: str, key: str) -> str:
    if not part.startswith(SLASH):
        raise WireError(f"{key[:120]!r}: {part[:40]!r} does not begin with {SLASH}")
    return demangle(part)


def _number(text: str, key: str) -> int:
    if not text.isascii() or not text.isdigit() or len(text) > 20:
        raise WireError(f"{key[:120]!r}: {text[:20]!r} is not a number")
    return int(text)
