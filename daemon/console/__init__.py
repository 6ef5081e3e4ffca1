"""The operators' language: a line in, the command it means, an answer in words or JSON.

What each word does stands in daemon/commands/; how lines get here, in daemon/frontends/.
"""
