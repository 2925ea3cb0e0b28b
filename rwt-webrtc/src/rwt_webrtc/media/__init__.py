"""Images and audio over WebRTC: topics as tracks (WHEP), and cameras and microphones as topics (WHIP)."""

from rwt_webrtc.media.audio_topics import AudioTopics
from rwt_webrtc.media.whep import watch_routes
from rwt_webrtc.media.whip import IncomingMedia

__all__ = ["IncomingMedia", "AudioTopics", "watch_routes"]
