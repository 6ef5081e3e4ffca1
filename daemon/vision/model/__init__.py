"""What was taught: facet types, relation matrix, views, the part merged from them. Values; no image."""
