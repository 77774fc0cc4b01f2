"""Flights of the station: velocities streamed to a vehicle, for as long as somebody looks."""
