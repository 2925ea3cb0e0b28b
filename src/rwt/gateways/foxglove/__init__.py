"""The Foxglove gateway: translates between Foxglove's WebSocket protocol and the robot graph."""
