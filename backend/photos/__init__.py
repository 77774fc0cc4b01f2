"""Still photos: where they were taken."""
