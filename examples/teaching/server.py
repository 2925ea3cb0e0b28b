"""The server's side: one graph with a demo robot for each demonstrator."""

from __future__ import annotations

import signal
import time
from functools import partial
from multiprocessing.connection import Connection

import anyio
import anyio.to_thread

from rwt import Server
from rwt.extensions.demo import DemoRobot
from rwt.extensions.demo.world.lens import Lens
from teaching.plan import Camera, name_of


def serve_robots(pipe: Connection[str | float, str], robots: int, camera: Camera) -> None:
    """The process: says its URL, and to each word that it hears how many seconds it has computed so far.

    It ends when the other end of the pipe is closed. Ctrl-C is for the process that started it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    anyio.run(_serve, pipe, robots, camera)


async def _serve(pipe: Connection[str | float, str], robots: int, camera: Camera) -> None:
    lens = Lens(camera.width, camera.height)
    names = [name_of(number) for number in range(1, robots + 1)]
    made = [
        partial(DemoRobot, seed=number, namespace=f"/{name}", lens=lens)
        for number, name in enumerate(names, start=1)
    ]
    async with Server("ws://127.0.0.1:0", extra_nodes=made) as server:
        with server.node("organiser") as organiser:
            for name in names:
                await organiser.params.set(f"/{name}/demo_robot:camera_rate", camera.rate)
        pipe.send(server.urls[0])
        await _answer(pipe)


async def _answer(pipe: Connection[str | float, str]) -> None:
    while True:
        try:
            await anyio.to_thread.run_sync(pipe.recv)
        except (EOFError, OSError):
            return
        pipe.send(time.process_time())
