"""What all commands share: errors in one line, progress bars, JSON."""

from __future__ import annotations

import errno
import functools
import io
import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, ParamSpec, TypeVar

import typer

from lcdata.errors import LcdataError

if TYPE_CHECKING:
    from lcdata.evaluation.pool import Executor

P = ParamSpec("P")
R = TypeVar("R")

EXIT_FAILED = 1
EXIT_SOME_FAILED = 3
EXIT_INTERRUPTED = 130

debug = False
"""Set by `--debug`: errors are shown with their traceback."""

JsonFlag = Annotated[bool, typer.Option("--json", help="Machine-readable standard output.")]
Jobs = Annotated[
    int | None, typer.Option("--jobs", "-j", min=1, help="Processes; default: one a core.")
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        help="Run on Dask: tcp://HOST:PORT of a scheduler, or local[:N] for N workers here."
    ),
]
DatasetPath = Annotated[Path, typer.Argument(help="Folder of the data set.", show_default=False)]


def guarded(command: Callable[P, R]) -> Callable[P, R]:
    """Turn what goes wrong in a command into one line and an exit code."""

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        for stream in (sys.stdout, sys.stderr):  # names may not fit the terminal's encoding
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")
        if debug:
            return command(*args, **kwargs)
        try:
            return command(*args, **kwargs)
        except LcdataError as error:
            fail(str(error))
        except KeyboardInterrupt:
            print("lcdata: interrupted; the same command goes on from here", file=sys.stderr)
            raise typer.Exit(EXIT_INTERRUPTED) from None
        except BrokenPipeError:  # `lcdata info X | head`
            sys.stderr.close()
            raise typer.Exit(EXIT_FAILED) from None
        except OSError as error:
            fail(describe_os_error(error))
        except MemoryError:
            fail("out of memory: use fewer --jobs")
        except (typer.Exit, typer.BadParameter):
            raise
        except Exception as error:  # the last line of defence: a person sees one line
            detail = (str(error).strip().splitlines() or [""])[0]
            fail(f"internal error: {type(error).__name__}: {detail}: --debug shows where")

    return run


def describe_os_error(error: OSError) -> str:
    """One line with the file and a remedy where there is one."""
    remedies = {
        errno.ENOSPC: "free some space; the same command goes on from there",
        errno.EACCES: "check the permissions",
        errno.EROFS: "choose another output with -o",
        errno.EMFILE: "raise `ulimit -n`",
    }
    what = error.strerror or type(error).__name__
    where = f"{error.filename}: " if error.filename else ""
    remedy = remedies.get(error.errno or 0)
    return f"{where}{what}" + (f": {remedy}" if remedy else "")


def fail(message: str) -> NoReturn:
    """Print one line on standard error and end with exit code 1."""
    line = " ".join(message.split())
    print(f"lcdata: {line}", file=sys.stderr)
    raise typer.Exit(EXIT_FAILED)


def end_with(failures: Sequence[str]) -> None:
    """Name items that failed while others did not; exit code 3 if there are any."""
    for failure in failures:
        print(f"lcdata: {failure}", file=sys.stderr)
    if failures:
        raise typer.Exit(EXIT_SOME_FAILED)


def print_json(content: Any) -> None:
    """Print plain values as JSON; NaN, which JSON lacks, becomes null."""
    print(json.dumps(_plain(content), indent=2, allow_nan=False))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return value


@contextmanager
def progress_bar(quiet: bool = False) -> Iterator[Callable[[str, int, int], None] | None]:
    """A progress bar on standard error, or None where nobody watches.

    Yields:
        `report(stage, done, total)`; each new stage is a new line.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TaskID,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description:<22}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), speed_estimate_period=600) as bar:
        tasks: dict[str, TaskID] = {}

        def report(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=total)
            bar.update(tasks[stage], completed=done, total=total)

        yield report


def on_scheduler(scheduler: str | None, jobs: int | None) -> Executor | None:
    """What runs tasks on a Dask scheduler; None without one."""
    if scheduler is None:
        return None
    from lcdata.evaluation.cluster import cluster_executor

    return cluster_executor(
        scheduler, jobs, lambda words: typer.echo(f"lcdata: note: {words}", err=True)
    )


def counted(number: int, what: str) -> str:
    """`1 pair`, `2 pairs`."""
    return f"{number} {what}{'s' * (number != 1)}"


def names(text: str) -> list[str]:
    """Comma-separated names."""
    return [name.strip() for name in text.split(",") if name.strip()]
