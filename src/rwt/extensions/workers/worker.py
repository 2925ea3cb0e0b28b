"""Setting `workers`: processes that serve the same ports, with one graph over Zenoh."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import anyio

from rwt.access.settings import SettingsError
from rwt.composition.nodes import ON_EVERY_WORKER
from rwt.extensions.workers.metrics import WorkerMetrics
from rwt.extensions.workers.supervisor import Announce, Supervisor, parent_lives
from rwt.tls.tls import server_tls
from rwt_interfaces.distro import DISTROS
from rwt_transports.shared_port import HeldPort, can_share, hold_port

if TYPE_CHECKING:
    from ssl import SSLContext

    from rwt.settings.models import Settings


@dataclass(frozen=True, slots=True)
class WorkerContext:
    """Context of one worker.

    Attributes:
        number: number from 1; the first worker also runs what must exist only once.
        folder: folder of the workers' sockets, accessible only to this user.
        announce: called once with the announcement, when clients can connect.
    """

    number: int
    folder: Path
    metrics: WorkerMetrics
    announce: Announce


ServeAsWorker: TypeAlias = "Callable[[WorkerContext, Settings], None]"
"""Serves as one worker until it ends."""

InWorker = Callable[[int, Callable[[], None]], int]
"""Body of a worker process, given its number and a function that serves; returns the exit code."""


def run_workers(
    settings: Settings, serve: ServeAsWorker, announce: Announce, in_worker: InWorker | None = None
) -> int:
    """Run the supervisor: bind the ports, start the workers, announce, watch. Returns the exit code.

    Raises:
        SettingsError: the settings do not allow several processes, or the certificate is invalid.
        TransportError: an address is not available.
    """
    _check(settings)
    tls = server_tls(settings.tls)
    with ExitStack() as stack:
        # Only for this user. Its path is short, because paths of sockets are limited.
        temporary = tempfile.TemporaryDirectory(prefix="rwt-", ignore_cleanup_errors=True)
        folder = Path(stack.enter_context(temporary))
        shared, urls = stack.enter_context(_held(settings, tls))
        settings = settings.model_copy(update={"listen": urls})
        work = partial(_work, settings, shared, folder, serve, in_worker or _plainly)
        # A worker may take time to end: for its clients, its graph, and a busy machine.
        return Supervisor(settings.workers, work, settings.limits.close_seconds + 10.0).run(announce)


def _plainly(number: int, serve: Callable[[], None]) -> int:
    serve()
    return 0


def _check(settings: Settings) -> None:
    if sys.platform != "linux":
        raise SettingsError("`workers`: needs Linux, which spreads clients over processes; use 1")
    if not DISTROS[settings.distro].joins_over_zenoh:
        raise SettingsError(
            f"`workers`: need ROS 2: a graph of {settings.distro} cannot be joined over Zenoh; use 1"
        )
    if "stdio:" in (url.lower() for url in settings.listen):
        raise SettingsError("`workers`: stdio: has one client, which one process serves; use 1")


@contextmanager
def _held(settings: Settings, tls: SSLContext | None) -> Iterator[tuple[frozenset[str], tuple[str, ...]]]:
    """Bind the shared ports; yield their URLs, and all URLs, with the actual ports."""
    held: list[HeldPort] = []
    urls = []
    try:
        for url in settings.listen:
            if can_share(url, tls):
                held.append(anyio.run(hold_port, url, tls))
                url = held[-1].url
            urls.append(url)
        yield frozenset(each.url for each in held), tuple(urls)
    finally:
        for each in held:
            each.close()


def _work(
    settings: Settings,
    shared: frozenset[str],
    folder: Path,
    serve: ServeAsWorker,
    in_worker: InWorker,
    number: int,
    announce: Announce,
) -> int:
    worker = WorkerContext(number, folder, WorkerMetrics(folder, number, settings.workers), announce)
    try:
        return in_worker(number, partial(serve, worker, _share(settings, shared, number)))
    finally:
        if not parent_lives():
            # It was killed, and cannot clean up.
            shutil.rmtree(folder, ignore_errors=True)


def _share(settings: Settings, shared: frozenset[str], number: int) -> Settings:
    """Return the settings of a worker: the first gets all, the others what may exist several times."""
    if number == 1:
        return settings.model_copy(update={"graph": "zenoh"})
    return settings.model_copy(
        update={
            "graph": "zenoh",
            "listen": tuple(url for url in settings.listen if url in shared),
            "dial": settings.dial.model_copy(update={"urls": ()}),
            "demo": False,
            "nodes": tuple(name for name in settings.nodes if name in ON_EVERY_WORKER),
        }
    )
