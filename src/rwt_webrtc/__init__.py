"""Pictures and sound over WebRTC: topics as tracks (WHEP), and cameras and microphones as topics (WHIP)."""

from rwt_webrtc.sound_topics import SoundTopics
from rwt_webrtc.whep import watch_routes
from rwt_webrtc.whip import IncomingMedia

__all__ = ["IncomingMedia", "SoundTopics", "watch_routes"]
