"""After the run: pages, tables and exports of what it did, and its looks replayed through today's recogniser."""
