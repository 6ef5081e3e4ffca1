"""The dashboard: a page for a browser on this machine, from the daemon's status and its run as it is written.

It is a process of its own and cannot move the arm: it sends the daemon no command but `status`.
"""
