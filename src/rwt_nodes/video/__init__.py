"""Pictures and video of image topics over HTTP, as `web_video_server` serves them."""

from rwt_nodes.video.server import WebVideoServer

__all__ = ["WebVideoServer"]
