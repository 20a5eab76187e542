"""Campaigns of runs, in processes here or on a cluster, kept as they come, in one Parquet file."""

from wbc.batch.batch import BatchProgress, run_batch
from wbc.batch.row import read_rows, write_rows
from wbc.problem.campaign import Campaign, load_campaign

__all__ = ["BatchProgress", "Campaign", "load_campaign", "read_rows", "run_batch", "write_rows"]
