"""The server under test: what `rwt serve` runs, with one service of a robot in the same process."""

from __future__ import annotations

from functools import partial
from typing import Any

from rwt import Server


def add_two_ints(request: Any) -> dict[str, object]:
    """`request` is a Struct of a type that is known at run time only."""
    return {"sum": request.a + request.b}


if __name__ == "__main__":
    server = Server("ws://127.0.0.1:0", nodes=("rosapi",))
    server.node("calculator").advertise_service(
        "/add_two_ints", "example_interfaces/AddTwoInts", add_two_ints
    )
    server.run(announce=partial(print, flush=True))
