"""Release of rclpy that programs run with.

Kilted differs from Jazzy in names (`TimerInfo`, content filters, nodes, endpoints and timers in ``with``
statements, `create_future` of executors), in the arithmetic of durations, in the order in which an executor
runs tasks, and in several errors. Code that follows the release asks :data:`FROM_KILTED`.
"""

from __future__ import annotations

import os
from typing import Final

#: True on Kilted and later releases, by ROS_DISTRO, which `rwt run --distro` sets; the default is Jazzy.
FROM_KILTED: Final = os.environ.get("ROS_DISTRO") in ("kilted", "lyrical", "rolling")
