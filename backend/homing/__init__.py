"""Flying home by the estimate, as far as the station has to do with it."""
