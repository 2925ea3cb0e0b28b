"""Type variables that programs import from rclpy's modules for annotations."""

from __future__ import annotations

from typing import Any, TypeVar

MsgType = TypeVar("MsgType")
SrvType = TypeVar("SrvType")
SrvTypeRequest = TypeVar("SrvTypeRequest")
SrvTypeResponse = TypeVar("SrvTypeResponse")
WaitableEntityType = TypeVar("WaitableEntityType", bound=Any)
