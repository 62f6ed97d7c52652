"""Jobs (a command line and a folder) on this machine, Slurm or Ray; isolated child processes."""
