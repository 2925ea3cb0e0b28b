"""Images and audio over WebRTC: topics as tracks (WHEP), and cameras and microphones as topics (WHIP)."""

from rwt.media.webrtc.audio_topics import AudioTopics
from rwt.media.webrtc.whep import watch_routes
from rwt.media.webrtc.whip import IncomingMedia

__all__ = ["IncomingMedia", "AudioTopics", "watch_routes"]
