"""Contexts: init, shutdown, domains and signals."""

import os
import signal
import threading
import time
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Empty

from differential.steps import node, public, tell, wait


def init_twice() -> None:
    """Init, shutdown, and again."""
    tell("ok", rclpy.ok)
    tell("init", lambda: rclpy.init(args=[]) and None)
    tell("again", rclpy.init, args=[])
    tell("ok", rclpy.ok)
    tell("shutdown", rclpy.shutdown)
    tell("again", rclpy.shutdown)
    tell("try", rclpy.try_shutdown)
    tell("ok", rclpy.ok)
    tell("init", lambda: rclpy.init(args=[]) and None)
    tell("ok", rclpy.ok)
    rclpy.shutdown()


def before_init() -> None:
    """Calls before init."""
    tell("node", rclpy.create_node, "node")
    tell("shutdown", rclpy.shutdown)
    tell("executor", lambda: bool(SingleThreadedExecutor()))
    tell("now", lambda: rclpy.clock.Clock().now().nanoseconds > 0)
    tell("context", lambda: Context().ok())
    tell("domain", lambda: Context().get_domain_id())


def init_as_context_manager() -> None:
    """The block ends it."""
    with rclpy.init(args=[]) as begun:
        print(type(begun).__name__, rclpy.ok())
    print(rclpy.ok())


def own_context() -> None:
    """A context of its own."""
    context = Context()
    print(context.ok())
    rclpy.init(args=[], context=context)
    print(context.ok(), rclpy.ok(), rclpy.ok(context=context))
    made = rclpy.create_node("node", context=context)
    print(made.context is context, context.get_domain_id() == int(os.environ["ROS_DOMAIN_ID"]))
    made.destroy_node()
    rclpy.shutdown(context=context)
    print(context.ok())
    tell("again", context.shutdown)
    tell("try", context.try_shutdown)
    tell("init", context.init)


def context_attributes() -> None:
    """Public attributes."""
    print(public(Context()))


def domains() -> None:
    """Domains."""
    for domain in (0, 96, -1, "1"):
        context = Context()
        tell(domain, lambda c=context, d=domain: c.init(args=[], domain_id=d) or c.get_domain_id())
        context.try_shutdown()


def shutdown_callbacks() -> None:
    """Callbacks of the shutdown."""
    context = Context()
    told: list[str] = []

    class Listener:
        """Has a method."""

        def method(self) -> None:
            """Tell."""
            told.append("method")

    listener = Listener()
    context.on_shutdown(lambda: told.append("function"))
    context.on_shutdown(listener.method)
    tell("wrong", context.on_shutdown, 1)
    rclpy.init(args=[], context=context)
    rclpy.shutdown(context=context)
    print(sorted(told))
    context.on_shutdown(lambda: told.append("late"))
    print(sorted(told))


def implementation() -> None:
    """The middleware."""
    print(type(rclpy.get_rmw_implementation_identifier()).__name__)
    print(rclpy.get_global_executor is not None)


def _interrupt(number: int, after: float = 0.3) -> None:
    threading.Timer(after, os.kill, (os.getpid(), number)).start()


def _spin_until(number: int) -> None:
    with node() as made:
        _interrupt(number)
        try:
            rclpy.spin(made)
        except BaseException as error:
            print(type(error).__name__)
        print(rclpy.ok())


def _end_by(number: int) -> None:
    rclpy.init(args=[])
    made = rclpy.create_node("node")
    _interrupt(number)
    rclpy.spin(made)


def interrupted_spin() -> None:
    """Ctrl-C during rclpy.spin."""
    _spin_until(signal.SIGINT)


def interrupted_program() -> None:
    """A program that Ctrl-C ends."""
    _end_by(signal.SIGINT)


def terminated_spin() -> None:
    """SIGTERM during rclpy.spin."""
    _spin_until(signal.SIGTERM)


def terminated_program() -> None:
    """A program that SIGTERM ends."""
    _end_by(signal.SIGTERM)


def interrupted_executors() -> None:
    """Ctrl-C during an executor's spin."""
    for kind in (SingleThreadedExecutor, MultiThreadedExecutor):
        with node() as made:
            executor = kind()
            executor.add_node(made)
            _interrupt(signal.SIGINT)
            try:
                executor.spin()
            except BaseException as error:
                print(type(error).__name__)
            print(rclpy.ok())


def interrupted_callback() -> None:
    """Ctrl-C during a callback."""
    with node() as made:

        def callback() -> None:
            time.sleep(1.0)
            print("the callback ended")

        made.create_timer(0.1, callback)
        _interrupt(signal.SIGINT, 0.5)
        try:
            rclpy.spin(made)
        except BaseException as error:
            print(type(error).__name__)


def interrupted_wait_for_service() -> None:
    """Ctrl-C while a program waits for a service."""
    with node() as made:
        client = made.create_client(Empty, "service")
        _interrupt(signal.SIGINT)
        try:
            print(client.wait_for_service(5))
        except BaseException as error:
            print(type(error).__name__)


def interrupted_without_handlers() -> None:
    """Ctrl-C when rclpy handles no signals."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    made = rclpy.create_node("node")
    _interrupt(signal.SIGINT)
    try:
        rclpy.spin(made)
    except BaseException as error:
        print(type(error).__name__)
    print(rclpy.ok())
    made.destroy_node()
    rclpy.shutdown()


def handler_options() -> None:
    """Handlers that are installed."""
    from rclpy.signals import get_current_signal_handlers_options as current

    print(current())
    rclpy.init(args=[])
    print(current())
    rclpy.shutdown()
    print(current())
    rclpy.signals.install_signal_handlers(SignalHandlerOptions.SIGINT)
    print(current())
    rclpy.signals.uninstall_signal_handlers()
    print(current())
    print(sorted(SignalHandlerOptions.__members__.items()))


def external_shutdown() -> None:
    """A shutdown in another thread during a spin."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        threading.Timer(0.3, rclpy.shutdown).start()
        try:
            executor.spin()
        except ExternalShutdownException:
            print("ExternalShutdownException")
        print(rclpy.ok())


def without_shutdown() -> None:
    """A program that ends without shutdown."""
    rclpy.init(args=[])
    rclpy.create_node("node")
    print("end")


def exception_ends_the_program() -> None:
    """An uncaught exception."""
    rclpy.init(args=[])
    made = rclpy.create_node("node")

    def fail() -> Any:
        raise ZeroDivisionError("timer")

    made.create_timer(0.05, fail)
    rclpy.spin(made)


def rate_interrupted() -> None:
    """Shutdown while a thread sleeps at a rate."""
    with node() as made:
        rate = made.create_rate(0.1)
        told: list[str] = []

        def sleep() -> None:
            try:
                rate.sleep()
            except Exception as error:
                told.append(type(error).__name__)

        thread = threading.Thread(target=sleep, daemon=True)
        thread.start()
        wait(lambda: False, 0.2)
        rclpy.shutdown()
        thread.join(3)
        print(told, thread.is_alive())
