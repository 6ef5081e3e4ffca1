"""The one way to the arm: what it may never be told (guard), paths, bounded moves, the stop that comes first.

Nothing here knows what a pick is; whoever wants the arm moved comes through this door.
"""
