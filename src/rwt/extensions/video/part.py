"""Declaration of web_video_server."""

from __future__ import annotations

from rwt.declarations import NodeContext, NodePart, NoSettings, ReadyNode


def _make(context: NodeContext, settings: NoSettings) -> ReadyNode:
    from rwt.extensions.video import WebVideoServer

    limits = context.limits
    return WebVideoServer(context.graph, limits.video_viewers, limits.video_encoders, limits.video_pixels)


PART = NodePart(
    summary="image topics as images and video over HTTP",
    pools=(
        "rwt.extensions.video.server:VIEWERS",
        "rwt.extensions.video.server:ENCODERS",
        "rwt.extensions.video.server:PIXELS",
    ),
    make=_make,
    on_every_worker=True,
)
