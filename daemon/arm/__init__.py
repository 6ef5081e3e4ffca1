"""The one way to the arm: what it may never be told, how a move is sent, who has it and stops it."""
