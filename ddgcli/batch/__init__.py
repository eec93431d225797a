"""Many runs of one command: tasks from inputs and sweeps, a process for each, a table of results."""
