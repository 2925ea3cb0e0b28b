"""Warnings of robot programs: to the log, and to `/rosout` for clients."""

from __future__ import annotations

import logging
from typing import Final

from rwt_participant.api import RobotApi
from rwt_participant.errors import RobotError

logger: Final = logging.getLogger("rwt_lerobot")

ROSOUT: Final = "/rosout"
LOG_TYPE: Final = "rcl_interfaces/Log"
WARN: Final = 30
"""Level of a warning in `rcl_interfaces/Log`."""


def warn(api: RobotApi, name: str, text: str) -> None:
    """Log a warning, and publish it on `/rosout`.

    Args:
        api: node or client that publishes it.
        name: name of the program.
        text: the warning.
    """
    logger.warning("%s", text)
    try:
        api.publish(ROSOUT, {"level": WARN, "name": name, "msg": text}, LOG_TYPE)
    except RobotError as error:  # Without a connection, the log is the only place.
        logger.warning("the warning was not published: %s", error)
