"""Settings of the HTTP gateway: the model alone."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from rwt.access.settings import MIB, Bytes, Count, Seconds, Table


class HttpSettings(Table):
    """The robot over plain HTTP, at `/api`."""

    wait_seconds: Annotated[
        Seconds, Field(description="longest time that a request may wait for a message or an answer")
    ] = 60.0
    stream_bytes: Annotated[
        Bytes,
        Field(
            description="bytes that may wait for the reader of one stream of events; beyond it the oldest are"
            " dropped"
        ),
    ] = 4 * MIB
    goals: Annotated[
        Count,
        Field(
            description="goals that one role's clients of one address may have, those that have ended"
            " included: of these the oldest are forgotten first"
        ),
    ] = 100
    goal_seconds: Annotated[Seconds, Field(description="how long a goal that has ended can be asked for")] = (
        600.0
    )
