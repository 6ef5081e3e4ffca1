"""The root of the errors that a person can act on. What it says is for that person; anything else raised is a fault of
the program.
"""


class FacetdError(Exception):
    """What happened, where, and what to do: one line. Drivers have roots of their own (they know no daemon)."""
