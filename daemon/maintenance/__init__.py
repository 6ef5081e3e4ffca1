"""What keeps a service running for years: watching, telling, checking, packing up for a maintainer."""
