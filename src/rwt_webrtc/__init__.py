"""Pictures over WebRTC: image topics as video tracks, each encoded once for all who watch (WHEP)."""

from rwt_webrtc.whep import video_routes

__all__ = ["video_routes"]
