"""Landing pads: on paper, in the pictures, and under a vehicle that the station lands."""
