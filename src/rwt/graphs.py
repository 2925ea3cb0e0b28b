"""Which graph a server stands in front of, and which interfaces it knows."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

from rwt_access.settings import SettingsError
from rwt_graph.memory.graph import MemoryGraph
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.registry import Registry

if TYPE_CHECKING:
    from rwt.settings.models import Settings
    from rwt.workers.worker import WorkerContext
    from rwt_graph.api import Graph
    from rwt_graph.clock import Clock

MakeGraph: TypeAlias = "Callable[[Registry, Clock | None], Graph]"
"""Makes the graph of a server, as the class :class:`~rwt_graph.memory.graph.MemoryGraph` does."""


def make_registry(settings: Settings) -> Registry:
    """The interfaces of a distribution, and those of the folders in the settings.

    Raises:
        SettingsError: a folder or a file in it cannot be used.
    """
    registry = Registry(DISTROS[settings.distro])
    for folder in settings.interfaces:
        try:
            registry.add_directory(folder)
        except (InterfaceError, OSError) as error:
            raise SettingsError(f"`interfaces`: {folder}: {error}") from error
    try:
        registry.verify()
    except InterfaceError as error:
        raise SettingsError(f"`interfaces`: {error}") from error
    return registry


def make_graph(
    settings: Settings, registry: Registry, clock: Clock | None, worker: WorkerContext | None
) -> MemoryGraph:
    """The graph that the settings ask for, not entered.

    Args:
        settings: of the server.
        registry: the interfaces.
        clock: None for the wall clock.
        worker: the worker process that it is for, whose graph is joined with those of the others.

    Raises:
        SettingsError: the extra for it is not installed, or it is to join others and to be alone.
        GraphError: Zenoh's options cannot be used.
    """
    zenoh = settings.zenoh
    if settings.graph == "memory":
        if zenoh.listen or zenoh.connect:
            raise SettingsError(
                '`zenoh`: to join other processes over Zenoh, give --graph zenoh too, or `graph = "zenoh"`'
            )
        return MemoryGraph(registry, clock)
    try:
        from rwt_graph.zenoh import ZenohGraph, ZenohOptions  # An extra: imported only where it is asked for.
    except ImportError as error:
        raise SettingsError(
            "`graph`: the graph over Zenoh needs more packages: pip install 'robot-web-tools[zenoh]'"
        ) from error
    options = ZenohOptions(
        zenoh.listen, zenoh.connect, zenoh.mode, zenoh.multicast, zenoh.config, zenoh.domain
    )
    if worker is not None:
        from rwt_graph.zenoh.worker_mesh import mesh_options

        options = mesh_options(options, worker.folder, worker.number, settings.workers)
    return ZenohGraph(
        registry,
        clock,
        listen=options.listen,
        connect=options.connect,
        mode=options.mode,
        multicast=options.multicast,
        config=options.config,
        domain=options.domain,
    )


def refuse_contradictions(settings: Settings, registry: Registry) -> None:
    """Check that interfaces which a program gives are those that the settings ask for.

    Raises:
        SettingsError: they are not.
    """
    spoken = registry.distro.name
    if "distro" in settings.model_fields_set and settings.distro != spoken:
        raise SettingsError(
            f"`distro`: {settings.distro!r}, but the given graph or registry is of {spoken!r}; leave out one"
        )
    if settings.interfaces:
        raise SettingsError(
            "`interfaces`: cannot be added to the given graph or registry; give them to"
            " `registry.add_directory`, or leave out the graph or registry"
        )


__all__ = ["MakeGraph", "make_graph", "make_registry", "refuse_contradictions"]
