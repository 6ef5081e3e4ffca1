"""A group of facets and a model -> label, pose, confidence; or unknown, with the reason. No image."""
