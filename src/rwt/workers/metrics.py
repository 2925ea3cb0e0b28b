"""The metrics of all workers, whichever of them is asked.

Each offers its own to the others at a Unix socket in the folder that they share; who is asked by HTTP asks
the others and puts the pages together, each sample with a label `worker`.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

import anyio
from anyio.abc import SocketStream

from rwt.observability.prometheus import PrometheusText, merged

#: How long another may take; one that takes longer, or that is being started again, is left out.
_PATIENCE: Final = 1.0


class WorkerMetrics:
    """One worker's part.

    Args:
        folder: where the sockets are; nobody else may enter it.
        number: this worker's, from 1.
        count: how many there are.
    """

    def __init__(self, folder: Path, number: int, count: int) -> None:
        self._folder = folder
        self._number = number
        self._count = count

    @asynccontextmanager
    async def serve(self, own: Callable[[], bytes]) -> AsyncIterator[None]:
        """Let the others ask for `own` within the block."""
        path = self._path(self._number)
        path.unlink(missing_ok=True)  # Of a worker that was killed.

        async def tell(stream: SocketStream) -> None:
            async with stream:
                try:
                    await stream.send(own())
                except anyio.BrokenResourceError:
                    return  # Who asked has lost patience.

        async with (
            await anyio.create_unix_listener(path) as listener,
            anyio.create_task_group() as tasks,
        ):
            tasks.start_soon(listener.serve, tell)
            yield
            tasks.cancel_scope.cancel()

    async def gather(self, own: bytes) -> bytes:
        """The metrics of all, and which of them have answered."""
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
        with anyio.move_on_after(_PATIENCE):
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
