"""Run a simulated vehicle: `python -m rwt_mavlink.simulation HOST:PORT`, the address of a ground station."""

from __future__ import annotations

import argparse
import socket
import time
from contextlib import suppress
from typing import Final

from rwt_mavlink.simulation.vehicle import SimulatedVehicle

_STEP_SECONDS: Final = 0.02
_DATAGRAM_BYTES: Final = 65536


def main() -> None:
    """Send to a station, and obey it, until interrupted."""
    parser = argparse.ArgumentParser(prog="rwt_mavlink.simulation", description=__doc__)
    parser.add_argument("station", nargs="+", metavar="HOST:PORT", help="address of a ground station")
    parser.add_argument("--system", type=int, default=1, metavar="ID", help="system id (default 1)")
    parser.add_argument("--px4", action="store_true", help="modes and parameters like those of PX4")
    arguments = parser.parse_args()
    stations = [(host, int(port)) for host, _, port in (each.rpartition(":") for each in arguments.station)]
    vehicle = SimulatedVehicle(arguments.system, px4=arguments.px4)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.settimeout(_STEP_SECONDS)
        started = time.monotonic()
        while True:
            # Nothing has arrived, or no station listens yet.
            with suppress(TimeoutError, ConnectionRefusedError):
                vehicle.receive(udp.recv(_DATAGRAM_BYTES))
            vehicle.step(time.monotonic() - started)
            for frame in vehicle.outbox:
                for station in stations:
                    udp.sendto(frame, station)
            vehicle.outbox.clear()


if __name__ == "__main__":
    main()
