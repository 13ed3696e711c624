"""YAML of people: where each key stands, and keys that are given twice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import yaml


class Parsed(NamedTuple):
    """A YAML document.

    Args:
        content: Plain values.
        root: Its nodes, which know their lines; None for an empty document.
    """

    content: Any
    root: yaml.Node | None


class Duplicate(NamedTuple):
    """A key that one mapping has twice: plain YAML keeps the last one and says nothing.

    Args:
        key: Its path, joined by dots.
        first: Line of the first one, from 1.
        second: Line of the next one.
    """

    key: str
    first: int
    second: int


def parse(text: str) -> Parsed:
    """Values and nodes of a document.

    Raises:
        yaml.YAMLError: It is not YAML.
    """
    return Parsed(yaml.safe_load(text), yaml.compose(text, Loader=yaml.SafeLoader))


def duplicates(root: yaml.Node | None) -> Iterator[Duplicate]:
    """Keys that are given twice, in mappings and in mappings within them."""
    left, known = [(root, "")], set()
    while left:
        node, path = left.pop()
        if id(node) in known:  # an alias may name what it is part of
            continue
        known.add(id(node))
        if isinstance(node, yaml.MappingNode):
            seen: dict[str, int] = {}
            for key, value in node.value:
                name, line = str(key.value), key.start_mark.line + 1
                if name in seen:
                    yield Duplicate(path + name, seen[name], line)
                seen[name] = line
                left.append((value, f"{path}{name}."))
        elif isinstance(node, yaml.SequenceNode):
            left += [(item, path) for item in node.value]


def line_of(node: yaml.Node | None, path: Sequence[str | int]) -> int | None:
    """Line of a key, from 1, or of the deepest part of its path that is there."""
    line = None
    for part in path:
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                if key.value == str(part):
                    line, node = key.start_mark.line + 1, value
                    break
            else:
                break
        elif isinstance(node, yaml.SequenceNode) and isinstance(part, int):
            node = node.value[part] if part < len(node.value) else None
            line = node.start_mark.line + 1 if node else line
    return line
