"""Declaration of the connections to hubs, for robots behind a NAT."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pydantic import Field

from rwt.access.settings import PlainToken, Table
from rwt.declarations import Option, ServiceContext, ServicePart
from rwt_transports.http.routes import MetricFamily

if TYPE_CHECKING:
    from rwt.extensions.hub.uplink.dial import UplinkStatus
    from rwt.settings.models import Settings


MAX_LISTED: Final = 50
"""Maximum number of topics with a metric of their own, for each hub."""


class DialSettings(Table):
    """Hubs that the robot connects to, so that clients outside of its network reach it."""

    urls: tuple[str, ...] = Field(
        (),
        description="hubs, as `wss://HUB/robots/NAME` with the robot's name; nodes of one hub"
        " are alternatives, separated by commas in one text",
    )
    token: PlainToken | None = Field(
        None, description="token for the hubs: 16 to 256 of the characters A-Z a-z 0-9 - . _ ~"
    )
    cafile: Path | None = Field(
        None,
        description="PEM file with the authority of the hubs' certificates; not set: the system's"
        " authorities",
    )


def _check(settings: Settings, own: DialSettings) -> None:
    if own.urls:
        from rwt.extensions.hub.uplink.dial import check_dial_url
        from rwt_transports.errors import BadUrl

        try:
            for url in own.urls:
                check_dial_url(url)
        except BadUrl as error:
            raise ValueError(f"`dial.urls`: {error}") from error


@asynccontextmanager
async def _run(context: ServiceContext, settings: DialSettings) -> AsyncIterator[None]:
    from rwt.extensions.hub.uplink.dial import dial
    from rwt.tls.tls import client_tls

    token = settings.token.get_secret_value() if settings.token else None
    tls = client_tls(settings.cafile)
    found: list[UplinkStatus] = []
    async with AsyncExitStack() as stack:
        for url in settings.urls:
            status = await stack.enter_async_context(
                dial(
                    url,
                    context.accept(url),
                    token=token,
                    limits=context.limits,
                    buffers=context.buffers,
                    addresses=context.addresses,
                    identify=context.access.admission.credential_of,
                    routes=context.pages(url),
                    tls=tls,
                )
            )
            found.append(status)
            context.add_connection(status)
        context.add_metrics(lambda: _metrics(found))
        yield


def _metrics(found: list[UplinkStatus]) -> Iterator[MetricFamily]:
    families: tuple[tuple[str, str, Callable[[UplinkStatus], float]], ...] = (
        ("rwt_dial_connected", "1 while the uplink to a hub is open.", lambda it: int(it.connected)),
        ("rwt_dial_clients", "Clients and pages that are served through a hub.", lambda it: it.clients),
        ("rwt_dial_round_trip_seconds", "Seconds of the uplink's last round trip.", lambda it: it.round_trip),
        ("rwt_dial_rate_bytes", "Bytes per second that arrived at a hub lately.", lambda it: it.rate),
        ("rwt_dial_failures", "Attempts in a row that a hub did not answer.", lambda it: it.failures),
    )
    for name, help_, value in families:
        yield MetricFamily(name, "gauge", help_, [({"hub": each.url}, value(each)) for each in found])
    open_ones = [(each.url, each.feeds) for each in found if each.feeds is not None]
    topics = [
        ({"hub": url, "topic": topic}, clients)
        for url, feeds in open_ones
        for topic, clients in feeds.demand().most_common(MAX_LISTED)
    ]
    help_ = f"Clients of the {MAX_LISTED} topics that have most behind a hub."
    yield MetricFamily("rwt_dial_topic_clients", "gauge", help_, topics)
    drops = [
        ({"hub": url, "reason": reason.value}, count)
        for url, feeds in open_ones
        for reason, count in feeds.drops.items()
    ]
    help_ = "Samples that clients behind a hub did not get, by reason, since the session began."
    yield MetricFamily("rwt_dial_dropped_total", "counter", help_, drops)


PART = ServicePart(
    pools=(
        "rwt.extensions.hub.ends:WAITING_BYTES",
        "rwt.extensions.hub.ends:CLIENTS",
        "rwt.extensions.hub.ends:LINKS",
        "rwt.extensions.hub.hub:ROBOT_PLACES",
        "rwt.extensions.hub.hub:GREETINGS",
    ),
    summary="connections to hubs, through which clients outside of the robot's network reach it",
    settings=DialSettings,
    check=_check,
    is_on=lambda settings: bool(settings.urls),
    run=_run,
    brings_clients=True,
    options=(
        Option(
            "--dial",
            "dial.urls",
            {
                "action": "append",
                "metavar": "URL",
                "help": "connect to a hub, wss://HUB/robots/NAME, and serve its clients; may be given several"
                " times; without a URL to listen on, only these clients are served",
            },
        ),
    ),
)
