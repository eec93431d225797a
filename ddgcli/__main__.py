"""`python -m ddgcli` is the same as the `ddgcli` script."""

from ddgcli.cli.start import main

if __name__ == "__main__":
    main()
