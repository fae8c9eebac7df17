"""Programs of an outsider: they know block files and streams from the spec alone."""
