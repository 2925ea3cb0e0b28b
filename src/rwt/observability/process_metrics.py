"""What the operating system says of this process, under the names that Prometheus' own clients use."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt.observability.prometheus import PrometheusText

_PROC: Final = Path("/proc/self")
_STARTED: Final = time.time()


def write_process(page: PrometheusText) -> None:
    """CPU time everywhere, memory and open files where there is `/proc`."""
    times = os.times()
    cpu = times.user + times.system
    page.single("process_cpu_seconds_total", "counter", "CPU time used, in seconds.", cpu)
    page.single("process_start_time_seconds", "gauge", "When the process began, Unix time.", _STARTED)
    try:
        pages = int((_PROC / "statm").read_text().split()[1])
        files = sum(1 for _ in (_PROC / "fd").iterdir())
    except OSError:
        return  # no Linux
    resident = pages * os.sysconf("SC_PAGE_SIZE")
    page.single("process_resident_memory_bytes", "gauge", "Resident memory, in bytes.", resident)
    page.single("process_open_fds", "gauge", "Open file descriptors.", files)
