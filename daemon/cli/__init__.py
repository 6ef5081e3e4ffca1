"""Commands of `facetctl` that need no daemon (recogniser on files, cameras, first contact, demo), and commissioning."""
