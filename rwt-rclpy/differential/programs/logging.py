"""Loggers."""

import threading
import warnings
from typing import Any

import rclpy
import rclpy.logging
from rclpy.logging import LoggingSeverity, get_logger

from differential.steps import node, public, spinner, tell, with_logs


@with_logs
def severities() -> None:
    """Lines by severity."""
    logger = get_logger("name")
    print(logger.debug("debug"), logger.info("info"), logger.warning("warning"))
    print(logger.error("error"), logger.fatal("fatal"))


@with_logs
def levels() -> None:
    """Levels of a logger."""
    logger = get_logger("name")
    for level in LoggingSeverity.__members__.values():
        logger.set_level(level)
        print(
            level.name,
            logger.get_effective_level().name,
            [logger.is_enabled_for(each) for each in (10, 20, 50)],
        )
    logger.set_level(LoggingSeverity.DEBUG)
    logger.debug("now")
    tell("wrong", logger.set_level, 17)
    tell("text", logger.set_level, "DEBUG")


@with_logs
def children() -> None:
    """Levels are inherited."""
    parent = get_logger("parent")
    child = parent.get_child("child")
    parent.set_level(LoggingSeverity.ERROR)
    child.info("hidden")
    child.error("shown")
    child.set_level(LoggingSeverity.DEBUG)
    child.debug("shown")
    print(child.name, child.get_effective_level().name)
    tell("empty", parent.get_child, "")
    tell("none", parent.get_child, None)


@with_logs
def not_text() -> None:
    """Objects that are no strings."""
    logger = get_logger("name")
    for value in (1, None, [1, "a"], ValueError("a"), b"a", 1.5):
        tell(value, logger.info, value)


@with_logs
def percent_and_lines() -> None:
    """Text is logged as it is."""
    logger = get_logger("name")
    logger.info("100 %d %s {}")
    logger.info("first\nsecond")
    logger.info("")
    logger.info("ä")


@with_logs
def once() -> None:
    """Once for each call site."""
    logger = get_logger("name")
    for number in range(3):
        logger.info(f"once {number}", once=True)
        logger.info(f"first skipped {number}", skip_first=True)


@with_logs
def throttled() -> None:
    """At most once in a duration."""
    logger = get_logger("name")
    for number in range(3):
        logger.info(f"throttled {number}", throttle_duration_sec=10)
    tell("no duration", logger.info, "a", throttle_time_source_type="SYSTEM_TIME")
    tell("unknown", logger.info, "a", other=1)


@with_logs
def options_change_at_call_site() -> None:
    """A call site keeps its options and severity."""
    logger = get_logger("name")
    for severity in (LoggingSeverity.INFO, LoggingSeverity.ERROR):
        tell(severity.name, logger.log, "text", severity)
    for once_ in (False, True):
        tell(once_, logger.info, "text", once=once_)


@with_logs
def log_function() -> None:
    """The general function."""
    logger = get_logger("name")
    tell("info", logger.log, "a", LoggingSeverity.INFO)
    tell("number", logger.log, "a", 30)
    tell("wrong", logger.log, "a", 17)
    tell("no severity", logger.log, "a")


@with_logs
def deprecated() -> None:
    """Deprecated names warn."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        get_logger("name").warn("warn")
        print([each.category.__name__ for each in caught])


def severity_names() -> None:
    """Names and numbers of severities."""
    for each in LoggingSeverity.__members__.values():
        print(each.name, int(each), str(each))
    tell("get", rclpy.logging.get_logging_severity_from_string, "INFO")
    tell("lower case", rclpy.logging.get_logging_severity_from_string, "warn")
    tell("wrong", rclpy.logging.get_logging_severity_from_string, "NOTE")


def logger_levels_of_module() -> None:
    """Functions of the module."""
    print(
        rclpy.logging.get_logger_level("unknown").name,
        rclpy.logging.get_logger_effective_level("unknown").name,
    )
    tell("set", rclpy.logging.set_logger_level, "a", LoggingSeverity.ERROR)
    print(rclpy.logging.get_logger_level("a").name, rclpy.logging.get_logger_effective_level("a.b").name)
    tell("initialize", rclpy.logging.initialize)
    tell("shutdown", rclpy.logging.shutdown)
    tell("clear", rclpy.logging.clear_config)
    tell("directory", lambda: bool(rclpy.logging.get_logging_directory()))


@with_logs
def of_a_node() -> None:
    """The logger of a node."""
    with node("talker", namespace="/a/b") as made:
        made.get_logger().info("text")
        print(made.get_logger().name, type(made.get_logger()).__name__)
        made.get_logger().get_child("part").warning("text")


@with_logs
def levels_of_command_line() -> None:
    """--log-level."""
    rclpy.init(args=["--ros-args", "--log-level", "warn", "--log-level", "loud:=debug"])
    for name in ("quiet", "loud"):
        get_logger(name).debug("debug")
        get_logger(name).info("info")
        get_logger(name).warning("warning")
    rclpy.shutdown()


@with_logs
def no_console() -> None:
    """--disable-stdout-logs."""
    rclpy.init(args=["--ros-args", "--disable-stdout-logs"])
    get_logger("name").info("info")
    rclpy.shutdown()


def rosout() -> None:
    """Lines on /rosout."""
    from rcl_interfaces.msg import Log

    with node("talker") as made, spinner(made) as spin:
        told: list[Any] = []
        made.create_subscription(Log, "/rosout", told.append, 10)
        spin(seconds=0.3)
        made.get_logger().warning("text")
        made.get_logger().debug("hidden")
        get_logger("other").info("not of a node")
        made.get_logger().get_child("part").info("child")
        spin(lambda: len(told) == 2, 2)
        spin(seconds=0.1)
        for each in told:
            print(each.name, each.level, each.msg, each.file.rpartition("/")[2], each.function, each.line > 0)


def rosout_off() -> None:
    """Nodes without /rosout."""
    from rcl_interfaces.msg import Log

    with node("talker", enable_rosout=False) as made, spinner(made) as spin:
        told: list[Any] = []
        made.create_subscription(Log, "/rosout", told.append, 10)
        spin(seconds=0.2)
        made.get_logger().warning("text")
        spin(seconds=0.2)
        print(told)


def logger_attributes() -> None:
    """Public attributes."""
    print(public(get_logger("name")), get_logger("name") == get_logger("name"))
    print(get_logger("name").name)
    tell("empty", get_logger, "")
    tell("none", get_logger, None)


@with_logs
def from_a_thread() -> None:
    """Logging in a thread."""
    thread = threading.Thread(target=lambda: get_logger("name").info("thread"))
    thread.start()
    thread.join()


def logger_service() -> None:
    """Services for levels."""
    from rcl_interfaces.msg import LoggerLevel
    from rcl_interfaces.srv import GetLoggerLevels, SetLoggerLevels

    with node(enable_logger_service=True) as made, spinner(made) as spin:
        setter = made.create_client(SetLoggerLevels, "node/set_logger_levels")
        getter = made.create_client(GetLoggerLevels, "node/get_logger_levels")
        setter.wait_for_service(5)
        getter.wait_for_service(5)
        levels_ = [LoggerLevel(name="a", level=10), LoggerLevel(name="b", level=17)]
        future = setter.call_async(SetLoggerLevels.Request(levels=levels_))
        spin(future.done)
        print(future.result())
        future = getter.call_async(GetLoggerLevels.Request(names=["a", "b", "c"]))
        spin(future.done)
        print(future.result())
