"""An experiment's outcome as JSON, Markdown, CSV and pictures."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import Any

import lcdata
from lcdata.dataset.atomic import json_text, write_bytes
from lcdata.reproduce.experiment import Outcome, Table


def write_outcome(outcome: Outcome, folder: Path) -> list[Path]:
    """Write `<name>.json`, `<name>.md`, a CSV for each table, and its pictures.

    Returns:
        The files.

    Raises:
        OSError: The folder cannot be written.
    """
    content = {
        "experiment": outcome.name,
        "source": outcome.source,
        "protocol": outcome.protocol,
        "lcdata_version": lcdata.__version__,
        "values": _finite(outcome.values),
        "tables": [
            {"title": t.title, "header": t.header, "rows": t.rows, "note": t.note}
            for t in outcome.tables
        ],
    }
    texts = {folder / f"{outcome.name}.json": json_text(content)}
    texts[folder / f"{outcome.name}.md"] = markdown(outcome)
    for number, table in enumerate(outcome.tables):
        suffix = f"-{number + 1}" if len(outcome.tables) > 1 else ""
        texts[folder / f"{outcome.name}{suffix}.csv"] = _csv(table)
    files = {path: text.encode() for path, text in texts.items()}
    files |= {folder / name: picture for name, picture in outcome.pictures.items()}
    for path, content_of_file in files.items():
        write_bytes(path, content_of_file)
    return list(files)


def markdown(outcome: Outcome) -> str:
    """The outcome as a Markdown page."""
    parts = [f"# {outcome.name}", f"{outcome.source}.", outcome.protocol]
    for table in outcome.tables:
        rows = [table.header, ("---",) * len(table.header), *table.rows]
        lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
        parts += [f"## {table.title}", "\n".join(lines)]
        parts += [table.note] if table.note else []
    parts += [f"![{name}]({name})" for name in outcome.pictures]
    return "\n\n".join(parts) + "\n"


def _finite(value: Any) -> Any:
    """Plain values without NaN and infinity, which JSON lacks."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _csv(table: Table) -> str:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([table.header, *table.rows])
    return text.getvalue()
