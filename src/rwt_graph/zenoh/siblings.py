"""How several processes of one server are joined with each other, and each with those outside."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rwt_graph.zenoh.errors import ZenohError
from rwt_graph.zenoh.session import configuration

if TYPE_CHECKING:
    from rwt_graph.zenoh.session import ZenohOptions

_PORT = re.compile(r":\d+(?=$|[?#])")


def sibling(options: ZenohOptions, folder: Path, number: int) -> ZenohOptions:
    """The options of one of several processes that were given the same ones.

    Peers are a mesh over Unix sockets in `folder`, each connected to those that were started before it. To
    the outside each is a peer of its own, because peers pass nothing on: the first is found where `options`
    say, the others at ports of their own, of which Zenoh's gossip tells. With a router in them, the first is
    that and the others its clients; clients of a router elsewhere need nothing of each other.

    Args:
        options: what the server was given.
        folder: which nobody else may enter.
        number: from 1, in the order of starting.

    Raises:
        ZenohError: the configuration file cannot be used.
    """
    config = configuration(options)
    mode = options.mode or json.loads(config.get_json("mode")) or "peer"
    if mode == "client":
        return options
    own, before = (_socket(folder, number), [_socket(folder, each) for each in range(1, number)])
    if mode == "router" and number > 1:
        return replace(options, mode="client", listen=(), connect=(before[0],))
    listen = _endpoints(config.get_json("listen/endpoints"), mode)
    connect = _endpoints(config.get_json("connect/endpoints"), mode)
    if number > 1:
        listen = [_PORT.sub(":0", each) for each in listen if _PORT.search(each)]
    return replace(options, listen=(own, *listen), connect=(*before, *connect))


def _socket(folder: Path, number: int) -> str:
    return f"unixsock-stream/{folder}/zenoh-{number}"


def _endpoints(text: str, mode: str) -> list[str]:
    """A list of a configuration, which may be one for each mode."""
    value = json.loads(text)
    if isinstance(value, dict):
        value = value.get(mode, [])
    if not isinstance(value, list) or not all(isinstance(each, str) for each in value):
        raise ZenohError(f"endpoints are a list of texts like tcp/0.0.0.0:7447, not {text}")
    return value


__all__ = ["sibling"]
