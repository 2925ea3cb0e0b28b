"""Declaration of web_video_server."""

from __future__ import annotations

from typing import Final

from rwt.declarations import NodeContext, NodePart, NoSettings, ReadyNode
from rwt_transports.shared_pool import PoolRow

VIEWERS: Final = PoolRow("viewers of images", "limits.video_viewers", "viewers of images")
ENCODERS: Final = PoolRow("image encoders", "limits.video_encoders", "different image streams")
PIXELS: Final = PoolRow("pixels of videos", "limits.video_pixels", "pixels per image of all videos")


def _make(context: NodeContext, settings: NoSettings) -> ReadyNode:
    from rwt.extensions.video import WebVideoServer

    limits = context.limits
    return WebVideoServer(context.graph, limits.video_viewers, limits.video_encoders, limits.video_pixels)


PART = NodePart(
    summary="image topics as images and video over HTTP",
    pools=(VIEWERS, ENCODERS, PIXELS),
    make=_make,
    on_every_worker=True,
)
