"""The command line, one file a command."""

from __future__ import annotations

import sys


def main() -> None:
    """Entry point of the `lcdata` command."""
    from lcdata.cli import common
    from lcdata.cli.app import app

    arguments = sys.argv[1:]
    common.debug = "--debug" in arguments
    app(args=[argument for argument in arguments if argument != "--debug"], prog_name="lcdata")
