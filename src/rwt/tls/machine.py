"""Names and addresses of this machine."""

from __future__ import annotations

import contextlib
import ipaddress
import socket

from rwt.access.settings import is_host_name

Address = ipaddress.IPv4Address | ipaddress.IPv6Address


def machine_addresses() -> tuple[Address, ...]:
    """Return the addresses of this machine's interfaces, the one with a route to other networks first.

    Link-local IPv6 addresses are left out: browsers do not accept their zone.
    """
    import ifaddr

    found: list[Address] = []
    for adapter in ifaddr.get_adapters():
        for each in adapter.ips:
            # ifaddr represents IPv6 as (address, flow, zone).
            address = ipaddress.ip_address(each.ip if isinstance(each.ip, str) else each.ip[0])
            if not (address.version == 6 and address.is_link_local):
                found.append(address)
    first = outward_address(socket.AF_INET)
    return tuple(
        sorted(dict.fromkeys(found), key=lambda it: (it != first, it.is_loopback, it.version, int(it)))
    )


def outward_address(family: socket.AddressFamily) -> Address | None:
    """Return the address that this machine would use towards another network. Sends nothing."""
    with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
        # Addresses for documentation (RFC 5737, RFC 3849), discard port: it only looks for a route.
        probe.connect(("192.0.2.1" if family is socket.AF_INET else "2001:db8::1", 9))
        return ipaddress.ip_address(probe.getsockname()[0])
    return None


def machine_names() -> list[str]:
    """Return this machine's valid host names, including its `.local` name for multicast DNS (RFC 6762)."""
    host = socket.gethostname()
    first = host.partition(".")[0]
    return [name for name in ("localhost", host, f"{first}.local") if is_host_name(name)]
