"""`rwt serve --workers N`: N processes on the same ports, with one graph over Zenoh."""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import anyio

from rwt.nodes import ON_EVERY_WORKER
from rwt.workers.metrics import WorkerFigures
from rwt.workers.supervisor import Say, Supervisor, parent_lives
from rwt_access.tls import server_tls
from rwt_cli.console.logs import name_worker
from rwt_cli.console.output import reported
from rwt_cli.errors import CommandError
from rwt_interfaces.distro import DISTROS
from rwt_transports.shared_port import HeldPort, can_share, hold_port

if TYPE_CHECKING:
    from ssl import SSLContext

    from rwt.settings.models import Settings


@dataclass(frozen=True, slots=True)
class Seat:
    """What one worker has for itself.

    Attributes:
        number: from 1; the first is also the home of what there can be only once.
        folder: where the workers have their sockets, for this user only.
        figures: the metrics of all.
        say: called with the announcement when clients can come.
    """

    number: int
    folder: Path
    figures: WorkerFigures
    say: Say


Serve = Callable[["Settings", Seat], None]
"""Serves as one worker until it is told to end."""


def serve_by_workers(settings: Settings, arguments: argparse.Namespace, serve: Serve) -> int:
    """Run the parent: hold the ports, start the workers, announce, watch; returns the exit code.

    Raises:
        CommandError: what was asked for cannot be shared among processes.
        TransportError: an address cannot be had.
        SettingsError: the certificate cannot be used.
    """
    _check(settings, arguments)
    tls = server_tls(settings.tls)
    with ExitStack() as stack:
        folder = stack.enter_context(_folder())
        shared, urls = stack.enter_context(_held(settings, tls))
        work = partial(_work, settings.model_copy(update={"listen": urls}), shared, folder, serve)
        return Supervisor(settings.workers, work, _patience(settings)).run(partial(print, flush=True))


def _patience(settings: Settings) -> float:
    """How long a worker may take to end: its clients, its graph, and a busy machine."""
    return settings.limits.close_seconds + 10.0


def _check(settings: Settings, arguments: argparse.Namespace) -> None:
    """Refuse what several processes cannot do together."""
    for option in ("script", "record", "introspection"):
        if getattr(arguments, option):
            raise CommandError(
                f"--{option} sees one process only: use it without --workers, or `rwt record` beside them",
                exit_code=2,
            )
    if sys.platform != "linux":
        raise CommandError("--workers needs Linux, which spreads clients over processes", exit_code=2)
    if not DISTROS[settings.distro].joins_over_zenoh:
        raise CommandError(
            f"--workers needs ROS 2: a graph of {settings.distro} cannot be joined over Zenoh", exit_code=2
        )
    if "stdio:" in (url.lower() for url in settings.listen):
        raise CommandError("stdio: has one client, which one process serves: no --workers", exit_code=2)


@contextmanager
def _folder() -> Iterator[Path]:
    """A folder that only this user may enter; its path is short, as those of sockets must be."""
    folder = Path(tempfile.mkdtemp(prefix="rwt-"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _held(settings: Settings, tls: SSLContext | None) -> Iterator[tuple[frozenset[str], tuple[str, ...]]]:
    """Hold the ports that workers share; the URLs of these, and all URLs, with the ports that there are."""
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
    settings: Settings, shared: frozenset[str], folder: Path, serve: Serve, number: int, say: Say
) -> int:
    """In a child: serve as worker `number`; returns the exit code."""
    name_worker(number)
    seat = Seat(number, folder, WorkerFigures(folder, number, settings.workers), say)
    try:
        return reported(lambda: serve(_share(settings, shared, number), seat))
    finally:
        if not parent_lives():
            # It was killed, and cannot tidy up.
            shutil.rmtree(folder, ignore_errors=True)


def _share(settings: Settings, shared: frozenset[str], number: int) -> Settings:
    """What of the settings a worker does: the first all of it, the others what can be done by many."""
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


__all__ = ["Seat", "Serve", "serve_by_workers"]
