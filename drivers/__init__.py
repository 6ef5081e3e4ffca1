"""Hardware, real and simulated. Nothing here knows the daemon; `daemon/cell/` alone names what is here."""
