"""Vehicles as the station knows them."""
