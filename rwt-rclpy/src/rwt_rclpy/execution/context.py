"""`rclpy.context`: contexts between init and shutdown."""

from __future__ import annotations

import inspect
import os
import sys
import threading
import weakref
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Self

from rwt_rclpy.clocks.timekeeper import Waker
from rwt_rclpy.destroyable import Destroyable
from rwt_rclpy.exceptions import RCLError, RCLInvalidROSArgsError
from rwt_rclpy.middleware.link import DOMAINS, Link, domain_of
from rwt_rclpy.names.arguments import RosArguments, parse_arguments
from rwt_rclpy.names.validation import wrong_in_namespace
from rwt_rclpy.release import FROM_KILTED

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node

OnShutdown = Callable[[], object]


class ContextHandle(Destroyable):
    """State of an initialised context.

    Attributes:
        arguments: arguments of the command line for all nodes.
        domain: ROS domain.
        link: graph of that domain.
    """

    def __init__(self, arguments: RosArguments, domain: int) -> None:
        super().__init__()
        self.arguments = arguments
        self.domain = domain
        self.link: Link = DOMAINS.link(domain)
        self.valid = True

    def ok(self) -> bool:
        """True until the context is shut down."""
        return self.valid

    def get_domain_id(self) -> int:
        """The ROS domain."""
        return self.domain

    def shutdown(self) -> None:
        """End it."""
        self.valid = False


#: All initialised contexts, for signals.
_initialised: weakref.WeakSet[Context] = weakref.WeakSet()


