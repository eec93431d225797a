"""Costs of the kernels of the commands: the table that `--dry-run` predicts from."""
