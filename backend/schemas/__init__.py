"""What goes over the wire to browsers and programs."""
