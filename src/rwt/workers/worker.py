"""Setting `workers`: processes that serve the same ports, with one graph over Zenoh and common metrics."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

import anyio
from anyio.abc import SocketStream

from rwt.access.settings import SettingsError
from rwt.composition.nodes import ON_EVERY_WORKER
from rwt.observability.prometheus import PrometheusText, merged
from rwt.tls.tls import server_tls
from rwt.workers.supervisor import Announce, Supervisor, parent_lives
from rwt_interfaces.distro import DISTROS
from rwt_transports.shared_port import HeldPort, can_share, hold_port

if TYPE_CHECKING:
    from ssl import SSLContext

    from rwt.settings.models import Settings


#: Timeout for one worker. A worker that is slower, or restarting, is left out.
_TIMEOUT_SECONDS: Final = 1.0


class WorkerMetrics:
    """Metrics exchange of one worker.

    Args:
        folder: folder of the sockets, accessible only to this user.
        number: number of this worker, from 1.
        count: number of workers.
    """

    def __init__(self, folder: Path, number: int, count: int) -> None:
        self._folder = folder
        self._number = number
        self._count = count

    @asynccontextmanager
    async def serve(self, own: Callable[[], bytes]) -> AsyncIterator[None]:
        """Serve `own` to the other workers within the block."""
        path = self._path(self._number)
        path.unlink(missing_ok=True)  # Left over from a killed worker.

        async def tell(stream: SocketStream) -> None:
            async with stream:
                try:
                    await stream.send(own())
                except anyio.BrokenResourceError:
                    return  # The other worker's timeout has expired.

        async with (
            await anyio.create_unix_listener(path) as listener,
            anyio.create_task_group() as tasks,
        ):
            tasks.start_soon(listener.serve, tell)
            yield
            tasks.cancel_scope.cancel()

    async def gather(self, own: bytes) -> bytes:
        """Return the merged metrics, with `rwt_worker_up` for each worker."""
        pages: dict[int, bytes] = {self._number: own}
        async with anyio.create_task_group() as tasks:
            for number in range(1, self._count + 1):
                if number != self._number:
                    tasks.start_soon(self._ask, number, pages)
        present = PrometheusText()
        present.family(
            "rwt_worker_up", "gauge", "Whether a worker of this server answers.",
            [({"worker": str(number)}, int(number in pages)) for number in range(1, self._count + 1)],
        )  # fmt: skip
        return merged({str(number): pages[number] for number in sorted(pages)}, "worker") + present.text()

    async def _ask(self, number: int, pages: dict[int, bytes]) -> None:
        with anyio.move_on_after(_TIMEOUT_SECONDS):
            try:
                page = b""
                async with await anyio.connect_unix(self._path(number)) as stream:
                    async for part in stream:
                        page += part
            except (OSError, anyio.BrokenResourceError):
                return
            pages[number] = page

    def _path(self, number: int) -> Path:
        return self._folder / f"metrics-{number}"


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
