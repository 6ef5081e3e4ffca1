"""Where operators come in: the serial terminal, the socket and its client.

What their words mean is daemon/console/'s.
"""
