"""Cost of each way between processes, compared with the bare kernel and other programs."""
