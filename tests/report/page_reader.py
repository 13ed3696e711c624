"""Reads the page as a person does: its words, pictures and tables."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from html.parser import HTMLParser

VOID = {"meta", "img", "source", "input", "br"}
NUMBER = r"-?∞|-?\d+(?:\.\d+)?"


def numbers(text: str) -> list[str]:
    """All numbers in a text, whatever stands between them."""
    return re.findall(NUMBER, text)


@dataclass
class Row:
    """Cells of a line, what each is sorted by, and the title over it."""

    group: str
    cells: list[str] = field(default_factory=list)
    keys: list[str | None] = field(default_factory=list)


@dataclass
class Table:
    head: list[str] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)


class Reader(HTMLParser):
    """Collects sources, visible text and tables, and checks that tags are closed."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sources: list[str] = []
        self.links: list[str] = []
        self.words: list[str] = []
        self.tables: list[Table] = []
        self.commands: list[str] = []
        self._group = ""
        self._cell: list[str] | None = None
        self.feed(page)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.sources += [v or "" for k, v in attrs if k in ("src", "srcset", "action")]
        self.links += [v or "" for k, v in attrs if k == "href"]
        if tag not in VOID:
            self.open.append(tag)
        if tag == "table":
            self.tables.append(Table())
            self._group = ""
        elif tag == "tr" and "tbody" in self.open and given.get("class") != "scenario":
            self.tables[-1].rows.append(Row(self._group))
        elif tag in {"td", "th"}:
            self._cell = []
            if tag == "td":
                self.tables[-1].rows[-1].keys.append(given.get("data-sort"))
        elif tag == "code":
            self.commands.append("")
        elif tag == "br" and self._cell is not None:
            self._cell.append(" ")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        if tag not in {"td", "th"} or self._cell is None:
            return
        text = " ".join("".join(self._cell).split())
        if tag == "td":
            self.tables[-1].rows[-1].cells.append(text)
        elif "tbody" in self.open:
            self._group = text
        else:
            self.tables[-1].head.append(text)
        self._cell = None

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in {"style", "script"}:
            return
        self.words.append(data)
        if self._cell is not None:
            self._cell.append(data)
        if "code" in self.open:
            self.commands[-1] += data

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def table(self, *head: str) -> list[Table]:
        """Tables whose head starts so."""
        return [table for table in self.tables if tuple(table.head[: len(head)]) == head]
