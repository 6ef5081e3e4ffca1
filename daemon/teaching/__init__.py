"""Make models from views and drawings: teach, train, judge what was never seen, accept or reject.

Recognition is in daemon/vision/, the files of models in daemon/store/.
"""
