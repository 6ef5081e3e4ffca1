"""The operators' language: which command a line means, what commands work with, what operators hear unasked."""
