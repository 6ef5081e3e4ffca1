"""facetd: recognise parts by their facets, locate them, and bring the gripper there one bounded move at a time."""
