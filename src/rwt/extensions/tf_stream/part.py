"""Declaration of tf2_web_republisher."""

from __future__ import annotations

from rwt.declarations import NodeContext, NodePart, NoSettings, ReadyNode


def _make(context: NodeContext, settings: NoSettings) -> ReadyNode:
    from rwt.extensions.tf_stream import Tf2WebRepublisher

    return Tf2WebRepublisher(context.graph)


PART = NodePart(
    summary="transforms that a page requests, at its rate",
    pools=("rwt.extensions.tf_stream.republisher:STREAMS",),
    make=_make,
)
