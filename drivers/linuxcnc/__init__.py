"""LinuxCNC's remote shell (linuxcncrsh): a line protocol over TCP."""
