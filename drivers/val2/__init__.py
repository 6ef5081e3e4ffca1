"""The VAL II line: the protocol without I/O (wire), locations, the commands' text, the ledger, the serial link itself.

Degrees and millimetres of the controller; what may be asked of the arm is decided elsewhere.
"""
