"""Helpers of the Snakemake workflow: environment, forks, log, timings, graph; the library does not import them."""
