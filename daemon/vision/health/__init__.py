"""What is wrong with the images themselves (light, lens, cable, mounting), and what they hint at of the calibration.

Nothing here says anything of parts.
"""
