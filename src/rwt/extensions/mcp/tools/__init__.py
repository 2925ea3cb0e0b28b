"""Tools of agents: one row each in one table."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

from rwt.extensions.mcp.tools.acting import CALL_SERVICE, PUBLISH, SET_PARAMETER
from rwt.extensions.mcp.tools.goals import CANCEL_GOAL, CHECK_GOAL, SEND_GOAL
from rwt.extensions.mcp.tools.listing import DESCRIBE_TYPE, LIST_ROBOT
from rwt.extensions.mcp.tools.reading import GET_PARAMETER, READ_TOPIC, WAIT_FOR, WATCH_NUMBERS
from rwt.extensions.mcp.tools.recorded import DESCRIBE_RECORDING, READ_RECORDING
from rwt.extensions.mcp.tools.tool import Tool
from rwt.extensions.mcp.tools.transforms import LIST_FRAMES, LOOK_UP_TRANSFORM

TOOLS: Final[Mapping[str, Tool[Any]]] = MappingProxyType(
    {
        tool.name: tool
        for tool in (
            LIST_ROBOT,
            DESCRIBE_TYPE,
            READ_TOPIC,
            WATCH_NUMBERS,
            WAIT_FOR,
            GET_PARAMETER,
            LIST_FRAMES,
            LOOK_UP_TRANSFORM,
            DESCRIBE_RECORDING,
            READ_RECORDING,
            PUBLISH,
            CALL_SERVICE,
            SET_PARAMETER,
            SEND_GOAL,
            CHECK_GOAL,
            CANCEL_GOAL,
        )
    }
)
"""Every tool by its name, in the order in which they are listed."""
