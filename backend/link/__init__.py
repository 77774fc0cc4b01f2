"""The MAVLink link to the vehicles: bytes in, events out; no socket, no clock, no thread."""
