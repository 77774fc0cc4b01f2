"""Writes a flight folder while it flies."""
