"""The Zenoh session of a graph: its configuration, opening and closing."""

from __future__ import annotations

import atexit
import json
import logging
import threading
from collections.abc import Callable
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

#: This project's defaults where neither the caller nor the file gives a value: by key, its value and Zenoh's.
_DEFAULTS: dict[str, tuple[object, object]] = {
    "listen/endpoints": ([], {"router": ["tcp/[::]:7447"], "peer": ["tcp/[::]:0"]}),
    "scouting/multicast/enabled": (False, None),
    # Zenoh's 1, 2 and then 4 seconds leave a link that was cut apart for long after it could be back.
    "connect/retry": ({"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5}, None),
    # Milliseconds after which a peer that says nothing is gone, and open calls to it fail: by Zenoh's 10 s a
    # host that was cut off for five would leave its callers waiting.
    "transport/link/tx/lease": (3000, 10000),
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": (_WAIT_BEFORE_DROP, 1000),
    # Batches of 64 KiB that wait on a link: Zenoh's 2 are full at once when the other side is not scheduled.
    "transport/link/tx/queue/size/data": (16, 2),
}

#: How long closing may take.
_CLOSE_SECONDS = 3.0

#: The largest ROS_DOMAIN_ID that fits every DDS; rmw_zenoh has no limit of its own.
_LARGEST_DOMAIN = 2**32 - 1


@dataclass(frozen=True, slots=True)
class ZenohOptions:
    """How a process joins the graph of others.

    Attributes:
        listen: endpoints to be found at, `tcp/0.0.0.0:7447`; none by default.
        connect: endpoints of peers or routers; one that is not there yet is tried again until it is.
        mode: `peer` talks to each peer directly; `client` leaves that to the router or peer that it is
            connected to; `router` passes on between all that are connected to it.
        multicast: whether to look for peers on the local network.
        config: a Zenoh configuration file (JSON5), for TLS, access control and the like. What is given here
            wins over what is in it, and what is neither given nor in it has this project's defaults.
        domain: ROS_DOMAIN_ID: graphs of different domains do not meet.
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
    """The session's configuration.

    Raises:
        ZenohError: the file cannot be read, or a value is not one that Zenoh takes.
    """
    config = _from_file(options.config) if options.config is not None else zenoh.Config()
    for key, (own, zenohs) in _DEFAULTS.items():
        if json.loads(config.get_json(key)) == zenohs:
            _insert(config, key, own)
    given: dict[str, object] = {
        "mode": options.mode,
        "listen/endpoints": list(options.listen) or None,
        "connect/endpoints": list(options.connect) or None,
        "scouting/multicast/enabled": options.multicast,
        # The caches of transient-local publishers number their samples by time.
        "timestamping/enabled": True,
    }
    for key, value in given.items():
        if value is not None:
            _insert(config, key, value)
    return config


def _from_file(path: str | PathLike[str]) -> zenoh.Config:
    name = fspath(path)
    try:
        return zenoh.Config.from_file(name)
    except Exception as error:  # The binding raises its own, Python's and Rust's.
        raise ZenohError(
            f"the Zenoh configuration {name} cannot be used: it is not there, or not JSON5 as Zenoh writes it"
        ) from error


def _insert(config: zenoh.Config, key: str, value: object) -> None:
    try:
        config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise ZenohError(f"Zenoh does not take {value!r} for {key}") from error


class ZenohSession:
    """One session, which is closed in every case: a process with an open session never ends."""

    def __init__(self) -> None:
        self._session: zenoh.Session | None = None
        self._lock = threading.Lock()

    def open(self, options: ZenohOptions) -> zenoh.Session:
        """Open the session; blocks for as long as it takes to connect.

        Raises:
            ZenohError: an endpoint cannot be used.
        """
        config = configuration(options)
        # Before it is open, lest an exception between the two leave it so.
        atexit.register(self.close)
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            atexit.unregister(self.close)
            raise ZenohError(_cannot_open(options)) from error
        return self._session

    def close(self) -> None:
        """Close the session, and with it what was declared; from any thread.

        Blocks for a moment; for three seconds when a connected process cannot be reached. Zenoh would wait
        for ten, for the link to take the goodbye.
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


#: Runs a call on the graph's thread, soon and in order.
RunOnGraph = Callable[[Callable[[], None]], None]
