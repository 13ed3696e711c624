"""lcdata info."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lcdata.cli.common import JsonFlag, end_with, guarded, print_json
from lcdata.errors import LcdataError

EXAMPLE = "lcdata info recordings/gym"


@guarded
def info(
    recording: Annotated[
        Path,
        typer.Argument(help="A bag or folder, or a folder of those.", show_default=False),
    ],
    rig: Annotated[
        Path | None, typer.Option(help="Rig file; default: rig.yaml beside the recording.")
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Show topics, clocks, dwells and pairs of a recording, and a rig to start from."""
    from lcdata.recording.source import find_recordings
    from lcdata.recording.summary import summarise
    from lcdata.rig import find_rig, load_rig

    found = rig or find_rig(recording)
    loaded = load_rig(found) if found else None
    summaries, failures = [], []
    for path in find_recordings(recording):
        try:
            summaries.append(summarise(path, loaded))
        except LcdataError as error:
            failures.append(str(error))
    if as_json:
        print_json({"recordings": [s.to_dict() for s in summaries], "failures": failures})
    else:
        for summary in summaries:
            print("\n".join(summary.lines()), end="\n\n")
    if failures and not summaries:
        raise LcdataError(failures[0])
    end_with(failures)
