"""What must survive a restart: targets, in SQLite."""
