"""What serves Snakemake alone: the environment of jobs, forks, log, timings, graph; the library knows nothing of it."""
