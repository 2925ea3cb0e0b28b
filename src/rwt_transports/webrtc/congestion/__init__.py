"""Congestion control of media: rates from the feedback of receivers, without I/O and without a clock."""
