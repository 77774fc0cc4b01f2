"""Landing pads on paper: drawings of true size, and the command that writes them."""
