"""One image -> straight-sided outlines and sub-pixel corners. Knows nothing of the other eye."""
