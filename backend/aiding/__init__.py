"""The autopilot's own filter is told where the vehicle is, when the operator asks for it."""
