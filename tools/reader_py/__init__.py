"""A streaming reader of block files."""
