"""Two sets of outlines -> facets in space, grouped, corners welded once. Nothing is named."""
