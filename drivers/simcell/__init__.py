"""The simulated cell: a PUMA 560 behind a VAL II controller, rendered cameras, parts that rest, fall and are gripped.

Its truth is its own: the daemon sees pictures and hears the line, as in a real cell.
"""
