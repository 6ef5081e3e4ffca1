"""What happened in a cell, as values: outcomes of picks and how they are counted. No file, no clock, no other package.

Everything that counts, shows or exports what happened (status, runs, review, fleet, metrics) counts by this package.
"""
