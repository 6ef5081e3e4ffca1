"""Events of a cell as values: records, cause codes, outcomes of picks and how they count. No file, no clock.

Status, runs, review, fleet and metrics count by this package.
"""
