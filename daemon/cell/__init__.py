"""Configuration -> cameras and arm: real, recorded or simulated. The only room that names drivers.

build.py makes the Hardware, pick_cell.py what a pick works with; when to look or move is decided elsewhere.
"""
