"""The command language: parse a line, run its command, answer as text or JSON.

daemon/commands/ has the commands, daemon/frontends/ receives the lines.
"""
