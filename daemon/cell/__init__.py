"""Build cameras and arm from the configuration: real, recorded or simulated. The only package that imports drivers.

build.py makes the Hardware, pick_cell.py the Workcell and settings of a pick.
"""
