"""`python -m lcdata`."""

from __future__ import annotations

from lcdata.cli import main

if __name__ == "__main__":
    main()
