"""`rclpy.logging`."""

from rwt_rclpy.logs import output as _output
from rwt_rclpy.logs.logger import RcutilsLogger as RcutilsLogger
from rwt_rclpy.logs.logger import _root_logger as _root_logger
from rwt_rclpy.logs.logger import clear_config as clear_config
from rwt_rclpy.logs.logger import get_logger as get_logger
from rwt_rclpy.logs.logger import initialize as initialize
from rwt_rclpy.logs.logger import shutdown as shutdown
from rwt_rclpy.logs.output import LoggingSeverity as LoggingSeverity

get_logger_effective_level = _output.effective_level
get_logger_level = _output.get_level
get_logging_severity_from_string = _output.level_from_string
get_logging_directory = _output.logging_directory
set_logger_level = _output.set_level
