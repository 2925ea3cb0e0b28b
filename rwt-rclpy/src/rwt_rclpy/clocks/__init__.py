"""Clocks, times, durations, timers and `/clock`."""
