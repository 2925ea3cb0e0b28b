"""Zenoh session of a graph: configuration, opening and closing."""

from __future__ import annotations

import atexit
import json
import logging
import threading
from dataclasses import dataclass
from os import PathLike, fspath
from typing import Literal

import zenoh

from rwt_graph.errors import ZenohError

logger = logging.getLogger(__name__)

Mode = Literal["peer", "client", "router"]

#: How long a sample may wait for room on a link before it is dropped, in microseconds. Zenoh's own 1 ms loses
#: samples whenever the receiving process is not scheduled for a moment; a link that stays full drops at once.
_WAIT_BEFORE_DROP = 50_000

#: This project's defaults where they differ from Zenoh's: by key, the value and Zenoh's.
_DEFAULTS: dict[str, tuple[object, object]] = {
    "listen/endpoints": ([], {"router": ["tcp/[::]:7447"], "peer": ["tcp/[::]:0"]}),
    "scouting/multicast/enabled": (False, None),
    # Zenoh's 1, 2 and then 4 seconds delay the reconnection of a broken link.
    "connect/retry": ({"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5}, None),
    # Milliseconds after which a silent peer is considered gone and its open calls fail. With Zenoh's 10 s,
    # callers would wait too long for a host that is cut off for five.
    "transport/link/tx/lease": (3000, 10000),
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": (_WAIT_BEFORE_DROP, 1000),
    # Batches of 64 KiB queued per link: Zenoh's 2 are full at once while the receiver is not scheduled.
    "transport/link/tx/queue/size/data": (16, 2),
}

#: Timeout of closing, in seconds.
_CLOSE_SECONDS = 3.0

#: Maximum ROS_DOMAIN_ID that fits every DDS; rmw_zenoh itself has no limit.
_LARGEST_DOMAIN = 2**32 - 1


@dataclass(frozen=True, slots=True)
class ZenohOptions:
    """Options for joining a graph over Zenoh.

    Attributes:
        listen: endpoints to listen on, such as `tcp/0.0.0.0:7447`; none by default.
        connect: endpoints of peers or routers; unreachable ones are retried.
        mode: `peer` connects to each peer directly; `client` only to its routers or peers, which forward;
            `router` forwards between all that are connected to it.
        multicast: True to search for peers on the local network.
        config: Zenoh configuration file (JSON5), for TLS, access control and the like. Options given here
            take precedence over the file, and the file over this project's defaults.
        domain: ROS_DOMAIN_ID: graphs of different domains are separate.
    """

    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    mode: Mode | None = None
    multicast: bool | None = None
    config: str | PathLike[str] | None = None
    domain: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.domain <= _LARGEST_DOMAIN:
            raise ZenohError(f"{self.domain} is not a domain: it must be 0 or more")


def configuration(options: ZenohOptions) -> zenoh.Config:
    """Return the session's configuration. Raises :exc:`ZenohError` for a file or a value that is invalid."""
    config = zenoh.Config()
    if options.config is not None:
        name = fspath(options.config)
        try:
            config = zenoh.Config.from_file(name)
        except Exception as error:  # The binding raises its own exceptions, Python's and Rust's.
            raise ZenohError(
                f"the Zenoh configuration {name} cannot be used: it is not there, or not JSON5 as Zenoh"
                " writes it"
            ) from error
    for key, (own, zenohs) in _DEFAULTS.items():
        if json.loads(config.get_json(key)) == zenohs:
            _insert(config, key, own)
    given: dict[str, object] = {
        "mode": options.mode,
        "listen/endpoints": list(options.listen) or None,
        "connect/endpoints": list(options.connect) or None,
        "scouting/multicast/enabled": options.multicast,
        # Caches of transient-local publishers number samples by time.
        "timestamping/enabled": True,
    }
    for key, value in given.items():
        if value is not None:
            _insert(config, key, value)
    return config


def _insert(config: zenoh.Config, key: str, value: object) -> None:
    try:
        config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise ZenohError(f"Zenoh does not take {value!r} for {key}") from error


class ZenohSession:
    """Session that is closed in every case: a process with an open session does not exit."""

    def __init__(self) -> None:
        self._session: zenoh.Session | None = None
        self._lock = threading.Lock()

    def open(self, options: ZenohOptions) -> zenoh.Session:
        """Open the session; blocks until it is connected. Raises :exc:`ZenohError`."""
        config = configuration(options)
        # Set before opening, so that an exception in between cannot leave the session open.
        atexit.register(self.close)
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            atexit.unregister(self.close)
            raise ZenohError(_cannot_open(options)) from error
        return self._session

    def close(self) -> None:
        """Close the session with everything declared on it, from any thread.

        Blocks briefly; for three seconds if a connected process is unreachable, where Zenoh itself takes ten.
        """
        with self._lock:
            session, self._session = self._session, None
        if session is not None:
            atexit.unregister(self.close)
            closing = threading.Thread(target=_close, args=(session,), daemon=True, name="zenoh close")
            closing.start()
            closing.join(_CLOSE_SECONDS)
            if closing.is_alive():
                logger.info("left the graph without a goodbye to a process that cannot be reached")


def _close(session: zenoh.Session) -> None:
    try:
        session.close()
    except zenoh.ZError as error:
        logger.info("a link could not be closed in order: %s", type(error).__name__)


def _cannot_open(options: ZenohOptions) -> str:
    asked = [f"listen on {', '.join(options.listen)}"] if options.listen else []
    asked += [f"connect to {', '.join(options.connect)}"] if options.connect else []
    return (
        f"Zenoh cannot {' and '.join(asked) or 'be opened'}: endpoints are written like tcp/127.0.0.1:7447, "
        "one to listen on must be free and of this host, and a client needs a router that is there"
    )
