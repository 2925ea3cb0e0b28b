"""Mesh of Zenoh sessions through which the workers of one server share a graph."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

from rwt.extensions.zenoh.session import ZenohOptions, configuration
from rwt_graph.errors import ZenohError

_PORT = re.compile(r":\d+(?=$|[?#])")


def mesh_options(options: ZenohOptions, folder: Path, number: int, count: int) -> ZenohOptions:
    """Return the options of one worker.

    In mode `peer` the workers are a full mesh over Unix sockets in `folder`. Outside, each is a separate
    peer, because peers do not forward: the first listens at the endpoints of `options`, the others at ports
    of their own, which Zenoh's gossip announces. In mode `router` the first worker is the router, the others
    its clients. In mode `client` all workers connect to the same router.

    Args:
        folder: folder of the sockets; only the server may have access.
        number: number of the worker, from 1, in the order of starting.

    Raises:
        ZenohError: the configuration file cannot be used.
    """
    config = configuration(options)
    mode = options.mode or json.loads(config.get_json("mode")) or "peer"
    if mode == "client":
        return options
    if mode == "router" and number > 1:
        return replace(options, mode="client", listen=(), connect=(_endpoint(folder, 1),))
    # A restarted worker connects to the others, instead of waiting for their retries.
    there = [each for each in range(1, count + 1) if each < number or _socket(folder, each).exists()]
    others = [_endpoint(folder, each) for each in there if each != number and mode == "peer"]
    listen = _endpoints(config.get_json("listen/endpoints"), mode)
    connect = _endpoints(config.get_json("connect/endpoints"), mode)
    if number > 1:
        listen = [_PORT.sub(":0", each) for each in listen if _PORT.search(each)]
    return replace(options, listen=(_endpoint(folder, number), *listen), connect=(*others, *connect))


def _socket(folder: Path, number: int) -> Path:
    return folder / f"zenoh-{number}"


def _endpoint(folder: Path, number: int) -> str:
    return f"unixsock-stream/{_socket(folder, number)}"


def _endpoints(text: str, mode: str) -> list[str]:
    value = json.loads(text)
    if isinstance(value, dict):
        value = value.get(mode, [])
    if not isinstance(value, list) or not all(isinstance(each, str) for each in value):
        raise ZenohError(f"endpoints are a list of texts like tcp/0.0.0.0:7447, not {text}")
    return value
