"""Tools of agents: one row each in one table."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

from rwt.extensions.mcp.tools.acting import call_service, publish, set_parameter
from rwt.extensions.mcp.tools.goals import cancel_goal, check_goal, send_goal
from rwt.extensions.mcp.tools.listing import describe_type, list_robot
from rwt.extensions.mcp.tools.reading import get_parameter, read_topic, wait_for, watch_numbers
from rwt.extensions.mcp.tools.recorded import describe_recording, read_recording
from rwt.extensions.mcp.tools.tool import Tool
from rwt.extensions.mcp.tools.transforms import list_frames, look_up_transform

TOOLS: Final[Mapping[str, Tool[Any]]] = MappingProxyType(
    {
        tool.name: tool
        for tool in (
            list_robot,
            describe_type,
            read_topic,
            watch_numbers,
            wait_for,
            get_parameter,
            list_frames,
            look_up_transform,
            describe_recording,
            read_recording,
            publish,
            call_service,
            set_parameter,
            send_goal,
            check_goal,
            cancel_goal,
        )
    }
)
"""Every tool by its name, in the order in which they are listed."""
