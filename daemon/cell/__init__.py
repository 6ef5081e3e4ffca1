"""Configuration -> hardware: real, recorded or simulated. The only room that names drivers; nothing is decided here."""
