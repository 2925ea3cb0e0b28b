"""Pictures over WebRTC: image topics as video tracks (WHEP), and cameras of clients as topics (WHIP)."""

from rwt_webrtc.whep import video_routes
from rwt_webrtc.whip import IncomingMedia

__all__ = ["video_routes", "IncomingMedia"]
