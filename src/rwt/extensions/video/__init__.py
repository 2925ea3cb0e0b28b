"""Images and video of image topics over HTTP, as `web_video_server` serves them."""

from rwt.extensions.video.server import WebVideoServer

__all__ = ["WebVideoServer"]
