"""Mutated inputs of every kind we read ourselves: nothing but our own errors, within time and memory.

`python -m benchmarks.fuzz [--format NAME] [--seconds S] [--seed N] [--store]`: mutates valid inputs of a
kind, or makes random scenes and calls, until this processor time is over. It prints one line a kind (inputs
tried, accepted, refused, the slowest) and every escape: an exception that is not ours, a message over two
lines' length, an input that takes too long, or one that ends the process. They are in `build/fuzz/`, and the
exit code is 1. `--store` adds the counts to the ledger that docs/hard-cases.md shows, with a seed that no
stored run had. An interrupt (Control-C, SIGTERM) ends the run with what was counted, exit code 130.
"""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path

from benchmarks.fuzz.coverage import LineCoverage


def main() -> int:
    """Try every kind; 1 where an input escapes."""
    blind = "--blind" in sys.argv
    coverage = None if blind else LineCoverage()
    if coverage is not None:
        coverage.start()  # before the modules that it counts are imported
    from benchmarks.fuzz.inputs import kinds
    from benchmarks.fuzz.ledger import add_to_ledger, next_seed
    from benchmarks.fuzz.run import fuzz_in_processes

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--format", choices=list(kinds()), help="one kind only")
    parser.add_argument("--seconds", type=float, default=5.0, help="of processor time, for each kind")
    parser.add_argument("--seed", type=int, help="0, or with --store the next one")
    parser.add_argument("--store", action="store_true", help="add the counts to the ledger")
    parser.add_argument("--blind", action="store_true", help="mutate the valid inputs only, count no lines")
    parser.add_argument("--unguided", action="store_true", help="mutate the valid inputs only, count lines")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # else its child would not end
    bad = 0
    for kind in kinds().values():
        if options.format not in (None, kind.name):
            continue
        seed = options.seed if options.seed is not None else next_seed(kind.name) if options.store else 0
        account = fuzz_in_processes(kind, options.seconds, seed, coverage, guided=not options.unguided)
        print(f"{kind.name:12s} {account}", flush=True)
        if options.store:
            add_to_ledger(kind.name, account, guided=not (blind or options.unguided))
        for number, (message, data) in enumerate(account.escapes):
            folder = Path("build/fuzz")
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"{kind.name.replace('.', '_').replace(' ', '_')}_{seed}_{number}").write_bytes(data)
            print(f"  escape {number}: {message}", flush=True)
            bad += 1
        if account.interrupted:
            return 130
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
