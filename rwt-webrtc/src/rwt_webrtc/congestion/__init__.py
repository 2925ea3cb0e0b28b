"""Congestion control of media, without I/O: rates from reports of receivers, probes, and pacing."""
