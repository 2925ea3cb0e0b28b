"""The dashboard for Grafana queries metrics and labels that the server has."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest

from rwt import Server
from rwt_client import connect
from tests.processes import ROOT
from tests.waiting import until

DASHBOARD: dict[str, Any] = json.loads((ROOT / "docs/how-to/deploy/grafana.json").read_text(encoding="utf-8"))
QUERIES = [target["expr"] for panel in DASHBOARD["panels"] for target in panel["targets"]]

#: Labels that Prometheus adds to each sample.
_ADDED = {"instance"}


def test_panels_are_told_apart_and_do_not_overlap() -> None:
    panels = DASHBOARD["panels"]
    assert len({panel["id"] for panel in panels}) == len({panel["title"] for panel in panels}) == len(panels)
    cells = [
        (x, y)
        for grid in (panel["gridPos"] for panel in panels)
        for x in range(grid["x"], grid["x"] + grid["w"])
        for y in range(grid["y"], grid["y"] + grid["h"])
    ]
    assert len(cells) == len(set(cells)) and max(x for x, _ in cells) < 24


@pytest.mark.anyio
async def test_the_server_has_each_metric_and_label() -> None:
    gate = {"rules": {"drive": {"topics": ["/cmd_vel"], "fields": {"linear.x": {"max": 1}}}}}
    async with Server("ws://127.0.0.1:0", gate=gate, demo=True) as server, connect(server.urls[0]) as robot:
        await robot.subscribe("/odom", lambda _: None)
        robot.advertise("/cmd_vel", "geometry_msgs/Twist").publish({"linear": {"x": 5.0}})
        await robot.call("/rosapi/topics")
        await until(lambda: "rwt_refusals_total{" in server.metrics.text().decode())
        text = server.metrics.text().decode()
    found: dict[str, set[str]] = {}
    for name, labels in re.findall(r"^(\w+)(?:\{(.*)\})? ", text, re.MULTILINE):
        found.setdefault(name, set()).update(re.findall(r'(\w+)="', labels))
    sources = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "src/rwt").rglob("*.py"))
    for query in QUERIES:
        metrics = set(re.findall(r"\b(?:rwt|process)_\w+", query))
        labels = {each.strip() for by in re.findall(r"by \(([^)]*)\)", query) for each in by.split(",")}
        assert metrics, query
        for metric in metrics:
            # A metric has no samples before its first event.
            assert metric in found or f'"{metric}"' in sources, query
            if metric in found:
                assert labels <= found[metric] | _ADDED, query
