"""Declaration of rosapi."""

from __future__ import annotations

from rwt.declarations import NodeContext, NodePart, NoSettings
from rwt.rosapi import Rosapi


def _make(context: NodeContext, settings: NoSettings) -> Rosapi:
    return Rosapi(context.graph)


PART = NodePart(summary="services about the graph, under `/rosapi`", make=_make)
