"""Shows a recorded flight in the browser as if it were live."""
