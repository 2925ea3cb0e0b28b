"""`rclpy.logging`."""

from rwt_rclpy.logs.logger import RcutilsLogger as RcutilsLogger
from rwt_rclpy.logs.logger import _root_logger as _root_logger
from rwt_rclpy.logs.logger import clear_config as clear_config
from rwt_rclpy.logs.logger import get_logger as get_logger
from rwt_rclpy.logs.logger import initialize as initialize
from rwt_rclpy.logs.logger import shutdown as shutdown
from rwt_rclpy.logs.output import LoggingSeverity as LoggingSeverity
from rwt_rclpy.logs.output import effective_level as get_logger_effective_level  # noqa: F401 - rclpy's name
from rwt_rclpy.logs.output import get_level as get_logger_level  # noqa: F401 - rclpy's name
from rwt_rclpy.logs.output import level_from_string as get_logging_severity_from_string  # noqa: F401 - rclpy's name
from rwt_rclpy.logs.output import logging_directory as get_logging_directory  # noqa: F401 - rclpy's name
from rwt_rclpy.logs.output import set_level as set_logger_level  # noqa: F401 - rclpy's name
