"""An ordinary client in a process of its own: `python -m tests.faults.attacks.ordinary_client PORT`.

It calls a service every 20 ms. For each line that it reads it prints the worst wait for an answer since the
line before, in seconds.
"""

from __future__ import annotations

import select
import sys
import time
from typing import Final

from tests.faults.blocking_client import BlockingClient

_PAUSE: Final = 0.02


def main() -> None:
    """Runs until nothing more can be read."""
    with BlockingClient(int(sys.argv[1])) as client:
        client.socket.settimeout(60.0)
        worst = 0.0
        while True:
            begin = time.monotonic()
            client.ask_something()
            now = time.monotonic()
            worst = max(worst, now - begin)
            readable, _, _ = select.select([sys.stdin], [], [], max(0.0, begin + _PAUSE - now))
            if readable:
                if not sys.stdin.readline():
                    return
                sys.stdout.write(f"{worst}\n")
                sys.stdout.flush()
                worst = 0.0


if __name__ == "__main__":
    main()
