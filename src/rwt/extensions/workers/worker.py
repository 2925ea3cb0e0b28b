"""Setting `workers`: processes that serve the same ports, with one graph over Zenoh."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import anyio

from rwt import parts
from rwt.access.settings import SettingsError
from rwt.declarations import InWorker, NodePart, Part, ServeAsWorker, ServicePart, WorkerContext
from rwt.extensions.workers.metrics import WorkerMetrics
from rwt.extensions.workers.supervisor import Announce, Supervisor, parent_lives
from rwt.extensions.zenoh.part import NAME as ZENOH
from rwt.settings.models import Settings
from rwt.tls.tls import server_tls
from rwt_interfaces.distro import DISTROS
from rwt_transports.shared_port import HeldPort, can_share, hold_port

if TYPE_CHECKING:
    from ssl import SSLContext


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
    metrics = WorkerMetrics(folder, number, settings.workers)
    worker = WorkerContext(number, folder, announce, metrics.serve, metrics.gather)
    try:
        return in_worker(number, partial(serve, worker, _share(settings, shared, number)))
    finally:
        if not parent_lives():
            # It was killed, and cannot clean up.
            shutil.rmtree(folder, ignore_errors=True)


def _runs_on_every_worker(part: Part) -> bool:
    return isinstance(part, NodePart | ServicePart) and part.on_every_worker


def _share(settings: Settings, shared: frozenset[str], number: int) -> Settings:
    """Return the settings of a worker: the first gets all, the others what may exist several times."""
    if number == 1:
        return settings.model_copy(update={"graph": ZENOH})
    active = settings.active("node", "service")
    once = {key for each, _ in active if not _runs_on_every_worker(each.part) for key in each.keys}
    rest = {name: getattr(settings, name) for name in settings.model_fields_set if name not in once}
    listen = tuple(url for url in settings.listen if url in shared)
    nodes = tuple(name for name in settings.nodes if _runs_on_every_worker(parts.load("node", name)))
    return Settings(**rest).model_copy(update={"graph": ZENOH, "listen": listen, "nodes": nodes})
