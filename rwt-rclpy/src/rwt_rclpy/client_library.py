"""The package `rclpy` itself: init, shutdown, nodes and the functions that spin."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Self

from rwt_rclpy.execution.context import Context, get_default_context
from rwt_rclpy.execution.signals import (
    SignalHandlerOptions,
    install_signal_handlers,
    uninstall_signal_handlers,
)
from rwt_rclpy.execution.task import Future
from rwt_rclpy.parameters.parameter import Parameter
from rwt_rclpy.release import FROM_KILTED

if TYPE_CHECKING:
    from rwt_rclpy.execution.executors import Executor
    from rwt_rclpy.nodes.node import Node

_global_executor: Executor | None = None


def init(
    *,
    args: Sequence[str] | None = None,
    context: Context | None = None,
    domain_id: int | None = None,
    signal_handler_options: SignalHandlerOptions | None = None,
) -> InitContextManager | None:
    """Initialise a context.

    Args:
        args: command line, `sys.argv` by default.
        context: context; the default one if None.
        domain_id: ROS domain; by default the value of ROS_DOMAIN_ID.
        signal_handler_options: signals that end it; by default both for the default context, none for others.

    Returns:
        Context manager that shuts it down, from ROS 2 Kilted on; None before.
    """
    default = get_default_context()
    context = default if context is None else context
    if signal_handler_options is None:
        signal_handler_options = SignalHandlerOptions.ALL if context is default else SignalHandlerOptions.NO
    context.init(args, domain_id=domain_id)
    install_signal_handlers(signal_handler_options)
    return InitContextManager(context) if FROM_KILTED else None


class InitContextManager:
    """Context manager that shuts down what `init` began."""

    def __init__(self, context: Context) -> None:
        self.context = context

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        if self.context is get_default_context():
            try_shutdown()
            uninstall_signal_handlers()
        else:
            self.context.try_shutdown()


def ok(*, context: Context | None = None) -> bool:
    """True while the context is initialised."""
    return (context or get_default_context()).ok()


def shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    """Shut down a context.

    Raises:
        RuntimeError: it is not initialised, or was shut down already.
    """
    default = context is None or context is get_default_context()
    (get_default_context(shutting_down=True) if default else context or get_default_context()).shutdown()
    if uninstall_handlers or (uninstall_handlers is None and default):
        uninstall_signal_handlers()


def try_shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    """Shut down a context, unless that was done already."""
    default = context is None or context is get_default_context()
    (get_default_context(shutting_down=True) if default else context or get_default_context()).try_shutdown()
    if uninstall_handlers or (uninstall_handlers is None and default):
        uninstall_signal_handlers()


def get_global_executor() -> Executor:
    """Return the executor that the functions of this module spin with."""
    global _global_executor
    if _global_executor is None:
        from rwt_rclpy.execution.executors import SingleThreadedExecutor

        _global_executor = SingleThreadedExecutor()

        def reset() -> None:
            global _global_executor
            if _global_executor is not None:
                _global_executor.shutdown(0)
                _global_executor = None

        get_default_context().on_shutdown(reset)
    return _global_executor


def create_node(node_name: str, **options: Any) -> Node:
    """Create a node; see :class:`rwt_rclpy.nodes.node.Node` for the arguments."""
    from rwt_rclpy.nodes.node import Node

    return Node(node_name, **options)


@contextmanager
def _executor_with(node: Node, executor: Executor | None) -> Iterator[Executor]:
    """Return an executor that has the node during the block."""
    chosen = get_global_executor() if executor is None else executor
    added = chosen.add_node(node)
    try:
        yield chosen
    finally:
        if added:
            chosen.remove_node(node)


def spin_once(node: Node, *, executor: Executor | None = None, timeout_sec: float | None = None) -> None:
    """Run one callback, waiting for one."""
    with _executor_with(node, executor) as chosen:
        chosen.spin_once(timeout_sec=timeout_sec)


def spin(node: Node, executor: Executor | None = None) -> None:
    """Run callbacks until the context ends.

    Raises:
        ExternalShutdownException: it was ended by a signal.
    """
    chosen = get_global_executor() if executor is None else executor
    chosen.add_node(node)
    try:
        while chosen.context.ok():
            chosen.spin_once()
    finally:
        chosen.remove_node(node)


def spin_until_future_complete(
    node: Node, future: Future, executor: Executor | None = None, timeout_sec: float | None = None
) -> None:
    """Run callbacks until a future is done, at most for some seconds."""
    with _executor_with(node, executor) as chosen:
        chosen.spin_until_future_complete(future, timeout_sec)


def get_rmw_implementation_identifier() -> str:
    """Return the identifier of the middleware: the graph of this project instead of an rmw."""
    return "rwt_graph"


def get_available_rmw_implementations() -> set[str]:
    """Return the identifiers of all available middleware."""
    return {"rwt_graph"}


def timeout_sec_to_nsec(timeout_sec: float | None) -> int:
    """Return seconds as whole nanoseconds; -1 for no timeout."""
    if timeout_sec is None or timeout_sec < 0:
        return -1
    return int(float(timeout_sec) * 1_000_000_000)


def remove_ros_args(args: Sequence[str] | None = None) -> list[str]:
    """Return the arguments of a command line that are not ROS's."""
    import sys

    from rwt_rclpy.names import arguments

    return arguments.remove_ros_args(sys.argv if args is None else args)


#: Marks a package, whose modules the import hook finds.
__path__: list[str] = []


def __getattr__(name: str) -> Any:
    from rwt_rclpy.modules import MODULES

    if f"rclpy.{name}" in MODULES:
        return importlib.import_module(MODULES[f"rclpy.{name}"])
    raise AttributeError(f"module 'rclpy' has no attribute {name!r}")


__all__ = ["Parameter", "create_node", "init", "ok", "shutdown", "spin", "spin_once", "try_shutdown"]
