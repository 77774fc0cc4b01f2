"""Landing: the pad's geometry, its detection in pictures and the camera's pose above it."""
