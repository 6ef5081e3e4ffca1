"""The pick, room of the cycle: its states, plans, looks, moves, and the part followed from look to look."""
