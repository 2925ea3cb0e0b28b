"""Images and video of image topics over HTTP, as `web_video_server` serves them."""

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.video.server import WebVideoServer as WebVideoServer

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.extensions.video.server": ("WebVideoServer"),
    },
)
