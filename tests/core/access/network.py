"""A second host on this machine, a network namespace, and the cable to it, which can be pulled."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
from types import TracebackType


@functools.cache
def why_no_cables() -> str:
    """Why there can be no second host; empty where there can."""
    if sys.platform != "linux" or shutil.which("ip") is None:
        return "needs Linux and iproute2's ip"
    name = f"rwt-{os.getpid()}-try"
    made = subprocess.run(["ip", "netns", "add", name], capture_output=True, text=True, check=False)
    if made.returncode:
        return f"needs to make network namespaces (root): {made.stderr.strip()}"
    ip("netns", "del", name)
    return ""


def ip(*words: str) -> None:
    """Run `ip`."""
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True, timeout=60)


class Cable:
    """A second host within the block, and a cable to it.

    Attributes:
        here: the address of this end.
        there: the address of the other end.
        there_runs: what stands before a command that runs at the other end.
    """

    def __init__(self) -> None:
        number = os.getpid() % 16_000
        self._name, self._end = f"rwt-{os.getpid()}-operator", f"rwt{os.getpid()}"
        self.here, self.there = (f"10.79.{number // 64}.{number % 64 * 4 + host}" for host in (1, 2))
        self.there_runs = ("ip", "netns", "exec", self._name)

    def __enter__(self) -> Cable:
        ip("netns", "add", self._name)
        try:
            ip("link", "add", self._end, "type", "veth", "peer", "name", "cable", "netns", self._name)
            ip("addr", "add", f"{self.here}/30", "dev", self._end)
            ip("link", "set", self._end, "up")
            ip("-n", self._name, "addr", "add", f"{self.there}/30", "dev", "cable")
            ip("-n", self._name, "link", "set", "cable", "up")
            ip("-n", self._name, "link", "set", "lo", "up")
        except BaseException:
            ip("netns", "del", self._name)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # A namespace without a name is there until the last packet in it is.
        ip("link", "del", self._end)
        ip("netns", "del", self._name)

    def pull(self) -> None:
        """Drop every packet silently."""
        ip("-n", self._name, "link", "set", "cable", "down")

    def plug(self) -> None:
        """Let packets pass again."""
        ip("-n", self._name, "link", "set", "cable", "up")
