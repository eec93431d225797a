"""Many runs of one command: tasks from inputs and swept parameters, a process for each task with bounded time
and memory, the table of their results, and the journal from which an interrupted batch continues.
"""

__all__ = ["process", "run", "table", "tasks"]
