"""Commands of README.md in a network namespace that has nothing but loopback.

    unshare --map-root-user --net python offline.py FOLDER_OF_PROGRAMS

The blocks of README.md are `client.py` and `robot.py` in the working directory. A namespace of its own has
port 9090 free, so that they run as they are written.
"""

from __future__ import annotations

import fcntl
import os
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

GET_FLAGS, SET_FLAGS, UP = 0x8913, 0x8914, 1  # SIOCGIFFLAGS, SIOCSIFFLAGS and IFF_UP of Linux's if.h
LONGEST = 120.0
PORT = 9090


def main() -> None:
    """Run everything; what fails raises."""
    programs = Path(sys.argv[1])
    loopback_alone()
    python, rwt, suite = (str(programs / name) for name in ("python", "rwt", "rosbridge-conformance"))
    with serving(rwt, "serve", "--demo"):
        run(python, "client.py")
        run(rwt, "topic", "echo", "/odom", "--once")
        run(suite, f"ws://127.0.0.1:{PORT}", "--run", "services/*")
    with serving(python, "robot.py"):
        run(rwt, "service", "call", "/beep", "{}")


def loopback_alone() -> None:
    """Switch loopback on, and make sure that nothing leads out of here.

    Raises:
        RuntimeError: there is another interface, so this is no namespace of its own.
    """
    names = [name for _, name in socket.if_nameindex()]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:

        def flags(name: str) -> int:
            answer = fcntl.ioctl(control, GET_FLAGS, struct.pack("16sH14x", name.encode(), 0))
            return int(struct.unpack("16sH14x", answer)[1])

        # Some kernels put tunnels into every namespace, which are down.
        if up := [name for name in names if name != "lo" and flags(name) & UP]:
            raise RuntimeError(f"there is a network: {up}")
        fcntl.ioctl(control, SET_FLAGS, struct.pack("16sH14x", b"lo", flags("lo") | UP))


@contextmanager
def serving(*command: str) -> Iterator[None]:
    """Run a server, from the moment when it takes connections."""
    with subprocess.Popen(command) as server:
        try:
            end = time.monotonic() + LONGEST
            while not connects():
                if server.poll() is not None or time.monotonic() > end:
                    raise RuntimeError(f"{command} does not listen on port {PORT}")
                time.sleep(0.1)
            yield
        finally:
            server.terminate()  # in a shell's background Ctrl-C is ignored
            left = server.wait(LONGEST)
    if left != 0:
        raise RuntimeError(f"{command} ended with {left}")


def connects() -> bool:
    """Return True if the port has a listener."""
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.1", PORT)) == 0


def run(*command: str) -> None:
    """Run a command to its end; what it prints is printed."""
    subprocess.run(command, check=True, timeout=LONGEST, env={**os.environ, "PYTHONUNBUFFERED": "1"})


if __name__ == "__main__":
    main()
