"""Pieces of the page: pictures in the page itself, tables that sort, text to be copied."""

from __future__ import annotations

import base64
import math
import shlex
from collections.abc import Iterable, Sequence
from html import escape
from typing import NamedTuple

PNG, JPEG, WEBP = b"\x89PNG", b"\xff\xd8\xff", b"RIFF"
KINDS = {PNG: "png", JPEG: "jpeg", WEBP: "webp"}


class Cell(NamedTuple):
    """A cell of a table.

    Args:
        html: What is shown.
        key: What the column is sorted by: a number (NaN stays last, whichever way), or None for
            the text that is shown.
    """

    html: str
    key: float | None = None

    @property
    def tag(self) -> str:
        """As HTML."""
        if self.key is None:
            return f"<td>{self.html}</td>"
        return f'<td data-sort="{_number(self.key)}">{self.html}</td>'


class Group(NamedTuple):
    """Rows of a table that stay together, however it is sorted.

    Args:
        title: HTML of the line over them; empty for none.
        rows: The rows.
    """

    title: str
    rows: Sequence[Sequence[Cell]]


def table(head: Sequence[str], groups: Iterable[Group], kind: str = "") -> str:
    """A table that sorts within its groups where the browser runs scripts.

    Args:
        head: HTML of the columns' names.
        groups: The rows.
        kind: Further classes.
    """
    body = ""
    for group in groups:
        title = ""
        if group.title:
            title = (
                f'<tr class="scenario"><th scope="rowgroup" colspan="{len(head)}">'
                f"{group.title}</th></tr>"
            )
        rows = "".join(f"<tr>{''.join(cell.tag for cell in row)}</tr>" for row in group.rows)
        body += f"<tbody>{title}{rows}</tbody>"
    columns = "".join(f'<th scope="col">{name}</th>' for name in head)
    return (
        f'<div class="scroll"><table class="sortable{" " + kind if kind else ""}">'
        f"<thead><tr>{columns}</tr></thead>{body}</table></div>"
    )


def _number(key: float) -> str:
    """As JavaScript's Number() reads it; empty for NaN."""
    if math.isnan(key):
        return ""
    if math.isinf(key):
        return "Infinity" if key > 0 else "-Infinity"
    return f"{key:.9g}"


def items(texts: Iterable[str]) -> str:
    """A list of texts."""
    return f"<ul>{''.join(f'<li>{escape(text)}</li>' for text in texts)}</ul>"


def command(parts: Sequence[str]) -> str:
    """A command; the page's script puts a button beside it. Options stay with their values.

    Args:
        parts: Words, as a shell takes them apart.
    """
    lines: list[list[str]] = [[]]
    for part in parts:
        if part.startswith("--"):
            lines.append([])
        lines[-1].append(shlex.quote(part))
    spans = (f"<span>{escape(' '.join(line))}</span>" for line in lines)
    return f'<div class="copied"><code>{" ".join(spans)}</code></div>'


def copies(**texts: str) -> str:
    """The same table in other notations, to be opened and copied.

    Args:
        **texts: The table, by name of the notation.
    """
    *most, last = texts
    names = f"{', '.join(most)} or {last}" if most else last
    blocks = "".join(
        f'<div class="copied"><b>{name}</b><pre>{escape(text.strip())}</pre></div>'
        for name, text in texts.items()
    )
    return f'<details class="notations"><summary>This table as {names}</summary>{blocks}</details>'


def picture(light: bytes, dark: bytes, alt: str) -> str:
    """A plot that follows the page's theme."""
    return (
        f'<picture><source media="(prefers-color-scheme: dark)" srcset="{data(dark)}">'
        f'<img src="{data(light)}"{size(light)} alt="{escape(alt)}"></picture>'
    )


def captioned(light: bytes, dark: bytes, alt: str, caption: str) -> str:
    """A plot and what it shows."""
    return (
        f'<figure class="plot">{picture(light, dark, alt)}'
        f'<figcaption class="note">{escape(caption)}</figcaption></figure>'
    )


def size(picture: bytes) -> str:
    """Width and height of a PNG or plain WebP file, so that a page does not jump as it loads."""
    if picture.startswith(PNG):
        width, height = (int.from_bytes(picture[at : at + 4], "big") for at in (16, 20))
    elif picture[12:16] == b"VP8 ":
        width, height = (int.from_bytes(picture[a : a + 2], "little") & 0x3FFF for a in (26, 28))
    else:
        return ""
    return f' width="{width}" height="{height}"'


def data(picture: bytes) -> str:
    """A picture as a URL that needs no other file."""
    kind = next(kind for start, kind in KINDS.items() if picture.startswith(start))
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode()}"
