"""Whole-process benchmarks: this server and a bare relay, measured in turns, printed as ratios."""
