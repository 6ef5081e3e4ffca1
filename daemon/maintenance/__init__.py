"""Maintenance of a service that runs for years: watchdog, journal, metrics, doctor, support bundle."""
