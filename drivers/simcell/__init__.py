"""A cell that is not there: arm, VAL II controller, hand, light and cameras, parts; what truly happened in it (witness)
and what must never happen (judge). What it is like stands in etc/simcell.yaml. Nothing here knows of the daemon.
"""
