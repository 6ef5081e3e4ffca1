"""How operators reach the daemon: the serial terminal, the socket, and the socket's client.

daemon/console/ interprets what they type.
"""
