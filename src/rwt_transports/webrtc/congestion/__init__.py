"""Congestion control of media: rates from the feedback of receivers, without I/O, and the sender that keeps to them."""
