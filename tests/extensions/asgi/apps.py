"""Apps that ASGI servers run in the tests: the robot alone, and mounted in FastAPI and in Starlette."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI
from starlette.applications import Starlette
from starlette.routing import Mount

from rwt import LATCHED, Server

robot = Server(web={"enabled": False}, max_message_size=100_000)
node = robot.node("robot")
node.advertise("/label", "std_msgs/String", qos=LATCHED).publish({"data": "it is here"})
node.advertise_service(
    "/add", "example_interfaces/AddTwoInts", lambda request: {"sum": request.a + request.b}
)

alone = robot.asgi()


@asynccontextmanager
async def lifespan(app: object) -> AsyncIterator[None]:
    """The robot lives as long as the app."""
    async with robot:
        yield


fastapi = FastAPI(lifespan=lifespan)
fastapi.mount("/shop/robot", alone)


@fastapi.get("/shop")
def shop() -> dict[str, str]:
    """A page of the app's own."""
    return {"label": "shop"}


starlette = Starlette(lifespan=lifespan, routes=[Mount("/shop/robot", app=alone)])
