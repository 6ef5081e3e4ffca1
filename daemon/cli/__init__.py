"""Jobs of `facetctl` that need no daemon: the recogniser on files, the cameras by themselves, the demo."""
