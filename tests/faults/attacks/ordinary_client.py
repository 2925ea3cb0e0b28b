"""An ordinary client in a process of its own: `python -m tests.faults.attacks.ordinary_client PORT PID`.

It calls a service every 20 ms. For each line that it reads it prints, in seconds since the line before, the
worst wait for an answer, and the most time that the server's event loop (the first thread of the process PID)
ran during one wait.
"""

from __future__ import annotations

import os
import select
import sys
import time
from pathlib import Path
from typing import Final

from tests.faults.blocking_client import BlockingClient

_PAUSE: Final = 0.02


def main() -> None:
    """Runs until nothing more can be read."""
    # Not the attackers' address: what they cause is charged to it.
    with BlockingClient(int(sys.argv[1]), b"X-Forwarded-For: 198.51.100.9") as client:
        client.socket.settimeout(60.0)
        if os.geteuid() == 0:
            # An answer counts when it comes, not when other processes let it be read.
            os.setpriority(os.PRIO_PROCESS, 0, -15)
        schedule = Path(f"/proc/{sys.argv[2]}/task/{sys.argv[2]}/schedstat")

        def ran() -> float:
            return int(schedule.read_text().split()[0]) / 1e9

        worst = worst_ran = 0.0
        while True:
            begin, ran_before = time.monotonic(), ran()
            client.ask_something()
            now = time.monotonic()
            worst = max(worst, now - begin)
            worst_ran = max(worst_ran, ran() - ran_before)
            readable, _, _ = select.select([sys.stdin], [], [], max(0.0, begin + _PAUSE - now))
            if readable:
                if not sys.stdin.readline():
                    return
                sys.stdout.write(f"{worst} {worst_ran}\n")
                sys.stdout.flush()
                worst = worst_ran = 0.0


if __name__ == "__main__":
    main()
