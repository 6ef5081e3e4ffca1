"""Views and drawings -> models: taught, trained, judged for what was never seen, accepted or not.

How a part is told from its facets is daemon/vision/'s; where models lie is daemon/store/'s.
"""
