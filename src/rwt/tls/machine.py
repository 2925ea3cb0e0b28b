"""What this machine is called, and which addresses it has."""

from __future__ import annotations

import contextlib
import ipaddress
import socket

from rwt.access.settings.types import is_host_name

Address = ipaddress.IPv4Address | ipaddress.IPv6Address


def machine_addresses() -> tuple[Address, ...]:
    """The addresses of this machine's interfaces, the one that leads to other networks first.

    Link-local ones of IPv6 are left out: browsers cannot be given one, for want of its zone.
    """
    import ifaddr

    found: list[Address] = []
    for adapter in ifaddr.get_adapters():
        for each in adapter.ips:
            # ifaddr has IPv6 as address, flow and zone.
            address = ipaddress.ip_address(each.ip if isinstance(each.ip, str) else each.ip[0])
            if not (address.version == 6 and address.is_link_local):
                found.append(address)
    first = _outward_address()
    return tuple(
        sorted(dict.fromkeys(found), key=lambda it: (it != first, it.is_loopback, it.version, int(it)))
    )


def _outward_address() -> Address | None:
    """Which of its addresses this machine would use towards another network; nothing is sent."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # An address for documents (RFC 5737), the port of discard.
        return ipaddress.ip_address(probe.getsockname()[0])
    return None


def machine_names() -> list[str]:
    """Its names that are names of hosts; `.local` is what multicast DNS tells others (RFC 6762)."""
    host = socket.gethostname()
    first = host.partition(".")[0]
    return [name for name in ("localhost", host, f"{first}.local") if is_host_name(name)]
