"""Pages of a hub: its robots as a page and as JSON, health and metrics."""

from __future__ import annotations

import html
import json
from typing import TYPE_CHECKING, Final

from rwt.observability.prometheus import CONTENT_TYPE, PrometheusText
from rwt_transports.http.routes import HttpRequest, HttpResponse, Routes, page_policy

if TYPE_CHECKING:
    from rwt.extensions.hub.hub import Hub

MAX_LISTED: Final = 50
"""Maximum number of robots with metrics of their own: those with the most clients."""

_PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>Robots</title>
<style>body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 44rem; margin: 3rem auto; padding: 0 1rem }}
code {{ background: #8882; padding: .1em .3em; border-radius: 3px }}
td, th {{ padding: .1em 1em .1em 0; text-align: left }}</style>
<h1>Robots that have dialled in</h1>
<table><tr><th>robot<th>connect a rosbridge client to<th>clients{rows}</table>
"""


def hub_routes(hub: Hub) -> Routes:
    """Return the routes of a hub.

    ``GET /`` is a page, ``/robots`` the same as JSON; also ``/healthz``, ``/metrics``, and pages of robots
    below ``/NAME/``.
    """
    routes = Routes()
    routes.get("/", lambda request: _index(hub, request))
    routes.get("/robots", lambda request: _robots(hub))
    routes.get("/healthz", lambda request: _health(hub))
    routes.get("/metrics", lambda request: _metrics(hub))
    for method in ("GET", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"):
        routes.add("/*", hub.page, method)
    return routes


def _metrics(hub: Hub) -> HttpResponse:
    page, robots = PrometheusText(), hub.robots
    page.single("rwt_hub_robots", "gauge", "Robots that have dialled in.", len(robots))
    streams = sum(robot.clients for robot in robots)
    page.single("rwt_hub_streams", "gauge", "Clients and pages of all robots.", streams)
    busiest = sorted(robots, key=lambda robot: -robot.clients)[:MAX_LISTED]
    help_ = f"Clients and pages of the {MAX_LISTED} robots with the most."
    counts = [({"robot": robot.name}, robot.clients) for robot in busiest]
    page.family("rwt_hub_robot_streams", "gauge", help_, counts)
    help_ = "Seconds of the last round trip on their uplinks."
    trips = [({"robot": robot.name}, robot.uplink.round_trip) for robot in busiest]
    page.family("rwt_hub_robot_round_trip_seconds", "gauge", help_, trips)
    if hub.nodes is not None:
        page.single("rwt_hub_nodes", "gauge", "Other nodes whose robots are known.", hub.nodes.count)
        linked = sum(robot.is_linked for robot in robots)
        page.single("rwt_hub_linked_robots", "gauge", "Robots of other nodes that have clients here.", linked)
    text = "Bytes that one side has sent and the other has not taken."
    page.single("rwt_hub_waiting_bytes", "gauge", text, hub.waiting.total)
    page.single("rwt_hub_clients_total", "counter", "Clients that came.", hub.clients)
    page.single("rwt_hub_pages_total", "counter", "Requests for pages of robots.", hub.pages)
    page.single("rwt_hub_passed_bytes_total", "counter", "Bytes passed on, both ways.", hub.bytes)
    return HttpResponse(page.text(), content_type=CONTENT_TYPE)


def _index(hub: Hub, request: HttpRequest) -> HttpResponse:
    host = html.escape(request.headers.get("host", "HOST"))
    rows = "".join(
        f"<tr><td>{name}<td><code>ws://{host}/{name}</code><td>{clients}"
        for name, clients in _listed(hub).items()
    )
    page = _PAGE.format(rows=rows or "<tr><td>none")
    return HttpResponse(page.encode(), content_type="text/html; charset=utf-8", headers=page_policy())


def _listed(hub: Hub) -> dict[str, int]:
    """Return the robots of all nodes, and the clients that each has at this one."""
    names = dict.fromkeys(hub.nodes.robots if hub.nodes is not None else (), 0)
    names.update((robot.name, robot.clients) for robot in hub.robots)
    return dict(sorted(names.items()))


def _robots(hub: Hub) -> HttpResponse:
    listed = [
        {"name": name, "path": f"/{name}", "clients": clients} for name, clients in _listed(hub).items()
    ]
    return HttpResponse(json.dumps({"robots": listed}).encode(), content_type="application/json")


def _health(hub: Hub) -> HttpResponse:
    body = {
        "status": "ok",
        "robots": len(hub.robots),
        "clients": sum(robot.clients for robot in hub.robots),
    }
    return HttpResponse(json.dumps(body).encode(), content_type="application/json")
