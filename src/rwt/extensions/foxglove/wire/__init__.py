"""Foxglove's wire protocol: JSON messages, binary frames, and the encodings of payloads."""
