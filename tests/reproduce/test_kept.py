"""Rows that outlive a run that was stopped."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from lcdata.reproduce.kept import KeptRows, run_kept


@dataclass(frozen=True)
class Square:
    number: int
    square: int

    @property
    def key(self) -> int:
        return self.number


@dataclass(frozen=True)
class Number:
    number: int

    @property
    def key(self) -> int:
        return self.number


def squared(task: Number) -> Iterator[Square]:
    if task.number == 3:
        raise KeyboardInterrupt
    yield Square(task.number, task.number**2)


def test_a_stopped_run_goes_on_where_it_was(tmp_path):
    path = tmp_path / "deep" / "rows.jsonl"
    tasks = [Number(n) for n in (1, 2, 3, 4)]
    with pytest.raises(KeyboardInterrupt):
        run_kept("squares", tasks, KeptRows(path, lambda c: Square(**c)), squared, 1, None)
    kept = KeptRows(path, lambda c: Square(**c))
    assert kept.rows == {1: Square(1, 1), 2: Square(2, 4)}
    kept.add(Square(3, -9))
    seen = []
    rows = run_kept("squares", tasks, kept, squared, 1, lambda *step: seen.append(step))
    assert [row.square for row in rows] == [1, 4, -9, 16]
    assert seen == [("squares", 3, 4), ("squares", 4, 4)]


def test_lines_that_are_no_rows_are_left_out(tmp_path):
    path = tmp_path / "rows.jsonl"
    path.write_text('{"number": 1, "square": 1}\n{"number": 2}\n{"number": 3, "squ')
    assert set(KeptRows(path, lambda c: Square(**c)).rows) == {1}
