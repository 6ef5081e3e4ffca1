"""Many cells: collect their finished runs into one store, as tables, replay them by many workers, show them on one
page.

It runs on a computer of the plant, never on a cell's; a cell does not depend on it.
"""
