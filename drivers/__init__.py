"""Hardware, real and simulated. Nothing here knows the daemon; `daemon/cell.py` alone names what is here."""
