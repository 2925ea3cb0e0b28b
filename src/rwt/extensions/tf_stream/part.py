"""Declaration of tf2_web_republisher."""

from __future__ import annotations

from typing import Final

from rwt.declarations import NodeContext, NodePart, NoSettings, ReadyNode
from rwt_transports.shared_pool import PoolRow

STREAMS: Final = PoolRow("transform streams", "", "subscriptions of transforms")


def _make(context: NodeContext, settings: NoSettings) -> ReadyNode:
    from rwt.extensions.tf_stream import Tf2WebRepublisher

    return Tf2WebRepublisher(context.graph)


PART = NodePart(summary="transforms that a page requests, at its rate", pools=(STREAMS,), make=_make)
