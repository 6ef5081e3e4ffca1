"""Views and drawings -> models: taught, trained, judged for what was never seen, accepted or not.

Recognition is in daemon/vision/, the files of models in daemon/store/.
"""
