"""After the run: what it did, as a page, as tables, and replayed through today's recogniser. Reads run folders only."""
