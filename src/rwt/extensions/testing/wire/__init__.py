"""Wire between clients and a server under test: faults, transcripts, slow readers."""
