"""First import of the program: an interrupt while the rest is imported ends it in one line."""

from __future__ import annotations

import signal

from ddgcli.cli.early_interrupt import end_at_once


def main() -> None:
    """Run the command line."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # ignored signals stay so
        signal.signal(signal.SIGINT, end_at_once)
    from ddgcli.cli.main import main as command_line

    command_line()
