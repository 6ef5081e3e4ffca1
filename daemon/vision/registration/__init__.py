"""A part that is known, or suspected, laid onto both images: its pose from edges; proof or refusal."""
