"""YAML of people: where each key stands, and keys that are given twice."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError


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


def describe(
    error: ValidationError, source: str, root: yaml.Node | None, model: type[BaseModel]
) -> str:
    """The first thing wrong in one line: file:line, key, value, and what is allowed.

    Args:
        error: What the model said of the document.
        source: Name of the file.
        root: Nodes of the document.
        model: What the document was to be.
    """
    first = error.errors()[0]
    path = [part for part in first["loc"] if isinstance(part, str | int)]
    line = line_of(root, path)
    where = f"{source}:{line}" if line else source
    key = ".".join(map(str, path))
    if first["type"] == "extra_forbidden":
        known = _keys_at(model, path[:-1])
        close = difflib.get_close_matches(str(path[-1]), known, n=1)
        hint = f"did you mean {close[0]}?" if close else f"known are {', '.join(known)}"
        return f"{where}: unknown key {key}: {hint}"
    message = first["msg"].removeprefix("Value error, ")
    message = message[:1].lower() + message[1:] if message[:5] == "Input" else message
    value = first["input"]
    if not key:
        return f"{where}: {message}"
    shown = repr(value)
    shown = shown if len(shown) <= 80 else shown[:77] + "..."
    return f"{where}: {key} is {shown}: {message}"


def _keys_at(model: type[BaseModel], path: Sequence[str | int]) -> list[str]:
    """Keys that are allowed at a place in the document."""
    section = model
    for part in path:
        if isinstance(part, str):
            section = next(_models(section.model_fields[part].annotation))
    return list(section.model_fields)


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Models within an annotation: of `list[Section] | None`, Section."""
    from pydantic import BaseModel

    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in getattr(annotation, "__args__", ()):
        yield from _models(part)
