"""The command line: options, exit codes, summaries and progress.

`main` holds the command table, `run` what all commands share (reading, writing, timing, summary). Each
command is one thin file in `commands`; what simulators share is in `simulation`.
"""

__all__ = [
    "commands",
    "early_interrupt",
    "input_facts",
    "main",
    "messages",
    "multi_value",
    "options",
    "progress",
    "run",
    "simulation",
    "start",
    "streams",
    "summary",
    "threads",
]
