"""Congestion control of media: rates from reports of receivers, without I/O, and a sender that keeps them."""
