"""Declaration of the supervisor of worker processes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import anyio

from rwt.declarations import InWorker, ServeAsWorker, SupervisorPart

if TYPE_CHECKING:
    from rwt.settings.models import Settings


def _run(
    settings: Settings, serve: ServeAsWorker, announce: Callable[[str], None], in_worker: InWorker | None
) -> int:
    from rwt.extensions.workers.worker import run_workers

    return run_workers(settings, serve, announce, in_worker)


async def _parent_ended() -> None:
    from rwt.extensions.workers.supervisor import parent_sentinel

    await anyio.wait_readable(parent_sentinel())


PART = SupervisorPart(
    summary="several processes that serve the same ports", run=_run, parent_ended=_parent_ended
)
