"""Every case against `rwt serve` over every transport: `python -m tests.conformance.transports`."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rosbridge_conformance.command import main
from rosbridge_conformance.wire.pipes import SOCKET

SERVE = (sys.executable, "-m", "rwt.cli", "serve")
PIPES = f"stdio:{sys.executable} -m rwt.cli serve stdio: unix://{SOCKET}"
"""A server of its own for each case: one client on its pipes, the others on a socket."""

WEBRTC = ("--set", "webrtc.enabled=true", "--set", "webrtc.channels=200")
"""All connections of a run are channels of one peer."""


@contextmanager
def server(url: str, *arguments: str) -> Iterator[str]:
    """`rwt serve` in a process of its own; the URL on which it listens."""
    process = subprocess.Popen(
        [*SERVE, url, *arguments], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        assert process.stdout is not None
        match = re.search(r"\w+://\S+", process.stdout.readline())
        assert match is not None, f"{url}: the server ended"
        yield match[0]
    finally:
        process.kill()
        process.communicate()


def _runs(folder: Path) -> Iterator[int]:
    for distro in ("jazzy", "noetic"):
        for url in ("ws://127.0.0.1:0", "tcp://127.0.0.1:0", f"unix://{folder}/{distro}"):
            with server(url, "--distro", distro) as address:
                yield main([address, "--target", f"rwt-{distro}"])
        with server("ws://127.0.0.1:0", "--distro", distro, *WEBRTC) as address:
            yield main([address.replace("ws://", "webrtc+http://"), "--target", f"rwt-{distro}"])
        yield main([f"{PIPES} --distro {distro}", "--target", f"rwt-{distro}", "--jobs", "2"])


def run(argv: Sequence[str] = ()) -> int:
    """Play everything; the exit code is 0 when nothing failed unexpectedly anywhere."""
    with tempfile.TemporaryDirectory() as folder:
        return max(_runs(Path(folder)))


if __name__ == "__main__":
    sys.exit(run())
