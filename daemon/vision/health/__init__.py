"""What is wrong with the images themselves: dark, blurred, the eyes exchanged. Never about parts."""
