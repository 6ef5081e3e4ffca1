"""Facets of several looks from different places, matched and adjusted together into one partial polyhedron."""
