"""Hardware, real and simulated. Nothing here knows the daemon; `daemon/cell/build.py` alone names what is here."""
