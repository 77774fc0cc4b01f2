"""Video in: sources, exact frame identity, decoding, a ring of the last minute, recorded video and its writers."""
