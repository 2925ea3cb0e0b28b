"""WebRTC: rosbridge over data channels, and images and audio as media tracks (WHEP, WHIP)."""
