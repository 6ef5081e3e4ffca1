"""The pattern rotation layer: a relation matrix laid onto taught ones in the numbering that fits best.

Matrices in, numberings and activations out; what the numbers mean, and who is believed, is said elsewhere.
"""
