"""Graph and interfaces of a server, from its settings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import ModuleType
from typing import TYPE_CHECKING, TypeAlias

from rwt.access.settings import SettingsError
from rwt.composition.extensions import extension_for
from rwt.settings.models import GRAPHS, ROS1_GRAPHS, Settings
from rwt_graph.memory.graph import MemoryGraph
from rwt_interfaces.distro import DISTROS, JAZZY, NOETIC
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.registry import Registry

if TYPE_CHECKING:
    from rwt.extensions.workers.worker import WorkerContext
    from rwt_graph.api import Graph
    from rwt_graph.clock import Clock

MakeGraph: TypeAlias = "Callable[[Registry, Clock | None], Graph]"
"""Factory of the graph of a server, such as :class:`~rwt_graph.memory.graph.MemoryGraph`."""


def make_registry(settings: Settings) -> Registry:
    """Return the interfaces of a distribution, and of the folders in the settings. Raises SettingsError."""
    registry = Registry(DISTROS[settings.distro])
    if settings.graph == "ros2":
        _ros2().add_installed(registry)
    for folder in settings.interfaces:
        try:
            registry.add_directory(folder)
        except (InterfaceError, OSError) as error:
            raise SettingsError(f"`interfaces`: {error}") from error
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
        GraphError: Zenoh's options cannot be used.
    """
    if registry is None:
        registry = make_registry(settings)
    else:
        _check_registry(registry, settings)
    zenoh = settings.zenoh
    is_ros1 = settings.graph.partition(":")[0] in ROS1_GRAPHS
    if (is_ros1 or settings.graph in ("memory", "ros2")) and (zenoh.listen or zenoh.connect):
        raise SettingsError(
            '`zenoh`: to join other processes over Zenoh, give --graph zenoh too, or `graph = "zenoh"`'
        )
    if settings.graph == "memory":
        return (make or MemoryGraph)(registry, clock)
    if make is not None:
        raise SettingsError(f"`graph`: {settings.graph!r}, but {make!r} makes the graph; leave out one")
    if settings.graph == "ros2":
        joined: Graph = _ros2().Ros2Graph(
            registry, clock, use_sim_time=settings.ros2.use_sim_time, remap=settings.ros2.remap
        )
        return joined
    if is_ros1:
        from rwt.extensions.ros1 import Ros1Graph  # Imported only if configured.

        return Ros1Graph(registry, clock, master=settings.graph if settings.graph != "ros1" else None)
    if settings.graph != "zenoh":
        # An entry point is a factory, like the argument `graph` of `Server`.
        make = extension_for("graph", "rwt.graphs", settings.graph, GRAPHS)
        return make(registry, clock)
    try:
        from rwt.extensions.zenoh import ZenohGraph, ZenohOptions  # Optional: imported only if configured.
    except ImportError as error:
        raise SettingsError(
            "`graph`: the graph over Zenoh needs more packages: pip install 'robot-web-tools[zenoh]'"
        ) from error
    options = ZenohOptions(
        zenoh.listen, zenoh.connect, zenoh.mode, zenoh.multicast, zenoh.config, zenoh.domain
    )
    if worker is not None:
        from rwt.extensions.zenoh.worker_mesh import mesh_options

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


def bridged_graphs(settings: Settings, first: Graph) -> Iterator[Graph]:
    """Yield the graphs of the setting `bridge`, not entered; those of one distribution share types.

    Raises:
        SettingsError: see :func:`make_graph`.
    """
    for name in settings.bridge:
        is_ros1 = name.partition(":")[0] in ROS1_GRAPHS
        distro = NOETIC if is_ros1 else JAZZY if first.distro is NOETIC else first.distro
        other = settings.model_copy(update={"graph": name, "distro": distro.name, "bridge": ()})
        yield make_graph(other, None, first.registry if distro is first.distro else None, None, None)


def relay_between(first: Graph, second: Graph) -> Callable[[], None]:
    """Relay between two graphs until the returned function is called."""
    from rwt_graph.bridge import GraphBridge  # Imported only if configured.

    bridge = GraphBridge(first, second)
    bridge.open()
    return bridge.close


def _ros2() -> ModuleType:
    try:
        import rwt.extensions.ros2  # Needs ROS 2, imported only if configured.
    except ImportError as error:
        raise SettingsError(
            f"`graph`: ROS 2 is not available ({error}): source its setup.bash, for example that in"
            " /opt/ros/jazzy, and use its Python"
        ) from error
    return rwt.extensions.ros2


def check_graph(graph: Graph, settings: Settings, registry: Registry | None, clock: Clock | None) -> None:
    """Raise SettingsError if an existing graph contradicts the other settings."""
    if registry is not None or clock is not None:
        raise SettingsError("registry, clock: the given graph has its own; leave them out")
    _check_registry(graph.registry, settings)
    if settings.graph != "memory" or "zenoh" in settings.model_fields_set:
        raise SettingsError(
            "`graph`, `zenoh`: cannot change the given graph; leave out the settings, or the graph"
        )


def _check_registry(registry: Registry, settings: Settings) -> None:
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
