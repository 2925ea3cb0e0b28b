"""Metrics of all workers, merged by the one that receives the request.

Each worker serves its own metrics on a Unix socket in a shared folder. The one that is asked over HTTP reads
the others' and labels each sample with `worker`.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

import anyio
from anyio.abc import SocketStream

from rwt.observability.prometheus import PrometheusText, merged

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
