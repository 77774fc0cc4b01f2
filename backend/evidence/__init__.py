"""Proof of a target's coordinate: all that it was computed from, kept beside it, and the computation repeated."""
