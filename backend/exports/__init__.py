"""Targets for other tools: files to download, and Cursor on Target events sent as they change."""
