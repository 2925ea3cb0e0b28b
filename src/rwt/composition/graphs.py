"""Graph and interfaces of a server, from its settings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypeAlias

from rwt.access.settings import SettingsError
from rwt.composition.starting import loaded
from rwt.declarations import GraphContext, GraphPart
from rwt.settings.models import MEMORY, Settings, default_distro, distro_of_graph, name_of_graph
from rwt_graph.memory.graph import MemoryGraph
from rwt_interfaces.distro import DISTROS, JAZZY, NOETIC
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.registry import Registry

if TYPE_CHECKING:
    from rwt.declarations import WorkerContext
    from rwt_graph.api import Graph
    from rwt_graph.clock import Clock

MakeGraph: TypeAlias = "Callable[[Registry, Clock | None], Graph]"
"""Factory of the graph of a server, such as :class:`~rwt_graph.memory.graph.MemoryGraph`."""


def _part_of(graph: str) -> GraphPart | None:
    """Return the declaration of a value of the setting `graph`; None for the graph of this process."""
    return None if graph == MEMORY else loaded("graph", name_of_graph(graph), "graph", GraphPart)


def make_registry(settings: Settings) -> Registry:
    """Return the interfaces of a distribution, and of the folders in the settings. Raises SettingsError."""
    registry = Registry(DISTROS[settings.distro])
    part = _part_of(settings.graph)
    if part is not None and part.add_interfaces is not None:
        part.add_interfaces(registry)
    for folder in settings.interfaces:
        try:
            registry.add_directory(folder)
        except (InterfaceError, OSError) as error:
            raise SettingsError(f"`interfaces`: {error}") from error
    # At startup: otherwise the first message of a broken type would fail.
    try:
        registry.verify()
    except InterfaceError as error:
        raise SettingsError(f"`interfaces`: {error}") from error
    return registry


def make_graph(
    settings: Settings,
    make: MakeGraph | None,
    registry: Registry | None,
    clock: Clock | None,
    worker: WorkerContext | None,
) -> Graph:
    """Return the graph of the settings, not entered; `make` replaces the setting `graph`.

    Raises:
        SettingsError: its extra is not installed, or the settings contradict each other.
        GraphError: the options of the graph cannot be used.
    """
    if registry is None:
        registry = make_registry(settings)
    else:
        _check_registry(registry, settings)
    part = _part_of(settings.graph)
    if part is None:
        return (make or MemoryGraph)(registry, clock)
    if make is not None:
        raise SettingsError(f"`graph`: {settings.graph!r}, but {make!r} makes the graph; leave out one")
    context = GraphContext(registry, clock, settings.graph, worker, settings.workers)
    return part.make(context, settings.of(part.settings))


def bridged_graphs(settings: Settings, first: Graph) -> Iterator[Graph]:
    """Yield the graphs of the setting `bridge`, not entered; those of one distribution share types.

    Raises:
        SettingsError: see :func:`make_graph`.
    """
    for name in settings.bridge:
        required = distro_of_graph(name)
        if not required and first.distro is NOETIC:
            required = default_distro(name) or JAZZY.name
        distro = DISTROS[required] if required else first.distro
        # Without `bridge`, which is a setting of the first graph.
        other = settings.model_copy(update={"graph": name, "distro": distro.name, "bridge": ()})
        yield make_graph(other, None, first.registry if distro is first.distro else None, None, None)


def relay_between(first: Graph, second: Graph) -> Callable[[], None]:
    """Relay between two graphs until the returned function is called."""
    from rwt_graph.bridge import GraphBridge  # Imported only if configured.

    bridge = GraphBridge(first, second)
    bridge.open()
    return bridge.close


def check_graph(graph: Graph, settings: Settings, registry: Registry | None, clock: Clock | None) -> None:
    """Raise SettingsError if an existing graph contradicts the other settings."""
    if registry is not None or clock is not None:
        raise SettingsError("registry, clock: the given graph has its own; leave them out")
    _check_registry(graph.registry, settings)
    of_graphs = [each.key for each in type(settings).tables if each.kind == "graph"]
    if settings.graph != MEMORY or of_graphs:
        names = ", ".join(f"`{name}`" for name in ("graph", *of_graphs))
        raise SettingsError(f"{names}: cannot change the given graph; leave out the settings, or the graph")


def _check_registry(registry: Registry, settings: Settings) -> None:
    spoken = registry.distro.name
    is_set = "distro" in settings.model_fields_set and settings.distro != default_distro(settings.graph)
    if is_set and settings.distro != spoken:
        raise SettingsError(
            f"`distro`: {settings.distro!r}, but the given graph or registry is of {spoken!r}; leave out one"
        )
    if settings.interfaces:
        raise SettingsError(
            "`interfaces`: cannot be added to the given graph or registry; give them to"
            " `registry.add_directory`, or leave out the graph or registry"
        )
