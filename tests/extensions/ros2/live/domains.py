"""Domains of ROS 2 for tests and measurements, which must not meet others on the machine."""

from __future__ import annotations

import random
import socket

#: Domains whose ports are below those that Linux gives to outgoing connections.
_DOMAINS = range(1, 100)


def free_domain() -> int:
    """Return the number of a domain without programs on this machine.

    Raises:
        RuntimeError: every domain has programs.
    """
    for domain in random.sample(_DOMAINS, len(_DOMAINS)):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                # DDS's port of the first program of a domain.
                probe.bind(("", 7410 + 250 * domain))
            except OSError:
                continue
            return domain
    raise RuntimeError("every domain of ROS 2 has programs on this machine")
