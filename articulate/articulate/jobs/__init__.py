"""Many jobs: each a command line and a folder; here, under Slurm, or on a Ray cluster."""
