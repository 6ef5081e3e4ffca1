"""Facets of one stereo pair: outlines matched, fitted, triangulated, grouped; its circles and its table."""
