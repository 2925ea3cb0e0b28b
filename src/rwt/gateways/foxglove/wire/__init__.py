"""What is said in Foxglove's protocol: its texts, its binary frames, and the encodings of messages."""
