"""The server's side: one graph with a demo robot for each demonstrator."""

from __future__ import annotations

import signal
import time
from contextlib import ExitStack, closing
from multiprocessing.connection import Connection

import anyio
import anyio.to_thread

from rwt.server import serve
from rwt_graph import MemoryGraph, Node
from rwt_nodes import Rosapi, Tf2WebRepublisher
from rwt_nodes.demo import DemoRobot
from rwt_nodes.demo.world.lens import Lens
from rwt_nodes.video import WebVideoServer
from teaching.plan import Camera, name_of


def serve_robots(pipe: Connection[str | float, str], robots: int, camera: Camera) -> None:
    """The process: says its URL, and to each word that it hears how many seconds it has computed so far.

    It ends when the other end of the pipe is closed. Ctrl-C is for the process that started it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    anyio.run(_serve, pipe, robots, camera)


async def _serve(pipe: Connection[str | float, str], robots: int, camera: Camera) -> None:
    lens = Lens(camera.width, camera.height)
    with ExitStack() as nodes:
        async with MemoryGraph() as graph:
            video = nodes.enter_context(closing(WebVideoServer(graph)))
            nodes.enter_context(closing(Rosapi(graph)))
            nodes.enter_context(closing(Tf2WebRepublisher(graph)))
            for number in range(1, robots + 1):
                robot = DemoRobot(graph, seed=number, namespace=f"/{name_of(number)}", lens=lens)
                nodes.enter_context(closing(robot))
            with Node(graph, "organiser") as organiser:
                for number in range(1, robots + 1):
                    await organiser.set_param(f"/{name_of(number)}/demo_robot:camera_rate", camera.rate)
            async with serve(graph, "ws://127.0.0.1:0", http=[video.http]) as server:
                pipe.send(server.urls[0])
                await _answer(pipe)


async def _answer(pipe: Connection[str | float, str]) -> None:
    while True:
        try:
            await anyio.to_thread.run_sync(pipe.recv)
        except (EOFError, OSError):
            return
        pipe.send(time.process_time())
