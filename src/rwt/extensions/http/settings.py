"""Settings of the HTTP gateway: the model alone."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from rwt.access.settings import MIB, Bytes, Count, Seconds, Table


class HttpSettings(Table):
    """The robot over plain HTTP, at `/api`."""

    wait_seconds: Annotated[
        Seconds,
        Field(description="longest time in seconds that a request may wait for a message or a response"),
    ] = 60.0
    stream_bytes: Annotated[
        Bytes,
        Field(
            description="bytes queued for the reader of one event stream; beyond it, the oldest events are"
            " dropped"
        ),
    ] = 4 * MIB
    goals: Annotated[
        Count,
        Field(
            description="goals of one role's clients of one address, including ended goals, of which the"
            " oldest are forgotten first"
        ),
    ] = 100
    goal_seconds: Annotated[
        Seconds,
        Field(description="seconds for which an ended goal, or call that required approval, can be queried"),
    ] = 600.0
