"""Images and video of image topics over HTTP, as `web_video_server` serves them."""

from rwt.nodes.video.server import WebVideoServer

__all__ = ["WebVideoServer"]
