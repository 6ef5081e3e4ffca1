"""Many cells: their finished runs gathered in one store, laid out as one table, replayed by many workers, shown on one
page. Beside `review`, on a computer of the plant's; a cell needs none of it and knows nothing of it.
"""
