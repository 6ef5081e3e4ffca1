"""The VAL II driver: the protocol without I/O (wire), locations, the text of commands, and the serial link.

It uses the controller's degrees and millimetres. It does not decide which motions are allowed; daemon/arm does.
"""
