"""The live page: what the daemon tells at its socket and writes into its run, shown in a browser on this machine. A
process of its own. Nothing here can move the arm: the one word it ever says to the daemon is `status`.
"""