class Context:
    """Context of nodes, from `init` to `shutdown`."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._callbacks: list[Callable[[], OnShutdown | None]] = []
        self._rwt_nodes: weakref.WeakSet[Node] = weakref.WeakSet()
        self._wakers: weakref.WeakSet[Waker] = weakref.WeakSet()
        self._handle: ContextHandle | None = None

    @property
    def handle(self) -> ContextHandle | None:
        """State; None before :meth:`init`."""
        return self._handle

    @property
    def _rwt_link(self) -> Link:
        """Return the graph of its domain. Raises RuntimeError before :meth:`init`."""
        if self._handle is None:
            raise RuntimeError("the context is not initialized: call rclpy.init() first")
        return self._handle.link

    def init(
        self,
        args: Sequence[str] | None = None,
        *,
        initialize_logging: bool = True,
        domain_id: int | None = None,
    ) -> None:
        """Begin.

        Args:
            args: command line, `sys.argv` by default.
            initialize_logging: True to apply ``--log-level`` of the command line.
            domain_id: ROS domain; by default the value of ROS_DOMAIN_ID.

        Raises:
            RuntimeError: it was initialised before, or the domain is negative.
            UnicodeEncodeError: an argument is not valid UTF-8.
            RCLError: the enclave's name is invalid, or the environment demands enclaves, which only DDS has.
            UnknownROSArgsError: an argument after ``--ros-args`` is unknown.
        """
        with self._lock:
            domain = domain_of(domain_id)
            if self._handle is not None:
                raise RuntimeError("Context.init() must only be called once")
            given = sys.argv if args is None else args
            for each in given:
                each.encode()  # With a wrong locale it contains surrogates, which are invalid in names.
            try:
                arguments = parse_arguments(given)
            except RCLInvalidROSArgsError as error:
                raise RCLError(
                    str(error)
                ) from error  # The program's arguments are rcl's, a node's are rclpy's.
            if wrong := wrong_in_namespace(arguments.enclave):
                raise RCLError(f"--enclave {arguments.enclave}: {wrong[0]}")
            arguments.refuse_unknown()
            config = arguments.log_config_file
            if config is not None and not config.is_file():
                raise RCLError(f"--log-config-file {config}: the file does not exist")
            _refuse_enclaves()
            self._handle = ContextHandle(arguments, domain)
            _initialised.add(self)
        if initialize_logging:
            from rwt_rclpy.logs import output

            output.configure(arguments)

    def ok(self) -> bool:
        """True while the context is initialised and not shut down."""
        handle = self._handle
        return handle is not None and handle.valid

    def _call_callbacks(self) -> None:
        callbacks, self._callbacks = self._callbacks, []
        for weak in callbacks:
            callback = weak()
            if callback is not None:
                callback()
        for node in tuple(self._rwt_nodes):
            node._rwt_context_ended()
        self._wake()

    def _wake(self) -> None:
        with self._lock:  # A copy, because threads that begin to wait change the set.
            wakers = tuple(self._wakers)
        for waker in wakers:
            waker.wake()

    def shutdown(self) -> None:
        """End it.

        Raises:
            RuntimeError: it is not initialised, or was shut down before.
        """
        with self._lock:
            if self._handle is None:
                raise RuntimeError("Context must be initialized before it can be shutdown")
            if not self._handle.valid:
                error = RuntimeError if FROM_KILTED else RCLError
                raise error("the context was shut down before; try_shutdown() does so only if needed")
            self._handle.shutdown()
        self._call_callbacks()

    def try_shutdown(self) -> None:
        """Shut down, unless that was done already."""
        with self._lock:
            if self._handle is None or not self._handle.valid:
                return
            self._handle.shutdown()
        self._call_callbacks()

    def _rwt_shutdown_by_signal(self) -> None:
        """Shut down from outside: spinning and waiting functions raise ExternalShutdownException."""
        if self._handle is not None:
            self._handle.shutdown()
        self._wake()

    def on_shutdown(self, callback: OnShutdown) -> None:
        """Call a function at shutdown; at once if that was done. Methods are referenced weakly.

        Raises:
            TypeError: it is not callable.
        """
        if not callable(callback):
            raise TypeError(f"callback should be a callable, got {type(callback)}")
        if self._handle is not None and not self._handle.valid:
            callback()
            return
        with self._lock:
            if inspect.ismethod(callback):
                method: weakref.WeakMethod[OnShutdown] = weakref.WeakMethod(callback, self._forget)
                self._callbacks.append(method)
            else:
                self._callbacks.append(lambda: callback)

    def _forget(self, weak: Callable[[], OnShutdown | None]) -> None:
        if weak in self._callbacks:
            self._callbacks.remove(weak)

    def _rwt_wake_on_end(self, waker: Waker) -> None:
        """Wake waiting threads when the context ends for any reason."""
        with self._lock:
            self._wakers.add(waker)

    def get_domain_id(self) -> int:
        """Return the ROS domain. Raises RuntimeError before :meth:`init`."""
        if self._handle is None:
            raise RuntimeError("Context must be initialized before it can have a domain id")
        return self._handle.domain

    def destroy(self) -> None:
        """Release the state."""
        if self._handle is not None:
            self._handle.destroy_when_not_in_use()

    def __enter__(self) -> Self:
        if self._handle is None:
            self.init()
        return self

    def __exit__(self, *exc: object) -> None:
        self.try_shutdown()


def _refuse_enclaves() -> None:
    """Reject a demand for encryption, which is not available here.

    ROS demands it by these two variables (https://design.ros2.org/articles/ros2_dds_security.html).
    """
    enabled = os.environ.get("ROS_SECURITY_ENABLE") == "true"
    if enabled and os.environ.get("ROS_SECURITY_STRATEGY") == "Enforce":
        raise RCLError(
            "ROS_SECURITY_STRATEGY=Enforce demands security enclaves, which are DDS's and not available here;"
            " unset it, and use TLS and tokens of rwt serve, or Zenoh's"
        )


def initialised_contexts() -> list[Context]:
    """Return all contexts that are initialised and not shut down."""
    return [context for context in tuple(_initialised) if context.ok()]


_default: Context | None = None
_default_lock = threading.Lock()


def get_default_context(*, shutting_down: bool = False) -> Context:
    """Return the context of `rclpy.init()`; a new one after the current one was shut down."""
    global _default
    with _default_lock:
        if _default is None:
            _default = Context()
        if shutting_down:
            old, _default = _default, None
            return old
        return _default
