"""What is wrong with the images themselves: light, lens, cable, mounting. Never about parts.

examine.py: examine, drift, misleading, troubles. blur.py and camera_order.py measure for it.
"""
